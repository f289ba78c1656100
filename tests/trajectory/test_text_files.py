import os
from pathlib import Path

import numpy as np
import pytest
from evo.tools import file_interface
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory import Trajectory, read_trajectory, write_kitti, write_tum

TUM_LINE = "1.5 1 2 3 0 0 0 1\n"
FORMATS = ["auto", "tum", "kitti", "euroc"]


def random_trajectory(count: int = 12, seed: int = 0, size: float = 1.0) -> Trajectory:
    rng = np.random.default_rng(seed)
    return Trajectory(
        np.arange(count),
        1.4e9 + np.cumsum(rng.uniform(0.01, 0.1, count)),
        size * rng.normal(size=(count, 3)),
        rng.normal(size=(count, 4)),
    )


def written(folder: Path, text: str, name: str = "poses.txt") -> Path:
    file = folder / name
    file.write_text(text)
    return file


@pytest.mark.parametrize("size", [1e-8, 1.0, 1e8])
def test_tum_files_keep_every_bit(tmp_path, size):
    trajectory = random_trajectory(size=size)

    write_tum(trajectory, tmp_path / "a.txt")
    back = read_trajectory(tmp_path / "a.txt")

    for name in ("frame_ids", "timestamps", "positions", "quaternions"):
        np.testing.assert_array_equal(getattr(back, name), getattr(trajectory, name))


def test_kitti_files_keep_the_poses(tmp_path):
    trajectory = random_trajectory()

    write_kitti(trajectory, tmp_path / "a.txt")
    back = read_trajectory(tmp_path / "a.txt")

    np.testing.assert_array_equal(back.positions, trajectory.positions)
    np.testing.assert_allclose((back.rotations.inv() * trajectory.rotations).magnitude(), 0, atol=1e-14)
    assert back.timestamps.tolist() == list(range(12))


def test_evo_reads_what_is_written(tmp_path):
    trajectory = random_trajectory()
    write_tum(trajectory, tmp_path / "tum.txt")
    write_kitti(trajectory, tmp_path / "kitti.txt")

    tum = file_interface.read_tum_trajectory_file(tmp_path / "tum.txt")
    kitti = file_interface.read_kitti_poses_file(tmp_path / "kitti.txt")

    np.testing.assert_array_equal(tum.timestamps, trajectory.timestamps)
    np.testing.assert_array_equal(tum.positions_xyz, trajectory.positions)
    np.testing.assert_array_equal(tum.orientations_quat_wxyz, np.roll(trajectory.quaternions, 1, axis=1))
    np.testing.assert_allclose(
        np.array(kitti.poses_se3)[:, :3, :3], trajectory.rotations.as_matrix(), rtol=0, atol=1e-15
    )


def test_euroc_ground_truth_is_read_like_evo_does(tmp_path):
    rng = np.random.default_rng(0)
    stamps = 1403636580838555648 + 5_000_000 * np.arange(6)
    turns = Rotation.random(6, random_state=0).as_quat()
    values = np.column_stack([rng.normal(size=(6, 3)), np.roll(turns, 1, axis=1), rng.normal(size=(6, 9))]).tolist()
    rows = [",".join(map(str, [stamp, *row])) for stamp, row in zip(stamps.tolist(), values, strict=True)]
    file = written(tmp_path, "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m]\n" + "\r\n".join(rows), "data.csv")

    found, peer = read_trajectory(file), file_interface.read_euroc_csv_trajectory(file)

    np.testing.assert_array_equal(found.timestamps, peer.timestamps)
    np.testing.assert_array_equal(found.positions, peer.positions_xyz)
    np.testing.assert_allclose(found.quaternions, np.roll(peer.orientations_quat_wxyz, -1, axis=1), atol=1e-15)
    np.testing.assert_allclose(np.diff(found.timestamps), 0.005, atol=3e-7)


def test_real_ground_truth_is_read_like_evo_does():
    data = os.environ.get("GTF_TUNE_DATA")
    if not data or not (files := sorted(Path(data).glob("*/groundtruth.txt"))):
        pytest.skip("GTF_TUNE_DATA does not name a folder with */groundtruth.txt")
    for file in files:
        found, peer = read_trajectory(file), file_interface.read_tum_trajectory_file(file)

        np.testing.assert_array_equal(found.timestamps, peer.timestamps)
        np.testing.assert_array_equal(found.positions, peer.positions_xyz)
        np.testing.assert_allclose(found.quaternions, np.roll(peer.orientations_quat_wxyz, -1, axis=1), atol=1e-7)


def test_comments_blank_lines_and_windows_line_ends_are_skipped(tmp_path):
    file = written(tmp_path, "\ufeff# a comment\r\n\r\n1 0 0 0 0 0 0 1\r\n  # another\n2 0 0 0 0 0 0 1")

    assert read_trajectory(file).timestamps.tolist() == [1, 2]


@pytest.mark.parametrize(
    ("text", "format", "reason"),
    [
        (TUM_LINE + "2 1 2 3 0 0 0\n", "tum", "line 2: expected 8 numbers 'timestamp tx ty tz qx qy qz qw', not 7"),
        (TUM_LINE + "2 1 2 3 0 0 0 one\n", "tum", "line 2: expected 8 numbers .* 'one'"),
        (TUM_LINE + "\n2 1 nan 3 0 0 0 1\n", "tum", "line 3: .* NaN or infinite"),
        (TUM_LINE + "2 1 1e999 3 0 0 0 1\n", "tum", "line 2: .* NaN or infinite"),
        (TUM_LINE + TUM_LINE, "tum", "line 2: expected a later timestamp than the 1.5"),
        (TUM_LINE + "1.25 1 2 3 0 0 0 1\n", "tum", "line 2: expected a later timestamp .* not 1.25"),
        (TUM_LINE + "2 1 2 3 0 0 0 0\n", "tum", "line 2: expected a unit quaternion, but its length is 0"),
        (TUM_LINE + "2 0 0 0 1 1 2 3\n", "tum", "line 2: expected a unit quaternion, but its length is 3.8"),
        ("# nothing\n", "tum", "at least one pose in"),
        ("", "auto", "at least one pose in"),
        ("1 2 3\n", "auto", r"line 1: expected 8 columns \(TUM\), 12 \(KITTI\) or a header that names them, not 3"),
        ("1 0 0 0 0 1 0 0 0 0 1\n", "kitti", "line 1: expected the 12 numbers of a 3x4 matrix, not 11"),
        ("1 0 0 0 0 1 0 0 0 0 x 0\n", "kitti", "line 1: .* 'x'"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0\n", "kitti", "line 1: expected a rotation"),
        ("2 0 0 0 0 2 0 0 0 0 2 0\n", "kitti", "line 1: expected a rotation"),
        ("1e300 0 0 0 0 2 0 0 0 0 2 0\n", "kitti", "line 1: expected a rotation"),
        ("1,2,3\n", "euroc", "line 1: expected at least 8 columns .* not 3"),
        ("1.5,0,0,0,1,0,0,0\n", "euroc", "line 1: expected a timestamp in whole nanoseconds, not '1.5'"),
        ("9" * 400 + ",0,0,0,1,0,0,0\n", "euroc", "line 1: expected a timestamp in whole nanoseconds"),
        ("5,0,0,0,1,0,0,inf\n", "euroc", "line 1: .* NaN or infinite"),
        (TUM_LINE, "toml", "one of the formats auto, tum, .*, not 'toml'"),
    ],
)
def test_malformed_files_are_refused_with_file_and_line(tmp_path, text, format, reason):
    file = written(tmp_path, text)

    with pytest.raises(TrajectoryError, match=reason) as caught:
        read_trajectory(file, format)

    assert format == "toml" or "poses.txt" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_cannot_be_read_say_why(tmp_path):
    with pytest.raises(TrajectoryError, match=r"missing\.txt is not \(No such file"):
        read_trajectory(tmp_path / "missing.txt")
    with pytest.raises(TrajectoryError, match=r"is not \(Is a directory"):
        read_trajectory(tmp_path, "tum")
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(TrajectoryError, match="not UTF-8 from byte 0"):
        read_trajectory(tmp_path / "binary")


def test_files_that_cannot_be_written_say_why(tmp_path):
    for write in (write_tum, write_kitti):
        with pytest.raises(TrajectoryError, match="No such file"):
            write(random_trajectory(), tmp_path / "missing" / "a.txt")


def test_the_empty_trajectory_is_written_but_not_read(tmp_path):
    for write in (write_tum, write_kitti):
        write(Trajectory.empty(), tmp_path / "a.txt")

        with pytest.raises(TrajectoryError, match="at least one pose"):
            read_trajectory(tmp_path / "a.txt")


TOKENS = st.one_of(
    st.floats(width=32).map(str),
    st.integers().map(str),
    st.sampled_from(["0", "1", "0.5", "#", "nan", "-inf", "1e999"]),
)
LINES = st.lists(TOKENS, max_size=14).flatmap(lambda row: st.sampled_from([" ", ",", "\t"]).map(lambda s: s.join(row)))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(
    content=st.one_of(st.binary(max_size=300), st.lists(LINES, max_size=5).map(lambda rows: "\n".join(rows).encode()))
)
def test_any_bytes_are_read_or_refused(tmp_path, content):
    file = tmp_path / "fuzz.txt"
    file.write_bytes(content)

    for format in FORMATS:
        try:
            trajectory = read_trajectory(file, format)
        except TrajectoryError:
            continue
        assert len(trajectory) > 0


def test_kitti_files_may_hold_whole_matrices(tmp_path):
    path = tmp_path / "poses.txt"
    write_kitti(random_trajectory(4), path)
    expected = read_trajectory(path)
    path.write_text("".join(f"{line} 0 0 0 1\n" for line in path.read_text().splitlines()))

    np.testing.assert_array_equal(read_trajectory(path).positions, expected.positions)
    path.write_text(path.read_text().replace("0 0 0 1\n", "0 0 1 0\n"))
    with pytest.raises(TrajectoryError, match=r"line 1: expected 0 0 0 1 as the last row of a 4x4 matrix"):
        read_trajectory(path)


def test_a_header_counts_more_than_the_number_of_columns(tmp_path):
    path = tmp_path / "odometry.csv"
    header = "time,seq,stamp,frame,x,y,z,qx,qy,qz,qw,covariance"
    path.write_text(header + "\n" + "".join(f"{n},{n},{n},{n},{n},0,0,0,0,0,1,7\n" for n in range(4)))

    trajectory = read_trajectory(path)

    assert trajectory.positions[:, 0].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("lines", "hint"),
    [
        (["0,5 1,0 0 0 0 0 0 1,0"], "write decimal points, not commas"),
        (["0,5;1,0;0;0;0;0;0;1,0"], "write decimal points, not commas"),
        (["1.4e18 0 0 0 0 0 0 1", "1.4e18 1 0 0 0 0 0 1"], "drop the line, or write times with all their digits"),
        (["2 0 0 0 0 0 0 1", "1 1 0 0 0 0 0 1"], "sort the file"),
    ],
)
def test_what_other_programs_write_is_refused_with_what_to_do(tmp_path, lines, hint):
    path = tmp_path / "poses.txt"
    path.write_text("\n".join(lines))

    with pytest.raises(TrajectoryError, match=f"{hint}$"):
        read_trajectory(path)
