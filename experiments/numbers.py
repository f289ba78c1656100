"""Write numbers and tables as Markdown."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from scipy import stats

Table = tuple[Sequence[str], Sequence[Sequence[str]]]


def percent(value: float) -> str:
    return f"{value:+.1%}" if math.isfinite(value) else "-"


def share(value: float) -> str:
    return f"{value:.0%}" if math.isfinite(value) else "-"


def plain(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "-"


def significant(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "-"


def known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def mean(values: Iterable[float]) -> float:
    finite = [value for value in values if math.isfinite(value)]
    return float(np.mean(finite)) if finite else math.nan


def spearman(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the rank correlation of two series, NaN where one of them is constant."""
    if len(set(a)) < 2 or len(set(b)) < 2:
        return math.nan
    return float(stats.spearmanr(a, b).statistic)


def part(title: str, text: str, table: Table) -> str:
    """Return a section with its table, or a note where there is nothing in it."""
    columns, rows = table
    lines = [f"## {title}", "", text, ""]
    if not rows:
        return "\n".join([*lines, "Not measured yet."])
    lines += ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines)
