"""A Python function as a pipeline."""

import pickle
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtf_tune.errors import DefinitionError, RunError
from gtf_tune.execution import InlineExecutor, LocalExecutor
from gtf_tune.pipelines import RunOutcome, create_pipeline
from gtf_tune.pipelines.function import FunctionPipeline, RunImages, from_function
from gtf_tune.sequence import Sequence, load_sequence
from gtf_tune.testing import ContractCase, PipelineContract
from gtf_tune.trajectory import Trajectory, write_kitti, write_tum
from tests.execution.doubles import SEQUENCE, request_of
from tests.execution.executor_contract import LIMITS
from tests.pipelines.slam_functions import NOMINAL, circle
from tests.study.conftest import write_sequence

HERE = "tests.pipelines.slam_functions"
UPRIGHT = np.tile([0.0, 0.0, 0.0, 1.0], (len(SEQUENCE), 1))


def outcome_of(function: Any, sequence: Sequence = SEQUENCE) -> RunOutcome:
    request = replace(request_of(from_function(function, NOMINAL, "1")), sequence=sequence)
    return InlineExecutor().submit(request, LIMITS).result()


class TestFunctionPipeline(PipelineContract):
    @pytest.fixture(scope="class")
    @classmethod
    def case(cls, tmp_path_factory: pytest.TempPathFactory) -> ContractCase:
        folder = write_sequence(tmp_path_factory.mktemp("sequence"), ground_truth=False)
        return ContractCase(from_function(lambda *given: circle(*given), NOMINAL, "1"), load_sequence(folder))


class TestImportedFunction(PipelineContract):
    @pytest.fixture(scope="class")
    @classmethod
    def case(cls, tmp_path_factory: pytest.TempPathFactory) -> ContractCase:
        folder = write_sequence(tmp_path_factory.mktemp("sequence"), ground_truth=False)
        return ContractCase(create_pipeline(f"{HERE}:with_nominal"), load_sequence(folder))


# What a function may return


def test_positions_and_quaternions_have_a_row_for_each_image_and_nan_where_there_is_no_pose() -> None:
    def partly(images: RunImages, options: dict[str, Any], seed: int) -> object:
        positions, quaternions = circle(images, options, seed)
        positions[3] = np.nan
        return positions, quaternions

    found = outcome_of(partly).trajectory

    frames = [frame for frame in SEQUENCE.frames if frame.frame_id != 3]
    assert found.frame_ids.tolist() == [frame.frame_id for frame in frames]
    assert found.timestamps.tolist() == [frame.timestamp for frame in frames]
    assert found.names == tuple(f"{frame.frame_id:06d}.pgm" for frame in frames)


def test_a_file_in_the_workspace_is_matched_by_its_times() -> None:
    def writes(images: RunImages, options: dict[str, Any], seed: int) -> str:
        positions, quaternions = circle(images, options, seed)
        kept = np.arange(len(images)) != 4
        trajectory = Trajectory(images.frame_ids, images.timestamps, positions, quaternions).select(kept)
        write_tum(trajectory, images.workspace / "poses.txt")
        return "poses.txt"

    found = outcome_of(writes).trajectory

    assert found.frame_ids.tolist() == [number for number in range(12) if number != 4]
    assert not found.ids_are_counted


def test_a_model_is_matched_by_the_names_of_its_images() -> None:
    def writes(images: RunImages, options: dict[str, Any], seed: int) -> Path:
        del options, seed
        lines = [f"1 1 0 0 0 {n} {n * n} 0 1 {name}\n\n" for n, name in enumerate(images.names) if n % 2]
        (images.workspace / "images.txt").write_text("".join(lines))
        return images.workspace

    assert outcome_of(writes).trajectory.frame_ids.tolist() == [1, 3, 5, 7, 9, 11]


def test_a_file_without_times_needs_a_pose_of_each_image() -> None:
    def writes(left_out: int) -> Callable[..., object]:
        def run(images: RunImages, options: dict[str, Any], seed: int) -> object:
            positions, quaternions = circle(images, options, seed)
            trajectory = Trajectory(images.frame_ids, images.timestamps, positions, quaternions)
            write_kitti(trajectory.select(np.arange(len(images) - left_out)), images.workspace / "poses.txt")
            return images.workspace / "poses.txt"

        return run

    assert outcome_of(writes(0)).status == "ok"
    assert "poses that are only numbered by their order" in outcome_of(writes(1)).error


def test_a_trajectory_has_the_frame_ids_of_its_images() -> None:
    def returns(images: RunImages, options: dict[str, Any], seed: int) -> Trajectory:
        positions, quaternions = circle(images, options, seed)
        return Trajectory(images.frame_ids, images.timestamps, positions, quaternions).select(np.arange(2, 9))

    assert outcome_of(returns).trajectory.frame_ids.tolist() == list(range(2, 9))


def test_poses_that_were_counted_as_frames_contradict_their_times() -> None:
    def counts(images: RunImages, options: dict[str, Any], seed: int) -> Trajectory:
        positions, quaternions = circle(images, options, seed)
        kept = np.arange(len(images)) != 4
        return Trajectory(np.arange(kept.sum()), images.timestamps[kept], positions[kept], quaternions[kept])

    assert "the pose of frame 4 has the time 0.166666667 s, but its image 0.133333333 s" in outcome_of(counts).error


@pytest.mark.parametrize(
    ("result", "reason"),
    [
        (None, "expected the function to return a Trajectory, positions and quaternions, or the path of a trajectory"),
        ((UPRIGHT[:5, :3], UPRIGHT[:5]), r"expected positions of shape \(12, 3\) and quaternions of shape \(12, 4\)"),
        ("nothing.txt", "nothing.txt"),
        ((np.full((12, 3), np.nan), UPRIGHT), "without poses"),
        (Trajectory(np.array([99]), np.zeros(1), np.zeros((1, 3)), UPRIGHT[:1]), "belong to no image by frame id"),
    ],
)
def test_what_is_no_trajectory_of_the_images_is_a_failed_run_with_the_reason(result: object, reason: str) -> None:
    outcome = outcome_of(lambda *_: result)

    assert outcome.status == "failed"
    with pytest.raises(RunError, match=reason):
        raise RunError(outcome.error)


def test_an_exception_of_the_function_is_a_failed_run() -> None:
    assert outcome_of(lambda *_: 1 / 0).error == "ZeroDivisionError: division by zero"


# What a function is given


def test_images_are_read_and_written_when_they_are_asked_for(tmp_path: Path) -> None:
    sequence = load_sequence(write_sequence(tmp_path, ground_truth=False, frames=6))
    seen: dict[str, Any] = {}

    class Recorder:
        def __call__(self, images: RunImages, options: dict[str, Any], seed: int) -> object:
            seen.update(
                names=images.names,
                files=sorted(path.name for path in images.folder.iterdir()),
                shape=images.arrays[2].shape,
                several=[image.dtype.name for image in images.arrays[1:3]],
                count=len(images.arrays),
                times=images.timestamps.tolist(),
                camera=images.camera,
                is_empty=not [path for path in images.workspace.iterdir() if path.name != "stages"],
                options=options,
                seed=seed,
            )
            return circle(images, options, seed)

    # Not sent to another process, so that what it saw stays at hand.
    pipeline = FunctionPipeline("recorder", "1", {}, NOMINAL, Recorder())
    request = replace(request_of(pipeline, index=7), sequence=sequence, options={"rounds": 5})

    assert InlineExecutor().submit(request, LIMITS).result().status == "ok"
    assert seen["names"] == tuple(seen["files"])
    assert seen["shape"] == (sequence.height, sequence.width)
    assert seen["several"] == ["uint8", "uint8"]
    assert seen["count"] == 6
    assert seen["times"] == [frame.timestamp for frame in sequence.frames]
    assert seen["camera"] == sequence.camera
    assert seen["is_empty"]
    assert seen["options"] == {**NOMINAL, "rounds": 5}
    assert seen["seed"] == 7


def test_options_have_the_names_and_types_of_nominal() -> None:
    table = from_function(circle, {"a": 1, "b": np.float64(0.5), "c": np.int64(2), "d": False, "e": "x"}, "1").options

    assert {name: spec.kind for name, spec in table.specs.items()} == {
        "a": "int",
        "b": "float",
        "c": "int",
        "d": "bool",
        "e": "str",
    }


@pytest.mark.parametrize(
    ("nominal", "reason"),
    [
        ({}, "needs the defaults of its options"),
        (None, "needs the defaults of its options"),
        ({"a": [1]}, r"option 'a' must be true or false, a whole number, a number or a text, not \[1\]"),
        ({"a": float("nan")}, "not nan"),
        ({"a": np.zeros(2)}, "option 'a' must be"),
    ],
)
def test_defaults_are_required_and_are_option_values(nominal: Any, reason: str) -> None:
    with pytest.raises(DefinitionError, match=reason):
        from_function(circle, nominal, "1")


def test_what_cannot_be_pickled_is_refused_at_once() -> None:
    lock = threading.Lock()

    with pytest.raises(DefinitionError, match="cannot be sent to other processes"):
        from_function(lambda *_: lock.locked(), NOMINAL, "1")


# Versions


def test_the_version_is_that_of_the_source() -> None:
    def first(images: RunImages, options: dict[str, Any], seed: int) -> object:
        return circle(images, options, seed)

    def second(images: RunImages, options: dict[str, Any], seed: int) -> object:
        return circle(images, options, seed + 1)

    versions = [from_function(function, NOMINAL).version for function in (first, second, first)]

    assert versions[0] == versions[2] != versions[1]
    assert len(versions[0]) == 64


def test_without_a_source_the_version_is_that_of_the_code() -> None:
    def typed(code: str) -> str:
        scope: dict[str, Any] = {}
        exec(code, scope)
        return from_function(scope["f"], NOMINAL).version

    assert typed("def f(i, o, s): return 1") == typed("def f(i, o, s): return 1")
    assert typed("def f(i, o, s): return 1") != typed("def f(i, o, s): return 2")
    assert typed("def f(i, o, s): return [x for x in i]") != typed("def f(i, o, s): return [x + x for x in i]")


def test_a_given_version_counts_instead() -> None:
    assert from_function(circle, NOMINAL, "7").version == "7"


def test_other_defaults_are_other_runs() -> None:
    keys = {request_of(from_function(circle, {"max_error": value}, "1")).key for value in (0.1, 0.2)}

    assert len(keys) == 2


# Names


def test_a_function_of_a_module_has_the_version_of_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    Path("my_slam_module.py").write_text("def run(images, options, seed): ...\nrun.nominal = {'a': 1}\n")

    pipeline = create_pipeline("my_slam_module:run")
    Path("my_slam_module.py").write_text("def run(images, options, seed): ...\nrun.nominal = {'a': 1}\n# changed\n")

    assert pipeline.name == "my_slam_module:run"
    assert pipeline.options.specs["a"].default == 1
    assert create_pipeline("my_slam_module:run").version != pipeline.version
    assert create_pipeline("my_slam_module:run", {"version": "7"}).version == "7"


def test_settings_give_the_defaults_of_a_function_without_any() -> None:
    pipeline = create_pipeline(f"{HERE}:circle", {"nominal": {"max_error": 0.5}})

    assert pipeline.options.specs["max_error"].default == 0.5


def test_a_factory_gets_the_settings_and_a_pipeline_is_taken_as_it_is() -> None:
    assert create_pipeline(f"{HERE}:factory", {"collapse_rate": 0.5}).settings["collapse_rate"] == "0.5"
    assert create_pipeline(f"{HERE}:PIPELINE").name == "analytic"


@pytest.mark.parametrize(
    ("target", "settings", "reason"),
    [
        ("no_such_module:run", {}, r"'no_such_module:run' cannot be imported \(ModuleNotFoundError"),
        (f"{HERE}:nothing", {}, "AttributeError"),
        (f"{HERE}:NUMBER", {}, "neither a pipeline nor a function, but int"),
        (f"{HERE}:circle", {}, "needs the defaults of its options"),
        (f"{HERE}:wrong_factory", {"a": 1}, "returned dict for its settings, which is no pipeline"),
        (f"{HERE}:with_nominal", {"speed": 1}, r'unknown settings \["speed"\]; it has only nominal and version'),
        (f"{HERE}:PIPELINE", {"speed": 1}, r'unknown settings \["speed"\]; it has none'),
    ],
)
def test_what_is_wrong_with_a_name_is_one_sentence(target: str, settings: dict[str, object], reason: str) -> None:
    with pytest.raises(DefinitionError, match=reason):
        create_pipeline(target, settings)


def test_a_function_of_a_script_is_known_elsewhere_but_cannot_run_there() -> None:
    pipeline = create_pipeline("__main__:my_slam", {"nominal": {"max_error": 0.5}})

    assert pipeline.options.specs["max_error"].default == 0.5
    assert "tunes the Python function 'my_slam' of a script or notebook" in pipeline.unavailable  # type: ignore[attr-defined]
    assert InlineExecutor().submit(request_of(pipeline), LIMITS).result().status == "failed"


@pytest.mark.parametrize("target", ["circle", "factory", "PIPELINE"])
def test_named_pipelines_travel_by_their_names(target: str) -> None:
    settings = {"nominal": NOMINAL} if target == "circle" else {}
    pipeline = create_pipeline(f"{HERE}:{target}", settings)

    with LocalExecutor() as executor:
        outcome = executor.submit(request_of(pipeline), LIMITS).result(60)

    assert outcome.status == "ok", outcome.error
    assert pickle.loads(pickle.dumps(pipeline)).version == pipeline.version


def test_a_process_that_cannot_import_the_pipeline_is_at_fault_not_the_options() -> None:
    class Gone(type(create_pipeline(f"{HERE}:factory"))):  # type: ignore[misc]
        name, version = "gone", "1"

    pipeline = Gone("no_such_module:run", {}, ".")

    with pytest.raises(DefinitionError, match="cannot be imported"):
        InlineExecutor().submit(request_of(pipeline), LIMITS).result()
