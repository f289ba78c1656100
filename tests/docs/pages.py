"""Find the commands and the code that the documentation shows."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
GENERATED = ("commands.md", "definition-reference.md")
GUIDE = sorted(path for path in (ROOT / "docs").glob("*.md") if path.name not in GENERATED)
PAGES = (ROOT / "README.md", *GUIDE)
MORE_PAGES = (ROOT / "CONTRIBUTING.md", ROOT / "studies" / "README.md", ROOT / "storage" / "README.md")

_FENCE = re.compile(r"^```(\w*)(?: title=\"([^\"]+)\")?[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_INDENTED = re.compile(r"^ {4}(gtf-tune .*)$", re.MULTILINE)
_INLINE = re.compile(r"`(gtf-tune [^`\n]+)`")


@dataclass(frozen=True)
class Snippet:
    """One thing that a page shows: a command line (``kind`` is "command") or a fenced block of a language.

    ``title`` is the name of the file that a block shows, if it is one.
    """

    page: Path
    position: int
    kind: str
    text: str
    title: str = ""

    @property
    def arguments(self) -> list[str]:
        """The words after ``gtf-tune``."""
        return shlex.split(self.text, comments=True)[1:]

    def __str__(self) -> str:
        return f"{self.page.name}: {self.text.splitlines()[0]}"


def snippets(page: Path) -> list[Snippet]:
    """Return what a page shows in blocks, in reading order."""
    text = page.read_text(encoding="utf-8").replace("\\\n", "  ")
    found = [
        Snippet(page, block.start(), block[1] or "text", block[3], block[2] or "") for block in _FENCE.finditer(text)
    ]
    for block in [one for one in found if one.kind in ("text", "bash", "console", "sh", "shell")]:
        lines = re.findall(r"^(?:\$ )?(gtf-tune .*)$", block.text, re.MULTILINE)
        found += [Snippet(page, block.position, "command", line) for line in lines]
    outside = _FENCE.sub(lambda block: " " * len(block[0]), text)
    found += [Snippet(page, line.start(), "command", line[1]) for line in _INDENTED.finditer(outside)]
    return sorted(found, key=lambda one: one.position)


def of_kind(kind: str, pages: tuple[Path, ...] = PAGES) -> list[Snippet]:
    """Return the snippets of a kind on all pages."""
    return [one for page in pages for one in snippets(page) if one.kind == kind]


def mentioned(page: Path) -> Iterator[Snippet]:
    """Yield the command lines inside the sentences of a page."""
    for match in _INLINE.finditer(page.read_text(encoding="utf-8")):
        yield Snippet(page, match.start(), "command", match[1])
