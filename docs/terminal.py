"""Draw what a command printed on a terminal.

``gtf-tune tune photos --minutes 10 2>&1 | python docs/terminal.py "gtf-tune tune photos --minutes 10"`` keeps what was
printed in data/terminal.json; `generate.py` draws the figure from that.
"""

import io
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.terminal_theme import MONOKAI
from rich.text import Text

DATA = Path(__file__).parent / "data" / "terminal.json"
_COLUMNS = 118


def main(command: str) -> None:
    """Keep a command and what it printed, from stdin."""
    printed = {"command": command, "lines": sys.stdin.read().splitlines()}
    DATA.write_text(json.dumps(printed, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def draw_terminal(printed: Mapping[str, Any]) -> str:
    """Return an SVG of a terminal with a ``command`` and the ``lines`` that it printed."""
    console = Console(record=True, width=_COLUMNS, file=io.StringIO(), force_terminal=True, color_system="truecolor")
    console.print(Text.assemble(("$ ", "bold green"), (str(printed["command"]), "bold")))
    for line in printed["lines"]:
        phase, colon, rest = str(line).partition(": ")
        text = Text.assemble((phase + colon, "cyan"), rest) if colon and " " not in phase else Text(str(line))
        console.print(text, highlight=False)
    return console.export_svg(title="gtf-tune", theme=MONOKAI, unique_id="terminal") + "\n"


if __name__ == "__main__":
    main(*sys.argv[1:])
