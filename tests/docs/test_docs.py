"""The documentation is true: its commands run, its files load, its references are fresh."""

import shutil
import tomllib
from pathlib import Path
from types import ModuleType

import pytest
import typer

from gtf_tune.cli.main import app
from gtf_tune.definition import definition_from_dict
from gtf_tune.study.create import checked_definition
from tests.docs.conftest import Command
from tests.docs.pages import MORE_PAGES, PAGES, ROOT, Snippet, mentioned, of_kind, snippets

STORIES = [page for page in PAGES if any(one.kind == "command" for one in snippets(page))]
STARTS_FROM_NOTHING = ("README.md", "index.md", "getting-started.md")


@pytest.mark.parametrize("page", STORIES, ids=lambda page: page.stem)
def test_the_commands_of_a_page_run_in_the_order_in_which_they_are_read(
    page: Path, call: Command, material: Path, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(material if page.name in STARTS_FROM_NOTHING else finished, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)

    for shown in snippets(page):
        if shown.title:
            (tmp_path / shown.title).write_text(shown.text)
        elif shown.kind == "toml" and "[pipeline]" in shown.text:
            (tmp_path / f"{tomllib.loads(shown.text)['name']}.toml").write_text(shown.text)
        if shown.kind == "command" and not _needs_another_place(shown):
            assert call(shown.arguments) == 0, str(shown)


def _needs_another_place(shown: Snippet) -> bool:
    """Return True if a command changes the user's shell, serves for ever, or needs a server, a file of another page or
    ground truth, which the photographs of the guide do not have.
    """
    words = shown.arguments
    return (
        "--install-completion" in words
        or "--side" in words
        or words[0] == "dashboard"
        or (words[0] == "worker" and "--once" not in words)
        or any("://" in word for word in words)
    )


DEFINITIONS = [one for one in of_kind("toml") if "pipeline" in tomllib.loads(one.text)]
REST = {"name": "rest", "sequences": [{"name": "photos", "path": "photos"}], "space": {"any": {"values": [1]}}}


@pytest.mark.parametrize("shown", [one for one in DEFINITIONS if "name" in tomllib.loads(one.text)], ids=str)
def test_every_study_definition_shown_is_one(shown: Snippet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for other in snippets(shown.page):
        if other.title:
            (tmp_path / other.title).write_text(other.text)
    data = tomllib.loads(shown.text)

    assert checked_definition(data, str(shown)) == definition_from_dict(data)


@pytest.mark.parametrize("shown", DEFINITIONS, ids=str)
def test_every_part_of_a_study_definition_shown_is_one(shown: Snippet) -> None:
    definition_from_dict({**REST, **tomllib.loads(shown.text)}, str(shown))


@pytest.mark.parametrize(
    "shown",
    [one for page in (*PAGES, *MORE_PAGES) for one in (*of_kind("command", (page,)), *mentioned(page))],
    ids=str,
)
def test_every_command_mentioned_exists_with_its_flags(shown: Snippet) -> None:
    parse(shown.arguments)


def test_every_command_has_an_example_that_exists_with_its_flags(generate: ModuleType) -> None:
    for path, help_text, is_group in generate.walk_commands():
        examples = [line.strip() for line in " ".join(help_text.split()).split("Example: ")[1:]]
        if is_group:
            continue
        assert len(examples) == 1, path
        assert examples[0].startswith(path), path


def test_every_command_is_documented_exactly_once(generate: ModuleType) -> None:
    headings = [
        line.lstrip("# ") for line in (ROOT / "docs" / "commands.md").read_text().splitlines() if "# gtf" in line
    ]

    assert headings == [path for path, _, _ in generate.walk_commands()]


def test_generated_files_are_fresh(generate: ModuleType) -> None:
    stale = [path.name for path, text in generate.generated(ROOT / "docs").items() if path.read_text() != text]

    assert stale == [], "run: python docs/generate.py"


def test_help_fits_eighty_columns(generate: ModuleType) -> None:
    for path, help_text, _ in generate.walk_commands():
        long = [line for line in help_text.splitlines() if len(line) > 80 and "Example: " not in line]
        assert long == [], path


def parse(arguments: list[str]) -> None:
    """Parse a command line without running it; raise what the command line would say."""
    command = typer.main.get_command(app)
    # Absolute paths are folders of the reader, which this machine lacks.
    words = ["." if word.startswith("/") else word for word in arguments if word != "--help"]
    name = "gtf-tune"
    while words and words[0] in getattr(command, "commands", {}):
        name = words.pop(0)
        command = command.commands[name]
    flags = {flag for parameter in command.params for flag in (*parameter.opts, *parameter.secondary_opts)}
    if words and words[0] in flags - {"--json"} and hasattr(command, "commands"):
        return
    assert not hasattr(command, "commands") or not words, f"'{' '.join(arguments)}': there is no command '{words[0]}'"
    if words:
        command.make_context(name, words, resilient_parsing=False)
