"""The compiled loops that have no plain counterpart elsewhere in the tests."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.irl.sampler import LogNormal
from tablesetting.reward import _kernels, square
from tablesetting.reward._kernels import _is_grid_maximum, exp_of_negative, log_normal


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


@given(st.floats(-9.0, 9.0), st.floats(1e-3, 1e3), st.floats(0.1, 2.0))
def test_log_normal_density_is_that_of_the_sampler(logarithm, median, spread):
    expected = LogNormal(median, spread).log_density(np.array(logarithm))
    np.testing.assert_allclose(log_normal(logarithm, median, spread), expected)


@given(st.integers(0, 2**32), st.integers(1, 15))
def test_cholesky_factor_solves_as_numpy_does(seed, size):
    rng = np.random.default_rng(seed)
    root, vector = rng.standard_normal((size, size)), rng.standard_normal(size)
    matrix = root @ root.T + np.eye(size)
    factor = np.tril(matrix)  # All that is read.
    log_determinant = _kernels._factorize(factor)
    np.testing.assert_allclose(np.tril(factor), np.linalg.cholesky(matrix), atol=1e-9)
    assert log_determinant == pytest.approx(np.linalg.slogdet(matrix)[1], abs=1e-9)

    solution, half = vector.copy(), np.empty(size)
    _kernels._solve(factor, solution)
    np.testing.assert_allclose(matrix @ solution, vector, atol=1e-9)
    _kernels._solve_transposed(factor, vector, half)
    np.testing.assert_allclose(np.tril(factor).T @ half, vector, atol=1e-9)
    length = _kernels._squared_length(factor, vector)
    assert length == pytest.approx(vector @ matrix @ vector)
