"""The compiled loops that have no plain counterpart elsewhere in the tests."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.reward._kernels import exp_of_negative


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
