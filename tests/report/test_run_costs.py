from collections.abc import Callable
from dataclasses import replace

import pytest

from gtf_tune.report.panels.costs import OTHER, run_costs, stage_costs, study_cost
from gtf_tune.report.panels.timeline import lane_counts, timeline
from gtf_tune.report.study_data import StudyData, read_study, runs_made
from gtf_tune.store.database import Database
from gtf_tune.store.runs import StoredRun, TrialRun


def run_of(data: StudyData, **changes: object) -> StoredRun:
    return replace(data.runs[0].run, **changes)


def use_of(data: StudyData, number: int, host: str, start_s: float, wall_s: float) -> TrialRun:
    run = run_of(data, id=number, host=host, started_at=1e9 + start_s, wall_s=wall_s)
    return replace(data.runs[0], run=run, reused=False)


def test_a_run_that_serves_two_trials_was_made_once(data: StudyData) -> None:
    first, again = data.runs[0], replace(data.runs[0], number=7, reused=True)

    assert [one.number for one in runs_made([first, again])] == [0]


def test_a_study_counts_what_it_made_and_what_it_reused(data: StudyData) -> None:
    cost = study_cost(data)

    assert (cost.uses, cost.made, cost.reused, cost.failed) == (60, 58, 2, 2)
    assert cost.compute_s == pytest.approx(58 * 2.0)
    assert cost.machines == ("node-a", "node-b")


def test_confirmations_are_counted_apart(
    own_database: Database, confirm_study: Callable[[Database, str], None]
) -> None:
    confirm_study(own_database, "adopt")

    cost = study_cost(read_study(own_database, "synthetic"))

    assert (cost.confirmation_runs, cost.confirmation_s, cost.made) == (3, 6.0, 58)


def test_cached_stages_cost_nothing_and_are_counted(data: StudyData) -> None:
    first = run_of(data, wall_s=10.0, diagnostics={"features_s": 6.0, "features_cached": False, "mapping_s": 3.0})
    second = run_of(data, wall_s=4.0, diagnostics={"features_s": 0.0, "features_cached": True, "mapping_s": 3.5})

    mapping, features, rest = stage_costs([first, second])

    assert (mapping.stage, mapping.total_s, mapping.computed, mapping.cached) == ("mapping", 6.5, 2, 0)
    assert (features.total_s, features.mean_s, features.computed, features.cached) == (6.0, 6.0, 1, 1)
    assert (rest.stage, rest.total_s) == (OTHER, pytest.approx(1.5))
    assert mapping.share + features.share + rest.share == pytest.approx(1)


def test_a_pipeline_without_stages_has_no_stage_costs(data: StudyData) -> None:
    assert stage_costs([run_of(data, diagnostics={"num_points3D": 7})]) == ()


def test_memory_and_time_are_listed_by_kind_of_run(data: StudyData) -> None:
    clean, noisy = run_costs(runs_made(data.runs))

    assert (clean.kind, clean.runs, noisy.kind, noisy.runs) == ("clean", 18, "noisy", 40)
    assert noisy.largest_bytes == 300 * 2**20


def test_runs_that_overlap_on_one_machine_lie_in_different_lanes(data: StudyData) -> None:
    uses = [use_of(data, 1, "a", 0, 10), use_of(data, 2, "a", 5, 10), use_of(data, 3, "a", 11, 1)]

    bars = timeline([*uses, use_of(data, 4, "b", 2, 3)])

    assert [(bar.host, bar.lane, bar.start_s) for bar in bars] == [("a", 0, 0), ("a", 1, 5), ("a", 0, 11), ("b", 0, 2)]
    assert lane_counts(bars) == {"a": 2, "b": 1}


def test_runs_without_a_start_are_not_on_the_timeline(data: StudyData) -> None:
    assert timeline([replace(data.runs[0], run=run_of(data, started_at=0.0))]) == ()
