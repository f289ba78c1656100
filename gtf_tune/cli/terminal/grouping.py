"""Groups of commands, each imported when it is called, listed by what they are for."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar

import typer
from typer.core import TyperGroup


@dataclass(frozen=True)
class Entry:
    """Line of a list of commands: its title there, its summary, and what is behind it.

    ``target`` is ``module:function`` below `gtf_tune.cli`; ``commands`` makes a group of it instead. The summary
    repeats the first sentence of the function, so that nothing is imported to print a list; a test compares them.
    """

    title: str
    summary: str
    target: str = ""
    commands: Mapping[str, "Entry"] | None = None


class LazyCommands(Mapping[str, Any]):
    """Commands by name, made from their entries when they are looked up."""

    def __init__(self, entries: Mapping[str, Entry]) -> None:
        self.entries = entries
        self._made: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._made:
            self._made[name] = _make(name, self.entries[name])
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.entries)

    def __len__(self) -> int:
        return len(self.entries)


class CommandGroup(TyperGroup):
    """Group whose commands are imported when they are called; its help lists them under titles, as plain text."""

    table: ClassVar[Mapping[str, Entry]] = {}

    def __init__(self, *, entries: Mapping[str, Entry] | None = None, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands: Any = LazyCommands(self.table if entries is None else entries)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands, without importing one."""
        del ctx
        return list(self.commands)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write one section for each title, in the order of the commands."""
        del ctx
        sections: dict[str, list[tuple[str, str]]] = {}
        for name, entry in self.commands.entries.items():
            sections.setdefault(entry.title, []).append((name, entry.summary))
        for title, rows in sections.items():
            with formatter.section(title):
                formatter.write_dl(rows)


def _make(name: str, entry: Entry) -> Any:
    if entry.commands is not None:
        return CommandGroup(
            entries=entry.commands, name=name, help=entry.summary, no_args_is_help=True, rich_markup_mode=None
        )
    module, _, function = entry.target.partition(":")
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    app.command(name)(getattr(import_module(f"gtf_tune.cli.{module}"), function))
    return typer.main.get_command(app)
