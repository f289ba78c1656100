"""Offer everything on the command line; the only layer that prints."""
