"""Cameras: the one convention (``camera``), and a module for each source of them."""
