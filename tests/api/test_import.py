"""What ``import gtf_tune`` costs and offers."""

import inspect
import subprocess
import sys

import pytest

import gtf_tune

HEAVY = ("numpy", "scipy", "optuna", "sqlalchemy", "plotly", "pycolmap", "cv2", "pydantic", "typer")


def loaded_after(code: str) -> set[str]:
    lines = f"import sys\n{code}\nprint(*sorted(name for name in sys.modules if '.' not in name))"
    done = subprocess.run([sys.executable, "-c", lines], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_importing_the_package_imports_nothing_heavy() -> None:
    assert loaded_after("import gtf_tune; dir(gtf_tune)").isdisjoint(HEAVY)


def test_scoring_trajectories_needs_numpy_and_scipy_only() -> None:
    found = loaded_after("from gtf_tune import gtf_ate, load_trajectories, Trajectory")

    assert {"numpy", "scipy"} <= found
    assert found.isdisjoint({"optuna", "sqlalchemy", "plotly", "pycolmap", "cv2", "typer"})


def test_names_can_be_listed_and_are_documented() -> None:
    assert set(gtf_tune.__all__) <= set(dir(gtf_tune))
    for name in set(gtf_tune.__all__) - {"__version__"}:
        assert inspect.getdoc(getattr(gtf_tune, name)), name


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'gtf_tune' has no attribute 'tuna'"):
        gtf_tune.tuna  # noqa: B018
