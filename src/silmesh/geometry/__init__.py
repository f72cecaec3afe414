"""Cameras, the visual hull and meshes: the geometry that every stage stands on."""
