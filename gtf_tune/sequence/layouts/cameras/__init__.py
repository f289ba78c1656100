"""Read the camera that a file describes."""
