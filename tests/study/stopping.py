"""Interrupt a study after some of its runs."""

from gtf_tune.study.events import Event, RunFinished
from gtf_tune.study.runs.stop import STOP_NOW, StopRequest


class StopAfter:
    """Ask to stop at once after so many runs that were not there before."""

    def __init__(self, count: int) -> None:
        self.stop = StopRequest()
        self.left = count

    def __call__(self, event: Event) -> None:
        if isinstance(event, RunFinished):
            self.left -= not event.run.reused
            if self.left <= 0:
                self.stop.ask(STOP_NOW)
