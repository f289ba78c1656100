"""Programs that want the folder of a data set get one with its images replaced."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gtf_tune.errors import DefinitionError, RunError
from gtf_tune.pipelines.base import PipelineJob
from gtf_tune.pipelines.command import CommandPipeline, create
from gtf_tune.pipelines.command.inputs import prepare
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.sequence import ImageSource, Selection, Sequence, load_sequence
from gtf_tune.testing import FolderStages

FRAMES, SIGMA = 3, 5.0
GREY = np.full((48, 64), 100, np.uint8)
DEPTH = np.full((48, 64), 5000, np.uint16)


@pytest.fixture
def data_set(tmp_path: Path) -> Path:
    """Return the folder of an RGB-D recording in TUM's layout, with a second camera and an IMU's file."""
    root = tmp_path / "recording"
    for folder, pixels in (("rgb", GREY), ("right", GREY), ("depth", DEPTH)):
        (root / folder).mkdir(parents=True)
        for number in range(FRAMES):
            cv2.imwrite(str(root / folder / f"{number}.png"), pixels)
    (root / "rgb.txt").write_text("".join(f"{number}.0 rgb/{number}.png\n" for number in range(FRAMES)))
    (root / "calibration.txt").write_text("50 50 32 24\n")
    (root / "imu.csv").write_text("0,0,0\n")
    return root


def pipeline(**sequence_files: list[str]) -> CommandPipeline:
    files = [{"path": "sequence/rgb.txt", "each_frame": "{timestamp_s:.1f} {index}"}]
    words: dict[str, Any] = {"arguments": ["python3", "{sequence}"], "files": files, "sequence_files": sequence_files}
    return create(words)


def prepared(made: CommandPipeline, sequence: Sequence, folder: Path, sigma: float = SIGMA) -> Path:
    folder.mkdir()
    stages = FolderStages(folder.with_name(f"{folder.name}-stages"))
    job = PipelineJob(ImageSource(sequence, sigma, 7), {}, 0, 1, folder, stages)
    return Path(str(prepare(made.command, job).values["sequence"]))


def pixels_of(path: Path) -> np.ndarray:
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)).astype(float)


def test_images_are_noisy_and_everything_else_is_as_it_was(data_set: Path, tmp_path: Path) -> None:
    made = pipeline(unchanged=["depth", "imu.csv"], noisy=["right"])

    folder = prepared(made, load_sequence(data_set), tmp_path / "run")

    noise = [pixels_of(folder / camera / f"{n}.png") - GREY for camera in ("rgb", "right") for n in range(FRAMES)]
    np.testing.assert_allclose([np.std(one) for one in noise], SIGMA, rtol=0.1)
    assert np.abs(np.corrcoef([one.ravel() for one in noise]) - np.eye(2 * FRAMES)).max() < 0.1
    assert (pixels_of(folder / "depth" / "0.png") == DEPTH).all()
    assert (folder / "imu.csv").read_text() == "0,0,0\n"
    assert (folder / "rgb.txt").read_text() == "0.0 0\n1.0 1\n2.0 2\n"


def test_frames_that_are_left_out_are_not_there(data_set: Path, tmp_path: Path) -> None:
    folder = prepared(pipeline(), load_sequence(data_set, selection=Selection(stop=1)), tmp_path / "run", sigma=0.0)

    assert [path.name for path in (folder / "rgb").iterdir()] == ["0.png"]
    assert (pixels_of(folder / "rgb" / "0.png") == GREY).all()


def test_a_run_depends_on_the_files_that_are_named(data_set: Path) -> None:
    sequence = load_sequence(data_set)

    def keys() -> list[str]:
        made = [pipeline(), pipeline(unchanged=["imu.csv"])]
        return [RunRequest(one, {}, sequence, "clean", 0, 0.0, 0, 0).key for one in made]

    before = keys()
    (data_set / "imu.csv").write_text("1,2,3,4\n")

    assert keys()[0] == before[0]
    assert keys()[1] != before[1]


def test_what_cannot_be_handed_over_is_said(data_set: Path, tmp_path: Path) -> None:
    sequence = load_sequence(data_set)

    with pytest.raises(RunError, match=r"'imu2\.csv' is not in .*recording"):
        prepared(pipeline(unchanged=["imu2.csv"]), sequence, tmp_path / "missing")
    with pytest.raises(RunError, match="'rgb' holds images that are replaced"):
        prepared(pipeline(unchanged=["rgb"]), sequence, tmp_path / "inside")
    resized = load_sequence(data_set, selection=Selection(max_image_size=32))
    with pytest.raises(RunError, match="do not fit resized images"):
        prepared(pipeline(), resized, tmp_path / "resized")
    with pytest.raises(DefinitionError, match=r"sequence_files: the path '\.\./depth' must lie inside"):
        pipeline(unchanged=["../depth"])


def test_a_parameter_called_sequence_is_the_users() -> None:
    words = {"arguments": ["python3", "{sequence}"], "parameters": {"sequence": {"default": "mine"}}}

    assert create(words).sequence_key(None) is None  # type: ignore[arg-type]
