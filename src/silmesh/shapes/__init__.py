"""Initial meshes: what the fit starts from, made at unit size and placed by the silhouettes."""
