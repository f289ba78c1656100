"""Keep worker processes at hand, each independent of the others, so that the death of one harms no other."""

import contextlib
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import spawn
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

from pebble import ProcessPool

from gtf_tune.errors import MachineError
from gtf_tune.execution.process import initialise_worker
from gtf_tune.operating_system import interrupts_withheld

_TRIES = 3


class Workers:
    """Lend single worker processes and take them back, so that importing a pipeline is paid once.

    Every process has a pebble pool of its own. Processes of one pool share locks: one that is killed while it holds a
    lock blocks the others for ever, and a pool whose idle process is killed refuses all further work. A pool of one is
    simply replaced. Safe to use from several threads.
    """

    def __init__(self) -> None:
        self._idle: list[ProcessPool] = []
        self._lent: set[ProcessPool] = set()
        self._ending: list[threading.Thread] = []
        self._lock = threading.Lock()

    def take(self) -> ProcessPool:
        """Return a pool of one process for a single run.

        Raises
        ------
        MachineError
            This machine cannot start another process.
        """
        for _ in range(_TRIES):
            pool = self._idle_or_new()
            # A new pool starts its process when it is asked for the first time, which limits of the system may forbid.
            with interrupts_withheld(), contextlib.suppress(OSError, RuntimeError):
                if pool.active:
                    return pool
            self.end(pool)
        raise MachineError(
            "this machine cannot start another process; end other programs or raise its limits (ulimit -u, -n)"
        )

    def give_back(self, pool: ProcessPool) -> None:
        """Keep a pool whose process has ended its run and is still sound."""
        with self._lock:
            self._lent.discard(pool)
            self._idle.append(pool)

    def end(self, pool: ProcessPool) -> None:
        """End a pool and its process, without waiting for it: the pool's own threads call this."""
        thread = threading.Thread(target=_end, args=(pool,), name="end-worker", daemon=True)
        with self._lock:
            if pool not in self._lent:
                return
            self._lent.remove(pool)
            self._ending = [other for other in self._ending if other.is_alive()] + [thread]
        thread.start()

    def close(self) -> None:
        """End every process, also those that are lent, and wait for their end."""
        with self._lock:
            self._lent.update(self._idle)
            self._idle.clear()
        for pool in list(self._lent):
            self.end(pool)
        for thread in list(self._ending):
            thread.join()

    def _idle_or_new(self) -> ProcessPool:
        with self._lock:
            if self._idle:
                pool = self._idle.pop()
            else:
                pool = ProcessPool(max_workers=1, initializer=initialise_worker, context=MainlessContext())
            self._lent.add(pool)
            return pool


def _end(pool: ProcessPool) -> None:
    with contextlib.suppress(OSError, RuntimeError):  # of one that never had a process
        pool.stop()
        pool.join()


_turn = threading.Lock()


class _Process(SpawnProcess):
    @staticmethod
    def _Popen(process_obj: Any) -> Any:
        with _without_main():
            return SpawnProcess._Popen(process_obj)


class MainlessContext(SpawnContext):
    """The start method ``spawn`` without the import of the parent's main module."""

    Process = _Process


@contextmanager
def _without_main() -> Iterator[None]:
    """Leave the main module out of the data by which processes are prepared that this thread starts in this context."""
    thread = threading.get_ident()

    def preparation_data(name: str) -> dict[str, Any]:
        data = original(name)
        if threading.get_ident() != thread:
            return data
        return {key: value for key, value in data.items() if not key.startswith("init_main_")}

    with _turn:
        original = spawn.get_preparation_data
        spawn.get_preparation_data = preparation_data
        try:
            yield
        finally:
            spawn.get_preparation_data = original
