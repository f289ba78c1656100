import json
from dataclasses import replace

from gtf_tune.report.panels.failures import run_failures, trial_faults
from gtf_tune.report.panels.reproducibility import provenance
from gtf_tune.report.points import nominal_floor, sequence_detail
from gtf_tune.report.study_data import StudyData
from gtf_tune.study.scoring.objective import CoverageFloor


def test_failed_runs_are_grouped_by_their_reason(data: StudyData) -> None:
    (failure,) = run_failures(data)

    assert failure.reason == "the pipeline crashed its process (SIGABRT)"
    assert (failure.runs, failure.numbers, failure.sequences) == (2, (6,), ("walk",))
    assert failure.example == "noisy run 2 of trial 6 on walk"


def test_the_most_frequent_reason_comes_first(data: StudyData) -> None:
    broken = [
        replace(one, run=replace(one.run, status="failed", error="out of memory")) if one.number == 0 else one
        for one in data.runs
    ]

    failures = run_failures(replace(data, runs=tuple(broken)))

    assert (failures[0].reason, failures[0].runs) == ("out of memory", 6)


def test_trials_without_a_score_and_pairs_without_an_error_are_explained(data: StudyData) -> None:
    faults = trial_faults(data)

    reasons = {(one.what, one.numbers): one.reason for one in faults}
    assert reasons["infeasible trials", (6,)] == "the pipeline crashed its process (SIGABRT)"
    assert reasons["pruned trials", (5,)] == "stopped early: worse than trial 3"
    assert reasons["failed trials", (9,)] == "the database went away"
    assert sum(one.count for one in faults if one.what == "pairs without an error") == 8


def test_a_matrix_has_gaps_where_pairs_failed(data: StudyData) -> None:
    detail = sequence_detail(data, 6, "walk")

    assert detail.matrix.shape == (2, 4)
    assert all(detail.pair_errors[pair] for pair in [(0, 2), (1, 3)])


def test_a_trial_without_matrices_has_empty_ones(data: StudyData) -> None:
    detail = sequence_detail(data, 9, "walk")

    assert detail.matrix.size == 0


def test_the_floors_drawn_are_those_of_the_search_clean_and_noisy_apart(data: StudyData) -> None:
    stored = data.details[0]["sequences"]["walk"]
    lossy = {"sequences": {"walk": {**stored, "coverage_clean": [0.0, 1.0], "coverage_noisy": [0.8, 0.9, 0.9, 0.9]}}}

    assert nominal_floor(data, "walk") == CoverageFloor(0.95, 0.95)
    assert nominal_floor(replace(data, details={0: lossy}), "walk") == CoverageFloor(0.95, 0.95 * 0.8)
    assert nominal_floor(replace(data, details={}), "walk") is None


def test_what_a_study_depends_on_is_complete(data: StudyData) -> None:
    found = provenance(data)

    assert dict(found.versions) == {"analytic": "1", "gtf_tune": "0.1.0"}
    assert json.loads(found.definition)["name"] == "synthetic"
    assert (found.sequences[0].fingerprint, found.sequences[0].sigma) == ("w" * 64, "5.0")
    assert (found.seed, found.threads) == (0, (1,))


def test_sequences_that_were_held_out_are_named_as_such(data: StudyData) -> None:
    held_out = replace(data.sequences[0], name="other")

    roles = {one.name: one.role for one in provenance(replace(data, holdouts=(held_out,))).sequences}

    assert roles == {"walk": "searched", "other": "held out"}


def test_several_versions_of_one_thing_are_all_named(data: StudyData) -> None:
    mixed = replace(data.runs[0], run=replace(data.runs[0].run, versions={"analytic": "2"}))

    assert dict(provenance(replace(data, runs=(mixed,))).versions)["analytic"] == "1, 2"
