"""Hover texts of trials."""

import math
from html import escape

from gtf_tune.display import interval, share, significant
from gtf_tune.report.points import PointSet, TrialPoint

_LONGEST = 90


def trial_text(point: TrialPoint, points: PointSet) -> str:
    """Return the hover text of a trial."""
    name = "trial 0 (nominal)" if point.number == 0 else f"trial {point.number}"
    lines = [f"<b>{name}</b>"]
    if math.isfinite(point.value):
        lines.append(f"{points.unit.name} {significant(point.value)} {points.unit.symbol}")
    if point.state != "feasible":
        lines.append(f"{point.state}: {shortened(point.message)}" if point.message else point.state)
    if math.isfinite(point.low):
        lines.append(f"95 % interval {interval(point.low, point.high)}")
    if math.isfinite(point.ground_truth):
        lines.append(f"{points.truth_name} {significant(point.ground_truth, 4)}")
    if math.isfinite(point.coverage):
        lines.append(f"coverage {share(point.coverage)}")
    if point.collapsed > 0:
        lines.append(f"{share(point.collapsed)} of the noisy runs collapsed")
    return "<br>".join(lines)


def shortened(text: str, longest: int = _LONGEST) -> str:
    """Return a text on one line of at most ``longest`` characters, escaped for a figure."""
    line = " ".join(text.split())
    return escape(line if len(line) <= longest else line[: longest - 1] + "…")
