"""Search one setting for several sequences, and try it on one that the search never saw."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.measure import Bench, confirm_study, finish_study
from experiments.numbers import Table, percent
from experiments.plan import AGGREGATE, CLEAN_RUNS, FIXED, NOISY_RUNS, OPTIONS, ROOM, sequence_of
from experiments.settings import Outcome
from gtf_tune.store import confirmations, studies
from gtf_tune.store.database import Database
from gtf_tune.study.outcome import verdict
from gtf_tune.study.outcome.improvement import Improvement, known

SEARCHED = (ROOM, "hut", "kitti07")
HELD_OUT = "fountain-P11"
OPTION = OPTIONS["huber"]
SIGMA = 5.0
STUDY = f"several.{OPTION.short}.s{SIGMA:g}"
CONFIRMATION = 8
"""Noisy runs of each setting on each sequence; several sequences say more together than one."""


@dataclass(frozen=True)
class OnSequence:
    """What a candidate does on one sequence: its improvement of the score, and its change of the true ATE.

    ``low`` and ``high`` are the 95 % confidence interval of ``improvement``. ``true_change`` is that of the sequence's
    own grid, ``None`` where it was not measured.
    """

    sequence: str
    held_out: bool
    improvement: float | None
    low: float | None
    high: float | None
    true_change: float | None


@dataclass(frozen=True)
class Candidate:
    """One candidate of the confirmation: over the searched sequences together, and on each sequence."""

    value: float
    verdict: str
    adopted: bool
    reasons: tuple[str, ...]
    improvement: float | None
    low: float | None
    high: float | None
    by_sequence: tuple[OnSequence, ...]


def needed() -> tuple[str, ...]:
    """Return the sequences that must be there."""
    return (*SEARCHED, HELD_OUT)


def definition(folders: Mapping[str, Path]) -> dict[str, Any]:
    """Return the definition of the study; its runs are those of the grids of each sequence."""
    sequences = [{**sequence_of(name, folders[name]), "holdout": name == HELD_OUT} for name in needed()]
    return {
        "name": STUDY,
        "pipeline": {"name": "glomap", "options": dict(FIXED)},
        "sequences": sequences,
        "space": {OPTION.name: {"values": list(OPTION.values)}},
        "gtf": {
            "clean_runs": CLEAN_RUNS,
            "noisy_runs": NOISY_RUNS,
            "noise_sigma": SIGMA,
            "aggregate": AGGREGATE,
        },
        "search": {"sampler": "grid"},
    }


def run_several(bench: Bench) -> None:
    """Complete and confirm the study, or raise `Interrupted`."""
    finish_study(bench, STUDY, definition(bench.folders))
    confirm_study(bench, STUDY, CONFIRMATION)


def read_several(database: Database, outcomes: Sequence[Outcome]) -> list[Candidate]:
    """Return the candidates of the confirmed study, none where it is not confirmed."""
    if STUDY not in studies.names(database):
        return []
    confirmed = confirmations.of_study(database, studies.get(database, STUDY).id)
    if not confirmed:
        return []
    found = verdict.verdict_of(confirmed[-1])
    return [_candidate(candidate, candidate.number == found.adopted, outcomes) for candidate in found.candidates]


def _candidate(found: verdict.Candidate, is_adopted: bool, outcomes: Sequence[Outcome]) -> Candidate:
    value = float(found.options[OPTION.name])
    improvement, low, high = _known(found.improvement)
    return Candidate(
        value=value,
        verdict=verdict.ADOPT if found.passes else verdict.KEEP,
        adopted=is_adopted,
        reasons=found.reasons,
        improvement=improvement,
        low=low,
        high=high,
        by_sequence=tuple(
            OnSequence(name, one.is_holdout, *_known(one.improvement), _truth(name, value, outcomes))
            for name, one in found.by_sequence.items()
        ),
    )


def _known(found: Improvement) -> tuple[float | None, float | None, float | None]:
    """Return the improvement and the ends of its interval, None where they are unknown."""
    return known(found.value), known(found.low), known(found.high)


def _truth(sequence: str, value: float, outcomes: Sequence[Outcome]) -> float | None:
    """Return how a value changes the true ATE on a sequence, from the grid of that sequence alone."""
    for outcome in outcomes:
        experiment = outcome.experiment
        if (experiment.sequence, experiment.option.short, experiment.sigma) == (sequence, OPTION.short, SIGMA):
            return next((outcome.change(setting) for setting in outcome.settings if setting.value == value), None)
    return None


def several_table(candidates: Sequence[Candidate]) -> Table:
    """Return one row for each candidate over all searched sequences, and one for each sequence."""
    rows = []
    for candidate in candidates:
        verdict = candidate.verdict + (": " + "; ".join(candidate.reasons) if candidate.reasons else "")
        adopted = ", the surest" if candidate.adopted else ""
        rows.append([f"**{candidate.value:g}**", "searched together", _improvement(candidate), "", verdict + adopted])
        for on in candidate.by_sequence:
            change = "-" if on.true_change is None else percent(on.true_change)
            rows.append(["", on.sequence + (" (held out)" if on.held_out else ""), _improvement(on), change, ""])
    return ["value", "sequence", "GTF ATE, 95 % interval", "true ATE", "verdict"], rows


def _improvement(found: Candidate | OnSequence) -> str:
    if found.improvement is None or found.low is None or found.high is None:
        return "-"
    return f"{percent(-found.improvement)} ({percent(-found.high)} to {percent(-found.low)})"
