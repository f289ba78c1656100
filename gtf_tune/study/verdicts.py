"""Name the verdicts of a confirmation, for those who only read them."""

ADOPT = "adopt"
KEEP = "keep nominal"
NO_VERDICT = "none"
"""Nominal did not work, so there was nothing to compare with."""
