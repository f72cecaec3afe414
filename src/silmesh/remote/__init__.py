"""Inputs from afar: archives and folders of ``https://`` and ``s3://``, fetched and unpacked."""
