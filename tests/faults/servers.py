"""Start a PostgreSQL server that tests may restart and reach by TCP."""

import os
import shutil
import signal
import socket
import tempfile
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import pytest
from sqlalchemy import create_engine, text

from gtf_tune.store.database import create_database
from tests.store.conftest import _binaries, _run_as_postgres


@dataclass(frozen=True)
class RestartableServer:
    """A throw-away server that listens on every address of this machine, without passwords."""

    binaries: Path
    folder: Path
    port: int

    @classmethod
    def create(cls) -> Self:
        """Start a server, or skip the test with the reason."""
        pytest.importorskip("psycopg", reason="the extra [postgres] is not installed")
        binaries = _binaries()
        if binaries is None:
            pytest.skip("no PostgreSQL here: install Debian's postgresql")
        folder = Path(tempfile.mkdtemp(prefix="gtf-pg-", dir="/tmp"))  # a socket's path has at most 107 characters
        if os.geteuid() == 0:
            shutil.chown(folder, "postgres", "postgres")
        server = cls(binaries, folder, _free_port())
        _run_as_postgres([str(binaries / "initdb"), "-D", server.data, "-U", "postgres", "-A", "trust", "--no-sync"])
        with server.rules.open("a") as rules:
            rules.write("host all all 10.213.0.0/16 trust\n")
        server.control("start")
        return server

    @property
    def data(self) -> str:
        return str(self.folder / "data")

    @property
    def rules(self) -> Path:
        """File that says who may connect, and how."""
        return self.folder / "data" / "pg_hba.conf"

    def control(self, *action: str) -> None:
        """Call pg_ctl and wait for it."""
        options = f"-k {self.folder} -p {self.port} -c listen_addresses='*' -c fsync=off -c max_connections=300"
        _run_as_postgres([str(self.binaries / "pg_ctl"), "-D", self.data, "-w", "-o", options, *action])

    def remove(self) -> None:
        """Stop the server and delete its files."""
        self.control("stop", "-m", "immediate")
        shutil.rmtree(self.folder, ignore_errors=True)

    def new_storage(self, host: str = "127.0.0.1") -> str:
        """Return the URL of a new database with all tables."""
        name = f"gtf_{uuid.uuid4().hex}"
        self.execute(f"CREATE DATABASE {name}")
        create_database(f"postgresql+psycopg://postgres@127.0.0.1:{self.port}/{name}").close()
        return f"postgresql+psycopg://postgres@{host}:{self.port}/{name}"

    def execute(self, statement: str) -> None:
        """Execute a statement outside a transaction, in the database postgres."""
        url = f"postgresql+psycopg://postgres@127.0.0.1:{self.port}/postgres"
        engine = create_engine(url, isolation_level="AUTOCOMMIT")
        with engine.connect() as connection:
            connection.execute(text(statement))
        engine.dispose()


@contextmanager
def pooled(server: RestartableServer) -> Iterator[int]:
    """Start a PgBouncer that pools transactions in front of a server, and yield its port; skip where there is none."""
    program = shutil.which("pgbouncer", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
    if program is None:
        pytest.skip("no PgBouncer here: install Debian's pgbouncer")
    port = _free_port()
    settings = server.folder / "pgbouncer.ini"
    settings.write_text(
        f"[databases]\n* = host=127.0.0.1 port={server.port} user=postgres\n[pgbouncer]\nlisten_addr = 127.0.0.1\n"
        f"listen_port = {port}\nunix_socket_dir =\nauth_type = any\npool_mode = transaction\ndefault_pool_size = 4\n"
        f"pidfile = {server.folder}/pgbouncer.pid\nlogfile = {server.folder}/pgbouncer.log\n"
    )
    settings.chmod(0o644)
    _run_as_postgres([program, "-d", str(settings)])
    try:
        _wait_until_it_listens(port, server.folder / "pgbouncer.log")
        yield port
    finally:
        os.kill(int((server.folder / "pgbouncer.pid").read_text()), signal.SIGTERM)


def _wait_until_it_listens(port: int, log: Path) -> None:
    """Wait for a daemon: it leaves the terminal before it opens its port and writes its number."""
    end = time.monotonic() + 30
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
            return
        except OSError:
            if time.monotonic() > end:
                raise AssertionError(f"PgBouncer does not listen:\n{log.read_text()}") from None
            time.sleep(0.05)


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])
