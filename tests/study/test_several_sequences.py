import math
from pathlib import Path

import numpy as np
import pytest

from gtf_tune.definition import GtfDefinition
from gtf_tune.errors import SequenceError
from gtf_tune.gtf import GtfScore
from gtf_tune.store import studies, trials
from gtf_tune.store.database import Database
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.scoring.objective import SequenceScore, score_trial
from tests.study.conftest import Runner, definition_of, write_sequence

GTF = GtfDefinition()


def scored(value: float, relative_error: float = 0.1) -> SequenceScore:
    """Return a feasible score of a sequence."""
    score = GtfScore(
        value=value,
        standard_error=relative_error * value,
        confidence_interval=(value * math.exp(-2 * relative_error), value * math.exp(2 * relative_error)),
        matrix=np.full((2, 3), value),
        pair_errors={},
        coverage_clean=np.ones(2),
        coverage_noisy=np.ones(3),
        extents=np.ones((2, 3)),
        matched=np.full((2, 3), 50),
        num_frames=50,
        collapsed=np.zeros(3, dtype=bool),
    )
    return SequenceScore(score, coverage=1.0, violation=-0.05)


def test_the_score_is_the_geometric_mean_of_ratios_to_nominal() -> None:
    found = score_trial({"a": scored(0.5), "b": scored(90.0)}, {"a": 1.0, "b": 100.0}, GTF)

    assert found.value == pytest.approx(math.sqrt(0.5 * 0.9))


def test_nominal_itself_scores_one() -> None:
    assert score_trial({"a": scored(0.5), "b": scored(90.0)}, None, GTF).value == pytest.approx(1.0)


def test_the_unit_of_a_sequence_does_not_matter() -> None:
    metres = score_trial({"a": scored(0.5), "b": scored(0.09)}, {"a": 1.0, "b": 0.1}, GTF)
    millimetres = score_trial({"a": scored(0.5), "b": scored(90.0)}, {"a": 1.0, "b": 100.0}, GTF)

    assert metres.value == pytest.approx(millimetres.value)


def test_errors_of_independent_sequences_average_out() -> None:
    alone = score_trial({"a": scored(1.0)}, None, GTF)
    four = score_trial({name: scored(1.0) for name in "abcd"}, None, GTF)

    assert alone.standard_error == pytest.approx(0.1)
    assert four.standard_error == pytest.approx(0.05)
    assert four.confidence_interval == pytest.approx((math.exp(-0.1), math.exp(0.1)))


def test_one_infeasible_sequence_makes_the_trial_infeasible_and_worse_than_any_score() -> None:
    lost = SequenceScore(None, coverage=0.2, violation=0.75, message="a run registered 20% of the frames")

    found = score_trial({"a": scored(0.1), "b": lost}, {"a": 1.0, "b": 1.0}, GTF)

    assert not found.feasible
    assert found.value > 1000
    assert found.message.startswith("b: ")
    assert math.isnan(found.standard_error)


def test_scores_of_each_sequence_are_stored(room: Path, tmp_path: Path, database: Database, run_study: Runner) -> None:
    other = write_sequence(tmp_path / "other", ground_truth=False, frames=9)
    both = [{"name": "room", "path": str(room)}, {"name": "other", "path": str(other)}]
    run_study(definition_of(room, sequences=both, search={"trials": 2}))

    nominal, trial = trials.of_study(database, studies.get(database, "small").id)
    details = trials.details(database, [nominal.id, trial.id])
    ratios = [
        details[trial.id]["sequences"][name]["value"] / details[nominal.id]["sequences"][name]["value"]
        for name in ("room", "other")
    ]

    assert trial.value == pytest.approx(math.sqrt(ratios[0] * ratios[1]))
    assert trial.ci_low is not None
    assert trial.ci_high is not None
    assert trial.ci_low < trial.value < trial.ci_high


@pytest.mark.parametrize("holdout", [True, False])
def test_the_same_images_are_no_second_sequence(holdout: bool, room: Path, database: Database) -> None:
    copied = write_sequence(room.with_name("copied"), ground_truth=False)
    both = [{"name": "room", "path": str(room)}, {"name": "copied", "path": str(copied), "holdout": holdout}]

    with pytest.raises(SequenceError, match="'room' and 'copied' have the same images"):
        create_study(database, checked_definition(definition_of(room, sequences=both), "test"), room)
