"""Say what happens while a study runs, for whoever shows or records it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from gtf_tune.pipelines import OptionValue
from gtf_tune.store.runs import StoredRun
from gtf_tune.study.outcome.improvement import UNKNOWN_IMPROVEMENT, Improvement
from gtf_tune.study.runs.run_source import RunListener, RunSlot
from gtf_tune.study.scoring.objective import TrialScore


@dataclass(frozen=True)
class TrialEnd:
    """End of a trial: its slot, options, score and improvement on nominal, and why it was stopped early if it was."""

    number: int
    options: Mapping[str, OptionValue]
    score: TrialScore
    improvement: Improvement = UNKNOWN_IMPROVEMENT
    stopped: str = ""


class StudyListener(RunListener, Protocol):
    """Hear of trials and runs; called from the thread that works on the trial."""

    def trial_started(self, number: int, options: Mapping[str, OptionValue], planned_runs: int) -> None:
        """Take note of a trial whose options are chosen."""
        ...

    def trial_finished(self, end: TrialEnd) -> None:
        """Take note of a trial that is complete and stored."""
        ...


class Silent:
    """Hear and do nothing."""

    def trial_started(self, number: int, options: Mapping[str, OptionValue], planned_runs: int) -> None:
        """Do nothing."""

    def run_finished(self, slot: RunSlot, run: StoredRun, *, reused: bool) -> None:
        """Do nothing."""

    def noise_started(self, sequence: str, sigma: float, planned_runs: int) -> None:
        """Do nothing."""

    def noise_chosen(self, sequence: str, sigma: float, reason: str) -> None:
        """Do nothing."""

    def trial_finished(self, end: TrialEnd) -> None:
        """Do nothing."""


@dataclass(frozen=True)
class Several:
    """Pass everything on to several listeners, in order."""

    listeners: tuple[StudyListener, ...]

    def trial_started(self, number: int, options: Mapping[str, OptionValue], planned_runs: int) -> None:
        """Pass it on."""
        for listener in self.listeners:
            listener.trial_started(number, options, planned_runs)

    def run_finished(self, slot: RunSlot, run: StoredRun, *, reused: bool) -> None:
        """Pass it on."""
        for listener in self.listeners:
            listener.run_finished(slot, run, reused=reused)

    def noise_started(self, sequence: str, sigma: float, planned_runs: int) -> None:
        """Pass it on."""
        for listener in self.listeners:
            listener.noise_started(sequence, sigma, planned_runs)

    def noise_chosen(self, sequence: str, sigma: float, reason: str) -> None:
        """Pass it on."""
        for listener in self.listeners:
            listener.noise_chosen(sequence, sigma, reason)

    def trial_finished(self, end: TrialEnd) -> None:
        """Pass it on."""
        for listener in self.listeners:
            listener.trial_finished(end)
