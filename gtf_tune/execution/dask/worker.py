"""Execute runs inside a worker of a Dask cluster: in child processes with limits, as everywhere else."""

import multiprocessing
import os
import platform
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from distributed import WorkerPlugin, get_worker

from gtf_tune.errors import DefinitionError, SequenceError
from gtf_tune.execution.base import RunLimits
from gtf_tune.execution.local import LocalExecutor
from gtf_tune.execution.paths import private_cache_folder
from gtf_tune.execution.stage_cache import StageCache
from gtf_tune.execution.stages import FreshStages
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.sequence import Sequence

PLUGIN = "gtf-tune-runs"
DATA_ROOT_VARIABLE = "GTF_TUNE_DATA_ROOT"
_DECIDING_PACKAGES = ("gtf-tune", "pycolmap")


class RunHost(WorkerPlugin):  # type: ignore[misc]  # distributed has no types
    """The executor and the sequences of one Dask worker; its number of threads says how many runs go at a time."""

    def __init__(self, *, keep_stages: bool) -> None:
        self._keep_stages = keep_stages
        self._sequences: dict[tuple[str, Path], Sequence] = {}

    def setup(self, worker: Any) -> None:
        """Start the executor; called by Dask when the worker starts or the plug-in is registered."""
        # Dask's nanny starts workers as daemons, to which multiprocessing grants no children: its only use of the flag.
        multiprocessing.current_process()._config["daemon"] = False  # type: ignore[attr-defined]
        folder = private_cache_folder()
        stages = StageCache(folder) if self._keep_stages else FreshStages()
        self._executor = LocalExecutor(worker.state.nthreads, stages, scratch=folder / "scratch", retry_elsewhere=True)

    def teardown(self, worker: Any) -> None:
        """Stop all runs; called by Dask when the worker ends."""
        del worker
        self._executor.__exit__(None, None, None)

    def run(self, request: RunRequest, limits: RunLimits, known_good: RunRequest | None) -> RunOutcome:
        """Execute one run on the images that lie here.

        Raises
        ------
        SequenceError
            The images are missing here, or their pixels differ.
        """
        sequence = request.sequence
        key = sequence.fingerprint, sequence.root
        if key not in self._sequences:
            self._sequences[key] = checked_here(sequence)
        here = self._sequences[key]
        check = replace(known_good, sequence=here) if known_good else None
        return self._executor.submit(replace(request, sequence=here), limits, check).result()


def run_on_worker(
    request: RunRequest, limits: RunLimits, known_good: RunRequest | None, versions: Mapping[str, str]
) -> tuple[str, RunOutcome]:
    """Execute one run where Dask has sent it, and return the address of that worker with the outcome.

    Raises
    ------
    DefinitionError
        A package that results depend on has another version here.
    SequenceError
        The images are missing here, or their pixels differ.
    """
    here = package_versions()
    for package, expected in versions.items():
        if here[package] != expected:
            raise DefinitionError(
                f"the Dask worker on {platform.node()} has {package} {here[package]}, not {expected} as the study; "
                "install the same version there"
            )
    worker = get_worker()
    host: RunHost = worker.plugins[PLUGIN]
    return str(worker.address), host.run(request, limits, known_good)


def package_versions() -> dict[str, str]:
    """Return the versions of the packages that results depend on."""
    return {name: _version_of(name) for name in _DECIDING_PACKAGES}


def checked_here(sequence: Sequence) -> Sequence:
    """Return a sequence of another machine as it lies here: in the same place, or by name below GTF_TUNE_DATA_ROOT.

    Raises
    ------
    SequenceError
        Its images are missing here, or their pixels differ.
    """
    data_root = os.environ.get(DATA_ROOT_VARIABLE)
    # A copy, because the original has brought its fingerprint along.
    here = _moved(sequence, Path(data_root) / sequence.name) if data_root else replace(sequence)
    if here.fingerprint != sequence.fingerprint:
        raise SequenceError(
            f"sequence '{sequence.name}' at {here.root} on {platform.node()} has other pixels than the study's; copy "
            f"them there, or set {DATA_ROOT_VARIABLE} for the Dask workers"
        )
    return here


def _moved(sequence: Sequence, root: Path) -> Sequence:
    """Return a sequence below another root; images outside its own, as lists may name them, stay where they are."""
    paths = [frame.path for frame in sequence.frames]
    moved = [root / path.relative_to(sequence.root) if path.is_relative_to(sequence.root) else path for path in paths]
    frames = tuple(replace(frame, path=path) for frame, path in zip(sequence.frames, moved, strict=True))
    return replace(sequence, root=root, frames=frames)


def _version_of(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"
