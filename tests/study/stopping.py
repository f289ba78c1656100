"""Interrupt studies after a number of runs."""

from gtf_tune.store.runs import StoredRun
from gtf_tune.study.runs.run_source import RunSlot
from gtf_tune.study.runs.stop import STOP_NOW, StopRequest
from gtf_tune.study.work.callbacks import Silent


class StopAfter(Silent):
    """Ask to stop at once after so many runs that were not there before."""

    def __init__(self, count: int) -> None:
        self.stop = StopRequest()
        self.left = count

    def run_finished(self, slot: RunSlot, run: StoredRun, *, reused: bool) -> None:
        del slot, run
        self.left -= not reused
        if self.left <= 0:
            self.stop.ask(STOP_NOW)
