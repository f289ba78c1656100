"""Show a study at work: bars on a terminal, plain lines elsewhere."""

import sys
import threading
import time
from typing import TYPE_CHECKING, Self

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from gtf_tune.cli.terminal.console import duration, printable, say, stderr
from gtf_tune.study.events import (
    Event,
    NoiseChosen,
    NoiseStarted,
    RunFinished,
    TrialFinished,
    TrialSetAside,
    TrialStarted,
)
from gtf_tune.study.runs.plan import FinishedRun

if TYPE_CHECKING:
    from gtf_tune.display import ScoreUnit
    from gtf_tune.study.open_study import OpenStudy


class StudyProgress:
    """Show how far a study is, the lowest score so far, and how long it will take; `on_event` is a callback.

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
            TextColumn("{task.fields[note]}", markup=False),
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

    def on_event(self, event: Event) -> None:
        """Show an event of the worker; safe to call from several threads."""
        with self._lock:
            match event:
                case TrialStarted(planned_runs=planned):
                    self._plan(planned)
                case RunFinished(run):
                    self._show_run(run)
                case NoiseStarted():
                    self._noise_began = self._noise_began or time.perf_counter()
                    self._plan(event.planned_runs)
                    if self._progress.disable:
                        say(event.text)
                case NoiseChosen():
                    self._show_noise(event)
                case TrialFinished():
                    self._show_trial(event)
                case TrialSetAside():
                    say(printable(event.text))

    def _plan(self, runs: int) -> None:
        self._planned += runs
        self._progress.update(self._runs, total=self._planned)

    def _show_run(self, run: FinishedRun) -> None:
        request, stored = run.request, run.stored
        found = stored.error or ("reused" if run.reused else f"{stored.wall_s:.1f} s")
        note = printable(f"{request.kind} {request.index} on {request.sequence.name}: {found}")
        self._progress.advance(self._runs)
        self._progress.update(self._runs, note=note)

    def _show_noise(self, event: NoiseChosen) -> None:
        """Print which noise was chosen; its runs count as no trial's, or the time left would be too long."""
        now = time.perf_counter()
        self._began += now - (self._noise_began or now)
        self._noise_began = None
        self._progress.console.print(printable(event.text), markup=False, highlight=False)

    def _show_trial(self, event: TrialFinished) -> None:
        self._finished += 1
        self._done_here += 1
        self._remember(event)
        left = (time.perf_counter() - self._began) / self._done_here * max(self._budget - self._finished, 0)
        note = f"lowest {self._unit.told(self._lowest)}, {duration(left)} left"
        self._progress.update(self._trials, completed=self._finished, note=note)
        if self._progress.disable:
            say(f"{trial_line(event, self._unit)}; {self._finished}/{self._budget}, {note}")

    def _remember(self, event: TrialFinished) -> None:
        result = event.result
        if result.value is None or not result.feasible or result.state == "pruned":
            return
        if self._lowest is None or result.value < self._lowest:
            self._lowest = result.value


def trial_line(event: TrialFinished, unit: "ScoreUnit") -> str:
    """Return what a trial found in one line, its score in ``unit``."""
    from gtf_tune.display import short_names
    from gtf_tune.pipelines.options import option_text

    result = event.result
    name = "nominal" if event.number == 0 else f"trial {event.number}"
    values = [option_text(value, digits=4) for value in event.options.values()]
    options = ", ".join(f"{option}={text}" for option, text in zip(short_names(event.options), values, strict=True))
    if result.value is None or not result.feasible:
        return f"{name} ({options}): infeasible, {result.message}"
    if result.state == "pruned":
        return f"{name} ({options}): stopped early, {result.message}"
    change = f", {event.improvement.text}" if event.improvement.is_known else ""
    return f"{name} ({options}): {unit.told(result.value)}{change}"
