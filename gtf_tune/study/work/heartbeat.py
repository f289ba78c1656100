"""Record at regular intervals that this process is alive and works on its trials."""

import threading
from collections.abc import Callable
from typing import Self

from gtf_tune.errors import StorageError
from gtf_tune.store import trial_queue
from gtf_tune.store.database import Database
from gtf_tune.store.trial_queue import TrialLease
from gtf_tune.study.runs.stop import FINISH_RUNS, StopRequest

INTERVAL_S = 15.0
GRACE_S = 120.0
_FAREWELL_S = 5.0


class Heartbeat:
    """Renew every lease that this process holds, from a thread of its own.

    Where another worker has taken a trial over, the trial is asked to stop. A database that cannot be reached is tried
    again at the next beat, since the trial itself will fail on it. Optuna's own heartbeat is not recorded on purpose:
    other Optuna programs fail stale trials that have one, while our next worker goes on with them. ``after_beat`` is
    called between beats, from the thread.
    """

    def __init__(
        self, database: Database, interval_s: float = INTERVAL_S, after_beat: Callable[[], None] = lambda: None
    ) -> None:
        self._database = database
        self._interval_s = interval_s
        self._after_beat = after_beat
        self._held: dict[str, tuple[TrialLease, StopRequest]] = {}
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._beat_until_end, name="heartbeat", daemon=True)

    def hold(self, lease: TrialLease, stop: StopRequest) -> None:
        """Begin to renew a lease; ``stop`` is asked to finish the runs if another worker takes the trial over."""
        self._held[lease.token] = (lease, stop)

    def drop(self, lease: TrialLease) -> None:
        """No longer renew a lease."""
        self._held.pop(lease.token, None)

    @property
    def holds_any(self) -> bool:
        """Whether this process works on a trial."""
        return bool(self._held)

    def __enter__(self) -> Self:
        """Start the thread."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End the thread."""
        self._end.set()
        self._thread.join(_FAREWELL_S)

    def _beat_until_end(self) -> None:
        while not self._end.wait(self._interval_s):
            try:
                self._beat_once()
                self._after_beat()
            except StorageError:
                continue

    def _beat_once(self) -> None:
        for lease, stop in list(self._held.values()):
            if not trial_queue.renew(self._database, lease) and lease.token in self._held:
                stop.ask(FINISH_RUNS)
