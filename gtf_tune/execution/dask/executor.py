"""Run requests on the workers of a Dask cluster."""

import threading
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass, field
from typing import Any, Self

from gtf_tune.errors import DefinitionError, StorageError
from gtf_tune.execution.base import RunLimits
from gtf_tune.execution.run_in_child import versions_of
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.trajectory import Trajectory

_LOST_TRIES = 3
_CONNECT_TIMEOUT_S = 15
_FAREWELL_S = 5


@dataclass(eq=False)
class _Item:
    request: RunRequest
    limits: RunLimits
    future: "Future[RunOutcome]" = field(default_factory=Future)
    task: Any = None
    tries: int = 0


class DaskExecutor:
    """Send each run to a Dask cluster as one task, which runs it in a child process of the worker.

    Requests and outcomes travel through Dask; no disk is shared. A run whose worker is lost is sent to another one by
    the scheduler. After ``allowed-failures`` losses Dask gives it up, and it is sent anew twice before it counts as
    failed. A run in flight when the executor ends goes on to its end or time limit on its worker, unheeded.

    Parameters
    ----------
    address
        Of the scheduler, as ``tcp://HOST:PORT``.
    keep_stages
        Whether Dask workers keep stages in the stage cache of their machine.

    Raises
    ------
    DefinitionError
        Dask is not installed, or no scheduler answers.
    """

    def __init__(self, address: str, *, keep_stages: bool = True) -> None:
        try:
            from distributed import Client
        except ModuleNotFoundError as error:
            raise DefinitionError(
                f"--executor dask:// needs the package '{error.name}'; run pip install 'gtf-tune[dask]'"
            ) from error
        from gtf_tune.execution.dask.worker import PLUGIN, RunHost, package_versions

        self._address = address
        self._versions = package_versions()
        self._items: set[_Item] = set()
        self._lock = threading.RLock()
        self._closed = False
        try:
            self._client = Client(address, timeout=_CONNECT_TIMEOUT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise DefinitionError(
                f"no Dask scheduler answers at {address}; start one with 'dask scheduler', or mend --executor"
            ) from error
        self._client.register_plugin(RunHost(keep_stages=keep_stages), name=PLUGIN)

    def submit(self, request: RunRequest, limits: RunLimits) -> "Future[RunOutcome]":
        """Send a run; the future ends when the run does."""
        item = _Item(request, limits)
        with self._lock:
            self._items.add(item)
            self._send(item)
        return item.future

    def cancel_waiting(self) -> None:
        """Cancel every run that no Dask worker has been given yet."""
        given = {str(key) for keys in self._client.processing().values() for key in keys}
        with self._lock:
            self._cancel([item for item in self._items if item.task.key not in given])

    def __enter__(self) -> Self:
        """Return the executor itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Forget all runs and leave the cluster; it does not belong to the executor."""
        with self._lock:
            self._closed = True
            self._cancel(list(self._items))
        self._client.close(timeout=_FAREWELL_S)

    def _send(self, item: _Item) -> None:
        from gtf_tune.execution.dask.worker import run_on_worker

        item.tries += 1
        # pure=False: equal requests stay separate tasks, so that cancelling one leaves the other alone.
        item.task = self._client.submit(run_on_worker, item.request, item.limits, self._versions, pure=False)
        item.task.add_done_callback(lambda done: self._finish(item, done))

    def _cancel(self, items: list[_Item]) -> None:
        for item in items:
            self._items.discard(item)
            item.future.cancel()
        self._client.cancel([item.task for item in items])

    def _finish(self, item: _Item, done: Any) -> None:
        with self._lock:
            if item not in self._items:
                return
            if self._is_lost(done) and item.tries < _LOST_TRIES and not self._closed:
                self._send(item)
                return
            self._items.discard(item)
        self._settle(item, done)

    def _settle(self, item: _Item, done: Any) -> None:
        if self._is_lost(done):
            item.future.set_result(_lost(item))
            return
        try:
            item.future.set_result(done.result())
        except CancelledError:
            item.future.set_exception(
                StorageError(f"the Dask scheduler at {self._address} is gone; start it again, then resume the study")
            )
        except Exception as error:  # handed on to whoever asks the future, as every executor does
            item.future.set_exception(error)

    @staticmethod
    def _is_lost(done: Any) -> bool:
        from distributed.scheduler import KilledWorker

        return done.status == "error" and isinstance(done.exception(), KilledWorker)


def _lost(item: _Item) -> RunOutcome:
    return RunOutcome(
        status="failed",
        trajectory=Trajectory.empty(),
        error=f"the run was lost with its Dask workers {item.tries} times, most likely for want of memory",
        versions=versions_of(item.request),
    )
