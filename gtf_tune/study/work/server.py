"""Work on every open study of a storage: what one of many workers does on one of many machines."""

import random
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from gtf_tune.errors import DeletedError, GtfTuneError, MachineError, StorageError, UnreachableError
from gtf_tune.execution import Executor
from gtf_tune.store import studies
from gtf_tune.store.database import Database
from gtf_tune.store.optuna.tables import LostRecordError
from gtf_tune.store.studies import Study, stored_definition
from gtf_tune.study.events import Callback, Event, TrialStarted, ignore
from gtf_tune.study.open_study import OpenStudy, SequencePlaces, open_study, trials_left
from gtf_tune.study.runs.stop import StopRequest
from gtf_tune.study.work.heartbeat import GRACE_S, INTERVAL_S
from gtf_tune.study.work.worker import StudyWorker

_RETRY_REFUSED_S = 60.0
_FIRST_PAUSE_S = 0.5
_LONGEST_PAUSE_S = 10.0


@dataclass(frozen=True)
class WorkerRules:
    """What a worker works on and when it ends.

    ``names`` are the studies to work on, all where it is empty. ``idle_exit_s`` is how many seconds without work end
    it: 0 as soon as none of its studies has anything left, infinity never. While others work on the last trials of a
    study it is not idle but waits to take over from workers that die. ``beat_s`` and ``grace_s`` are those of
    `StudyWorker`.
    """

    names: tuple[str, ...] = ()
    places: SequencePlaces = field(default_factory=SequencePlaces)
    allow_version_mismatch: bool = False
    trial_parallel: int = 1
    idle_exit_s: float = 0.0
    beat_s: float = INTERVAL_S
    grace_s: float = GRACE_S


@dataclass(frozen=True)
class LeftStudy:
    """Study that this worker leaves to others, and why.

    ``trials`` is how many it still has, ``None`` where only its pipeline, which is not here, would say.
    """

    name: str
    trials: int | None
    reason: str


@dataclass(frozen=True)
class _Refusal:
    record: Study
    reason: str
    until: float


@dataclass(eq=False)
class WorkerLoop:
    """Take up open studies, oldest first, and go on to the next one where no trial is free.

    A study that cannot be worked on here (images missing or different, another version of the pipeline, rows that
    someone deleted) is left to other workers; ``announce`` gets the reason once, in the words of ``describe``, and the
    study is tried again a minute later. ``callback_of`` returns what gets the events of a study that work begins on.
    """

    database: Database
    executor: Executor
    rules: WorkerRules
    stop: StopRequest = field(default_factory=StopRequest)
    announce: Callable[[str], None] = lambda text: None
    callback_of: Callable[[OpenStudy], Callback] = lambda study: ignore
    describe: Callable[[GtfTuneError], str] = str
    _opened: dict[int, OpenStudy] = field(default_factory=dict)
    _refused: dict[int, _Refusal] = field(default_factory=dict)

    def run(self) -> None:
        """Work until idle for long enough or asked to stop.

        Raises
        ------
        StorageError, MachineError
            The database is at fault, or this machine.
        """
        idle_since, pause_s = time.monotonic(), _FIRST_PAUSE_S
        while not self.stop.level:
            open_now = self._open_now()
            worked = [self._work_on(record) for record in open_now if not self.stop.level]
            if any(worked):
                idle_since, pause_s = time.monotonic(), _FIRST_PAUSE_S
                continue
            waits_for_others = any(record.id not in self._refused for record in open_now)
            if not waits_for_others and time.monotonic() - idle_since >= self.rules.idle_exit_s:
                return
            self.stop.wait(pause_s * random.uniform(0.5, 1.0))
            pause_s = min(1.5 * pause_s, _LONGEST_PAUSE_S)

    def left_to_others(self) -> list[LeftStudy]:
        """Return the studies that have trials to do and cannot be worked on here."""
        refused = [record for record in self._open_now() if record.id in self._refused]
        left = [LeftStudy(study.name, self._trials_left(study), self._refused[study.id].reason) for study in refused]
        return [study for study in left if study.trials != 0]

    def _trials_left(self, record: Study) -> int | None:
        try:
            return trials_left(self.database, record)
        except StorageError:
            raise
        except GtfTuneError:
            return None

    def _open_now(self) -> list[Study]:
        found = studies.open_studies(self.database)
        for gone in set(self._opened) - {record.id for record in found}:
            del self._opened[gone]
        return [record for record in found if not self.rules.names or record.name in self.rules.names]

    def _work_on(self, record: Study) -> bool:
        """Work on a study while trials are free, and return whether there was any."""
        refusal = self._refused.get(record.id)
        if refusal is not None and refusal.record == record and time.monotonic() < refusal.until:
            return False
        try:
            return self._work(self._open(record))
        except DeletedError:
            self.announce(f"study '{record.name}' was deleted; its trial in work is dropped")
            self._opened.pop(record.id, None)
            return False
        except LostRecordError:
            self.announce(f"another program renamed or deleted the Optuna study of '{record.name}'; looking for it")
            self._opened.pop(record.id, None)
            return True
        except (MachineError, UnreachableError):
            raise
        except Exception as error:  # whatever is wrong with one study, the others are served
            studies.open_studies(self.database)  # raises where the database itself is at fault
            reason = self.describe(error) if isinstance(error, GtfTuneError) else f"{type(error).__name__}: {error}"
            self._refuse(record, reason)
            return False

    def _work(self, study: OpenStudy) -> bool:
        begun: list[int] = []

        def count(event: Event) -> None:
            if isinstance(event, TrialStarted):
                begun.append(event.number)

        rules, callbacks = self.rules, (count, self.callback_of(study))
        worker = StudyWorker(study, self.executor, self.stop, callbacks, beat_s=rules.beat_s, grace_s=rules.grace_s)
        complete = worker.work_while_free(rules.trial_parallel)
        return complete or bool(begun)

    def _open(self, record: Study) -> OpenStudy:
        """Return a study ready for work; opened again only if its definition changed, since that reads all images."""
        known = self._opened.get(record.id)
        if known is None or known.record != record:
            searched = {sequence.name for sequence in stored_definition(record).searched_sequences}
            stored = studies.sequences(self.database, record.id)
            places = self.rules.places.of([sequence for sequence in stored if sequence.name in searched])
            known = open_study(
                self.database, record.name, places, allow_version_mismatch=self.rules.allow_version_mismatch
            )
            self._opened[record.id] = known
            self._refused.pop(record.id, None)
            self.announce(f"serving study '{record.name}'")
            for change in known.changes:
                self.announce(f"note: {change}")
        return known

    def _refuse(self, record: Study, reason: str) -> None:
        before = self._refused.get(record.id)
        if before is None or before.reason != reason:
            self.announce(f"study '{record.name}' is left to other workers: {reason}")
        self._opened.pop(record.id, None)
        self._refused[record.id] = _Refusal(record, reason, time.monotonic() + _RETRY_REFUSED_S)
