"""What is known of a study when a trial is to be chosen."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from gtf_tune.display import definition_unit
from gtf_tune.store import confirmations, trials
from gtf_tune.store.database import Database
from gtf_tune.store.studies import Study, stored_definition
from gtf_tune.store.trials import Trial
from gtf_tune.study.outcome.baselines import adopted_baseline
from gtf_tune.study.outcome.doubt import doubts_of_detail
from gtf_tune.study.outcome.verdict import Verdict, verdict_of


@dataclass(frozen=True)
class Evidence:
    """What is known of a study when a trial is to be chosen.

    Attributes
    ----------
    score
        Name of the score, such as ``GTF ATE``.
    nominal, best
        Trial 0, and the feasible complete trial of the smallest score, as far as they exist.
    adopted
        The trial that the last confirmation adopted.
    confirmation
        The verdict of the last confirmation.
    num_trials, num_feasible
        How many trials there are, and how many of them are complete and feasible.
    search_doubts
        Why the score says little, by nominal's runs of the search.
    """

    score: str
    nominal: Trial | None
    best: Trial | None
    adopted: Trial | None = None
    confirmation: Verdict | None = None
    num_trials: int = 0
    num_feasible: int = 0
    search_doubts: tuple[str, ...] = ()

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


def evidence_of(score: str, known: Sequence[Trial], verdict: Verdict | None, doubts: tuple[str, ...] = ()) -> Evidence:
    """Return the evidence from all trials of a study, the verdict of its last confirmation, and doubts of the score."""
    feasible = [trial for trial in known if trial.state == "complete" and trial.feasible and trial.value is not None]
    by_number = {trial.number: trial for trial in known}
    return Evidence(
        score=score,
        nominal=by_number.get(0),
        best=min(feasible, key=lambda trial: (trial.value, trial.number), default=None),
        adopted=_adopted(verdict, by_number.get(0), by_number.get),
        confirmation=verdict,
        num_trials=len(known),
        num_feasible=len(feasible),
        search_doubts=doubts,
    )


def read_evidence(database: Database, study: Study) -> Evidence:
    """Read the evidence with a few small queries, whatever the number of trials."""
    known = confirmations.of_study(database, study.id)
    verdict = verdict_of(known[-1]) if known else None
    efforts = trials.efforts(database, study.id)
    definition, nominal = stored_definition(study), trials.nominal(database, study.id)
    detail = trials.details(database, [nominal.id])[nominal.id] if nominal and nominal.state == "complete" else {}
    return Evidence(
        score=definition_unit(definition).name,
        nominal=nominal,
        best=trials.best(database, study.id),
        adopted=_adopted(verdict, nominal, lambda number: trials.get(database, study.id, number)),
        confirmation=verdict,
        num_trials=sum(effort.count for effort in efforts),
        num_feasible=sum(effort.count for effort in efforts if effort.state == "complete" and effort.feasible),
        search_doubts=doubts_of_detail(detail, definition.gtf),
    )


def _adopted(verdict: Verdict | None, nominal: Trial | None, stored: Callable[[int], Trial | None]) -> Trial | None:
    """Return the trial that a confirmation adopted, which is none of the search where it is a baseline."""
    candidate = verdict.adopted_candidate if verdict else None
    if candidate is None:
        return stored(verdict.adopted) if verdict and verdict.adopted is not None else None
    if candidate.baseline:
        return adopted_baseline(candidate, nominal) if nominal else None
    return stored(candidate.number)
