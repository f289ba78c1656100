"""Take up the trials that a user of Optuna has enqueued with `optuna.Study.enqueue_trial`."""

from collections.abc import Mapping

from gtf_tune.errors import OptionError, numbered
from gtf_tune.store import enqueued
from gtf_tune.store.optuna import trials as optuna_trials
from gtf_tune.study.enqueue import option_faults
from gtf_tune.study.open_study import OpenStudy


def adopt_waiting(study: OpenStudy) -> None:
    """Append the trials that wait in Optuna's queue to a study, whose budget grows by as many.

    The sampler chooses what they leave open, as Optuna itself has it. A trial with options that the study cannot have
    fails at once; its user attribute ``refused`` says why.
    """
    for waiting in enqueued.waiting_in_optuna(study.database, study.record):
        faults = _faults(study, optuna_trials.fixed_options(study.optuna_study, waiting.id))
        if faults:
            optuna_trials.refuse(study.optuna_study, waiting.id, numbered(faults))
        else:
            enqueued.adopt(study.database, study.record.id, waiting)


def _faults(study: OpenStudy, options: Mapping[str, object]) -> list[str]:
    table = study.pipeline.options
    try:
        return option_faults(study.space, study.definition, table, table.check(options))
    except OptionError as error:
        return [str(error)]
