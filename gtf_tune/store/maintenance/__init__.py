"""Check, copy and compare databases."""
