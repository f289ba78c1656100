"""Choose the magnitude of the noise."""
