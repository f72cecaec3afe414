"""What outlines cannot show: the surface moves to where the photographs agree."""
