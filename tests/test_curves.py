import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from tablesetting.curves import (
    CurveKey,
    Share,
    average,
    paired_difference,
    reaches,
    read_published,
)


def rows_of(task, strategy, errors):
    """Make rows of mean errors, one list for each trial."""
    return [
        {
            "task": task,
            "strategy": strategy,
            "trial": str(trial),
            "num_demos": str(count),
            "error": str(error),
        }
        for trial, row in enumerate(errors)
        for count, error in enumerate(row, start=1)
    ]


ROWS = [
    *rows_of("vase", "active-var", [[0.4, 0.1], [0.6, 0.3]]),
    *rows_of("vase", "random", [[0.4, 0.3], [0.6, 0.7]]),
    *rows_of("spoon", "random", [[0.8, 0.2]]),
]


def test_curves_are_means_and_spreads_over_the_trials():
    curves = average(ROWS, ["error"])
    assert list(curves) == [
        CurveKey("vase", "active-var", "error"),
        CurveKey("vase", "random", "error"),
        CurveKey("spoon", "random", "error"),
    ]
    curve = curves[CurveKey("vase", "active-var", "error")]
    np.testing.assert_array_equal(curve.num_demos, [1, 2])
    np.testing.assert_allclose(curve.means, [0.5, 0.2])
    spread = np.sqrt(0.02)  # Of two values 0.2 apart.
    np.testing.assert_allclose(curve.stds, spread)
    np.testing.assert_allclose(curve.half_stds, spread / 2)
    np.testing.assert_allclose(curve.standard_errors, 0.1)
    assert curve.num_trials == 2


def test_order_of_the_rows_does_not_matter():
    for key, curve in average(ROWS[::-1], ["error"]).items():
        expected = average(ROWS, ["error"])[key]
        np.testing.assert_allclose(curve.means, expected.means)
        np.testing.assert_allclose(curve.stds, expected.stds)


def test_one_trial_has_no_spread():
    curve = average(ROWS, ["error"])[CurveKey("spoon", "random", "error")]
    np.testing.assert_array_equal(curve.stds, 0.0)
    np.testing.assert_array_equal(curve.means, [0.8, 0.2])


def test_differences_are_taken_trial_by_trial():
    shuffled = [ROWS[k] for k in np.random.default_rng(0).permutation(len(ROWS))]
    gain = paired_difference(shuffled, "vase", "random", "active-var", "error")
    np.testing.assert_array_equal(gain.num_demos, [1, 2])
    np.testing.assert_allclose(gain.means, [0.0, 0.3], atol=1e-15)
    np.testing.assert_allclose(gain.stds, [0.0, np.sqrt(0.02)], atol=1e-15)


def test_published_curves_are_read_with_their_bars(tmp_path):
    table = tmp_path / "published.csv"
    table.write_text(
        "task,strategy,quantity,num_demos,mean,half_std\n"
        "vase,random,error,1,0.4,0.1\nvase,random,error,2,0.2,0.05\n"
    )
    ((key, curve),) = read_published(table, 100).items()
    assert key == ("vase", "random", "error")
    np.testing.assert_array_equal(curve.num_demos, [1, 2])
    np.testing.assert_array_equal(curve.means, [0.4, 0.2])
    np.testing.assert_array_equal(curve.half_stds, [0.1, 0.05])
    assert curve.standard_errors[0] == pytest.approx(0.02)


LEARNED = [
    *rows_of("vase", "active-var", [[0.4, 0.1, 0.0], [0.6, 0.3, 0.1], [0.1, 0.4, 0.4]]),
    *rows_of("vase", "random", [[0.4, 0.3, 0.1], [0.6, 0.7, 0.7], [0.1, 0.1, 0.1]]),
    *rows_of("spoon", "random", [[0.1, 0.1, 0.1]]),
]


def test_demonstrations_are_counted_until_an_error_is_first_at_the_level():
    """After 2, 3 and 1; at random after 3, never in three, which counts as 4, and 1."""
    active, random = reaches(LEARNED, "vase", 0.1, quantity="error")
    assert (active.strategy, random.strategy) == ("active-var", "random")
    assert active.level == random.level == 0.1
    assert active.mean == pytest.approx((2 + 3 + 1) / 3)
    assert random.mean == pytest.approx((3 + 4 + 1) / 3)
    assert active.standard_error == pytest.approx(np.std([2, 3, 1], ddof=1) / 3**0.5)
    assert active.ratio == pytest.approx(6 / 8)
    left = np.array([2, 3, 1]) - 6 / 8 * np.array([3, 4, 1])
    error = np.std(left, ddof=1) / 3**0.5 / (8 / 3)
    assert active.ratio_error == pytest.approx(error)
    assert (random.ratio, random.ratio_error) == (1.0, 0.0)
    assert (active.num_missed, random.num_missed, random.num_trials) == (0, 1, 3)


def test_the_error_of_a_ratio_is_its_spread_over_studies():
    rng, found = np.random.default_rng(0), []
    for _ in range(100):
        needed = {"cvar": rng.integers(2, 5, size=30)}
        needed["random"] = needed["cvar"] + rng.integers(0, 4, size=30)
        rows = [
            row
            for strategy, counts in needed.items()
            for row in rows_of(
                "vase", strategy, 1.0 * (np.arange(1, 8) < counts[:, None])
            )
        ]
        found.append(reaches(rows, "vase", 0.5, quantity="error")[0])
    spread = np.std([each.ratio for each in found])
    promised = np.mean([each.ratio_error for each in found])
    assert promised == pytest.approx(spread, rel=0.2)


def test_without_the_baseline_there_is_no_ratio():
    rows = [row for row in LEARNED if row["strategy"] == "active-var"]
    (active,) = reaches(rows, "vase", 0.1, quantity="error")
    assert active.ratio is active.ratio_error is None
    (random,) = reaches(LEARNED, "spoon", 0.1, quantity="error")
    assert (random.mean, random.standard_error) == (1.0, 0.0)


def test_a_share_counts_what_happened():
    share = Share.of([True, False, True, True])
    assert (share.count, share.total, share.value) == (3, 4, 0.75)


def test_the_interval_of_a_share_is_wilsons():
    """For 8 of 10 as in textbooks; for none of n it ends at z^2 / (n + z^2)."""
    assert Share(8, 10).interval == pytest.approx((0.4902, 0.9433), abs=1e-4)
    square = 1.959963984540054**2
    assert Share(0, 12).interval == pytest.approx((0.0, square / (12 + square)))
    assert Share(12, 12).interval == pytest.approx((12 / (12 + square), 1.0))


counts = st.integers(1, 2000).flatmap(
    lambda total: st.tuples(st.integers(0, total), st.just(total))
)


@given(counts)
def test_the_interval_of_a_share_is_that_of_scipy(counted):
    share = Share(*counted)
    expected = binomtest(*counted).proportion_ci(0.95, method="wilson")
    assert share.interval == pytest.approx((expected.low, expected.high), abs=1e-12)


@given(counts)
def test_the_interval_is_around_the_share_and_mirrored_for_its_opposite(counted):
    count, total = counted
    low, high = Share(count, total).interval
    assert 0.0 <= low <= count / total + 1e-12
    assert count / total - 1e-12 <= high <= 1.0
    mirrored = Share(total - count, total).interval
    assert mirrored == pytest.approx((1.0 - high, 1.0 - low), abs=1e-12)


def test_of_no_cases_nothing_is_known():
    share = Share.of([])
    assert math.isnan(share.value)
    assert share.interval == (0.0, 1.0)
    assert str(share) == "none"


def test_a_share_is_written_in_percent_with_its_interval():
    assert str(Share(8, 10)) == "80.0 (49-94)"
