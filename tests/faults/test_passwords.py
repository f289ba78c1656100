"""The database's password appears nowhere: not in output, errors, JSON, definitions, command lines, or the database."""

import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from sqlalchemy import create_engine, text

from tests.cli.conftest import Cli
from tests.faults.disturbance import wait_until
from tests.faults.servers import RestartableServer

PASSWORD = "s3cret-and-long"


@pytest.fixture
def guarded_storage(restartable_server: RestartableServer) -> str:
    """Return the URL, password included, of a database without tables."""
    restartable_server.execute("DROP DATABASE IF EXISTS guarded")
    restartable_server.execute("DROP ROLE IF EXISTS keeper")
    restartable_server.execute(f"CREATE ROLE keeper LOGIN PASSWORD '{PASSWORD}'")
    restartable_server.execute("CREATE DATABASE guarded OWNER keeper")
    return f"postgresql://keeper:{PASSWORD}@127.0.0.1:{restartable_server.port}/guarded"


def test_the_password_is_never_shown_or_stored(
    guarded_storage: str, shared_room: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    def said(storage: str, *arguments: str) -> str:
        monkeypatch.setenv("GTF_TUNE_STORAGE", storage)
        answer = cli(*arguments)
        return answer.out + answer.err

    create = ("study", "create", "small", "-p", "analytic", "-s", str(shared_room), "-n", "2", "-k", "1", "-K", "3")
    printed = said(guarded_storage, *create, "-r", "filter.max_error=1e-3:1e-1:log")
    printed += said(guarded_storage, "worker", "--once", "--jobs", "1")
    printed += said(guarded_storage, "study", "show", "small", "--json")
    printed += said(guarded_storage, "study", "show", "smal")
    printed += said(guarded_storage.replace("/guarded", "/nowhere"), "study", "list")
    printed += said(guarded_storage.replace("keeper:", "nobody:"), "study", "list")
    printed += said(guarded_storage.replace("127.0.0.1", "127.0.0.1:x"), "study", "list")
    engine = create_engine(guarded_storage.replace("postgresql:", "postgresql+psycopg:"))
    with engine.connect() as connection:
        content = str(connection.scalar(text("SELECT database_to_xml(true, true, '')")))
    engine.dispose()

    assert "nothing is left to do" in printed
    assert "***" in printed
    assert PASSWORD not in printed
    assert "filter.max_error" in content
    assert PASSWORD not in content


def test_the_password_is_on_no_command_line_of_a_worker_and_its_children(
    guarded_storage: str, shared_room: Path, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "small.toml").write_text(
        'name = "small"\n[pipeline]\nname = "analytic"\nsettings = {failure = "hang"}\n'
        '[space]\n"filter.max_error" = {low = 1e-3, high = 0.1, log = true}\n'
    )
    monkeypatch.setenv("GTF_TUNE_STORAGE", guarded_storage)
    cli("study", "create", "small.toml", "-s", str(shared_room))
    worker = subprocess.Popen(
        [sys.executable, "-m", "gtf_tune", "worker", "--jobs", "1"],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert worker.stderr is not None
    assert any("begins" in line for line in worker.stderr)
    wait_until(lambda: psutil.Process(worker.pid).children())
    process = psutil.Process(worker.pid)
    lines = [" ".join(one.cmdline()) for one in (process, *process.children(recursive=True))]
    worker.terminate()
    rest = worker.stderr.read()
    worker.wait(timeout=60)
    worker.stderr.close()

    assert len(lines) > 1
    assert not any(PASSWORD in line for line in lines)
    assert PASSWORD not in rest
