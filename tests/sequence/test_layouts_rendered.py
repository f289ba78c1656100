"""Data sets that were rendered or scanned: Replica, TartanAir, ICL-NUIM, 7-Scenes, ScanNet."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import Camera, Selection, load_sequence

# A camera at (1, 2, 3) that is turned by 90 degrees about its vertical.
POSE = np.array([[0.0, 0, 1, 1], [0, 1, 0, 2], [-1, 0, 0, 3], [0, 0, 0, 1]])


def _row(matrix):
    return " ".join(f"{value:.6e}" for value in matrix.ravel())


def _shifted(steps):
    pose = POSE.copy()
    pose[0, 3] += steps
    return pose


@pytest.fixture
def replica(tmp_path, write_images):
    root = tmp_path / "Replica" / "office0"
    write_images(root, [f"results/frame{n:06d}.jpg" for n in range(3)] + ["results/depth000000.png"])
    (root / "traj.txt").write_text("".join(_row(_shifted(n)) + "\n" for n in range(3)))
    camera = {"w": 64, "h": 48, "fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5, "scale": 6553.5}
    (root.parent / "cam_params.json").write_text(json.dumps({"camera": camera}))
    return root


def test_replica_has_poses_row_by_row_and_intrinsics_beside_the_scene(replica):
    sequence = load_sequence(replica)

    assert (sequence.layout, len(sequence)) == ("replica", 3)
    assert sequence.camera == Camera("PINHOLE", 64, 48, (60, 60, 32, 24))
    np.testing.assert_allclose(sequence.ground_truth.positions, [[1, 2, 3], [2, 2, 3], [3, 2, 3]])
    np.testing.assert_allclose(sequence.ground_truth.rotations.as_matrix()[0], POSE[:3, :3], atol=1e-12)
    assert [frame.timestamp for frame in sequence.frames] == pytest.approx([0, 1 / 30, 2 / 30])


def test_replica_works_without_intrinsics(replica):
    (replica.parent / "cam_params.json").unlink()

    assert load_sequence(replica).camera is None


def test_replica_with_too_few_poses_is_refused(replica):
    (replica / "traj.txt").write_text(_row(POSE))

    with pytest.raises(SequenceError, match=r"traj\.txt: expected 16 numbers for each of 3 images, found 16"):
        load_sequence(replica)


def test_poses_that_are_no_rotations_are_refused(replica):
    (replica / "traj.txt").write_text("".join(_row(np.diag([1.0, 1, -1, 1])) + "\n" for _ in range(3)))

    with pytest.raises(SequenceError, match=r"pose of image frame000000\.jpg is not a rotation"):
        load_sequence(replica)


def test_replica_with_damaged_intrinsics_is_refused(replica):
    (replica.parent / "cam_params.json").write_text('{"camera": {"w": 64}}')

    with pytest.raises(SequenceError, match=r"cam_params\.json: camera: expected a key 'fx', found none"):
        load_sequence(replica)


@pytest.fixture
def tartanair(tmp_path, write_images):
    root = tmp_path / "P000"
    write_images(root, [f"image_left/{n:06d}_left.png" for n in range(2)], width=640, height=480)
    (root / "pose_left.txt").write_text("1 2 3 0 0 0 1\n1 3 3 0 0 0.70710678 0.70710678\n")
    return root


def test_tartanair_turns_north_east_down_into_the_axes_of_opencv(tartanair):
    sequence = load_sequence(tartanair)

    assert (sequence.layout, sequence.has_timestamps) == ("tartanair", False)
    assert sequence.camera == Camera("PINHOLE", 640, 480, (320, 320, 320, 240))
    np.testing.assert_allclose(sequence.ground_truth.positions, [[1, 2, 3], [1, 3, 3]])
    # Looking north (x), with east (y) to the right and down (z) down; then turned from north to east.
    level, turned = sequence.ground_truth.rotations.as_matrix()
    np.testing.assert_allclose(level @ np.eye(3), [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(turned @ [0, 0, 1], [0, 1, 0], atol=1e-7)


def test_the_monocular_test_track_of_tartanair_has_its_poses_in_a_folder_beside_the_images(tmp_path, write_images):
    root = tmp_path / "mono" / "ME001"
    write_images(root, [f"{n:06d}.png" for n in range(2)], width=640, height=480)
    (tmp_path / "mono_gt").mkdir()
    (tmp_path / "mono_gt" / "ME001.txt").write_text("1 2 3 0 0 0 1\n1 3 3 0 0 0.70710678 0.70710678\n")

    sequence = load_sequence(root)

    assert (sequence.layout, sequence.has_timestamps, len(sequence)) == ("tartanair", False, 2)
    np.testing.assert_allclose(sequence.ground_truth.positions, [[1, 2, 3], [1, 3, 3]])


@pytest.mark.parametrize("text", ["1 2 3 0 0 0 1\n", "1 2 3 0 0 0\n1 2 3 0 0 0 1\n"])
def test_tartanair_with_damaged_poses_is_refused(tartanair, text):
    (tartanair / "pose_left.txt").write_text(text)

    with pytest.raises(SequenceError, match=r"pose_left\.txt"):
        load_sequence(tartanair)


def _write_icl_poses(path):
    quaternion = Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_quat()
    lines = [f"{n} {n} 0.5 -2.25 " + " ".join(map(str, quaternion)) for n in range(1, 4)]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture
def icl(tmp_path, write_images):
    """The TUM-compatible form: images are numbered from 0, poses from 1."""
    root = tmp_path / "living_room_traj0_frei_png"
    write_images(root, [f"rgb/{n}.png" for n in (0, 1, 2, 3, 10)], width=640, height=480)
    _write_icl_poses(root / "livingRoom0.gt.freiburg")
    return root


def test_icl_nuim_matches_poses_by_number_and_has_a_positive_focal_length(icl):
    sequence = load_sequence(icl)

    assert sequence.layout == "icl-nuim"
    assert [frame.path.stem for frame in sequence.frames] == ["0", "1", "2", "3", "10"]
    assert sequence.frames[4].timestamp == pytest.approx(10 / 30)
    assert sequence.ground_truth.frame_ids.tolist() == [1, 2, 3]
    assert sequence.ground_truth.positions[:, 0].tolist() == [1, 2, 3]
    assert sequence.camera == Camera("PINHOLE", 640, 480, (481.2, 480.0, 320.0, 240.0))


def test_icl_nuim_projects_points_where_the_published_left_handed_camera_does(icl):
    sequence = load_sequence(icl)
    point = np.array([1.3, 0.2, 1.0])
    rotation, centre = Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix(), np.array([1, 0.5, -2.25])
    x, y, z = rotation.T @ (point - centre)
    published = (481.2 * x / z + 319.5, -480.0 * y / z + 239.5)

    mirrored = point * [1, -1, 1]
    pose = sequence.ground_truth
    x, y, z = pose.rotations.as_matrix()[0].T @ (mirrored - pose.positions[0])
    fx, fy, cx, cy = sequence.camera.params

    assert (fx * x / z + cx - 0.5, fy * y / z + cy - 0.5) == pytest.approx(published)


def test_icl_nuim_follows_its_associations(icl):
    lines = [f"{n} depth/{n - 1}.png {n} rgb/{n - 1}.png" for n in range(1, 5)]
    (icl / "associations.txt").write_text("\n".join(lines) + "\n")

    sequence = load_sequence(icl)

    assert [frame.path.stem for frame in sequence.frames] == ["0", "1", "2", "3"]
    assert sequence.ground_truth.frame_ids.tolist() == [0, 1, 2]


def test_icl_nuim_reads_the_native_form(tmp_path, write_images):
    write_images(tmp_path, [f"scene_00_{n:04d}.png" for n in range(1, 4)], width=640, height=480)
    _write_icl_poses(tmp_path / "livingRoom0.gt.freiburg")

    sequence = load_sequence(tmp_path)

    assert (sequence.layout, len(sequence.ground_truth)) == ("icl-nuim", 3)


@pytest.mark.parametrize("line", ["1 depth/1.png", "1 depth/1.png one rgb/1.png"])
def test_icl_nuim_with_damaged_associations_is_refused(icl, line):
    (icl / "associations.txt").write_text(line + "\n")

    with pytest.raises(SequenceError, match=r"associations\.txt:1: expected 'number depth-image number colour-image'"):
        load_sequence(icl)


def test_seven_scenes_has_one_pose_file_for_each_image(tmp_path, write_images):
    names = [f"frame-{n:06d}" for n in (0, 1, 5)]
    write_images(tmp_path, [f"{name}.color.png" for name in names], width=640, height=480)
    for name, steps in zip(names, (0, 1, 5), strict=True):
        (tmp_path / f"{name}.pose.txt").write_text("\n".join(_row(row) for row in _shifted(steps)) + "\n")
        (tmp_path / f"{name}.depth.png").write_bytes(b"not looked at")

    sequence = load_sequence(tmp_path)

    assert (sequence.layout, len(sequence)) == ("7-scenes", 3)
    assert sequence.ground_truth.positions[:, 0].tolist() == [1, 2, 6]
    assert (sequence.camera, sequence.focal_prior) == (None, 525)
    assert sequence.notes[0].startswith("7-Scenes describes its depth camera only")
    assert sequence.frames[2].timestamp == pytest.approx(5 / 30)


@pytest.fixture
def scannet(tmp_path, write_images):
    numbers = (0, 2, 4, 10)
    write_images(tmp_path, [f"color/{n}.jpg" for n in numbers])
    (tmp_path / "pose").mkdir()
    for n in numbers:
        (tmp_path / "pose" / f"{n}.txt").write_text("\n".join(_row(row) for row in _shifted(n)))
    (tmp_path / "intrinsic").mkdir()
    (tmp_path / "intrinsic" / "intrinsic_color.txt").write_text("55 0 31.5 0\n0 56 23.5 0\n0 0 1 0\n0 0 0 1\n")
    return tmp_path


def test_scannet_skips_the_poses_where_tracking_was_lost(scannet):
    (scannet / "pose" / "2.txt").write_text("-inf -inf -inf -inf\n" * 4)

    sequence = load_sequence(scannet)

    assert sequence.layout == "scannet"
    assert [frame.path.name for frame in sequence.frames] == ["0.jpg", "2.jpg", "4.jpg", "10.jpg"]
    assert sequence.ground_truth.frame_ids.tolist() == [0, 2, 3]
    assert sequence.camera == Camera("PINHOLE", 64, 48, (55, 56, 32, 24))


def test_scannet_frames_can_be_thinned_by_rate(scannet):
    sequence = load_sequence(scannet, selection=Selection(rate_hz=7.5))

    assert [frame.path.stem for frame in sequence.frames] == ["0", "4", "10"]


def test_scannet_works_without_poses_and_intrinsics(scannet, tmp_path, write_images):
    for path in (scannet / "pose").iterdir():
        path.unlink()
    (scannet / "intrinsic" / "intrinsic_color.txt").unlink()

    sequence = load_sequence(scannet)

    assert (sequence.ground_truth, sequence.camera) == (None, None)


def test_a_damaged_pose_file_is_named(scannet):
    (scannet / "pose" / "4.txt").write_text("1 2 3\n")

    with pytest.raises(SequenceError, match=r"4\.txt: expected a 4x4 matrix, found 3 numbers"):
        load_sequence(scannet)
