"""Show how far `gtf-tune tune` is: one bar over all phases on a terminal, plain lines elsewhere."""

import sys
import threading
import time
from typing import TYPE_CHECKING, Self

from rich.progress import BarColumn, Progress, TextColumn

from gtf_tune.cli.terminal.console import duration, say, stderr
from gtf_tune.cli.terminal.progress import trial_line
from gtf_tune.study.events import Event, RunFinished, TrialFinished

if TYPE_CHECKING:
    from gtf_tune.display import ScoreUnit
    from gtf_tune.study.tune.pace import Pace

_QUIET_S = 60.0
"""How long plain lines may pause while runs end but no trial does."""


class TuneProgress:
    """Print every trial as it ends, with the time that everything still takes; `on_event` is a callback."""

    def __init__(self, pace: "Pace", unit: "ScoreUnit") -> None:
        self._pace, self._unit = pace, unit
        self._lock = threading.Lock()
        self._began = self._said = time.monotonic()
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TextColumn("{task.percentage:>3.0f} %"),
            TextColumn("{task.fields[note]}"),
            console=stderr(),
            disable=not sys.stderr.isatty(),
        )
        self._task = self._bar.add_task("search", total=1.0, note="")

    def __enter__(self) -> Self:
        """Start to show."""
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop to show, leaving the last state on the terminal."""
        self._bar.stop()

    def say(self, text: str) -> None:
        """Print a sentence above the bar."""
        if self._bar.disable:
            say(text)
        else:
            self._bar.console.print(text, markup=False, highlight=False)

    def on_event(self, event: Event) -> None:
        """Show an event of the work; safe to call from several threads."""
        with self._lock:
            if isinstance(event, TrialFinished):
                self._say_with_left(trial_line(event, self._unit))
            elif isinstance(event, RunFinished):
                self._show()
                if self._bar.disable and time.monotonic() - self._said > _QUIET_S:
                    request = event.run.request
                    self._say_with_left(f"{self._pace.phase}: {request.kind} run {request.index} has ended")

    def _say_with_left(self, text: str) -> None:
        self._said = time.monotonic()
        self._show()
        self.say(f"{text}; about {duration(self._pace.left_s)} left" if self._bar.disable else text)

    def _show(self) -> None:
        left, passed = self._pace.left_s, time.monotonic() - self._began
        share = passed / (passed + left) if passed + left > 0 else 1.0
        self._bar.update(self._task, description=self._pace.phase, completed=share, note=f"about {duration(left)} left")
