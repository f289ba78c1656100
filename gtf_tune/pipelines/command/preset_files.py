"""Find the definitions of programs that come with gtf-tune."""

import tomllib
from importlib.resources import files
from typing import Any

from gtf_tune.errors import DefinitionError, did_you_mean

_SUFFIX = ".toml"
_RUN_HERE = ("colmap-3.8",)


def preset_names() -> tuple[str, ...]:
    """Return the names of all presets, sorted."""
    folder = files("gtf_tune.pipelines.command") / "presets"
    return tuple(sorted(file.name.removesuffix(_SUFFIX) for file in folder.iterdir() if file.name.endswith(_SUFFIX)))


def how_tried(name: str) -> str:
    """Return how a preset was tried: with its program, or against the sources of its program only."""
    return "run here" if name in _RUN_HERE else "checked against the program's sources, never run"


def load_preset(name: str) -> dict[str, Any]:
    """Return the tables of a preset, or raise `DefinitionError` with the nearest names."""
    if name not in preset_names():
        hint = did_you_mean(name, preset_names(), cutoff=0.4, otherwise=f"known are {', '.join(preset_names())}")
        raise DefinitionError(f"there is no preset '{name}'; {hint}")
    path = files("gtf_tune.pipelines.command") / "presets" / f"{name}{_SUFFIX}"
    return tomllib.loads(path.read_text(encoding="utf-8"))
