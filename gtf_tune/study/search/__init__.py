"""What to try next: the space and the samplers."""
