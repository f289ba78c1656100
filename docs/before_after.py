"""Draw how much less a trajectory moves under noise after one option is changed, on a rendered room.

``python docs/before_after.py FOLDER`` renders the room, runs GLOMAP in FOLDER and writes data/before_after.json;
`generate.py` draws the figure from that.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

OPTION = "mapper.bundle_adjustment.ceres.loss_function_scale"
DATA = Path(__file__).parent / "data" / "before_after.json"
NOISE_SIGMA = 4.0
NOISY_RUNS = 4
ENLARGED = 100
"""How many times movements are drawn too large, or none could be seen."""

_WIDTH, _HEIGHT, _PANEL = 760, 270, 345
_INK, _FAINT, _PATH, _MOVE = "#1f2933", "#66727f", "#66727f", "rgb(192,57,43)"


def main(folder: Path) -> None:
    """Measure the default of the option and a tenth of it, and keep what the figure shows."""
    import gtf_tune as gtf
    from gtf_tune.sequence import render_room
    from gtf_tune.sequence.render.room import RoomSpec

    room = folder / "room"
    if not (room / "groundtruth.txt").exists():
        render_room(room, RoomSpec(num_frames=14))
    fixed = {f"mapper.bundle_adjustment.refine_{name}": False for name in ("focal_length", "extra_params")}
    storage = folder / "before-after.db"
    study = gtf.create_study(
        "room",
        sequence=room,
        space={OPTION: [1.0, 0.1]},
        options=fixed,
        gtf={"noise_sigma": NOISE_SIGMA, "clean_runs": 1, "noisy_runs": NOISY_RUNS},
        search={"sampler": "grid"},
        storage=storage,
    )
    study.run()
    DATA.write_text(json.dumps(measured(storage), indent=None) + "\n", encoding="utf-8")


def measured(storage: Path) -> dict[str, Any]:
    """Return the clean path of each trial and the movement of its noisy runs, seen from above, in extents."""
    from gtf_tune.report.aligned_runs import align_runs, in_one_frame, read_configuration
    from gtf_tune.report.points import study_points
    from gtf_tune.report.study_data import read_study
    from gtf_tune.store.database import open_database

    database = open_database(str(storage))
    data = read_study(database, "room")
    points = study_points(data).points
    runs = in_one_frame([read_configuration(database, data, "", point.number)["room"] for point in points])
    panels = []
    for point, found in zip(points, runs, strict=True):
        clean, *noisy = align_runs(found)
        path = dict(zip(clean.frame_ids.tolist(), clean.positions[:, :2].round(5).tolist(), strict=True))
        ends = [zip(run.frame_ids.tolist(), run.positions[:, :2].round(5).tolist(), strict=True) for run in noisy]
        moves = [[[path[frame], end] for frame, end in run if frame in path] for run in ends]
        truth = float(f"{point.ground_truth:.4g}")
        values = {"option": point.options[OPTION], "score": float(f"{point.value:.4g}"), "true_ate": truth}
        panels.append({**values, "path": list(path.values()), "moves": moves})
    database.close()
    return {"option": OPTION, "noisy_runs": NOISY_RUNS, "noise_sigma": NOISE_SIGMA, "panels": panels}


def draw_before_after(data: Mapping[str, Any]) -> str:
    """Return the two paths side by side as SVG, with the movement of every frame in every noisy run."""
    before, after = data["panels"][0], data["panels"][-1]
    places = [place for panel in (before, after) for place in panel["path"]]
    low, high = (tuple(pick(place[axis] for place in places) for axis in (0, 1)) for pick in (min, max))
    scale = min(255 / (high[0] - low[0]), 130 / (high[1] - low[1]))
    change, truth = (100 * (after[name] / before[name] - 1) for name in ("score", "true_ate"))
    name = data["option"].rpartition(".")[2]
    label = f"Movement under noise before and after {name} {before['option']:g} became {after['option']:g}"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img">',
        f"<title>{escape(label)}</title>",
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="white"/>',
        *_panel(before, "default", 25, (low, high, scale)),
        *_panel(after, "changed", 25 + _PANEL + 20, (low, high, scale)),
        _text(
            25,
            _HEIGHT - 14,
            f"Movement {change:+.0f} %, seen without ground truth. Ground truth, which nothing used: {truth:+.0f} %.",
            _INK,
        ),
    ]
    return "\n".join([*parts, "</svg>", ""])


def _panel(panel: Mapping[str, Any], title: str, left: int, view: tuple[Sequence[float], ...]) -> list[str]:
    low, high, scale = view

    def pixel(place: Sequence[float]) -> tuple[float, float]:
        middle = [(one + other) / 2 for one, other in zip(low, high, strict=True)]
        return left + _PANEL / 2 + scale * (place[0] - middle[0]), 145 - scale * (place[1] - middle[1])

    lines = []
    for start, end in (move for run in panel["moves"] for move in run):
        (x, y), (u, v) = pixel(start), pixel(end)
        u, v = x + ENLARGED * (u - x), y + ENLARGED * (v - y)
        lines.append(f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{u:.1f}" y2="{v:.1f}" stroke="{_MOVE}" stroke-width="1.3"/>')
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(pixel, panel["path"]))
    dots = [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.6" fill="{_INK}"/>' for x, y in map(pixel, panel["path"])]
    option = f"{OPTION.rpartition('.')[2]} = {panel['option']:g}"
    return [
        f'<rect x="{left}" y="10" width="{_PANEL}" height="220" rx="8" fill="none" stroke="#dfe3e8"/>',
        _text(left + 14, 34, f"{title}: {option}", _INK, bold=True),
        _text(left + 14, 54, f"moves by {panel['score']:.3g} ‰ of its extent (drawn {ENLARGED}-fold)", _FAINT),
        f'<polyline points="{path}" fill="none" stroke="{_PATH}" stroke-width="1.5"/>',
        *lines,
        *dots,
    ]


def _text(x: float, y: float, words: str, colour: str, *, bold: bool = False) -> str:
    weight = ' font-weight="600"' if bold else ""
    style = f'fill="{colour}" font-family="Helvetica, Arial, sans-serif" font-size="13"{weight}'
    return f'<text x="{x:g}" y="{y:g}" {style}>{escape(words)}</text>'


if __name__ == "__main__":
    main(Path(sys.argv[1]))
