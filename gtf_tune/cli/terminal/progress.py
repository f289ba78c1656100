"""Show a study at work: bars on a terminal, plain lines elsewhere."""

import sys
import threading
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Self

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from gtf_tune.cli.terminal.console import chosen_noise, duration, say, stderr, tried_noise

if TYPE_CHECKING:
    from gtf_tune.display import ScoreUnit
    from gtf_tune.pipelines import OptionValue
    from gtf_tune.store.runs import StoredRun
    from gtf_tune.study.open_study import OpenStudy
    from gtf_tune.study.runs.run_source import RunSlot
    from gtf_tune.study.work.callbacks import TrialEnd


class StudyProgress:
    """Show how far a study is, the lowest score so far, and how long it will take.

    ``finished`` trials of ``budget`` were done before. Scores are shown in ``unit``; ``lowest`` is None where no trial
    is feasible yet. The time left follows from the time per trial so far.
    """

    def __init__(self, budget: int, finished: int, unit: "ScoreUnit", lowest: float | None) -> None:
        self._budget = budget
        self._finished = finished
        self._unit = unit
        self._lowest = lowest
        self._lock = threading.Lock()
        self._began = time.perf_counter()
        self._noise_began: float | None = None
        self._done_here = 0
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TextColumn("{task.fields[note]}"),
            console=stderr(),
            transient=False,
            disable=not sys.stderr.isatty(),
        )
        self._trials = self._progress.add_task("trials", total=budget, completed=finished, note="")
        self._runs = self._progress.add_task("runs  ", total=None, note="")
        self._planned = 0

    @classmethod
    def of(cls, study: "OpenStudy") -> "StudyProgress":
        """Return the progress of a study as it stands."""
        from gtf_tune.display import definition_unit
        from gtf_tune.store import trials

        counts = trials.counts(study.database, study.record.id)
        finished = sum(count for state, count in counts.items() if state != "claimed")
        best = trials.best(study.database, study.record.id)
        return cls(study.budget, finished, definition_unit(study.definition), best.value if best else None)

    def __enter__(self) -> Self:
        """Start to show."""
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop to show, leaving the last state on the terminal."""
        self._progress.stop()

    def trial_started(self, number: int, options: Mapping[str, "OptionValue"], planned_runs: int) -> None:
        """Take note of a trial whose options are chosen."""
        del number, options
        with self._lock:
            self._planned += planned_runs
            self._progress.update(self._runs, total=self._planned)

    def run_finished(self, slot: "RunSlot", run: "StoredRun", *, reused: bool) -> None:
        """Take note of a run that is now stored."""
        with self._lock:
            self._progress.advance(self._runs)
            note = "reused" if reused else f"{run.wall_s:.1f} s"
            self._progress.update(self._runs, note=f"{slot.kind} {slot.index} on {slot.sequence}: {run.error or note}")

    def noise_started(self, sequence: str, sigma: float, planned_runs: int) -> None:
        """Take note of runs by which the noise is chosen."""
        with self._lock:
            self._noise_began = self._noise_began or time.perf_counter()
            self._planned += planned_runs
            self._progress.update(self._runs, total=self._planned)
            if self._progress.disable:
                say(tried_noise(sequence, sigma, planned_runs))

    def noise_chosen(self, sequence: str, sigma: float, reason: str) -> None:
        """Say which noise was chosen; its runs count as no trial's, or the time left would be too long."""
        with self._lock:
            now = time.perf_counter()
            self._began += now - (self._noise_began or now)
            self._noise_began = None
            self._progress.console.print(chosen_noise(sequence, sigma, reason), markup=False, highlight=False)

    def trial_finished(self, end: "TrialEnd") -> None:
        """Take note of a trial that is complete and stored."""
        with self._lock:
            self._finished += 1
            self._done_here += 1
            self._remember(end)
            left = (time.perf_counter() - self._began) / self._done_here * max(self._budget - self._finished, 0)
            note = f"lowest {self._unit.told(self._lowest)}, {duration(left)} left"
            self._progress.update(self._trials, completed=self._finished, note=note)
            if self._progress.disable:
                say(f"{self._line(end)}; {self._finished}/{self._budget}, {note}")

    def _remember(self, end: "TrialEnd") -> None:
        if end.score.feasible and not end.stopped and (self._lowest is None or end.score.value < self._lowest):
            self._lowest = end.score.value

    def _line(self, end: "TrialEnd") -> str:
        from gtf_tune.pipelines.options import option_text

        name = "nominal" if end.number == 0 else f"trial {end.number}"
        options = ", ".join(f"{option}={option_text(value, digits=4)}" for option, value in end.options.items())
        if not end.score.feasible:
            return f"{name} ({options}): infeasible, {end.score.message}"
        if end.stopped:
            return f"{name} ({options}): stopped early, {end.stopped}"
        change = f", {end.improvement.text}" if end.improvement.is_known else ""
        return f"{name} ({options}): {self._unit.told(end.score.value)}{change}"
