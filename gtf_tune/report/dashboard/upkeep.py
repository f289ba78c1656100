"""Updates of optuna-dashboard's content while it is served, as workers write none of it."""

import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from gtf_tune.report.dashboard.sync import REFRESH_S, SHARE, DashboardSync
from gtf_tune.store import studies
from gtf_tune.store.database import Database, open_database

_PATIENCE_S = 2.0


class Upkeep:
    """Thread that updates the content of every study that has changed, for the length of a context.

    The newest study comes first. ``warn`` is called with the first fault; nothing here raises.
    """

    def __init__(
        self,
        database: Database,
        *,
        artifacts: Path | None = None,
        warn: Callable[[str], None] = lambda _: None,
        refresh_s: float = REFRESH_S,
    ) -> None:
        self._url = database.url.render_as_string(hide_password=False)
        self._artifacts = artifacts
        self._warn = warn
        self._refresh_s = refresh_s
        self._has_warned = False
        self._due_at: dict[str, float] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._work, name="dashboard upkeep", daemon=True)

    def __enter__(self) -> Self:
        """Start the thread."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """End the thread, or abandon it after two seconds: what it leaves unfinished is written again next time."""
        self._ended.set()
        self._thread.join(_PATIENCE_S)

    def _work(self) -> None:
        database: Database | None = None
        while not self._ended.is_set():
            try:
                # Its own connections: a new Optuna storage changes the listeners of a pool that requests may be using.
                database = database or open_database(self._url)
                for name in reversed(studies.names(database)):
                    if not self._ended.is_set():
                        self._follow(database, name)
            except Exception as error:  # the dashboard goes on with the content it has
                self._warn_once(f"optuna-dashboard's content could not be brought up to date ({error})")
            self._ended.wait(self._refresh_s)
        if database is not None:
            database.close()

    def _follow(self, database: Database, name: str) -> None:
        started = time.monotonic()
        if started < self._due_at.get(name, started):
            return
        sync = DashboardSync(database, name, artifacts=self._artifacts, warn=self._warn_once)
        if not sync.is_current():
            sync.bring_up_to_date()
        ended = time.monotonic()
        self._due_at[name] = ended + (ended - started) / SHARE

    def _warn_once(self, message: str) -> None:
        if not self._has_warned:
            self._has_warned = True
            self._warn(message)
