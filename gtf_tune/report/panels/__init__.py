"""Compose the panels of a report from tables, figures and sentences."""
