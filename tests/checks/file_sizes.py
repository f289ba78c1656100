"""Fail when a source file has more than 400 lines, a folder of the package more than 20 modules, or a file 2 MB."""

import subprocess
import sys
from collections import Counter
from pathlib import Path

MOST_LINES = 400
MOST_MODULES = 20
MOST_BYTES = 2_000_000
PACKAGE = Path("gtf_tune")


def main() -> int:
    listed = subprocess.run(["git", "ls-files", "-z"], capture_output=True, text=True, check=True)
    known = [Path(name) for name in listed.stdout.split("\0") if name and Path(name).exists()]
    files = [path for path in known if path.suffix == ".py"]
    faults = [*long_files(files), *full_folders(files), *heavy_files(known)]
    for fault in faults:
        sys.stderr.write(f"{fault}\n")
    return 1 if faults or not files else 0


def long_files(files: list[Path]) -> list[str]:
    """Return a sentence for every file that is too long."""
    sizes = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in files}
    return [
        f"{path} has {size} lines, more than {MOST_LINES}; split it by idea"
        for path, size in sizes.items()
        if size > MOST_LINES
    ]


def heavy_files(files: list[Path]) -> list[str]:
    """Return a sentence for every file, of whatever kind, that is too large to be kept in the history for ever."""
    sizes = {path: path.stat().st_size for path in files}
    return [
        f"{path} has {size} bytes; keep it out of the repository" for path, size in sizes.items() if size > MOST_BYTES
    ]


def full_folders(files: list[Path]) -> list[str]:
    """Return a sentence for every folder of the package that has too many modules."""
    counts = Counter(path.parent for path in files if PACKAGE in path.parents and path.name != "__init__.py")
    return [
        f"{folder} has {count} modules, more than {MOST_MODULES}; make a room of what belongs together"
        for folder, count in counts.items()
        if count > MOST_MODULES
    ]


if __name__ == "__main__":
    sys.exit(main())
