"""Give the fault tests disturbed studies, the digest that they must end with, and servers that may be restarted."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gtf_tune.store.database import open_database
from gtf_tune.store.maintenance.digest import study_digest
from tests.cli.conftest import cli  # noqa: F401 (a fixture)
from tests.faults import counted
from tests.faults.disks import SmallDisk, mounted
from tests.faults.disturbance import NAME, Disturbed
from tests.faults.servers import RestartableServer
from tests.store.conftest import (  # noqa: F401 (fixtures)
    make_storage,
    postgresql_server,
    postgresql_template,
)
from tests.study.conftest import write_sequence


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave the long tests to `make soak`, which asks for them by their mark."""
    if "soak" not in str(config.option.markexpr):
        long = [item for item in items if item.get_closest_marker("soak")]
        config.hook.pytest_deselected(items=long)
        items[:] = [item for item in items if item not in long]


Disturb = Callable[..., Disturbed]


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Yield a folder in which the counted pipeline is installed, on the path of this process."""
    folder = tmp_path_factory.mktemp("site")
    counted.install(folder)
    sys.path.insert(0, str(folder))
    yield folder
    sys.path.remove(str(folder))


@pytest.fixture(scope="session")
def shared_room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a small sequence with ground truth."""
    return write_sequence(tmp_path_factory.mktemp("data") / "room", ground_truth=True)


@pytest.fixture
def disturb(shared_room: Path, site: Path, tmp_path: Path) -> Iterator[Disturb]:
    """Yield a function that makes a disturbed study in a storage; whatever it started is gone afterwards."""
    made: list[Disturbed] = []

    def make(storage: str) -> Disturbed:
        made.append(Disturbed(storage, shared_room, tmp_path, site))
        return made[-1]

    yield make
    for one in made:
        for process in one.workers:
            process.kill()
            process.join()


@pytest.fixture(scope="session")
def undisturbed(site: Path, shared_room: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., str]:
    """Return a function that gives the digest of a study that nothing disturbs; each study is made once."""
    known: dict[str, str] = {}

    def digest_of(**sections: dict[str, object]) -> str:
        key = repr(sections)
        if key not in known:
            folder = tmp_path_factory.mktemp("undisturbed")
            calm = Disturbed(f"sqlite:///{folder}/calm.db", shared_room, folder, site)
            calm.create(**sections)
            calm.finish(pause_s=0.0)
            database = open_database(calm.storage)
            known[key] = study_digest(database, NAME)
            database.close()
        return known[key]

    return digest_of


@pytest.fixture(scope="session")
def restartable_server() -> Iterator[RestartableServer]:
    """Yield a PostgreSQL server of these tests' own, reachable by TCP, which they may restart."""
    server = RestartableServer.create()
    yield server
    server.remove()


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[SmallDisk]:
    """Yield a disk of a few megabytes."""
    with mounted(tmp_path / "small") as disk:
        yield disk
