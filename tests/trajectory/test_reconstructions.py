"""Reconstructions that programs write as JSON give the poses that were put into them."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory import read_trajectory

NAMES = ("frame_00002.png", "frame_00010.png", "frame_00011.png", "frame_00020.png", "frame_00030.png")
POSITIONS = np.random.default_rng(3).normal(size=(5, 3))
ROTATIONS = Rotation.from_rotvec(np.random.default_rng(4).normal(size=(5, 3)))  # world_from_camera, OpenCV's axes


def transforms() -> Any:
    frames = []
    for name, position, rotation in zip(NAMES, POSITIONS, ROTATIONS.as_matrix(), strict=True):
        matrix = np.eye(4)
        matrix[:3, 3] = position
        matrix[:3, :3] = np.column_stack([rotation[:, 0], -rotation[:, 1], -rotation[:, 2]])  # right, up, backward
        frames.append({"file_path": f"./images/{name}", "transform_matrix": matrix.tolist()})
    return {"fl_x": 500, "frames": frames[::-1]}


def opensfm() -> Any:
    camera_from_world = ROTATIONS.inv()
    shots = {
        name: {"rotation": turn.as_rotvec().tolist(), "translation": (-turn.apply(position)).tolist(), "camera": "v2"}
        for name, turn, position in zip(NAMES, camera_from_world, POSITIONS, strict=True)
    }
    lost = {"cameras": {}, "shots": {"other.png": {"rotation": [0, 0, 0], "translation": [0, 0, 0]}}, "points": {}}
    return [lost, {"cameras": {}, "shots": shots, "points": {}}]


def sfmdata() -> Any:
    views, poses = [], []
    for index, (name, turn, position) in enumerate(zip(NAMES, ROTATIONS.inv(), POSITIONS, strict=True)):
        views.append({"viewId": str(index), "poseId": str(index), "path": f"C:\\photos\\{name}"})
        columns = turn.as_matrix().T.ravel()  # camera_from_world, one column after the other
        transform = {"rotation": [repr(float(v)) for v in columns], "center": [repr(float(v)) for v in position]}
        poses.append({"poseId": str(index), "pose": {"transform": transform, "locked": "0"}})
    views.append({"viewId": "9", "poseId": "9", "path": "/photos/without_pose.png"})
    return {"version": ["1", "2", "0"], "views": views, "poses": poses}


@pytest.mark.parametrize(("make", "name"), [(transforms, "a.json"), (opensfm, "b.json"), (sfmdata, "c.sfm")])
def test_poses_are_read_as_they_are(make: Callable[[], Any], name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(json.dumps(make()))

    found = read_trajectory(tmp_path / name)

    assert found.names == NAMES
    assert found.frame_ids.tolist() == [2, 10, 11, 20, 30]
    assert np.allclose(found.positions, POSITIONS)
    assert np.allclose((found.rotations.inv() * ROTATIONS).magnitude(), 0, atol=1e-7)


def test_folders_stay_where_files_in_them_have_one_name(tmp_path: Path) -> None:
    content = transforms()
    content["frames"][0]["file_path"] = "left/0.png"
    content["frames"][1]["file_path"] = "right/0.png"
    (tmp_path / "a.json").write_text(json.dumps(content))

    assert {"left/0.png", "right/0.png"} < set(read_trajectory(tmp_path / "a.json").names)


def changed(content: Any, change: Callable[[Any], Any]) -> Any:
    change(content)
    return content


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ({"camera": 1}, "expected the poses of a reconstruction"),
        ({"frames": []}, "expected at least one image with a pose"),
        ([{"shots": {}}], "expected at least one image with a pose"),
        ({"views": [], "poses": {"a": 1}}, "expected a list under the key poses"),
        (changed(transforms(), lambda c: c["frames"][0].pop("file_path")), r"frames\[0\]: expected a key 'file_path'"),
        (
            changed(transforms(), lambda c: c["frames"][0].update(transform_matrix=[[1, 2], [3]])),
            r"frames\[0\].transform_matrix: expected 4 x 4 finite numbers",
        ),
        (
            changed(transforms(), lambda c: c["frames"][0].update(transform_matrix=np.zeros((4, 4)).tolist())),
            "expected a rotation",
        ),
        (
            changed(opensfm(), lambda c: c[1]["shots"][NAMES[0]].update(rotation=[1, None, 2])),
            r"shots\['frame_00002.png'\].rotation: expected 3 finite numbers",
        ),
        (
            changed(sfmdata(), lambda c: c["poses"][2]["pose"]["transform"].update(center=["1", "x", "2"])),
            "pose 2.center: expected 3 finite numbers",
        ),
        (changed(opensfm(), lambda c: c[1]["shots"].update({"a/frame_00002.png": 3})), "expected a key 'rotation'"),
    ],
)
def test_a_damaged_file_is_named_with_the_key(content: Any, fault: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps(content))

    with pytest.raises(TrajectoryError, match=fault):
        read_trajectory(tmp_path / "a.json")


def test_text_that_is_no_json_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("{")

    with pytest.raises(TrajectoryError, match="expected JSON in"):
        read_trajectory(tmp_path / "a.json")


def test_a_mirrored_camera_is_no_rotation(tmp_path: Path) -> None:
    content = transforms()
    content["frames"][0]["transform_matrix"] = np.diag([1.0, 1.0, -1.0, 1.0]).tolist()
    (tmp_path / "a.json").write_text(json.dumps(content))

    with pytest.raises(TrajectoryError, match="skewed, mirrored or empty"):
        read_trajectory(tmp_path / "a.json")
