"""Inputs from afar: archives and folders by ``https://`` and ``s3://``, fetched once and unpacked."""
