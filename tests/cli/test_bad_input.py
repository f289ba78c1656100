"""Bad input is one sentence on stderr, exit code 1, and nothing lost."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.cli.conftest import Cli, Said

CREATE = ("study", "create", "small", "-p", "analytic", "-s", "room", "-n", "3")
AXIS = ("-r", "filter.max_error=1e-3:1e-1:log")


def _assert_one_sentence(said: Said, *words: str) -> None:
    assert said.code == 1, said.err
    lines = [line for line in said.err.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1, said.err
    assert "Traceback" not in said.err
    for word in words:
        assert word in lines[0], lines[0]


def test_an_unknown_option_is_named_with_the_nearest_known(cli: Cli, room: Path) -> None:
    _assert_one_sentence(
        cli(*CREATE, "-r", "filter.max_eror=1e-3:1e-1"), "filter.max_eror", "did you mean 'filter.max_error'"
    )


def test_a_value_of_the_wrong_type_says_which_type_is_right(cli: Cli, room: Path) -> None:
    _assert_one_sentence(cli(*CREATE, *AXIS, "-o", "tracks.min_length=2.5"), "a whole number", "2.5")


def test_option_names_without_quotes_are_one_fault_each(cli: Cli, room: Path) -> None:
    Path("bare.toml").write_text(
        """
        name = "bare"
        pipeline = { name = "analytic", options = { robust.scale = 1e-1 } }
        sequences = [{ name = "room", path = "room" }]
        [space]
        filter.max_error = { low = 1e-3, high = 1e-1 }
        """
    )

    _assert_one_sentence(
        cli("study", "create", "bare.toml"), "2 faults", '"robust.scale" = ...', '"filter.max_error" = ...'
    )


def test_what_a_study_lacks_is_named_by_its_flags_where_it_comes_from_flags(cli: Cli, room: Path) -> None:
    Path("small.toml").write_text('pipeline = { name = "analytic" }\nname = "small"\n')

    _assert_one_sentence(cli("study", "create", "small", "-p", "analytic"), "--sequence", "--range", "--values")
    from_file = cli("study", "create", "small.toml")
    _assert_one_sentence(from_file, "'space' is missing")
    assert "--range" not in from_file.err


@pytest.mark.parametrize(
    ("section", "flags"),
    [
        ('pipeline = "analytic"', ("-p", "analytic")),
        ('pipeline = "analytic"', ("-o", "tracks.min_length=3")),
        ("pipeline.options = 3", ("-o", "tracks.min_length=3")),
        ('space = "all"', AXIS),
        ("gtf = 3", ("-K", "3")),
    ],
)
def test_a_section_that_is_no_table_is_named_also_where_flags_add_to_it(
    section: str, flags: tuple[str, ...], cli: Cli, room: Path
) -> None:
    Path("small.toml").write_text(f'name = "small"\n{section}\n')

    _assert_one_sentence(cli("study", "create", "small.toml", *flags), "should be a table")


def test_one_trial_is_no_table_of_trials(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS)

    said = cli("study", "export", "small", "--format", "csv", "--trial", "1")

    _assert_one_sentence(said, "--format csv writes all trials", "--format json")
    assert said.out == ""


def test_ctrl_c_before_a_command_begins_says_nothing(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("gtf_tune.cli.main.app", interrupted)

    assert cli("study", "list") == Said(130, "", "")


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        ((*AXIS, "-r", "filter.max_error=1e-4:1"), "--range is given 2 times for 'filter.max_error'"),
        ((*AXIS, "-v", "filter.max_error=0.01,0.1"), "--range or --values is given 2 times for 'filter.max_error'"),
        ((*AXIS, "-o", "robust.scale=1", "-o", "robust.scale=2"), "--option is given 2 times for 'robust.scale'"),
        ((*AXIS, "--max-image-size", "64", "--frames", "max_image_size=32"), "--max-image-size and --frames"),
    ],
)
def test_flags_that_contradict_each_other_are_refused(flags: tuple[str, ...], said: str, cli: Cli, room: Path) -> None:
    _assert_one_sentence(cli(*CREATE, *flags), said)


def test_an_unknown_key_of_any_name_is_told(cli: Cli, room: Path) -> None:
    _assert_one_sentence(cli(*CREATE, *AXIS, "--side", "section=3"), "unknown key 'side_metric.section'")


def test_an_empty_folder_is_named(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "room").mkdir()

    _assert_one_sentence(cli(*CREATE, *AXIS), "room", "image")


def test_one_corrupt_image_is_named(cli: Cli, room: Path) -> None:
    (room / "rgb" / "000003.png").write_bytes(b"not an image")

    _assert_one_sentence(cli(*CREATE, *AXIS), "000003.png")


def test_no_clean_runs_are_refused(cli: Cli, room: Path) -> None:
    _assert_one_sentence(cli(*CREATE, *AXIS, "--clean-runs", "0"), "clean_runs", "not 0")


def test_a_negative_sigma_is_refused(cli: Cli, room: Path) -> None:
    _assert_one_sentence(cli(*CREATE, *AXIS, "--noise-sigma", "-1"), "noise_sigma", "not -1")


def test_a_definition_with_three_faults_names_all_three(cli: Cli, room: Path) -> None:
    Path("bad.toml").write_text(
        """
        name = "bad"
        [pipeline]
        name = "analytic"
        options = { "robust.kernell" = "huber" }
        [[sequences]]
        name = "room"
        path = "room"
        [space]
        "filter.max_error" = { low = 1e-3, high = 1e-1, logg = true }
        [gtf]
        noise_sigma = -3.0
        """
    )

    _assert_one_sentence(cli("study", "create", "bad.toml"), "3 faults", "robust.kernell", "logg", "noise_sigma")


def test_a_storage_that_is_not_sqlite_is_left_alone(cli: Cli, room: Path) -> None:
    Path("notes.txt").write_text("these are my notes, at least a hundred bytes of them\n" * 10)
    before = Path("notes.txt").read_bytes()

    _assert_one_sentence(cli(*CREATE, *AXIS, "--storage", "notes.txt"), "notes.txt")
    assert Path("notes.txt").read_bytes() == before


def test_a_folder_that_cannot_be_written_is_named(cli: Cli, room: Path) -> None:
    _assert_one_sentence(cli(*CREATE, *AXIS, "--storage", "/proc/study.db"), "/proc")


def test_a_study_that_exists_is_kept(cli: Cli, room: Path) -> None:
    assert cli(*CREATE, *AXIS).code == 0

    _assert_one_sentence(cli(*CREATE, *AXIS), "'small' exists already", "resume")


def test_pixels_that_changed_since_the_study_began_are_refused(cli: Cli, room: Path) -> None:
    assert cli(*CREATE, *AXIS).code == 0
    cv2.imwrite(str(room / "rgb" / "000002.png"), np.full((16, 20), 99, dtype=np.uint8))

    _assert_one_sentence(cli("study", "run", "small"), "room", "other pixels")


def test_an_unknown_study_is_named_with_the_nearest(cli: Cli, room: Path) -> None:
    assert cli(*CREATE, *AXIS).code == 0

    _assert_one_sentence(cli("study", "run", "smal"), "'smal'", "did you mean 'small'")


def test_a_storage_that_does_not_exist_is_not_created_by_reading(cli: Cli, tmp_path: Path) -> None:
    _assert_one_sentence(cli("study", "list", "--storage", "none.db"), "none.db")
    assert not (tmp_path / "none.db").exists()


@pytest.mark.parametrize(
    "text", ["filter.max_error", "filter.max_error=", "filter.max_error=1:2:3:4", "filter.max_error=1e-1:log"]
)
def test_a_malformed_range_shows_the_right_form(cli: Cli, room: Path, text: str) -> None:
    _assert_one_sentence(cli(*CREATE, "-r", text), "NAME=")


def test_a_place_that_cannot_take_an_export_is_named(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, "-K", "1")
    cli("study", "run", "small", "--jobs", "1")
    Path("taken").write_text("a file in the way")

    for format_, place in (("tum", "taken"), ("tum", "taken/below"), ("json", "taken/below"), ("csv", "room")):
        said = cli("study", "export", "small", "--format", format_, "--output", place)
        _assert_one_sentence(said, f"cannot write {place} (", "choose another place with --output")
    assert Path("taken").read_text() == "a file in the way"


def test_a_place_where_the_demo_cannot_write_is_one_sentence(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")

    _assert_one_sentence(cli("demo", "--folder", "file/demo"), "cannot write the sequence")
