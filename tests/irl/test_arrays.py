import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tablesetting.irl.arrays import log_sum_exp, normalize_l1


def test_log_sum_exp_by_hand():
    exponents = np.log([[1.0, 2.0, 3.0], [1.0, 1.0, 2.0]])
    np.testing.assert_allclose(log_sum_exp(exponents), np.log([6.0, 4.0]))


def test_log_sum_exp_neither_overflows_nor_underflows():
    np.testing.assert_allclose(log_sum_exp(np.array([1e4, 1e4])), 1e4 + np.log(2))
    np.testing.assert_allclose(log_sum_exp(np.array([-1e4, -1e4])), -1e4 + np.log(2))


def test_log_sum_exp_ignores_absent_terms():
    assert log_sum_exp(np.array([0.5, -np.inf, -np.inf])) == 0.5


@given(arrays(float, (3, 4), elements=st.floats(-5, 5)), st.floats(-500, 500))
def test_log_sum_exp_moves_with_a_shift(exponents, shift):
    shifted = log_sum_exp(exponents + shift)
    np.testing.assert_allclose(shifted, log_sum_exp(exponents) + shift, atol=1e-9)


def test_normalize_l1_by_hand():
    vectors = np.array([[3.0, -1.0], [0.0, -2.0]])
    np.testing.assert_array_equal(normalize_l1(vectors), [[0.75, -0.25], [0.0, -1.0]])
