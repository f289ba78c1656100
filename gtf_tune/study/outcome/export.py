"""Write options in the forms that people paste back into their tools."""

import csv
import io
import json
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType

from gtf_tune.definition import StudyDefinition
from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import OptionValue, option_text
from gtf_tune.pipelines.colmap.flags import command_of, commands_of, flag_of

_COLMAP_FORMATS = ("colmap-ini", "colmap-cli")
_FORMULA_BEGINNINGS = ("=", "+", "-", "@", "\t", "\r")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|-")  # or the dash for what is not known
_OTHER_FORMATS = ("json", "csv", "tum")
FORMATS = (*_COLMAP_FORMATS, *_OTHER_FORMATS)
_FILES = MappingProxyType({"options.json": "json", "project.ini": "colmap-ini", "colmap-flags.txt": "colmap-cli"})
FILE_NAMES = tuple(_FILES)
"""Names of all files that `options_files` may return."""

_WHEN = MappingProxyType({"view_graph_calibrator": "  # only where the intrinsics are unknown"})
_NO_SETTINGS: Mapping[str, object] = MappingProxyType({})
_COLMAP_PIPELINES = ("glomap", "colmap", "colmap-hierarchical")
_INI_HEAD = (
    "# With a project file COLMAP takes paths from it alone: put database_path=, image_path= and output_path= here."
)


def formats_of(pipeline: str) -> tuple[str, ...]:
    """Return the formats that a pipeline's results can be written in, first the one that its users paste."""
    return FORMATS if pipeline in _COLMAP_PIPELINES else _OTHER_FORMATS


def colmap_ini(pipeline: str, options: Mapping[str, OptionValue], settings: Mapping[str, object] = _NO_SETTINGS) -> str:
    """Return a COLMAP project file without paths; options that COLMAP's command line lacks follow as comments."""
    _require_colmap(pipeline)
    sections: dict[str, list[str]] = {}
    for flag, value in _flags(pipeline, options, settings):
        section, _, key = flag.rpartition(".")
        sections.setdefault(section, []).append(f"{key}={value}")
    blocks = [f"[{section}]\n" * bool(section) + "\n".join(lines) for section, lines in sorted(sections.items())]
    blocks += [f"# only from pycolmap: {name}={_text(options[name])}" for name in without_flag(pipeline, options)]
    return "\n".join([_INI_HEAD, *blocks]) + "\n"


def colmap_flags(
    pipeline: str, options: Mapping[str, OptionValue], settings: Mapping[str, object] = _NO_SETTINGS
) -> str:
    """Return the COLMAP commands in running order with their flags; options without a flag follow as comments."""
    _require_colmap(pipeline)
    pairing = str(settings.get("pairing", "exhaustive"))
    commands: dict[str, list[str]] = {name: [] for name in commands_of(pipeline, pairing)}
    for flag, value in _flags(pipeline, options, settings):
        commands[command_of(pipeline, flag, pairing)].append(f" --{flag} {shlex.quote(value)}")
    lines = [f"colmap {name}{''.join(flags)}{_WHEN.get(name, '')}" for name, flags in commands.items()]
    lines += [f"# only from pycolmap: {name}={_text(options[name])}" for name in without_flag(pipeline, options)]
    return "\n".join(lines) + "\n"


def option_json(options: Mapping[str, OptionValue]) -> str:
    """Return the options as a nested JSON object, the form that pycolmap's ``mergedict`` takes stage by stage."""
    tree: dict[str, object] = {}
    for name, value in options.items():
        *groups, last = name.split(".")
        place = tree
        for group in groups:
            child = place.setdefault(group, {})
            place = child if isinstance(child, dict) else place
        place[last] = value
    return json.dumps(tree, indent=2) + "\n"


def table_csv(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as CSV; missing values are empty, others as they are typed."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([_cell(column) for column in columns])
    writer.writerows([[_cell(value) for value in row] for row in rows])
    return buffer.getvalue()


def _cell(value: object) -> str:
    """Return a cell; a text that spreadsheets would take for a formula gets an apostrophe, which makes it a text."""
    if isinstance(value, str) and value.startswith(_FORMULA_BEGINNINGS) and not _NUMBER.fullmatch(value):
        return f"'{value}"
    return "" if value is None else option_text(value)


def without_flag(pipeline: str, options: Mapping[str, OptionValue]) -> list[str]:
    """Return the options that COLMAP's command line cannot set."""
    return [name for name in options if flag_of(pipeline, name) is None]


def _flags(
    pipeline: str, options: Mapping[str, OptionValue], settings: Mapping[str, object]
) -> Iterator[tuple[str, str]]:
    """Yield COLMAP's names and values of options, after those that make it read the images as the pipeline does."""
    yield "ImageReader.single_camera", "1"
    if settings.get("camera_model"):
        yield "ImageReader.camera_model", str(settings["camera_model"])
    if settings.get("vocab_tree_path") and settings.get("pairing") == "sequential":
        yield "SequentialMatching.vocab_tree_path", str(settings["vocab_tree_path"])
    for name, value in options.items():
        flag = flag_of(pipeline, name)
        if flag is not None:
            yield flag, _text(value)


def _require_colmap(pipeline: str) -> None:
    if _COLMAP_FORMATS[0] not in formats_of(pipeline):
        raise DefinitionError(
            f"pipeline '{pipeline}' has no COLMAP project file; export JSON or CSV", remedy=("format",)
        )


def _text(value: OptionValue) -> str:
    if isinstance(value, bool):
        return "1" if value else "0"
    return repr(value) if isinstance(value, float) else str(value)


def options_text(format_: str, definition: StudyDefinition, searched: Mapping[str, OptionValue]) -> str:
    """Return the options of a trial, fixed ones included, in the format ``colmap-ini``, ``colmap-cli`` or ``json``.

    Raises
    ------
    DefinitionError
        The format is COLMAP's and the pipeline is not.
    """
    pipeline = definition.pipeline
    options = {**definition.fixed_options, **searched}
    if format_ == "colmap-ini":
        return colmap_ini(pipeline.name, options, pipeline.settings)
    if format_ == "colmap-cli":
        return colmap_flags(pipeline.name, options, pipeline.settings)
    return option_json(options)


def options_files(definition: StudyDefinition, searched: Mapping[str, OptionValue]) -> dict[str, str]:
    """Return the options of a trial in every form that its pipeline's users paste, content by file name."""
    known = formats_of(definition.pipeline.name)
    return {name: options_text(format_, definition, searched) for name, format_ in _FILES.items() if format_ in known}
