"""Keep the results of benchmarks in a file, and write docs/performance.md from it."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.section import Section, as_markdown

RESULTS = Path(__file__).parent / "results.json"
PAGE = Path(__file__).parents[1] / "docs" / "performance.md"

_HEAD = """# Performance

This page is written by `make bench` from what it measures; nothing in it is typed by hand. Ratios compare things that
were measured in turns in one run. Times are those of one machine; ratios travel better.
"""


@dataclass(frozen=True)
class Result:
    """One section with what is needed to judge its figures."""

    section: Section
    machine: Mapping[str, str]
    measured_at: str
    full: bool
    took_s: float


def load() -> dict[str, Result]:
    """Return the results of earlier runs by the name of their benchmark."""
    if not RESULTS.exists():
        return {}
    stored = json.loads(RESULTS.read_text(encoding="utf-8"))
    return {name: _result(data) for name, data in stored.items()}


def save(results: Mapping[str, Result]) -> None:
    """Store all results and write the page."""
    stored = {name: asdict(result) for name, result in results.items()}
    RESULTS.write_text(json.dumps(stored, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    PAGE.write_text(render(results), encoding="utf-8")


def render(results: Mapping[str, Result]) -> str:
    """Return the page as Markdown."""
    parts = [_HEAD, _aims(results)]
    parts += [f"{as_markdown(result.section)}\n{_provenance(result)}\n" for result in results.values()]
    return "\n".join([*parts, _machines(results)])


def _aims(results: Mapping[str, Result]) -> str:
    lines = ["## Aims", "", "| aim | measured | |", "| --- | --- | --- |"]
    lines += [
        f"| {aim.wanted} | {aim.measured} | {'met' if aim.met else '**missed**'} |"
        for result in results.values()
        for aim in result.section.aims
    ]
    return "\n".join([*lines, ""])


def _provenance(result: Result) -> str:
    effort = "full" if result.full else "quick"
    return f"*Measured {result.measured_at} in the {effort} form, in {result.took_s:.0f} s.*"


def _machines(results: Mapping[str, Result]) -> str:
    lines = [
        "## The machine",
        "",
        "| benchmark | processor | memory | system | speed | load before |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {result.section.title} | "
        + " | ".join(result.machine.get(fact, "") for fact in ("processor", "memory", "system", "speed", "load before"))
        + " |"
        for result in results.values()
    ]
    versions = sorted({result.machine["versions"] for result in results.values()})
    return "\n".join([*lines, "", *(f"Versions: {version}." for version in versions), ""])


def _result(data: Mapping[str, Any]) -> Result:
    return Result(
        section=Section.from_dict(data["section"]),
        machine=data["machine"],
        measured_at=data["measured_at"],
        full=data["full"],
        took_s=data["took_s"],
    )
