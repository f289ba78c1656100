import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory

from gtf_tune.cli.remedies import with_remedy
from gtf_tune.errors import StorageError
from gtf_tune.store import studies, trials
from gtf_tune.store.database import Database, open_database, schema, upgrade_database
from gtf_tune.store.database.models import TABLE_PREFIX, Base
from gtf_tune.store.maintenance.check import check

ASSETS = Path(__file__).parent / "assets"


def test_the_known_revisions_are_those_of_the_migrations() -> None:
    config = Config()
    config.set_main_option("script_location", "gtf_tune.store:migrations")
    config.set_main_option("path_separator", "os")
    revisions = [script.revision for script in ScriptDirectory.from_config(config).walk_revisions()]
    assert tuple(reversed(revisions)) == schema.REVISIONS


def test_migrations_make_the_tables_of_the_models(database: Database) -> None:
    def ours(name: str, kind: str, parents: object) -> bool:
        return kind != "table" or name.startswith(TABLE_PREFIX)

    with database.engine.connect() as connection:
        options = {"version_table": schema.VERSION_TABLE, "include_name": ours, "compare_type": True}
        assert compare_metadata(MigrationContext.configure(connection, opts=options), Base.metadata) == []


def test_there_is_a_file_of_every_revision() -> None:
    assert {path.stem for path in ASSETS.glob("*.db")} == {"no_revision", *schema.REVISIONS}


@pytest.fixture
def asset(tmp_path: Path) -> Callable[[str], str]:
    """Return a function that copies the file of one revision."""
    return lambda revision: str(shutil.copy(ASSETS / f"{revision}.db", tmp_path / "old.db"))


@pytest.mark.parametrize("revision", ["no_revision", *schema.REVISIONS[:-1]])
def test_old_files_open_with_the_command_that_upgrades_them(asset: Callable[[str], str], revision: str) -> None:
    path = asset(revision)
    with pytest.raises(StorageError, match="upgrade") as caught:
        open_database(path)
    assert with_remedy(caught.value).endswith(f" (gtf-tune storage upgrade --storage sqlite:///{path})")


@pytest.mark.parametrize("revision", ["no_revision", *schema.REVISIONS])
def test_old_files_are_sound_after_an_upgrade(asset: Callable[[str], str], revision: str) -> None:
    database = upgrade_database(asset(revision))
    report = check(database)
    database.close()
    assert (report.revision, report.problems) == (schema.REVISIONS[-1], ())


@pytest.mark.parametrize("revision", schema.REVISIONS)
def test_old_files_keep_their_studies(asset: Callable[[str], str], revision: str) -> None:
    database = upgrade_database(asset(revision))
    best = trials.best(database, studies.get(database, "old").id)
    database.close()
    assert best is not None
    assert (best.value, best.options) == (0.5, {"a.b": 0.1})
