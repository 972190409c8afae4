import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.irl.arrays import normalize_l1, row_blocks


def test_normalize_l1_by_hand():
    vectors = np.array([[3.0, -1.0], [0.0, -2.0]])
    np.testing.assert_array_equal(normalize_l1(vectors), [[0.75, -0.25], [0.0, -1.0]])


@given(st.integers(0, 50), st.integers(0, 2**21))
def test_blocks_cover_every_row_once_and_stay_small(num_rows, row_size):
    blocks = list(row_blocks(num_rows, row_size))
    rows = [row for block in blocks for row in range(num_rows)[block]]
    assert rows == list(range(num_rows))
    for block in blocks:
        num_in_block = block.stop - block.start
        assert num_in_block == 1 or num_in_block * row_size <= 2**20


@pytest.mark.parametrize(("row_size", "expected"), [(2**19, [2, 2, 1]), (10, [5])])
def test_blocks_are_as_large_as_they_may_be(row_size, expected):
    assert [block.stop - block.start for block in row_blocks(5, row_size)] == expected
