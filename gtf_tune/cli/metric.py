"""Compare trajectory files, with or without gtf-tune's studies."""

from pathlib import Path
from typing import Annotated

import typer

from gtf_tune.cli.parameters import Json

app = typer.Typer(help="Compute trajectory errors from files.", no_args_is_help=True)

Reference = Annotated[Path, typer.Argument(help="Reference trajectory (TUM, KITTI, EuRoC or COLMAP).")]
Estimate = Annotated[Path, typer.Argument(help="Estimated trajectory.")]
Alignment = Annotated[str, typer.Option("--alignment", help="sim3, se3 or none.")]
Format = Annotated[str, typer.Option("--format", help="tum, kitti, euroc, colmap or auto.")]
MaxDifference = Annotated[float, typer.Option("--max-difference", help="Association tolerance in seconds.")]


@app.command("ate")
def ate_command(
    reference: Reference,
    estimate: Estimate,
    alignment: Alignment = "sim3",
    format: Format = "auto",
    max_difference: MaxDifference = 0.02,
    json: Json = False,
) -> None:
    """Print the absolute trajectory error (RMSE over matched positions).

    Example: gtf-tune metric ate groundtruth.txt estimate.txt --alignment sim3
    """
    from gtf_tune.metrics import ate_statistics

    first, second = _matched(reference, estimate, format, max_difference)
    _print(ate_statistics(second, first, alignment=_alignment(alignment)), "unit of the reference", json)


@app.command("rpe")
def rpe_command(
    reference: Reference,
    estimate: Estimate,
    relation: Annotated[str, typer.Option("--relation", help="translation or rotation.")] = "translation",
    delta: Annotated[float, typer.Option("--delta", help="Distance between the poses of a pair.")] = 1.0,
    unit: Annotated[str, typer.Option("--unit", help="frames, seconds or metres.")] = "frames",
    pairs: Annotated[str, typer.Option("--pairs", help="all or consecutive.")] = "all",
    alignment: Alignment = "sim3",
    format: Format = "auto",
    max_difference: MaxDifference = 0.02,
    json: Json = False,
) -> None:
    """Print the relative pose error over pairs of poses.

    Example: gtf-tune metric rpe groundtruth.txt estimate.txt --delta 1 --unit frames
    """
    from gtf_tune.metrics import RpeSettings, rpe_statistics

    first, second = _matched(reference, estimate, format, max_difference)
    settings = RpeSettings.checked(relation=relation, delta=delta, unit=unit, pairs=pairs)
    statistics = rpe_statistics(second, first, settings, alignment=_alignment(alignment))
    _print(statistics, "degrees" if relation == "rotation" else "unit of the reference", json)
