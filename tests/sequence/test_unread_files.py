"""Files that bear on camera or poses are noted where they are not read."""

import pytest

from gtf_tune.sequence import load_sequence
from tests.sequence import miniatures

NOTE = "files that may describe camera or poses and are not read: "


@pytest.mark.parametrize(
    "name",
    [
        "calib.txt",
        "calibration.yaml",
        "camera.json",
        "cam0.yaml",
        "intrinsics.txt",
        "K.txt",
        "poses.txt",
        "poses_bounds.npy",
        "groundtruth.txt",
        "ground_truth.csv",
        "gt.tum",
        "trajectory.txt",
        "times.txt",
        "timestamps.csv",
        "sparse/camera_info.xml",
        "Family_COLMAP_SfM.log",
        "bundle.out",
        "model.nvm",
        "sfm_data.json",
        "reconstruction.json",
        "temple_par.txt",
        "cams_krt.txt",
        "graph.g2o",
        "ost.yaml",
        "TUM1.yaml",
    ],
)
def test_a_plain_folder_says_what_lies_beside_its_images(tmp_path, name):
    miniatures.folder(tmp_path)
    miniatures.text(tmp_path / name, ["1 2 3"])

    assert load_sequence(tmp_path, layout="folder").notes == (NOTE + name,)


@pytest.mark.parametrize("name", ["notes.txt", "README.md", "depth.txt", "imu.csv", "sometimes-read.pdf", ".calib.txt"])
def test_other_files_are_no_matter(tmp_path, name):
    miniatures.folder(tmp_path)
    miniatures.text(tmp_path / name, ["1 2 3"])

    assert load_sequence(tmp_path).notes == ()


@pytest.mark.parametrize(
    ("layout", "name"),
    [
        ("eth3d-slam", "calibration.yaml"),
        ("kitti", "calib_cam_to_cam.txt"),
        ("euroc", "mav0/leica0/data.csv"),
        ("euroc", "mav0/mocap0/data.csv"),
        ("euroc", "mav0/cam0/camchain.yaml"),
        ("icl-nuim", "camera.txt"),
        ("7-scenes", "calibration.txt"),
        ("scannet", "extrinsic.txt"),
        ("replica", "poses.json"),
        ("tartanair", "cam_intrinsics.txt"),
        ("colmap", "cameras.json"),
        ("nerf", "transforms_test.json"),
        ("strecha", "calibration.mat"),
        ("vslam-lab", "cameras.xml"),
    ],
)
def test_every_layout_says_what_it_does_not_read(tmp_path, layout, name):
    miniatures.LAYOUTS[layout](tmp_path)
    miniatures.text(tmp_path / name, ["1 2 3"])

    assert NOTE + name in load_sequence(tmp_path).notes


@pytest.mark.parametrize(
    ("layout", "file", "old", "new", "note"),
    [
        ("euroc", "mav0/cam0/sensor.yaml", "sensor_type", "rolling_shutter", "sensor.yaml has keys that are not read"),
        ("vslam-lab", "calibration.yaml", "fps", "shutter", "calibration.yaml has keys that are not read: shutter"),
        ("replica", "cam_params.json", '"scale"', '"skew"', "cam_params.json has keys that are not read: skew"),
        ("kitti", "calib.txt", "P1:", "D_0:", "calib.txt has lines that are not read: D_0"),
    ],
)
def test_keys_that_are_not_read_are_noted(tmp_path, layout, file, old, new, note):
    miniatures.LAYOUTS[layout](tmp_path)
    path = tmp_path / file
    path.write_text(path.read_text().replace(old, new))

    assert any(found.startswith(note) for found in load_sequence(tmp_path).notes)


def test_skew_is_refused_as_no_model_has_it(tmp_path):
    from gtf_tune.errors import SequenceError

    miniatures.scannet(tmp_path)
    (tmp_path / "intrinsic" / "intrinsic_color.txt").write_text("50 3 31.5 0\n0 51 23.5 0\n0 0 1 0\n0 0 0 1\n")

    with pytest.raises(SequenceError, match=r"intrinsic_color\.txt: expected a calibration matrix .* with skew"):
        load_sequence(tmp_path)
