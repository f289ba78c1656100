"""Draw the figure of the start page as SVG: GTF ATE and true ATE over one option."""

import math
from collections.abc import Mapping, Sequence
from typing import Any
from xml.sax.saxutils import escape

_WIDTH, _HEIGHT = 720, 380
_LEFT, _RIGHT, _TOP, _BOTTOM = 70, 650, 50, 320
_GTF, _TRUTH, _NOMINAL, _INK = "rgb(150,90,150)", "rgb(54,161,101)", "rgb(27,107,162)", "#495057"
_HEADROOM = 1.15


def draw_sweep(trials: Sequence[Mapping[str, Any]]) -> str:
    """Return an SVG of the scores of trials over their one option, on a logarithmic axis.

    The study of data/demo.json was made on the room of ``gtf-tune sequence render room`` with seven values of
    ``mapper.max_normalized_reproj_error``, sampler grid, k = 2, k_delta = 4, sigma = 4 and fixed intrinsics.
    Pink is the GTF ATE in per mille of the extent with one standard error; green the true ATE on an axis of its own.
    The smallest value of each has a ring; the blue line is the nominal setting. Needs ``options``, ``gtf_ate``,
    ``standard_error``, ``gt_ate`` and ``ordinal``, as ``gtf-tune study show --json`` prints them.
    """
    name = next(iter(trials[0]["options"]))
    known = sorted(
        (trial for trial in trials if trial["gtf_ate"] is not None), key=lambda one: float(one["options"][name])
    )
    xs = [math.log10(float(one["options"][name])) for one in known]
    scores = [1000 * float(one["gtf_ate"]) for one in known]
    errors = [1000 * float(one["standard_error"] or 0) for one in known]
    truths = [float(one["gt_ate"]) for one in known]
    across = _scale((xs[0], xs[-1]), (_LEFT + 20, _RIGHT - 20))
    up = _scale((0, _HEADROOM * max(map(sum, zip(scores, errors, strict=True)))), (_BOTTOM, _TOP))
    up_truth = _scale((0, _HEADROOM * max(truths)), (_BOTTOM, _TOP))
    nominal = next(math.log10(float(one["options"][name])) for one in known if one["ordinal"] == 0)
    bars = [
        _line(across(x), up(score - error), across(x), up(score + error), _GTF)
        for x, score, error in zip(xs, scores, errors, strict=True)
    ]
    parts = [
        _frame(),
        _line(across(nominal), _TOP, across(nominal), _BOTTOM, _NOMINAL, dash="6 4"),
        _text(across(nominal), _TOP - 6, "nominal", _NOMINAL, "middle"),
        *_decades(xs, across),
        *bars,
        *_curve([(across(x), up(score)) for x, score in zip(xs, scores, strict=True)], _GTF),
        *_curve([(across(x), up_truth(truth)) for x, truth in zip(xs, truths, strict=True)], _TRUTH),
        _text((_LEFT + _RIGHT) / 2, _HEIGHT - 16, name, _INK, "middle"),
        _text(_LEFT, 20, "GTF ATE [‰ of the extent], without ground truth", _GTF, "start"),
        _text(_RIGHT, 20, "true ATE [m]", _TRUTH, "end"),
        *(_text(_LEFT - 8, up(value) + 4, f"{value:.3g}", _GTF, "end") for value in _ticks(max(scores))),
        *(_text(_RIGHT + 8, up_truth(value) + 4, f"{value:.2g}", _TRUTH, "start") for value in _ticks(max(truths))),
    ]
    label = f"GTF ATE and true ATE over {name}"
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img">'
    body = "\n".join((f"<title>{escape(label)}</title>", f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="white"/>'))
    return "\n".join((head, body, *parts, "</svg>", ""))


def _scale(values: tuple[float, float], pixels: tuple[float, float]) -> Any:
    low, high = values
    factor = (pixels[1] - pixels[0]) / ((high - low) or 1.0)
    return lambda value: pixels[0] + (value - low) * factor


def _ticks(largest: float) -> list[float]:
    """Return about four round numbers up to the largest value."""
    step = 10 ** math.floor(math.log10(largest))
    while largest / step < 3:
        step /= 2
    return [step * count for count in range(1, math.floor(largest / step) + 1)]


def _decades(xs: Sequence[float], across: Any) -> list[str]:
    whole = range(math.ceil(xs[0] - 0.05), math.floor(xs[-1] + 0.05) + 1)
    return [_text(across(power), _BOTTOM + 18, f"{10.0**power:g}", _INK, "middle") for power in whole]


def _curve(points: Sequence[tuple[float, float]], colour: str) -> list[str]:
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    lowest = max(points, key=lambda point: point[1])
    dots = [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" fill="{colour}"/>' for x, y in points]
    ring = f'<circle cx="{lowest[0]:.1f}" cy="{lowest[1]:.1f}" r="9" fill="none" stroke="{colour}" stroke-width="2"/>'
    return [f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>', *dots, ring]


def _frame() -> str:
    axes = f"M{_LEFT} {_TOP} V{_BOTTOM} H{_RIGHT} V{_TOP}"
    return f'<path d="{axes}" fill="none" stroke="{_INK}"/>'


def _line(x1: float, y1: float, x2: float, y2: float, colour: str, dash: str = "none") -> str:
    place = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
    return f'<line {place} stroke="{colour}" stroke-width="1.5" stroke-dasharray="{dash}"/>'


def _text(x: float, y: float, text: str, colour: str, anchor: str) -> str:
    place = f'x="{x:.1f}" y="{y:.1f}" fill="{colour}" text-anchor="{anchor}"'
    return f'<text {place} font-family="sans-serif" font-size="14">{escape(text)}</text>'
