"""SIGKILL at random moments: to the study process, to one of several workers, to the child of a run."""

import random
import signal
import time
from collections.abc import Callable
from contextlib import suppress

import psutil
import pytest

from gtf_tune.store.database import open_database
from tests.faults.conftest import Disturb
from tests.faults.disturbance import Disturbed, is_running, stored, wait_until

LONG = {"search": {"trials": 200}}


def kill_one_at_random(study: Disturbed, chance: random.Random, **plan: object) -> None:
    """Start a worker, let it begin some runs, wait a part of a run, and kill it."""
    process = study.start(**plan)
    target = len(study.begun()) + chance.randint(1, 4)
    wait_until(lambda: len(study.begun()) >= target or not process.is_alive())
    process.join(chance.uniform(0.0, 0.05))
    study.kill(process)


@pytest.mark.parametrize("backend", ["sqlite", "postgresql"])
@pytest.mark.parametrize("sampler", ["tpe"])
def test_a_study_whose_process_is_killed_again_and_again_ends_as_if_undisturbed(
    backend: str, sampler: str, disturb: Disturb, make_storage: Callable[..., str], undisturbed: Callable[..., str]
) -> None:
    study = disturb(make_storage(backend, True))
    study.create(search={"sampler": sampler})

    for kill in range(4):
        kill_one_at_random(study, random.Random(kill))
    study.finish()

    study.check(undisturbed(search={"sampler": sampler}))


def test_the_trial_of_a_killed_worker_is_finished_by_another(
    disturb: Disturb, make_storage: Callable[..., str], undisturbed: Callable[..., str]
) -> None:
    study = disturb(make_storage("postgresql", True))
    study.create()
    survivor = study.start(pause_s=0.1)

    kill_one_at_random(study, random.Random(7), pause_s=0.1)
    study.finish([survivor])

    study.check(undisturbed())


def test_a_run_whose_child_is_killed_is_done_again(
    disturb: Disturb, make_storage: Callable[..., str], undisturbed: Callable[..., str]
) -> None:
    study = disturb(make_storage("sqlite", True))
    study.create()
    worker = study.start(jobs=2, pause_s=0.2)

    for kill in range(2):
        begun = len(study.begun())
        wait_until(lambda begun=begun: len(study.begun()) > begun)
        children = runners(worker.pid)
        if children:
            random.Random(kill).choice(children).send_signal(signal.SIGKILL)
    family = psutil.Process(worker.pid).children(recursive=True)
    study.finish([worker])

    study.check(undisturbed())
    wait_until(lambda: not any(is_running(one) for one in family))


def runners(pid: int | None) -> list[psutil.Process]:
    """Return the processes in which a worker's runs live."""
    found = []
    for child in psutil.Process(pid).children():
        with suppress(psutil.NoSuchProcess):  # it may end this very moment
            if "spawn_main" in " ".join(child.cmdline()):
                found.append(child)
    return found


@pytest.mark.soak
@pytest.mark.parametrize("backend", ["sqlite", "postgresql"])
def test_two_hundred_kills_change_nothing(
    backend: str, disturb: Disturb, make_storage: Callable[..., str], undisturbed: Callable[..., str]
) -> None:
    study = disturb(make_storage(backend, True))
    study.create(**LONG)
    chance = random.Random(0)

    for _ in range(200):
        kill_one_at_random(study, chance)
    study.finish()

    study.check(undisturbed(**LONG))


@pytest.mark.soak
def test_two_hundred_killed_children_change_nothing(
    disturb: Disturb, make_storage: Callable[..., str], undisturbed: Callable[..., str]
) -> None:
    study = disturb(make_storage("sqlite", True))
    study.create(**LONG)
    chance = random.Random(0)
    worker = study.start(jobs=2, pause_s=0.3)
    database = open_database(study.storage)

    for _ in range(200):
        # A run whose child was killed is the next to run. So no run loses three children, which would be its failure.
        target = len(stored(database)) + 2
        wait_until(lambda target=target: len(stored(database)) >= target)
        wait_until(lambda: runners(worker.pid))
        time.sleep(chance.uniform(0.0, 0.3))
        with suppress(psutil.NoSuchProcess):
            chance.choice(runners(worker.pid)).kill()
    database.close()
    study.finish([worker])

    study.check(undisturbed(**LONG))
