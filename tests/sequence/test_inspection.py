import json
from dataclasses import asdict, replace

import cv2
import numpy as np
import pytest

from gtf_tune.sequence import Camera, RoomSpec, Selection, inspect_sequence, load_sequence, render_room


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    return load_sequence(
        render_room(tmp_path_factory.mktemp("inspect") / "room", RoomSpec(num_frames=10, width=320, height=240, seed=3))
    )


def _warnings(sequence):
    return "\n".join(inspect_sequence(sequence).warnings)


def _load(folder, pictures, **arguments):
    folder.mkdir(exist_ok=True)
    for number, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f"{number:03d}.png"), picture)
    return load_sequence(folder, **arguments)


def _texture(width=480, height=360, seed=0):
    noise = np.random.default_rng(seed).random((height // 6, width // 6), dtype=np.float32) * 255
    return cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)


def test_a_good_sequence_gives_facts_and_no_warnings(room):
    report = inspect_sequence(room)

    assert (report.frames, report.width, report.height, report.layout) == (10, room.width, room.height, "eth3d-slam")
    assert report.rate_hz == pytest.approx(5.0)
    assert report.duration_s == pytest.approx(1.8)
    assert report.field_of_view_deg == pytest.approx(65, abs=0.1)
    assert report.ground_truth_frames == 10
    assert 0.5 < report.ground_truth_extent < 2
    assert report.median_shift_px > 5
    assert report.gaps == ()
    assert report.warnings == ()


def test_a_report_can_be_written_as_json(room):
    assert json.loads(json.dumps(asdict(inspect_sequence(room))))["camera"]["model"] == "PINHOLE"


def test_blurred_frames_are_named(room, tmp_path):
    pictures = [room.read_grey(frame) for frame in room.frames]
    pictures[4] = cv2.GaussianBlur(pictures[4], (0, 0), 4)

    assert "1 of 10 checked images are much less sharp" in _warnings(_load(tmp_path / "a", pictures))
    assert "(frames 4)" in _warnings(_load(tmp_path / "a", pictures))


def test_duplicates_are_named(room, tmp_path):
    pictures = [room.read_grey(frame) for frame in room.frames]
    pictures[3] = pictures[2]

    assert "1 of 9 checked images equal the next one exactly" in _warnings(_load(tmp_path / "a", pictures))


def test_images_without_texture_are_named(tmp_path):
    flat = [np.full((120, 160), 120 + n, np.uint8) for n in range(5)]

    found = _warnings(_load(tmp_path / "a", flat))

    assert "5 of 5 checked images are poor in texture" in found
    assert "4 of 4 checked images share fewer than 40 features with the next one" in found


def test_dark_and_bright_images_are_named(tmp_path):
    dark = (_texture() // 12).astype(np.uint8)

    found = _warnings(_load(tmp_path / "a", [dark, dark, 255 - dark, 255 - dark]))

    assert "2 of 4 checked images are very dark" in found
    assert "2 of 4 checked images are very bright" in found


def test_a_camera_that_only_turns_is_noticed(tmp_path):
    camera = Camera("PINHOLE", 480, 360, (400.0, 400.0, 240.0, 180.0))
    intrinsics = np.array([[400.0, 0, 239.5], [0, 400, 179.5], [0, 0, 1]])
    scene = _texture(960, 720)
    pictures = []
    for angle in np.deg2rad([0.0, 1.5, 3.0, 4.5, 6.0]):
        turn = cv2.Rodrigues(np.array([0.0, angle, 0.0]))[0]
        shift = np.array([[1.0, 0, -240], [0, 1, -180], [0, 0, 1]])
        mapping = intrinsics @ turn @ np.linalg.inv(intrinsics) @ shift
        pictures.append(cv2.warpPerspective(scene, mapping, (480, 360), flags=cv2.INTER_CUBIC))

    found = _warnings(_load(tmp_path / "a", pictures, camera=camera))

    assert "4 of 4 checked images differ from the next one by a turn of the camera only" in found


def test_a_camera_that_stands_still_is_noticed(tmp_path):
    rng = np.random.default_rng(0)
    still = [np.clip(_texture() + rng.normal(0, 2, (360, 480)), 0, 255).astype(np.uint8) for _ in range(5)]

    assert "4 of 4 checked images hardly differ from the next one" in _warnings(_load(tmp_path / "a", still))


def test_unknown_and_odd_intrinsics_are_noticed(room):
    odd = room.with_camera(Camera("PINHOLE", room.width, room.height, (60.0, 60.0, 20.0, 180.0)))

    assert "intrinsics are unknown" in _warnings(room.with_camera(None))
    assert "field of view of" in _warnings(odd)
    assert "principal point is far from the centre" in _warnings(odd)


def test_gaps_are_listed(room):
    late = [replace(frame, timestamp=frame.timestamp + 7 * (frame.frame_id > 3)) for frame in room.frames]

    report = inspect_sequence(replace(room, frames=tuple(late)))

    assert [(gap.before, gap.after) for gap in report.gaps] == [(3, 4)]
    assert report.gaps[0].seconds == pytest.approx(7.2)
    assert "1 gap;" in "\n".join(report.warnings)


def test_ground_truth_that_is_partial_or_straight_is_noticed(room):
    partial = replace(room, ground_truth=room.ground_truth.select(np.arange(6)))
    line = replace(room.ground_truth, positions=np.outer(np.arange(10.0), [1, 2, 3]))

    assert "ground truth covers 6 of 10 images" in _warnings(partial)
    assert "lie on a line" in _warnings(replace(room, ground_truth=line))


def test_too_few_images_are_noticed(room):
    few = load_sequence(room.root, selection=Selection(max_frames=3))

    assert "3 images are too few" in _warnings(few)
    assert "1 image is too few" in _warnings(load_sequence(room.root, selection=Selection(max_frames=1)))
