"""The driver keeps to DROID-SLAM's own interface, tried on a CPU with a stand-in of its module and of torch."""

import json
import math
import shutil
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gtf_tune.errors import DefinitionError, RunError
from gtf_tune.pipelines.droid_slam import DroidSlamPipeline, create
from gtf_tune.pipelines.droid_slam.driver import working_size
from gtf_tune.sequence import Camera, Sequence
from gtf_tune.testing import ContractCase, FolderStages, PipelineContract

# What the driver uses of torch, on numpy arrays.
TORCH = """
import json, os, types
import numpy as np
class Tensor(np.ndarray):
    def permute(self, *axes):
        return self.transpose(axes)
def as_tensor(values):
    array = np.asarray(values)
    return (array.astype(np.float32) if array.dtype == np.float64 else array).view(Tensor)
seeds = []
manual_seed = seeds.append
__version__ = "0.0"
class OutOfMemoryError(RuntimeError):
    pass
cuda = types.SimpleNamespace(
    is_available=lambda: not os.path.exists(os.path.join(os.path.dirname(__file__), "no_cuda")),
    manual_seed_all=seeds.append,
    OutOfMemoryError=OutOfMemoryError,
    max_memory_allocated=lambda: 123,
)
started = []
multiprocessing = types.SimpleNamespace(set_start_method=started.append)
"""

# Upstream's class as the driver sees it: the constructor's arguments, track, terminate, video.counter, frontend.
DROID = """
import json, os, types
import numpy as np
import torch
HERE = os.path.dirname(__file__)
class Droid:
    def __init__(self, args):
        self.args, self.tracked = args, []
        self.video = types.SimpleNamespace(counter=types.SimpleNamespace(value=0))
        self.frontend = types.SimpleNamespace(is_initialized=False)
    def track(self, tstamp, image, depth=None, intrinsics=None):
        assert depth is None and image.shape[0] == 1 and image.shape[2:] == tuple(self.args.image_size)
        if not self.tracked:
            np.savez(os.path.join(HERE, "first.npz"), image=image, intrinsics=intrinsics)
        self.tracked.append(tstamp)
        self.video.counter.value += 1
        self.frontend.is_initialized = self.video.counter.value >= self.args.warmup
    def terminate(self, stream=None):
        filled = [t for t, image, intrinsics in stream]
        with open(os.path.join(HERE, "called.json"), "w") as file:
            json.dump({"args": vars(self.args), "tracked": self.tracked, "filled": filled, "seeds": torch.seeds,
                       "started": torch.started}, file)
        turn = np.sqrt(0.5)
        return np.array([[self.args.beta * t, 2, 3, 0, 0, turn, turn] for t in filled], dtype=np.float32)
"""

APPEND = "self.tracked.append(tstamp)"


def make_checkout(folder: Path, droid: str = DROID) -> Path:
    modules = folder / "droid_slam"
    modules.mkdir(parents=True)
    (modules / "torch.py").write_text(TORCH)
    (modules / "droid.py").write_text(droid)
    (modules / "droid_async.py").write_text("from droid import Droid\nclass DroidAsync(Droid):\n    pass\n")
    (folder / "droid.pth").write_bytes(b"weights")
    return folder


def pipeline_of(checkout: Path) -> DroidSlamPipeline:
    return create({"checkout": str(checkout), "python": sys.executable})


@pytest.fixture(scope="module", autouse=True)
def lock_folder(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tempfile.tempdir", str(tmp_path_factory.mktemp("locks")))
        yield


def run(checkout: Path, sequence: Sequence, folder: Path, **options: Any) -> Any:
    case = ContractCase(pipeline_of(checkout), sequence)
    return case.run(folder / "run", FolderStages(folder / "stages"), {"warmup": 4, **options})


def called(checkout: Path) -> Any:
    return json.loads((checkout / "droid_slam" / "called.json").read_text())


class TestContract(PipelineContract):
    @pytest.fixture(scope="class")
    @classmethod
    def case(cls, scene: Sequence, tmp_path_factory: pytest.TempPathFactory) -> ContractCase:
        return ContractCase(pipeline_of(make_checkout(tmp_path_factory.mktemp("droid"))), scene, {"warmup": 4})


def test_droid_gets_the_arguments_of_its_demo(scene: Sequence, tmp_path: Path) -> None:
    checkout = make_checkout(tmp_path / "droid")

    run(checkout, scene, tmp_path, beta=0.4)

    seen = called(checkout)
    assert seen["args"] == {
        "weights": str(checkout / "droid.pth"),
        "buffer": 512,
        "image_size": [384, 512],
        "disable_vis": True,
        "stereo": False,
        "beta": 0.4,
        "filter_thresh": 2.4,
        "warmup": 4,
        "keyframe_thresh": 4.0,
        "frontend_thresh": 16.0,
        "frontend_window": 25,
        "frontend_radius": 2,
        "frontend_nms": 1,
        "backend_thresh": 22.0,
        "backend_radius": 2,
        "backend_nms": 3,
        "upsample": False,
        "asynchronous": False,
        "frontend_device": "cuda",
        "backend_device": "cuda",
        "motion_damping": 0.0,
    }
    assert (seen["seeds"], seen["started"]) == ([7, 7], ["spawn"])


def test_every_frame_gets_a_pose_whatever_the_stride(scene: Sequence, tmp_path: Path) -> None:
    checkout = make_checkout(tmp_path / "droid")

    output = run(checkout, scene, tmp_path, stride=2, beta=0.5)

    assert called(checkout)["tracked"] == [0, 2, 4, 6, 8]
    assert called(checkout)["filled"] == list(range(9))
    assert output.trajectory.frame_ids.tolist() == [frame.frame_id for frame in scene.frames]
    assert output.trajectory.positions[:, 0].tolist() == [0.5 * index for index in range(9)]
    assert output.trajectory.quaternions[0].tolist() == pytest.approx([0, 0, math.sqrt(0.5), math.sqrt(0.5)])
    assert output.diagnostics["num_keyframes"] == 5


def test_asynchronous_mode_takes_upstreams_other_class(scene: Sequence, tmp_path: Path) -> None:
    checkout = make_checkout(tmp_path / "droid")
    (checkout / "droid_slam" / "droid_async.py").write_text("raise ImportError('asynchronous was asked for')")

    with pytest.raises(RunError, match="asynchronous was asked for"):
        run(checkout, scene, tmp_path, asynchronous=True)


@pytest.mark.parametrize("distorted", [False, True])
def test_images_and_intrinsics_are_prepared_as_in_the_demo(scene: Sequence, tmp_path: Path, distorted: bool) -> None:
    checkout = make_checkout(tmp_path / "droid")
    coefficients = (0.2, -0.1, 0.01, 0.02)
    distortion = Camera("OPENCV", 240, 180, (220.0, 210.0, 120.0, 91.0, *coefficients))
    camera = distortion if distorted else Camera("PINHOLE", 240, 180, (220.0, 210.0, 120.0, 91.0))

    run(checkout, scene.with_camera(camera), tmp_path)

    # demo.py: undistort, resize to about 384 * 512 pixels, crop to multiples of 8, scale the intrinsics alike.
    image = cv2.cvtColor(scene.read_grey(scene.frames[0]), cv2.COLOR_GRAY2BGR)
    if distorted:
        matrix = np.array([[220.0, 0, 119.5], [0, 210.0, 90.5], [0, 0, 1]])
        image = cv2.undistort(image, matrix, np.array([*coefficients, 0, 0, 0, 0]))
    height = int(180 * np.sqrt((384 * 512) / (180 * 240)))
    width = int(240 * np.sqrt((384 * 512) / (180 * 240)))
    image = cv2.resize(image, (width, height))[: height - height % 8, : width - width % 8]
    fed = np.load(checkout / "droid_slam" / "first.npz")
    np.testing.assert_array_equal(fed["image"], image.transpose(2, 0, 1)[None])
    scales = [width / 240, height / 180]
    np.testing.assert_allclose(fed["intrinsics"], np.array([220.0, 210.0, 119.5, 90.5]) * [*scales, *scales], rtol=1e-6)


@pytest.mark.parametrize(
    ("size", "expected"), [((48, 64), (384, 512)), ((70, 100), (370, 529)), ((480, 752), (354, 554))]
)
def test_the_working_size_is_that_of_the_demo(size: tuple[int, int], expected: tuple[int, int]) -> None:
    assert working_size(*size) == expected


@pytest.mark.parametrize(
    ("droid", "options", "reason"),
    [
        (DROID, {"warmup": 20}, "found 9 keyframes, fewer than the 20 it starts with; lower option 'warmup'"),
        ("import nothing_like_this", {}, r"cannot be imported by .*python\S* \(No module named 'nothing_like_this'\)"),
        (
            DROID.replace(APPEND, "raise torch.OutOfMemoryError('tried to allocate 9 GB')"),
            {},
            r"ran out of GPU memory \(tried to allocate 9 GB\); lower option 'buffer'",
        ),
        (
            DROID.replace(APPEND, "raise RuntimeError('CUDA error: misaligned')"),
            {},
            "DROID-SLAM ended with exit code 1; its last words: RuntimeError: CUDA error: misaligned",
        ),
        (DROID.replace(APPEND, "os.abort()"), {}, "DROID-SLAM was ended by SIGABRT"),
        (DROID.replace("beta * t", "beta * t * np.nan"), {}, "NaN"),
        (DROID.replace("for t in filled]", "for t in filled[1:]]"), {}, "gave 8 poses for 9 images"),
        (
            DROID.replace("value += 1", "value += 9"),
            {"buffer": 32},
            "buffer of 32 is too small .* raise option 'buffer'",
        ),
    ],
)
def test_a_failure_is_a_run_with_a_reason(
    scene: Sequence, tmp_path: Path, droid: str, options: dict[str, Any], reason: str
) -> None:
    checkout = make_checkout(tmp_path / "droid", droid)

    with pytest.raises(RunError, match=reason):
        run(checkout, scene, tmp_path, **options)


def test_without_a_gpu_the_run_says_so(scene: Sequence, tmp_path: Path) -> None:
    checkout = make_checkout(tmp_path / "droid")
    (checkout / "droid_slam" / "no_cuda").touch()

    with pytest.raises(RunError, match=r"needs a CUDA device, and torch 0\.0 sees none"):
        run(checkout, scene, tmp_path)


def test_weights_that_vanish_are_missed(scene: Sequence, tmp_path: Path) -> None:
    checkout = make_checkout(tmp_path / "droid")
    case = ContractCase(pipeline_of(checkout), scene, {"warmup": 4})
    (checkout / "droid.pth").unlink()

    with pytest.raises(RunError, match=r"no weights at .*droid\.pth"):
        case.run(tmp_path, FolderStages(tmp_path / "stages"))


def test_unknown_and_foreign_intrinsics_are_refused(scene: Sequence, tmp_path: Path) -> None:
    checkout = make_checkout(tmp_path / "droid")
    fisheye = Camera("OPENCV_FISHEYE", 240, 180, (220.0, 220.0, 120.0, 90.0, 0, 0, 0, 0))

    for number, (camera, told) in enumerate([(None, "they are unknown"), (fisheye, "of the model OPENCV_FISHEYE")]):
        with pytest.raises(RunError, match=told):
            run(checkout, scene.with_camera(camera), tmp_path / str(number))


def test_every_missing_part_is_told_at_once(tmp_path: Path) -> None:
    with pytest.raises(DefinitionError, match=r"no DROID-SLAM at .*no Python at .*no weights at"):
        create({"checkout": str(tmp_path)})
    with pytest.raises(DefinitionError, match="needs the setting 'checkout'"):
        create({})
    with pytest.raises(DefinitionError, match="did you mean 'weights'"):
        create({"checkout": str(tmp_path), "weight": "x"})


def test_the_identity_follows_sources_and_weights_and_not_places(tmp_path: Path) -> None:
    first = pipeline_of(make_checkout(tmp_path / "a"))
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    moved = pipeline_of(tmp_path / "b")
    (tmp_path / "b" / "droid_slam" / "droid.py").write_text(DROID + "# changed\n")
    (tmp_path / "a" / "droid.pth").write_bytes(b"others")

    assert (moved.version, moved.settings) == (first.version, first.settings)
    assert pipeline_of(tmp_path / "b").version != first.version
    assert pipeline_of(tmp_path / "a").settings != first.settings


def test_defaults_are_those_of_the_demo(tmp_path: Path) -> None:
    specs = pipeline_of(make_checkout(tmp_path / "droid")).options.specs

    named = {name: specs[name].default for name in ("beta", "keyframe_thresh", "filter_thresh", "warmup")}
    assert named == {"beta": 0.3, "keyframe_thresh": 4.0, "filter_thresh": 2.4, "warmup": 8}
