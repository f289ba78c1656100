"""One storm of everything: kills, freezes, clocks that jump, a full disk under the cache, a server that restarts."""

import os
import random
import signal
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path

import psutil
import pytest
from sqlalchemy import create_engine, text

from tests.faults.conftest import Disturb
from tests.faults.disks import SmallDisk
from tests.faults.disturbance import Disturbed, clock_beside, is_running, wait_until
from tests.faults.servers import RestartableServer
from tests.faults.test_databases import DROP
from tests.faults.test_storms import middling_disk as middling_disk
from tests.faults.test_storms import nobody_is_left
from tests.faults.test_storms import report as report

pytestmark = pytest.mark.soak

STORM_S = float(os.environ.get("GTF_TUNE_STORM_S", "600"))
TRIALS = int(os.environ.get("GTF_TUNE_STORM_TRIALS", "150"))
STUDY = {"search": {"trials": TRIALS}, "pipeline": {"settings": {"stages": "yes"}}}
GRACE_S = 6.0
_JOBS = (1, 2)


@dataclass
class Storm:
    """Keep workers at a study, one for each of `_JOBS`, and let one fault after the other come over them."""

    study: Disturbed
    server: RestartableServer
    disk: SmallDisk
    chance: random.Random
    faults: Counter[str] = field(default_factory=Counter)
    workers: list[BaseProcess] = field(default_factory=list)
    may_repeat: int = 0

    def keep_at_work(self) -> bool:
        """Start what has ended, as a service manager does, and return whether the study goes on."""
        for place, jobs in enumerate(_JOBS):
            if len(self.workers) <= place:
                self.workers.append(self._start(jobs))
            elif not self.workers[place].is_alive():
                if self.workers[place].exitcode == 0:
                    return False
                self.faults[f"exit code {self.workers[place].exitcode}"] += 1
                self.workers[place] = self._start(jobs)
        return True

    def strike(self) -> None:
        """Let one fault happen, and pass."""
        faults = (self.kill, self.freeze, self.freeze, self.step, self.jump, self.fill, self.drop, self.restart)
        fault = self.chance.choice(faults)
        self.faults[fault.__name__] += 1
        fault()

    def kill(self) -> None:
        """Kill a worker with all that it has started."""
        self.study.kill(self.chance.choice(self.workers))

    def freeze(self) -> None:
        """Stop a worker and all its children, for longer than its heartbeat may be missed or not."""
        family: list[psutil.Process] = []
        with suppress(psutil.NoSuchProcess):
            family = [psutil.Process(self.chance.choice(self.workers).pid)]
            family += family[0].children(recursive=True)
        self._signal(family, signal.SIGSTOP)
        seconds = self.chance.choice([0.5, 3.0, 1.5 * GRACE_S])
        self.may_repeat += max(_JOBS) * (seconds > GRACE_S)
        time.sleep(seconds)
        self._signal(family, signal.SIGCONT)

    def step(self) -> None:
        """Set the clock of workers and runs forward or back, as a time server or an administrator does."""
        clock = clock_beside(self.study.log)
        aside = clock.with_suffix(".new")
        aside.write_text(str(self.chance.choice([900.0, -900.0, 86_400.0, -7.0e8, 0.0])))
        aside.replace(clock)  # at once: others read it all the time

    def jump(self) -> None:
        """Let the database's clock seem to have jumped."""
        engine = create_engine(self.study.storage)
        seconds = self.chance.choice([3600, -3600, 86_400])
        with engine.begin() as connection:
            jump = text("UPDATE gtf_trial SET heartbeat_at = heartbeat_at + :seconds WHERE state = 'claimed'")
            connection.execute(jump, {"seconds": seconds})
        engine.dispose()

    def fill(self) -> None:
        """Leave no room on the disk of the cache and of the files of runs, for some seconds."""
        self.disk.fill()
        time.sleep(self.chance.uniform(0.5, 4.0))
        self.disk.free()

    def drop(self) -> None:
        """Cut all connections to the database."""
        self.server.execute(DROP)

    def restart(self) -> None:
        """Restart the server, with or without a farewell to its clients."""
        self.server.control("restart", "-m", self.chance.choice(["fast", "immediate"]))

    def _start(self, jobs: int) -> BaseProcess:
        cache = self.disk.folder / "cache"
        return self.study.start(jobs=jobs, cache=cache, pause_s=0.2, beat_s=0.5, grace_s=GRACE_S)

    @staticmethod
    def _signal(family: list[psutil.Process], number: signal.Signals) -> None:
        for process in family:
            with suppress(psutil.NoSuchProcess):
                process.send_signal(number)


def test_everything_at_once_changes_nothing(
    restartable_server: RestartableServer,
    middling_disk: SmallDisk,
    disturb: Disturb,
    undisturbed: Callable[..., str],
    report: Callable[..., None],
    tmp_path: Path,
) -> None:
    study = disturb(restartable_server.new_storage())
    study.create(**STUDY)
    storm = Storm(study, restartable_server, middling_disk, random.Random(4))

    end = time.monotonic() + STORM_S
    while storm.keep_at_work() and time.monotonic() < end:
        time.sleep(storm.chance.uniform(0.0, 6.0))
        storm.strike()
    storm.keep_at_work()
    for worker in storm.workers:
        worker.join(600)
    study.finish(pause_s=0.0, jobs=2, cache=tmp_path / "cache")

    report(study, **storm.faults)
    study.check(undisturbed(**STUDY), repeats=storm.may_repeat)
    wait_until(lambda: nobody_is_left(study))
    assert not any(is_running(psutil.Process(worker.pid)) for worker in storm.workers if worker.is_alive())
