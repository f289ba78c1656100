"""Samplers of other packages, named ``module:Class``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import optuna
import pytest
from optuna.distributions import BaseDistribution
from optuna.samplers import BaseSampler
from optuna.trial import FrozenTrial, TrialState, create_trial

from gtf_tune.definition import SearchDefinition, definition_from_dict
from gtf_tune.errors import DefinitionError
from gtf_tune.store import studies, trials
from gtf_tune.store.database import Database
from gtf_tune.store.optuna.foreign_sampler import without_penalties
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.search.samplers import make_sampler
from gtf_tune.study.search.space import SearchSpace
from tests.study.conftest import Runner, definition_of

NOWHERE = SearchSpace(())


class Noting(BaseSampler):
    """Take the low end of every range, and note what it is made with and shown."""

    seeds: ClassVar[list[int]] = []
    shown: ClassVar[list[list[float | None]]] = []
    ended: ClassVar[list[tuple[TrialState, Any]]] = []

    def __init__(self, seed: int, fails: bool = False) -> None:
        self.seeds.append(seed)
        self.fails = fails

    def infer_relative_search_space(self, study: optuna.Study, trial: FrozenTrial) -> dict[str, BaseDistribution]:
        study.stop()  # as Optuna's grid does where nothing is left to try
        return {}

    def sample_relative(self, study: optuna.Study, trial: FrozenTrial, space: dict[str, Any]) -> dict[str, Any]:
        return {}

    def sample_independent(self, study: optuna.Study, trial: FrozenTrial, name: str, distribution: Any) -> float:
        if self.fails:
            raise RuntimeError("no idea")
        self.shown.append([one.value for one in study.get_trials() if one.state == TrialState.COMPLETE])
        return float(distribution.low)

    def after_trial(
        self, study: optuna.Study, trial: FrozenTrial, state: TrialState, values: Sequence[float] | None
    ) -> None:
        self.ended.append((state, values))


@pytest.fixture(autouse=True)
def _nothing_noted() -> None:
    for noted in (Noting.seeds, Noting.shown, Noting.ended):
        noted.clear()


def _with(sampler: str, room: Path, **search: Any) -> dict[str, Any]:
    return definition_of(room, search={"sampler": sampler, "trials": 4, **search})


@pytest.fixture
def importable(monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the name by which a definition reaches `Noting`."""
    import sys
    import types

    module = types.ModuleType("somebodys")
    module.Noting = Noting  # type: ignore[attr-defined]
    module.number = 3  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "somebodys", module)
    return "somebodys:Noting"


def test_a_study_is_searched_by_any_sampler(room: Path, database: Database, run_study: Runner, importable: str) -> None:
    run_study(_with(importable, room))

    found = trials.of_study(database, studies.get(database, "small").id)
    assert [one.options for one in found][1:] == [{"filter.max_error": 3e-4}] * 3
    assert len(set(Noting.seeds)) == 4  # one of each trial, repeated after a resume
    assert Noting.ended == [(TrialState.COMPLETE, [one.value]) for one in found]


def test_a_sampler_gets_its_arguments_and_no_other_seed(room: Path, run_study: Runner, importable: str) -> None:
    run_study(_with(importable, room, sampler_arguments={"seed": 5}))

    assert set(Noting.seeds) == {5}


def test_a_sampler_sees_no_penalties(room: Path, database: Database, run_study: Runner, importable: str) -> None:
    strict = {"filter.max_error": {"low": 1e-5, "high": 0.1, "log": True}}

    run_study(_with(importable, room) | {"space": strict})

    nominal, second, *_ = trials.of_study(database, studies.get(database, "small").id)
    assert (second.feasible, nominal.feasible) == (False, True)
    assert second.value is not None
    assert second.value > 1
    assert Noting.shown[1] == [nominal.value, nominal.value]


def test_penalties_become_the_worst_feasible_score() -> None:
    found = [
        create_trial(state=TrialState.COMPLETE, value=value, constraints={"coverage": violation})
        for value, violation in [(0.002, -0.1), (1.5, 0.4), (0.007, 0.0)]
    ]
    for number, trial in enumerate(found):
        trial.number = number

    assert [one.value for one in without_penalties(found)] == [0.002, 0.007, 0.007]
    assert [one.value for one in found] == [0.002, 1.5, 0.007]
    assert without_penalties(found[1:2]) == found[1:2]


@pytest.mark.parametrize("name", ["CmaEsSampler", "NSGAIISampler", "NSGAIIISampler", "QMCSampler", "BruteForceSampler"])
def test_optunas_own_samplers_search_a_study(name: str, room: Path, database: Database, run_study: Runner) -> None:
    if name == "CmaEsSampler":
        pytest.importorskip("cmaes", reason="the package cmaes is not installed")

    run_study(
        _with(f"optuna.samplers:{name}", room, trials=5) | {"space": {"tracks.min_length": {"low": 2, "high": 4}}}
    )

    found = trials.of_study(database, studies.get(database, "small").id)
    assert [one.state for one in found] == ["complete"] * 5


def test_gp_looks_near_the_best_score_beside_an_infeasible_region() -> None:
    pytest.importorskip("torch", reason="the package torch is not installed")
    study = optuna.create_study()
    for number in range(20):
        study.sampler = make_sampler(SearchDefinition(sampler="optuna.samplers:GPSampler"), number, NOWHERE)
        trial = study.ask()
        x = trial.suggest_float("x", 0.0, 1.0)
        trial.set_constraint("coverage", 0.4 - x)
        study.tell(trial, 1.5 if x < 0.4 else 1e-3 * (1 + 20 * (x - 0.7) ** 2))

    late = [abs(trial.params["x"] - 0.7) for trial in study.trials[12:]]
    assert sum(distance < 0.1 for distance in late) > len(late) / 2


@pytest.mark.parametrize(
    ("name", "arguments", "reason"),
    [
        (
            "nobodys.package:Sampler",
            {},
            r"cannot be imported \(ModuleNotFoundError: No module named 'nobodys'\); install",
        ),
        ("somebodys:Notting", {}, r"cannot be imported \(AttributeError: .*has no attribute 'Notting'"),
        ("somebodys:number", {}, "is not a class of Optuna samplers"),
        ("somebodys:Noting", {"sed": 3}, r"cannot be made \(TypeError: .*'sed'\); check sampler_arguments"),
    ],
)
def test_a_sampler_that_cannot_be_made_is_refused_with_the_reason(
    name: str, arguments: dict[str, Any], reason: str, room: Path, database: Database, importable: str
) -> None:
    definition = checked_definition(_with(name, room, sampler_arguments=arguments), "test")

    with pytest.raises(DefinitionError, match=reason):
        create_study(database, definition, room)


def test_a_sampler_that_fails_is_named_and_the_study_goes_on_with_another(
    room: Path, database: Database, run_study: Runner, importable: str
) -> None:
    from gtf_tune.study.edit import change_sampler

    with pytest.raises(DefinitionError, match=r"sampler 'somebodys:Noting' failed \(RuntimeError: no idea\)"):
        run_study(_with(importable, room, sampler_arguments={"fails": True}))
    change_sampler(database, "small", "random")
    run_study(_with("random", room))

    study = studies.get(database, "small")
    assert study.state == "done"
    assert [one.state for one in trials.of_study(database, study.id)] == ["complete"] * 4


@pytest.mark.parametrize(
    ("search", "reason"),
    [
        ({"sampler": "refin"}, "or module:Class of an Optuna sampler, not 'refin'; did you mean 'refine'"),
        ({"sampler": "a b:C"}, "module:Class"),
        ({"sampler": "tpe", "sampler_arguments": {"seed": 1}}, "takes no sampler_arguments"),
    ],
)
def test_what_is_no_name_of_a_sampler_is_refused(search: dict[str, Any], reason: str, room: Path) -> None:
    with pytest.raises(DefinitionError, match=reason):
        definition_from_dict(definition_of(room, search=search))
