"""Fail when a source file has grown past 400 lines."""

import subprocess
import sys
from pathlib import Path

LIMIT = 400


def main() -> int:
    listed = subprocess.run(["git", "ls-files", "*.py"], capture_output=True, text=True, check=True)
    sizes = {name: len(Path(name).read_text(encoding="utf-8").splitlines()) for name in listed.stdout.split()}
    long = {name: size for name, size in sizes.items() if size > LIMIT}
    for name, size in long.items():
        sys.stderr.write(f"{name} has {size} lines, more than {LIMIT}; split it by idea\n")
    return 1 if long or not sizes else 0


if __name__ == "__main__":
    sys.exit(main())
