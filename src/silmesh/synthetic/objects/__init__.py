"""The made-up objects. Each module has the same four things.

``BOX``       lower and upper corner of a box that holds the object, in the world
``VOXEL``     side of the cubes that it is meshed with
``distance``  signed distance to its surface: from points [n, 3] to [n]
``paint``     its colour and shine there: from points [n, 3] to [n, 4], see ``paints``

Together they stand for the cases on which the report *Auto-Initialising Differentiable
Renderers* compares initial meshes.
"""
