"""What this machine allows, and what stands in for it where an operating system lacks something."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

import gtf_tune
from gtf_tune import operating_system
from gtf_tune.cli.parameters import make_executor
from gtf_tune.errors import MachineError
from gtf_tune.operating_system import available_memory_bytes, make_private, open_lock_file, process_start
from gtf_tune.store import trial_queue
from tests.study.conftest import write_sequence

GIB = 2**30
PACKAGE = Path(gtf_tune.__file__).parent
SCRIPTS = {"execution/watchdog.py", "pipelines/command/supervisor.py"}
ONLY_THERE = {"fcntl", "msvcrt", "resource", "pwd", "grp", "termios"}

HIDING = """
import builtins, io, os, signal
_import, _open = builtins.__import__, io.open
def hiding(name, globals=None, *rest, **named):
    if name in ("fcntl", "resource", "msvcrt") and str((globals or {}).get("__name__")).startswith("gtf_tune"):
        raise ImportError(name)
    return _import(name, globals, *rest, **named)
def without_proc(path, *rest, **named):
    if str(path).startswith("/proc"):
        raise FileNotFoundError(path)
    return _open(path, *rest, **named)
builtins.__import__, io.open = hiding, without_proc
for name in ("pidfd_open", "sched_getaffinity", "setpgid", "killpg"):
    delattr(os, name)
del signal.pthread_sigmask
"""


def test_a_study_runs_where_nothing_of_linux_is_to_be_had(tmp_path: Path) -> None:
    """Processes of runs hide it too: they inherit PYTHONPATH, where Python finds sitecustomize."""
    (tmp_path / "sitecustomize.py").write_text(HIDING)
    write_sequence(tmp_path / "room", ground_truth=True)
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{PACKAGE.parent}", "GTF_TUNE_CACHE_DIR": "cache"}
    create = "study create small -p analytic -s room -n 2 -k 1 -K 2 --noise-sigma 5 -r filter.max_error=1e-3:1e-1:log"
    code = f"""
import sys
from gtf_tune.cli.main import main
for command in ({create!r}, "study run small --jobs 2 --no-dashboard", "storage check"):
    sys.argv = ["gtf-tune", *command.split()]
    try:
        main()
    except SystemExit as end:
        assert not end.code
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )

    assert (done.returncode, "2/2" in done.stderr) == (0, True), done.stderr


def test_no_other_module_takes_what_windows_lacks() -> None:
    found = []
    for path in PACKAGE.rglob("*.py"):
        name = path.relative_to(PACKAGE).as_posix()
        if name == "operating_system.py" or name in SCRIPTS:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
            found += [f"{name}: {one}" for one in names if one in ONLY_THERE]
            if isinstance(node, ast.Constant) and str(node.value).startswith("/proc"):
                found.append(f"{name}: {node.value}")

    assert found == []


def test_the_process_of_another_user_that_is_hidden_counts_as_alive(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """As on machines that mount /proc with hidepid=2, where workers were taken for dead."""
    (tmp_path / "self").mkdir()
    mine = trial_queue.this_worker()
    monkeypatch.setattr(operating_system, "_PROC", tmp_path)
    monkeypatch.setattr(trial_queue, "machine_name", lambda: mine.machine)

    def refused(pid: int, number: int) -> None:
        raise PermissionError(pid, number)

    monkeypatch.setattr(os, "kill", refused)
    assert not trial_queue.has_died(mine)

    def gone(pid: int, number: int) -> None:
        raise ProcessLookupError(pid, number)

    monkeypatch.setattr(os, "kill", gone)
    assert trial_queue.has_died(mine)


def test_a_process_is_known_by_its_start_also_without_proc(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(operating_system, "_PROC", tmp_path / "none")

    assert process_start(os.getpid()) == process_start(os.getpid()) != 0
    assert process_start(2**22 + 1) is None


LIMITS = {"v2": ("memory.max", "memory.current"), "v1": ("memory.limit_in_bytes", "memory.usage_in_bytes")}


@pytest.mark.parametrize("version", LIMITS)
@pytest.mark.parametrize("visible", [True, False])
def test_the_limit_of_a_control_group_or_of_one_around_it_counts(
    version: str, visible: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A container sees its own group as the root, whatever its path is outside."""
    root, controller = tmp_path / "cgroup", "" if version == "v2" else "memory"
    (tmp_path / "proc/self").mkdir(parents=True)
    (tmp_path / "proc/self/cgroup").write_text(f"4:{controller}:/job/step\n")
    groups = {"job/step": None, "job": (3 * GIB, 2 * GIB)} if visible else {"": (3 * GIB, 2 * GIB)}
    for name, numbers in groups.items():
        folder = root / controller / name
        folder.mkdir(parents=True, exist_ok=True)
        for file, number in zip(LIMITS[version], numbers or ("max", 0), strict=True):
            (folder / file).write_text(f"{number}\n")
        (folder / "memory.stat").write_text(f"anon 5\ninactive_file {GIB // 2}\n")
    monkeypatch.setattr(operating_system, "_PROC", tmp_path / "proc")

    assert list(operating_system._left_in_groups(root)) == [3 * GIB // 2]


def test_the_share_of_a_slurm_job_counts_and_0_is_all_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SLURM_MEM_PER_NODE", "100")
    assert available_memory_bytes() == 100 * 2**20
    monkeypatch.setenv("SLURM_MEM_PER_NODE", "0")
    assert available_memory_bytes() > 100 * 2**20
    monkeypatch.setenv("SLURM_MEM_PER_CPU", "50")
    monkeypatch.setenv("SLURM_CPUS_ON_NODE", "3")
    assert available_memory_bytes() == 150 * 2**20 < psutil.virtual_memory().total


def test_folders_of_the_cache_are_private_and_those_of_others_are_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folder = make_private(tmp_path / "a" / "cache")
    assert folder.stat().st_mode & 0o777 == 0o700
    (tmp_path / "link").symlink_to(folder)
    assert make_private(tmp_path / "link")

    monkeypatch.setattr(operating_system, "user_id", lambda: os.geteuid() + 1)
    for place in (folder, tmp_path / "link"):
        with pytest.raises(MachineError, match="it belongs to another user"):
            make_executor(1, place)
    with pytest.raises(MachineError, match="it belongs to another user"):
        open_lock_file(tmp_path / "lock")


def test_a_link_in_place_of_a_lock_file_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "lock").symlink_to(tmp_path / "victim")

    with pytest.raises(MachineError, match="cannot be trusted"):
        open_lock_file(tmp_path / "lock")
    assert not (tmp_path / "victim").exists()
