"""Run requests in this very process: for tests, examples and debuggers."""

import tempfile
from concurrent.futures import Future
from pathlib import Path
from typing import Self

from gtf_tune.execution.base import RunLimits
from gtf_tune.execution.paths import RunPaths
from gtf_tune.execution.run_in_child import execute
from gtf_tune.execution.stages import FreshStages, StageStore
from gtf_tune.pipelines.run import RunOutcome, RunRequest


class InlineExecutor:
    """Run each request at once where it is submitted, one at a time and without a time limit.

    A pipeline that crashes takes the process with it: use it with pipelines that you trust.
    """

    def __init__(self, stages: StageStore | None = None) -> None:
        self._stages = stages or FreshStages()
        self.executed: list[RunRequest] = []
        """The requests so far, in order."""

    def submit(
        self, request: RunRequest, limits: RunLimits, known_good: RunRequest | None = None
    ) -> "Future[RunOutcome]":
        """Run the request once and return a future that has ended; failures are not looked into."""
        del known_good
        self.executed.append(request)
        future: Future[RunOutcome] = Future()
        with tempfile.TemporaryDirectory(prefix="gtf-tune-") as folder:
            paths = RunPaths(Path(folder))
            paths.create()
            try:
                future.set_result(execute(request, limits, paths, self._stages))
            except Exception as error:  # handed on to whoever asks the future, as every executor does
                future.set_exception(error)
        return future

    def cancel_waiting(self) -> None:
        """Do nothing: no run ever waits."""

    def __enter__(self) -> Self:
        """Return the executor itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing: no process was started."""
