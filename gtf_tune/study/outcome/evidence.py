"""What is known of a study when a trial is to be chosen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self

from gtf_tune.definition import GtfDefinition

if TYPE_CHECKING:  # readers of what is stored need neither numpy nor scipy
    from gtf_tune.gtf import GtfScore

from collections.abc import Callable

from gtf_tune.display import definition_unit
from gtf_tune.store import confirmations, trials
from gtf_tune.store.database import Database
from gtf_tune.store.studies import Study, stored_definition
from gtf_tune.store.trials import Trial
from gtf_tune.study.outcome.baselines import adopted_baseline
from gtf_tune.study.outcome.lead import LEAD_KEY, led
from gtf_tune.study.outcome.verdict import Verdict, verdict_of

MOST_MOVEMENT = 0.1
"""Share of its extent that nominal's trajectory may move under noise."""

LEAST_KEPT = 0.9
"""Share of the frames of nominal's clean runs that its noisy runs must register."""

_MOST_DIVERGED = 0.5


@dataclass(frozen=True)
class NominalRuns:
    """What the runs of nominal on one sequence say about the score.

    Attributes
    ----------
    movement
        Median over pairs of runs, as a fraction of the extent; None where the score is no length or nothing is known.
    diverged
        Share of the noisy runs that collapsed or gave no error.
    clean_coverage, noisy_coverage
        Registered frames over all frames: the least of the clean runs, and the median of the noisy runs.
    """

    movement: float | None
    diverged: float
    clean_coverage: float
    noisy_coverage: float

    @classmethod
    def of_score(cls, score: "GtfScore") -> Self:
        """Return what fresh runs say."""
        failed = [all(value != value for value in column) for column in score.matrix.T.tolist()]
        lost = [bool(one) or bool(other) for one, other in zip(score.collapsed, failed, strict=True)]
        return cls(
            movement=movement(score),
            diverged=sum(lost) / len(lost),
            clean_coverage=float(score.coverage_clean.min()),
            noisy_coverage=median(score.coverage_noisy.tolist()),
        )

    @classmethod
    def of_detail(cls, detail: Mapping[str, Any], gtf: GtfDefinition) -> Self:
        """Return what is stored with the nominal trial for one sequence."""
        matrix = detail.get("matrix") or []
        unit = 1.0 if gtf.normalise == "extent" else detail.get("extent")
        flat = [value for row in matrix for value in row if value is not None]
        known = bool(flat) and bool(unit) and gtf.metric != "rpe_rotation"
        failed = [all(value is None for value in column) for column in zip(*matrix, strict=True)]
        collapsed = detail.get("collapsed") or [False] * len(failed)
        lost = [one or other for one, other in zip(collapsed, failed, strict=True)]
        return cls(
            movement=median(flat) / float(unit or 1.0) if known else None,
            diverged=sum(lost) / len(lost) if lost else 0.0,
            clean_coverage=float(detail["coverage_nominal"]),
            noisy_coverage=_noisy_coverage(detail),
        )

    @property
    def fault(self) -> str:
        """Why the score says little, in words; empty where it says something."""
        if self.diverged > _MOST_DIVERGED:
            return f"{self.diverged:.0%} of nominal's noisy runs diverged"
        if self.movement is not None and self.movement > MOST_MOVEMENT:
            return (
                f"nominal's own trajectory moves by {1000 * self.movement:.0f} per mille of its extent under noise, "
                f"more than {1000 * MOST_MOVEMENT:.0f}"
            )
        return _frames_lost(self.clean_coverage, self.noisy_coverage)


def movement(score: "GtfScore") -> float | None:
    """Return how far trajectories move under noise, the median over pairs of runs, as a fraction of the extent.

    None where the score is no length, or no pair could be measured.
    """
    unit = 1.0 if score.settings.is_relative else score.extent
    known = [value for row in (score.matrix / unit).tolist() for value in row if value == value]
    return median(known) if known and score.settings.metric != "rpe_rotation" else None


def doubts(runs: Mapping[str, NominalRuns]) -> tuple[str, ...]:
    """Return why the score says little, one sentence for each sequence where it does."""
    faults = {name: found.fault for name, found in runs.items()}
    return tuple(f"The score says little on {name}: {fault}." for name, fault in faults.items() if fault)


def doubts_of_scores(scores: "Mapping[str, GtfScore]", searched: Sequence[str]) -> tuple[str, ...]:
    """Return the doubts that fresh runs of nominal raise on the searched sequences."""
    return doubts({name: NominalRuns.of_score(scores[name]) for name in searched})


def doubts_of_detail(detail: Mapping[str, Any], gtf: GtfDefinition) -> tuple[str, ...]:
    """Return the doubts that the nominal trial of the search raises."""
    known = {name: found for name, found in detail.get("sequences", {}).items() if found.get("matrix")}
    return doubts({name: NominalRuns.of_detail(found, gtf) for name, found in known.items()})


def frames_lost_to_noise(detail: Mapping[str, Any]) -> str:
    """Return in words which frames noise costs the nominal trial on one sequence; empty where it keeps nearly all."""
    return _frames_lost(detail["coverage_nominal"], _noisy_coverage(detail))


def _noisy_coverage(detail: Mapping[str, Any]) -> float:
    return float(median(detail.get("coverage_noisy") or [detail["coverage"]]))


def _frames_lost(clean: float, noisy: float) -> str:
    if noisy >= LEAST_KEPT * clean:
        return ""
    return f"noise costs the nominal options frames ({clean:.0%} without it, {noisy:.0%} in the median noisy run)"


@dataclass(frozen=True)
class Evidence:
    """What is known of a study when a trial is to be chosen.

    Attributes
    ----------
    score
        Name of the score, such as ``GTF ATE``.
    nominal, best
        Trial 0, and the feasible complete trial of the smallest score, or the leading one where its score is nearly as
        small (`gtf_tune.study.outcome.lead`); as far as they exist.
    adopted
        The trial that the last confirmation adopted.
    confirmation
        The verdict of the last confirmation.
    num_ended, num_feasible
        How many trials have ended, and how many of them are complete and feasible.
    search_doubts
        Why the score says little, by nominal's runs of the search.
    lead
        What the study resolved under `LEAD_KEY`.
    """

    score: str
    nominal: Trial | None
    best: Trial | None
    adopted: Trial | None = None
    confirmation: Verdict | None = None
    num_ended: int = 0
    num_feasible: int = 0
    search_doubts: tuple[str, ...] = ()
    lead: Mapping[str, Any] = field(default_factory=dict)

    @property
    def leads(self) -> bool:
        """Whether the best trial is the leading one."""
        return self.best is not None and self.best.number == self.lead.get("number")

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the score says little: by the fresh runs of the last confirmation where they were looked at."""
        fresh = self.confirmation.doubts if self.confirmation else None
        return self.search_doubts if fresh is None else fresh

    @property
    def has_nominal(self) -> bool:
        """Whether trial 0 is complete and feasible."""
        return self.nominal is not None and self.nominal.value is not None and bool(self.nominal.feasible)

    @property
    def repeats_nominal(self) -> bool:
        """Whether no trial beats nominal; one with nominal's options, under noise of its own, does not."""
        return (
            self.has_nominal
            and self.nominal is not None
            and self.best is not None
            and (self.best.number == 0 or self.best.options == self.nominal.options)
        )

    @property
    def newer(self) -> Trial | None:
        """The best trial of the search where it beats nominal and the last confirmation did not measure it."""
        if self.confirmation is None or self.best is None or self.repeats_nominal:
            return None
        return None if self.confirmation.compared(self.best.options) else self.best


def evidence_of(
    score: str,
    known: Sequence[Trial],
    verdict: Verdict | None,
    doubts: tuple[str, ...] = (),
    lead: Mapping[str, Any] = MappingProxyType({}),
) -> Evidence:
    """Return the evidence from all trials of a study, the verdict of its last confirmation, and doubts of the score.

    ``lead`` is what the study resolved under `LEAD_KEY`.
    """
    feasible = [trial for trial in known if trial.state == "complete" and trial.feasible and trial.value is not None]
    by_number = {trial.number: trial for trial in known}
    return Evidence(
        score=score,
        nominal=by_number.get(0),
        best=led(
            min(feasible, key=lambda trial: (trial.value, trial.number), default=None),
            by_number.get(lead.get("number", -1)),
            by_number.get(0),
            lead,
        ),
        adopted=_adopted(verdict, by_number.get(0), by_number.get),
        confirmation=verdict,
        num_ended=sum(trial.state != "claimed" for trial in known),
        num_feasible=len(feasible),
        search_doubts=doubts,
        lead=lead,
    )


def read_evidence(database: Database, study: Study) -> Evidence:
    """Read the evidence with a few small queries, whatever the number of trials."""
    known = confirmations.of_study(database, study.id)
    verdict = verdict_of(known[-1]) if known else None
    efforts, lead = trials.efforts(database, study.id), study.resolved.get(LEAD_KEY, {})
    definition, nominal = stored_definition(study), trials.nominal(database, study.id)
    detail = trials.details(database, [nominal.id])[nominal.id] if nominal and nominal.state == "complete" else {}
    return Evidence(
        score=definition_unit(definition).name,
        nominal=nominal,
        best=led(
            trials.best(database, study.id),
            trials.numbered(database, study.id, lead["number"]) if lead else None,
            nominal,
            lead,
        ),
        adopted=_adopted(verdict, nominal, lambda number: trials.get(database, study.id, number)),
        confirmation=verdict,
        num_ended=sum(effort.count for effort in efforts if effort.state != "claimed"),
        num_feasible=sum(effort.count for effort in efforts if effort.state == "complete" and effort.feasible),
        search_doubts=doubts_of_detail(detail, definition.gtf),
        lead=lead,
    )


def _adopted(verdict: Verdict | None, nominal: Trial | None, stored: Callable[[int], Trial | None]) -> Trial | None:
    """Return the trial that a confirmation adopted, which is none of the search where it is a baseline."""
    candidate = verdict.adopted_candidate if verdict else None
    if candidate is None:
        return stored(verdict.adopted) if verdict and verdict.adopted is not None else None
    if candidate.baseline:
        return adopted_baseline(candidate, nominal) if nominal else None
    return stored(candidate.number)
