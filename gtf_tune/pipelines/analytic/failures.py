"""Fail on purpose, in the ways in which real programs fail."""

import ctypes
import os
import signal
import sys
from collections.abc import Callable, Mapping
from types import MappingProxyType

from gtf_tune.errors import RunError

_MEMORY_BYTES = 4 * 2**30
_CHUNK_BYTES = 64 * 2**20
_FLOOD_LINES = 100_000
_EXIT_CODE = 3


def _refuse() -> None:
    raise RunError("the analytic pipeline was told to fail")


def _break() -> None:
    raise ZeroDivisionError("the analytic pipeline was told to break")


def _exit() -> None:
    os._exit(_EXIT_CODE)


def _crash() -> None:
    ctypes.string_at(0)


def _hang() -> None:
    while True:
        signal.pause()


def _eat_memory() -> None:
    held = [bytearray(b"\1") * _CHUNK_BYTES for _ in range(_MEMORY_BYTES // _CHUNK_BYTES)]
    raise RunError(f"the analytic pipeline could eat {len(held) * _CHUNK_BYTES} bytes without being stopped")


def _flood() -> None:
    for _ in range(_FLOOD_LINES):
        sys.stderr.write("x" * 999 + "\n")
    raise RunError("the analytic pipeline was told to print 100 MB and fail")


FAILURES: Mapping[str, Callable[[], None]] = MappingProxyType(
    {
        "none": lambda: None,
        "error": _refuse,
        "exception": _break,
        "exit": _exit,
        "abort": os.abort,
        "segfault": _crash,
        "hang": _hang,
        "memory": _eat_memory,
        "flood": _flood,
    }
)
"""What each word of the setting ``failure`` does."""
