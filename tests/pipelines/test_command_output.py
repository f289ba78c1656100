"""What a program writes as its trajectory, beyond the usual forms: how it is read, and how it is refused."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from gtf_tune.errors import DefinitionError, RunError
from gtf_tune.pipelines import PipelineOutput
from gtf_tune.pipelines.analytic import imaginary_sequence
from gtf_tune.pipelines.command import create
from gtf_tune.sequence import Sequence
from gtf_tune.testing import ContractCase, FolderStages

PYTHON = [sys.executable, "-I", "-S"]
WRITES = "import sys; open(sys.argv[1], 'w').write({text!r})"
MAKES_A_FOLDER = "import os, sys; os.mkdir(sys.argv[1])"


@pytest.fixture(scope="module")
def frames() -> Sequence:
    return imaginary_sequence(4)


def run(code: str, frames: Sequence, folder: Path, **output: Any) -> PipelineOutput:
    """Run a program of one line whose first argument is the place of the trajectory."""
    (folder / "program.py").write_text(code)
    pipeline = create({"arguments": [*PYTHON, str(folder / "program.py"), "{output}"], "output": output})
    return ContractCase(pipeline, frames).run(folder / "run", FolderStages(folder / "stages"), {})


def test_poses_in_eurocs_format_can_be_sorted(frames: Sequence, tmp_path: Path) -> None:
    text = "#ns,p\n33333333,7,0,0,0.6,0,0,0.8\n0,5,0,0,1,0,0,0\n"

    found = run(WRITES.format(text=text), frames, tmp_path, format="euroc", sort=True).trajectory

    assert found.positions[:, 0].tolist() == [5, 7]
    assert found.quaternions[1].tolist() == [0, 0, 0.8, 0.6]


def test_a_byte_order_mark_costs_no_pose(frames: Sequence, tmp_path: Path) -> None:
    text = "\ufeff0,5,0,0,0,0,0,1\n33333333,7,0,0,0,0,0,1\n"

    found = run(WRITES.format(text=text), frames, tmp_path, delimiter=",", time_scale=1e-9).trajectory

    assert found.positions[:, 0].tolist() == [5, 7]


@pytest.mark.parametrize(
    ("output", "fault"),
    [
        ({"format": "euroc", "time_scale": 1e-9}, "'time_scale' and 'delimiter' are for the format 'tum' only"),
        ({"format": "kitti", "association": "row", "sort": True}, "'kitti' has no times to 'sort' by"),
        ({"format": "colmap", "association": "name", "delimiter": ","}, "for the format 'tum' only"),
    ],
)
def test_keys_that_a_format_does_not_heed_are_refused(
    frames: Sequence, tmp_path: Path, output: dict[str, Any], fault: str
) -> None:
    with pytest.raises(DefinitionError, match=fault):
        run(MAKES_A_FOLDER, frames, tmp_path, **output)


def test_a_trajectory_that_cannot_be_read_fails_the_run_only(frames: Sequence, tmp_path: Path) -> None:
    with pytest.raises(RunError, match="expected a readable trajectory file"):
        run(MAKES_A_FOLDER, frames, tmp_path, sort=True)


@pytest.mark.parametrize("sort", [False, True])
def test_a_reason_names_the_file_as_the_definition_does(frames: Sequence, tmp_path: Path, sort: bool) -> None:
    with pytest.raises(RunError, match=r"cannot be used: poses\.txt, line 1: expected 8 numbers"):
        run(WRITES.format(text="0 1 2\n"), frames, tmp_path, path="poses.txt", sort=sort)


def test_poses_without_images_point_to_the_keys_that_match_them(frames: Sequence, tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"3333333\.000000 s; see 'time_scale' and 'max_difference_s'"):
        run(WRITES.format(text="3333333 0 0 0 0 0 0 1\n"), frames, tmp_path)


REPEATS = "0 5 0 0 0 0 0 1\n0.033333333 7 0 0 0 0 0 1\n0.033333333 8 0 0 0 0 0 1\n0.066666667 9 0 0 0 0 0 1\n"


@pytest.mark.parametrize(("duplicates", "x"), [("first", [5, 7, 9]), ("last", [5, 8, 9])])
def test_of_several_poses_of_one_image_the_wanted_one_counts(
    frames: Sequence, tmp_path: Path, duplicates: str, x: list[float]
) -> None:
    found = run(WRITES.format(text=REPEATS), frames, tmp_path, duplicates=duplicates)

    assert found.trajectory.positions[:, 0].tolist() == x
    assert found.diagnostics["num_repeated_poses"] == 1


def test_several_poses_of_one_image_are_an_error_unless_the_definition_says_which_counts(
    frames: Sequence, tmp_path: Path
) -> None:
    with pytest.raises(RunError, match="expected a later timestamp than"):
        run(WRITES.format(text=REPEATS), frames, tmp_path)


def test_positions_that_are_given_twice_are_repeats_too(frames: Sequence, tmp_path: Path) -> None:
    text = "0 5 0 0 0 0 0 1\n1 7 0 0 0 0 0 1\n1 8 0 0 0 0 0 1\n"

    found = run(WRITES.format(text=text), frames, tmp_path, association="index", duplicates="last").trajectory

    assert found.positions[:, 0].tolist() == [5, 8]


def test_lines_out_of_order_stay_an_error_where_repeats_are_allowed(frames: Sequence, tmp_path: Path) -> None:
    with pytest.raises(RunError, match="sort the file"):
        run(WRITES.format(text="1 5 0 0 0 0 0 1\n0 7 0 0 0 0 0 1\n"), frames, tmp_path, duplicates="first")


def test_a_program_may_write_a_reconstruction_that_names_the_images(frames: Sequence, tmp_path: Path) -> None:
    shots = {
        f"{frame.frame_id:06d}.pgm": {"rotation": [0, 0, 0], "translation": [-frame.frame_id, 0, 0]}
        for frame in frames.frames[:3]
    }
    code = WRITES.format(text=json.dumps([{"shots": shots}]))

    found = run(code, frames, tmp_path, path="reconstruction.json", format="opensfm", association="name").trajectory

    assert found.frame_ids.tolist() == [frame.frame_id for frame in frames.frames[:3]]
    assert found.positions[:, 0].tolist() == found.frame_ids.tolist()
