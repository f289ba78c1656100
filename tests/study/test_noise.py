from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gtf_tune.definition import GtfDefinition
from gtf_tune.errors import TrajectoryError
from gtf_tune.execution import InlineExecutor, RunLimits
from gtf_tune.pipelines import create_pipeline
from gtf_tune.pipelines.analytic import imaginary_sequence
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.store import studies, trials
from gtf_tune.store.database import Database
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.evaluate import Configuration, evaluate_configuration
from gtf_tune.study.events import Event, NoiseChosen, NoiseStarted
from gtf_tune.study.noise.ladder import DEFAULT_RUNS, LADDER, NoiseProbe, fresh_runs
from gtf_tune.study.open_study import open_study
from gtf_tune.study.outcome.confirm import confirm, plan_confirmation
from gtf_tune.study.runs.run_source import RunSource, SequenceRuns
from gtf_tune.study.runs.stop import StopRequest
from gtf_tune.study.work.worker import StudyWorker
from tests.study.conftest import Runner, definition_of, write_sequence

LIMITS = RunLimits(60, 2**30)
STEADY = {"collapse_rate": 0.0}
AUTO = {"pipeline": {"settings": STEADY}, "gtf": {"noise_sigma": "auto"}, "search": {"trials": 2}}


def test_the_analytic_pipeline_responds_linearly_to_noise() -> None:
    probe = NoiseProbe(create_pipeline("analytic", STEADY), {}, GtfDefinition(), runs=6)

    scale = probe.measure(imaginary_sequence(40), fresh_runs(InlineExecutor(), LIMITS))

    visible = [inside for level, inside in zip(scale.levels, scale.linear, strict=True) if level.sigma >= 1]
    assert all(visible)
    assert scale.score_line.r_squared > 0.99


def test_all_levels_see_the_same_noise_patterns() -> None:
    executor = InlineExecutor()
    probe = NoiseProbe(create_pipeline("analytic"), {}, GtfDefinition(), runs=3, ladder=(1.0, 2.0))

    probe.measure(imaginary_sequence(20), fresh_runs(executor, LIMITS))

    noisy = [run for run in executor.executed if run.kind == "noisy"]
    assert [run.noise_sigma for run in noisy] == [1.0] * 3 + [2.0] * 3
    assert [run.noise_seed for run in noisy[:3]] == [run.noise_seed for run in noisy[3:]]


def test_the_floor_compares_clean_runs_with_other_clean_runs() -> None:
    executor = InlineExecutor()
    probe = NoiseProbe(create_pipeline("analytic", STEADY), {}, GtfDefinition(), runs=3, ladder=(5.0,))

    scale = probe.measure(imaginary_sequence(20), fresh_runs(executor, LIMITS))

    assert [run.index for run in executor.executed if run.kind == "clean"] == [0, 1, 2, 3, 4]
    assert 0 < scale.floor.score < scale.levels[0].score / 3


def test_auto_noise_is_measured_once_and_stored_with_the_study(
    room: Path, database: Database, run_study: Runner
) -> None:
    first = run_study(definition_of(room, **AUTO))
    sigma = studies.get(database, "small").resolved["noise_sigma"]["room"]

    again = run_study({**definition_of(room, **AUTO), "name": "again"})

    assert len(first.executed) > 2 * (2 + 3)
    assert open_study(database, "small").sigmas == {"room": sigma}
    assert again.executed == []
    assert studies.get(database, "again").resolved["noise_sigma"]["room"] == sigma


def test_a_study_climbs_the_ladder_until_the_response_is_no_longer_linear() -> None:
    executor = InlineExecutor()
    fresh = fresh_runs(executor, LIMITS)

    def jumping(requests: Sequence[RunRequest]) -> SequenceRuns:
        """Let noise above 2 grey levels count five times."""
        return fresh(
            [replace(one, noise_sigma=one.noise_sigma * (5 if one.noise_sigma > 2 else 1)) for one in requests]
        )

    probe = NoiseProbe(create_pipeline("analytic", STEADY), {}, GtfDefinition(), runs=6, whole=False)
    sigma, reason = probe.choose(imaginary_sequence(40), jumping)

    assert sigma <= 2
    assert "linear range" in reason
    assert {run.noise_sigma for run in executor.executed if run.kind == "noisy"} == {0.5, 1.0, 2.0, 15.0}


def test_a_study_whose_nominal_setting_fails_takes_the_weakest_noise_and_goes_on(
    room: Path, database: Database, run_study: Runner
) -> None:
    broken = {"failure": "error", "failure_rate": 1.0}

    run_study(definition_of(room, **{**AUTO, "pipeline": {"settings": broken}}))

    assert studies.get(database, "small").resolved["noise_sigma"] == {"room": LADDER[0]}
    assert [one.feasible for one in trials.of_study(database, studies.get(database, "small").id)] == [False, False]


def test_the_choice_of_a_noise_is_told_as_it_goes(room: Path, database: Database) -> None:
    heard: list[tuple[float, int]] = []

    def listen(event: Event) -> None:
        match event:
            case NoiseStarted(_, sigma, planned_runs):
                heard.append((sigma, planned_runs))
            case NoiseChosen(_, sigma):
                heard.append((sigma, -1))

    create_study(database, checked_definition(definition_of(room, **AUTO), "small"), room.parent)
    StudyWorker(open_study(database, "small"), InlineExecutor(), callbacks=[listen]).work()

    assert heard[:3] == [(0.0, 2 + DEFAULT_RUNS), (0.5, DEFAULT_RUNS), (1.0, DEFAULT_RUNS)]
    assert heard[-1] == (open_study(database, "small").sigmas["room"], -1)


def test_a_setting_can_be_scored_alone_with_a_noise_that_is_measured() -> None:
    executor = InlineExecutor()
    gtf = GtfDefinition(clean_runs=1, noisy_runs=3)
    said: list[str] = []

    found = evaluate_configuration(
        Configuration(create_pipeline("analytic", STEADY), {}, gtf), imaginary_sequence(20), executor, said.append
    )

    scored = [run.noise_sigma for run in executor.executed if run.kind == "noisy"][-3:]
    assert found.score.feasible
    (measured,) = (line for line in said if line.startswith("noise of "))
    assert set(scored) == {float(measured.split()[3])}


def test_the_first_stored_noise_decides(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **AUTO))
    study = studies.get(database, "small")

    found = studies.resolve_noise(database, study.id, {"room": 99.0, "other": 1.0})

    assert found == {"room": study.resolved["noise_sigma"]["room"], "other": 1.0}


def test_a_held_out_sequence_gets_its_noise_at_confirmation(
    room: Path, tmp_path: Path, database: Database, run_study: Runner
) -> None:
    other = write_sequence(tmp_path / "other", ground_truth=False, frames=9)
    both = [{"name": "room", "path": str(room)}, {"name": "other", "path": str(other), "holdout": True}]
    grid = {"space": {"filter.max_error": {"values": [0.01, 0.002]}}, "search": {"sampler": "grid"}}
    run_study(definition_of(room, sequences=both, **{**AUTO, **grid}))
    searched = set(studies.get(database, "small").resolved["noise_sigma"])
    study = open_study(database, "small")
    source = RunSource(database, InlineExecutor(), LIMITS, StopRequest())

    confirm(study, plan_confirmation(study, {}, top=1, noisy_runs=4), source)

    assert searched == {"room"}
    assert set(studies.get(database, "small").resolved["noise_sigma"]) == {"room", "other"}


def test_a_first_level_that_breaks_every_run_is_an_error() -> None:
    probe = NoiseProbe(create_pipeline("analytic"), {}, GtfDefinition(), runs=4, ladder=(5.0,))
    fresh = fresh_runs(InlineExecutor(), LIMITS)

    def fragile(requests: Sequence[RunRequest]) -> SequenceRuns:
        found = fresh(requests)
        return replace(found, noisy=tuple(run.select(np.arange(1)) for run in found.noisy))

    with pytest.raises(TrajectoryError, match="no level of noise"):
        probe.measure(imaginary_sequence(12), fragile)


def test_runs_that_fail_without_noise_give_the_error_of_the_first_one() -> None:
    broken = create_pipeline("analytic", {"failure": "error", "failure_rate": 1.0})
    executor = InlineExecutor()
    probe = NoiseProbe(broken, {}, GtfDefinition(), runs=4)

    with pytest.raises(TrajectoryError, match=r"fails without noise already.*the analytic pipeline was told to fail"):
        probe.measure(imaginary_sequence(12), fresh_runs(executor, LIMITS))
    assert all(run.kind == "clean" for run in executor.executed)
