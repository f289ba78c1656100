import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from gtf_tune.errors import MachineError, RunError
from gtf_tune.execution import StageCache
from gtf_tune.execution.stages import FreshStages

ROOT = Path(__file__).parents[2]
BUILD_AND_WAIT = """
import signal, sys
from pathlib import Path
from gtf_tune.execution import StageCache

def build(folder):
    (folder / "half").write_text("written")
    print("building", flush=True)
    signal.pause()

with StageCache(Path(sys.argv[1])).open(Path()) as stages:
    stages.reach("features", "ab" * 32, build)
"""
BUILD_ONCE = """
import sys
from pathlib import Path
from gtf_tune.execution import StageCache

def build(folder):
    with Path(sys.argv[2]).open("a") as note:
        note.write("x")
    (folder / "data").write_bytes(b"7" * 100_000)

sys.stdin.readline()
for number in range(20):
    with StageCache(Path(sys.argv[1])).open(Path()) as stages:
        found = stages.reach("features", f"{number:064x}", build)
        assert (found / "data").read_bytes() == b"7" * 100_000
"""


def key(number: int) -> str:
    return f"{number:064x}"


class Builder:
    """Write one file and count how often."""

    def __init__(self, size: int = 1000) -> None:
        self.size = size
        self.calls = 0

    def __call__(self, folder: Path) -> None:
        self.calls += 1
        (folder / "deep").mkdir()
        (folder / "deep" / "data").write_bytes(bytes(self.calls % 256 for _ in range(self.size)))


def reach(cache: StageCache, number: int, build: Builder) -> bytes:
    with cache.open(Path()) as stages:
        return (stages.reach("features", key(number), build) / "deep" / "data").read_bytes()


@pytest.fixture
def cache(tmp_path: Path) -> StageCache:
    return StageCache(tmp_path / "cache")


def _start(script: str, *arguments: object) -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [sys.executable, "-c", script, *(str(one) for one in arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={"PYTHONPATH": str(ROOT)},
    )


def test_a_stage_is_built_once(cache: StageCache) -> None:
    build = Builder()

    first, second = reach(cache, 1, build), reach(cache, 1, build)

    assert build.calls == 1
    assert first == second


def test_a_stage_that_cannot_be_built_leaves_nothing(cache: StageCache) -> None:
    def build(folder: Path) -> None:
        (folder / "half").write_text("")
        raise ValueError("no features")

    with cache.open(Path()) as stages, pytest.raises(ValueError, match="no features"):
        stages.reach("features", key(1), build)

    assert cache.info().entries == {}
    assert list((cache.folder / "building").iterdir()) == []
    assert reach(cache, 1, Builder())


@pytest.mark.parametrize("damage", ["flipped", "truncated", "missing", "no manifest", "manifest cut", "manifest odd"])
def test_a_damaged_entry_is_dropped_and_built_again(cache: StageCache, damage: str) -> None:
    build = Builder()
    reach(cache, 1, build)
    folder = cache.entry_folder(key(1))
    data, manifest = folder / "files" / "deep" / "data", folder / "manifest.json"
    {
        "flipped": lambda: data.write_bytes(b"\2" * build.size),
        "truncated": lambda: data.write_bytes(b"\1" * (build.size - 1)),
        "missing": data.unlink,
        "no manifest": manifest.unlink,
        "manifest cut": lambda: manifest.write_text(manifest.read_text()[:-9]),
        "manifest odd": lambda: manifest.write_text('["not what was written"]'),
    }[damage]()

    assert reach(cache, 1, build) == b"\2" * build.size
    assert build.calls == 2


def test_entries_and_bytes_are_counted_by_stage(cache: StageCache) -> None:
    with cache.open(Path()) as stages:
        stages.reach("features", key(1), Builder(10))
        stages.reach("features", key(2), Builder(20))
        stages.reach("matches", key(3), Builder(5))

    info = cache.info()

    assert (info.entries, info.bytes) == ({"features": 2, "matches": 1}, {"features": 30, "matches": 5})


def test_the_least_recently_used_entries_go_first(cache: StageCache) -> None:
    for number in range(4):
        reach(cache, number, Builder(100))
    for age, number in enumerate([2, 0, 3, 1]):  # 1 was used last, 2 longest ago
        os.utime(cache.entry_folder(key(number)) / "manifest.json", (1e9 + age, 1e9 + age))

    freed = cache.prune(limit_bytes=200)

    assert freed == 200
    assert [number for number in range(4) if cache.entry_folder(key(number)).exists()] == [1, 3]


def test_reading_an_entry_makes_it_recently_used(cache: StageCache) -> None:
    for number in range(2):
        reach(cache, number, Builder(100))
        os.utime(cache.entry_folder(key(number)) / "manifest.json", (1e9 + number, 1e9 + number))
    reach(cache, 0, Builder(100))

    cache.prune(limit_bytes=100)

    assert cache.entry_folder(key(0)).exists()
    assert not cache.entry_folder(key(1)).exists()


def test_the_limit_is_kept_while_building(tmp_path: Path) -> None:
    cache = StageCache(tmp_path, limit_bytes=250)

    for number in range(6):
        reach(cache, number, Builder(100))

    assert sum(cache.info().bytes.values()) <= 250


def test_entries_that_a_run_uses_are_not_evicted(cache: StageCache) -> None:
    with cache.open(Path()) as stages:
        used = stages.reach("features", key(1), Builder())
        reach(cache, 2, Builder())

        assert cache.clear() == 1000
        assert (used / "deep" / "data").exists()

    assert cache.clear() == 1000
    assert cache.info().entries == {}


def test_what_is_being_built_is_not_taken_for_abandoned_by_another_container(
    cache: StageCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    unseen = 2**31 - 1
    monkeypatch.setattr(os, "getpid", lambda: unseen)  # containers do not see each other's processes

    def build(folder: Path) -> None:
        StageCache(cache.folder).prune()
        (folder / "data").write_text("built")

    with cache.open(Path()) as stages:
        assert (stages.reach("features", key(1), build) / "data").read_text() == "built"


def test_what_a_killed_builder_left_is_removed_with_the_next_entry(cache: StageCache) -> None:
    process = _start(BUILD_AND_WAIT, cache.folder)
    assert process.stdout is not None
    assert process.stdout.readline() == b"building\n"
    process.send_signal(signal.SIGKILL)
    process.communicate()

    reach(cache, 1, Builder())

    assert list((cache.folder / "building").iterdir()) == []


def test_a_run_that_asks_twice_gets_the_same_folder(cache: StageCache) -> None:
    with cache.open(Path()) as stages:
        first = stages.reach("features", key(1), Builder())

        assert stages.reach("features", key(1), Builder()) == first


@pytest.mark.parametrize("kept", [True, False])
def test_a_run_that_asks_again_after_a_failure_builds_again(cache: StageCache, tmp_path: Path, kept: bool) -> None:
    store = cache if kept else FreshStages()

    def fail(folder: Path) -> None:
        (folder / "half").write_text("written")
        raise RunError("no features")

    with store.open(tmp_path) as stages:
        with pytest.raises(RunError, match="no features"):
            stages.reach("features", key(1), fail)

        assert [path.name for path in stages.reach("features", key(1), Builder()).iterdir()] == ["deep"]


def test_threads_wait_for_the_first_one_instead_of_building_again(cache: StageCache) -> None:
    build = Builder()
    found: list[bytes] = []
    threads = [threading.Thread(target=lambda: found.append(reach(cache, 1, build))) for _ in range(8)]

    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert build.calls == 1
    assert len(set(found)) == 1


def test_processes_build_each_stage_once_between_them(cache: StageCache, tmp_path: Path) -> None:
    processes = [_start(BUILD_ONCE, cache.folder, tmp_path / "note") for _ in range(2)]

    for process in processes:
        assert process.stdin is not None
        process.stdin.write(b"go\n")
        process.stdin.flush()
    codes = [process.communicate() and process.returncode for process in processes]

    assert codes == [0, 0]
    assert (tmp_path / "note").read_text() == "x" * 20


def test_a_builder_that_is_killed_blocks_nobody_and_leaves_no_half_entry(cache: StageCache) -> None:
    process = _start(BUILD_AND_WAIT, cache.folder)
    assert process.stdout is not None
    assert process.stdout.readline() == b"building\n"

    process.send_signal(signal.SIGKILL)
    process.communicate()
    build = Builder()
    with cache.open(Path()) as stages:
        found = stages.reach("features", "ab" * 32, build)

        assert [path.name for path in found.iterdir()] == ["deep"]
    assert build.calls == 1
    assert list((cache.folder / "building").iterdir()) == []


def test_a_place_that_cannot_be_written_to_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")

    with (
        StageCache(tmp_path / "file").open(Path()) as stages,
        pytest.raises(MachineError, match="choose another folder for it, or work without it"),
    ):
        stages.reach("features", key(1), Builder())
