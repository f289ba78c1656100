"""Give the tests of the store fresh databases on SQLite and PostgreSQL, and small values to put into them."""

import multiprocessing
import os
import shutil
import subprocess
import tempfile
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import create_engine, make_url, text

from gtf_tune.errors import StorageError
from gtf_tune.pipelines.run import RunKind, RunOutcome, RunRequest
from gtf_tune.store import studies
from gtf_tune.store.database import Database, create_database, open_database
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.store.studies import NewStudy, Study, StudySequence
from gtf_tune.trajectory import Trajectory

BACKENDS = ("sqlite", "postgresql")
_SETTINGS = (
    "-c listen_addresses='' -c fsync=off -c full_page_writes=off -c synchronous_commit=off -c max_connections=120"
)


def _answer_as_nobody(work: Callable[[], object], answers: "multiprocessing.Queue[str]") -> None:
    if os.geteuid() == 0:
        os.setuid(65534)
    try:
        answers.put(str(work()))
    except StorageError as error:
        answers.put(str(error))


def as_nobody(work: Callable[[], object]) -> str:
    """Return as text what ``work`` returns without the rights of root, or the message of the error that it ends with.

    Modules that it imports must be imported already: nobody may be unable to read them.
    """
    context = multiprocessing.get_context("fork")
    answers: multiprocessing.Queue[str] = context.Queue()
    process = context.Process(target=_answer_as_nobody, args=(work, answers))
    process.start()
    process.join()
    assert process.exitcode == 0
    return answers.get()


@pytest.fixture
def public_folder() -> Iterator[Path]:
    """Yield a folder that everybody may enter: into those of pytest only their owner may."""
    folder = Path(tempfile.mkdtemp(prefix="gtf-public-", dir="/tmp"))
    folder.chmod(0o755)
    yield folder
    folder.chmod(0o755)
    shutil.rmtree(folder)


@dataclass(frozen=True)
class Server:
    """Make and drop databases on one PostgreSQL server."""

    url: str

    def execute(self, statement: str) -> None:
        engine = create_engine(self.url, isolation_level="AUTOCOMMIT")
        with engine.connect() as connection:
            connection.execute(text(statement))
        engine.dispose()

    def url_of(self, name: str) -> str:
        return make_url(self.url).set(database=name).render_as_string(hide_password=False)


def _binaries() -> Path | None:
    found = shutil.which("initdb")
    candidates = [Path(found).parent] if found else sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    return candidates[0] if candidates else None


def _run_as_postgres(command: list[str]) -> None:
    # initdb and postgres refuse to run as root.
    drop = ["setpriv", "--reuid=postgres", "--regid=postgres", "--clear-groups"] if os.geteuid() == 0 else []
    subprocess.run([*drop, *command], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd="/")


@pytest.fixture(scope="session")
def postgresql_server() -> Iterator[Server]:
    """Yield a throw-away server, or the one that GTF_TUNE_TEST_DB_URL names."""
    pytest.importorskip("psycopg", reason="the extra [postgres] is not installed")
    given = os.environ.get("GTF_TUNE_TEST_DB_URL")
    if given:
        yield Server(given.replace("postgresql://", "postgresql+psycopg://"))
        return
    binaries = _binaries()
    if binaries is None:
        pytest.skip("no PostgreSQL here: install Debian's postgresql, or set GTF_TUNE_TEST_DB_URL")
    folder = Path(tempfile.mkdtemp(prefix="gtf-pg-", dir="/tmp"))  # a socket's path has at most 107 characters
    if os.geteuid() == 0:
        shutil.chown(folder, "postgres", "postgres")
    data = str(folder / "data")
    try:
        _run_as_postgres([str(binaries / "initdb"), "-D", data, "-U", "postgres", "-A", "trust", "--no-sync"])
        _run_as_postgres([str(binaries / "pg_ctl"), "-D", data, "-w", "-o", f"-k {folder} {_SETTINGS}", "start"])
        yield Server(f"postgresql+psycopg://postgres@/postgres?host={folder}")
        _run_as_postgres([str(binaries / "pg_ctl"), "-D", data, "-m", "immediate", "stop"])
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="session")
def postgresql_template(postgresql_server: Server) -> Iterator[str]:
    """Yield the name of a PostgreSQL database with all tables, to be copied."""
    name = f"gtf_template_{uuid.uuid4().hex}"
    postgresql_server.execute(f"CREATE DATABASE {name}")
    create_database(postgresql_server.url_of(name)).close()
    yield name
    postgresql_server.execute(f"DROP DATABASE {name} WITH (FORCE)")


@pytest.fixture
def make_storage(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Callable[[str, bool], str]]:
    """Yield a function that makes a storage on a backend, with or without tables, and returns its URL."""
    dropped: list[str] = []

    def make(backend: str, with_tables: bool = True) -> str:
        name = f"gtf_{uuid.uuid4().hex}"
        if backend == "sqlite":
            path = tmp_path / f"{name}.db"
            if with_tables:
                shutil.copy(request.getfixturevalue("sqlite_template"), path)
            return f"sqlite:///{path}"
        server: Server = request.getfixturevalue("postgresql_server")
        template = request.getfixturevalue("postgresql_template") if with_tables else "template0"
        server.execute(f"CREATE DATABASE {name} TEMPLATE {template}")
        dropped.append(name)
        return server.url_of(name)

    yield make
    for name in dropped:
        request.getfixturevalue("postgresql_server").execute(f"DROP DATABASE {name} WITH (FORCE)")


@pytest.fixture(params=BACKENDS)
def storage(request: pytest.FixtureRequest, make_storage: Callable[[str, bool], str]) -> str:
    """Return the URL of a storage with all tables and no study, on each backend."""
    return make_storage(request.param, True)


@pytest.fixture(params=BACKENDS)
def empty_storage(request: pytest.FixtureRequest, make_storage: Callable[[str, bool], str]) -> str:
    """Return the URL of a storage without tables, on each backend."""
    return make_storage(request.param, False)


@pytest.fixture
def database(storage: str) -> Iterator[Database]:
    """Yield an open database with all tables and no study, on each backend."""
    opened = open_database(storage)
    yield opened
    opened.close()


@dataclass(frozen=True)
class FakePipeline:
    name: str = "fake"
    version: str = "1"
    settings: dict[str, str] = field(default_factory=lambda: {"pairing": "exhaustive"})


@dataclass(frozen=True)
class FakeSequence:
    fingerprint: str = "f" * 64
    camera: None = None
    cameras_key: str = "unknown"
    focal_prior: None = None
    num_frames: int = 4

    def __len__(self) -> int:
        return self.num_frames


def _trajectory(seed: int, num_poses: int) -> Trajectory:
    generator = np.random.default_rng(seed)
    return Trajectory(
        frame_ids=np.arange(num_poses),
        timestamps=np.arange(num_poses) / 30,
        positions=generator.normal(size=(num_poses, 3)),
        quaternions=generator.normal(size=(num_poses, 4)),
    )


@pytest.fixture
def make_request() -> Callable[..., RunRequest]:
    """Return a function that makes run requests, which differ by what is given."""

    def make(kind: RunKind = "clean", index: int = 0, **changes: Any) -> RunRequest:
        values: dict[str, Any] = {"pipeline": FakePipeline(), "options": {"a.b": 0.1}, "sequence": FakeSequence()}
        values |= {"noise_sigma": 0.0, "noise_seed": 0, "seed": index}
        return RunRequest(kind=kind, index=index, **{**values, **changes})

    return make


@pytest.fixture
def make_outcome() -> Callable[..., RunOutcome]:
    """Return a function that makes outcomes with a random trajectory."""

    def make(seed: int = 0, num_poses: int = 3, **changes: Any) -> RunOutcome:
        values: dict[str, Any] = {"status": "ok", "wall_s": 1.5, "peak_memory_bytes": 2**33, "host": "here"}
        values |= {"started_at": 1e9, "diagnostics": {"num_points3D": 7}, "versions": {"pycolmap": "4"}, "log": "done"}
        return RunOutcome(trajectory=_trajectory(seed, num_poses), **{**values, **changes})

    return make


@pytest.fixture
def make_study() -> Callable[..., Study]:
    """Return a function that adds a study with one sequence, and its Optuna study."""

    def make(database: Database, name: str = "room") -> Study:
        from optuna.study import StudyDirection

        optuna_id = optuna_storage(database).create_new_study([StudyDirection.MINIMIZE], name)
        sequence = StudySequence("desk", "data/desk", "images", "f" * 64, 4, 640, 480, "unknown", False, {"note": 1})
        return studies.add(database, NewStudy(name, optuna_id, '{"name":"room"}', {"sigma": 5.0}, "/data", (sequence,)))

    return make


@pytest.fixture
def study(database: Database, make_study: Callable[..., Study]) -> Study:
    """Return a fresh study on each backend."""
    return make_study(database)
