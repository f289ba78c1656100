"""Studies that earlier commits began: read, confirmed, and finished as those commits finish them."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from gtf_tune.definition import StudyDefinition
from gtf_tune.execution import InlineExecutor
from gtf_tune.execution.base import RunLimits
from gtf_tune.store import runs, studies, trials
from gtf_tune.store.database import Database, open_database
from gtf_tune.store.maintenance.digest import study_digest
from gtf_tune.store.runs import digest_of
from gtf_tune.store.studies import stored_definition
from gtf_tune.study import edit
from gtf_tune.study.open_study import OpenStudy, open_study
from gtf_tune.study.outcome.confirm import confirm, plan_confirmation
from gtf_tune.study.runs.run_source import RunSource
from gtf_tune.study.runs.stop import StopRequest
from gtf_tune.study.scoring.rescore import rescore
from gtf_tune.study.work.worker import StudyWorker

ASSETS = Path(__file__).parents[1] / "store" / "assets" / "a5c3ed4"
FINISHED: dict[str, list[Any]] = json.loads((ASSETS / "finished.json").read_text())
FILES = {
    "half_done.db": ("ladder", "confirmed"),
    "samplers.db": ("refine", "tpe", "gp", "cmaes", "qmc", "random", "grid"),
    "early_stopping.db": ("adaptive", "wilcoxon"),
}
FILE_OF = {name: file for file, names in FILES.items() for name in names}
DIGESTS = {
    "ladder": "96b376e3844e5969128503256cf82e267932ff6fbd3c1aa71804954d19ab9d0d",
    "confirmed": "c6cb109ecd58df5281cab7e6fb2308c894d3ba27f427c0397958198936705d11",
    "refine": "96939697090b4dc22e86b0861265db91591c81dcc45f19e688559f2501dd3dc0",
    "tpe": "cb6db1883b561bd8a2e9f8b3cf7ad897a8ef33747720d6724945018b845de345",
    "qmc": "bc750b231f07c04b1c062e71e71956fc9b20587609738fbce7df4f64436b3a41",
    "random": "40b52d9959a469aa638f7137779575a4b82ca2c8df5e17426119ee0dd5f5dce0",
    "grid": "a8825f6b2cba6ec1249b0435d92ecf1c878c6f40ba64ad1ccf2f479eeceed1e9",
}
"""What `study_digest` gives for the finished studies at commit a5c3ed4."""


@pytest.fixture
def stored(tmp_path: Path, request: pytest.FixtureRequest) -> Database:
    """Return a copy of the file that has the study of this name."""
    return open_database(str(shutil.copy(ASSETS / FILE_OF[request.param], tmp_path / "stored.db")))


@pytest.mark.parametrize(("stored", "name"), [(name, name) for name in DIGESTS], indirect=["stored"])
def test_a_study_of_an_earlier_commit_ends_as_it_ended_there(stored: Database, name: str, room: Path) -> None:
    study = open_study(stored, name, {"room": room})
    begun = len(trials.of_study(stored, study.record.id))

    StudyWorker(study, InlineExecutor()).work()

    found = [[one.options, one.state, one.value] for one in trials.of_study(stored, study.record.id)]
    assert begun == 4
    assert [state for _, state, _ in found] == [state for _, state, _ in FINISHED[name]]
    assert [value for *_, value in found] == pytest.approx([value for *_, value in FINISHED[name]], rel=1e-6)
    assert all(mine == pytest.approx(theirs) for (mine, *_), (theirs, *_) in zip(found, FINISHED[name], strict=True))
    if _rounds_alike(study):
        assert study_digest(stored, name) == DIGESTS[name]


@pytest.mark.parametrize(("stored", "name"), [("adaptive", "adaptive"), ("wilcoxon", "wilcoxon")], indirect=["stored"])
def test_a_study_that_stopped_trials_early_goes_on_with_all_runs_of_a_trial(
    stored: Database, name: str, room: Path
) -> None:
    study = open_study(stored, name, {"room": room})
    begun = {one.number: one.state for one in trials.of_study(stored, study.record.id) if one.state != "claimed"}

    StudyWorker(study, InlineExecutor()).work()

    found = {one.number: one for one in trials.of_study(stored, study.record.id)}
    assert "pruned" in begun.values()
    assert {number: found[number].state for number in begun} == begun
    assert len(found) == study.budget > len(begun)
    later = [one for number, one in found.items() if number not in begun]
    assert {one.state for one in later} == {"complete"}
    assert {one.noisy_runs for one in later if one.feasible} == {study.definition.gtf.noisy_runs_max}


def test_a_study_derived_from_one_that_stopped_trials_early_gives_every_trial_all_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = open_database(str(shutil.copy(ASSETS / "early_stopping.db", tmp_path / "stored.db")))
    derived: list[StudyDefinition] = []
    monkeypatch.setattr(edit, "create_study", lambda database, definition, root: derived.append(definition))

    for name in FILES["early_stopping.db"]:
        edit.derive_study(stored, name, edit.Extension(trials=5), f"more-{name}")

    most = [stored_definition(studies.get(stored, name)).gtf.noisy_runs_max for name in FILES["early_stopping.db"]]
    assert [made.gtf.noisy_runs for made in derived] == most
    assert [made.search.pruner for made in derived] == ["none", "none"]


def _rounds_alike(study: OpenStudy) -> bool:
    """Return True if this machine gives the stored runs and scores to the last bit, as not every processor does."""
    (use, *_) = runs.of_trial(study.database, trials.get(study.database, study.record.id, 0).id)
    request = study.planner.request(study.sequences["room"], {}, ("clean", 0), sigma=0.0, number=0)
    again = InlineExecutor().submit(request, RunLimits(60.0, 2**30)).result()
    found = rescore(study.database, study.record.name, {})
    same_scores = [one.score.value for one in found.trials] == [one.trial.value for one in found.trials]
    return same_scores and digest_of(again.trajectory) == use.run.trajectory_digest


@pytest.mark.parametrize(("stored", "name"), [(name, name) for name in FILE_OF], indirect=["stored"])
def test_a_study_of_an_earlier_commit_is_confirmed(stored: Database, name: str, room: Path) -> None:
    study = open_study(stored, name, {"room": room})
    plan = plan_confirmation(study, {}, top=1, noisy_runs=4)

    found = confirm(study, plan, RunSource(stored, InlineExecutor(), RunLimits(60.0, 2**30), StopRequest()))

    assert found.word in ("adopt", "keep nominal")
    assert [one.number for one in found.candidates] == [one.number for one in plan.candidates]
