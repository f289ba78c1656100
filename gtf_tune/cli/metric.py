"""Errors and scores of trajectory files that any program wrote."""

import math
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gtf_tune.cli.matching import Matching, matched_files
from gtf_tune.cli.parameters import Json
from gtf_tune.cli.terminal.console import number, write_json, write_line, write_pairs, write_table

if TYPE_CHECKING:
    from gtf_tune.api.trajectories import GtfAte
    from gtf_tune.metrics import ErrorStatistics
    from gtf_tune.trajectory import FloatArray


class Format(StrEnum):
    """Formats of trajectory files."""

    auto = "auto"
    tum = "tum"
    kitti = "kitti"
    euroc = "euroc"
    colmap = "colmap"


class Alignment(StrEnum):
    """Alignments."""

    sim3 = "sim3"
    se3 = "se3"
    none = "none"


class Relation(StrEnum):
    """What a relative error measures."""

    translation = "translation"
    rotation = "rotation"


class Unit(StrEnum):
    """Units of the distance between two poses."""

    frames = "frames"
    seconds = "seconds"
    metres = "metres"


class Pairs(StrEnum):
    """Ways to pair poses."""

    all = "all"
    consecutive = "consecutive"


class Aggregate(StrEnum):
    """Ways to make one number of the errors of all pairs."""

    median = "median"
    mean = "mean"
    gmean = "gmean"
    trimmed = "trimmed"


class Normalise(StrEnum):
    """Units of the score."""

    extent = "extent"
    none = "none"


_ASSOCIATIONS = MappingProxyType({"order": "order, which is right only where each file has a pose of every frame"})

Reference = Annotated[
    Path, typer.Argument(help="Reference trajectory (TUM, KITTI, EuRoC, COLMAP, nerfstudio, OpenSfM, Meshroom).")
]
Estimate = Annotated[Path, typer.Argument(help="Estimated trajectory.")]
AlignmentFlag = Annotated[Alignment, typer.Option("--alignment", help="How the estimate is laid on the reference.")]
FormatFlag = Annotated[Format, typer.Option("--format", help="Format of both files.")]
MaxDifference = Annotated[
    float, typer.Option("--max-difference", min=0.0, max=1e12, help="Association tolerance in seconds.")
]
Clean = Annotated[
    list[str], typer.Option("--clean", metavar="PATH|GLOB", help="Trajectories from clean images; repeatable.")
]
Noisy = Annotated[
    list[str], typer.Option("--noisy", metavar="PATH|GLOB", help="Trajectories from noisy images; repeatable.")
]
Offset = Annotated[float, typer.Option("--offset", help="Seconds added to the times of the estimate.")]
Delimiter = Annotated[
    str | None,
    typer.Option("--delimiter", help="What separates columns: ',', ';', tab, ... (default: found in the first line)."),
]


def ate(
    reference: Reference,
    estimate: Estimate,
    alignment: AlignmentFlag = Alignment.sim3,
    format_: FormatFlag = Format.auto,
    max_difference: MaxDifference = 0.02,
    offset: Offset = 0.0,
    delimiter: Delimiter = None,
    json: Json = False,
) -> None:
    """Print the absolute trajectory error over matched positions.

    Example: gtf-tune metric ate groundtruth.txt estimate.txt --alignment sim3
    """
    from gtf_tune.metrics import aligned_errors, summarise

    matching = Matching(format_.value, max_difference, offset, _character(delimiter))
    first, second = matched_files(reference, estimate, matching)
    _write(summarise(aligned_errors(first, second, alignment.value)), "unit of the reference", json)


def rpe(
    reference: Reference,
    estimate: Estimate,
    relation: Annotated[Relation, typer.Option("--relation", help="What is compared.")] = Relation.translation,
    delta: Annotated[
        float, typer.Option("--delta", min=1e-9, max=1e9, help="Distance between the two poses of a pair.")
    ] = 1.0,
    unit: Annotated[Unit, typer.Option("--unit", help="Unit of delta.")] = Unit.frames,
    pairs: Annotated[Pairs, typer.Option("--pairs", help="Every pose starts a pair, or only the last one's end.")] = (
        Pairs.all
    ),
    alignment: AlignmentFlag = Alignment.sim3,
    format_: FormatFlag = Format.auto,
    max_difference: MaxDifference = 0.02,
    offset: Offset = 0.0,
    delimiter: Delimiter = None,
    json: Json = False,
) -> None:
    """Print the relative pose error over pairs of poses.

    Example: gtf-tune metric rpe groundtruth.txt estimate.txt --delta 1 --unit frames
    """
    from gtf_tune.metrics import RpeSettings, rpe_errors, summarise

    matching = Matching(format_.value, max_difference, offset, _character(delimiter))
    first, second = matched_files(reference, estimate, matching)
    settings = RpeSettings(relation.value, delta, unit.value, pairs.value, alignment.value)
    shown = "degrees" if relation is Relation.rotation else "unit of the reference"
    errors = rpe_errors(first, second, settings)
    _require_pairs(errors, f"{delta:g} {unit.value}", len(first))
    _write(summarise(errors), shown, json)


def gtf(
    clean: Clean,
    noisy: Noisy,
    aggregate: Annotated[
        Aggregate,
        typer.Option("--aggregate", help="How the errors of all pairs become one number; mean is the paper's."),
    ] = Aggregate.median,
    normalise: Annotated[
        Normalise, typer.Option("--normalise", help="Divide errors by the extent of the clean trajectory, or not.")
    ] = Normalise.extent,
    alignment: Annotated[
        Alignment, typer.Option("--alignment", help="How a noisy trajectory is laid on a clean one.")
    ] = Alignment.sim3,
    format_: Annotated[Format, typer.Option("--format", help="Format of all files.")] = Format.auto,
    max_difference: MaxDifference = 0.01,
    json: Json = False,
) -> None:
    """Print the ground-truth-free score of trajectories that any program made.

    Give the trajectories of runs on clean images and of runs on images with added noise, as files, COLMAP models,
    folders of them, or glob patterns. Poses are associated by image name where all have names, else by time; by their
    order only where the files hold no times and equally many poses.

    Example: gtf-tune metric gtf --clean "runs/clean*.txt" --noisy "runs/noisy*.txt"
    """
    from gtf_tune.api.trajectories import gtf_ate, load_trajectories

    score = gtf_ate(
        load_trajectories(*clean, format=format_.value),
        load_trajectories(*noisy, format=format_.value),
        aggregate=aggregate.value,
        alignment=alignment.value,
        normalise=normalise.value,
        max_difference_s=max_difference,
    )
    if json:
        write_json(_score_values(score))
    else:
        _write_score(score)


def _score_values(score: "GtfAte") -> dict[str, Any]:
    arrays = {name: getattr(score, name).tolist() for name in ("matrix", "matched", "collapsed")}
    errors = [{"clean": i, "noisy": j, "reason": reason} for (i, j), reason in score.pair_errors.items()]
    return {**vars(score), **arrays, "pair_errors": errors}


def _write_score(score: "GtfAte") -> None:
    factor, unit = (1000, "‰ of extent") if score.unit == "extent" else (1, "unit of the clean trajectories")
    known = all(map(math.isfinite, score.interval))
    ends = " to ".join(number(factor * end) for end in score.interval)
    low, high = score.matched.min(), score.matched.max()
    write_pairs(
        {
            "GTF ATE": f"{number(factor * score.value)} {unit}",
            "95 % interval": ends if known else "too few runs for an interval",
            "associated by": _ASSOCIATIONS.get(score.association, score.association),
            "matched poses": f"{low}" if low == high else f"{low} to {high}",
            "collapsed": f"{score.collapsed.sum()} of {score.collapsed.size} noisy trajectories",
        }
    )
    write_line("")
    clean, noisy = (_short_names(names) for names in (score.clean, score.noisy))
    rows = [[name, *(number(factor * error) for error in row)] for name, row in zip(clean, score.matrix, strict=True)]
    write_table([f"[{unit}]", *(f">{name}" for name in noisy)], rows)
    for (i, j), reason in score.pair_errors.items():
        write_line(f"{score.clean[i]} and {score.noisy[j]}: {reason}")


def _short_names(paths: Sequence[str]) -> list[str]:
    """Return the paths without what all of them have in common at either end."""
    parts = [Path(path).parts for path in paths]
    while min(map(len, parts)) > 1 and len({names[0] for names in parts}) == 1:
        parts = [names[1:] for names in parts]
    while min(map(len, parts)) > 1 and len({names[-1] for names in parts}) == 1:
        parts = [names[:-1] for names in parts]
    return ["/".join(names) for names in parts]


def _character(delimiter: str | None) -> str | None:
    return "\t" if delimiter in ("tab", r"\t") else delimiter


def _require_pairs(errors: "FloatArray", distance: str, poses: int) -> None:
    from gtf_tune.errors import TrajectoryError

    if not len(errors):
        raise TrajectoryError(
            f"expected two of the {poses} matched poses {distance} apart, but no two are; lower --delta, or choose "
            "another --unit"
        )


def _write(statistics: "ErrorStatistics", unit: str, json: bool) -> None:
    values = vars(statistics)
    if json:
        write_json({**values, "unit": unit})
        return
    shown = {name: f"{value}" if name == "count" else number(value) for name, value in values.items()}
    write_pairs({**shown, "unit": unit})
