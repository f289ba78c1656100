"""What happens while a study runs, for the callables that show or record it.

A callback takes one event; it is called from the thread that works on the trial. ``match`` tells events apart::

    def show(event: Event) -> None:
        match event:
            case RunFinished(run):
                print(run.request.kind, run.request.index, run.stored.error)
            case TrialFinished(number=number, result=result):
                print(number, result.value)
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from gtf_tune.pipelines import OptionValue
from gtf_tune.store.trial_queue import TrialResult
from gtf_tune.study.outcome.improvement import UNKNOWN_IMPROVEMENT, Improvement
from gtf_tune.study.runs.sequence_runs import FinishedRun


@dataclass(frozen=True)
class TrialStarted:
    """The options of a trial are chosen; ``planned_runs`` is how many runs it starts with, over all sequences."""

    number: int
    options: Mapping[str, OptionValue]
    planned_runs: int


@dataclass(frozen=True)
class RunFinished:
    """A run has ended and is stored, or was found stored."""

    run: FinishedRun


@dataclass(frozen=True)
class NoiseStarted:
    """Runs with noise of ``sigma`` grey levels begin, by which the noise of a sequence is chosen."""

    sequence: str
    sigma: float
    planned_runs: int


@dataclass(frozen=True)
class NoiseChosen:
    """The study takes noise of ``sigma`` grey levels for a sequence from now on."""

    sequence: str
    sigma: float
    reason: str


@dataclass(frozen=True)
class TrialFinished:
    """A trial has ended and is stored; ``improvement`` is that on nominal."""

    number: int
    options: Mapping[str, OptionValue]
    result: TrialResult
    improvement: Improvement = UNKNOWN_IMPROVEMENT


Event = TrialStarted | RunFinished | NoiseStarted | NoiseChosen | TrialFinished
Callback = Callable[[Event], None]


def ignore(event: Event) -> None:
    """Do nothing with an event."""
    del event
