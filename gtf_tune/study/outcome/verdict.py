"""The verdict of a confirmation as a typed value, and the JSON in which it is stored and printed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, Self, cast

from gtf_tune.pipelines.options import OptionValue
from gtf_tune.store.confirmations import Confirmation
from gtf_tune.study.outcome.improvement import UNKNOWN_IMPROVEMENT, Improvement, known, nan_if_none

VerdictWord = Literal["adopt", "keep nominal", "none"]

ADOPT: Final = "adopt"
KEEP: Final = "keep nominal"
NO_VERDICT: Final = "none"
"""The nominal options did not work on fresh noise, so there was nothing to compare with."""


@dataclass(frozen=True)
class SequenceFacts:
    """What the fresh runs of one configuration gave on one sequence.

    ``value`` is the score, NaN where there is none; ``coverage`` the share of frames that the worst run registered;
    ``collapsed`` the number of noisy runs that collapsed.
    """

    value: float
    coverage: float
    collapsed: int

    def as_json(self) -> dict[str, float | int | None]:
        """Return the stored form."""
        return {"value": known(self.value), "coverage": known(self.coverage), "collapsed": self.collapsed}

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> Self:
        """Return the facts that `as_json` wrote."""
        return cls(
            nan_if_none(stored.get("value")), nan_if_none(stored.get("coverage")), int(stored.get("collapsed") or 0)
        )


@dataclass(frozen=True)
class SequenceComparison:
    """A candidate beside nominal on one sequence.

    ``p_value`` is that of this sequence alone, not corrected for several candidates; NaN where it is unknown.
    """

    facts: SequenceFacts
    improvement: Improvement
    p_value: float
    is_holdout: bool

    def as_json(self) -> dict[str, Any]:
        """Return the stored form."""
        return {**self.facts.as_json(), **_effect_json(self.improvement, self.p_value), "holdout": self.is_holdout}

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> Self:
        """Return the comparison that `as_json` wrote."""
        effect, p_value = _effect(stored)
        return cls(SequenceFacts.from_json(stored), effect, p_value, bool(stored.get("holdout")))


@dataclass(frozen=True)
class Candidate:
    """What a confirmation found about one trial of the search.

    Attributes
    ----------
    value
        Its score on the only sequence, or over sequences relative to nominal; NaN where there is none.
    improvement, p_value
        Over all searched sequences together; ``adjusted_p_value`` is corrected for the number of candidates (Holm).
    passes
        Whether it may be adopted: ``reasons`` lists what speaks against it.
    by_sequence
        The same on every sequence, held out or not.
    baseline
        Its name where it is no trial of the search but a baseline, whose number is negative.
    """

    number: int
    options: Mapping[str, OptionValue]
    value: float
    improvement: Improvement
    p_value: float
    adjusted_p_value: float
    passes: bool
    reasons: tuple[str, ...]
    by_sequence: Mapping[str, SequenceComparison]
    baseline: str = ""

    @property
    def label(self) -> str:
        """What to call it: the name of a baseline, or ``trial 3``."""
        return self.baseline or f"trial {self.number}"

    def as_json(self) -> dict[str, Any]:
        """Return the stored form."""
        return {
            "ordinal": self.number,
            "options": dict(self.options),
            **_effect_json(self.improvement, self.p_value),
            "adjusted_p_value": known(self.adjusted_p_value),
            "verdict": ADOPT if self.passes else KEEP,
            "reasons": list(self.reasons),
            "by_sequence": {name: found.as_json() for name, found in self.by_sequence.items()},
            "value": known(self.value),
            **({"baseline": self.baseline} if self.baseline else {}),
        }

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> Self:
        """Return the candidate that `as_json` wrote."""
        effect, p_value = _effect(stored)
        return cls(
            number=int(stored["ordinal"]),
            options=stored.get("options") or {},
            value=nan_if_none(stored.get("value")),
            improvement=effect,
            p_value=p_value,
            adjusted_p_value=nan_if_none(stored.get("adjusted_p_value")),
            passes=stored.get("verdict") == ADOPT,
            reasons=tuple(stored.get("reasons") or ()),
            by_sequence={
                name: SequenceComparison.from_json(found) for name, found in (stored.get("by_sequence") or {}).items()
            },
            baseline=stored.get("baseline") or "",
        )


@dataclass(frozen=True)
class MeasuredNominal:
    """The nominal options on fresh noise."""

    number: int
    options: Mapping[str, OptionValue]
    by_sequence: Mapping[str, SequenceFacts]

    def as_json(self) -> dict[str, Any]:
        """Return the stored form."""
        facts = {name: found.as_json() for name, found in self.by_sequence.items()}
        return {"ordinal": self.number, "options": dict(self.options), "by_sequence": facts}

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> Self:
        """Return what `as_json` wrote."""
        facts = {name: SequenceFacts.from_json(found) for name, found in (stored.get("by_sequence") or {}).items()}
        return cls(int(stored.get("ordinal") or 0), stored.get("options") or {}, facts)


@dataclass(frozen=True)
class Verdict:
    """What a confirmation concludes.

    Attributes
    ----------
    word
        ``adopt`` a candidate, ``keep nominal``, or ``none`` where nominal did not work on fresh noise.
    adopted
        Ordinal of the adopted trial; None for the other two.
    candidates
        The trials that were compared with nominal, best score of the search first, then the baselines; empty where
        there was none.
    nominal
        What nominal was measured at; None where there was no candidate to compare with.
    noisy_runs
        Fresh noisy runs on each sequence, of nominal and of what was not dropped before; 0 where it was not stored.
    doubts
        Why the score says little, by nominal's fresh runs; None where nobody looked (an earlier version, no runs).
    set_aside
        Which clean runs were set aside, one sentence for each sequence.
    """

    word: VerdictWord
    adopted: int | None
    candidates: tuple[Candidate, ...]
    nominal: MeasuredNominal | None
    noisy_runs: int = 0
    doubts: tuple[str, ...] | None = None
    set_aside: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return the stored form, which `study confirm --json` prints."""
        return {
            "verdict": self.word,
            "adopted": self.adopted,
            "candidates": [candidate.as_json() for candidate in self.candidates],
            "nominal": self.nominal.as_json() if self.nominal else None,
            "runs": self.noisy_runs,
            **({} if self.doubts is None else {"doubts": list(self.doubts)}),
            **({"set_aside": list(self.set_aside)} if self.set_aside else {}),
        }

    @classmethod
    def from_json(cls, stored: Mapping[str, Any], word: str) -> Self:
        """Return the verdict that `as_json` wrote; ``word`` is the candidate that is stored beside it."""
        nominal = stored.get("nominal")
        return cls(
            word=cast(VerdictWord, word),
            adopted=stored.get("adopted"),
            candidates=tuple(Candidate.from_json(candidate) for candidate in stored.get("candidates") or ()),
            nominal=MeasuredNominal.from_json(nominal) if nominal else None,
            noisy_runs=int(stored.get("runs") or 0),
            doubts=tuple(stored["doubts"]) if "doubts" in stored else None,
            set_aside=tuple(stored.get("set_aside") or ()),
        )

    @property
    def adopted_candidate(self) -> Candidate | None:
        """The candidate that is adopted."""
        return next((candidate for candidate in self.candidates if candidate.number == self.adopted), None)

    @property
    def leading(self) -> Candidate | None:
        """The adopted candidate, or else the one of the largest improvement; None where there was no candidate."""
        return self.adopted_candidate or max(self.candidates, key=_size, default=None)

    def compared(self, options: Mapping[str, OptionValue] | None) -> bool:
        """Whether these options were measured, as nominal's or as a candidate's.

        Options count, not trials: with noise of its own for every trial the same options may come again and score
        better.
        """
        measured = [self.nominal.options] if self.nominal else []
        return options in [*measured, *(candidate.options for candidate in self.candidates)]


def verdict_of(confirmation: Confirmation) -> Verdict:
    """Return the verdict of a stored confirmation."""
    return Verdict.from_json(confirmation.result, confirmation.verdict)


def _size(candidate: Candidate) -> float:
    return candidate.improvement.value if candidate.improvement.is_known else -math.inf


def _effect_json(improvement: Improvement, p_value: float) -> dict[str, float | int | None]:
    value, low, high = (known(bound) for bound in (improvement.value, improvement.low, improvement.high))
    return {
        "improvement": value,
        "low": low,
        "high": high,
        "p_value": known(p_value),
        "instances": improvement.instances,
    }


def _effect(stored: Mapping[str, Any]) -> tuple[Improvement, float]:
    if stored.get("improvement") is None:
        return UNKNOWN_IMPROVEMENT, math.nan
    effect = Improvement.from_json({**stored, "value": stored["improvement"]})
    return effect, nan_if_none(stored.get("p_value"))
