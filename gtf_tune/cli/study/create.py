"""Create a study from a definition file, from flags, or from both."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import typer

from gtf_tune.cli.parameters import (
    DEFAULT_STORAGE,
    Frames,
    Nominal,
    Settings,
    Storage,
    create_storage,
    hush_optuna,
    storage_flag,
)
from gtf_tune.cli.sequence_flags import CameraFlag, CameraGrouping, Cameras, Exclude, Recursive, parse_camera
from gtf_tune.cli.study.true_errors import Side
from gtf_tune.cli.terminal.console import say
from gtf_tune.cli.values import parse_options, parse_pairs, parse_value, refuse_repeated, split_pairs
from gtf_tune.errors import DefinitionError

Source = Annotated[str, typer.Argument(metavar="NAME|FILE.toml", help="Name of the study, or a study definition.")]
SequencePath = Annotated[
    list[Path] | None, typer.Option("--sequence", "-s", help="Folder of images; once for each sequence.")
]
Pipeline = Annotated[str | None, typer.Option("--pipeline", "-p", help="Pipeline to tune.")]
Fixed = Annotated[list[str] | None, typer.Option("--option", "-o", metavar="NAME=VALUE", help="Hold an option fixed.")]
Range = Annotated[
    list[str] | None,
    typer.Option("--range", "-r", metavar="NAME=LOW:HIGH[:log]", help="Search an option between two bounds."),
]
Values = Annotated[
    list[str] | None, typer.Option("--values", "-v", metavar="NAME=A,B,...", help="Search an option over a list.")
]

_FLAGS = MappingProxyType(
    {
        "sequences": "give --sequence FOLDER",
        "space": "say what to search with --range NAME=LOW:HIGH or --values NAME=A,B",
    }
)


def create(
    source: Source,
    name: Annotated[str | None, typer.Option("--name", help="Another name than the file's.")] = None,
    sequence: SequencePath = None,
    max_image_size: Annotated[
        int | None, typer.Option("--max-image-size", help="Shrink images to this many pixels on the longer side.")
    ] = None,
    frames: Frames = None,
    exclude: Exclude = None,
    recursive: Recursive = False,
    camera: CameraFlag = None,
    cameras: Cameras = CameraGrouping.auto,
    pipeline: Pipeline = None,
    option: Fixed = None,
    nominal: Nominal = None,
    setting: Settings = None,
    range_: Range = None,
    values: Values = None,
    clean_runs: Annotated[int | None, typer.Option("--clean-runs", "-k", help="k, clean runs of a trial.")] = None,
    noisy_runs: Annotated[int | None, typer.Option("--noisy-runs", "-K", help="k_delta, noisy runs.")] = None,
    noise_sigma: Annotated[
        str | None, typer.Option("--noise-sigma", help="Noise in grey levels (0..255), or auto.")
    ] = None,
    aggregate: Annotated[str | None, typer.Option("--aggregate", help="mean, median, gmean or trimmed.")] = None,
    side: Side = None,
    sampler: Annotated[
        str | None,
        typer.Option("--sampler", help="auto, refine, grid, tpe, qmc, random, or module:Class of any Optuna sampler."),
    ] = None,
    trials: Annotated[int | None, typer.Option("--trials", "-n", help="Trials, the nominal one included.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Seed of the whole study.")] = None,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Create a study; flags replace what the definition file says.

    Example: gtf-tune study create photos -s images/ -p glomap -r mapper.max_normalized_reproj_error=1e-4:1e-1:log
    """
    from gtf_tune.study.create import checked_definition, create_study

    hush_optuna()
    data, root = _base(source)
    if name:
        data["name"] = name
    _put(data, "pipeline", name=pipeline)
    _add_to_pipeline(data, "options", parse_pairs(option, "--option"))
    _add_to_pipeline(data, "nominal", parse_options(nominal, "--nominal"))
    _add_to_pipeline(data, "settings", parse_pairs(setting, "--setting"))
    _add_sequences(data, sequence)
    chosen = parse_pairs(frames, "--frames")
    if max_image_size is not None and "max_image_size" in chosen:
        raise DefinitionError("--max-image-size and --frames max_image_size mean the same; give one of them")
    _select(data, {"max_image_size": max_image_size, **chosen})
    _select(data, {"exclude": exclude or None, "recursive": recursive or None})
    _select(data, {"camera": parse_camera(camera) if camera else None})
    _select(data, {"cameras": cameras.value if cameras is not CameraGrouping.auto else None})
    _add_space(data, range_ or [], values or [])
    _put(data, "gtf", clean_runs=clean_runs, noisy_runs=noisy_runs, aggregate=aggregate)
    _put(data, "gtf", noise_sigma=None if noise_sigma is None else parse_value(noise_sigma))
    _put(data, "side_metric", **parse_pairs(side, "--side"))
    _put(data, "search", sampler=sampler, trials=trials, seed=seed)
    definition = checked_definition(data, source, {} if _is_file(source) else _FLAGS, root)
    database = create_storage(storage)
    study = create_study(database, definition, root, on_note=say)
    say(f"created study '{study.name}'")
    say(f"Next: gtf-tune study run {study.name}{storage_flag(database)}")


def _base(source: str) -> tuple[dict[str, Any], Path]:
    """Return the initial definition and the folder that its paths are relative to."""
    from gtf_tune.definition import read_toml

    if _is_file(source):
        path = Path(source)
        return read_toml(path), path.absolute().parent
    return {"name": source, "pipeline": {"name": "glomap"}}, Path.cwd()


def _is_file(source: str) -> bool:
    return source.endswith(".toml")


def _add_to_pipeline(data: dict[str, Any], part: str, given: dict[str, Any]) -> None:
    section = data.get("pipeline") or {}
    if given and isinstance(section, dict):
        data["pipeline"] = dict(section)
        _put(data["pipeline"], part, **given)


def _add_sequences(data: dict[str, Any], folders: list[Path] | None) -> None:
    if folders:
        paths = [path.absolute() for path in folders]
        named = zip(_distinct_names(paths), paths, strict=True)
        data["sequences"] = [{"name": name, "path": str(path)} for name, path in named]


def _distinct_names(paths: list[Path]) -> list[str]:
    """Return a name for each folder: its own, with as many folders above it as make it unique.

    Folders that are the same up to the root keep the same name.
    """
    from gtf_tune.definition.model import name_from

    depths = [1] * len(paths)
    while True:
        names = [name_from("-".join(path.parts[-depth:])) for path, depth in zip(paths, depths, strict=True)]
        deeper = [
            depth + (names.count(name) > 1 and depth < len(path.parts) - 1)
            for name, path, depth in zip(names, paths, depths, strict=True)
        ]
        if deeper == depths:
            return names
        depths = deeper


def _select(data: dict[str, Any], selection: dict[str, Any]) -> None:
    given = {name: value for name, value in selection.items() if value is not None}
    found = data.get("sequences")
    if given and isinstance(found, list):
        data["sequences"] = [{**sequence, **given} if isinstance(sequence, dict) else sequence for sequence in found]


def _add_space(data: dict[str, Any], ranges: list[str], lists: list[str]) -> None:
    bounds, values = split_pairs(ranges, "--range"), split_pairs(lists, "--values")
    refuse_repeated([*bounds, *values], "--range or --values")
    axes: dict[str, Any] = {name: parse_range(name, text) for name, text in bounds.items()}
    for name, text in values.items():
        axes[name] = {"values": [parse_value(value.strip()) for value in text.split(",")]}
    _put(data, "space", **axes)


def parse_range(name: str, bounds: str) -> dict[str, Any]:
    """Return the axis of ``--range NAME=LOW:HIGH[:log]``, of which ``bounds`` is what follows the equals sign."""
    parts = bounds.split(":")
    ends = [parse_value(part) for part in parts[:2]]
    are_numbers = len(ends) == 2 and all(isinstance(end, int | float) and not isinstance(end, bool) for end in ends)
    if not are_numbers or parts[2:] not in ([], ["log"], ["linear"]):
        raise DefinitionError(f"--range takes NAME=LOW:HIGH or NAME=LOW:HIGH:log, not '{name}={bounds}'")
    return {"low": ends[0], "high": ends[1], "log": parts[2:] == ["log"]}


def _put(data: dict[str, Any], section: str, /, **values: object) -> None:
    """Put given values into a section; one that is not a table stays as it is, and the check reports it."""
    given: Mapping[str, object] = {name: value for name, value in values.items() if value is not None}
    found = data.get(section) or {}
    if given and isinstance(found, dict):
        data[section] = {**found, **given}
