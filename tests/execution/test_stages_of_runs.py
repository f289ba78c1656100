from pathlib import Path

import pytest

from gtf_tune.execution import FreshStages, InlineExecutor, RunLimits, StageCache, StageStore
from gtf_tune.trajectory import to_bytes
from tests.execution.doubles import Staged, request_of

LIMITS = RunLimits(60.0, 2**30)


def trajectories(stages: StageStore, note: Path, runs: int = 3) -> list[bytes]:
    executor = InlineExecutor(stages)
    outcomes = [executor.submit(request_of(Staged(note), index), LIMITS).result() for index in range(runs)]
    assert {outcome.error for outcome in outcomes} == {""}
    return [to_bytes(outcome.trajectory) for outcome in outcomes]


def test_results_are_the_same_without_a_cache_with_one_and_from_it(tmp_path: Path) -> None:
    cache, note = StageCache(tmp_path / "cache"), tmp_path / "note"

    naive = trajectories(FreshStages(), note)
    filling = trajectories(cache, note)
    built = note.read_text()
    cached = trajectories(cache, note)

    assert naive == filling == cached
    assert note.read_text() == built


@pytest.mark.parametrize("limit_bytes", [0, 7000])
def test_results_are_the_same_while_entries_are_evicted(tmp_path: Path, limit_bytes: int) -> None:
    small = StageCache(tmp_path / "small", limit_bytes)
    note = tmp_path / "note"

    twice = [trajectories(small, note), trajectories(small, note)]

    assert twice == [trajectories(FreshStages(), note)] * 2
    small.prune()
    assert sum(small.info().bytes.values()) <= limit_bytes


def test_results_are_the_same_after_entries_were_damaged(tmp_path: Path) -> None:
    cache, note = StageCache(tmp_path / "cache"), tmp_path / "note"
    before = trajectories(cache, note)
    for path in (cache.folder / "stages").rglob("*.bin"):
        path.write_bytes(b"rubbish")

    assert trajectories(cache, note) == before


def test_runs_of_the_same_images_share_their_first_stage(tmp_path: Path) -> None:
    cache, note = StageCache(tmp_path / "cache"), tmp_path / "note"
    executor = InlineExecutor(cache)
    clean = [request_of(Staged(note), index, sigma=0.0) for index in range(3)]

    for request in clean:
        executor.submit(request, LIMITS).result()

    assert note.read_text().split() == ["first", "second", "second", "second"]
