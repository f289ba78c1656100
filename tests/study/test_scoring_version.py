"""A study keeps the scoring rules that it began with."""

from pathlib import Path

import optuna
import pytest
from sqlalchemy.orm import Session

from gtf_tune.errors import DefinitionError, StorageError
from gtf_tune.execution import InlineExecutor
from gtf_tune.store import studies
from gtf_tune.store.database import Database
from gtf_tune.store.database.session import write
from gtf_tune.store.maintenance.check import check
from gtf_tune.study.edit import Extension, extend_study
from gtf_tune.study.open_study import open_study
from gtf_tune.study.scoring import objective
from gtf_tune.study.scoring.rescore import rescore
from gtf_tune.study.work.server import WorkerLoop, WorkerRules
from gtf_tune.study.work.worker import StudyWorker
from tests.study.conftest import Runner, definition_of

REASON = (
    r"study 'small' is scored by rules of version 2, which gtf-tune \S+ has, but this one scores by version 3; work"
)


@pytest.fixture
def later(room: Path, run_study: Runner, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a study, and let this be a version with other rules."""
    run_study(definition_of(room, search={"trials": 2}))
    monkeypatch.setattr(objective, "SCORING_VERSION", 3)
    monkeypatch.setattr(objective, "KNOWN_RULES", (3,))


def test_the_version_of_the_rules_is_stored(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, search={"trials": 1}))

    assert studies.get(database, "small").resolved["scoring_version"] == objective.SCORING_VERSION


@pytest.mark.usefixtures("later")
def test_a_version_with_other_rules_neither_works_on_a_study_nor_confirms_or_rescores_it(database: Database) -> None:
    with pytest.raises(DefinitionError, match=REASON):
        open_study(database, "small")
    with pytest.raises(DefinitionError, match=REASON):
        rescore(database, "small", {})


@pytest.mark.usefixtures("later")
def test_a_study_without_a_version_has_the_first_rules(database: Database) -> None:
    def forget(session: Session) -> None:
        row = studies.locked(session, 1)
        row.resolved = {name: value for name, value in row.resolved.items() if name != "scoring_version"}

    write(database, forget)

    with pytest.raises(DefinitionError, match=REASON.replace("version 2", "version 1")):
        open_study(database, "small")


@pytest.mark.usefixtures("later")
def test_a_worker_leaves_a_study_with_other_rules_alone_and_says_so(database: Database) -> None:
    studies.set_state(database, studies.get(database, "small").id, "open")
    said: list[str] = []

    WorkerLoop(database, InlineExecutor(), WorkerRules(), announce=said.append).run()

    assert len(said) == 1
    assert said[0].startswith("study 'small' is left to other workers: study 'small' is scored by rules of version 2")


def test_trials_that_another_definition_scored_are_found_by_a_check_and_not_made_by_a_worker(
    room: Path, database: Database, run_study: Runner
) -> None:
    def change(session: Session) -> None:
        row = studies.locked(session, 1)
        row.state, row.definition = "open", row.definition.replace('"aggregate": "median"', '"aggregate": "mean"')

    run_study(definition_of(room, search={"trials": 2}))
    extend_study(database, "small", Extension(trials=3))
    assert check(database).problems == ()
    study = open_study(database, "small")
    write(database, change)  # as a tool does, or a gtf-tune of another version

    with pytest.raises(StorageError, match="was changed while it was worked on"):
        StudyWorker(study, InlineExecutor()).work()
    StudyWorker(open_study(database, "small"), InlineExecutor()).work()

    (problem,) = check(database).problems
    assert "study 'small' mixes trials that were scored by different rules or definitions (2 and 0 more" in problem


def test_another_optuna_is_another_version_but_for_corrections(
    room: Path, database: Database, run_study: Runner, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_study(definition_of(room, search={"trials": 1}))
    major, minor, *_ = optuna.__version__.split(".")

    monkeypatch.setattr(optuna, "__version__", f"{major}.{minor}.99")
    assert open_study(database, "small").mismatch == ""
    monkeypatch.setattr(optuna, "__version__", f"{int(major) + 1}.0.0")
    with pytest.raises(DefinitionError, match=r"began with Optuna .*, but \d+\.0\.0 is installed here"):
        open_study(database, "small")
    assert open_study(database, "small", allow_version_mismatch=True).mismatch
