import numpy as np
import pytest

from tablesetting.curves import Curve, CurveKey, Reach
from tablesetting.experiments.comparison import compare
from tablesetting.experiments.published import differences, published_curves

KEY = CurveKey("vase", "active-var", "mean_placement_error")
STEPS = np.arange(1.0, 4.0)
PUBLISHED = {KEY: Curve(STEPS, np.array([0.4, 0.3, 0.2]), np.full(3, 0.2), 100)}
OURS = {KEY: Curve(STEPS[:2], np.array([0.45, 0.1]), np.full(2, 0.3), 9)}


def test_the_paper_has_86_points_in_eight_curves():
    curves = published_curves()
    lengths = {key: len(curve.means) for key, curve in curves.items()}
    assert len(lengths) == 8
    assert sum(lengths.values()) == 86
    for key, length in lengths.items():
        assert length == (10 if key.quantity == "var_bound" else 11)


@pytest.mark.parametrize(
    ("key", "num_demos", "mean"),
    [
        (("vase", "active-var", "mean_placement_error"), 11, 0.044),
        (("vase", "random", "mean_placement_error"), 11, 0.064),
        (("spoon", "active-var", "mean_placement_error"), 1, 0.295),
        (("spoon", "active-var", "max_placement_error"), 1, 0.916),
        (("spoon", "active-var", "var_bound"), 10, 0.559),
    ],
)
def test_points_of_the_paper(key, num_demos, mean):
    curve = published_curves()[CurveKey(*key)]
    (index,) = np.flatnonzero(curve.num_demos == num_demos)
    assert curve.means[index] == pytest.approx(mean, abs=5e-4)


def test_distance_is_in_the_papers_error_bars():
    first, second = differences(OURS, PUBLISHED)
    assert (first.num_demos, first.published, first.ours) == (1, 0.4, 0.45)
    assert first.bars == pytest.approx(0.5)  # Bars are half a standard deviation.
    assert second.bars == pytest.approx(2.0)
    assert not list(differences({}, PUBLISHED))


def test_the_comparison_says_how_many_points_are_within_their_bars():
    held = CurveKey("vase", "active-var", "bound_held")
    curves = OURS | {held: Curve(STEPS[:2], np.array([1.0, 0.5]), np.zeros(2), 9)}
    found = list(differences(OURS, PUBLISHED))
    gain = Curve(STEPS[:2], np.array([0.0, 0.02]), np.full(2, 0.03), 9)
    text = compare("9 trials", curves, found, {"vase": {"random": gain}}, {})
    assert "1 of 2 points" in text
    for row in (
        "| after demonstrations | 1 | 2 |",
        "| active-var, mean error | 0.450 | 0.100 |",
        "| paper | 0.400 | 0.300 |",
        "| distance | 0.50 | 2.00 |",
        "| active-var, trials in which the bound held [%] | 100 | 50 |",
        "0.000 ± 0.010 | 0.020 ± 0.010 |",
    ):
        assert row in text


def test_nothing_is_compared_where_the_settings_are_not_the_papers():
    text = compare("9 trials", OURS, [], {}, {})
    assert "paper" not in text
    assert "| active-var, mean error | 0.450 | 0.100 |" in text


def test_the_comparison_says_how_many_demonstrations_small_errors_take():
    reached = [
        Reach("active-var", 0.05, 3.5, 0.25, 0, 9, 0.7, 0.041),
        Reach("random", 0.05, 5.0, 0.5, 0, 9, 1.0, 0.0),
        Reach("active-var", 0.02, 6.0, 0.3, 0, 9, 0.75, 0.05),
        Reach("random", 0.02, 8.0, 0.4, 0, 9, 1.0, 0.0),
    ]
    text = compare("9 trials", OURS, [], {"vase": {}}, {"vase": reached})
    assert (
        "| demonstrations to a mean error of | 0.05 | of random's | 0.02 | of random's |"
        "\n|---|---|---|---|---|"
        "\n| active-var | 3.50 ± 0.25 | 70% ± 4% | 6.00 ± 0.30 | 75% ± 5% |"
        "\n| random | 5.00 ± 0.50 |  | 8.00 ± 0.40 |  |\n"
    ) in text
    alone = [Reach("cvar", 0.05, 3.5, 0.25, 0, 9, None, None)]
    text = compare("9 trials", OURS, [], {"vase": {}}, {"vase": alone})
    assert "| cvar | 3.50 ± 0.25 |  |" in text


@pytest.mark.parametrize(
    ("missed", "at_random", "cells"),
    [
        (0, 2, "| 3.00 ± 0.10 | ≤ 75% ± 5% |"),
        (1, 0, "| ≥ 3.00 ± 0.10 (1 of 9 never) | ≥ 75% ± 5% |"),
        (1, 2, "| ≥ 3.00 ± 0.10 (1 of 9 never) |  |"),
    ],
)
def test_what_is_but_a_bound_on_a_count_is_marked(missed, at_random, cells):
    reached = [
        Reach("cvar", 0.05, 3.0, 0.1, missed, 9, 0.75, 0.05),
        Reach("random", 0.05, 4.0, 0.2, at_random, 9, 1.0, 0.0),
    ]
    text = compare("9 trials", OURS, [], {"vase": {}}, {"vase": reached})
    assert f"| cvar {cells}" in text
