"""Compare trajectory files, as evo does."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.cli.matching import matched_files
from gtf_tune.cli.parameters import Json
from gtf_tune.cli.terminal.console import number, write_json, write_pairs
from gtf_tune.cli.terminal.grouping import GroupedCommands

if TYPE_CHECKING:
    from gtf_tune.metrics import ErrorStatistics
    from gtf_tune.trajectory import FloatArray

app = typer.Typer(cls=GroupedCommands, help="Compute trajectory errors from files.", no_args_is_help=True)


class Format(StrEnum):
    """Name the formats of trajectory files."""

    auto = "auto"
    tum = "tum"
    kitti = "kitti"
    euroc = "euroc"
    colmap = "colmap"


class Alignment(StrEnum):
    """Name the alignments."""

    sim3 = "sim3"
    se3 = "se3"
    none = "none"


class Relation(StrEnum):
    """Name what a relative error measures."""

    translation = "translation"
    rotation = "rotation"


class Unit(StrEnum):
    """Name the units of the distance between two poses."""

    frames = "frames"
    seconds = "seconds"
    metres = "metres"


class Pairs(StrEnum):
    """Name the ways to pair poses."""

    all = "all"
    consecutive = "consecutive"


Reference = Annotated[Path, typer.Argument(help="Reference trajectory (TUM, KITTI, EuRoC or COLMAP).")]
Estimate = Annotated[Path, typer.Argument(help="Estimated trajectory.")]
AlignmentFlag = Annotated[Alignment, typer.Option("--alignment", help="How the estimate is laid on the reference.")]
FormatFlag = Annotated[Format, typer.Option("--format", help="Format of both files.")]
MaxDifference = Annotated[float, typer.Option("--max-difference", min=0.0, help="Association tolerance in seconds.")]


@app.command("ate")
def ate(
    reference: Reference,
    estimate: Estimate,
    alignment: AlignmentFlag = Alignment.sim3,
    format_: FormatFlag = Format.auto,
    max_difference: MaxDifference = 0.02,
    json: Json = False,
) -> None:
    """Print the absolute trajectory error over matched positions.

    Example: gtf-tune metric ate groundtruth.txt estimate.txt --alignment sim3
    """
    from gtf_tune.metrics import aligned_errors, summarise

    first, second = matched_files(reference, estimate, format_.value, max_difference)
    _write(summarise(aligned_errors(first, second, alignment.value)), "unit of the reference", json)


@app.command("rpe")
def rpe(
    reference: Reference,
    estimate: Estimate,
    relation: Annotated[Relation, typer.Option("--relation", help="What is compared.")] = Relation.translation,
    delta: Annotated[float, typer.Option("--delta", help="Distance between the two poses of a pair.")] = 1.0,
    unit: Annotated[Unit, typer.Option("--unit", help="Unit of delta.")] = Unit.frames,
    pairs: Annotated[Pairs, typer.Option("--pairs", help="Every pose starts a pair, or only the last one's end.")] = (
        Pairs.all
    ),
    alignment: AlignmentFlag = Alignment.sim3,
    format_: FormatFlag = Format.auto,
    max_difference: MaxDifference = 0.02,
    json: Json = False,
) -> None:
    """Print the relative pose error over pairs of poses.

    Example: gtf-tune metric rpe groundtruth.txt estimate.txt --delta 1 --unit frames
    """
    from gtf_tune.metrics import RpeSettings, rpe_errors, summarise

    first, second = matched_files(reference, estimate, format_.value, max_difference)
    settings = RpeSettings(relation.value, delta, unit.value, pairs.value, alignment.value)
    shown = "degrees" if relation is Relation.rotation else "unit of the reference"
    errors = rpe_errors(first, second, settings)
    _require_pairs(errors, f"{delta:g} {unit.value}", len(first))
    _write(summarise(errors), shown, json)


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
