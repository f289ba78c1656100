"""Start a PostgreSQL server that tests may restart and reach by TCP."""

import os
import shutil
import socket
import tempfile
import uuid
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
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        server = cls(binaries, folder, port)
        _run_as_postgres([str(binaries / "initdb"), "-D", server.data, "-U", "postgres", "-A", "trust", "--no-sync"])
        with (folder / "data" / "pg_hba.conf").open("a") as rules:
            rules.write("host all all 10.213.0.0/16 trust\n")
        server.control("start")
        return server

    @property
    def data(self) -> str:
        return str(self.folder / "data")

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
