"""What one benchmark found: a table, the aims it is held against, and how it was measured."""

import statistics
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Aim:
    """One aim: what is wanted, what was measured, and, where it is missed, by how much and what bounds it."""

    wanted: str
    measured: str
    met: bool
    bound: str = ""


@dataclass(frozen=True)
class Section:
    """The part of docs/performance.md that one benchmark writes."""

    title: str
    text: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    aims: tuple[Aim, ...] = ()
    conclusion: str = ""

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "Section":
        return cls(
            title=data["title"],
            text=data["text"],
            header=tuple(data["header"]),
            rows=tuple(tuple(row) for row in data["rows"]),
            aims=tuple(Aim(**aim) for aim in data["aims"]),
            conclusion=data["conclusion"],
        )


@dataclass(frozen=True)
class Effort:
    """Say how much a benchmark may do: the quick form for everybody, the full one for the documentation."""

    full: bool = False

    def pick(self, quick: int, full: int) -> int:
        return full if self.full else quick


Benchmark = Callable[[Effort], Section]


def median(values: Sequence[float]) -> float:
    return float(statistics.median(values))


def as_text(section: Section) -> str:
    """Return a section as a terminal shows it."""
    table = [section.header, *section.rows]
    widths = [max(len(row[column]) for row in table) for column in range(len(section.header))]
    lines = [section.title, "=" * len(section.title)]
    for row in table:
        cells = [
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    lines += [
        f"{'met   ' if aim.met else 'MISSED'}  {aim.wanted}: {aim.measured} {aim.bound}".rstrip()
        for aim in section.aims
    ]
    return "\n".join([*lines, section.conclusion, ""])


def as_markdown(section: Section) -> str:
    """Return a section as the documentation shows it."""
    lines = [f"## {section.title}", "", section.text, ""]
    lines.append("| " + " | ".join(section.header) + " |")
    lines.append("|" + "|".join([" --- "] + [" ---: "] * (len(section.header) - 1)) + "|")
    lines += ["| " + " | ".join(row) + " |" for row in section.rows]
    for aim in section.aims:
        verdict = "met" if aim.met else "**missed**"
        lines += ["", f"Aim: {aim.wanted}. Measured: {aim.measured}: {verdict}. {aim.bound}".rstrip()]
    if section.conclusion:
        lines += ["", section.conclusion]
    return "\n".join([*lines, ""])
