"""Baselines beside nominal: configurations that people use, which a confirmation compares with nominal too."""

from collections.abc import Mapping
from dataclasses import replace

from gtf_tune.definition import StudyDefinition
from gtf_tune.pipelines.options import OptionValue
from gtf_tune.store.trials import Trial
from gtf_tune.study.outcome.verdict import Candidate

_NO_ID = -1


def baseline_trials(definition: StudyDefinition, nominal: Trial) -> dict[str, Trial]:
    """Return a trial for each baseline of a study by its name, as if it had been one of the search.

    None is stored: their numbers are negative, and no run of the search is theirs.
    """
    return {
        name: _like(nominal, -number, {**(nominal.options or {}), **options})
        for number, (name, options) in enumerate(definition.search.baselines.items(), start=1)
    }


def adopted_baseline(candidate: Candidate, nominal: Trial) -> Trial:
    """Return the trial of a baseline that a confirmation adopted, scored by its fresh runs."""
    return replace(_like(nominal, candidate.number, dict(candidate.options)), value=candidate.value)


def _like(nominal: Trial, number: int, options: Mapping[str, OptionValue]) -> Trial:
    return replace(
        nominal,
        id=_NO_ID,
        number=number,
        optuna_trial_id=None,
        optuna_number=None,
        options=options,
        value=None,
        gtf_ate=None,
        standard_error=None,
        ci_low=None,
        ci_high=None,
    )
