"""Say which studies make the paper's figures: its own where its data is there, light forms of them elsewhere."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from experiments.ablation import pairs
from experiments.paper.numbers import ROWS
from experiments.plan import FIXED, OPTIONS, Experiment, Option
from gtf_tune.definition import load_definition
from gtf_tune.sequence.render.room import RoomSpec

DEFINITIONS = Path("studies/paper")
HUBER = OPTIONS["huber"].name
PAPERS_HUBER = 0.1
COLMAPS_HUBER = 1.0
SIGMA = 5.0

_SIZE: Mapping[str, Any] = {"num_frames": 50, "width": 256, "height": 192, "frame_rate_hz": 3.0}
STANDINS: Mapping[str, RoomSpec] = {
    "office": RoomSpec(**_SIZE, seed=1),
    "outdoor": RoomSpec(**_SIZE, seed=2, motion="forward", flicker=0.15),
    "plain": RoomSpec(**_SIZE, seed=3, contrast=0.4),
}
"""Rendered for Replica's office 0 (a walk past furniture), an outdoor sequence (a walk straight on in changing light),
and one with little texture."""

_LIGHT: Mapping[str, Any] = {
    **FIXED,
    "extraction.sift.max_num_features": 200,
    "sequential.overlap": 4,
    "sequential.quadratic_overlap": False,
}
PIPELINE: Mapping[str, Any] = {"name": "glomap", "settings": {"pairing": "sequential"}, "options": dict(_LIGHT)}
"""The light pipeline: features and pairs are few, everything else is GLOMAP's."""

LADDER = (1.0, 2.0, 5.0, 10.0)
LADDER_RUNS = 2
_RUNS = 3
_MANY_RUNS = 12
_SIGMAS = (1.0, 20.0)
_GRIDS: Mapping[str, tuple[float, ...]] = {
    "ba": (1e-3, 3e-3, 3e-2),
    "huber": (0.03, 0.3, COLMAPS_HUBER),
    "twoview": (1.0, 2.0, 8.0),
    "ratio": (0.7, 0.85),
    "peak": (0.0033, 0.015),
}
"""Thinned: the paper has some ten to a hundred values of each, and nominal is tried as well."""

_FIRST = "office"


@dataclass(frozen=True)
class PaperStudy(Experiment):
    """One study of a figure: ``table``, ``noise``, ``k-delta`` or ``ablation``; ``name`` is that of its study."""

    figure: str = "table"
    name: str = ""
    data: Mapping[str, Any] = field(default_factory=dict, compare=False)

    @property
    def study(self) -> str:
        """Return the name of its study."""
        return self.name


def light_studies(folder: Path) -> list[PaperStudy]:
    """Return the studies on rendered stand-ins below a folder, those that say most first."""
    swept = {short: _thinned(short) for short in _GRIDS}
    table = [_light(folder, name, swept[short], "table") for short in swept for name in STANDINS]
    quick = [study for study in table if study.option.short in ("ba", "huber")]
    noise = [_light(folder, _FIRST, swept["ba"], "noise", sigma=sigma) for sigma in _SIGMAS]
    many = _light(folder, _FIRST, swept["ba"], "k-delta", noisy_runs=_MANY_RUNS)
    ablated = [
        _light(folder, _FIRST, Option(f"ablation-{name}", name, ends, label), "ablation")
        for label, (name, ends) in pairs().items()
    ]
    return [*quick, many, *noise, *(study for study in table if study not in quick), *ablated]


def full_studies(data: Path, thin: int) -> list[PaperStudy]:
    """Return the paper's own studies of GLOMAP whose sequences lie below ``data``, with grids of ``thin`` points."""
    found = []
    for path in sorted(DEFINITIONS.rglob("*.toml")):
        definition = load_definition(path)
        (sequence,) = definition.sequences
        (name, axis), *_ = definition.space.items()
        folder = data / Path(sequence.path).as_posix().partition("storage/data/")[2]
        if definition.pipeline.name != "glomap" or not folder.exists():
            continue
        given = definition.model_dump(mode="json", exclude_unset=True)
        given["sequences"][0]["path"] = str(folder.absolute())
        if hasattr(axis, "points"):
            given["space"][name]["points"] = min(axis.points or thin, thin)
        short = next((short for short, option in OPTIONS.items() if option.name == name), name)
        figure = {"glomap": "table"}.get(path.parent.name, path.parent.name)
        sigma = definition.gtf.noise_sigma
        noisy = definition.gtf.noisy_runs_max
        option = Option(short, name, (), OPTIONS[short].paper_column if short in OPTIONS else name)
        found.append(PaperStudy(sequence.name, option, float(sigma), noisy, figure, definition.name, given))
    return found


def stands_for(sequence: str, printed: str) -> bool:
    """Whether a sequence is that of a row of the paper's table, or its stand-in."""
    rows = [row.sequence for row in ROWS]
    own = dict(zip(STANDINS, rows, strict=True)).get(sequence, sequence)
    return _letters(own) == _letters(printed)


def _letters(text: str) -> str:
    return "".join(filter(str.isalnum, text)).lower()


def _thinned(short: str) -> Option:
    option = OPTIONS[short]
    return Option(short, option.name, _GRIDS[short], option.paper_column)


def _light(
    folder: Path, sequence: str, option: Option, figure: str, *, sigma: float = SIGMA, noisy_runs: int = _RUNS
) -> PaperStudy:
    name = f"paper-{figure}-{sequence}-{option.short.replace('.', '-')}"
    name += "" if figure != "noise" else f"-{sigma:g}"
    data = {
        "name": name,
        "pipeline": {**PIPELINE, "nominal": {HUBER: PAPERS_HUBER}},
        "sequences": [{"name": sequence, "path": str((folder / sequence).absolute())}],
        "space": {option.name: {"values": list(option.values)}},
        "gtf": {
            "clean_runs": 1,
            "noisy_runs": noisy_runs,
            "noise_sigma": sigma,
            "aggregate": "mean",
            "normalise": "none",
        },
        "search": {"sampler": "grid"},
        "limits": {"run_timeout_s": 3600},
    }
    return PaperStudy(sequence, option, sigma, noisy_runs, figure, name, data)
