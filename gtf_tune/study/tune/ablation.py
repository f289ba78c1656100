"""Put options of the best trial back to nominal where they carry nothing, so that what is adopted is short.

This is the backward half of irace's ablation (Lopez-Ibanez et al., 2016): one option at a time, the least costly first.
"""

from collections.abc import Callable, Mapping

from gtf_tune.pipelines import OptionValue
from gtf_tune.store import trials
from gtf_tune.store.database import Database
from gtf_tune.store.trials import Trial
from gtf_tune.study.outcome.improvement import Improvement, paired_improvement, stored_matrices
from gtf_tune.study.outcome.judge import LEAST_IMPROVEMENT

Try = Callable[[Mapping[str, OptionValue]], Trial | None]
"""Runs a trial with these options; None where there is no time left for it, or someone stopped the work."""


def shortened(database: Database, nominal: Trial, best: Trial, attempt: Try) -> Trial:
    """Return the best trial with as many options as possible put back to nominal at a loss below 2 %.

    Trials of the study that have the options already are taken; the others are made by ``attempt``.
    """
    current = best
    while len(changed := _changed(current, nominal)) > 1:
        shorter = [_known_or_made(database, current, {**_options(current), **back}, attempt) for back in changed]
        losses = [(_loss(database, found, best), found) for found in shorter if found is not None and found.feasible]
        harmless = [(loss, found) for loss, found in losses if loss < LEAST_IMPROVEMENT]
        if not harmless:
            break
        current = min(harmless, key=lambda pair: pair[0])[1]
    return current


def _changed(trial: Trial, nominal: Trial) -> list[dict[str, OptionValue]]:
    """Return for every option that differs from nominal the change that puts it back."""
    usual = _options(nominal)
    return [{name: usual[name]} for name, value in _options(trial).items() if value != usual[name]]


def _options(trial: Trial) -> dict[str, OptionValue]:
    return dict(trial.options or {})


def _known_or_made(database: Database, like: Trial, options: Mapping[str, OptionValue], attempt: Try) -> Trial | None:
    known = (trial for trial in trials.of_study(database, like.study_id) if trial.state == "complete")
    return next((trial for trial in known if trial.options == options), None) or attempt(options)


def _loss(database: Database, shorter: Trial, best: Trial) -> float:
    """Return by which part the errors of a shorter configuration exceed those of the best one."""
    details = trials.details(database, [shorter.id, best.id])
    found: Improvement = paired_improvement(stored_matrices(details[best.id]), stored_matrices(details[shorter.id]))
    return -found.value if found.is_known else 1.0
