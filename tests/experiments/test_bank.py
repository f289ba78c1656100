"""Rules are replayed on small synthetic banks whose right answers are known."""

from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from experiments.bank.__main__ import ANSWER
from experiments.bank.bank import COPIES, PER_RUN, Bank, load
from experiments.bank.draw import Draw, Others, TooFewRunsError, block, price, seen_of, set_aside
from experiments.bank.page import page, with_short_answer
from experiments.bank.plan import CONFIGURATIONS, FIRST, NOMINAL, SEQUENCES, batches, copies
from experiments.bank.replay import draws, replay, sound
from experiments.bank.results import results_page
from experiments.bank.rules import RULES, confirmed, fixed, in_hindsight, led, nominal, posterior, race

ROOT = Path(__file__).parents[2]
LABELS = tuple(CONFIGURATIONS)[:5]
SECONDS = (1.0, 4.0, 3.0, 2.0, 6.0, 4.0)
"""Of a plain run: 20 in all, of which 8 are shared by all runs of a copy."""


def bank_of(factors, groups=None, spread=0.0, labels=LABELS):
    """Return a bank where both errors of configuration c on sequence s are factors[s][c], 1 being nominal's."""
    factors = np.asarray(factors, dtype=np.float64)
    generator, (sequences, configurations) = np.random.default_rng(0), factors.shape
    shape = (sequences, configurations, len(COPIES))
    noise = np.exp(spread * generator.standard_normal((*shape, len(COPIES))))
    clean_or_weak = np.array([copy.sigma for copy in COPIES]) < 2
    wanted = np.triu(np.ones((len(COPIES), len(COPIES)), bool), 1) & (np.arange(len(COPIES)) < 4)[:, None]
    wanted |= np.triu(np.outer(clean_or_weak, clean_or_weak), 1)
    true = 0.01 * factors[:, :, None] * np.exp(spread * generator.standard_normal(shape))
    values = {name: np.ones(shape) for name in PER_RUN} | {"true": true}
    return Bank(
        sequences=tuple(f"s{number}" for number in range(sequences)),
        groups=tuple(groups or (f"g{number}" for number in range(sequences))),
        labels=labels[:configurations],
        pairs=np.where(wanted, 0.002 * factors[:, :, None, None] * noise, np.nan),
        to_nominal=np.zeros(shape),
        per_run=values,
        seconds=np.tile(np.array(SECONDS), (sequences, configurations, 1)),
        extents=np.ones(sequences),
        frames=np.full(sequences, 12.0),
    )


def first_draw(bank, sequence=0) -> Draw:
    others = Others(bank, bank.groups[sequence])
    return next(draws(bank, sequence, block(bank, sequence), others, 1))


def without_runs(bank, places):
    registered = bank.per_run["registered"].copy()
    registered[places] = np.nan
    return replace(bank, per_run={**bank.per_run, "registered": registered})


def test_the_plan_begins_with_nominal_and_any_beginning_can_be_replayed():
    first = list(islice(batches(), 6 * len(FIRST)))

    assert next(iter(CONFIGURATIONS)) == NOMINAL
    assert {batch.labels for batch in first} == {tuple(CONFIGURATIONS)[:5]}
    assert [batch.sequence.name for batch in first[: len(FIRST)]] == list(FIRST)
    assert sorted({batch.copy for batch in first}) == sorted(copies(2, 4))


def test_the_plan_holds_every_configuration_on_every_copy_in_the_end():
    planned = {(batch.sequence.name, batch.copy, label) for batch in batches() for label in batch.labels}

    assert len(planned) == len(SEQUENCES) * len(COPIES) * len(CONFIGURATIONS)


def test_a_bank_is_read_back_with_four_digits(tmp_path):
    bank = bank_of([[1, 0.7, 0.9]] * 3, spread=0.5)

    bank.save(tmp_path / "runs.npz")
    again = load(tmp_path / "runs.npz")

    assert (again.sequences, again.groups, again.labels) == (bank.sequences, bank.groups, bank.labels)
    np.testing.assert_allclose(again.pairs, bank.pairs, rtol=2e-4)
    np.testing.assert_allclose(again.per_run["true"], bank.per_run["true"], rtol=2e-4)


def test_a_race_adopts_what_moves_least_and_is_judged_by_truth_on_other_copies():
    bank = bank_of([[1, 0.9, 0.5, 1.2, 1.1]] * 4)

    (found,) = replay(bank, {"race": partial(race, size=5, runs=(1, 1))}, count=3)

    assert found.values(sound(bank)) == pytest.approx([-0.5] * 4)
    assert found.picks[0] == {2: 3}


def test_the_fixed_configuration_is_chosen_on_other_groups_only():
    best_is_1, best_is_2 = [1, 0.3, 0.8], [1, 1.1, 0.8]
    bank = bank_of([best_is_1, best_is_1, best_is_2, best_is_2, best_is_2], groups=["a", "a", "b", "c", "d"])

    (found,) = replay(bank, {"fixed": fixed}, count=2)

    assert [set(found.picks[place]) for place in range(5)] == [{2}, {2}, {1}, {1}, {1}]
    assert found.worse(range(5)) == 3


def test_a_portfolio_is_chosen_among_what_other_sequences_have():
    bank = bank_of([[1, 0.9, 0.6, 0.8, 0.9, 0.1]] * 4, labels=tuple(CONFIGURATIONS)[:6])
    partly = without_runs(bank, np.s_[1:, 5])

    assert Others(bank, "g0").portfolio(2, 6) == (0, 5)
    assert Others(partly, "g0").portfolio(2, 6) == (0, 2)


def test_seen_and_unseen_copies_have_no_noise_in_common():
    bank = bank_of([[1, 0.9]] * 2)

    for draw in draws(bank, 0, block(bank, 0), Others(bank, "g0"), 5):
        unseen = {COPIES[place].index for place in draw.unseen}
        seen = {COPIES[place].index for places in draw.noisy.values() for place in places}
        assert len(unseen) == 8
        assert not seen & unseen


@pytest.mark.parametrize(("noisy", "seen"), [(2, 1), (4, 3), (5, 3), (8, 4), (16, 8)])
def test_half_of_the_copies_are_seen_and_all_but_one_of_few(noisy, seen):
    assert seen_of(noisy) == seen


def test_a_clean_and_a_noisy_nominal_run_cost_two_plain_runs_and_another_configuration_only_its_mapping():
    bank = bank_of([[1, 0.9]] * 2)

    assert price(bank, 0, {(0, 0)}) == 1
    assert price(bank, 0, {(0, 0), (0, 4)}) == 2
    assert price(bank, 0, {(0, 0), (0, 4), (1, 0), (1, 4)}) == pytest.approx(2 + 2 * 4 / 20)


def test_clean_runs_share_their_features_and_another_verification_shares_no_positions():
    bank = bank_of([[1, 0.9]] * 2, labels=(NOMINAL, "preset"))

    assert price(bank, 0, {(0, 0), (0, 1)}) == pytest.approx(1 + 12 / 20)
    assert price(bank, 0, {(0, 0), (1, 0)}) == pytest.approx(1 + 12 / 20)


def test_pairs_that_diverge_under_all_configurations_are_set_aside_and_no_others():
    tables = np.full((2, 2, 4), 0.002)
    tables[:, 1, :] *= [[1], [2]]
    tables[:, 0, 2] = 0.9
    tables[1, 1, 3] = 0.9

    kept = set_aside(tables)

    assert np.isnan(kept[:, 0, 2]).all()
    assert np.isnan(kept).sum() == 2


def test_a_clean_run_that_diverges_under_all_configurations_does_not_decide():
    bank = bank_of([[1, 0.5, 1.1]] * 3)
    pairs = bank.pairs.copy()
    pairs[:, :, 0, 4:] = np.array([0.8, 0.95, 0.75])[:, None]
    bank = replace(bank, pairs=pairs)

    (found,) = replay(bank, {"race": partial(race, size=3, runs=(4, 3))}, count=4)

    assert found.picks[0] == {1: 4}


def test_a_failed_run_counts_as_the_largest_error():
    bank = bank_of([[1, 0.5, 0.8]] * 3)
    pairs = bank.pairs.copy()
    pairs[:, 1] = np.nan

    (found,) = replay(replace(bank, pairs=pairs), {"race": partial(race, size=3, runs=(1, 1))}, count=2)

    assert found.picks[0] == {2: 2}


def test_the_posterior_goes_by_the_others_where_scores_say_nothing_about_truth():
    generator = np.random.default_rng(1)
    bank = bank_of([[1, 0.6, 1.2]] * 8)
    pairs = bank.pairs * np.exp(generator.normal(0, 1, (8, 3, 1, 1)))

    (found,) = replay(replace(bank, pairs=pairs), {"posterior": partial(posterior, size=3, runs=(1, 1))}, count=2)

    assert [max(found.picks[place], key=found.picks[place].get) for place in range(8)] == [1] * 8


def test_a_clear_gain_is_confirmed_at_the_first_look_and_no_gain_is_not():
    gain, none = bank_of([[1, 0.5]] * 2, spread=0.1), bank_of([[1, 1.0]] * 2, spread=0.1)

    def always_second(draw):
        return 1

    outcomes = []
    for bank in (gain, none):
        draw = first_draw(bank)
        outcomes.append((confirmed(draw, always_second, 2), len({place for _, place in draw.used})))
    assert outcomes[0] == (1, 2 + 4)
    assert outcomes[1][0] == 0


def test_a_sequence_with_too_few_runs_for_a_rule_is_left_out_of_it():
    bank = without_runs(bank_of([[1, 0.5]] * 3), np.s_[0, :, 8:])

    found = replay(bank, {"2 x 6": partial(race, size=2, runs=(2, 6)), "1 x 3": partial(race, size=2, runs=(1, 3))})

    assert [sorted(one.changes) for one in found] == [[1, 2], [0, 1, 2]]
    with pytest.raises(TooFewRunsError):
        race(first_draw(bank), 2, (2, 6))


def test_a_block_holds_the_configurations_that_have_enough_runs():
    bank = bank_of([[1] * 8], labels=tuple(CONFIGURATIONS)[:8])

    assert block(bank, 0).configurations == 8
    assert block(without_runs(bank, np.s_[0, 5:, 1:]), 0).configurations == 5
    assert block(without_runs(bank, np.s_[0, :, 1:]), 0) is None


def test_a_block_may_begin_with_one_clean_and_two_noisy_runs():
    few = block(without_runs(bank_of([[1] * 5]), np.s_[0, :, [1, 2, 3, *range(6, len(COPIES))]]), 0)

    assert (few.clean.tolist(), few.noisy[0.5].tolist()) == ([0], [4, 5])


def test_hindsight_is_at_least_as_good_as_any_rule():
    bank = bank_of([[1, 0.7, 0.9, 1.3, 0.8]] * 5, spread=0.4)

    found = {one.rule: one for one in replay(bank, {**RULES, "nominal": nominal, "hindsight": in_hindsight}, count=4)}

    best = found["hindsight"]
    assert all(best.changes[place] <= one.changes[place] + 1e-9 for one in found.values() for place in one.changes)


def test_the_page_has_a_row_for_every_rule_and_sequence():
    bank = bank_of([[1, 0.7, 0.9, 1.3, 0.8]] * 3, spread=0.2)

    text = page(bank, replay(bank, RULES, count=2))

    assert all(f"| {name} |" in text for name in (*RULES, *bank.sequences, *bank.labels))
    assert "nan" not in text


def test_another_configuration_takes_the_place_of_the_leading_one_by_a_clear_score_only() -> None:
    near, far = ([[1, 0.7, 0.9, 0.5, 0.8]] * 4 + [[1, 0.7, 0.9, last, 0.8]] for last in (0.72, 0.8))
    rule = partial(led, size=5, runs=(2, 3), margin=0.05)

    assert rule(first_draw(bank_of(near), 4)) == 3
    assert rule(first_draw(bank_of(far), 4)) == 1


def test_the_results_name_every_sequence_on_which_what_is_adopted_is_worse_than_nominal() -> None:
    bank = bank_of([[1, 0.7, 0.9, 0.6, 0.8]] * 4 + [[1, 1.2, 1.3, 1.1, 1.4]], spread=0.05)
    true = bank.per_run["true"].copy()
    true[0, 3] *= 3.0
    worse = replace(bank, per_run={**bank.per_run, "true": true})
    fresh = [{"is_adopted": True, "clean": 0.3}, {"is_adopted": False, "clean": 0.1}]

    text = results_page(worse, replay(worse, RULES, count=3), fresh)

    assert "* **s0**: +" in text
    assert "adopted 1, of which 1 was worse than nominal on the clean images by more than 2% (+30.0% at worst)" in text
    assert "nan" not in text


def test_the_page_on_options_says_what_the_bank_says() -> None:
    text = (ROOT / ANSWER).read_text(encoding="utf-8")

    assert "lowers the true ATE" in text
    assert with_short_answer(text, load()) == text, "run: python -m experiments.bank replay"
