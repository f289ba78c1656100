"""Read what a trial is compared with: the nominal trial and the best one before it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gtf_tune.alignment import MIN_MATCHED
from gtf_tune.errors import StorageError
from gtf_tune.store import trials
from gtf_tune.study.opened import OpenStudy


@dataclass(frozen=True)
class Reference:
    """Hold what trial 0 and the incumbent found.

    ``nominal_scores`` and ``floors`` (least coverage, a fraction of the frames) are by sequence; ``nominal_value`` is
    the value of trial 0, ``None`` while it is being scored or where it is infeasible. ``incumbent`` holds the instance
    values of the best trial before this one.
    """

    floors: Mapping[str, float]
    nominal_scores: Mapping[str, float] = field(default_factory=dict)
    nominal_value: float | None = None
    incumbent: tuple[float, ...] = ()


def read_reference(study: OpenStudy, ordinal: int) -> Reference:
    """Return what the trial in slot ``ordinal`` is compared with.

    The coverage floor is the definition's fraction of the least that any run of the nominal setting registers, noisy
    ones included, so that nominal itself reaches it; where a nominal run failed, of its clean runs. It is never less
    than the four frames that an alignment needs.

    Raises
    ------
    StorageError
        Several sequences are tuned together and the nominal setting has no score on one of them.
    """
    least = {name: MIN_MATCHED / len(sequence) for name, sequence in study.sequences.items()}
    if ordinal == 0:
        return Reference(least)
    nominal = trials.get(study.database, study.record.id, 0)
    detail = trials.details(study.database, [nominal.id])[nominal.id]["sequences"]
    share = study.definition.gtf.coverage_floor
    floors = {name: max(least[name], share * _nominal_coverage(detail[name])) for name in study.sequences}
    scores = {name: detail[name]["value"] for name in study.sequences if detail[name]["value"] is not None}
    if len(study.sequences) > 1 and len(scores) < len(study.sequences):
        missing = sorted(set(study.sequences) - set(scores))
        raise StorageError(
            f"the nominal setting has no score on {', '.join(missing)} ({nominal.message}), so settings cannot be "
            "compared over several sequences; leave that sequence out or fix options so that the nominal setting works"
        )
    value = nominal.value if nominal.feasible else None
    return Reference(floors, scores, value, _incumbent(study, ordinal))


def _nominal_coverage(detail: Mapping[str, Any]) -> float:
    return float(detail["coverage"] or detail["coverage_nominal"])


def _incumbent(study: OpenStudy, ordinal: int) -> tuple[float, ...]:
    best = trials.best(study.database, study.record.id, before=ordinal)
    return () if best is None else tuple(trials.details(study.database, [best.id])[best.id]["instances"])
