"""Data sets from vehicles, drones and photographs: KITTI, EuRoC, COLMAP and ETH3D multi-view, Strecha, NeRF."""

import json
import shutil
import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import Camera, load_sequence

IDENTITY = "1 0 0 0 0 1 0 0 0 0 1 {z}"


@pytest.fixture
def kitti(tmp_path, write_images):
    root = tmp_path / "dataset" / "sequences" / "07"
    write_images(root, [f"image_0/{n:06d}.png" for n in range(3)])
    (root / "times.txt").write_text("0.000000e+00\n1.037e-01\n2.074e-01\n")
    rows = [f"P{n}: 70 0 31.5 {shift} 0 71 23.5 0 0 0 1 0" for n, shift in enumerate((0, -37.6, 4.2, -33.4))]
    (root / "calib.txt").write_text("\n".join([*rows, "Tr: 0 -1 0 0 0 0 -1 0 1 0 0 0"]) + "\n")
    (tmp_path / "dataset" / "poses").mkdir()
    (tmp_path / "dataset" / "poses" / "07.txt").write_text("".join(IDENTITY.format(z=n) + "\n" for n in range(3)))
    return root


def test_kitti_has_times_calibration_and_poses_in_files_of_their_own(kitti):
    sequence = load_sequence(kitti)

    assert (sequence.layout, sequence.name) == ("kitti", "07")
    assert [frame.timestamp for frame in sequence.frames] == [0, 0.1037, 0.2074]
    assert sequence.camera == Camera("PINHOLE", 64, 48, (70, 71, 32, 24))
    assert sequence.ground_truth.positions[:, 2].tolist() == [0, 1, 2]
    assert sequence.ground_truth.timestamps.tolist() == [0, 0.1037, 0.2074]


def test_kitti_colour_images_stand_beside_camera_0(kitti):
    (kitti / "image_0").rename(kitti / "image_2")

    sequence = load_sequence(kitti)

    # P2 = K [I | (0.06, 0, 0)]: the camera is 6 cm to the left of camera 0.
    np.testing.assert_allclose(sequence.ground_truth.positions, [[-0.06, 0, n] for n in range(3)])


def cut(kitti, names):
    """Leave three images of those names, with the poses of frames 0 to 9."""
    for path, name in zip(sorted((kitti / "image_0").iterdir()), names, strict=True):
        path.rename(path.with_name(name))
    poses = kitti.parent.parent / "poses" / "07.txt"
    poses.write_text("".join(IDENTITY.format(z=n) + "\n" for n in range(10)))


def test_kitti_images_that_were_cut_have_the_poses_of_their_numbers(kitti):
    cut(kitti, ["000004.png", "000006.png", "000007.png"])

    sequence = load_sequence(kitti)

    assert sequence.ground_truth.positions[:, 2].tolist() == [4, 6, 7]
    assert sequence.notes == ("07.txt has 10 poses for 3 images: each image has the pose in the line of its number",)


@pytest.mark.parametrize("names", [["a.png", "b.png", "c.png"], ["000008.png", "000009.png", "000010.png"]])
def test_kitti_images_that_nothing_links_to_poses_have_none(kitti, names):
    cut(kitti, names)

    sequence = load_sequence(kitti)

    assert sequence.ground_truth is None
    assert "07.txt has 10 poses for 3 images, and their names do not say which belong together" in sequence.notes[0]


def test_kitti_poses_that_lack_some_lines_are_not_used(kitti):
    (kitti.parent.parent / "poses" / "07.txt").write_text(IDENTITY.format(z=0) + "\n" + IDENTITY.format(z=2) + "\n")

    assert load_sequence(kitti).ground_truth is None


def test_kitti_test_sequences_have_no_poses(kitti):
    (kitti.parent.parent / "poses" / "07.txt").unlink()

    assert load_sequence(kitti).ground_truth is None


def test_kitti_with_another_count_of_times_is_refused(kitti):
    (kitti / "times.txt").write_text("0\n1\n")

    with pytest.raises(SequenceError, match=r"times\.txt: has 2 times for 3 images"):
        load_sequence(kitti)


def test_kitti_without_calibration_is_refused(kitti):
    (kitti / "calib.txt").write_text("P1: 1 2 3\n")

    with pytest.raises(SequenceError, match=r"calib\.txt: expected a line 'P0:' with 12 numbers.*give the camera"):
        load_sequence(kitti)


SENSOR = """# General sensor definitions.
sensor_type: camera
comment: VI-Sensor cam0 (MT9M034)

# Sensor extrinsics wrt. the body-frame.
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, -0.02,
         1.0, 0.0, 0.0, -0.06,
         0.0, 0.0, 1.0, 0.01,
         0.0, 0.0, 0.0, 1.0]

# Camera specific definitions.
rate_hz: 20
resolution: [64, 48]
camera_model: pinhole
intrinsics: [45.8, 45.7, 36.7, 24.8] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 1.8e-05]
"""


@pytest.fixture
def euroc(tmp_path, write_images):
    start = 1403636579763555584
    stamps = [start + n * 50_000_000 for n in range(3)]
    camera = tmp_path / "mav0" / "cam0"
    write_images(camera / "data", [f"{stamp}.png" for stamp in stamps])
    rows = [f"{stamp},{stamp}.png" for stamp in stamps]
    (camera / "data.csv").write_text("#timestamp [ns],filename\n" + "\n".join(rows) + "\n")
    (camera / "sensor.yaml").write_text(SENSOR)
    truth = tmp_path / "mav0" / "state_groundtruth_estimate0"
    truth.mkdir()
    w, z = np.sqrt(0.5), np.sqrt(0.5)
    poses = [f"{stamp + 1_000_000},{n},2,3,{w},0,0,{z}," + ",".join(["0"] * 9) for n, stamp in enumerate(stamps[1:])]
    (truth / "data.csv").write_text("#timestamp, p_RS_R_x [m], ...\n" + "\n".join(poses) + "\n")
    return tmp_path


def test_euroc_has_distortion_and_poses_of_the_body(euroc):
    sequence = load_sequence(euroc)

    assert sequence.layout == "euroc"
    assert sequence.camera == Camera("OPENCV", 64, 48, (45.8, 45.7, 37.2, 25.3, -0.28, 0.07, 0.0002, 1.8e-05))
    assert sequence.ground_truth.frame_ids.tolist() == [1, 2]
    # The body is turned by 90 degrees about z, the camera by another 90, and its offset turns with the body.
    np.testing.assert_allclose(sequence.ground_truth.positions[0], [0.06, 2 - 0.02, 3.01])
    turn = Rotation.from_euler("z", 180, degrees=True).as_matrix()
    np.testing.assert_allclose(sequence.ground_truth.rotations.as_matrix()[0], turn, atol=1e-12)


def test_euroc_can_be_given_as_the_mav0_folder(euroc):
    assert len(load_sequence(euroc / "mav0")) == 3


def test_equidistant_distortion_is_the_fisheye_of_opencv(euroc):
    sensor = euroc / "mav0" / "cam0" / "sensor.yaml"
    sensor.write_text(SENSOR.replace("radial-tangential", "equidistant"))

    assert load_sequence(euroc).camera.model == "OPENCV_FISHEYE"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("radial-tangential", "omni", "expected a distortion_model among"),
        ("[64, 48]", "[64]", "resolution should be a list of 2 whole numbers, not a list of 1"),
        ("45.8,", "many,", r"intrinsics\[0\] should be a finite number, not 'many'"),
    ],
)
def test_euroc_with_a_damaged_sensor_file_is_refused(euroc, old, new, message):
    (euroc / "mav0" / "cam0" / "sensor.yaml").write_text(SENSOR.replace(old, new))

    with pytest.raises(SequenceError, match=rf"sensor\.yaml: {message}"):
        load_sequence(euroc)


def test_euroc_with_a_damaged_image_list_is_refused(euroc):
    (euroc / "mav0" / "cam0" / "data.csv").write_text("12.5,a.png\n")

    with pytest.raises(SequenceError, match=r"data\.csv:1: expected a time in whole nanoseconds, found '12.5'"):
        load_sequence(euroc)


def _images_text(names):
    lines = ["# Image list with two lines of data per image:"]
    for number, name in enumerate(names):
        lines += [f"{number + 1} 1 0 0 0 {-number} 0 0 1 {name}", ""]
    return "\n".join(lines) + "\n"


@pytest.fixture
def eth3d(tmp_path, write_images):
    names = [f"dslr_images_undistorted/DSC_{n:04d}.JPG" for n in (286, 287, 1000)]
    write_images(tmp_path / "images", [*names, "dslr_images_undistorted/DSC_0500.JPG"])
    model = tmp_path / "dslr_calibration_undistorted"
    model.mkdir()
    (model / "cameras.txt").write_text("# Camera list\n1 PINHOLE 64 48 50.5 50.25 32.1 24.2\n")
    (model / "images.txt").write_text(_images_text(names))
    return tmp_path


def test_eth3d_multi_view_is_a_colmap_model_beside_its_images(eth3d):
    sequence = load_sequence(eth3d)

    assert sequence.layout == "colmap"
    assert sequence.camera == Camera("PINHOLE", 64, 48, (50.5, 50.25, 32.1, 24.2))
    names = ["DSC_0286.JPG", "DSC_0287.JPG", "DSC_0500.JPG", "DSC_1000.JPG"]
    assert [frame.path.name for frame in sequence.frames] == names
    assert sequence.ground_truth.frame_ids.tolist() == [0, 1, 3]
    np.testing.assert_allclose(sequence.ground_truth.positions, [[0, 0, 0], [1, 0, 0], [2, 0, 0]])


def test_cameras_of_every_model_are_read_from_binary_models(tmp_path, write_images):
    write_images(tmp_path / "images", ["a.png", "b.png"])
    model = tmp_path / "sparse" / "0"
    model.mkdir(parents=True)
    params = (50.0, 51.0, 32.0, 24.0, 0.1, 0.01, 0.001, 0.002)
    (model / "cameras.bin").write_bytes(struct.pack("<QIiQQ8d", 1, 1, 4, 64, 48, *params))
    image = struct.pack("<I7dI", 1, 1, 0, 0, 0, -5, 0, 0, 1) + b"b.png\0" + struct.pack("<Q", 0)
    (model / "images.bin").write_bytes(struct.pack("<Q", 1) + image)

    sequence = load_sequence(tmp_path)

    assert sequence.camera == Camera("OPENCV", 64, 48, params)
    assert sequence.ground_truth.frame_ids.tolist() == [1]
    assert sequence.ground_truth.positions.tolist() == [[5, 0, 0]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 PINHOLE 64 48", r"cameras\.txt:1: expected 'id MODEL width height parameters'"),
        ("1 PINHOLE 64 48 1 2 3", r"cameras\.txt: camera model PINHOLE takes 4 parameters"),
        ("1 MAGIC 64 48 1 2 3 4", r"cameras\.txt: unknown camera model 'MAGIC'"),
        ("1 PINHOLE 64 -48 1 2 3 4", r"cameras\.txt: a camera needs an image size"),
        ("1 PINHOLE 64.5 48 1 2 3 4", r"cameras\.txt: expected the image size of camera 1 in whole pixels"),
        ("1 PINHOLE 64 48 1 2 3 many", r"cameras\.txt:1: expected numbers"),
        ("7 PINHOLE 64 48 1 2 3 4", r"cameras\.txt: has no camera 1, which an image uses"),
    ],
)
def test_damaged_cameras_are_refused(eth3d, text, message):
    (eth3d / "dslr_calibration_undistorted" / "cameras.txt").write_text(text + "\n")

    with pytest.raises(SequenceError, match=message):
        load_sequence(eth3d)


def test_a_binary_model_that_is_cut_off_is_refused(eth3d):
    model = eth3d / "dslr_calibration_undistorted"
    (model / "cameras.bin").write_bytes(struct.pack("<QIiQQ2d", 1, 1, 4, 64, 48, 1.0, 2.0))

    with pytest.raises(SequenceError, match=r"cameras\.bin: expected COLMAP cameras"):
        load_sequence(eth3d)


def test_a_model_without_its_images_is_refused(eth3d):
    shutil.rmtree(eth3d / "images")

    with pytest.raises(SequenceError, match="found none of the model's 3 images"):
        load_sequence(eth3d)


def test_a_folder_without_a_model_is_refused(tmp_path, write_images):
    write_images(tmp_path, ["a.png"])

    with pytest.raises(SequenceError, match="expected a COLMAP model"):
        load_sequence(tmp_path, layout="colmap")


CAMERA_FILE = "50 0 31.5\n0 51 23.5\n0 0 1\n0 0 0\n0 0 1\n0 1 0\n-1 0 0\n1 2 {z}\n64 48\n"


@pytest.mark.parametrize(("images", "cameras"), [(".", "."), ("urd", "gt_dense_cameras")])
def test_strecha_has_a_camera_file_for_each_image(tmp_path, write_images, images, cameras):
    write_images(tmp_path / images, ["0000.png", "0001.png"])
    (tmp_path / cameras).mkdir(exist_ok=True)
    for number in (0, 1):
        (tmp_path / cameras / f"000{number}.jpg.camera").write_text(CAMERA_FILE.format(z=3 + number))

    sequence = load_sequence(tmp_path)

    assert (sequence.layout, len(sequence)) == ("strecha", 2)
    assert sequence.camera == Camera("PINHOLE", 64, 48, (50, 51, 32, 24))
    np.testing.assert_allclose(sequence.ground_truth.positions, [[1, 2, 3], [1, 2, 4]])
    rotation = sequence.ground_truth.rotations.as_matrix()[0]
    np.testing.assert_allclose(rotation, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-12)


def test_strecha_without_a_camera_file_is_refused(tmp_path, write_images):
    write_images(tmp_path, ["0000.jpg", "0001.jpg"])
    (tmp_path / "0000.jpg.camera").write_text(CAMERA_FILE.format(z=3))

    with pytest.raises(SequenceError, match=r"0001\.jpg\.camera: cannot read the file"):
        load_sequence(tmp_path)


def _transforms(**values):
    pose = np.eye(4)
    pose[:3, 3] = 1, 2, 3
    frames = [{"file_path": f"./train/r_{n}", "transform_matrix": pose.tolist()} for n in (10, 2)]
    return json.dumps({**values, "frames": frames})


@pytest.fixture
def nerf(tmp_path, write_images):
    write_images(tmp_path, ["train/r_2.png", "train/r_10.png"])
    (tmp_path / "transforms_train.json").write_text(_transforms(camera_angle_x=2 * np.arctan(0.5)))
    return tmp_path


def test_nerf_turns_the_axes_of_opengl_into_those_of_opencv(nerf):
    sequence = load_sequence(nerf)

    assert sequence.layout == "nerf"
    assert [frame.path.name for frame in sequence.frames] == ["r_2.png", "r_10.png"]
    assert sequence.camera.params == pytest.approx((64, 64, 32, 24))
    np.testing.assert_allclose(sequence.ground_truth.rotations.as_matrix()[0], np.diag([1, -1, -1]), atol=1e-12)
    assert sequence.ground_truth.positions[0].tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", r"json: expected JSON"),
        ("[" * 100_000, r"json: expected JSON \(values are nested too deeply\)"),
        ('{"frames": []}', r"json: frames should be a list of frames"),
        ('{"frames": [{"file_path": "train/r_2"}]}', r"json: frames\[0\]: expected a key 'transform_matrix'"),
        (
            '{"frames": [{"file_path": "train/r_2", "transform_matrix": [1]}]}',
            r"json: frames\[0\].transform_matrix should be a 4x4 matrix",
        ),
        (_transforms(), r"json: expected fl_x or camera_angle_x, found neither"),
    ],
)
def test_damaged_transforms_are_refused(nerf, text, message):
    (nerf / "transforms_train.json").write_text(text)

    with pytest.raises(SequenceError, match=message):
        load_sequence(nerf)
