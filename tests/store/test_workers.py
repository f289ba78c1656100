import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from gtf_tune.store.trial_queue import has_died, this_worker


def test_this_process_lives() -> None:
    me = this_worker()
    assert me.pid == os.getpid()
    assert me.name == f"{me.host}:{me.pid}"
    assert not has_died(me)


def test_a_process_that_ended_has_died_even_before_it_is_reaped() -> None:
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    start = int(Path(f"/proc/{child.pid}/stat").read_text().rpartition(")")[2].split()[19])
    worker = replace(this_worker(), pid=child.pid, pid_started=start)
    alive = not has_died(worker)
    child.kill()
    os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
    unreaped = has_died(worker)
    child.communicate()
    assert (alive, unreaped, has_died(worker)) == (True, True, True)


def test_a_new_process_with_an_old_number_is_not_mistaken() -> None:
    me = this_worker("mine")
    assert has_died(replace(me, pid_started=me.pid_started - 100))


def test_nothing_is_said_about_processes_of_other_machines() -> None:
    assert not has_died(replace(this_worker(), machine="elsewhere", pid=0))
