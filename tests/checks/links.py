"""Refuse links of Markdown pages to files or headings of the repository that do not exist."""

import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_CODE = re.compile(r"^```.*?^```$|`[^`\n]+`", re.MULTILINE | re.DOTALL)
_HEADING = re.compile(r"^#+ +(.+)$", re.MULTILINE)


def broken_links(pages: list[Path]) -> list[str]:
    """Return a sentence for every relative link that leads nowhere."""
    return [fault for page in pages for fault in _faults(page)]


def anchor(heading: str) -> str:
    """Return the name by which a heading is linked."""
    words = re.sub(r"[^\w\s-]", "", heading.strip().lower().replace("`", ""))
    return re.sub(r"[\s]+", "-", words).strip("-")


def _faults(page: Path) -> Iterator[str]:
    for link in _LINK.findall(_CODE.sub("", page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, name = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if not target.exists():
            yield f"{page}: there is no {link}"
        elif name and target.suffix == ".md" and name not in _anchors(target):
            yield f"{page}: {path or 'the page'} has no heading #{name}"


@cache
def _anchors(page: Path) -> frozenset[str]:
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    return frozenset(anchor(heading) for heading in _HEADING.findall(text))


def main() -> None:
    """Print what is broken and exit with 1 if anything is."""
    listed = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    faults = broken_links([ROOT / name for name in listed.splitlines()])
    sys.stdout.write("".join(f"{fault}\n" for fault in faults))
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
