"""Count the runs that a study did not have to make, and why."""

from collections.abc import Iterable
from dataclasses import dataclass

from gtf_tune.definition import StudyDefinition
from gtf_tune.store.trials import Effort


@dataclass(frozen=True)
class Savings:
    """Runs of finished trials, over all sequences: asked for, and spared by each way to end a trial early.

    ``full`` is what the trials would have taken with all of their runs. ``by_sizing`` and ``by_pruner`` were spared on
    trials that were stopped early, ``by_coverage`` on infeasible ones. Runs that were stored before count as asked for.
    """

    full: int
    asked: int
    by_sizing: int
    by_pruner: int
    by_coverage: int

    @property
    def share(self) -> float:
        """Return the spared share of the runs, in [0, 1]."""
        return 1.0 - self.asked / self.full if self.full else 0.0


def runs_saved(efforts: Iterable[Effort], definition: StudyDefinition) -> Savings:
    """Return what stopping early has saved in the finished trials of a study."""
    gtf = definition.gtf
    each = (gtf.clean_runs + gtf.noisy_runs_max) * len(definition.searched_sequences)
    finished = [effort for effort in efforts if effort.state in ("complete", "pruned")]
    stopped = sum(_spared(one, each) for one in finished if one.state == "pruned")
    infeasible = sum(_spared(one, each) for one in finished if one.state == "complete" and not one.feasible)
    asked = sum((one.clean_runs + one.noisy_runs) * one.count for one in finished)
    pruner = definition.search.pruner != "none"
    return Savings(
        full=asked + stopped + infeasible,
        asked=asked,
        by_sizing=0 if pruner else stopped,
        by_pruner=stopped if pruner else 0,
        by_coverage=infeasible,
    )


def _spared(one: Effort, each: int) -> int:
    return max(each - one.clean_runs - one.noisy_runs, 0) * one.count
