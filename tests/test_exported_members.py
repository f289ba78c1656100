"""The public surface: what packages export is sorted, importable and documented."""

import importlib
import inspect
import pkgutil
from importlib.resources import files
from types import ModuleType

import pytest

import gtf_tune

PACKAGES = [
    module.name
    for module in pkgutil.walk_packages(gtf_tune.__path__, "gtf_tune.")
    if module.ispkg and ".migrations" not in module.name
]
EXPORTING = [name for name in PACKAGES if hasattr(importlib.import_module(name), "__all__")]


@pytest.fixture(params=EXPORTING)
def package(request: pytest.FixtureRequest) -> ModuleType:
    return importlib.import_module(request.param)


@pytest.mark.parametrize("name", PACKAGES)
def test_every_package_says_what_it_is_for(name: str) -> None:
    assert (importlib.import_module(name).__doc__ or "").strip()


def test_type_checkers_are_told_that_the_package_is_typed() -> None:
    assert (files("gtf_tune") / "py.typed").is_file()


def test_names_are_sorted_as_ruff_sorts_them(package: ModuleType) -> None:
    constants = sorted(name for name in package.__all__ if name.isupper())
    classes = sorted(name for name in package.__all__ if name[0].isupper() and not name.isupper())
    rest = sorted(name for name in package.__all__ if not name[0].isupper())

    assert list(package.__all__) == constants + classes + rest


def test_names_can_be_imported(package: ModuleType) -> None:
    assert [name for name in package.__all__ if not hasattr(package, name)] == []


def test_everything_that_is_imported_by_name_is_exported(package: ModuleType) -> None:
    public = {
        name
        for name, value in vars(package).items()
        if not name.startswith("_") and not inspect.ismodule(value) and _comes_from(value, package.__name__)
    }

    assert public <= set(package.__all__)


def test_exported_classes_and_functions_are_documented(package: ModuleType) -> None:
    undocumented = [
        name
        for name in package.__all__
        if inspect.isclass(value := getattr(package, name)) or inspect.isfunction(value)
        if not inspect.getdoc(value)
    ]

    assert undocumented == []


def _comes_from(value: object, package: str) -> bool:
    return str(getattr(value, "__module__", "")).startswith(package)
