"""Add up what a study cost: runs, time, memory, and what was not done twice."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, median

from gtf_tune.report.study_data import StudyData
from gtf_tune.store.runs import StoredRun, TrialRun

_SECONDS = "_s"
_CACHED = "_cached"
OTHER = "rest of the run"


@dataclass(frozen=True)
class StudyCost:
    """Hold what a study cost.

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
    """Hold what one stage cost over all runs made.

    ``computed`` runs did the work, ``cached`` runs found it in the stage cache; ``mean_s`` is per run that did it.
    """

    stage: str
    total_s: float
    share: float
    mean_s: float
    computed: int
    cached: int


@dataclass(frozen=True)
class RunCost:
    """Hold time and memory of the runs made on one sequence, clean or noisy."""

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
    ended = [one.finished_at for one in data.trials if one.finished_at is not None]
    started = [one.started_at for one in data.trials if one.started_at]
    return StudyCost(
        uses=len(data.runs),
        made=len(made),
        reused=sum(one.reused for one in data.runs),
        failed=sum(one.run.status == "failed" for one in made),
        compute_s=math.fsum(one.run.wall_s for one in made),
        elapsed_s=max(ended) - min(started) if ended and started else math.nan,
        machines=tuple(sorted({one.run.host for one in made if one.run.host})),
        confirmation_runs=len(data.confirmation_runs),
        confirmation_s=math.fsum(run.wall_s for run in data.confirmation_runs),
    )


def runs_made(runs: Sequence[TrialRun]) -> tuple[TrialRun, ...]:
    """Return each run that was executed for a trial of this study, once, in the order in which they started."""
    first = {one.run.id: one for one in reversed(runs) if not one.reused}
    return tuple(sorted(first.values(), key=lambda one: (one.run.started_at, one.run.id)))


def stage_costs(runs: Sequence[StoredRun]) -> tuple[StageCost, ...]:
    """Return what the stages cost, the most expensive first; what no stage claims comes last."""
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
    for one in runs:
        groups.setdefault((one.sequence_name, one.run.kind), []).append(one.run)
    return tuple(_run_cost(*key, group) for key, group in sorted(groups.items()))


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
