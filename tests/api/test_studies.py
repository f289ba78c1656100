"""Studies from Python, their runs in this process."""

import builtins
import logging
from pathlib import Path
from typing import Any

import numpy as np
import optuna
import pytest

import gtf_tune as gtf
from gtf_tune.execution import InlineExecutor
from gtf_tune.store.database import open_database
from gtf_tune.store.maintenance.digest import study_digest
from tests.study.conftest import write_sequence

SPACE = {"filter.max_error": (3e-4, 1e-1, "log")}
GTF = {"noise_sigma": 5.0, "noisy_runs": 4}


def analytic(name: str = "photos", **more: Any) -> gtf.Study:
    return gtf.create_study(name, sequence="photos/", pipeline="analytic", space=SPACE, gtf=GTF, **more)


# From creation to the verdict


def test_a_study_is_created_run_confirmed_and_read(folder: Path, here: list[InlineExecutor]) -> None:
    study = analytic(settings={"collapse_rate": 0.0})

    verdict = study.run(trials=8).confirm()

    assert [trial.number for trial in study.trials] == list(range(8))
    assert study.trials[0].options == {"filter.max_error": 0.01}
    assert (verdict.word, study.best.decision) == ("adopt", "adopt")
    assert study.best.number == verdict.adopted
    assert study.best.improvement == verdict.adopted_candidate.improvement
    assert f"Adopt the options of trial {verdict.adopted}." in study.best.text
    assert study.best.value < study.trials[0].value
    assert study.best.options == study.trials[study.best.number].options
    assert (folder / "gtf-tune.db").exists()


def test_trials_are_the_total_and_more_of_them_go_on(folder: Path, here: list[InlineExecutor]) -> None:
    study = analytic(trials=3)

    counts = [len(study.run(total).trials) for total in (None, 3, 2, 5)]

    assert counts == [3, 3, 3, 5]
    assert sum(len(executor.executed) for executor in here) == 5 * 6
    assert study.definition.search.trials == 5


def test_fewer_trials_than_there_are_begin_no_other(folder: Path, here: list[InlineExecutor]) -> None:
    """The study would go on to its 50 trials."""
    study = analytic().run(2)

    assert len(study.run(1).trials) == 2


def test_enqueued_trials_are_tried_next_and_count(folder: Path, here: list[InlineExecutor]) -> None:
    study = analytic().run(2)

    number = study.enqueue({"filter.max_error": 0.002})

    assert number == 2
    assert [trial.options["filter.max_error"] for trial in study.run(4).trials][2] == 0.002
    assert len(study.trials) == 4
    with pytest.raises(gtf.GtfTuneError, match="cannot try these options"):
        study.enqueue({"filter.max_error": 0.5})


def test_a_study_of_python_is_that_of_a_definition(folder: Path, here: list[InlineExecutor]) -> None:
    """The same study from the command line has the same digest."""
    from gtf_tune.store.database import create_database
    from gtf_tune.study.create import checked_definition, create_study
    from gtf_tune.study.open_study import open_study
    from gtf_tune.study.work.worker import StudyWorker
    from tests.study.conftest import definition_of

    analytic(trials=5).run()
    data = definition_of(folder / "photos", name="photos", gtf=GTF, search={"sampler": "refine", "trials": 5})
    data |= {"sequences": [{"name": "photos", "path": str(folder / "photos")}]}
    data["space"] = {"filter.max_error": {"low": 3e-4, "high": 1e-1, "log": True}}
    database = create_database("other.db")
    create_study(database, checked_definition(data, "test"), folder)
    StudyWorker(open_study(database, "photos"), InlineExecutor()).work()

    assert study_digest(open_database("gtf-tune.db"), "photos") == study_digest(database, "photos")


def test_opened_again_a_study_goes_on(folder: Path, here: list[InlineExecutor]) -> None:
    analytic(trials=2).run()

    assert len(gtf.open_study("photos").run(4).trials) == 4


def test_the_storage_is_that_of_the_environment(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GTF_TUNE_STORAGE", "elsewhere.db")

    analytic()

    assert "elsewhere.db" in gtf.open_study("photos").storage
    with pytest.raises(gtf.GtfTuneError, match="there is no storage at gtf-tune"):
        gtf.open_study("photos", storage="gtf-tune.db")


def test_progress_is_logged(folder: Path, here: list[InlineExecutor], caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, logger="gtf_tune"):
        analytic(trials=2).run()

    assert [record.message.split(":")[1] for record in caplog.records] == [
        " trial 0 begins",
        " trial 0 is done",
        " trial 1 begins",
        " trial 1 is done",
    ]


# What is given


def test_lists_tables_and_several_sequences_are_taken_as_in_a_definition(folder: Path) -> None:
    write_sequence(folder / "more", ground_truth=False, frames=10)

    study = gtf.create_study(
        "both",
        sequence={"one": "photos", "two": folder / "more"},
        pipeline="analytic",
        space={
            "filter.max_error": {"low": 1e-4, "high": 1e-1, "log": True, "points": 5},
            "robust.kernel": ["huber", "cauchy"],
            "matching.max_ratio": np.array([0.7, 0.8]),
            "robust.scale": (0.1, 2.0),
        },
        options={"refine.intrinsics": False},
        settings={"collapse_rate": 0.0},
        search={"sampler": "tpe", "seed": 3},
        limits={"run_timeout_s": 60},
        trials=7,
    )

    definition = study.definition
    assert [sequence.name for sequence in definition.sequences] == ["one", "two"]
    assert definition.space["filter.max_error"].points == 5
    assert definition.space["robust.kernel"].values == ["huber", "cauchy"]
    assert definition.space["matching.max_ratio"].values == [0.7, 0.8]
    assert not definition.space["robust.scale"].log
    assert (definition.search.sampler, definition.search.seed, definition.search.trials) == ("tpe", 3, 7)
    assert definition.pipeline.options == {"refine.intrinsics": False}
    assert definition.limits.run_timeout_s == 60


def test_the_users_own_values_are_what_nominal_means(folder: Path, here: list[InlineExecutor]) -> None:
    study = analytic(nominal={"filter.max_error": 0.02})

    assert study.run(1).trials[0].options == {"filter.max_error": 0.02}


@pytest.mark.parametrize("axis", [(1,), (1e-4, 1e-1, "lin"), ("a", "b"), "huber", 0.5])
def test_what_is_no_axis_is_refused(folder: Path, axis: Any) -> None:
    with pytest.raises(gtf.GtfTuneError, match=r"axis of option 'filter.max_error' must be \(low, high\)"):
        gtf.create_study("a", sequence="photos", pipeline="analytic", space={"filter.max_error": axis})


def test_an_unknown_option_is_refused_with_near_names(folder: Path) -> None:
    with pytest.raises(gtf.GtfTuneError, match=r"did you mean 'filter\.max_error'"):
        gtf.create_study("a", sequence="photos", pipeline="analytic", space={"filter.max_eror": (0.1, 0.2)})


def test_without_a_space_the_preset_of_the_pipeline_is_searched(folder: Path) -> None:
    study = gtf.create_study("photos", sequence="photos")

    assert "mapper.max_normalized_reproj_error" in study.definition.space
    with pytest.raises(gtf.GtfTuneError, match="nothing says what to search on pipeline 'analytic'"):
        gtf.create_study("a", sequence="photos", pipeline="analytic")


def test_a_taken_name_is_refused(folder: Path) -> None:
    analytic()

    with pytest.raises(gtf.GtfTuneError, match="exists already"):
        analytic()


# What a study shows


@pytest.fixture
def done(folder: Path, here: list[InlineExecutor]) -> gtf.Study:
    return analytic(trials=5).run()


def test_trials_become_a_data_frame(done: gtf.Study) -> None:
    pandas = pytest.importorskip("pandas")

    frame = done.to_dataframe()

    assert isinstance(frame, pandas.DataFrame)
    assert frame["number"].tolist() == [0, 1, 2, 3, 4]
    assert frame["value"].tolist() == [trial.value for trial in done.trials]
    assert frame["options.filter.max_error"].tolist() == [trial.options["filter.max_error"] for trial in done.trials]
    assert frame["state"].tolist() == ["complete"] * 5


def test_without_pandas_the_list_of_trials_is_named(done: gtf.Study, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def missing(name: str, *given: Any) -> Any:
        if name == "pandas":
            raise ModuleNotFoundError(name=name)
        return real(name, *given)

    monkeypatch.setattr(builtins, "__import__", missing)

    with pytest.raises(gtf.GtfTuneError, match="run pip install pandas, or take the list of trials"):
        done.to_dataframe()


def test_a_study_without_trials_is_an_empty_data_frame(folder: Path) -> None:
    pytest.importorskip("pandas")

    assert analytic().to_dataframe().empty


@pytest.mark.parametrize("panel", ["options", "search", "matrices", "trajectories", "coverage"])
def test_panels_of_the_report_are_figures(done: gtf.Study, panel: str) -> None:
    from plotly.graph_objects import Figure

    assert isinstance(done.plot(panel), Figure)


def test_a_figure_of_a_panel_is_chosen_by_its_name(done: gtf.Study) -> None:
    assert done.plot("options", "filter.max_error").layout.xaxis.title.text == "max_error"
    with pytest.raises(gtf.GtfTuneError, match="has the figures 'option filter"):
        done.plot("options", "robust.scale")
    with pytest.raises(gtf.GtfTuneError, match="there is no panel 'opions'; panels are verdict, models, options"):
        done.plot("opions")


def test_what_cannot_be_drawn_yet_is_one_sentence(folder: Path) -> None:
    with pytest.raises(gtf.GtfTuneError, match="has the figures none so far"):
        analytic().plot()


def test_optuna_reads_the_same_study(done: gtf.Study) -> None:
    study = done.optuna

    assert isinstance(study, optuna.Study)
    assert [trial.value for trial in study.trials] == [trial.value for trial in done.trials]


def test_without_a_feasible_trial_there_is_no_best(folder: Path) -> None:
    with pytest.raises(gtf.GtfTuneError, match="no feasible trial"):
        _ = analytic().best


# In one call


def test_tune_creates_runs_and_confirms_and_goes_on(folder: Path, here: list[InlineExecutor]) -> None:
    given = {"space": SPACE, "pipeline": "analytic", "gtf": GTF}

    first = gtf.tune("photos", trials=3, **given)
    again = gtf.tune("photos", trials=3, **given)

    assert first.name == again.name == "photos"
    assert len(first.trials) == 3
    assert first.is_confirmed
    assert again.best == first.best
    assert sum(len(executor.executed) for executor in here) == 3 * 6 + 3 * (2 + 8)  # the second look decides


@pytest.mark.parametrize(
    ("other", "part"),
    [
        ({"space": {"filter.max_error": (1e-4, 1e-1, "log")}}, "another space"),
        (
            {"pipeline": "glomap", "space": {"mapper.min_tri_angle_deg": (0.5, 3.0)}},
            "another pipeline and another space",
        ),
    ],
)
def test_tune_refuses_another_study_under_a_known_name(
    folder: Path, here: list[InlineExecutor], other: dict[str, Any], part: str
) -> None:
    analytic(trials=2)

    with pytest.raises(gtf.GtfTuneError, match=f"exists with {part}; give another name"):
        gtf.tune("photos", **{"space": SPACE, "pipeline": "analytic", **other})


def test_evaluate_scores_one_configuration(folder: Path, here: list[InlineExecutor]) -> None:
    best, nominal = (
        gtf.evaluate("photos", pipeline="analytic", options=options, gtf=GTF)
        for options in ({"filter.max_error": 0.002}, {})
    )

    assert best.interval[0] < best.value < nominal.value
