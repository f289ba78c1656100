"""Describe options that pycolmap's own documentation leaves out, from ``option_notes.toml``."""

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files

_SOLVER = "solver_options."


def option_note(name: str) -> str:
    """Return what an option means, by its dotted name; empty where nothing is noted."""
    notes = option_notes()
    if name in notes["options"]:
        return notes["options"][name]
    return notes["solver_options"].get(name.rpartition(_SOLVER)[2], "") if _SOLVER in name else ""


@cache
def option_notes() -> Mapping[str, Mapping[str, str]]:
    """Return all notes: by dotted name in ``options``, by field of Ceres' ``Solver::Options`` in ``solver_options``."""
    text = files("gtf_tune.pipelines.colmap").joinpath("option_notes.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)
