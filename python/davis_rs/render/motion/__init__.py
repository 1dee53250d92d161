"""What moves and changes in a scene besides the camera."""
