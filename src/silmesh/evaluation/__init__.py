"""How good a fitted mesh is: in the image, beside a true mesh, and as a mesh."""
