"""The compiled loops that have no plain counterpart elsewhere in the tests."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.reward import square
from tablesetting.reward._kernels import _is_grid_maximum, exp_of_negative


@given(st.floats(-708.0, 0.0))
def test_exponential_is_exact_to_fourteen_digits(x):
    assert exp_of_negative(x) == pytest.approx(math.exp(x), rel=1e-14)


@pytest.mark.parametrize("x", [-709.0, -1e4, -1e308, -math.inf])
def test_exponential_of_the_very_negative_is_next_to_nothing(x):
    assert 0.0 <= exp_of_negative(x) < 1e-300


def test_exponential_of_zero_is_one():
    assert exp_of_negative(0.0) == exp_of_negative(-0.0) == 1.0


def test_exponential_is_as_exact_over_its_whole_range():
    xs = -np.geomspace(1e-300, 708.0, 20_000)
    found = np.array([exp_of_negative(x) for x in xs])
    np.testing.assert_allclose(found, np.exp(xs), rtol=1e-14)


@given(st.integers(0, 2**32), st.integers(2, 6), st.integers(1, 5))
def test_maxima_of_a_grid_are_those_of_the_plain_comparison(seed, size, num_levels):
    """With few levels, neighbours are often equal; a plateau is a maximum."""
    levels = np.random.default_rng(seed).integers(num_levels, size=size * size)
    values = levels.astype(float)
    found = [
        _is_grid_maximum(values, row, column, size)
        for row in range(size)
        for column in range(size)
    ]
    assert found == square._is_grid_maximum(values[:, None])[:, 0].tolist()


def test_maxima_of_a_grid_by_hand():
    values = np.array([3.0, 2.0, 3.0, 1.0, 0.0, 3.0, 4.0, 1.0, 0.0])
    found = [_is_grid_maximum(values, g // 3, g % 3, 3) for g in range(9)]
    assert np.flatnonzero(found).tolist() == [0, 2, 5, 6]
