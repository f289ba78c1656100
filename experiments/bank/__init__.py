"""Stored runs of many configurations on many sequences, on which rules are replayed."""
