"""Tell the database that this process still works on its trials."""

import threading
from types import TracebackType
from typing import Self

from gtf_tune.errors import StorageError
from gtf_tune.store import slots
from gtf_tune.store.database import Database

INTERVAL_S = 15.0
GRACE_S = 120.0


class Heartbeat:
    """Beat for every slot that this process holds, from a thread of its own.

    A beat that finds the slot taken over marks it as lost; a database that cannot be reached is tried again at the next
    beat, since the workers of the trial will hear of it themselves.
    """

    def __init__(self, database: Database, interval_s: float = INTERVAL_S) -> None:
        self._database = database
        self._interval_s = interval_s
        self._held: dict[str, slots.Slot] = {}
        self._lost: set[str] = set()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._beat_for_ever, name="heartbeat", daemon=True)

    def hold(self, slot: slots.Slot) -> None:
        """Start to beat for a slot."""
        self._held[slot.claim] = slot

    def drop(self, slot: slots.Slot) -> None:
        """Stop to beat for a slot."""
        self._held.pop(slot.claim, None)

    def has_lost(self, slot: slots.Slot) -> bool:
        """Tell whether another worker has taken the slot over."""
        return slot.claim in self._lost

    def __enter__(self) -> Self:
        """Start the thread."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """End the thread."""
        self._end.set()
        self._thread.join()

    def _beat_for_ever(self) -> None:
        while not self._end.wait(self._interval_s):
            for slot in list(self._held.values()):
                try:
                    alive = slots.beat(self._database, slot)
                except StorageError:
                    continue
                if not alive and slot.claim in self._held:
                    self._lost.add(slot.claim)
