"""Tune Structure-from-Motion and visual SLAM without ground truth.

Everything here is imported when it is first used, so that ``import gtf_tune`` takes no time.
"""

from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gtf_tune.api.comparison import check, compare
    from gtf_tune.api.studies import create_study, evaluate, open_study, tune
    from gtf_tune.api.study import Study
    from gtf_tune.api.trajectories import gtf_ate, load_trajectories
    from gtf_tune.errors import GtfTuneError
    from gtf_tune.trajectory.value import Trajectory
    from gtf_tune.version import __version__

__all__ = [
    "GtfTuneError",
    "Study",
    "Trajectory",
    "__version__",
    "check",
    "compare",
    "create_study",
    "evaluate",
    "gtf_ate",
    "load_trajectories",
    "open_study",
    "tune",
]

_MODULES = MappingProxyType(
    {
        "GtfTuneError": "gtf_tune.errors",
        "Study": "gtf_tune.api.study",
        "Trajectory": "gtf_tune.trajectory.value",
        "__version__": "gtf_tune.version",
        "check": "gtf_tune.api.comparison",
        "compare": "gtf_tune.api.comparison",
        "create_study": "gtf_tune.api.studies",
        "evaluate": "gtf_tune.api.studies",
        "gtf_ate": "gtf_tune.api.trajectories",
        "load_trajectories": "gtf_tune.api.trajectories",
        "open_study": "gtf_tune.api.studies",
        "tune": "gtf_tune.api.studies",
    }
)


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module 'gtf_tune' has no attribute '{name}'")
    value: object = getattr(import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
