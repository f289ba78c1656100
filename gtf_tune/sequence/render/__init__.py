"""Render synthetic sequences with exact ground truth."""
