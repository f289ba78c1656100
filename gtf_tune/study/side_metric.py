"""Record ground truth beside a final score; nothing that searches, scores or picks reads it."""

from optuna.trial import Trial

from gtf_tune.errors import TrajectoryError
from gtf_tune.store import validations
from gtf_tune.store.slots import Slot
from gtf_tune.store.validations import Validation
from gtf_tune.study.opened import OpenStudy
from gtf_tune.study.scoring import ScoredTrial
from gtf_tune.validation import side_metric


def record_side_metric(study: OpenStudy, slot: Slot, trial: Trial, scored: ScoredTrial) -> None:
    """Store the ground-truth ATE of the clean runs on every sequence that has ground truth.

    It goes to a table of its own, and as the user attribute ``gt_ate`` (``gt_ate_NAME`` for several sequences) to
    Optuna.
    """
    found: list[Validation] = []
    for name, sequence in study.sequences.items():
        if sequence.ground_truth is None:
            continue
        try:
            metric = side_metric(sequence.ground_truth, scored.clean[name])
        except TrajectoryError as error:
            found.append(Validation(name, None, {"message": str(error)}))
            continue
        found.append(Validation(name, metric.gt_ate, {"by_run": list(metric.by_run), "skipped": list(metric.skipped)}))
        trial.set_user_attr("gt_ate" if len(study.sequences) == 1 else f"gt_ate_{name}", metric.gt_ate)
    if found:
        validations.save(study.database, slot.trial_id, found)
