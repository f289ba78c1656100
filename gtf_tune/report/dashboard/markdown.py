"""Markdown of notes, in which texts of users and programs cannot change the layout."""

from collections.abc import Iterable, Sequence

_WIDE_SPACE = "\u2003"


def inline_code(words: object) -> str:
    """Return a text as code within a line."""
    line = " ".join(str(words).split()).replace("`", "'").replace("|", "\\|")
    return f"`{line}`" if line else ""


def plain(words: object) -> str:
    """Return a text on one line without any meaning to Markdown."""
    line = " ".join(str(words).split())
    return "".join(f"\\{sign}" if sign in "\\`*_{}[]<>#|!" else sign for sign in line)


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of cells that are Markdown already; columns whose name starts with '>' are aligned right."""
    rules = ["---:" if name.startswith(">") else ":---" for name in columns]
    head = [name.removeprefix(">") for name in columns]
    return "\n".join([_row(head), f"| {' | '.join(rules)} |", *(_row(cells) for cells in rows)])


def _row(cells: Sequence[str]) -> str:
    # optuna-dashboard puts no space between the columns of a table.
    return "| " + " | ".join(f"{cell}{_WIDE_SPACE}" for cell in cells) + " |"
