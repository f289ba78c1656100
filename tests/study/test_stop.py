import signal
from collections.abc import Callable

import pytest

from gtf_tune.study.runs import stop as stop_module
from gtf_tune.study.runs.stop import FINISH_RUNS, STOP_NOW, StopRequest, signals_to


def test_sigterm_leaves_runs_six_seconds_and_ends_the_process_within_ten(monkeypatch: pytest.MonkeyPatch) -> None:
    later: dict[float, Callable[[], None]] = {}
    ended: list[int] = []
    monkeypatch.setattr(stop_module, "_later", later.__setitem__)
    monkeypatch.setattr(stop_module.os, "_exit", ended.append)
    stop = StopRequest()

    with signals_to(stop, lambda _: None):
        signal.raise_signal(signal.SIGTERM)
    levels = [stop.level]
    for _, action in sorted(later.items()):
        action()
        levels.append(stop.level)

    assert levels == [FINISH_RUNS, STOP_NOW, STOP_NOW]
    assert ended == [130]
    assert min(later) == 6.0
    assert max(later) < 10.0


def test_ctrl_c_finishes_runs_and_twice_stops_at_once() -> None:
    before = signal.getsignal(signal.SIGINT)
    stop, levels = StopRequest(), []

    with signals_to(stop, lambda _: None):
        for _ in range(2):
            signal.raise_signal(signal.SIGINT)
            levels.append(stop.level)

    assert levels == [FINISH_RUNS, STOP_NOW]
    assert signal.getsignal(signal.SIGINT) is before
