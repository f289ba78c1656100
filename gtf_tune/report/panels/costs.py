"""What a study cost: runs, time, memory, and what was reused instead of repeated."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, median

import plotly.graph_objects as go

from gtf_tune.display import count, duration, memory, share
from gtf_tune.report.drawing import markup, theme
from gtf_tune.report.drawing.markup import Html
from gtf_tune.report.panels.base import Block, Drawing, Panel, ReportInput
from gtf_tune.report.study_data import StudyData, runs_made
from gtf_tune.store.runs import StoredRun, TrialRun

_SECONDS = "_s"
_CACHED = "_cached"
OTHER = "rest of the run"
_STAGE_COLOURS = (
    theme.NOMINAL,
    theme.GROUND_TRUTH,
    theme.REPROJECTION,
    theme.GTF,
    "rgb(120,144,156)",
    "rgb(214,173,47)",
    "rgb(96,125,190)",
    "rgb(200,200,200)",
)


@dataclass(frozen=True)
class StudyCost:
    """Cost of a study.

    ``uses`` counts the runs that trials needed, ``made`` those executed for them, ``reused`` those found in the
    database, ``failed`` the failed ones among ``made``. ``compute_s`` adds the seconds of the runs made, ``elapsed_s``
    goes from the first trial's start to the last one's end. Confirmations are counted apart.
    """

    uses: int
    made: int
    reused: int
    failed: int
    compute_s: float
    elapsed_s: float
    machines: tuple[str, ...]
    confirmation_runs: int
    confirmation_s: float


@dataclass(frozen=True)
class StageCost:
    """Cost of one stage over all runs made.

    ``computed`` runs did the work, ``cached`` runs found the result in the stage cache; ``mean_s`` is the mean over
    the ``computed`` runs.
    """

    stage: str
    total_s: float
    share: float
    mean_s: float
    computed: int
    cached: int


@dataclass(frozen=True)
class RunCost:
    """Time and memory of the runs made on one sequence, clean or noisy."""

    sequence: str
    kind: str
    runs: int
    median_s: float
    longest_s: float
    median_bytes: float
    largest_bytes: float


def study_cost(data: StudyData) -> StudyCost:
    """Return the totals of a study."""
    made = runs_made(data.runs)
    ended = [trial.finished_at for trial in data.trials if trial.finished_at is not None]
    started = [trial.started_at for trial in data.trials if trial.started_at]
    return StudyCost(
        uses=len(data.runs),
        made=len(made),
        reused=sum(use.reused for use in data.runs),
        failed=sum(use.run.status == "failed" for use in made),
        compute_s=math.fsum(use.run.wall_s for use in made),
        elapsed_s=max(ended) - min(started) if ended and started else math.nan,
        machines=tuple(sorted({use.run.host for use in made if use.run.host})),
        confirmation_runs=len(data.confirmation_runs),
        confirmation_s=math.fsum(run.wall_s for run in data.confirmation_runs),
    )


def stage_costs(runs: Sequence[StoredRun]) -> tuple[StageCost, ...]:
    """Return what the stages cost, the most expensive first; the time outside all stages comes last."""
    seconds: dict[str, list[float]] = {}
    cached: dict[str, int] = {}
    rest = []
    for run in runs:
        timed = _stage_seconds(run)
        hits = {stage for stage in timed if run.diagnostics.get(stage + _CACHED) is True}
        for stage, spent in timed.items():
            seconds.setdefault(stage, []).extend([] if stage in hits else [spent])
            cached[stage] = cached.get(stage, 0) + (stage in hits)
        if timed:
            rest.append(max(run.wall_s - math.fsum(timed.values()), 0.0))
    if not seconds:
        return ()
    ordered = [*sorted(seconds.items(), key=lambda item: -math.fsum(item[1])), (OTHER, rest)]
    total = math.fsum(math.fsum(spent) for _, spent in ordered)
    return tuple(_stage_cost(stage, spent, total, cached.get(stage, 0)) for stage, spent in ordered)


def run_costs(runs: Sequence[TrialRun]) -> tuple[RunCost, ...]:
    """Return time and memory of runs by sequence and kind."""
    groups: dict[tuple[str, str], list[StoredRun]] = {}
    for use in runs:
        groups.setdefault((use.sequence_name, use.run.kind), []).append(use.run)
    return tuple(_run_cost(*key, group) for key, group in sorted(groups.items()))


def stage_figure(stages: Sequence[StageCost]) -> go.Figure:
    """Return the time of all runs as one bar, stage by stage."""
    drawn = theme.figure(height=170)
    for number, stage in enumerate(stages):
        drawn.add_bar(
            x=[100 * stage.share],
            y=["time"],
            orientation="h",
            name=stage.stage,
            marker={"color": _STAGE_COLOURS[number % len(_STAGE_COLOURS)], "line": {"color": theme.PAPER, "width": 1}},
            text=[stage.stage if stage.share > 0.07 else ""],
            textposition="inside",
            insidetextanchor="middle",
            hovertext=[f"{stage.stage}: {duration(stage.total_s)}, {share(stage.share)}"],
            hoverinfo="text",
        )
    drawn.update_layout(
        barmode="stack",
        margin={"t": 40, "b": 45},
        legend={"traceorder": "normal"},
        xaxis=theme.axis("share of the time of all runs [%]", range=[0, 100], showgrid=False),
        yaxis={"visible": False},
    )
    return drawn


def costs_panel(report: ReportInput) -> list[Block]:
    """Return time by stage with cache hits, time and memory by run, and how many runs were reused."""
    made = runs_made(report.data.runs)
    if not made:
        return [markup.missing("No run was made for this study, so it cost no time.")]
    cost = study_cost(report.data)
    blocks: list[Block] = [
        markup.paragraph(
            f"The trials needed {count(cost.uses, 'run')}; {cost.made} were executed and {cost.reused} found in the "
            f"database. All runs together took {duration(cost.compute_s)}; from its first to its last trial the study "
            f"took {duration(cost.elapsed_s)}, on {count(len(cost.machines), 'machine')}.{_confirmation_text(cost)}"
        )
    ]
    stages = stage_costs([use.run for use in made])
    if stages:
        blocks.append(Drawing("stages", "", stage_figure(stages), is_wide=True))
        rows = [
            (
                stage.stage,
                duration(stage.total_s),
                share(stage.share),
                duration(stage.mean_s),
                stage.computed,
                stage.cached,
            )
            for stage in stages
        ]
        blocks.append(markup.table(["stage", ">total", ">share", ">mean", ">computed", ">from the cache"], rows))
    else:
        blocks.append(markup.missing("The pipeline reports no stages, so only whole runs are listed."))
    blocks.append(_run_table(report))
    return blocks


def _stage_seconds(run: StoredRun) -> dict[str, float]:
    return {
        name.removesuffix(_SECONDS): float(value)
        for name, value in run.diagnostics.items()
        if name.endswith(_SECONDS) and isinstance(value, int | float)
    }


def _stage_cost(stage: str, spent: Sequence[float], total_s: float, cached: int) -> StageCost:
    stage_s = math.fsum(spent)
    mean_s = fmean(spent) if spent else math.nan
    return StageCost(stage, stage_s, stage_s / total_s if total_s else 0.0, mean_s, len(spent), cached)


def _run_cost(sequence: str, kind: str, runs: Sequence[StoredRun]) -> RunCost:
    memory = [float(run.peak_memory_bytes) for run in runs if run.peak_memory_bytes > 0] or [math.nan]
    seconds = [run.wall_s for run in runs]
    return RunCost(sequence, kind, len(runs), median(seconds), max(seconds), median(memory), max(memory))


def _confirmation_text(cost: StudyCost) -> str:
    if not cost.confirmation_runs:
        return ""
    runs = count(cost.confirmation_runs, "more run")
    return f" Confirmations with fresh seeds took {runs} and {duration(cost.confirmation_s)}."


def _run_table(report: ReportInput) -> Html:
    rows = [
        (
            cost.sequence,
            cost.kind,
            cost.runs,
            duration(cost.median_s),
            duration(cost.longest_s),
            memory(cost.median_bytes),
            memory(cost.largest_bytes),
        )
        for cost in run_costs(runs_made(report.data.runs))
    ]
    columns = ["sequence", "kind", ">runs", ">median time", ">longest", ">median peak memory", ">largest"]
    return markup.table(columns, rows)


PANEL = Panel("Time and memory", costs_panel)
