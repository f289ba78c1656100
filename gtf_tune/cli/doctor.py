"""Say what works on this machine."""

import platform
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import typer

from gtf_tune.cli.parameters import CacheDir, Json
from gtf_tune.cli.terminal.console import say, write_json, write_table
from gtf_tune.errors import MachineError

_PACKAGES = ("pycolmap", "optuna", "optuna-dashboard", "sqlalchemy", "numpy", "scipy", "opencv-python-headless")
_EXTRAS = {"psycopg": "postgres", "distributed": "dask", "kaleido": "png"}
_GIB = 2**30
_NEARLY = 0.95
Check = tuple[str, bool, str]


def doctor(cache_dir: CacheDir = None, json: Json = False) -> None:
    """Check packages, memory, the cache folder and the options of the installed COLMAP.

    Example: gtf-tune doctor
    """
    checks: list[Check] = [
        ("gtf-tune", True, f"{version('gtf-tune')} on Python {platform.python_version()}, {platform.platform()}")
    ]
    checks += [_package(name) for name in _PACKAGES]
    checks.append(_attempt("machine", _machine))
    checks.append(_attempt("stage cache", lambda: _cache(cache_dir)))
    checks.append(_attempt("glomap", _glomap))
    extras = [_extra(module, extra) for module, extra in _EXTRAS.items()]
    if json:
        write_json([{"check": name, "ok": ok, "detail": detail} for name, ok, detail in checks + extras])
    else:
        rows = [(name, "ok" if ok else "FAILS", detail) for name, ok, detail in checks]
        rows += [(name, "ok" if ok else "absent", detail) for name, ok, detail in extras]
        write_table(["what", "state", "detail"], rows)
    if not all(ok for _, ok, _ in checks):
        raise typer.Exit(1)
    say("everything that gtf-tune needs works; absent extras are optional")


def _package(name: str) -> Check:
    try:
        return name, True, version(name)
    except PackageNotFoundError:
        return name, False, f"not installed; run: pip install {name}"


def _extra(module: str, extra: str) -> Check:
    try:
        return module, True, version(module)
    except PackageNotFoundError:
        return module, False, f"optional; pip install 'gtf-tune[{extra}]'"


def _attempt(name: str, check: Callable[[], str]) -> Check:
    """Run a check; the errors of the system and of COLMAP are its answer."""
    try:
        return name, True, check()
    except (OSError, RuntimeError, ImportError, MachineError) as error:
        return name, False, str(error)


def _machine() -> str:
    import psutil

    from gtf_tune.api.defaults import cores, default_jobs
    from gtf_tune.operating_system import available_memory_bytes

    left, total = available_memory_bytes(), psutil.virtual_memory().total
    found = f"{cores()} cores, {left / _GIB:.1f} of {total / _GIB:.1f} GiB memory free"
    if left < psutil.virtual_memory().available * _NEARLY:
        found += " (by the limit of a control group, a container or a SLURM job)"
    return f"{found}, {default_jobs()} runs at a time unless --jobs says otherwise"


def _cache(folder: Path | None) -> str:
    import shutil

    from gtf_tune.execution import default_cache_folder
    from gtf_tune.operating_system import make_private

    place = folder or default_cache_folder()
    make_private(place)
    probe = place / "doctor.tmp"
    probe.write_bytes(b"")
    probe.unlink()
    return f"{place}, {shutil.disk_usage(place).free / _GIB:.0f} GiB free on its disk"


def _glomap() -> str:
    from gtf_tune.pipelines import create_pipeline

    pipeline = create_pipeline("glomap")
    return f"{len(pipeline.options.specs)} tunable options, pycolmap {pipeline.version}"
