"""Columns of a text trajectory as its header names them, whatever separates them, and the unit of its times."""

from pathlib import Path

import numpy as np
import pytest

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory import read_trajectory

START_NS = 1403636579763555584
QUATERNION = (0.1, -0.3, 0.5, 0.8)
VALUES = {
    "x": "1.5",
    "y": "-2",
    "z": "3e-1",
    "qx": "0.1005037815259212",
    "qy": "-0.3015113445777636",
    "qz": "0.502518907629606",
    "qw": "0.8040302522073697",
}


def written(folder: Path, header: str, order: str, separator: str = ",", scale: float = 1e9) -> Path:
    """Write three poses 50 ms apart, whose columns have the order of ``order``; ``-`` is a column of something else."""
    lines = [header] if header else []
    for pose in range(3):
        time = (
            str(round((START_NS + 50_000_000 * pose) * scale / 1e9))
            if scale > 1
            else f"{(START_NS + 5e7 * pose) / 1e9:.9f}"
        )
        values = {**VALUES, "t": time, "-": "7", "x": f"{1.5 + pose * pose}"}
        lines.append(separator.join(values[role] for role in order.split()))
    file = folder / "poses.txt"
    file.write_text("\n".join(lines) + "\n")
    return file


def check(file: Path, delimiter: str | None = None) -> None:
    found = read_trajectory(file, delimiter=delimiter)

    np.testing.assert_allclose(found.timestamps, [START_NS / 1e9 + 0.05 * pose for pose in range(3)], rtol=0, atol=1e-6)
    np.testing.assert_array_equal(found.positions, [[1.5, -2, 0.3], [2.5, -2, 0.3], [5.5, -2, 0.3]])
    np.testing.assert_allclose(found.quaternions, np.tile(np.array(QUATERNION) / np.linalg.norm(QUATERNION), (3, 1)))


@pytest.mark.parametrize(
    ("header", "order"),
    [
        ("#timestamp,px,py,pz,qw,qx,qy,qz", "t x y z qw qx qy qz"),
        ("#ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw", "t x y z qx qy qz qw"),
        ("ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw", "t x y z qx qy qz qw"),
        (
            "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
            "v_RS_R_x [m s^-1], b_w_RS_S_x [rad s^-1]",
            "t x y z qw qx qy qz - -",
        ),
        ("num,t,x,y,z,qx,qy,qz,qw", "- t x y z qx qy qz qw"),
        ("qw,qx,qy,qz,x,y,z,time", "qw qx qy qz x y z t"),
        (
            "%time,field.header.seq,field.header.stamp,field.pose.position.x,field.pose.position.y,field.pose.position.z,"
            "field.pose.orientation.x,field.pose.orientation.y,field.pose.orientation.z,field.pose.orientation.w",
            "- - t x y z qx qy qz qw",
        ),
        ('"Timestamp","PosX","PosY","PosZ","QuatX","QuatY","QuatZ","QuatW"', "t x y z qx qy qz qw"),
        ("# timestamp tx ty tz qx qy qz qw", "t x y z qx qy qz qw"),
        ("# written by a program\n# timestamp tx ty tz qw qx qy qz\n# metres", "t x y z qw qx qy qz"),
    ],
)
def test_columns_are_what_the_header_calls_them(tmp_path: Path, header: str, order: str) -> None:
    check(written(tmp_path, header, order))


@pytest.mark.parametrize("separator", [",", ", ", ";", "\t", " ", "   "])
@pytest.mark.parametrize("comment", ["# ", ""])
def test_whatever_separates_the_columns_is_found(tmp_path: Path, separator: str, comment: str) -> None:
    check(written(tmp_path, f"{comment}timestamp tx ty tz qx qy qz qw", "t x y z qx qy qz qw", separator, 1.0))


@pytest.mark.parametrize("scale", [1.0, 1e3, 1e6, 1e9])
def test_times_since_1970_show_their_unit(tmp_path: Path, scale: float) -> None:
    found = read_trajectory(written(tmp_path, "", "t x y z qx qy qz qw", " ", scale))

    np.testing.assert_allclose(found.timestamps, START_NS / 1e9 + np.arange(3) / 20, rtol=0, atol=1e-3)


@pytest.mark.parametrize(
    ("name", "unit"), [("timestamp [ms]", 1e3), ("time_us", 1e6), ("t(ns)", 1e9), ("stamp [s]", 1.0), ("nsec", 1e9)]
)
def test_the_header_names_the_unit_of_times(tmp_path: Path, name: str, unit: float) -> None:
    file = tmp_path / "poses.csv"
    file.write_text(f"{name},x,y,z,qx,qy,qz,qw\n1000,0,0,0,0,0,0,1\n3000,0,0,0,0,0,0,1\n")

    assert read_trajectory(file).timestamps.tolist() == [1000 / unit, 3000 / unit]


def test_numbers_of_frames_stand_for_times_where_there_are_none(tmp_path: Path) -> None:
    file = tmp_path / "poses.csv"
    file.write_text("frame_id;x;y;z;qx;qy;qz;qw;score\n0;0;0;0;0;0;0;1;9\n7;0;0;0;0;0;0;1;9\n")

    assert read_trajectory(file).timestamps.tolist() == [0, 7]


def test_a_delimiter_that_is_given_is_taken(tmp_path: Path) -> None:
    check(written(tmp_path, "# timestamp|tx|ty|tz|qx|qy|qz|qw", "t x y z qx qy qz qw", "|", 1.0), delimiter="|")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("1,0,0,0,0,0,0,1\n", "line 1: expected a header that says whether qw comes first"),
        ("# t x y z q0 q1 q2 q3\n1 0 0 0 0 0 0 1\n", "line 2: the header above it, 't x y z q0 q1 q2 q3', does not"),
        ("# t x y z x y z qw qx\n1 0 0 0 0 0 0 1 2\n", "does not name exactly one column as x, y, z, qy, qz; call"),
        ("time,stamp_a,x,y,z,qx,qy,qz\n1,0,0,0,0,0,0,1\n", "exactly one column as qw"),
        ("t,x,y,z,qx,qy,qz,qw\n1,0,0,0,0,0,0,1\n2,0,0,0\n", "line 3: expected"),
        ("18295873486192640 0 0 0 0 0 0 1\n18295873486192641 0 0 0 0 0 0 1\n", "line 2: .* need.* more than 53 bits"),
        ("18295873486192641 0 0 0 0 0 0 1\n18295873486192648 0 0 0 0 0 0 1\n", "line 1: .* needs more than 53 bits"),
        ("140363657976355558 0 0 0 0 0 0 1\n140363657976355559 0 0 0 0 0 0 1\n", "line 2: .* need more than 53 bits"),
    ],
)
def test_columns_that_nothing_explains_are_refused(tmp_path: Path, text: str, reason: str) -> None:
    (tmp_path / "poses.txt").write_text(text)

    with pytest.raises(TrajectoryError, match=reason):
        read_trajectory(tmp_path / "poses.txt")


def test_whole_numbers_of_53_bits_keep_every_digit(tmp_path: Path) -> None:
    (tmp_path / "poses.txt").write_text("9007199254740990 0 0 0 0 0 0 1\n9007199254740991 0 0 0 0 0 0 1\n")

    assert read_trajectory(tmp_path / "poses.txt").timestamps.tolist() == [9007199254740990, 9007199254740991]


def test_a_header_that_names_some_columns_agrees_with_a_format_that_is_given(tmp_path: Path) -> None:
    (tmp_path / "poses.txt").write_text("ts (ms),x,y,z,a,b,c,d\n5,0,0,0,0,0,0,1\n")

    found = read_trajectory(tmp_path / "poses.txt", "tum")

    assert (found.timestamps.tolist(), found.quaternions.tolist()) == ([0.005], [[0, 0, 0, 1]])
    (tmp_path / "poses.txt").write_text("ts (ms),x,z,y,a,b,c,d\n5,0,0,0,0,0,0,1\n")
    with pytest.raises(TrajectoryError, match="does not name exactly one column as qx"):
        read_trajectory(tmp_path / "poses.txt", "tum")
