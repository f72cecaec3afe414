"""What people look at: tables, loss figures, pictures of the meshes, and the page with them."""
