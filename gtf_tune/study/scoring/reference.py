"""Read what a trial is compared with: the nominal trial and the best one before it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gtf_tune.errors import DefinitionError
from gtf_tune.store import runs, trials
from gtf_tune.study.open_study import OpenStudy
from gtf_tune.study.scoring.coverage import CoverageFloor, coverage_floor, least_floor


@dataclass(frozen=True)
class Reference:
    """Hold what trial 0 and the incumbent found.

    ``nominal_scores`` and ``floors`` are by sequence; ``nominal_value`` is the value of trial 0, ``None`` while it is
    being scored or where it is infeasible. ``nominal_detail`` is what trial 0 stored, its matrices included.
    ``incumbent`` holds the instance values of the best trial before this one.
    """

    floors: Mapping[str, CoverageFloor]
    nominal_scores: Mapping[str, float] = field(default_factory=dict)
    nominal_value: float | None = None
    nominal_detail: Mapping[str, Any] = field(default_factory=dict, repr=False)
    incumbent: tuple[float, ...] = ()


def read_reference(study: OpenStudy, number: int) -> Reference:
    """Return what the trial in slot ``number`` is compared with.

    Raises
    ------
    DefinitionError
        Several sequences are tuned together and the nominal setting has no score on one of them.
    """
    if number == 0:
        return Reference({name: least_floor(len(sequence)) for name, sequence in study.sequences.items()})
    nominal = trials.get(study.database, study.record.id, 0)
    stored = trials.details(study.database, [nominal.id])[nominal.id]
    detail = stored["sequences"]
    floors = _floors(study, nominal.id, detail)
    scores = {name: detail[name]["value"] for name in study.sequences if detail[name]["value"] is not None}
    if len(study.sequences) > 1 and len(scores) < len(study.sequences):
        reasons = [f"{name} ({detail[name]['message']})" for name in study.sequences if detail[name]["message"]]
        raise DefinitionError(
            f"the nominal setting has no score on {', '.join(reasons) or nominal.message}, so settings cannot be "
            "compared over several sequences; leave that sequence out or fix options so that the nominal setting works"
        )
    value = nominal.value if nominal.feasible else None
    return Reference(floors, scores, value, stored, _incumbent(study, number))


def _floors(study: OpenStudy, nominal_id: int, detail: Mapping[str, Any]) -> dict[str, CoverageFloor]:
    """Return the floors that nominal's runs set; their coverages are in its detail, except where it has no score."""
    share = study.definition.gtf.coverage_floor
    unscored = any("coverage_noisy" not in detail[name] for name in study.sequences)
    uses = runs.of_trial(study.database, nominal_id) if unscored else []
    floors = {}
    for name, sequence in study.sequences.items():
        clean, noisy = (
            detail[name].get(f"coverage_{kind}")
            or [one.run.coverage for one in uses if (one.sequence_name, one.run.kind) == (name, kind)]
            for kind in ("clean", "noisy")
        )
        floors[name] = coverage_floor(clean, noisy, share).at_least(least_floor(len(sequence)))
    return floors


def _incumbent(study: OpenStudy, number: int) -> tuple[float, ...]:
    best = trials.best(study.database, study.record.id, before=number)
    return () if best is None else tuple(trials.details(study.database, [best.id])[best.id]["instances"])
