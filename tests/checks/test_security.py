"""What docs/security.md promises of the code, checked on the code."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "gtf_tune"
FILES = sorted(PACKAGE.rglob("*.py"))
FORBIDDEN_CALLS = {
    "eval",
    "exec",
    "compile",
    "os.system",
    "os.popen",
    "pickle.load",
    "pickle.loads",
    "yaml.unsafe_load",
}
FORBIDDEN_IMPORTS = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "yaml"}
NETWORK_CLIENTS = {"urllib", "http", "requests", "httpx", "aiohttp", "ftplib", "smtplib", "paramiko"}
CONNECTING_CALLS = {"socket.socket", "socket.create_connection"}
EXCEPT = {"testing.py"}  # the pipelines' contract pickles a pipeline and reads it back, inside the tests
ALLOWED_IMPORTS = {
    "pipelines/function/pipeline.py": {"cloudpickle"},  # a caller's function on its way to the caller's own children
    "sequence/layouts/fields.py": {"yaml"},  # with loaders that make no objects, see below
}
HARMLESS_LOADERS = {"yaml.BaseLoader", "yaml.SafeLoader"}


def calls(tree: ast.AST) -> Iterator[tuple[str, ast.Call]]:
    """Yield every call with its dotted name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_file_runs_text_as_code_or_reads_objects_from_bytes(path: Path) -> None:
    if path.name in EXCEPT:
        pytest.skip("only tests use it")
    tree = ast.parse(path.read_text(encoding="utf-8"))
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}

    allowed = ALLOWED_IMPORTS.get(path.relative_to(PACKAGE).as_posix(), set())
    assert not imported & (FORBIDDEN_IMPORTS - allowed)
    assert not {name for name, _ in calls(tree)} & FORBIDDEN_CALLS


def test_yaml_files_become_texts_and_numbers_only() -> None:
    loads = [call for path in FILES for name, call in calls(ast.parse(path.read_text())) if name == "yaml.load"]
    loaders = {ast.unparse(keyword.value) for call in loads for keyword in call.keywords if keyword.arg == "Loader"}

    assert all(any(keyword.arg == "Loader" for keyword in call.keywords) for call in loads)
    assert loaders <= HARMLESS_LOADERS


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_file_opens_a_network_connection_of_its_own(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}

    assert not {name.partition(".")[0] for name in imported} & NETWORK_CLIENTS
    assert not {name for name, _ in calls(tree)} & CONNECTING_CALLS


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_program_is_started_through_a_shell(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    keywords = [keyword for _, call in calls(tree) for keyword in call.keywords if keyword.arg == "shell"]

    assert not keywords
