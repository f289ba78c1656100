from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from gtf_tune.errors import StorageError
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.store import runs, trial_queue
from gtf_tune.store.database import Database
from gtf_tune.store.database.columns import Json, Words
from gtf_tune.store.runs import RunTotals, TrialRun, digest_of, trajectories
from gtf_tune.store.studies import Study
from gtf_tune.store.trial_queue import this_worker
from gtf_tune.trajectory import Trajectory, to_bytes

MakeRequest = Callable[..., RunRequest]
MakeOutcome = Callable[..., RunOutcome]


def test_a_saved_run_is_found_again(database: Database, make_request: MakeRequest, make_outcome: MakeOutcome) -> None:
    request = make_request("noisy", 3, noise_sigma=5.0, noise_seed=2**64 - 1, seed=2**31 - 1)
    saved = runs.save(database, request, make_outcome(diagnostics={"points": 7, "error_px": 0.1, "note": "a\0b"}))

    assert runs.find(database, [request.key, "0" * 64]) == {request.key: saved}
    assert (saved.noise_seed, saved.seed, saved.noise_sigma) == (2**64 - 1, 2**31 - 1, 5.0)
    assert saved.diagnostics == {"points": 7, "error_px": 0.1, "note": "a\0b"}
    assert (saved.coverage, saved.peak_memory_bytes) == (0.75, 2**33)
    assert runs.log(database, request.key) == "done"


def test_a_trajectory_comes_back_bit_by_bit(
    database: Database, make_request: MakeRequest, make_outcome: MakeOutcome
) -> None:
    request, outcome = make_request(), make_outcome(num_poses=50)
    runs.save(database, request, outcome)
    found = trajectories(database, [request.key])[request.key]
    np.testing.assert_array_equal(found.positions, outcome.trajectory.positions)
    np.testing.assert_array_equal(found.quaternions, outcome.trajectory.quaternions)


def test_the_first_writer_of_a_run_wins(
    database: Database, make_request: MakeRequest, make_outcome: MakeOutcome
) -> None:
    with ThreadPoolExecutor(6) as pool:
        saved = list(pool.map(lambda seed: runs.save(database, make_request(), make_outcome(seed)), range(6)))
    assert len(set(one.trajectory_digest for one in saved)) == 1
    assert runs.find(database, [make_request().key]) == {saved[0].key: saved[0]}


def test_a_failed_run_is_a_row_with_its_reason(
    database: Database, make_request: MakeRequest, make_outcome: MakeOutcome
) -> None:
    outcome = make_outcome(num_poses=0, status="failed", error="it hung", log="bytes \0 and \ud800 remain")
    saved = runs.save(database, make_request(), outcome)
    assert (saved.status, saved.error, saved.coverage) == ("failed", "it hung", 0.0)
    assert len(trajectories(database, [saved.key])[saved.key]) == 0
    assert runs.log(database, saved.key) == "bytes ? and ? remain"


@pytest.mark.parametrize("damage", [b"nonsense", b""])
def test_a_damaged_trajectory_names_its_run(
    database: Database, make_request: MakeRequest, make_outcome: MakeOutcome, damage: bytes
) -> None:
    saved = runs.save(database, make_request(), make_outcome())
    with database.engine.begin() as connection:
        connection.execute(text("UPDATE gtf_run_output SET trajectory = :damage"), {"damage": damage})
    with pytest.raises(StorageError, match=f"trajectory of run {saved.key} is damaged"):
        trajectories(database, [saved.key])


def test_another_trajectory_in_its_place_is_noticed(
    database: Database, make_request: MakeRequest, make_outcome: MakeOutcome
) -> None:
    first = runs.save(database, make_request("clean", 0), make_outcome(0))
    other = to_bytes(make_outcome(1).trajectory)
    with database.engine.begin() as connection:
        connection.execute(text("UPDATE gtf_run_output SET trajectory = :other"), {"other": other})
    with pytest.raises(StorageError, match=f"run {first.key} is damaged .its digest differs"):
        trajectories(database, [first.key])


def test_linking_again_keeps_who_made_a_run(
    database: Database, study: Study, make_request: MakeRequest, make_outcome: MakeOutcome
) -> None:
    lease = trial_queue.lease_trial(database, study.id, 1, this_worker())
    assert lease is not None
    made = [runs.save(database, make_request(kind, 0), make_outcome()) for kind in ("clean", "noisy")]

    runs.link(database, lease.trial_id, [TrialRun(0, "desk", made[0], reused=False)])
    runs.link(database, lease.trial_id, [TrialRun(0, "desk", one, reused=True) for one in made])

    linked = runs.of_trial(database, lease.trial_id)
    assert linked == runs.of_study(database, study.id)
    assert [(one.number, one.sequence_name, one.run, one.reused) for one in linked] == [
        (0, "desk", made[0], False),
        (0, "desk", made[1], True),
    ]


def test_totals_count_what_a_study_made_and_reused(
    database: Database, study: Study, make_request: MakeRequest, make_outcome: MakeOutcome
) -> None:
    assert runs.totals(database, study.id) == RunTotals(0, 0, 0, 0.0, 0.0)
    lease = trial_queue.lease_trial(database, study.id, 1, this_worker())
    assert lease is not None
    for index, status in enumerate(["ok", "failed", "ok"]):
        saved = runs.save(database, make_request("noisy", index), make_outcome(status=status, wall_s=1.0 + index))
        runs.link(database, lease.trial_id, [TrialRun(0, "desk", saved, reused=index == 2)])
    assert runs.totals(database, study.id) == RunTotals(2, 1, 1, 3.0, 3.0)


@settings(max_examples=50)
@given(st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(), st.lists, max_leaves=5))
def test_json_columns_keep_every_bit(value: object) -> None:
    column = Json()
    stored = column.process_bind_param(value, None)
    assert repr(column.process_result_value(stored, None)) == repr(value)


@given(st.text(alphabet=st.characters(blacklist_categories=[])))
def test_text_columns_accept_any_text(value: str) -> None:
    stored = Words().process_bind_param(value, None)
    assert stored is not None
    assert "\0" not in stored
    assert len(stored.encode()) >= len(value)


def test_equal_trajectories_have_equal_digests_whatever_their_memory_layout(make_outcome: MakeOutcome) -> None:
    one = make_outcome(num_poses=5).trajectory
    positions = np.asfortranarray(one.positions)
    other = Trajectory(one.frame_ids, one.timestamps, positions, one.quaternions)
    assert digest_of(one) == digest_of(other)
    assert digest_of(one) != digest_of(make_outcome(1, num_poses=5).trajectory)
