from collections.abc import Callable, Sequence
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
from gtf_tune.study.noise.choice import STEPS, choose_noise, fresh_runs
from gtf_tune.study.noise.ladder import NoiseProbe
from gtf_tune.study.open_study import open_study
from gtf_tune.study.outcome.confirm import confirm, plan_confirmation
from gtf_tune.study.runs.plan import RunPlanner, SeedSource
from gtf_tune.study.runs.run_source import RunSource, SequenceRuns, sequence_runs
from gtf_tune.study.runs.stop import StopRequest
from gtf_tune.study.work.worker import StudyWorker
from gtf_tune.trajectory import FloatArray, Trajectory
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


def _planner(noisy_runs: int = 3, clean_runs: int = 2) -> RunPlanner:
    gtf = GtfDefinition(clean_runs=clean_runs, noisy_runs=noisy_runs)
    return RunPlanner(create_pipeline("analytic", STEADY), gtf, SeedSource(0), {})


def _placed(positions: FloatArray) -> Trajectory:
    frames = np.arange(len(positions))
    return Trajectory(frames, frames.astype(float), positions, np.tile([0.0, 0.0, 0.0, 1.0], (len(positions), 1)))


def _responding(clean: float, response: Callable[[float], float]) -> Callable[[Sequence[RunRequest]], SequenceRuns]:
    """Return a way to obtain runs that move by ``clean`` from seed to seed, and by a response to the noise besides."""
    ring = np.linspace(0.0, 2 * np.pi, 20, endpoint=False)
    positions = np.stack([np.cos(ring), np.sin(ring), np.zeros(20)], axis=1)

    def obtain(requests: Sequence[RunRequest]) -> SequenceRuns:
        found = []
        for request in requests:
            size = np.hypot(clean, response(request.noise_sigma) if request.kind == "noisy" else 0.0)
            moved = positions + size * np.random.default_rng(request.seed).normal(size=positions.shape)
            found.append((request.kind, _placed(moved), None))
        return sequence_runs(found, 20)

    return obtain


@pytest.mark.parametrize(
    ("clean", "response", "sigma", "reason"),
    [
        (0.0002, lambda sigma: 0.002 * sigma, 0.5, "the weakest noise that shows"),
        (0.002, lambda sigma: 0.002 * sigma, 2.0, "the weakest noise that shows"),
        (0.0, lambda sigma: 1e-9, 0.5, "the weakest noise that shows"),
        (0.002, lambda sigma: 0.0, 0.5, "no noise shows"),
    ],
)
def test_the_weakest_noise_that_shows_is_chosen(
    clean: float, response: Callable[[float], float], sigma: float, reason: str
) -> None:
    found, why = choose_noise(imaginary_sequence(20), _responding(clean, response), _planner(), {})

    assert (found, why.startswith(reason)) == (sigma, True)


def test_no_louder_noise_is_tried_where_clean_runs_fell_apart() -> None:
    obtain = _responding(0.002, lambda sigma: 0.0)
    asked: list[float] = []

    def one_apart(requests: Sequence[RunRequest]) -> SequenceRuns:
        asked.extend(request.noise_sigma for request in requests if request.kind == "noisy")
        runs = obtain(requests)
        far = _placed(np.random.default_rng(0).normal(size=(20, 3)))
        return replace(runs, clean=(runs.clean[0], far))

    sigma, why = choose_noise(imaginary_sequence(20), one_apart, _planner(), {})

    assert sigma == 0.5
    assert "clean runs differ by more than noisy ones" in why
    assert set(asked) == {0.5}


def test_noise_that_breaks_runs_is_not_chosen() -> None:
    obtain = _responding(0.002, lambda sigma: 0.0)

    def fragile(requests: Sequence[RunRequest]) -> SequenceRuns:
        runs = obtain(requests)
        loud = max(request.noise_sigma for request in requests) > 1
        return replace(runs, noisy=tuple(run.select(np.arange(1)) for run in runs.noisy)) if loud else runs

    assert choose_noise(imaginary_sequence(20), fragile, _planner(), {}) == (1.0, "stronger noise breaks runs")


def test_a_single_clean_run_is_joined_by_another_for_the_floor() -> None:
    executor = InlineExecutor()

    choose_noise(imaginary_sequence(20), fresh_runs(executor, LIMITS), _planner(clean_runs=1), {})

    assert [run.index for run in executor.executed if run.kind == "clean"] == [0, 1]


def test_auto_noise_is_chosen_once_by_runs_of_the_nominal_trial(
    room: Path, database: Database, run_study: Runner
) -> None:
    first = run_study(definition_of(room, **AUTO))
    sigma = studies.get(database, "small").resolved["noise_sigma"]["room"]

    again = run_study({**definition_of(room, **AUTO), "name": "again"})

    assert open_study(database, "small").sigmas == {"room": sigma}
    louder = sum(1 for run in first.executed if run.kind == "noisy" and run.noise_sigma != sigma)
    gtf = open_study(database, "small").definition.gtf
    assert len(first.executed) == 2 * (gtf.clean_runs + gtf.noisy_runs_max) + louder
    assert again.executed == []
    assert studies.get(database, "again").resolved["noise_sigma"]["room"] == sigma


def test_a_study_whose_nominal_setting_fails_takes_the_weakest_noise_and_goes_on(
    room: Path, database: Database, run_study: Runner
) -> None:
    broken = {"failure": "error", "failure_rate": 1.0}

    run_study(definition_of(room, **{**AUTO, "pipeline": {"settings": broken}}))

    assert studies.get(database, "small").resolved["noise_sigma"] == {"room": STEPS[0]}
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

    assert heard[0] == (0.5, 2 + 3)
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
