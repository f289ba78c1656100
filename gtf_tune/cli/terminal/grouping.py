"""List commands by what they are for, with their whole first sentence."""

from typing import Any

from typer.core import TyperGroup

_UNGROUPED = "Commands"


class GroupedCommands(TyperGroup):
    """Print the commands of a group under the titles given as ``rich_help_panel``, as plain text that wraps."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write one section for each title, in the order of the commands."""
        del ctx
        sections: dict[str, list[tuple[str, str]]] = {}
        for name, command in self.commands.items():
            if not command.hidden:
                panel = getattr(command, "rich_help_panel", None)
                title = panel if isinstance(panel, str) else _UNGROUPED
                sections.setdefault(title, []).append((name, _summary(command.help or "")))
        for title, rows in sections.items():
            with formatter.section(title):
                formatter.write_dl(rows)


def _summary(text: str) -> str:
    """Return the first paragraph in one line."""
    return " ".join(text.strip().split("\n\n")[0].split())
