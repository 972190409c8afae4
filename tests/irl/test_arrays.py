import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.irl.arrays import normalize_l1, row_blocks


def test_normalised_vectors_have_unit_l1_norm_and_keep_their_direction():
    vectors = np.random.default_rng(0).standard_normal((5, 7))
    scaled = normalize_l1(vectors)
    np.testing.assert_allclose(np.abs(scaled).sum(axis=1), 1.0)
    np.testing.assert_allclose(scaled * np.abs(vectors).sum(axis=1)[:, None], vectors)


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
