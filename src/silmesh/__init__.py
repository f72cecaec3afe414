"""From photographs of an object to a mesh, with nothing to set by hand."""
