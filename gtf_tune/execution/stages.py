"""The folders of the stages of runs, without a cache."""

import contextlib
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from gtf_tune.pipelines.base import Stages


class StageStore(Protocol):
    """Open stages for one run; a picklable value that travels to worker processes."""

    def open(self, workspace: Path) -> contextlib.AbstractContextManager[Stages]:
        """Return the stages of one run; what they hand out stays in place until the context ends."""
        ...

    def make_room(self) -> None:
        """Give up what can be built again, because the disk is full."""
        ...


@dataclass(frozen=True)
class FreshStages:
    """Build every stage anew in the run's own workspace: the naive way, and what the cache is checked against."""

    @contextlib.contextmanager
    def open(self, workspace: Path) -> Iterator[Stages]:
        """Yield stages that live in ``workspace``."""
        yield _Fresh(workspace)

    def make_room(self) -> None:
        """Do nothing: nothing is kept."""


@dataclass(frozen=True)
class _Fresh:
    workspace: Path

    def reach(self, stage: str, key: str, build: Callable[[Path], None]) -> Path:
        folder = self.workspace / f"{stage}-{key}"
        if not folder.exists():
            folder.mkdir(parents=True)
            try:
                build(folder)
            except BaseException:
                shutil.rmtree(folder, ignore_errors=True)
                raise
        return folder
