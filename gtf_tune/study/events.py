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

from gtf_tune.display import ScoreUnit
from gtf_tune.pipelines import OptionValue
from gtf_tune.store.trial_queue import SET_ASIDE_S, TrialResult
from gtf_tune.study.outcome.improvement import UNKNOWN_IMPROVEMENT, Improvement
from gtf_tune.study.runs.plan import FinishedRun


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

    @property
    def text(self) -> str:
        """The event in words."""
        noise = f"{self.sigma:g} grey levels" if self.sigma else "none"
        return f"choosing the noise of {self.sequence}: {noise}, {self.planned_runs} runs"


@dataclass(frozen=True)
class NoiseChosen:
    """The study takes noise of ``sigma`` grey levels for a sequence from now on."""

    sequence: str
    sigma: float
    reason: str

    @property
    def text(self) -> str:
        """The event in words."""
        return f"noise of {self.sequence}: {self.sigma:g} grey levels ({self.reason})"


@dataclass(frozen=True)
class TrialFinished:
    """A trial has ended and is stored; ``improvement`` is that on nominal."""

    number: int
    options: Mapping[str, OptionValue]
    result: TrialResult
    improvement: Improvement = UNKNOWN_IMPROVEMENT


@dataclass(frozen=True)
class TrialSetAside:
    """A trial is left to another machine, since its runs failed and none has worked on this one yet."""

    number: int
    reason: str

    @property
    def text(self) -> str:
        """The event in words."""
        return (
            f"nothing has worked on this machine yet ({self.reason}); trial {self.number} is left to another one for "
            f"{SET_ASIDE_S:g} s, and counts if there is none"
        )


Event = TrialStarted | RunFinished | NoiseStarted | NoiseChosen | TrialFinished | TrialSetAside
Callback = Callable[[Event], None]


def summary(event: Event, unit: ScoreUnit) -> str:
    """Return an event in one line for a log, scores in ``unit``; empty for a run that ended well."""
    match event:
        case TrialStarted(number):
            return f"trial {number} begins"
        case RunFinished(run) if run.stored.error and not run.reused:
            request = run.request
            return f"{request.kind} run {request.index} on {request.sequence.name} failed: {run.stored.error}"
        case NoiseStarted() | NoiseChosen() | TrialSetAside():
            return event.text
        case TrialFinished(number, _, result):
            found = unit.told(result.value) if result.feasible else f"infeasible, {result.message}"
            return f"trial {number} is done: {found}"
    return ""


def ignore(event: Event) -> None:
    """Do nothing with an event."""
    del event
