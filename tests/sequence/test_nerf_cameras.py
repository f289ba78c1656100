"""The camera keys of transforms.json and the models of COLMAP that they mean."""

import json

import pytest

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import Camera, Selection, load_sequence
from tests.sequence import miniatures

PINHOLE = (50, 51, 32, 24)
FISHEYE = {"is_fisheye": True, "k1": 0.1, "k2": 0.02, "k3": 0.03, "k4": 0.04}
FOV_90 = 1.5707963267948966


def _load(root, known=miniatures.INTRINSICS, **values):
    miniatures.images(root, [f"images/{n}.png" for n in range(miniatures.COUNT)])
    (root / "transforms.json").write_text(json.dumps(miniatures.transforms(**known, **values)))
    return load_sequence(root)


@pytest.mark.parametrize(
    ("values", "model", "params"),
    [
        ({}, "PINHOLE", PINHOLE),
        ({"camera_model": "OPENCV", "k1": 0.0}, "PINHOLE", PINHOLE),
        ({"k1": 0.1, "p2": 0.01}, "OPENCV", (*PINHOLE, 0.1, 0, 0, 0.01)),
        ({"k1": 0.1, "k3": 0.3}, "FULL_OPENCV", (*PINHOLE, 0.1, 0, 0, 0, 0.3, 0, 0, 0)),
        (
            {"camera_model": "FULL_OPENCV", "k1": 0.1, "k4": 0.4},
            "FULL_OPENCV",
            (*PINHOLE, 0.1, 0, 0, 0, 0, 0.4, 0, 0),
        ),
        ({"k4": 0.4, "k6": 0.6}, "FULL_OPENCV", (*PINHOLE, 0, 0, 0, 0, 0, 0.4, 0, 0.6)),
        (FISHEYE, "OPENCV_FISHEYE", (*PINHOLE, 0.1, 0.02, 0.03, 0.04)),
        ({**FISHEYE, "camera_model": "OPENCV"}, "OPENCV_FISHEYE", (*PINHOLE, 0.1, 0.02, 0.03, 0.04)),
        ({"camera_model": "OPENCV_FISHEYE"}, "OPENCV_FISHEYE", (*PINHOLE, 0, 0, 0, 0)),
        ({"camera_model": "equidistant", "k4": 0.4}, "OPENCV_FISHEYE", (*PINHOLE, 0, 0, 0, 0.4)),
        ({"is_fisheye": False, "k1": 0.1}, "OPENCV", (*PINHOLE, 0.1, 0, 0, 0)),
        (
            {**FISHEYE, "p1": 0.5, "sy1": 0.7},
            "THIN_PRISM_FISHEYE",
            (*PINHOLE, 0.1, 0.02, 0.5, 0, 0.03, 0.04, 0, 0.7),
        ),
        (
            {"camera_model": "THIN_PRISM_FISHEYE", "k1": 0.1, "sx1": 0.2},
            "THIN_PRISM_FISHEYE",
            (*PINHOLE, 0.1, 0, 0, 0, 0, 0, 0.2, 0),
        ),
        (
            {"camera_model": "FISHEYE624", "distortion_params": list(range(12))},
            "RAD_TAN_THIN_PRISM_FISHEYE",
            (*PINHOLE, *range(12)),
        ),
        ({"camera_model": "FOV", "omega": 0.9}, "FOV", (*PINHOLE, 0.9)),
        ({"fl_y": 50.0, "camera_model": "SIMPLE_RADIAL", "k1": 0.1}, "SIMPLE_RADIAL", (50, 32, 24, 0.1)),
        ({"camera_model": "SIMPLE_RADIAL", "k1": 0.1}, "OPENCV", (*PINHOLE, 0.1, 0, 0, 0)),
        ({"fl_y": 50.0, "camera_model": "RADIAL", "k1": 0.1, "k2": 0.2}, "RADIAL", (50, 32, 24, 0.1, 0.2)),
        (
            {"fl_y": 50.0, "camera_model": "SIMPLE_RADIAL_FISHEYE", "k1": 0.1},
            "SIMPLE_RADIAL_FISHEYE",
            (50, 32, 24, 0.1),
        ),
        ({"camera_model": "RADIAL_FISHEYE", "k1": 0.1}, "OPENCV_FISHEYE", (*PINHOLE, 0.1, 0, 0, 0)),
    ],
)
def test_coefficients_and_names_choose_the_model_that_holds_them(tmp_path, values, model, params):
    known = {**miniatures.INTRINSICS, **values}

    assert _load(tmp_path, known).camera == Camera(model, 64, 48, params)


@pytest.mark.parametrize(
    ("values", "params"),
    [
        ({"fl_x": 50}, (50, 50, 32, 24)),
        ({"fl_y": 50}, (50, 50, 32, 24)),
        ({"camera_angle_x": FOV_90}, (32, 32, 32, 24)),
        ({"camera_angle_y": FOV_90}, (24, 24, 32, 24)),
        ({"camera_angle_x": FOV_90, "camera_angle_y": FOV_90}, (32, 24, 32, 24)),
        ({"x_fov": 90, "cx": 31, "cy": 23}, (32, 32, 31, 23)),
        ({"fl_x": "50", "w": 64.0, "h": 48}, (50, 50, 32, 24)),
    ],
)
def test_focal_lengths_come_in_pixels_radians_or_degrees(tmp_path, values, params):
    camera = _load(tmp_path, {}, **values).camera

    assert (camera.model, camera.params) == ("PINHOLE", pytest.approx(params))


@pytest.mark.parametrize(
    ("values", "what"),
    [
        ({"camera_model": "EQUIRECTANGULAR"}, "an equirectangular camera whose images are 64x48"),
        ({"camera_model": "OMNIDIRECTIONALSTEREO_L"}, "camera_model OMNIDIRECTIONALSTEREO_L"),
        ({"k1": 0.1, "k4": 0.4}, "k4 of a perspective lens"),
        ({"camera_model": "OPENCV_FISHEYE", "k5": 0.4}, "a lens with the coefficients k5"),
        ({"camera_model": "FOV"}, "camera_model FOV with these coefficients"),
        ({"distortion_params": [0.1] * 12}, "distortion_params of a camera_model other than FISHEYE624"),
        ({"ftheta_p0": 0.1}, "a camera described by 'ftheta_p0'"),
        ({"rolling_shutter": [0, 0, 0, 1]}, "a camera described by 'rolling_shutter'"),
    ],
)
def test_a_lens_without_a_model_is_refused_with_the_way_out(tmp_path, values, what):
    with pytest.raises(SequenceError, match=rf"transforms\.json: .*found {what}.*; give the camera"):
        _load(tmp_path, **values)


def test_panoramas_have_the_model_of_panoramas(tmp_path):
    miniatures.images(tmp_path, [f"images/{n}.png" for n in range(miniatures.COUNT)])
    values = {"camera_model": "EQUIRECTANGULAR", "w": 64, "h": 32}
    (tmp_path / "transforms.json").write_text(json.dumps(miniatures.transforms(**values)))

    with pytest.raises(SequenceError, match="the intrinsics are for 64x32 images"):
        load_sequence(tmp_path)
    values = {"camera_model": "EQUIRECTANGULAR"}
    (tmp_path / "transforms.json").write_text(json.dumps(miniatures.transforms(**values)))
    for number in range(miniatures.COUNT):
        _crop(tmp_path / "images" / f"{number}.png")
    assert load_sequence(tmp_path).camera == Camera("EQUIRECTANGULAR", 64, 32, (64, 32))


def _crop(path):
    import cv2

    cv2.imwrite(str(path), cv2.imread(str(path))[:32])


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("fl_x", None),
        ("fl_x", "wide"),
        ("fl_x", 10**330),
        ("fl_x", float("nan")),
        ("fl_x", [50]),
        ("cx", "c"),
        ("cx", True),
        ("k1", None),
        ("w", "64px"),
        ("w", 0),
        ("w", -64),
        ("h", 48.5),
        ("camera_angle_x", 0),
        ("is_fisheye", "perhaps"),
        ("camera_model", 7),
    ],
)
def test_a_wrong_value_is_named_by_its_key(tmp_path, key, value):
    known = {**miniatures.INTRINSICS, key: value}
    if key == "camera_angle_x":
        known.pop("fl_x")

    with pytest.raises(SequenceError, match=rf"transforms\.json: {key} should be .*; check the file"):
        _load(tmp_path, known)


@pytest.mark.parametrize(("key", "value"), [("fl_x", 0), ("fl_y", -3)])
def test_an_impossible_focal_length_is_refused(tmp_path, key, value):
    with pytest.raises(SequenceError, match=r"transforms\.json: camera parameter f[xy] of PINHOLE cannot be"):
        _load(tmp_path, {**miniatures.INTRINSICS, key: value})


def _per_frame(root, values):
    """Write transforms of as many images as there are cameras; a frame's keys are over those of the file."""
    count = len(values)
    miniatures.images(root, [f"images/{n}.png" for n in range(count)])
    pose = miniatures.matrix(0).tolist()
    frames = [{"file_path": f"images/{n}.png", "transform_matrix": pose, **given} for n, given in enumerate(values)]
    (root / "transforms.json").write_text(json.dumps({**miniatures.INTRINSICS, "frames": frames}))


def test_images_with_intrinsics_of_their_own_are_grouped_by_camera(tmp_path):
    _per_frame(tmp_path, [{"fl_x": 60.0}] * 3 + [{}] * 6)

    sequence = load_sequence(tmp_path)

    assert sequence.taken_by == (0, 0, 0, 1, 1, 1, 1, 1, 1)
    assert [camera.intrinsics.params[0] for camera in sequence.cameras] == [60.0, PINHOLE[0]]
    assert (sequence.camera, sequence.main_camera.intrinsics.params) == (None, PINHOLE)
    assert len(load_sequence(tmp_path, camera="unknown").cameras) == 1


def test_the_largest_group_can_be_used_alone_and_the_rest_is_named(tmp_path):
    _per_frame(tmp_path, [{"fl_x": 60.0}] * 3 + [{}] * 6)

    sequence = load_sequence(tmp_path, selection=Selection(cameras="largest"))

    assert sequence.camera.params == PINHOLE
    assert [frame.frame_id for frame in sequence.frames] == [3, 4, 5, 6, 7, 8]
    assert sequence.notes == (
        "the images come from 2 cameras; the 6 of the largest group are used, 3 are left out: 0.png, 1.png, 2.png",
    )


def test_intrinsics_that_differ_count_as_unknown_where_one_camera_is_asked_for(tmp_path):
    _per_frame(tmp_path, [{"fl_x": 60.0 + n} for n in range(9)])

    sequence = load_sequence(tmp_path, selection=Selection(cameras="one"))

    assert (sequence.camera, len(sequence), len(load_sequence(tmp_path).cameras)) == (None, 9, 9)
    assert "have 9 different intrinsics, so they count as unknown" in sequence.notes[0]


@pytest.mark.parametrize(
    ("values", "rules", "kept"),
    [([60.0] * 3 + [50.0] * 6, 2, 6), ([60.0] * 3 + [50.0] * 6, 1, 9), ([60.0 + n for n in range(9)], 2, 9)],
)
def test_former_rules_keep_the_frames_of_one_camera(tmp_path, values, rules, kept):
    _per_frame(tmp_path, [{"fl_x": value} for value in values])

    sequence = load_sequence(tmp_path, selection=Selection(rules=rules))

    assert (len(sequence), len(sequence.cameras)) == (kept, 1)
    assert (sequence.camera is None) == (kept == 9)


def test_keys_that_are_not_read_are_noted(tmp_path):
    sequence = _load(tmp_path, aabb_scale=4, applied_transform=[[1, 0, 0, 0]], lens="odd")

    assert sequence.notes == ("transforms.json has keys that are not read: lens",)


def test_a_transposed_pose_is_no_pose(tmp_path):
    miniatures.nerf(tmp_path)
    path = tmp_path / "transforms.json"
    values = json.loads(path.read_text())
    values["frames"][1]["transform_matrix"] = miniatures.matrix(1).T.tolist()
    path.write_text(json.dumps(values))

    with pytest.raises(SequenceError, match=r"transforms\.json: the pose of image 1\.png is not a rotation"):
        load_sequence(tmp_path)
