import numpy as np
import pytest

from tablesetting.bootstrap import estimate_ratio


def test_a_ratio_of_paired_samples():
    rng = np.random.default_rng(0)
    below = rng.exponential(size=400)
    found = estimate_ratio(0.5 * below, below, rng=rng)
    assert (found.value, found.low, found.high) == pytest.approx((0.5, 0.5, 0.5))
    other = estimate_ratio(rng.exponential(size=400), below, rng=rng)
    assert other.low < other.value < other.high
    assert other.high - other.low == pytest.approx(4 * np.sqrt(2 / 400), rel=0.3)


def test_a_ratio_has_no_interval_where_there_may_be_nothing_below():
    below = np.array([0.0, 1.0])
    found = estimate_ratio(np.array([1.0, 1.0]), below, rng=np.random.default_rng(0))
    assert (found.value, found.low, found.high) == (2.0, None, None)
    single = estimate_ratio(below[1:], below[1:], rng=np.random.default_rng(0))
    assert (single.value, str(single)) == (1.0, "1.0000")
