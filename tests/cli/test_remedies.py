"""Errors say what is wrong in their own words; only the command line speaks of flags and commands."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from gtf_tune.cli.remedies import REMEDIES, with_remedy
from gtf_tune.errors import DefinitionError, StorageError, first_remedy
from tests.cli.conftest import Cli

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "gtf_tune"
COLMAPS = {PACKAGE / "pipelines" / "colmap" / "shell.py"}  # writes commands of COLMAP
LAYERS = [
    path
    for path in sorted(PACKAGE.rglob("*.py"))
    if path.relative_to(PACKAGE).parts[0] != "cli" and path not in COLMAPS
]
COMMANDS = (ROOT / "docs" / "commands.md").read_text()
_FLAG = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
_SPOKEN = re.compile(r"gtf-tune (study|storage|pipeline|sequence|metric|worker|evaluate|noise)\b")


def _texts(tree: ast.AST) -> Iterator[str]:
    """Yield every text in a file but those that stand alone, which are documentation."""
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in alone:
            yield node.value


@pytest.mark.parametrize("path", LAYERS, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_nothing_below_the_command_line_says_a_flag_of_it(path: Path) -> None:
    said = {flag for text in _texts(ast.parse(path.read_text(encoding="utf-8"))) for flag in _FLAG.findall(text)}

    assert said.isdisjoint(_FLAG.findall(COMMANDS))


def _raised(tree: ast.AST) -> Iterator[str]:
    """Yield the texts in every error that is raised or returned."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("Error"):
            yield from (
                one.value for one in ast.walk(node) if isinstance(one, ast.Constant) and isinstance(one.value, str)
            )


@pytest.mark.parametrize("path", LAYERS, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_error_below_the_command_line_says_a_command_of_it(path: Path) -> None:
    spoken = [text for text in _raised(ast.parse(path.read_text(encoding="utf-8"))) if _SPOKEN.search(text)]

    assert spoken == []


def _named() -> set[tuple[str, int]]:
    """Return every remedy that the package names, with the number of its arguments."""
    keywords = [
        node
        for path in LAYERS
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.keyword) and node.arg == "remedy"
    ]
    tuples = [one for node in keywords for one in ast.walk(node.value) if isinstance(one, ast.Tuple) and one.elts]
    return {(ast.literal_eval(one.elts[0]), len(one.elts) - 1) for one in tuples}


def test_every_remedy_has_words() -> None:
    named = _named()

    assert len(named) > 20
    for action, arguments in named:
        error = DefinitionError("oops", remedy=(action, *["x"] * arguments))
        assert with_remedy(error) == f"oops ({REMEDIES[action].format(*['x'] * arguments)})"


def test_every_word_of_a_remedy_exists() -> None:
    assert set(REMEDIES) == {action for action, _ in _named()}
    for words in REMEDIES.values():
        assert all(flag in COMMANDS for flag in re.findall(r"--[a-z-]+", words)), words
        assert all(f"### {command}\n" in COMMANDS for command in re.findall(r"gtf-tune \w+ \w+", words)), words


def test_arguments_of_commands_are_quoted() -> None:
    error = StorageError("no frames", remedy=("extract", "my walk.mp4", "my walk/"))

    assert with_remedy(error) == "no frames (gtf-tune sequence extract 'my walk.mp4' 'my walk/' --rate-hz 3)"


def test_an_error_without_a_remedy_is_its_message() -> None:
    assert with_remedy(StorageError("no disk")) == "no disk"


def test_several_faults_in_one_message_have_the_first_remedy() -> None:
    faults = [StorageError("a"), StorageError("b", remedy=("check",)), StorageError("c", remedy=("show",))]

    assert first_remedy(faults) == ("check",)
    assert first_remedy(faults[:1]) == ()


def test_the_command_line_adds_flags_and_commands(cli: Cli, room: Path) -> None:
    create = ("study", "create", "small", "-p", "analytic", "-s", "room", "-n", "2", "-k", "1", "-K", "2")
    axis = ("-r", "filter.max_error=1e-3:1e-1:log")

    nowhere = cli("study", "show", "small").err
    unknown = cli(*create, "-r", "filter.max_eror=1e-3:1e-1:log").err
    cli(*create, *axis)
    taken = cli(*create, *axis).err
    nothing = cli("study", "extend", "small").err
    room.rename("elsewhere")
    moved = cli("study", "run", "small").err

    assert nowhere.endswith(
        "there is no storage at gtf-tune.db; create a study in it first "
        "(gtf-tune study create ... --storage sqlite:///gtf-tune.db)\n"
    )
    assert "did you mean 'filter.max_error'? (gtf-tune pipeline options analytic)\n" in unknown
    assert "or choose another name (gtf-tune study resume small, or gtf-tune study delete small)\n" in taken
    assert "(--trials N, --range NAME=LOW:HIGH, or --as NEW-NAME with --noisy-runs N)\n" in nothing
    assert "on this machine; say where it lies (--sequence room=PATH)\n" in moved
