"""Turn run requests into outcomes: child processes, limits, stage cache, executors."""

from gtf_tune.execution.base import Executor, RunLimits
from gtf_tune.execution.inline import InlineExecutor
from gtf_tune.execution.local import LocalExecutor
from gtf_tune.execution.paths import default_cache_folder, private_cache_folder
from gtf_tune.execution.stage_cache import CacheInfo, StageCache
from gtf_tune.execution.stages import FreshStages, StageStore

__all__ = [
    "CacheInfo",
    "Executor",
    "FreshStages",
    "InlineExecutor",
    "LocalExecutor",
    "RunLimits",
    "StageCache",
    "StageStore",
    "default_cache_folder",
    "private_cache_folder",
]
