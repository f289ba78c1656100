"""Optuna's private names are used in one room, and every one of them exists in the installed Optuna."""

import ast
import inspect
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from pathlib import Path

import optuna
import pytest
from optuna.storages import RDBStorage
from optuna.storages._cached_storage import _CachedStorage
from optuna.study import Study
from optuna.trial import Trial

PACKAGE = Path(__file__).parents[2] / "gtf_tune"
ROOM = PACKAGE / "store" / "optuna"
ELSEWHERE = sorted(path for path in PACKAGE.rglob("*.py") if ROOM not in path.parents)


def study() -> Study:
    return optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=0))


def trial() -> Trial:
    return study().ask()


def rdb() -> RDBStorage:
    return RDBStorage("sqlite://")


def parameters(call: Callable[..., object]) -> list[str]:
    return list(inspect.signature(call).parameters)


def scoped_session_factory() -> object:
    from optuna.storages._rdb.storage import _create_scoped_session

    return parameters(_create_scoped_session) == ["scoped_session", "ignore_integrity_error"]


def tables() -> object:
    from optuna.storages._rdb import models

    names = ("BaseModel", "TrialModel", "TrialParamModel", "TrialUserAttributeModel", "TrialSystemAttributeModel")
    return all(hasattr(models, name) for name in (*names, "TrialIntermediateValueModel"))


NAMES: Mapping[str, Callable[[], object]] = {
    "_backend": lambda: _CachedStorage(rdb())._backend,
    "_cached_frozen_trial": lambda: trial()._cached_frozen_trial,
    "_create_scoped_session": scoped_session_factory,
    "_get_best_trial_id": lambda: RDBStorage._get_best_trial_id,
    "_get_prepared_new_trial": lambda: (
        parameters(RDBStorage._get_prepared_new_trial) == ["self", "study_id", "template_trial", "session"]
    ),
    "_get_trials": lambda: RDBStorage._get_trials,
    "_rdb": tables,
    "_set_trial_param": lambda: (
        parameters(RDBStorage._set_trial_param)
        == ["self", "trial_id", "param_name", "param_value_internal", "distribution", "previous_distribution"]
    ),
    "_storage": lambda: study()._storage,
    "_study_id": lambda: study()._study_id + 1,
    "_thread_local": lambda: hasattr(study()._thread_local, "cached_all_trials"),
    "_trial_id": lambda: trial()._cached_frozen_trial._trial_id + 1,
}
"""Each private name that the room uses, with a call that is true as long as Optuna means by it what the room needs."""


@pytest.mark.parametrize("name", NAMES)
def test_a_private_name_of_optuna_is_still_there(name: str) -> None:
    users = ", ".join(str(path.relative_to(PACKAGE.parent)) for path in sorted(ROOM.glob("*.py")) if _uses(path, name))
    try:
        found = bool(NAMES[name]())
    except (AttributeError, ImportError):
        found = False

    assert found, f"Optuna {version('optuna')} no longer has '{name}' as {users} needs it: adapt that module"


def test_every_private_name_that_the_room_uses_is_checked() -> None:
    used = {name for path in ROOM.glob("*.py") for name in _private(path)}
    ours = {name for path in ROOM.glob("*.py") for name in _defined(path)} - set(NAMES)

    assert used - ours == set(NAMES)


@pytest.mark.parametrize("path", ELSEWHERE, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_other_room_uses_a_private_name_of_optuna(path: Path) -> None:
    assert _private(path) & set(NAMES) <= set(_defined(path))
    assert not [name for name in _imported(path) if name.startswith("optuna.") and "._" in name]


def _uses(path: Path, name: str) -> bool:
    return name in _private(path)


def _private(path: Path) -> set[str]:
    """Return the names with one leading underscore that a file takes from other objects, imports or gives as texts."""
    found = set()
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.Attribute) and not (isinstance(node.value, ast.Name) and node.value.id == "self"):
            found.add(node.attr)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Call):  # super()
            found.add(node.attr)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
            found.add(node.value)
    found |= {part for name in _imported(path) for part in name.split(".")}
    return {name for name in found if name.startswith("_") and not name.startswith("__")}


def _defined(path: Path) -> Iterator[str]:
    """Yield the names with a leading underscore that a file defines itself."""
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not _overrides(node):
            yield node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store) and ast.unparse(node.value) == "self":
            yield node.attr


def _overrides(node: ast.FunctionDef | ast.ClassDef) -> bool:
    return f"super().{node.name}" in ast.unparse(node)


def _imported(path: Path) -> Iterator[str]:
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _tree(path: Path) -> ast.AST:
    return ast.parse(path.read_text(encoding="utf-8"))
