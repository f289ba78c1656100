"""Run requests on the workers of a Dask cluster."""

import threading
from collections.abc import Iterable
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass, field
from typing import Any, Self

from gtf_tune.errors import DefinitionError, MachineError
from gtf_tune.execution.attempt import Retries, failure
from gtf_tune.execution.base import RunLimits
from gtf_tune.pipelines.run import RunOutcome, RunRequest

_LOST_TRIES = 3
_CONNECT_TIMEOUT_S = 15
_FAREWELL_S = 5


@dataclass(eq=False)
class _Item:
    """A run that was submitted, from its first task to its outcome."""

    request: RunRequest
    limits: RunLimits
    known_good: RunRequest | None = None
    future: "Future[RunOutcome]" = field(default_factory=Future)
    task: Any = None
    losses: int = 0
    retries: Retries = field(default_factory=Retries)
    failed_on: set[str] = field(default_factory=set)


class DaskExecutor:
    """Send each run to a Dask cluster as one task, which runs it in a child process of the worker.

    Requests and outcomes travel through Dask; no disk is shared. A run whose worker is lost is sent to another one by
    the scheduler. After ``allowed-failures`` losses Dask gives it up, and it is sent anew twice before it counts as
    failed. A run that fails without having said why is sent to a worker on another host, where there is one. A run in
    flight when the executor ends goes on to its end or time limit on its worker; nobody reads its outcome.

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
                f"runs on a Dask cluster need the package '{error.name}'; run pip install 'gtf-tune[dask]'"
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
                f"no Dask scheduler answers at {address}; start one with 'dask scheduler', or correct the address",
                remedy=("executor",),
            ) from error
        self._client.register_plugin(RunHost(keep_stages=keep_stages), name=PLUGIN)

    def submit(
        self, request: RunRequest, limits: RunLimits, known_good: RunRequest | None = None
    ) -> "Future[RunOutcome]":
        """Send a run; the future ends when the run does."""
        item = _Item(request, limits, known_good)
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

        hosts = elsewhere(self._client.nthreads(), item.failed_on) if item.failed_on else None
        # pure=False: equal requests stay separate tasks, so that cancelling one leaves the other alone.
        item.task = self._client.submit(
            run_on_worker,
            item.request,
            item.limits,
            item.known_good,
            self._versions,
            pure=False,
            workers=hosts,
            allow_other_workers=hosts is not None,
        )
        item.task.add_done_callback(lambda done: self._finish(item, done))

    def _cancel(self, items: list[_Item]) -> None:
        for item in items:
            self._items.discard(item)
            item.future.cancel()
        self._client.cancel([item.task for item in items])

    def _finish(self, item: _Item, done: Any) -> None:
        lost = self._is_lost(done)
        with self._lock:
            if item not in self._items:
                return
            item.losses += lost
            if not self._closed and (item.losses < _LOST_TRIES if lost else self._fails_again(item, done)):
                self._send(item)
                return
            self._items.discard(item)
        self._settle(item, done, lost=lost)

    @staticmethod
    def _fails_again(item: _Item, done: Any) -> bool:
        """Note where a run failed, and return whether it is to be tried again."""
        if done.status != "finished":
            return False
        address, outcome = done.result()
        item.failed_on.add(address)
        return item.retries.wanted(outcome)

    def _settle(self, item: _Item, done: Any, *, lost: bool) -> None:
        if lost:
            item.future.set_result(_lost(item))
            return
        try:
            item.future.set_result(item.retries.settled(done.result()[1]))
        except CancelledError:
            item.future.set_exception(MachineError(f"the Dask scheduler at {self._address} is gone; start it again"))
        except Exception as error:  # handed on to whoever asks the future, as every executor does
            item.future.set_exception(error)

    @staticmethod
    def _is_lost(done: Any) -> bool:
        from distributed.scheduler import KilledWorker

        return done.status == "error" and isinstance(done.exception(), KilledWorker)


def elsewhere(workers: Iterable[str], failed_on: Iterable[str]) -> list[str] | None:
    """Return the addresses of workers on hosts where a run has not failed; ``None`` where there are none.

    Addresses look like ``tcp://10.0.0.2:40331``.
    """
    hosts = {_host(address) for address in failed_on}
    return [address for address in workers if _host(address) not in hosts] or None


def _host(address: str) -> str:
    return address.rpartition(":")[0]


def _lost(item: _Item) -> RunOutcome:
    reason = f"the run was lost with its Dask workers {item.losses} times, most likely for want of memory"
    return failure(item.request, reason, "configuration")
