import cv2
import numpy as np
import pytest

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import RoomSpec, load_sequence, render_room
from gtf_tune.sequence.render.motion import random_path
from gtf_tune.sequence.render.scene import Face

SMALL = RoomSpec(num_frames=4, width=160, height=120)


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    return render_room(tmp_path_factory.mktemp("render") / "room", SMALL)


def _pixels(folder):
    return [path.read_bytes() for path in sorted((folder / "rgb").iterdir())]


def test_a_room_loads_as_a_sequence_with_ground_truth_and_intrinsics(room):
    sequence = load_sequence(room)

    assert (sequence.layout, len(sequence), len(sequence.ground_truth)) == ("eth3d-slam", 4, 4)
    assert (sequence.width, sequence.height) == (160, 120)
    assert sequence.camera == SMALL.camera
    assert [frame.timestamp for frame in sequence.frames] == [0.0, 0.2, 0.4, 0.6]


def test_pictures_have_contrast_and_are_well_exposed(room):
    for frame in load_sequence(room).frames:
        grey = cv2.imread(str(frame.path), cv2.IMREAD_UNCHANGED)
        assert grey.ndim == 2
        assert 60 < grey.mean() < 190
        assert grey.std() > 20


def test_equal_specs_give_equal_files_whatever_the_number_of_threads(room, tmp_path):
    again = render_room(tmp_path / "again", SMALL, threads=1)

    assert _pixels(again) == _pixels(room)
    for table in ("rgb.txt", "groundtruth.txt", "calibration.txt"):
        assert (again / table).read_text() == (room / table).read_text()


def test_another_seed_gives_another_room_and_path(room, tmp_path):
    other = load_sequence(render_room(tmp_path / "other", RoomSpec(num_frames=4, width=160, height=120, seed=1)))

    assert other.fingerprint != load_sequence(room).fingerprint
    assert np.abs(other.ground_truth.positions - load_sequence(room).ground_truth.positions).max() > 0.01


@pytest.mark.parametrize(("motion", "axis"), [("arc", 0), ("forward", 1)])
def test_a_motion_says_where_the_camera_goes(motion, axis):
    path = random_path(np.random.default_rng(0), motion)
    moved = path.pose(1.0)[:3, 3] - path.pose(0.0)[:3, 3]

    assert np.argmax(np.abs(moved)) == axis


def test_a_turn_stays_near_one_place_and_looks_elsewhere():
    path = random_path(np.random.default_rng(0), "turn")
    first, last = path.pose(0.0), path.pose(1.0)

    assert np.linalg.norm(last[:3, 3] - first[:3, 3]) < 1.5
    assert first[:3, 2] @ last[:3, 2] < 0.2


def test_less_contrast_flattens_a_texture_about_its_mean():
    face = Face(np.zeros(3), np.zeros(3), np.zeros(3), np.array([[10.0, 30.0]], np.float32))

    assert face.with_contrast(0.5).texture.tolist() == [[15.0, 25.0]]


def test_features_of_two_pictures_lie_on_the_epipolar_lines_of_the_ground_truth(tmp_path):
    sequence = load_sequence(render_room(tmp_path / "room", RoomSpec(num_frames=8, width=320, height=240)))
    first, second = (_features(sequence, index) for index in (3, 4))
    matches = cv2.BFMatcher().knnMatch(first[1], second[1], k=2)
    good = [pair[0] for pair in matches if pair[0].distance < 0.7 * pair[1].distance]

    distances = _epipolar_distances(
        sequence, first[0][[match.queryIdx for match in good]], second[0][[match.trainIdx for match in good]]
    )

    assert len(good) > 100
    assert np.median(distances) < 0.25


def _features(sequence, index):
    """Return pixel positions (centres at +0.5) and descriptors of a frame."""
    points, descriptors = cv2.SIFT_create().detectAndCompute(sequence.read_grey(sequence.frames[index]), None)
    return np.array([point.pt for point in points]) + 0.5, descriptors


def _epipolar_distances(sequence, first, second):
    """Return the distance in pixels of points of frame 4 from the epipolar lines of those of frame 3."""
    fx, fy, cx, cy = sequence.camera.params
    unproject = np.linalg.inv([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    rotations = sequence.ground_truth.rotations.as_matrix()
    baseline = rotations[4].T @ (sequence.ground_truth.positions[3] - sequence.ground_truth.positions[4])
    rays = np.column_stack([first, np.ones(len(first))]) @ unproject.T @ (rotations[4].T @ rotations[3]).T
    lines = np.cross(baseline, rays) @ unproject
    return np.abs((lines * np.column_stack([second, np.ones(len(second))])).sum(axis=1)) / np.hypot(*lines.T[:2])


def test_a_folder_that_holds_a_sequence_is_left_alone(room):
    with pytest.raises(SequenceError, match="there already is a sequence"):
        render_room(room, SMALL)


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")

    with pytest.raises(SequenceError, match="cannot write the sequence"):
        render_room(tmp_path / "file" / "room", SMALL)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("num_frames", 1),
        ("width", 10),
        ("sensor_noise", -1),
        ("exposure", float("nan")),
        ("frame_rate_hz", 0),
        ("contrast", -1),
    ],
)
def test_impossible_specs_are_refused_by_name(field, value):
    with pytest.raises(SequenceError, match=field):
        RoomSpec(**{field: value})


def test_an_unknown_motion_is_refused_with_the_known_ones():
    with pytest.raises(SequenceError, match="one of arc, forward, turn, not 'fly'"):
        RoomSpec(motion="fly")
