"""Everything at once and for long: kills of study processes, workers and children, and faults of what they stand on."""

import random
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.faults.conftest import Disturb
from tests.faults.disks import SmallDisk, mounted
from tests.faults.disturbance import Disturbed, WorkerPlan, attend, is_running, wait_until, work
from tests.faults.servers import RestartableServer
from tests.faults.test_kills import runners
from tests.faults.test_networks import OtherHost, other_host  # noqa: F401 (a fixture)

pytestmark = pytest.mark.soak

KILLS = 210
LONG = {"search": {"trials": 200}}
PLACES: dict[str, tuple[Callable[[WorkerPlan, str], None], int]] = {
    "study": (attend, 1),
    "worker": (work, 2),
    "second worker": (work, 1),
}
"""What each process of the fleet does, and how many runs it has side by side: each costs a start after every kill."""
_CHILDREN_EACH = 2  # a run whose process was killed three times under one executor counts as failed, and rightly so


@dataclass
class Storm:
    """Keep a study process and two workers at a study, and kill them and their children."""

    study: Disturbed
    chance: random.Random
    plan: dict[str, Any]
    kills: Counter[str] = field(default_factory=Counter)
    at_work: dict[str, BaseProcess] = field(default_factory=dict)
    spared: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for place in PLACES:
            self._start(place)

    def strike(self) -> None:
        """Let the fleet begin some runs, then kill one of it, or one of its children."""
        target = len(self.study.begun()) + self.chance.randint(1, 4)
        wait_until(lambda: len(self.study.begun()) >= target)
        time.sleep(self.chance.uniform(0.0, 0.2))
        place = self.chance.choice(list(PLACES))
        process = self.at_work[place]
        assert process.is_alive(), f"the {place} ended with {process.exitcode} before the storm was over"
        children = runners(process.pid) if self.spared[place] else []
        if children:
            self.chance.choice(children).kill()
            self.spared[place] -= 1
            self.kills["child"] += 1
        else:
            self.study.kill(process)
            self.kills[place.split()[-1]] += 1
            self._start(place)

    def settle(self) -> list[BaseProcess]:
        """Return the processes that are at work now."""
        return list(self.at_work.values())

    def _start(self, place: str) -> None:
        body, jobs = PLACES[place]
        self.at_work[place] = self.study.start(body, jobs=jobs, **self.plan)
        self.spared[place] = _CHILDREN_EACH


@pytest.fixture
def report(capsys: pytest.CaptureFixture[str], request: pytest.FixtureRequest) -> Callable[..., None]:
    """Return a function that prints what a storm did, past pytest's capture."""
    began = time.monotonic()

    def say(study: Disturbed, /, **counts: object) -> None:  # a kind of kill is called "study", too
        begun = study.begun()
        shown = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in counts.items())
        with capsys.disabled():
            print(  # noqa: T201 (whoever soaks wants the figures)
                f"\n{request.node.name}: {shown}; {len(begun)} runs begun, {len(begun) - len(set(begun))} of them "
                f"again after a kill in the middle; {time.monotonic() - began:.0f} s"
            )

    return say


@pytest.fixture
def middling_disk(tmp_path: Path) -> Iterator[SmallDisk]:
    """Yield a disk with room for a study and SQLite's write-ahead log."""
    with mounted(tmp_path / "middling", "32m") as disk:
        yield disk


def nobody_is_left(study: Disturbed) -> bool:
    """Return True if no process that was started for the study, whoever's child it is by now, still lives."""
    mark = str(study.log)
    return not any(mark in environment_of(one).values() and is_running(one) for one in psutil.process_iter())


def environment_of(process: psutil.Process) -> dict[str, str]:
    try:
        return process.environ()
    except (psutil.Error, OSError):
        return {}


@pytest.mark.parametrize("backend", ["sqlite", "postgresql"])
def test_a_storm_of_kills_changes_nothing_and_leaves_nobody_running(
    backend: str,
    disturb: Disturb,
    make_storage: Callable[..., str],
    undisturbed: Callable[..., str],
    report: Callable[..., None],
) -> None:
    study = disturb(make_storage(backend, True))
    study.create(**LONG)
    storm = Storm(study, random.Random(0), {"pause_s": 0.5})

    while storm.kills.total() < KILLS:
        storm.strike()
    survivors = storm.settle()
    study.finish([study.start(pause_s=0.0), *survivors])

    report(study, **storm.kills)
    study.check(undisturbed(**LONG))
    wait_until(lambda: nobody_is_left(study))


def test_a_storm_of_kills_while_the_server_restarts_and_drops_connections_changes_nothing(
    restartable_server: RestartableServer,
    disturb: Disturb,
    undisturbed: Callable[..., str],
    report: Callable[..., None],
) -> None:
    drop = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE application_name = 'gtf-tune'"
    medium = {"search": {"trials": 60}}
    study = disturb(restartable_server.new_storage())
    study.create(**medium)
    storm = Storm(study, random.Random(1), {"pause_s": 0.5})
    faults: Counter[str] = Counter()

    while storm.kills.total() < 60:
        storm.strike()
        if storm.kills.total() % 10 == 5:
            restartable_server.control("restart", "-m", storm.chance.choice(["fast", "immediate"]))
            faults["restarts"] += 1
        else:
            restartable_server.execute(drop)
            faults["drops"] += 1
    study.finish([study.start(pause_s=0.0), *storm.settle()])

    report(study, **storm.kills, **faults)
    study.check(undisturbed(**medium))
    wait_until(lambda: nobody_is_left(study))


def test_a_host_that_is_cut_off_again_and_again_changes_nothing(
    other_host: OtherHost,  # noqa: F811
    restartable_server: RestartableServer,
    disturb: Disturb,
    undisturbed: Callable[..., str],
    report: Callable[..., None],
) -> None:
    medium = {"search": {"trials": 60}}
    study = disturb(restartable_server.new_storage(host="10.213.7.1"))
    study.create(**medium)
    chance = random.Random(2)
    far = study.start(pause_s=0.3, namespace=other_host.name, grace_s=2.0)
    near = study.start(pause_s=0.3, grace_s=2.0)

    cuts = 0
    while near.is_alive() and far.is_alive() and cuts < 10:
        near.join(chance.uniform(0.5, 3.0))
        other_host.cut()
        near.join(chance.uniform(1.0, 6.0))
        other_host.connect()
        cuts += 1
    study.finish([near, far])

    report(study, cuts=cuts)
    study.check(undisturbed(**medium))


def test_a_disk_that_fills_up_again_and_again_changes_nothing(
    middling_disk: SmallDisk, disturb: Disturb, undisturbed: Callable[..., str], report: Callable[..., None]
) -> None:
    medium = {"search": {"trials": 40}}
    study = disturb(f"sqlite:///{middling_disk.folder}/study.db")
    study.create(**medium)
    chance = random.Random(3)

    full = 0
    while full < 10:
        worker = study.start(pause_s=0.02)
        target = len(study.begun()) + chance.randint(1, 10)
        wait_until(lambda target=target: len(study.begun()) >= target)
        middling_disk.fill()
        worker.join(60)
        assert worker.exitcode == 1, "a worker on a full disk must end, and say so"
        middling_disk.free()
        study.witness()
        full += 1
    study.finish(pause_s=0.0)

    report(study, full=full)
    study.check(undisturbed(**medium))
