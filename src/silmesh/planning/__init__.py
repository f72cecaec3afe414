"""What is to be made, checked before any work, and what makes it run again."""
