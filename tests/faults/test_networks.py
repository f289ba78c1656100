"""Two hosts and one database: a host that is cut off, and comes back when its trial has another owner."""

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest

from tests.faults.conftest import Disturb
from tests.faults.disturbance import wait_until
from tests.faults.servers import RestartableServer

HERE, THERE = "10.213.7.1", "10.213.7.2"


@dataclass(frozen=True)
class OtherHost:
    """A network namespace that is joined to this one by a cable."""

    name: str

    @property
    def cable(self) -> str:
        return f"{self.name}-h"

    def connect(self) -> None:
        ip("link", "set", self.cable, "up")

    def cut(self) -> None:
        ip("link", "set", self.cable, "down")


def ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


@pytest.fixture
def other_host() -> Iterator[OtherHost]:
    if os.geteuid() != 0 or shutil.which("ip") is None:
        pytest.skip("network namespaces need root and the command ip (Debian's iproute2)")
    host = OtherHost(f"gtf{os.getpid()}")
    try:
        ip("netns", "add", host.name)
    except subprocess.CalledProcessError as error:
        pytest.skip(f"network namespaces are not possible here: {error.stderr.decode().strip()}")
    try:
        ip("link", "add", host.cable, "type", "veth", "peer", "name", "far", "netns", host.name)
        ip("addr", "add", f"{HERE}/24", "dev", host.cable)
        ip("-n", host.name, "addr", "add", f"{THERE}/24", "dev", "far")
        ip("-n", host.name, "link", "set", "far", "up")
        host.connect()
        yield host
    finally:
        ip("netns", "del", host.name)


def test_a_host_that_was_cut_off_does_not_overwrite_the_trial_that_another_took_over(
    other_host: OtherHost,
    restartable_server: RestartableServer,
    disturb: Disturb,
    undisturbed: Callable[..., str],
) -> None:
    study = disturb(restartable_server.new_storage(host=HERE))
    study.create()
    # The far worker is slow enough to be in the middle of a run when its cable is pulled.
    far = study.start(pause_s=1.0, namespace=other_host.name, grace_s=2.0)
    wait_until(lambda: len(study.begun()) >= 2)
    other_host.cut()

    near = study.start(pause_s=0.0, grace_s=2.0)
    wait_until(lambda: taken_over(study.storage))
    other_host.connect()
    study.finish([near, far])

    study.check(undisturbed())
    assert taken_over(study.storage)


def taken_over(storage: str) -> bool:
    """Return True if a trial that had a second owner is complete."""
    from gtf_tune.store import studies, trials
    from gtf_tune.store.database import open_database
    from tests.faults.disturbance import NAME

    database = open_database(storage)
    found = trials.of_study(database, studies.get(database, NAME).id)
    database.close()
    return any(trial.attempts > 1 and trial.state == "complete" for trial in found)
