"""Which runs a configuration needs, and where they come from."""
