"""Describe the machine that figures come from."""

import os
import platform
import timeit
from importlib.metadata import version
from pathlib import Path

import psutil

from gtf_tune.version import __version__

PACKAGES = ("pycolmap", "optuna", "numpy", "sqlalchemy", "opencv-python-headless")


def describe() -> dict[str, str]:
    """Return the facts that figures depend on, in words."""
    memory = psutil.virtual_memory()
    return {
        "processor": f"{_processor()}, {len(os.sched_getaffinity(0))} cores",
        "memory": f"{memory.total / 2**30:.0f} GiB",
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "versions": ", ".join([f"gtf-tune {__version__}", *(f"{name} {version(name)}" for name in PACKAGES)]),
        "speed": f"{_million_additions_a_second():.0f} million additions a second in Python",
        "load before": f"{os.getloadavg()[0]:.1f} processes wanted to run in the minute before",
    }


def _million_additions_a_second() -> float:
    """Return what a loop in Python reaches at best: a shared machine may run at half of its speed for hours."""
    return 1.0 / min(timeit.repeat("while i < 1_000_000: i += 1", "i = 0", number=1, repeat=5))


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
