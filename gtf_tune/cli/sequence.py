"""Check data sets, take frames out of videos, render a scene."""

import shlex
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.cli.parameters import Frames, Json
from gtf_tune.cli.sequence_flags import (
    CameraFlag,
    CameraGrouping,
    Cameras,
    Exclude,
    Recursive,
    load_as_asked,
    parse_selection,
)
from gtf_tune.cli.terminal.console import duration, number, say, write_json, write_line, write_pairs

if TYPE_CHECKING:
    from gtf_tune.sequence import Sequence, SequenceReport
    from gtf_tune.sequence.inspection import CameraReport


_NAMED = 4
_FIRST_RANGE = "mapper.max_normalized_reproj_error=1e-4:1e-1:log"


class Choice(StrEnum):
    """Name the ways to choose a frame of each period."""

    sharpest = "sharpest"
    regular = "regular"


def inspect(
    path: Annotated[Path, typer.Argument(help="Folder of images, or a data set.")],
    layout: Annotated[str, typer.Option("--layout", help="Force a layout; see 'sequence layouts'.")] = "auto",
    frames: Frames = None,
    exclude: Exclude = None,
    recursive: Recursive = False,
    camera: CameraFlag = None,
    cameras: Cameras = CameraGrouping.auto,
    json: Json = False,
) -> None:
    """Print what a data set holds, and warn of what will hurt.

    Example: gtf-tune sequence inspect images/
    """
    from gtf_tune.definition.model import name_from
    from gtf_tune.sequence import FEWEST_FRAMES, inspect_sequence

    loaded = load_as_asked(path, parse_selection(frames, exclude, recursive, cameras), camera, layout=layout)
    report = inspect_sequence(_with_colmap_prior(loaded))
    if json:
        write_json(asdict(report))
        return
    write_pairs(_described(report))
    for note in report.notes:
        write_line(f"note: {note}")
    for warning in report.warnings:
        write_line(f"warning: {warning}")
    if report.frames >= FEWEST_FRAMES:
        chosen = [word for given in frames or [] for word in ("--frames", given)]
        chosen += [word for given in exclude or [] for word in ("--exclude", given)]
        chosen += ["--recursive"] * recursive + (["--camera", camera] if camera else [])
        chosen += ["--cameras", cameras.value] if cameras is not CameraGrouping.auto else []
        words = ["create", name_from(report.name), "--sequence", str(path), *chosen, "--range", _FIRST_RANGE]
        say(f"Next: gtf-tune study {shlex.join(words)}")


def layouts() -> None:
    """Say which data sets are understood, what to download and where to put it.

    Example: gtf-tune sequence layouts
    """
    from gtf_tune.sequence import layout_help

    for name, text in layout_help().items():
        write_line(f"{name}\n    {' '.join(text.split())}")


def extract(
    video: Annotated[Path, typer.Argument(help="Video file.")],
    folder: Annotated[Path, typer.Argument(help="New folder for the frames.")],
    rate_hz: Annotated[float, typer.Option("--rate-hz", min=1e-6, max=1e6, help="Frames to take a second.")] = 5.0,
    choice: Annotated[Choice, typer.Option("--choice", help="Which frame of each period.")] = Choice.sharpest,
    max_frames: Annotated[
        int, typer.Option("--max-frames", min=0, max=10**9, help="Stop after so many (0: no limit).")
    ] = 0,
) -> None:
    """Extract frames from a video, by default the sharpest of each period.

    Example: gtf-tune sequence extract walk.mp4 images/ --rate-hz 3
    """
    from gtf_tune.sequence import Extraction, extract_video

    extract_video(video, folder, Extraction(rate_hz=rate_hz, choice=choice.value, max_frames=max_frames))
    say(f"wrote frames to {folder}")
    say(f"Next: gtf-tune sequence inspect {shlex.quote(str(folder))}")


def render(
    folder: Annotated[Path, typer.Argument(help="New folder for the sequence.")],
    frames: Annotated[int, typer.Option("--frames", min=2, max=10**6, help="Number of frames.")] = 24,
    seed: Annotated[
        int, typer.Option("--seed", min=0, max=2**31 - 1, help="Another seed gives another room and path.")
    ] = 0,
) -> None:
    """Render a textured room with exact ground truth.

    Example: gtf-tune sequence render storage/data/room
    """
    from gtf_tune.sequence import RoomSpec, render_room

    render_room(folder, RoomSpec(num_frames=frames, seed=seed))
    say(f"rendered {frames} frames into {folder}")
    say(f"Next: gtf-tune sequence inspect {shlex.quote(str(folder))}")


def _with_colmap_prior(sequence: "Sequence") -> "Sequence":
    """Return a sequence of unknown intrinsics with the focal length that COLMAP's pipelines read from EXIF."""
    from gtf_tune.pipelines import create_pipeline, with_focal_prior

    return with_focal_prior(sequence, create_pipeline("glomap"))


def _cameras(report: "SequenceReport") -> dict[str, str]:
    """Return size and intrinsics of the only camera, or a line for each of several with its images."""
    if len(report.cameras) == 1:
        return {"images": _size(report.cameras[0]), "intrinsics": _intrinsics(report.cameras[0])}
    lines = {"images": f"of {len(report.cameras)} cameras"}
    for position, camera in enumerate(report.cameras, 1):
        names = ", ".join(camera.images[:_NAMED])
        more = f" and {len(camera.images) - _NAMED} more" if len(camera.images) > _NAMED else ""
        counted = "1 image" if len(camera.images) == 1 else f"{len(camera.images)} images"
        lines[f"camera {position}"] = f"{counted} of {_size(camera)}: {names}{more}"
        lines[f"intrinsics {position}"] = _intrinsics(camera)
    return lines


def _size(camera: "CameraReport") -> str:
    size = f"{camera.width}x{camera.height} pixels"
    if (camera.stored_width, camera.stored_height) != (camera.width, camera.height):
        size += f", resized from {camera.stored_width}x{camera.stored_height}"
    return size


def _intrinsics(camera: "CameraReport") -> str:
    if camera.intrinsics is not None:
        params = " ".join(number(value) for value in camera.intrinsics.params)
        return f"{camera.intrinsics.model} {params} (field of view {camera.field_of_view_deg:.0f} degrees)"
    if camera.focal_prior is not None:
        return f"unknown; glomap and colmap start from a focal length of {number(camera.focal_prior)} pixels"
    return "unknown; the pipeline will estimate them"


def _described(report: "SequenceReport") -> dict[str, str]:
    timing = f", {report.rate_hz:.3g} Hz over {duration(report.duration_s)}" if report.rate_hz else ", no timestamps"
    truth = "none"
    if report.ground_truth_frames:
        truth = f"{report.ground_truth_frames} of {report.frames} frames, extent {number(report.ground_truth_extent)}"
    return {
        "sequence": f"{report.name} ({report.layout})",
        "frames": f"{report.frames}{timing}",
        **_cameras(report),
        "ground truth": truth,
        "texture": f"{report.median_corners:.0f} corners in the median of {report.checked_frames} frames",
        "motion": f"{report.median_shift_px:.1f} pixels from frame to frame (median)",
    }
