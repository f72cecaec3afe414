"""What a person gives: photographs, masks or a video of one object, and what they show."""
