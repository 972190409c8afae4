import numpy as np
import pytest

from tablesetting.curves import CurveKey, average, paired_difference, read_published


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
