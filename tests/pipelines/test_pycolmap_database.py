"""Parts of COLMAP databases can be copied without touching the original."""

from pathlib import Path

import pycolmap
import pytest

from gtf_tune.pipelines.colmap.database import add_rows, copy_database, copy_rows, make_plain


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Return a closed database with five images, keypoints, matches and verified pairs."""
    folder = tmp_path / "source"
    folder.mkdir()
    database = pycolmap.Database.open(folder / "database.db")
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, 5
    pycolmap.synthesize_dataset(options, database)
    database.close()
    make_plain(folder / "database.db")
    return folder / "database.db"


def counts(path: Path) -> dict[str, int]:
    database = pycolmap.Database.open(path)
    try:
        return {
            "images": database.num_images(),
            "keypoints": database.num_keypoints(),
            "matches": database.num_matches(),
            "inliers": database.num_inlier_matches(),
        }
    finally:
        database.close()


def test_whole_copies_have_everything(source: Path, tmp_path: Path) -> None:
    copy_database(source, tmp_path / "copy.db")

    assert counts(tmp_path / "copy.db") == counts(source)
    assert all(counts(source).values())


def test_tables_can_be_left_out(source: Path, tmp_path: Path) -> None:
    copy_database(source, tmp_path / "copy.db", without={"matches"})

    assert counts(tmp_path / "copy.db") == counts(source) | {"matches": 0}


def test_single_tables_can_be_taken_out_and_put_back(source: Path, tmp_path: Path) -> None:
    copy_rows(source, tmp_path / "matches.db", "matches")
    copy_database(source, tmp_path / "copy.db", without={"matches"})
    only = counts(tmp_path / "matches.db")

    make_plain(tmp_path / "matches.db")
    add_rows(tmp_path / "matches.db", tmp_path / "copy.db", "matches")

    assert only == {"images": 0, "keypoints": 0, "matches": counts(source)["matches"], "inliers": 0}
    assert counts(tmp_path / "copy.db") == counts(source)


def test_reading_leaves_nothing_beside_the_source(source: Path, tmp_path: Path) -> None:
    before = source.read_bytes()

    copy_database(source, tmp_path / "copy.db")
    copy_rows(source, tmp_path / "matches.db", "matches")

    assert [path.name for path in source.parent.iterdir()] == ["database.db"]
    assert source.read_bytes() == before


def test_plain_databases_are_one_file_in_a_read_only_mode(tmp_path: Path) -> None:
    path = tmp_path / "database.db"
    pycolmap.Database.open(path).close()

    make_plain(path)

    rollback_journal = b"\x01\x01"
    assert path.read_bytes()[18:20] == rollback_journal
    assert [one.name for one in tmp_path.iterdir()] == ["database.db"]
