"""Show the runs of the nominal and of the recommended setting: trajectories, matrices, frames."""

import numpy as np

from gtf_tune.display import ScoreUnit, count, interval, sequence_unit, significant
from gtf_tune.report import markup
from gtf_tune.report.figures import theme
from gtf_tune.report.figures.matrices import matrix_figure, matrix_range
from gtf_tune.report.figures.trajectories import error_range, scene_figure, spread_figure, top_figure
from gtf_tune.report.markup import Html
from gtf_tune.report.panels.blocks import Block, Drawing, ReportInput
from gtf_tune.report.study_data import StudyData
from gtf_tune.report.tables.details import SequenceDetail, sequence_detail
from gtf_tune.report.tables.trajectories import FrameSpread, align_runs, frame_spread, lay_on_each_other
from gtf_tune.report.tables.verdict import study_verdict

# Browsers keep at most 8 to 16 WebGL scenes of a page alive; each sequence takes two.
_MOST_SCENES = 4
_LISTED_FRAMES = 8


def trajectories_panel(report: ReportInput) -> list[Block]:
    """Return the aligned runs from the top and, for the first sequences, in 3-D."""
    blocks: list[Block] = []
    for number, (sequence, settings) in enumerate(report.settings.items()):
        placed = [align_runs(one) for one in lay_on_each_other(settings)]
        if not any(placed):
            blocks.append(markup.missing(f"{sequence}: no clean run has poses that could be drawn."))
            continue
        thinned = [tuple(run.thinned(report.definition.trajectory_points) for run in runs) for runs in placed]
        colours = error_range(placed)
        drawers = [("top view", top_figure), *([("3-D", scene_figure)] if number < _MOST_SCENES else [])]
        for words, draw in drawers:
            for setting, runs in zip(settings, thinned, strict=True):
                title = f"{sequence}, {setting.title}: {words}"
                blocks.append(Drawing(f"{words} {sequence} {setting.title}", title, draw(runs, colours)))
    return blocks or [markup.missing("No run has finished yet, so there is no trajectory to draw.")]


def matrices_panel(report: ReportInput) -> list[Block]:
    """Return the matrix of errors of each compared trial on each sequence, in common colours."""
    data, unit = report.data, sequence_unit(report.data.definition.gtf)
    compared = compared_trials(data)
    blocks: list[Block] = []
    for sequence in data.sequences:
        found = [(name, ordinal, sequence_detail(data, ordinal, sequence.name)) for name, ordinal in compared]
        colours = matrix_range([detail for _, _, detail in found], unit)
        for name, ordinal, detail in found:
            if not detail.matrix.size:
                reason = detail.message or "it has no noisy runs"
                blocks.append(markup.missing(f"{sequence.name}, {name} trial {ordinal}: no matrix, because {reason}."))
                continue
            title = f"{sequence.name}, {name} (trial {ordinal}): {_score_text(detail, unit)}"
            drawn = matrix_figure(detail, unit, colours)
            blocks.append(Drawing(f"matrix {sequence.name} {name}", title, drawn))
    return blocks or [markup.missing("No trial is complete yet, so there is no matrix to show.")]


def frames_panel(report: ReportInput) -> list[Block]:
    """Return how far each frame moves and how often it is registered, and name the fragile ones."""
    blocks: list[Block] = []
    colours = (theme.NOMINAL, theme.GTF_DARK)
    for sequence, settings in report.settings.items():
        spreads = [frame_spread(one) for one in settings]
        if not any(np.isfinite(spread.median).any() for spread in spreads):
            blocks.append(markup.missing(f"{sequence}: no noisy run can be compared with a clean one."))
            continue
        drawn = spread_figure(list(zip(spreads, colours, strict=False)))
        blocks.append(Drawing(f"frames {sequence}", sequence, drawn, is_wide=True))
        for spread, setting in zip(spreads, settings, strict=True):
            blocks.append(_fragile_text(spread, sequence, setting.num_frames))
    return blocks or [markup.missing("No run has finished yet, so nothing is known about single frames.")]


def compared_trials(data: StudyData) -> list[tuple[str, int]]:
    """Return name and ordinal of the trials that are shown side by side: nominal and the adopted one, else the best."""
    compared = [("nominal", 0)] if any(one.ordinal == 0 for one in data.trials) else []
    verdict = study_verdict(data)
    if verdict.kind == "adopt" and verdict.ordinal is not None:
        compared.append(("recommended", verdict.ordinal))
    elif data.best is not None and data.best.ordinal != 0:
        compared.append(("best", data.best.ordinal))
    return compared


def _score_text(detail: SequenceDetail, unit: ScoreUnit) -> str:
    low, high = unit.shown(detail.low), unit.shown(detail.high)
    sure = f" ({interval(low, high)})" if np.isfinite(low) else ""
    return f"{significant(unit.shown(detail.value))}{sure} {unit.symbol}"


def _fragile_text(spread: FrameSpread, sequence: str, num_frames: int) -> Html:
    fragile = np.flatnonzero(spread.fragile)
    order = fragile[np.argsort(-spread.median[fragile])]
    named = ", ".join(
        f"{spread.frame_ids[index]} ({significant(float(spread.median[index]))} ‰)" for index in order[:_LISTED_FRAMES]
    )
    more = f" and {len(order) - _LISTED_FRAMES} more" if len(order) > _LISTED_FRAMES else ""
    moved = f"these frames move far more than others: {named}{more}" if named else "no frame moves far more than others"
    partly = int((spread.registered < 1).sum())
    never = num_frames - len(spread.frame_ids)
    registered = (
        f"{count(partly, 'frame')} registered in some runs only, {count(never, 'frame')} in none"
        if partly or never
        else "every run registered every frame"
    )
    return markup.paragraph(f"{sequence}, {spread.title}: {moved}; {registered}.")
