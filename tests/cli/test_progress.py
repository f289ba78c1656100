import itertools
from types import SimpleNamespace

import pytest

from gtf_tune.cli.terminal import progress
from gtf_tune.definition import GtfDefinition
from gtf_tune.display import sequence_unit
from gtf_tune.store.trial_queue import TrialResult
from gtf_tune.study.events import NoiseChosen, NoiseStarted, TrialFinished


def test_runs_that_choose_the_noise_do_not_count_in_the_time_that_trials_take(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seconds = itertools.count(0, 100)
    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=lambda: float(next(seconds))))
    shown = progress.StudyProgress(3, 0, sequence_unit(GtfDefinition()), None)

    shown.on_event(NoiseStarted("room", 0.0, 6))
    shown.on_event(NoiseStarted("room", 0.5, 4))
    shown.on_event(NoiseChosen("room", 0.5, "it is the weakest"))
    shown.on_event(TrialFinished(0, {}, TrialResult("complete", value=0.002, feasible=True)))

    said = capsys.readouterr().err
    assert "noise of room: 0.5 grey levels (it is the weakest)" in said
    assert "6 min 40 s left" in said
