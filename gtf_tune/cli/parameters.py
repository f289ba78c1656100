"""The flags that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

from gtf_tune.api import defaults

STORAGE_VARIABLE = defaults.STORAGE_VARIABLE

Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
Storage = Annotated[
    str,
    typer.Option(
        "--storage",
        envvar=STORAGE_VARIABLE,
        help="Database: a file, sqlite:///FILE, postgresql+psycopg://HOST/NAME, or @FILE that holds such a URL.",
        show_envvar=True,
    ),
]
CacheDir = Annotated[
    Path | None,
    typer.Option("--cache-dir", envvar="GTF_TUNE_CACHE_DIR", help="Folder of the stage cache.", show_envvar=True),
]
NoCache = Annotated[bool, typer.Option("--no-cache", help="Compute every stage of every run anew.")]
Jobs = Annotated[
    int | None, typer.Option("--jobs", "-j", min=1, max=10_000, help="Runs side by side (default: cores).")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--setting", metavar="NAME=VALUE", help="A setting of the pipeline that is no option (pairing=...)."),
]
Nominal = Annotated[
    list[str] | None,
    typer.Option(
        "--nominal",
        metavar="OPTION=VALUE|FILE.json",
        help="Your present value of an option, or all of them as 'study export --format json' writes them.",
    ),
]
Frames = Annotated[
    list[str] | None,
    typer.Option(
        "--frames",
        metavar="KEY=VALUE",
        help="Which frames: start, stop, stride, rate_hz, max_frames; max_image_size for their size.",
    ),
]
StudyName = Annotated[str, typer.Argument(metavar="STUDY", help="Name of the study.")]

DEFAULT_STORAGE = defaults.DEFAULT_STORAGE
