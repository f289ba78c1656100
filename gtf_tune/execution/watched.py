"""Execute one run while its output is shown, and keep everything that it writes: to find out why a program fails."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import IO

from pebble import ProcessPool

from gtf_tune.execution.base import RunLimits
from gtf_tune.execution.paths import RunPaths
from gtf_tune.execution.process import initialise_worker
from gtf_tune.execution.run_in_child import execute_in_worker
from gtf_tune.execution.stages import FreshStages
from gtf_tune.execution.workers import MainlessContext
from gtf_tune.pipelines.run import RunOutcome, RunRequest

_LOOK_EVERY_S = 0.2


def run_watched(request: RunRequest, limits: RunLimits, folder: Path, show: Callable[[str], None]) -> RunOutcome:
    """Run a pipeline once in a process of its own, without stage cache, and return how the run ended.

    Parameters
    ----------
    request, limits
        The run, and what it may take; its time is not limited.
    folder
        A folder that is empty or does not exist yet; log and workspace of the run stay in it.
    show
        Called with the text that the run and its programs print, soon after they print it.

    Raises
    ------
    MachineError
        The folder cannot be written.
    SequenceError
        An image cannot be read.
    """
    paths = RunPaths(folder)
    paths.create()
    paths.log.touch()
    pool = ProcessPool(max_workers=1, initializer=initialise_worker, context=MainlessContext())
    try:
        future = pool.schedule(execute_in_worker, args=(request, limits, paths, FreshStages()))
        with paths.log.open("r", encoding="utf-8", errors="replace") as log:
            while not future.done():
                _show_new(log, show)
                time.sleep(_LOOK_EVERY_S)
            _show_new(log, show)
        outcome: RunOutcome = future.result()
        return outcome
    finally:
        pool.stop()
        pool.join()


def _show_new(log: IO[str], show: Callable[[str], None]) -> None:
    text = log.read()
    if text:
        show(text)
