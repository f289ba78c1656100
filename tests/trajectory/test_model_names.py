"""Frame ids and times that the names of a model's images hold."""

from pathlib import Path

import numpy as np
import pytest

from gtf_tune.trajectory import Trajectory, read_trajectory


def model(names: list[str], folder: Path) -> Trajectory:
    (folder / "images.txt").write_text("".join(f"1 1 0 0 0 {n} 0 {n * n} 1 {name}\n\n" for n, name in enumerate(names)))
    return read_trajectory(folder)


@pytest.mark.parametrize(
    ("names", "ids"),
    [
        (["frame_00012.jpg", "frame_00013.jpg", "frame_00021.jpg"], [12, 13, 21]),
        (["rgb/IMG_7.png", "rgb/IMG_9.png", "rgb/IMG_10.png"], [7, 9, 10]),
        (["1403636579763555584.png", "1403636579813555456.png"], [1403636579763555584, 1403636579813555456]),
        (["9223372036854775806.png", "9223372036854775807.png"], [2**63 - 2, 2**63 - 1]),
    ],
)
def test_numbers_at_the_end_of_names_are_frame_ids(tmp_path: Path, names: list[str], ids: list[int]) -> None:
    found = model(names, tmp_path)

    assert found.frame_ids.tolist() == ids
    assert not found.ids_are_counted


@pytest.mark.parametrize(
    "names",
    [
        ["a1.png", "b2.png"],
        ["left/1.png", "right/1.png"],
        ["9223372036854775807.png", "9223372036854775808.png"],
        ["x.png", "y.png"],
    ],
)
def test_names_without_one_number_each_are_only_counted(tmp_path: Path, names: list[str]) -> None:
    assert model(names, tmp_path).ids_are_counted


@pytest.mark.parametrize(
    ("names", "times"),
    [
        (["1305031102.175304.png", "1305031102.211214.png"], [1305031102.175304, 1305031102.211214]),
        (["7054.443252.png", "7054.480193.png"], [7054.443252, 7054.480193]),
        (
            ["1403636579763555584.png", "1403636579813555456.png"],
            [1403636579763555584 / 1e9, 1403636579813555456 / 1e9],
        ),
        (["1403636579763555.png", "1403636579813555.png"], [1403636579763555 / 1e6, 1403636579813555 / 1e6]),
    ],
)
def test_images_called_by_times_have_these(tmp_path: Path, names: list[str], times: list[float]) -> None:
    found = model(names, tmp_path)

    assert found.has_timestamps
    assert found.timestamps.tolist() == times


@pytest.mark.parametrize("names", [["000012.png", "000013.png"], ["frame_1.5.png", "frame_1.6.png"]])
def test_other_names_hold_no_times(tmp_path: Path, names: list[str]) -> None:
    found = model(names, tmp_path)

    assert not found.has_timestamps
    np.testing.assert_array_equal(found.timestamps, found.frame_ids)
