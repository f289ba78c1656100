"""Optuna's rows belong to other programs too: studies they renamed, deleted or filled go on, or say what to do."""

import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path

import optuna
import pytest
from sqlalchemy import text

from gtf_tune.errors import OptunaStudyError
from gtf_tune.execution import InlineExecutor
from gtf_tune.execution.base import RunLimits
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.store import studies, trials
from gtf_tune.store.database import Database, create_database, open_database
from gtf_tune.store.maintenance.check import check
from gtf_tune.store.maintenance.copy import copy_study
from gtf_tune.store.maintenance.digest import study_digest
from gtf_tune.store.optuna.link import linked
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.edit import Extension, derive_study, extend_study
from gtf_tune.study.open_study import open_study
from gtf_tune.study.work.server import WorkerLoop, WorkerRules
from gtf_tune.study.work.worker import StudyWorker
from tests.cli.conftest import Cli
from tests.faults import other_programs
from tests.faults.other_programs import DISTURBANCES
from tests.study.conftest import definition_of, write_sequence

HARMLESS = list(DISTURBANCES)[:4]
FATAL = list(DISTURBANCES)[4:]
NUMBER_OF_TRIALS = 6


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a sequence and a database with a study of six trials that are done."""
    folder = tmp_path_factory.mktemp("template")
    room = write_sequence(folder / "room", ground_truth=True)
    database = create_database(str(folder / "study.db"))
    data = definition_of(room, search={"sampler": "tpe", "trials": NUMBER_OF_TRIALS})
    create_study(database, checked_definition(data, "test"), folder)
    StudyWorker(open_study(database, "small"), InlineExecutor()).work()
    database.close()
    return folder


@pytest.fixture
def database(template: Path, tmp_path: Path) -> Iterator[Database]:
    shutil.copy(template / "study.db", tmp_path / "study.db")
    opened = open_database(str(tmp_path / "study.db"))
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def undisturbed(template: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the digest of the study after four more trials."""
    path = tmp_path_factory.mktemp("undisturbed") / "study.db"
    shutil.copy(template / "study.db", path)
    return more(open_database(str(path)))


def more(database: Database) -> str:
    extend_study(database, "small", Extension(trials=NUMBER_OF_TRIALS + 4))
    StudyWorker(open_study(database, "small"), InlineExecutor()).work()
    found = study_digest(database, "small")
    database.close()
    return found


@pytest.mark.parametrize("name", HARMLESS)
def test_a_disturbed_study_goes_on_as_an_undisturbed_one(database: Database, undisturbed: str, name: str) -> None:
    DISTURBANCES[name](database)

    assert more(database) == undisturbed


@pytest.mark.parametrize("name", FATAL)
def test_a_deleted_study_says_what_is_left_of_it(database: Database, name: str) -> None:
    DISTURBANCES[name](database)
    extend_study(database, "small", Extension(trials=NUMBER_OF_TRIALS + 1))

    with pytest.raises(
        OptunaStudyError, match=r"another program deleted .* derive a new study on its runs, or delete it"
    ):
        open_study(database, "small")


@pytest.mark.parametrize("name", FATAL)
def test_a_study_on_the_runs_of_a_deleted_one_makes_none_twice(database: Database, name: str) -> None:
    DISTURBANCES[name](database)
    executor = InlineExecutor()

    derive_study(database, "small", Extension(), "again")
    StudyWorker(open_study(database, "again"), executor).work()

    assert executor.executed == []
    assert [one.value for one in trials.of_study(database, studies.get(database, "again").id)] == [
        one.value for one in trials.of_study(database, studies.get(database, "small").id)
    ]


@pytest.mark.parametrize("name", DISTURBANCES)
def test_a_disturbed_study_is_deleted_whole(database: Database, name: str) -> None:
    DISTURBANCES[name](database)

    studies.delete_study(database, "small")

    with database.engine.connect() as connection:
        left = connection.scalars(text("SELECT study_name FROM studies")).all()
    assert left == (["small"] if name == "id reused" else [])
    assert studies.names(database) == []


@pytest.mark.parametrize("name", HARMLESS)
def test_a_disturbed_study_is_copied_whole(database: Database, tmp_path: Path, name: str) -> None:
    DISTURBANCES[name](database)
    target = create_database(str(tmp_path / "copy.db"))

    assert copy_study(database, target, "small") == study_digest(database, "small")
    assert check(target).ok
    target.close()


@pytest.mark.parametrize(
    ("name", "problem", "note"),
    [
        ("renamed", "", "renamed the Optuna study of 'small' to 'renamed'"),
        ("renamed in place", "", "renamed the Optuna study of 'small' to 'renamed'"),
        ("foreign trials", "", "other programs added 4 trials to the Optuna study of 'small'; its search ignores them"),
        ("deleted", "another program deleted the Optuna study of 'small'", ""),
        ("id reused", "another program deleted the Optuna study of 'small'", ""),
    ],
)
def test_a_check_says_what_others_did(database: Database, name: str, problem: str, note: str) -> None:
    DISTURBANCES[name](database)

    found = check(database)

    assert problem in " ".join(found.problems)
    assert note in " ".join(found.notes)
    assert bool(found.problems) == bool(problem)


class _Disturbing(InlineExecutor):
    """Executor during whose runs something happens to the database, as another program may do at any time."""

    def __init__(self, database: Database, disturb: Callable[[Database], None], after: int) -> None:
        super().__init__()
        self._database, self._disturb, self._after = database, disturb, after

    def submit(
        self, request: RunRequest, limits: RunLimits, known_good: RunRequest | None = None
    ) -> "Future[RunOutcome]":
        found = super().submit(request, limits, known_good)
        if len(self.executed) == self._after:
            self._disturb(self._database)
        return found


def serve(database: Database, executor: InlineExecutor) -> list[str]:
    said: list[str] = []
    WorkerLoop(database, executor, WorkerRules(), announce=said.append).run()
    return said


def tell(database: Database) -> None:
    """Give the running trial a value of one's own, as the dashboard's form for a running trial does."""
    study = other_programs.load(database)
    running = next(trial for trial in study.get_trials(deepcopy=False) if not trial.state.is_finished())
    study.tell(running.number, -1.0)


@pytest.mark.parametrize("disturb", [*(DISTURBANCES[name] for name in HARMLESS), tell])
def test_a_study_that_is_disturbed_during_a_run_ends_as_an_undisturbed_one(
    database: Database, undisturbed: str, disturb: Callable[[Database], None]
) -> None:
    extend_study(database, "small", Extension(trials=NUMBER_OF_TRIALS + 4))

    serve(database, _Disturbing(database, disturb, after=7))

    assert study_digest(database, "small") == undisturbed


def test_a_worker_goes_on_with_the_other_studies(database: Database) -> None:
    extend_study(database, "small", Extension(trials=NUMBER_OF_TRIALS + 4))
    derive_study(database, "small", Extension(trials=3), "other")

    said = serve(database, _Disturbing(database, other_programs.delete, after=1))

    assert {one.name: one.state for one in studies.summaries(database)} == {"small": "open", "other": "done"}
    assert any("'small' is left to other workers: another program deleted the Optuna study" in line for line in said)


def test_a_study_without_trials_gets_a_new_optuna_study(database: Database) -> None:
    derive_study(database, "small", Extension(), "fresh")
    other_programs.delete(database, "fresh")

    executor = InlineExecutor()
    StudyWorker(open_study(database, "fresh"), executor).work()

    assert [trial.state for trial in trials.of_study(database, studies.get(database, "fresh").id)] == ["complete"] * 6


def test_two_copies_are_named(database: Database) -> None:
    study = other_programs.load(database)
    for name in ("one", "two"):
        copy = optuna.create_study(study_name=name, storage=study._storage)
        copy.add_trials(study.get_trials(deepcopy=False))
    other_programs.delete(database)

    with pytest.raises(OptunaStudyError, match=r"copied the Optuna study of 'small' in .* to 'one' and 'two'"):
        linked(database, studies.get(database, "small"))


def test_a_study_that_others_copied_and_kept_is_its_own(database: Database) -> None:
    study = other_programs.load(database)
    optuna.create_study(study_name="copy", storage=study._storage).add_trials(study.get_trials(deepcopy=False))

    assert linked(database, studies.get(database, "small")) == studies.get(database, "small")


@pytest.mark.parametrize(
    ("directions", "shown"), [(["maximize"], "maximize"), (["minimize", "maximize"], "minimize and maximize")]
)
def test_an_empty_optuna_study_of_another_kind_is_not_taken(
    database: Database, directions: list[str], shown: str
) -> None:
    storage = optuna.create_study(study_name="x", storage=other_programs.load(database)._storage)._storage
    optuna.create_study(study_name="taken", storage=storage, directions=directions)

    with pytest.raises(OptunaStudyError, match=f"the Optuna study 'taken' in .* is to {shown}, but"):
        derive_study(database, "small", Extension(), "taken")


def test_a_name_that_another_program_gave_to_a_study_is_not_taken(database: Database) -> None:
    derive_study(database, "small", Extension(), "fresh")
    with database.engine.begin() as connection:
        connection.execute(text("UPDATE studies SET study_name = 'taken' WHERE study_name = 'fresh'"))

    with pytest.raises(OptunaStudyError, match="has an Optuna study 'taken' that belongs to study 'fresh'"):
        derive_study(database, "small", Extension(), "taken")


READING = (
    "study list",
    "study show small",
    "study best small",
    "study report small -o report.html",
    "study export small -f csv -o trials.csv",
    "study export small -f tum -o tum",
    "study rescore small --aggregate mean",
)
CHANGING = ("study resume small --jobs 1", "study extend small --trials 7", "worker --once --jobs 1", "storage check")


@pytest.mark.parametrize("name", DISTURBANCES)
def test_every_command_works_on_a_disturbed_study_or_says_why_not(cli: Cli, database: Database, name: str) -> None:
    DISTURBANCES[name](database)

    read = [cli(*command.split(), "--storage", "study.db") for command in READING]
    changed = [cli(*command.split(), "--storage", "study.db") for command in CHANGING]

    assert [said.code for said in read] == [0] * len(READING)
    fails = name in FATAL
    assert [said.code for said in changed] == [int(fails), 0, int(fails), int(fails)]
    assert ("another program deleted the Optuna study of 'small'" in changed[2].err) is fails
