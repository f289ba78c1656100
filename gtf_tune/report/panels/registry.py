"""The panels of a report; a new one is a module here that defines ``PANEL``, and its name in `KINDS`."""

from importlib import import_module

from gtf_tune.report.panels.base import Panel

KINDS = (
    "verdict",
    "models",
    "options",
    "agreement",
    "trajectories",
    "matrices",
    "frames",
    "images",
    "search",
    "trials",
    "coverage",
    "failures",
    "costs",
    "timeline",
    "reproducibility",
)
"""All panels by the names of their modules, in the order in which a report shows them."""


def panel(kind: str) -> Panel:
    """Return the panel of a kind."""
    found: Panel = import_module(f"{__package__}.{kind}").PANEL
    return found
