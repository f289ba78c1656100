"""Say which setting of a study to use, as far as its confirmation allows."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gtf_tune.errors import StorageError
from gtf_tune.store import confirmations, studies, trials
from gtf_tune.store.database import Database
from gtf_tune.store.trials import Trial
from gtf_tune.study.outcome.verdicts import ADOPT, KEEP, compared

UNCONFIRMED = "unconfirmed"


@dataclass(frozen=True)
class Recommendation:
    """Hold the trial to use and the verdict behind it: *adopt*, *keep nominal* or *unconfirmed*.

    ``confirmation`` is the result of the last confirmation, also of one that came to no verdict; empty where there is
    none, or where the options of the best trial of today were not among those that it compared. ``turned_down`` says
    that the confirmation speaks for a nominal setting that failed in the search, so that there is nothing to recommend.
    """

    trial: Trial
    verdict: str
    confirmation: Mapping[str, Any]
    turned_down: bool = False

    @property
    def candidate(self) -> Mapping[str, Any]:
        """Return what the confirmation found about the adopted setting, else about the most promising one."""
        found = list(self.confirmation.get("candidates") or ())
        adopted = [one for one in found if one["ordinal"] == self.confirmation.get("adopted")]
        return max(adopted or found, key=lambda one: one["improvement"] or float("-inf"), default={})


def recommend(database: Database, study_id: int, name: str) -> Recommendation:
    """Return the adopted trial, or nominal where the confirmation keeps it, or the best one so far, unconfirmed.

    A nominal setting that was infeasible in the search is never recommended.

    Raises
    ------
    StorageError
        There is no feasible trial yet, or none at all.
    """
    best = trials.best(database, study_id)
    if best is None:
        raise StorageError(without_feasible_trial(database, name))
    known = confirmations.of_study(database, study_id)
    result = known[-1].result if known else {}
    nominal = trials.get(database, study_id, 0)
    if not known or not (best.options == nominal.options or compared(result, best.options)):
        return Recommendation(best, UNCONFIRMED, {})
    if known[-1].verdict == ADOPT:
        return Recommendation(trials.get(database, study_id, result["adopted"]), ADOPT, result)
    if known[-1].verdict == KEEP and nominal.feasible:
        return Recommendation(nominal, KEEP, result)
    return Recommendation(best, UNCONFIRMED, result, turned_down=known[-1].verdict == KEEP)


def without_feasible_trial(database: Database, name: str) -> str:
    """Return what to tell whoever asks for the outcome of a study none of whose trials is feasible."""
    study = studies.get(database, name)
    if study.state != "done":
        return f"study '{name}' has no feasible trial yet; run it with: gtf-tune study run {name}"
    reasons = Counter(one.message for one in trials.of_study(database, study.id) if one.message)
    reason = reasons.most_common(1)[0][0] if reasons else "no reason was stored"
    return f"no trial of study '{name}' is feasible: {reason}; see: gtf-tune study show {name}"
