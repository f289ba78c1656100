"""What to do with the result of a study, and how sure that is."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from gtf_tune.pipelines import OptionValue
from gtf_tune.report.details import stored_number
from gtf_tune.report.option_axis import options_at_an_edge
from gtf_tune.report.points import TrialPoint, study_points
from gtf_tune.report.study_data import StudyData
from gtf_tune.study.outcome.improvement import UNKNOWN_IMPROVEMENT, Improvement, improvement
from gtf_tune.study.outcome.verdicts import ADOPT, KEEP, compared

VerdictKind = Literal["adopt", "keep", "neither", "unconfirmed", "none"]


@dataclass(frozen=True)
class OptionChange:
    """Hold one searched option with its nominal and its chosen value."""

    option: str
    nominal: OptionValue | None
    chosen: OptionValue


@dataclass(frozen=True)
class Candidate:
    """Hold what a confirmation with fresh seeds found about one trial; ``reasons`` speak against adopting it."""

    number: int
    improvement: Improvement
    p_value: float
    is_adopted: bool
    reasons: tuple[str, ...]
    by_sequence: Mapping[str, Improvement]


@dataclass(frozen=True)
class Verdict:
    """Hold what a study says.

    ``adopt`` and ``keep`` come from a confirmation with fresh seeds, and so does ``neither``: the best trial was turned
    down, or could not be compared, and the nominal setting does not work either. ``unconfirmed`` means that the best
    trial so far is not the nominal one and was not confirmed; ``none`` that no trial is feasible yet, or that none
    beats nominal.
    ``ratio`` is the trial's score over nominal's in the search, ``improvement`` the same instance by instance, from the
    confirmation where there is one; ``ground_truth`` is the improvement that ground truth sees. ``collapsed`` is the
    share of the trial's noisy runs that fell apart.
    """

    kind: VerdictKind
    number: int | None
    changes: tuple[OptionChange, ...] = ()
    ratio: float = math.nan
    improvement: Improvement = UNKNOWN_IMPROVEMENT
    ground_truth: float = math.nan
    collapsed: float = math.nan
    at_an_edge: tuple[str, ...] = ()
    candidates: tuple[Candidate, ...] = ()

    @property
    def is_distinct(self) -> bool:
        """Tell whether the interval of the improvement lies above zero."""
        return self.improvement.low > 0


def study_verdict(data: StudyData) -> Verdict:
    """Return the verdict of the last confirmation if today's best trial was part of it, else that of the trials."""
    if data.best is None:
        return Verdict("none", None)
    found = confirmed_candidates(data)
    best = data.best.number
    repeats_nominal = data.nominal is not None and data.best.options == data.nominal.options
    if data.confirmations and (repeats_nominal or compared(data.confirmations[-1].result, data.best.options)):
        chosen = data.confirmations[-1].result.get("adopted")
        adopted = next((one for one in found if one.number == chosen), None)
        if adopted is not None:
            return _about(data, "adopt", adopted.number, adopted.improvement, found)
        if data.confirmations[-1].verdict == KEEP and data.nominal is not None:
            return _about(data, "keep", 0, UNKNOWN_IMPROVEMENT, found)
        if not repeats_nominal:
            return _about(data, "neither", best, UNKNOWN_IMPROVEMENT, found)
    if best == 0 or repeats_nominal:
        return _about(data, "none", 0)
    return _about(data, "unconfirmed", best, _searched_improvement(data, best))


def confirmed_candidates(data: StudyData) -> tuple[Candidate, ...]:
    """Return what the last confirmation found about each of its candidates; empty where there is none."""
    if not data.confirmations:
        return ()
    return tuple(_candidate(row) for row in data.confirmations[-1].result.get("candidates") or ())


def compared_trials(data: StudyData) -> list[tuple[str, int]]:
    """Return name and number of the trials that are shown side by side: nominal and the adopted one, else the best."""
    compared = [("nominal", 0)] if any(one.number == 0 for one in data.trials) else []
    verdict = study_verdict(data)
    if verdict.kind == "adopt" and verdict.number is not None:
        compared.append(("recommended", verdict.number))
    elif data.best is not None and data.best.number != 0:
        compared.append(("best", data.best.number))
    return compared


def _candidate(row: Mapping[str, Any]) -> Candidate:
    return Candidate(
        number=int(row["ordinal"]),
        improvement=_improvement(row),
        p_value=stored_number(row.get("adjusted_p_value")),
        is_adopted=row.get("verdict") == ADOPT,
        reasons=tuple(row.get("reasons") or ()),
        by_sequence={name: _improvement(one) for name, one in (row.get("by_sequence") or {}).items()},
    )


def _improvement(row: Mapping[str, Any]) -> Improvement:
    value, low, high = (stored_number(row.get(name)) for name in ("improvement", "low", "high"))
    return Improvement(value, low, high, int(row.get("instances") or 0))


def _about(
    data: StudyData,
    kind: VerdictKind,
    number: int,
    found: Improvement = UNKNOWN_IMPROVEMENT,
    candidates: tuple[Candidate, ...] = (),
) -> Verdict:
    points = {point.number: point for point in study_points(data).points}
    chosen = points.get(number, TrialPoint(number, "failed"))
    nominal = points.get(0, TrialPoint(0, "failed"))
    names = [name for name in data.definition.space if name in chosen.options]
    return Verdict(
        kind=kind,
        number=number,
        changes=tuple(OptionChange(name, nominal.options.get(name), chosen.options[name]) for name in names),
        ratio=chosen.value / nominal.value if nominal.value else math.nan,
        improvement=found,
        ground_truth=1 - chosen.ground_truth / nominal.ground_truth if nominal.ground_truth else math.nan,
        collapsed=chosen.collapsed,
        at_an_edge=options_at_an_edge(data.definition.space, chosen.options) if number else (),
        candidates=candidates,
    )


def _searched_improvement(data: StudyData, best: int) -> Improvement:
    nominal, other = data.details.get(0), data.details.get(best)
    return improvement(nominal, other) if data.nominal is not None and nominal and other else UNKNOWN_IMPROVEMENT
