"""Flags that say how a sequence is read, and what they stand for."""

import re
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gtf_tune.cli.values import parse_frames, parse_value
from gtf_tune.errors import DefinitionError

if TYPE_CHECKING:
    from gtf_tune.sequence import Selection, Sequence

CameraFlag = Annotated[
    str | None,
    typer.Option(
        "--camera",
        metavar="unknown|MODEL,P1,P2,...",
        help="Intrinsics instead of the data set's: a COLMAP model and its parameters for the stored images.",
    ),
]
Exclude = Annotated[
    list[str] | None,
    typer.Option("--exclude", metavar="GLOB", help="Leave out images whose names fit a pattern; repeatable."),
]
Recursive = Annotated[bool, typer.Option("--recursive", help="Take the images of subfolders too.")]


class CameraGrouping(StrEnum):
    """Name which images share a camera."""

    auto = "auto"
    one = "one"
    per_folder = "per-folder"
    per_image = "per-image"
    largest = "largest"


Cameras = Annotated[
    CameraGrouping,
    typer.Option(
        "--cameras",
        help="Which images share a camera: by size and EXIF, all, or those of a folder; or use the largest group only.",
    ),
]


def parse_camera(text: str | None) -> Any:
    """Return what ``--camera`` stands for in a definition: a name, or a model with its parameters.

    Raises
    ------
    DefinitionError
        The text is neither.
    """
    if text is None or text in ("auto", "unknown"):
        return text or "auto"
    model, *params = re.split(r"[,\s]+", text.strip())
    values = [parse_value(value) for value in params]
    if not values or not all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        raise DefinitionError(
            f"--camera takes unknown, or a model and its parameters such as PINHOLE,500,500,320,240, not '{text}'"
        )
    return {"model": model.upper(), "params": [float(value) for value in values]}


def parse_selection(
    frames: list[str] | None, exclude: list[str] | None, recursive: bool, cameras: CameraGrouping
) -> "Selection":
    """Return the selection that ``--frames``, ``--exclude``, ``--recursive`` and ``--cameras`` describe."""
    from dataclasses import replace

    return replace(parse_frames(frames), exclude=tuple(exclude or ()), recursive=recursive, cameras=cameras.value)


def load_as_asked(
    path: Path, selection: "Selection", camera: str | None, *, layout: str = "auto", fewest: int = 1
) -> "Sequence":
    """Load a sequence with the intrinsics that ``--camera`` gives, the data set's own where it is not given."""
    from gtf_tune.sequence import Lens, load_sequence

    given = parse_camera(camera)
    chosen: Any = given if isinstance(given, str) else Lens(**given)
    return load_sequence(path, layout=layout, selection=selection, camera=chosen, fewest=fewest)
