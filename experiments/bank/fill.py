"""Make the runs of the bank that are not stored yet, until the time is up or someone asks to stop."""

import os
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from experiments.bank.pipeline import create
from experiments.bank.plan import CONFIGURATIONS, FIXED, SEQUENCES, BankSequence, Batch, Copy, batches
from gtf_tune.definition import GtfDefinition, LimitsDefinition
from gtf_tune.execution import LocalExecutor, StageCache
from gtf_tune.pipelines import OptionValue
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.sequence import Sequence, load_sequence, render_room
from gtf_tune.store.database import Database, create_database
from gtf_tune.study.runs.plan import RunPlanner, SeedSource
from gtf_tune.study.runs.run_source import Interrupted, RunSource, run_limits
from gtf_tune.study.runs.stop import StopRequest, signals_to

CACHE_BYTES = 30 * 2**30
_PURPOSE = "bank"


@dataclass(frozen=True)
class _Planner(RunPlanner):
    """Planner that checks each configuration once: the bank has thousands of requests for a few of them."""

    checked: dict[tuple[tuple[str, OptionValue], ...], dict[str, OptionValue]] = field(default_factory=dict)

    def effective_options(self, options: Mapping[str, OptionValue]) -> dict[str, OptionValue]:
        key = tuple(sorted(options.items()))
        if key not in self.checked:
            self.checked[key] = super().effective_options(options)
        return self.checked[key]


def _planner() -> _Planner:
    return _Planner(create(), GtfDefinition(), SeedSource(0, _PURPOSE), FIXED)


@dataclass(frozen=True)
class Depot:
    """Folder outside the repository with rendered rooms, the database of runs and the stages of copies."""

    work: Path
    data: Path
    planner: RunPlanner = field(default_factory=_planner)
    loaded: dict[str, Sequence] = field(default_factory=dict)

    def database(self) -> Database:
        self.work.mkdir(parents=True, exist_ok=True)
        return create_database(str(self.work / "bank.db"))

    def sequence(self, wanted: BankSequence) -> Sequence:
        """Return a sequence in its light form, after rendering it where it is a room that is not there yet."""
        if wanted.name not in self.loaded:
            folder = self.data / wanted.name
            if wanted.room is not None:
                folder = self.work / "rooms" / wanted.name
                if not (folder / "groundtruth.txt").exists():
                    render_room(folder, wanted.room, threads=1)
            self.loaded[wanted.name] = load_sequence(folder, wanted.name, selection=wanted.selection)
        return self.loaded[wanted.name]

    def has(self, wanted: BankSequence) -> bool:
        return wanted.room is not None or (self.data / wanted.name / "groundtruth.txt").exists()

    def request(self, sequence: BankSequence, copy: Copy, label: str) -> RunRequest:
        """Return one run of the bank; its noise and seeds are common to all configurations."""
        run, options = (copy.kind, copy.index), CONFIGURATIONS[label]
        return self.planner.request(self.sequence(sequence), options, run, sigma=copy.sigma, number=0)

    def nominal_run(self, sequence: Sequence) -> RunRequest:
        return self.planner.request(sequence, {}, ("clean", 0), sigma=0.0, number=0)


def fill(depot: Depot, minutes: float, say: Callable[[str], None]) -> None:
    """Make runs for so many minutes; those that are stored are not repeated.

    Raises
    ------
    MachineError
        This machine is at fault; the run that failed because of it is not in the bank.
    """
    missing = [sequence.name for sequence in SEQUENCES if not depot.has(sequence)]
    if missing:
        say(f"not in {depot.data}, so left out: {', '.join(missing)}")
    stop, until = StopRequest(), time.monotonic() + 60 * minutes
    cache = StageCache(depot.work / "cache", CACHE_BYTES)
    with signals_to(stop, say), LocalExecutor(1, cache, scratch=depot.work / "scratch") as executor:
        source = RunSource(
            depot.database(), executor, run_limits(LimitsDefinition()), stop, nominal_run=depot.nominal_run
        )
        for batch in batches():
            if time.monotonic() > until or stop.level:
                break
            if depot.has(batch.sequence):
                _fill_batch(depot, source, batch, say)


def _fill_batch(depot: Depot, source: RunSource, batch: Batch, say: Callable[[str], None]) -> None:
    began = time.monotonic()
    try:
        runs = source.obtain([depot.request(batch.sequence, batch.copy, label) for label in batch.labels])
    except Interrupted:
        return
    fresh = [run for run in runs if not run.reused]
    if fresh:
        failed = sum(run.stored.status != "ok" for run in fresh)
        copy = f"{batch.copy.kind} {batch.copy.index} sigma {batch.copy.sigma:g}"
        say(
            f"{time.strftime('%H:%M:%S')} {batch.sequence.name} {copy}: {len(fresh)} runs in "
            f"{time.monotonic() - began:.0f} s, {failed} failed"
        )


def write_line(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def data_folder(given: Path | None) -> Path:
    return (given or Path(os.environ.get("GTF_TUNE_DATA", "."))).absolute()
