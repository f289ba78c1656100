"""Systems are compared under the same noise, and options are checked with as few runs as that takes."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from gtf_tune.definition import GtfDefinition, LimitsDefinition
from gtf_tune.errors import DefinitionError
from gtf_tune.execution import InlineExecutor
from gtf_tune.sequence import load_sequence
from gtf_tune.store.database import Database
from gtf_tune.study.check_options import MOST_RUNS, OptionCheck, check_options, systems_like, tuned_like
from gtf_tune.study.runs.run_source import RunSource, run_limits
from gtf_tune.study.runs.stop import StopRequest
from gtf_tune.study.systems import (
    OrderAgreement,
    System,
    SystemComparison,
    compare_systems,
    order_agreement,
    read_system,
)
from gtf_tune.study.tune import start
from gtf_tune.study.tune.start import TuneRequest
from tests.study.conftest import Runner, definition_of

GTF = GtfDefinition(noise_sigma=5.0, noisy_runs=6)
NOMINAL = read_system("analytic")


def system(name: str, **options: float) -> System:
    named = {option.replace("__", "."): value for option, value in options.items()}
    return replace(NOMINAL, name=name, options=NOMINAL.pipeline.options.check(named))


GOOD = system("good", filter__max_error=0.002)
WORSE = system("worse", robust__scale=5.0)
LOSSY = system("lossy", filter__max_error=3e-5)


@pytest.fixture
def source(database: Database) -> RunSource:
    return RunSource(database, InlineExecutor(), run_limits(LimitsDefinition()), StopRequest())


def compared(room: Path, source: RunSource, *systems: System) -> SystemComparison:
    return compare_systems(systems, load_sequence(room), GTF, 0, source)


def test_each_system_is_compared_with_the_first_under_the_same_noise(room: Path, source: RunSource) -> None:
    found = compared(room, source, NOMINAL, GOOD, WORSE)

    assert [system.name for system in found.systems] == ["analytic", "good", "worse"]
    assert found.candidate(1).improvement.low > 0 > found.candidate(2).improvement.high
    assert [found.is_comparable(index) for index in (1, 2)] == [True, True]
    assert found.agreement == OrderAgreement(3, 3)
    assert found.as_json()["systems"][1]["against_first"]["improvement"] == found.candidate(1).improvement.value


def test_a_system_that_loses_frames_is_not_comparable_and_the_reason_names_the_first(
    room: Path, source: RunSource
) -> None:
    found = compared(room, source, NOMINAL, LOSSY)

    assert not found.is_comparable(1)
    assert any("where analytic registers 12" in remark for remark in found.remarks(1))
    assert not any("nominal" in remark for remark in found.remarks(1))
    assert math.isnan(found.agreement.tau)


def test_trajectories_of_another_scale_are_comparable_only_where_the_score_divides_by_it(
    room: Path, source: RunSource
) -> None:
    found = compared(room, source, NOMINAL, GOOD)
    first, other = found.systems
    (name, score), *_ = other.scores.scores.items()
    unscaled = replace(score.settings, normalise="none")

    def with_extents(one: object, factor: float) -> object:
        scores = {name: replace(score, extents=factor * score.extents, settings=unscaled)}
        return replace(one, scores=replace(one.scores, scores=scores))  # type: ignore[type-var, attr-defined]

    same = replace(found, systems=(with_extents(first, 1.0), with_extents(other, 1.1)))  # type: ignore[arg-type]
    larger = replace(found, systems=(with_extents(first, 1.0), with_extents(other, 3.0)))  # type: ignore[arg-type]

    assert (same.is_comparable(1), larger.is_comparable(1)) == (True, False)


def test_pairs_that_are_equal_in_one_of_two_orders_do_not_count() -> None:
    found = order_agreement([(1.0, 10.0), (2.0, 30.0), (3.0, 20.0), (3.0, 40.0)])

    assert found == OrderAgreement(pairs=5, agreeing=4)
    assert found.tau == pytest.approx(0.6)


@pytest.mark.parametrize("names", [("a",), ("a", "a")])
def test_two_different_systems_are_needed(names: tuple[str, ...], room: Path, source: RunSource) -> None:
    with pytest.raises(DefinitionError, match="two or more different systems"):
        compared(room, source, *(replace(NOMINAL, name=name) for name in names))


def test_options_and_pipelines_are_read_from_files(tmp_path: Path) -> None:
    options, definition = tmp_path / "tuned.json", tmp_path / "study.toml"
    options.write_text('{"filter": {"max_error": 0.002}}')
    definition.write_text('[pipeline]\nname = "analytic"\nnominal = { "robust.scale" = 3.0 }\n')

    assert read_system(str(options), "analytic").options == {"filter.max_error": 0.002}
    assert read_system(str(definition)).options == {"robust.scale": 3.0}
    with pytest.raises(DefinitionError, match=r"missing.json' is no JSON file"):
        read_system(str(tmp_path / "missing.json"), "analytic")


def checked(room: Path, source: RunSource, options: System) -> OptionCheck:
    return check_options(NOMINAL, options, load_sequence(room), GTF, 0, source)


def test_a_clear_gain_and_a_fault_end_a_check_at_the_first_look(room: Path, source: RunSource) -> None:
    good, lossy = checked(room, source, GOOD), checked(room, source, LOSSY)

    assert (good.outcome, good.noisy_runs) == ("holds", 4)
    assert "The options hold here, after 4 noisy runs of each" in good.text
    assert (lossy.outcome, lossy.noisy_runs) == ("does not hold", 4)
    assert "where nominal registers 12" in lossy.text


def test_options_that_are_worse_do_not_hold(room: Path, source: RunSource) -> None:
    assert checked(room, source, WORSE).outcome == "does not hold"


def test_what_cannot_be_told_from_nominal_takes_all_looks(room: Path, source: RunSource) -> None:
    found = checked(room, source, system("same", robust__scale=1.03))

    assert (found.outcome, found.noisy_runs) == ("no difference", MOST_RUNS)


def test_a_study_gives_its_pipeline_noise_and_options_to_a_check_and_a_start_to_another(
    room: Path, database: Database, run_study: Runner, tmp_path: Path
) -> None:
    pipeline = {"name": "analytic", "nominal": {"robust.scale": 2.0}}
    run_study(definition_of(room, pipeline=pipeline, search={"sampler": "grid", "trials": None}))
    options = tmp_path / "mine.json"
    options.write_text('{"filter": {"max_error": 0.002}}')

    nominal, adopted, gtf = systems_like(database, "small", None)
    _, mine, _ = systems_like(database, "small", options)
    request = tuned_like(database, "small", TuneRequest(room, 5.0, 1, sections={"search": {"trials": 4}}))

    assert nominal.options == {"robust.scale": 2.0}
    assert (adopted.name, adopted.options["robust.scale"], gtf.noise_sigma) == ("small", 2.0, 5.0)
    assert adopted.options["filter.max_error"] != 0.01
    assert mine.options == {"robust.scale": 2.0, "filter.max_error": 0.002}
    assert request.start == {"filter.max_error": adopted.options["filter.max_error"]}
    assert request.sections["pipeline"]["nominal"] == {"robust.scale": 2.0}
    assert list(request.sections["space"]) == ["filter.max_error"]
    assert request.identity != TuneRequest(room, 5.0, 1, sections=request.sections).identity
    first = start._definition(request, "next").search.first
    assert dict(first[0]) == request.start
