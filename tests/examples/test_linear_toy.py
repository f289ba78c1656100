"""In the linear case the score orders configurations as their information does."""

import numpy as np

from examples.linear_toy import agreement, determinants, expected_errors, gtf_errors, samples_needed


def test_the_orders_by_determinant_by_expected_error_and_by_gtf_agree() -> None:
    best_first = np.argsort(-determinants())

    assert list(np.argsort(expected_errors())) == list(best_first)
    assert list(np.argsort(gtf_errors(samples=200))) == list(best_first)


def test_four_samples_put_95_percent_of_the_pairs_in_order_and_one_does_not() -> None:
    assert samples_needed() == 4
    assert agreement(1) < 0.9
    assert agreement(32) > 0.99


def test_gtf_is_proportional_to_the_expected_error() -> None:
    ratios = gtf_errors(samples=4000) / expected_errors()

    assert np.allclose(ratios, 0.3 / 0.5, rtol=0.03)


def test_a_bias_is_not_seen() -> None:
    assert np.allclose(gtf_errors(samples=8), gtf_errors(samples=8, bias=10.0))
