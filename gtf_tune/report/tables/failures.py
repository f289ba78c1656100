"""List what went wrong, grouped by reason."""

from dataclasses import dataclass

from gtf_tune.report.study_data import StudyData
from gtf_tune.report.tables.costs import runs_made
from gtf_tune.report.tables.details import sequence_detail
from gtf_tune.report.tables.points import state_of

_NO_REASON = "no reason was stored"


@dataclass(frozen=True)
class RunFailure:
    """Hold one reason why runs failed; ``example_key`` is the key of the first such run, whose log may be shown."""

    reason: str
    runs: int
    ordinals: tuple[int, ...]
    sequences: tuple[str, ...]
    example: str
    example_key: str


@dataclass(frozen=True)
class TrialFault:
    """Hold one reason why trials have no score, or why some of their pairs of runs have no error."""

    what: str
    reason: str
    count: int
    ordinals: tuple[int, ...]


def run_failures(data: StudyData) -> tuple[RunFailure, ...]:
    """Return why runs failed, the most frequent reason first."""
    groups: dict[str, list[tuple[int, str, str, str]]] = {}
    for one in runs_made(data.runs):
        if one.run.status == "failed":
            name = f"{one.run.kind} run {one.run.index} of trial {one.ordinal} on {one.sequence_name}"
            groups.setdefault(one.run.error or _NO_REASON, []).append(
                (one.ordinal, one.sequence_name, name, one.run.key)
            )
    found = [
        RunFailure(
            reason=reason,
            runs=len(group),
            ordinals=tuple(sorted({one[0] for one in group})),
            sequences=tuple(sorted({one[1] for one in group})),
            example=group[0][2],
            example_key=group[0][3],
        )
        for reason, group in groups.items()
    ]
    return tuple(sorted(found, key=lambda one: -one.runs))


def trial_faults(data: StudyData) -> tuple[TrialFault, ...]:
    """Return why trials are infeasible, pruned or failed, and why pairs of runs could not be compared."""
    groups: dict[tuple[str, str], list[int]] = {}
    for trial in data.trials:
        state = state_of(trial)
        if state in ("infeasible", "pruned", "failed"):
            groups.setdefault((f"{state} trials", trial.message or _NO_REASON), []).append(trial.ordinal)
        for sequence in data.sequences:
            for reason in sequence_detail(data, trial.ordinal, sequence.name).pair_errors.values():
                groups.setdefault(("pairs without an error", reason), []).append(trial.ordinal)
    return tuple(_fault(what, reason, ordinals) for (what, reason), ordinals in groups.items())


def _fault(what: str, reason: str, ordinals: list[int]) -> TrialFault:
    return TrialFault(what, reason, len(ordinals), tuple(sorted(set(ordinals))))
