"""Studies of Python functions, their runs in this process."""

import signal
from pathlib import Path
from typing import Any

import pytest

import gtf_tune as gtf
from gtf_tune.execution import InlineExecutor
from gtf_tune.pipelines.function import RunImages
from tests.pipelines.slam_functions import circle, with_nominal

GTF = {"noise_sigma": 5.0, "noisy_runs": 4}


def shaken(images: RunImages, options: dict[str, Any], seed: int) -> object:
    return circle(images, options, seed)


def test_a_function_of_a_module_is_tuned_under_its_name(folder: Path, here: list[InlineExecutor]) -> None:
    study = gtf.create_study(
        "mine",
        sequence="photos",
        pipeline=shaken,
        space={"max_error": (1e-4, 1, "log")},
        nominal={"max_error": 0.01, "rounds": 3},
        gtf=GTF,
        trials=3,
    )

    study.run()

    assert study.definition.pipeline.name.endswith("test_function_studies:shaken")
    assert study.definition.pipeline.settings["nominal"] == {"max_error": 0.01, "rounds": 3}
    assert [trial.state for trial in study.trials] == ["complete"] * 3
    assert len(gtf.open_study("mine").run(4).trials) == 4


def test_a_function_may_bring_its_defaults(folder: Path, here: list[InlineExecutor]) -> None:
    study = gtf.create_study("mine", sequence="photos", pipeline=with_nominal, space={"rounds": (1, 9)}, gtf=GTF)

    assert len(study.run(2).trials) == 2
    assert study.trials[0].options == {"rounds": 3}


def test_a_function_is_also_tuned_by_its_name(folder: Path, here: list[InlineExecutor]) -> None:
    study = gtf.create_study(
        "mine",
        sequence="photos",
        pipeline="tests.pipelines.slam_functions:circle",
        space={"max_error": (1e-4, 1.0, "log")},
        nominal={"max_error": 0.01},
        gtf=GTF,
    )

    assert study.run(2).trials[0].options == {"max_error": 0.01}


def test_defaults_that_are_whole_may_have_ranges_that_are_not(folder: Path) -> None:
    study = gtf.create_study("mine", sequence="photos", pipeline=shaken, space={"a": (0.1, 2.0)}, nominal={"a": 1})

    assert study.definition.pipeline.settings["nominal"] == {"a": 1.0}


@pytest.mark.parametrize("nominal", [None, {}])
def test_the_defaults_of_a_function_are_required(folder: Path, nominal: Any) -> None:
    with pytest.raises(gtf.GtfTuneError, match="needs the defaults of its options"):
        gtf.create_study("mine", sequence="photos", pipeline=shaken, space={"a": (0.1, 2.0)}, nominal=nominal)


def test_what_is_no_function_is_refused(folder: Path) -> None:
    with pytest.raises(gtf.GtfTuneError, match="expected the name of a pipeline or a function, not int"):
        gtf.create_study("mine", sequence="photos", pipeline=3, space={"a": (0.1, 2.0)}, nominal={"a": 1})  # type: ignore[arg-type]


def local_study(function: Any, version: str = "") -> gtf.Study:
    return gtf.create_study(
        "local",
        sequence="photos",
        pipeline=function,
        space={"max_error": (1e-4, 1e-1, "log")},
        nominal={"max_error": 0.01},
        version=version,
        gtf=GTF,
        trials=2,
    )


def make(seed: int) -> Any:
    def local(images: RunImages, options: dict[str, Any], _: int) -> object:
        return circle(images, options, seed)

    return local


def test_a_local_function_goes_on_where_it_is_given_again(folder: Path, here: list[InlineExecutor]) -> None:
    local_study(make(1)).run()

    assert len(gtf.open_study("local", pipeline=make(1)).run(3).trials) == 3
    with pytest.raises(gtf.GtfTuneError, match=r"tunes the Python function 'make.<locals>.local' of a script"):
        gtf.open_study("local").run(4)


def test_a_function_that_has_changed_is_refused(folder: Path, here: list[InlineExecutor]) -> None:
    local_study(make(1)).run()

    def local(images: RunImages, options: dict[str, Any], seed: int) -> object:
        return circle(images, options, seed)

    local.__qualname__ = make(1).__qualname__

    with pytest.raises(gtf.GtfTuneError, match="has changed since study 'local' began"):
        gtf.open_study("local", pipeline=local)
    assert len(gtf.open_study("local", pipeline=local, allow_version_mismatch=True).run(3).trials) == 3


def test_a_given_version_says_that_nothing_changed(folder: Path, here: list[InlineExecutor]) -> None:
    local_study(make(1), version="1").run()

    def local(images: RunImages, options: dict[str, Any], seed: int) -> object:
        return circle(images, options, seed)

    local.__qualname__ = make(1).__qualname__

    assert len(gtf.open_study("local", pipeline=local).run(3).trials) == 3


def test_another_function_is_refused(folder: Path) -> None:
    local_study(make(1))

    with pytest.raises(gtf.GtfTuneError, match=r"tunes the pipeline '.*local', not '.*circle'; give"):
        gtf.open_study("local", pipeline=circle)


def test_ctrl_c_ends_the_program_and_keeps_what_is_finished(folder: Path, here: list[InlineExecutor]) -> None:
    def interrupted(images: RunImages, options: dict[str, Any], seed: int) -> object:
        if not Path("pressed").exists():
            Path("pressed").touch()
            signal.raise_signal(signal.SIGINT)
        return circle(images, options, seed)

    study = local_study(interrupted)

    with pytest.raises(KeyboardInterrupt):
        study.run()

    assert [trial.state for trial in study.run().trials] == ["complete"] * 2
    runs = [request.key for executor in here for request in executor.executed]
    assert len(set(runs)) == len(runs) == 2 * 6


def test_a_configuration_of_a_function_is_evaluated(folder: Path, here: list[InlineExecutor]) -> None:
    found = gtf.evaluate("photos", pipeline=shaken, nominal={"max_error": 0.01}, gtf=GTF)
    assert found.score.score.matrix.shape == (2, 4)
