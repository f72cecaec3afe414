"""The fit: a mesh's parameters moved by Adam until its soft silhouettes match the given ones."""
