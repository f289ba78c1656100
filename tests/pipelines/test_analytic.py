"""The analytic pipeline has a known optimum, realistic noise and every way to fail."""

import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.errors import DefinitionError, RunError
from gtf_tune.metrics import ate
from gtf_tune.pipelines import OptionValue, PipelineJob, PipelineOutput, create_pipeline
from gtf_tune.pipelines.analytic import (
    OPTIMUM,
    AnalyticPipeline,
    expected_error,
    ground_truth,
    imaginary_sequence,
    missing_share,
)
from gtf_tune.sequence import ImageSource
from gtf_tune.testing import ContractCase, FolderStages, PipelineContract

NOWHERE = Path("nowhere")
NO_COLLAPSE = {"collapse_rate": "0"}


class TestAnalyticContract(PipelineContract):
    @pytest.fixture(scope="class")
    @classmethod
    def case(cls) -> ContractCase:
        return ContractCase(create_pipeline("analytic"), imaginary_sequence(20))


def run(
    options: Mapping[str, OptionValue] | None = None,
    *,
    settings: Mapping[str, object] = NO_COLLAPSE,
    sigma: float = 0.0,
    noise_seed: int = 0,
    seed: int = 1,
) -> PipelineOutput:
    images = ImageSource(imaginary_sequence(40), sigma=sigma, seed=noise_seed)
    job = PipelineJob(images, options or {}, seed, 1, NOWHERE, FolderStages(NOWHERE))
    return create_pipeline("analytic", settings).run(job)


def response(options: Mapping[str, OptionValue], instance: int, sigma: float = 5.0) -> float:
    """Return the ATE between a clean run and one noisy instance."""
    noisy = run(options, sigma=sigma, noise_seed=instance, seed=1000 + instance)
    return float(ate(run(options).trajectory, noisy.trajectory))


options_of_all_kinds = st.fixed_dictionaries(
    {
        "filter.max_error": st.floats(1e-6, 1.0),
        "robust.scale": st.floats(1e-4, 1e3),
        "matching.max_ratio": st.floats(0.1, 1.0),
        "tracks.min_length": st.integers(2, 20),
        "robust.kernel": st.sampled_from(["trivial", "huber", "cauchy"]),
        "refine.intrinsics": st.booleans(),
    }
)


@given(options_of_all_kinds)
def test_nothing_beats_the_optimum(options: dict[str, OptionValue]) -> None:
    assert expected_error(options) >= expected_error(OPTIMUM)


def test_sweeping_one_option_does_not_reach_the_optimum() -> None:
    sweep = [expected_error({"filter.max_error": value}) for value in np.geomspace(1e-4, 1e-1, 50)]

    assert min(sweep) > 1.3 * expected_error(OPTIMUM)


def test_the_error_against_ground_truth_is_the_expected_one() -> None:
    truth = ground_truth(range(40))

    errors = {value: ate(run({"filter.max_error": value}).trajectory, truth) for value in (0.002, 0.01, 0.1)}

    for value, error in errors.items():
        assert error == pytest.approx(expected_error({"filter.max_error": value}), rel=0.3)


def test_the_response_to_noise_ranks_settings_like_the_true_error() -> None:
    values = (0.02, 0.002, 0.5, 0.1)

    scores = [np.mean([response({"filter.max_error": value}, one) for one in range(8)]) for value in values]

    expected = [expected_error({"filter.max_error": value}) for value in values]
    assert np.argsort(scores).tolist() == np.argsort(expected).tolist()


def test_the_response_grows_with_the_noise() -> None:
    small, large = (np.mean([response({}, one, sigma) for one in range(6)]) for sigma in (5.0, 20.0))

    assert large / small == pytest.approx(4.0, rel=0.35)


def test_noisy_instances_are_common_to_all_settings() -> None:
    here = np.log([response({}, one) for one in range(20)])
    there = np.log([response({"robust.scale": 0.5}, one) for one in range(20)])

    assert np.corrcoef(here, there)[0, 1] > 0.8
    assert 0.15 < here.std() < 0.6


def test_some_noisy_runs_fall_apart_with_all_their_frames() -> None:
    whole, broken = (run(sigma=5.0, noise_seed=3, settings={"collapse_rate": rate}).trajectory for rate in ("0", "1"))
    truth = ground_truth(range(40))

    assert len(broken) == len(whole) == 40
    assert ate(broken, truth) > 50 * ate(whole, truth)


def test_clean_runs_never_fall_apart() -> None:
    assert ate(run(settings={"collapse_rate": "1"}).trajectory, ground_truth(range(40))) < 0.01


def test_strict_settings_lose_frames() -> None:
    strict = {"filter.max_error": 5e-5}

    assert missing_share({}) == 0
    assert len(run(strict).trajectory) == pytest.approx(40 * (1 - missing_share(strict)), abs=8)


def test_seeds_matter_and_nothing_else_does() -> None:
    first, again, other = run(seed=1), run(seed=1), run(seed=2)

    assert np.array_equal(first.trajectory.positions, again.trajectory.positions)
    assert not np.array_equal(first.trajectory.positions, other.trajectory.positions)


def test_ground_truth_depends_on_frame_ids_alone() -> None:
    few, many = ground_truth([3, 8]), ground_truth(range(10))

    assert np.allclose(few.positions, many.positions[[3, 8]])
    assert np.allclose(few.quaternions, many.quaternions[[3, 8]])


def test_cameras_look_at_the_scene() -> None:
    truth = ground_truth(range(40))

    ahead = truth.rotations.apply([0.0, 0.0, 1.0])

    toward = -truth.positions / np.linalg.norm(truth.positions, axis=1, keepdims=True)
    assert np.allclose(ahead, toward)


def test_imaginary_sequences_need_no_disk() -> None:
    sequence = imaginary_sequence(5)

    assert len(sequence) == 5
    assert sequence.read_grey(sequence.frames[0]).shape == (48, 64)
    assert sequence.fingerprint == imaginary_sequence(5).fingerprint != imaginary_sequence(6).fingerprint


def test_a_run_can_be_told_to_fail() -> None:
    with pytest.raises(RunError, match="told to fail"):
        run(settings={"failure": "error"})
    with pytest.raises(ZeroDivisionError):
        run(settings={"failure": "exception"})


def test_a_share_of_the_runs_can_fail() -> None:
    settings = {"failure": "error", "failure_rate": 0.5}

    failed = 0
    for seed in range(100):
        try:
            run(settings=settings, seed=seed)
        except RunError:
            failed += 1

    assert 30 < failed < 70


@pytest.mark.parametrize(("failure", "code"), [("exit", 3), ("abort", -6), ("segfault", -11)])
def test_a_run_can_take_its_process_with_it(failure: str, code: int) -> None:
    script = f"from gtf_tune.pipelines.analytic.failures import FAILURES; FAILURES['{failure}']()"

    done = subprocess.run([sys.executable, "-c", script], check=False, capture_output=True)

    assert done.returncode == code


def test_a_run_without_frames_is_a_failure() -> None:
    images = ImageSource(replace(imaginary_sequence(2)))
    job = PipelineJob(
        images, {"filter.max_error": 1e-6, "matching.max_ratio": 0.1}, 1, 1, NOWHERE, FolderStages(NOWHERE)
    )

    outcomes = []
    for seed in range(20):
        try:
            outcomes.append(len(create_pipeline("analytic").run(replace(job, seed=seed)).trajectory))
        except RunError as error:
            outcomes.append(str(error))

    assert any("registered no frame" in str(one) for one in outcomes)


@pytest.mark.parametrize(
    ("setting", "value"), [("failure", "explode"), ("failure_rate", "often"), ("collapse_rate", 2)]
)
def test_wrong_settings_are_refused(setting: str, value: object) -> None:
    with pytest.raises(DefinitionError, match=f"setting '{setting}' must"):
        create_pipeline("analytic", {setting: value})


def test_the_factory_makes_an_analytic_pipeline() -> None:
    assert isinstance(create_pipeline("analytic"), AnalyticPipeline)
