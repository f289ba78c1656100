"""Write what follows from the code into the documentation, or check that it is there already.

::

    python docs/generate.py            # write
    python docs/generate.py --check    # exit with 1 and name the stale files

Whole pages: commands.md (from ``--help``) and definition-reference.md (from the models of a study definition).
Blocks between ``<!-- generated: NAME -->`` and ``<!-- end -->`` in pages written by hand: data-set layouts, numbers of
options. Figures: images/demo.svg from data/demo.json, images/before-after.svg from data/before_after.json,
images/terminal.svg from data/terminal.json.
"""

import json
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

import typer
from before_after import draw_before_after
from figure import draw_sweep
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined
from terminal import draw_terminal

from gtf_tune.cli.main import app
from gtf_tune.definition import (
    GtfDefinition,
    LimitsDefinition,
    PipelineDefinition,
    RangeAxis,
    SearchDefinition,
    SequenceDefinition,
    SideMetricDefinition,
    StudyDefinition,
    ValuesAxis,
)
from gtf_tune.definition.model import CameraDefinition
from gtf_tune.pipelines import create_pipeline
from gtf_tune.sequence import layout_help

DOCS = Path(__file__).parent
WIDTH = 80
SECTIONS: Mapping[str, tuple[type[BaseModel], str]] = {
    "study": (StudyDefinition, "The top of the file."),
    "pipeline": (PipelineDefinition, "`[pipeline]`: what is tuned, and what is held fixed."),
    "sequences": (SequenceDefinition, "`[[sequences]]`: the images; one table for each sequence."),
    "sequences.camera": (CameraDefinition, "`camera = { model = ..., params = [...] }`: intrinsics by hand."),
    "space (range)": (RangeAxis, "`[space]`: an option between two bounds."),
    "space (values)": (ValuesAxis, "`[space]`: an option over a list; the only kind for booleans and enumerations."),
    "gtf": (GtfDefinition, "`[gtf]`: how a setting is scored."),
    "side_metric": (
        SideMetricDefinition,
        "`[side_metric]`: how runs are measured against ground truth, beside the search.",
    ),
    "search": (SearchDefinition, "`[search]`: which settings are tried."),
    "limits": (LimitsDefinition, "`[limits]`: what one run may take. A run beyond a limit is stopped and has failed."),
}
"""Every part of a study definition by its heading, with a sentence."""

COUNTED_PIPELINES = ("glomap", "colmap", "colmap-hierarchical")

_BLOCK = re.compile(r"(<!-- generated: ([a-z-]+) -->\n).*?(<!-- end -->)", re.DOTALL)
_WORSE, _FAR_WORSE = 0.02, 9.0
_BOUNDS = {"ge": ">=", "gt": ">", "le": "<=", "lt": "<"}
_WORDS = {bool: "true or false", int: "whole number", float: "number", str: "text", NoneType: ""}
Command = Any
"""A command of the click that typer carries; it has no public name."""


def main() -> None:
    """Write the stale files, or name them and exit with 1 if asked to check."""
    stale = {path: text for path, text in generated(DOCS).items() if not path.exists() or _read(path) != text}
    if "--check" in sys.argv[1:]:
        for path in stale:
            sys.stderr.write(f"{path}: is stale; run: python docs/generate.py\n")
        sys.exit(1 if stale else 0)
    for path, text in stale.items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")


def generated(docs: Path) -> dict[Path, str]:
    """Return the text that every generated file in a documentation folder should have."""
    files = {
        docs / "commands.md": command_page(),
        docs / "definition-reference.md": definition_page(tomllib.loads(_read(docs / "data" / "fields.toml"))),
        docs / "images" / "demo.svg": draw_sweep(json.loads(_read(docs / "data" / "demo.json"))["trials"]),
        docs / "images" / "before-after.svg": draw_before_after(json.loads(_read(docs / "data" / "before_after.json"))),
        docs / "images" / "terminal.svg": draw_terminal(json.loads(_read(docs / "data" / "terminal.json"))),
    }
    blocks = {
        "layouts": layout_block,
        "option-counts": option_counts_block,
        "reprojection": lambda: reprojection_block(json.loads(_read(docs / "results.json"))["experiments"]),
    }
    for page in sorted([docs.parent / "README.md", *docs.glob("*.md")]):
        if page not in files and _BLOCK.search(_read(page)):
            files[page] = _filled(_read(page), blocks)
    return files


def command_page() -> str:
    """Return the command reference: the help of every command, grouped as the command line groups them."""
    parts = [_COMMANDS_HEAD]
    for path, help_text, is_group in walk_commands():
        level = "##" if is_group or " " not in path.removeprefix("gtf-tune ") else "###"
        parts.append(f"{level} {path}\n\n```text\n{help_text}\n```\n")
    return "\n".join(parts)


def walk_commands() -> Iterator[tuple[str, str, bool]]:
    """Yield (full name, help text 80 columns wide, whether it has subcommands) of every command, parents first."""
    yield from _walk(typer.main.get_command(app), "gtf-tune", None)


def definition_page(meanings: Mapping[str, Mapping[str, str]]) -> str:
    """Return the reference of a study definition; ``meanings`` holds a sentence for every field of every section."""
    parts = [_DEFINITION_HEAD]
    for heading, (model, purpose) in SECTIONS.items():
        known = meanings.get(heading, {})
        if set(known) != set(model.model_fields):
            raise ValueError(f"docs/data/fields.toml: [{heading}] must describe {sorted(model.model_fields)}")
        rows = [_field_row(name, field, known[name]) for name, field in model.model_fields.items()]
        parts.append("\n".join([f"## `{heading}`\n", f"{purpose}\n", _FIELD_TABLE, *rows, ""]))
    return "\n".join(parts)


def layout_block() -> str:
    """Return a table of the data-set layouts."""
    rows = [f"| `{name}` | {' '.join(text.split())} |" for name, text in layout_help().items()]
    return "\n".join(["| layout | what to download, and which path to give |", "|---|---|", *rows])


def option_counts_block() -> str:
    """Return a table of how many options each pipeline offers, by the first part of their names."""
    rows = []
    for name in COUNTED_PIPELINES:
        pipeline = create_pipeline(name)
        groups = Counter(option.split(".")[0] for option in pipeline.options.specs)
        listed = ", ".join(f"{group} {count}" for group, count in sorted(groups.items()))
        rows.append(f"| `{name}` | {pipeline.version} | {len(pipeline.options.specs)} | {listed} |")
    return "\n".join(["| pipeline | pycolmap | options | of these |", "|---|---|---|---|", *rows])


def reprojection_block(experiments: list[dict[str, Any]]) -> str:
    """Return how often the value with the least reprojection error is worse than the default by ground truth."""
    changes = []
    for experiment in experiments:
        errors = {setting["value"]: setting["true_ate"] for setting in experiment["settings"]}
        picked = errors.get(experiment["picks"]["reprojection"])
        if picked is not None:
            changes.append(picked / experiment["settings"][0]["true_ate"] - 1)
    worse, far = sum(change > _WORSE for change in changes), sum(change > _FAR_WORSE for change in changes)
    return (
        f"We searched one option at a time on sequences with ground truth. In {worse} of {len(changes)} searches the\n"
        "value with the smallest reprojection error had a larger true error than the default, in "
        f"{far} of them more than\nten times as large ([results](docs/results.md))."
    )


def _filled(page: str, blocks: Mapping[str, Callable[[], str]]) -> str:
    return _BLOCK.sub(lambda found: f"{found[1]}\n{blocks[found[2]]()}\n\n{found[3]}", page)


def _walk(command: Command, path: str, parent: Any) -> Iterator[tuple[str, str, bool]]:
    # typer carries its own copy of click, whose Context has no public import path.
    context = command.context_class(
        command, info_name=path.split()[-1], parent=parent, terminal_width=WIDTH, max_content_width=WIDTH
    )
    children = getattr(command, "commands", {})
    yield path, _trimmed(command.get_help(context)), bool(children)
    for name, child in children.items():
        yield from _walk(child, f"{path} {name}", context)


def _trimmed(text: str) -> str:
    return "\n".join(line.rstrip() for line in text.strip().splitlines())


def _field_row(name: str, field: FieldInfo, meaning: str) -> str:
    limits = " and ".join(
        f"{sign} {getattr(limit, bound):g}"
        for limit in field.metadata
        for bound, sign in _BOUNDS.items()
        if getattr(limit, bound, None) is not None
    )
    kind = _kind(field.annotation) + (f" {limits}" if limits else "")
    return f"| `{name}` | {kind} | {_default(field)} | {meaning} |"


def _kind(annotation: object) -> str:
    if annotation in _WORDS:
        return _WORDS[annotation]
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return ", ".join(f'`"{value}"`' for value in arguments)
    if origin in (Union, UnionType):
        return " or ".join(text for text in map(_kind, arguments) if text)
    if origin is list:
        return f"list of {_kind(arguments[0])}"
    return "table"


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    default = field.get_default(call_default_factory=True, validated_data={})
    if default is None or default is PydanticUndefined or isinstance(default, BaseModel | dict):
        return "-"
    return f"`{json.dumps(default)}`"


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8")


_FIELD_TABLE = "| field | value | default | meaning |\n|---|---|---|---|"

_COMMANDS_HEAD = """# Commands

This page is generated from `--help`. `--storage` and `GTF_TUNE_STORAGE` name the database (see [storage](storage.md));
most reading commands take `--json`. Results go to stdout, progress and notes to stderr. Exit codes: 0 done, 1 a mistake
that the message explains (or what `storage check`, `doctor` and `worker --once` found), 2 wrong usage, 130 interrupted.
"""

_DEFINITION_HEAD = """# Study definition: every field

This page is generated from the code that checks definitions. [Study definitions](study-definitions.md) explains how to
write one. Unknown keys are errors.
"""

if __name__ == "__main__":
    main()
