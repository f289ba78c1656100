"""Write options in the forms that people paste back into their tools."""

import csv
import io
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from gtf_tune.definition import StudyDefinition
from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import OptionValue, option_text
from gtf_tune.pipelines.colmap.shell import KNOWN, UNKNOWN, colmap_shell_script
from gtf_tune.store.studies import StudySequence

_COLMAP_FORMATS = ("colmap", "colmap-cli")
_OTHER_FORMATS = ("json", "csv", "tum")
FORMATS = (*_COLMAP_FORMATS, *_OTHER_FORMATS)
_FILES = MappingProxyType({"options.json": "json", "run.sh": "colmap-cli"})
FILE_NAMES = (*_FILES, "project.ini", "colmap-flags.txt")
"""Names of all files that `options_files` may return, or returned in earlier versions."""

_COLMAP_PIPELINES = ("glomap", "colmap", "colmap-hierarchical")
_FORMULA_BEGINNINGS = ("=", "+", "-", "@", "\t", "\r")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|-")  # or the dash for what is not known


def formats_of(pipeline: str) -> tuple[str, ...]:
    """Return the formats that a pipeline's results can be written in, first the one that its users paste."""
    return FORMATS if pipeline in _COLMAP_PIPELINES else _OTHER_FORMATS


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


def options_text(
    format_: str, definition: StudyDefinition, searched: Mapping[str, OptionValue], camera: str = ""
) -> str:
    """Return the options of a trial, fixed ones included, as ``json`` or as COLMAP's commands (``colmap-cli``).

    ``camera`` is that of the images, as `common_camera` says it.

    Raises
    ------
    DefinitionError
        The format is COLMAP's and the pipeline is not.
    """
    pipeline = definition.pipeline
    options = {**definition.fixed_options, **searched}
    if format_ in _COLMAP_FORMATS:
        check_format(format_, pipeline.name)
        return colmap_shell_script(pipeline.name, None, pipeline.settings, options, camera)
    return option_json(options)


def check_format(format_: str, pipeline: str) -> None:
    """Raise `DefinitionError` if a pipeline's results cannot be written in a format."""
    if format_ not in formats_of(pipeline):
        raise DefinitionError(f"pipeline '{pipeline}' is not COLMAP's; export JSON or CSV", remedy=("format",))


def options_files(definition: StudyDefinition, searched: Mapping[str, OptionValue], camera: str = "") -> dict[str, str]:
    """Return the options of a trial in every form that its pipeline's users paste, content by file name."""
    known = [(name, format_) for name, format_ in _FILES.items() if format_ in formats_of(definition.pipeline.name)]
    return {name: options_text(format_, definition, searched, camera) for name, format_ in known}


def common_camera(definition: StudyDefinition, sequences: Sequence[StudySequence]) -> str:
    """Return the camera of all images of a study as `colmap_shell_script` takes it; nothing where they differ."""
    found = {sequence.camera for sequence in sequences}
    if found == {UNKNOWN}:
        return UNKNOWN
    if UNKNOWN in found or any(len(sequence.info.get("cameras", ())) > 1 for sequence in sequences):
        return ""
    is_reduced = any(sequence.max_image_size is not None for sequence in definition.sequences)
    return found.pop() if len(found) == 1 and not is_reduced else KNOWN
