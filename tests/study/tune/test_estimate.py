"""What is timed before a search, and of which images the models are made."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gtf_tune.definition import StudyDefinition
from gtf_tune.errors import RunError
from gtf_tune.pipelines import create_pipeline
from gtf_tune.sequence import Sequence
from gtf_tune.study.create import checked_definition
from gtf_tune.study.runs.plan import option_costs
from gtf_tune.study.tune import estimate
from gtf_tune.study.tune.budget import REDUCTIONS, Reduction, RunPrice
from gtf_tune.study.tune.estimate import Beginning, Estimate, price_of_stages
from gtf_tune.study.tune.reconstruct import TooSlow
from gtf_tune.trajectory import Trajectory
from tests.pipelines.conftest import make_scene

SEARCHED = "mapper.bundle_adjustment.ceres.loss_function_scale"
STAGES = {"images": 1.0, "features": 10.0, "matches": 20.0, "geometry": 5.0, "mapping": 4.0, "wall": 42.0}


def poses(count: int, stride: int = 1, bend: float = 0.0) -> Trajectory:
    """Return a curve, or another one where it is bent."""
    times = np.arange(0, count * stride, stride, dtype=float)
    positions = np.column_stack([np.cos(times / 9), np.sin(times / 9), bend * np.cos(5 * times)])
    return Trajectory(times.astype(np.int64), times, positions, np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)))


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    return make_scene(tmp_path_factory.mktemp("scene"), frames=24)


@pytest.fixture
def definition(scene: Sequence) -> StudyDefinition:
    given = {"name": "s", "path": str(scene.root)}
    text = {"name": "s", "pipeline": {"name": "glomap"}, "sequences": [given]}
    return checked_definition({**text, "space": {SEARCHED: {"low": 0.1, "high": 1.0}}}, "test")


@pytest.fixture
def made(definition: StudyDefinition, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Estimate]:
    """Return estimates on runs that take a second for each image, and models that take as long as is given."""

    def make(minutes: float, model_s: float, clean: Trajectory | None = None) -> Estimate:
        def timed(_: Any, __: Any, sequence: Sequence, *___: Any) -> tuple[dict[str, float], Trajectory, int]:
            return {"wall": float(len(sequence)), "mapping": 1.0}, clean or poses(len(sequence), 24 // len(sequence)), 1

        def hand_over(_: Path, workshop: Any, *__: Any, **___: Any) -> SimpleNamespace:
            needed = model_s if len(workshop.sequence) == 24 else 1.0
            if needed > workshop.timeout_s:
                raise TooSlow
            model = SimpleNamespace(trajectory=poses(24))
            return SimpleNamespace(nominal=SimpleNamespace(model=model, whole_s=needed, mapping_s=needed / 2))

        monkeypatch.setattr(estimate, "_timed_stages", timed)
        monkeypatch.setattr(estimate, "hand_over", hand_over)
        said: list[str] = []
        means = Beginning(SimpleNamespace(said=said), tmp_path, lambda: 60 * minutes, said.append)  # type: ignore[arg-type]
        return Estimate(definition, create_pipeline("glomap"), tmp_path, means, 60 * minutes)

    return make


def said(found: Estimate) -> str:
    return " ".join(found.means.source.said)  # type: ignore[attr-defined]


def test_reductions_that_leave_the_same_images_are_one(made: Callable[..., Estimate], tmp_path: Path) -> None:
    found = made(minutes=30, model_s=300.0)
    found.definition.sequences[0] = found.definition.sequences[0].model_copy(update={"stride": 2})

    assert [len(found.sequence(reduction)) for reduction in REDUCTIONS] == [12, 12, 12, 12]
    assert found.reductions == (Reduction(),)


def test_models_are_made_of_all_images_where_that_takes_a_small_part_of_the_time(made: Callable[..., Estimate]) -> None:
    given, full = made(minutes=30, model_s=300.0).models()

    assert given["max_image_size"] is None
    assert (full.whole_s, full.repeated_s) == (300.0, 150.0)


@pytest.mark.parametrize(("minutes", "model_s"), [(30, 1200.0), (0.5, 10.0)])
def test_models_are_made_of_reduced_images_where_all_would_take_too_long_or_do(
    made: Callable[..., Estimate], minutes: float, model_s: float
) -> None:
    found = made(minutes, model_s)

    given, full = found.models()

    assert (given["max_image_size"], given["stride"]) == (240, 2)
    assert full.whole_s == 1.0
    assert "take too large a part of the time" in said(found)


def test_reduced_images_on_which_nominal_gives_another_trajectory_are_not_searched_on(
    made: Callable[..., Estimate],
) -> None:
    def misleading(clean: Trajectory | None) -> Estimate | None:
        found = made(30, 300.0, clean)
        found.models()
        assert not found.misleads(Reduction())
        return found if found.misleads(REDUCTIONS[2]) else None

    assert misleading(None) is None
    bent, lost = misleading(poses(12, 2, bend=1.0)), misleading(poses(5))
    assert bent is not None
    assert "12 images of 240x180 pixels are too few or too small: 12 are registered" in said(bent)
    assert lost is not None


def test_reduced_images_on_which_nominal_fails_are_not_searched_on_and_those_of_the_model_are(
    made: Callable[..., Estimate], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = made(30, 1200.0)
    found.models()

    def fail(*_: Any) -> None:
        raise RunError("the nominal options do not work: no model")

    monkeypatch.setattr(estimate, "_timed_stages", fail)

    assert found.of_model == REDUCTIONS[2]
    assert not found.misleads(REDUCTIONS[2])
    assert found.misleads(REDUCTIONS[1])
    assert said(found).endswith("the nominal options do not work: no model")


def test_the_price_of_a_configuration_begins_at_the_first_stage_that_it_changes() -> None:
    repeated = [price_of_stages(STAGES, stage).repeated_s for stage in ("mapping", "geometry", "matches", "features")]

    assert repeated == [6.0, 11.0, 31.0, 41.0]
    assert price_of_stages(STAGES, "mapping").verified_s == 11.0
    assert price_of_stages({"wall": 7.0}, "mapping") == RunPrice(7.0, 7.0, 7.0)


def test_it_is_said_how_much_longer_runs_get_by_an_option_that_repeats_more_than_mapping() -> None:
    stage_of = {"a.b": "mapping", "matching.sift.max_ratio": "matches"}

    assert option_costs(stage_of, STAGES) == ["'matching.sift.max_ratio' repeats matching: runs take 7.2 x as long"]
    assert option_costs(stage_of, {}) == ["'matching.sift.max_ratio' repeats matching"]
