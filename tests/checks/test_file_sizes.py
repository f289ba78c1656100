from pathlib import Path

from tests.checks.file_sizes import MOST_BYTES, MOST_LINES, MOST_MODULES, full_folders, heavy_files, long_files


def test_a_file_may_have_as_many_lines_as_the_limit_and_no_more(tmp_path: Path) -> None:
    fits, long = tmp_path / "fits.py", tmp_path / "long.py"
    fits.write_text("\n" * MOST_LINES)
    long.write_text("\n" * (MOST_LINES + 1))

    (fault,) = long_files([fits, long])

    assert fault.startswith(f"{long} has 401 lines, more than 400")


def test_a_folder_of_the_package_may_have_as_many_modules_as_the_limit_and_no_more() -> None:
    modules = [Path(f"gtf_tune/room/{number}.py") for number in range(MOST_MODULES)]
    init = Path("gtf_tune/room/__init__.py")
    elsewhere = [Path(f"tests/room/{number}.py") for number in range(MOST_MODULES + 1)]

    assert full_folders([*modules, init, *elsewhere]) == []
    (fault,) = full_folders([*modules, init, Path("gtf_tune/room/more.py")])
    assert fault.startswith("gtf_tune/room has 21 modules, more than 20")


def test_a_file_that_is_too_heavy_for_the_history_is_named(tmp_path: Path) -> None:
    light, heavy = tmp_path / "light", tmp_path / "heavy"
    for path, size in ((light, MOST_BYTES), (heavy, MOST_BYTES + 1)):
        with path.open("wb") as file:
            file.truncate(size)

    (fault,) = heavy_files([light, heavy])

    assert fault.startswith(f"{heavy} has {MOST_BYTES + 1} bytes")
