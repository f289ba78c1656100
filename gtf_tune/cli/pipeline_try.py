"""Run a pipeline once and show everything that it does."""

import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.cli.measure.runs import Options, Seed
from gtf_tune.cli.parameters import Frames, Keep, Settings, new_folder
from gtf_tune.cli.sequence_flags import (
    CameraFlag,
    CameraGrouping,
    Cameras,
    Exclude,
    Recursive,
    load_as_asked,
    parse_selection,
)
from gtf_tune.cli.terminal.console import number, printable, say, write_pairs
from gtf_tune.cli.values import parse_pairs
from gtf_tune.errors import RunError

if TYPE_CHECKING:
    from gtf_tune.pipelines.run import RunOutcome
    from gtf_tune.sequence import Sequence

_MOST_LISTED = 12
_GIB = 2**30


def try_pipeline(
    definition: Annotated[str, typer.Argument(metavar="PIPELINE|FILE.toml", help="A pipeline, or its definition.")],
    sequence: Annotated[Path, typer.Option("--sequence", "-s", help="Folder of images.")],
    option: Options = None,
    setting: Settings = None,
    frames: Frames = None,
    exclude: Exclude = None,
    recursive: Recursive = False,
    camera: CameraFlag = None,
    cameras: Cameras = CameraGrouping.auto,
    seed: Seed = 0,
    memory_gb: Annotated[float, typer.Option("--memory-gb", min=0.1, max=1e6, help="Memory that it may take.")] = 16,
    keep: Keep = None,
) -> None:
    """Run a pipeline once and show everything that it does, to debug a definition.

    Its output is shown as it comes. All files of the run are kept: what it was given, what it wrote, its log.

    Example: gtf-tune pipeline try my_slam.toml -s photos/ -o max_features=500
    """
    from gtf_tune.execution import RunLimits
    from gtf_tune.execution.watched import run_watched
    from gtf_tune.pipelines.run import RunRequest
    from gtf_tune.study.systems import named_pipeline

    pipeline, own = named_pipeline(definition, parse_pairs(setting, "--setting"))
    options = pipeline.options.check({**own, **parse_pairs(option, "--option")})
    loaded = load_as_asked(sequence, parse_selection(frames, exclude, recursive, cameras), camera)
    folder = new_folder(keep) if keep else Path(tempfile.mkdtemp(prefix="gtf-tune-try-"))
    request = RunRequest(pipeline, options, loaded, "clean", 0, noise_sigma=0.0, noise_seed=0, seed=seed)
    say(f"one clean run of {pipeline.name} on {len(loaded)} frames; its files stay in {folder}")
    outcome = run_watched(request, RunLimits(float("inf"), round(memory_gb * _GIB)), folder, _show)
    _write_placeholders(folder)
    write_pairs(_facts(outcome, loaded) | {"files": str(folder)})
    if outcome.status != "ok":
        raise RunError(f"{outcome.error}; its files are in {folder}")


def _show(text: str) -> None:
    sys.stderr.write(printable(text))
    sys.stderr.flush()


def _write_placeholders(folder: Path) -> None:
    from gtf_tune.pipelines.command import PLACEHOLDERS

    for path in folder.rglob(PLACEHOLDERS):
        say("placeholders:")
        _show("".join(f"  {line}\n" for line in path.read_text(encoding="utf-8").splitlines()))


def _facts(outcome: "RunOutcome", sequence: "Sequence") -> dict[str, str]:
    poses = set(outcome.trajectory.frame_ids.tolist())
    missing = [frame.path.name for frame in sequence.frames if frame.frame_id not in poses]
    more = f" and {len(missing) - _MOST_LISTED} more" if len(missing) > _MOST_LISTED else ""
    facts = {"result": "a trajectory" if outcome.status == "ok" else f"failed: {outcome.error}"}
    facts["frames with a pose"] = f"{len(sequence) - len(missing)} of {len(sequence)}"
    if missing and len(poses):
        facts["without a pose"] = ", ".join(missing[:_MOST_LISTED]) + more
    facts |= {name: str(value) for name, value in outcome.diagnostics.items()}
    facts["time"] = f"{outcome.wall_s:.1f} s"
    facts["memory"] = f"{outcome.peak_memory_bytes / _GIB:.2f} GiB at most"
    return facts | _errors(outcome, sequence)


def _errors(outcome: "RunOutcome", sequence: "Sequence") -> dict[str, str]:
    """Return the error against ground truth, where there is one and the poses suffice."""
    from gtf_tune.errors import TrajectoryError
    from gtf_tune.metrics import ate

    if sequence.ground_truth is None or outcome.status != "ok":
        return {}
    try:
        error = ate(sequence.ground_truth, outcome.trajectory)
    except TrajectoryError as reason:
        return {"true ATE": f"unknown: {reason}"}
    return {"true ATE": f"{number(error)} in the unit of the ground truth"}
