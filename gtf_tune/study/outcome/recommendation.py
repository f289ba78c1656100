"""Decide which trial of a study to use, and say so: the one place that does.

`study best`, `show`, `list`, `export`, `confirm`, the HTML report and the dashboard print what stands here.
"""

from collections import Counter
from dataclasses import dataclass
from typing import Any, Final, Literal

from gtf_tune.display import count
from gtf_tune.errors import StorageError
from gtf_tune.store import trials
from gtf_tune.store.database import Database
from gtf_tune.store.studies import Study
from gtf_tune.store.trials import Trial
from gtf_tune.study.outcome.evidence import Evidence, read_evidence
from gtf_tune.study.outcome.improvement import UNKNOWN_IMPROVEMENT, Improvement, read_improvements
from gtf_tune.study.outcome.verdict import ADOPT, KEEP, NO_VERDICT, Verdict

Decision = Literal[
    "adopt", "keep nominal", "neither", "unconfirmed", "nothing better", "nothing feasible", "says little"
]

NEITHER: Final = "neither"
UNCONFIRMED: Final = "unconfirmed"
NOTHING_BETTER: Final = "nothing better"
NOTHING_FEASIBLE: Final = "nothing feasible"
SAYS_LITTLE: Final = "says little"

Step = Literal["confirm", "export", "extend", "new study", "other noise", "wait"]


@dataclass(frozen=True)
class Recommendation:
    """Which trial of a study to use, why, and what to do next.

    Attributes
    ----------
    decision
        ``adopt`` and ``keep nominal`` come from the last confirmation and stand until the next one. ``neither``: the
        confirmation adopted nothing, and nominal does not work either. ``unconfirmed``: the best trial of the search,
        not confirmed yet. ``nothing better``: no trial of the search beats nominal. ``nothing feasible``: no trial may
        be used. ``says little``: not confirmed, and nominal's runs are such that no confirmation would count.
    trial
        The trial to use, "the best" wherever one is shown; None for ``neither`` and ``nothing feasible``.
    improvement
        Of that trial on nominal: on fresh noise where it was confirmed, else in the search.
    evidence
        What the decision rests on.
    """

    decision: Decision
    trial: Trial | None
    improvement: Improvement
    evidence: Evidence

    @property
    def is_confirmed(self) -> bool:
        """Whether fresh noise speaks for the trial to use."""
        return self.decision in (ADOPT, KEEP)

    @property
    def compares(self) -> bool:
        """Whether a trial beside nominal has ended."""
        return self.evidence.num_ended > 1

    @property
    def is_doubted(self) -> bool:
        """Whether nominal is kept because the score says little."""
        return bool(self.evidence.doubts) and self.decision in (KEEP, SAYS_LITTLE)

    @property
    def beside_nominal(self) -> Trial | None:
        """The trial to look at beside nominal: the one to use, else the best of the search; None where it is nominal.

        Where a confirmation keeps nominal that is the trial which it turned down.
        """
        shown = self.trial if self.trial is not None and self.trial.number > 0 else self.evidence.best
        return None if shown is None or shown.number == 0 or self.decision == NOTHING_BETTER else shown

    @property
    def headline(self) -> str:
        """What to do, in a few words."""
        number = self.trial.number if self.trial else None
        adopted = self.evidence.confirmation.adopted_candidate if self.evidence.confirmation else None
        return {
            ADOPT: f"Adopt the options of {adopted.label if adopted else f'trial {number}'}",
            KEEP: "Keep the nominal options",
            NEITHER: "Neither the nominal options nor others are recommended",
            UNCONFIRMED: f"Trial {number} is the best so far; not confirmed yet",
            NOTHING_BETTER: "Keep the nominal options so far",
            NOTHING_FEASIBLE: "No trial is feasible so far",
            SAYS_LITTLE: "Keep the nominal options",
        }[self.decision]

    @property
    def sentences(self) -> tuple[str, ...]:
        """Why, one fact a sentence."""
        reason = {
            ADOPT: self._why_adopted,
            KEEP: self._why_kept,
            NEITHER: self._why_neither,
            UNCONFIRMED: self._why_unconfirmed,
            NOTHING_BETTER: self._why_nothing_better,
            NOTHING_FEASIBLE: self._why_nothing_feasible,
            SAYS_LITTLE: self._why_doubted,
        }[self.decision]
        newer = self.evidence.newer if self.is_confirmed and not self.is_doubted else None
        return (*reason(), *(() if newer is None else (_about_newer(newer, self.evidence.score),)))

    @property
    def text(self) -> str:
        """The headline and the reasons as one paragraph."""
        return " ".join([f"{self.headline}.", *self.sentences])

    @property
    def step(self) -> Step:
        """What to do next."""
        if self.is_doubted:
            return "other noise"
        if self.is_confirmed:
            return "confirm" if self.evidence.newer else "export"
        steps: dict[Decision, Step] = {NEITHER: "new study", UNCONFIRMED: "confirm", NOTHING_BETTER: "extend"}
        return steps.get(self.decision, "wait")

    def summary(self) -> dict[str, Any]:
        """Return what commands about something else say of the recommendation with ``--json``."""
        return {
            "verdict": self.decision,
            "headline": self.headline,
            "reasons": list(self.sentences),
            "recommended": self.trial.number if self.trial else None,
        }

    def as_json(self) -> dict[str, Any]:
        """Return what `study best --json` prints."""
        found, confirmation = self.evidence, self.evidence.confirmation
        trial = self.trial.as_dict() if self.trial else None
        return {
            **self.summary(),
            "recommended": trial,
            "best": trial,
            "nominal": found.nominal.as_dict() if found.nominal else None,
            "improvement": self.improvement.as_json() if self.improvement.is_known else None,
            "confirmation": confirmation.as_json() if confirmation else None,
        }

    def _why_adopted(self) -> tuple[str, ...]:
        verdict = self.evidence.confirmation
        passed = sum(candidate.passes for candidate in verdict.candidates) if verdict else 0
        surest = (f"Of {passed} candidates that passed, its improvement is the surest.",) if passed > 1 else ()
        others = self._about_baselines(verdict) if verdict else ()
        return (f"{self.evidence.score} {self.improvement.text} against nominal, on fresh noise.", *surest, *others)

    def _why_doubted(self) -> tuple[str, ...]:
        return self.evidence.doubts

    def _why_kept(self) -> tuple[str, ...]:
        verdict = self.evidence.confirmation
        if self.evidence.doubts:
            return self.evidence.doubts
        if verdict is None or verdict.leading is None:
            return (
                f"No trial had a smaller {self.evidence.score} than nominal in the search, so there was nothing to "
                "confirm.",
            )
        return (_none_passed(verdict), *self._about_leading(verdict), *self._about_baselines(verdict))

    def _why_neither(self) -> tuple[str, ...]:
        verdict = self.evidence.confirmation
        if verdict is None or verdict.word == NO_VERDICT:
            return ("On fresh noise the nominal options did not work, so there was nothing to compare with.",)
        message = self.evidence.nominal.message if self.evidence.nominal else ""
        return (
            _none_passed(verdict),
            *self._about_leading(verdict),
            f"The nominal options were infeasible in the search{f': {message}' if message else ''}.",
        )

    def _about_leading(self, verdict: Verdict) -> tuple[str, ...]:
        """Return what the confirmation found about the most promising candidate."""
        leading = verdict.leading
        if leading is None:
            return ()
        change = f"{self.evidence.score} {leading.improvement.text}; " if leading.improvement.is_known else ""
        others = len(leading.reasons) - 1
        more = f" (and {count(others, 'more reason')})" if others > 0 else ""
        return (f"{capitalised(leading.label)}: {change}{next(iter(leading.reasons), 'not adopted')}{more}.",)

    def _about_baselines(self, verdict: Verdict) -> tuple[str, ...]:
        """Return what the confirmation found about the baselines that no other sentence is about."""
        others = [found for found in verdict.candidates if found.baseline and found != verdict.leading]
        return tuple(
            f"{capitalised(found.label)}: {self.evidence.score} {found.improvement.text} against nominal; "
            f"{'passes too' if found.passes else next(iter(found.reasons))}."
            for found in others
        )

    def _why_unconfirmed(self) -> tuple[str, ...]:
        score, lead = self.evidence.score, self.evidence.lead
        flatters = (
            f"These runs made it the best of {count(self.evidence.num_feasible, 'feasible trial')}, which flatters it."
            if not self.evidence.leads
            else "It was the best configuration on most sequences that were measured, so another trial only takes its "
            f"place with a score that is smaller by {lead['margin']:.0%}."
        )
        if not self.evidence.has_nominal:
            return (f"The nominal options are infeasible, so there is nothing to compare its {score} with.", flatters)
        if not self.improvement.is_known:
            return (f"Too few noisy runs worked under both to compare its {score} with nominal's.", flatters)
        has_interval = self.improvement.low == self.improvement.low
        doubt = (
            ()
            if self.improvement.is_certain or not has_interval
            else ("The interval does not exclude that the two are equal.",)
        )
        return (f"{score} {self.improvement.text} against nominal, in the search.", *doubt, flatters)

    def _why_nothing_better(self) -> tuple[str, ...]:
        others = max(self.evidence.num_feasible - 1, 0)
        if not self.compares:
            return ("No other trial has ended, so nothing was compared.",)
        return (f"None of {count(others, 'other feasible trial')} has a smaller {self.evidence.score} than nominal.",)

    def _why_nothing_feasible(self) -> tuple[str, ...]:
        if not self.evidence.num_ended:
            return ("No trial has ended, so nothing was compared.",)
        message = self.evidence.nominal.message if self.evidence.nominal else ""
        reason = f" The nominal options: {message}." if message else ""
        return (f"None of {count(self.evidence.num_ended, 'trial')} is feasible.{reason}",)


def decide(evidence: Evidence, improvement: Improvement = UNKNOWN_IMPROVEMENT) -> Recommendation:
    """Return which trial to use.

    Where the score says little nominal is kept, whatever a confirmation of an earlier version found. Otherwise a
    confirmation counts as long as it adopted a trial or keeps nominal options that work: trials that came later do
    not undo it, they are named beside it. Where it came to nothing, a later best trial is looked at anew.

    Parameters
    ----------
    improvement
        Of the best trial of the search on nominal.
    """
    verdict = evidence.confirmation
    if evidence.best is None:
        return Recommendation(NOTHING_FEASIBLE, None, UNKNOWN_IMPROVEMENT, evidence)
    if evidence.has_nominal and evidence.doubts:
        return Recommendation(KEEP if verdict else SAYS_LITTLE, evidence.nominal, UNKNOWN_IMPROVEMENT, evidence)
    if verdict is not None and verdict.adopted_candidate is not None and evidence.adopted is not None:
        return Recommendation(ADOPT, evidence.adopted, verdict.adopted_candidate.improvement, evidence)
    if verdict is not None and verdict.word == KEEP and evidence.has_nominal:
        return Recommendation(KEEP, evidence.nominal, UNKNOWN_IMPROVEMENT, evidence)
    if verdict is not None and evidence.newer is None and not evidence.repeats_nominal:
        return Recommendation(NEITHER, None, UNKNOWN_IMPROVEMENT, evidence)
    if evidence.repeats_nominal:
        return Recommendation(NOTHING_BETTER, evidence.nominal, UNKNOWN_IMPROVEMENT, evidence)
    return Recommendation(UNCONFIRMED, evidence.best, improvement, evidence)


def recommend(database: Database, study: Study) -> Recommendation:
    """Return which trial of a stored study to use.

    Raises
    ------
    DefinitionError
        The stored definition cannot be read.
    """
    evidence = read_evidence(database, study)
    chosen = [] if evidence.best is None else [evidence.best]
    improvements = read_improvements(database, study.id, chosen)
    found = next(iter(improvements.values()), UNKNOWN_IMPROVEMENT)
    return decide(evidence, found)


def require_trial(database: Database, study: Study, found: Recommendation) -> Trial:
    """Return the trial to use.

    Raises
    ------
    StorageError
        There is none, with the reason.
    """
    if found.trial is not None:
        return found.trial
    if found.decision == NOTHING_FEASIBLE:
        raise without_feasible_trial(database, study)
    raise StorageError(f"study '{study.name}' has no trial to use: {found.text}")


def without_feasible_trial(database: Database, study: Study) -> StorageError:
    """Return the error of a study none of whose trials is feasible: why it has no outcome, and what to do."""
    name = study.name
    if study.state != "done":
        return StorageError(f"study '{name}' has no feasible trial yet; run it first", remedy=("run", name))
    reasons = Counter(trial.message for trial in trials.of_study(database, study.id) if trial.message)
    reason = reasons.most_common(1)[0][0] if reasons else "no reason was stored"
    return StorageError(
        f"no trial of study '{name}' is feasible: {reason}; look at its trials", remedy=("show it", name)
    )


def capitalised(text: str) -> str:
    """Return a text with its first letter in upper case, the others as they are."""
    return text[:1].upper() + text[1:]


def _none_passed(verdict: Verdict) -> str:
    if len(verdict.candidates) == 1:
        return "On fresh noise the only candidate did not pass every test."
    return f"On fresh noise none of {len(verdict.candidates)} candidates passed every test."


def _about_newer(newer: Trial, score: str) -> str:
    return (
        f"Trial {newer.number}, which that confirmation did not measure, has a smaller {score} in the search: confirm "
        "again."
    )
