"""The disk of the stage cache fills up while a study runs: programs report it in their own ways, and none may count."""

from collections.abc import Callable

import pytest

from gtf_tune.execution import LocalExecutor, RunLimits, StageCache
from tests.execution.doubles import FillsItsDisk, request_of
from tests.faults.conftest import Disturb
from tests.faults.disks import SmallDisk

LIMITS = RunLimits(timeout_s=60.0, memory_bytes=2**30)
WAIT_S = 60.0
STAGED = {"pipeline": {"name": "counted", "settings": {"stages": "yes"}}}


@pytest.mark.parametrize("how", ["words", "exception", "abort"])
def test_a_run_that_fails_on_a_full_disk_says_nothing_about_its_configuration(small_disk: SmallDisk, how: str) -> None:
    folder = small_disk.folder
    with LocalExecutor(1, StageCache(folder), scratch=folder / "scratch") as executor:
        outcome = executor.submit(request_of(FillsItsDisk(folder / "note", how=how)), LIMITS).result(WAIT_S)

    assert (outcome.status, outcome.cause) == ("failed", "machine")
    assert f"the disk of {folder}" in outcome.error
    assert "make room or choose another folder for the cache" in outcome.error


def test_what_the_cache_can_build_again_makes_room(small_disk: SmallDisk) -> None:
    folder = small_disk.folder
    cache = StageCache(folder)
    cache.build("old", "ab" * 32, lambda entry: (entry / "file").write_bytes(b"x" * 3 * 2**20) and None)
    with LocalExecutor(1, cache, scratch=folder / "scratch") as executor:
        pipeline = FillsItsDisk(folder / "note", how="words", size=2 * 2**20)
        outcome = executor.submit(request_of(pipeline), LIMITS).result(WAIT_S)

    assert (outcome.status, outcome.attempts) == ("ok", 2)


def test_a_study_on_a_full_disk_stops_and_ends_as_if_undisturbed_once_there_is_room(
    disturb: Disturb, make_storage: Callable[..., str], undisturbed: Callable[..., str], small_disk: SmallDisk
) -> None:
    study = disturb(make_storage("sqlite", True))
    study.create(**STAGED)
    small_disk.fill()

    worker = study.start(jobs=1, cache=small_disk.folder)
    worker.join(WAIT_S)
    small_disk.free()
    study.finish(jobs=1, cache=small_disk.folder)

    assert worker.exitcode == 1
    study.check(undisturbed(**STAGED))
