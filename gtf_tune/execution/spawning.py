"""Start child processes that do not import the main module of their parent.

multiprocessing imports it in every child, so that what it defines can be unpickled there. A script that does not check
``__name__`` would then start anew in each child. Python functions as pipelines travel by value and do not need it.
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import spawn
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

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
