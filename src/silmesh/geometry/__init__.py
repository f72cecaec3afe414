"""What several stages measure alike, in images and on meshes; it knows nothing of files."""
