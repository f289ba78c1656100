"""What the report adds to the recommendation of a study: changed options, ground truth, fragility."""

import math
from dataclasses import dataclass

from gtf_tune.pipelines import OptionValue
from gtf_tune.report.option_axis import options_at_an_edge
from gtf_tune.report.points import TrialPoint, study_points
from gtf_tune.report.study_data import StudyData
from gtf_tune.study.outcome.recommendation import UNCONFIRMED, Recommendation
from gtf_tune.study.outcome.verdict import ADOPT


@dataclass(frozen=True)
class OptionChange:
    """One searched option with its nominal and its recommended value."""

    option: str
    nominal: OptionValue | None
    chosen: OptionValue


@dataclass(frozen=True)
class VerdictFacts:
    """A recommendation with what the report knows of its trial; empty and NaN where no trial is recommended.

    Attributes
    ----------
    changes
        Every searched option of the recommended trial beside nominal.
    ground_truth
        Change of the error against ground truth relative to nominal: -0.2 is a fifth smaller.
    collapsed
        Share of its noisy runs that collapsed.
    at_an_edge
        Options whose value is an end of the searched range.
    """

    recommendation: Recommendation
    changes: tuple[OptionChange, ...] = ()
    ground_truth: float = math.nan
    collapsed: float = math.nan
    at_an_edge: tuple[str, ...] = ()


def verdict_facts(data: StudyData) -> VerdictFacts:
    """Return the recommendation of a study and the facts that belong to it."""
    found = data.recommendation
    if found.trial is None:
        return VerdictFacts(found)
    points = {point.number: point for point in study_points(data).points}
    chosen, nominal = points[found.trial.number], points.get(0, TrialPoint(0, "failed"))
    names = [name for name in data.definition.space if name in chosen.options]
    return VerdictFacts(
        recommendation=found,
        changes=tuple(OptionChange(name, nominal.options.get(name), chosen.options[name]) for name in names),
        ground_truth=chosen.ground_truth / nominal.ground_truth - 1 if nominal.ground_truth else math.nan,
        collapsed=chosen.collapsed,
        at_an_edge=options_at_an_edge(data.definition.space, chosen.options) if chosen.number else (),
    )


def compared_trials(data: StudyData) -> list[tuple[str, int]]:
    """Return name and number of the trials that are shown side by side: nominal and the one of most interest."""
    compared = [("nominal", 0)] if any(trial.number == 0 for trial in data.trials) else []
    found = data.recommendation
    if found.beside_nominal is not None:
        name = {ADOPT: "recommended", UNCONFIRMED: "best"}.get(found.decision, "lowest score")
        compared.append((name, found.beside_nominal.number))
    return compared
