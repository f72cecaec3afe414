"""The command ``silmesh``: photographs of one object to a mesh, by the workflow in a cache."""
