"""Compiled copies of chosen blocks of rows, beside NumPy."""

import numpy as np
import pytest

from steelyard.graph.block_copies import copy_blocks


@pytest.mark.parametrize("columns", [slice(0, 1), slice(3, 12), slice(0, 40), slice(5, 5)])
@pytest.mark.parametrize("spare", [0, 2])
def test_copies_are_those_of_numpy(columns: slice, spare: int) -> None:
    random = np.random.default_rng(columns.stop + spare)
    rows, last, places = random.random((9, 8, 40)), random.random((9, 4, 6)), random.permutation(9)[:5]
    copies = np.full((5, 4, spare + columns.stop - columns.start + 1), 7.0)
    copy_blocks(places, rows, columns, last, 5, copies)
    assert np.all(copies[:, :, :spare] == 7.0)
    np.testing.assert_array_equal(copies[:, :, spare:-1], rows[places, :4, columns])
    np.testing.assert_array_equal(copies[:, :, -1], last[places, :, 5])


@pytest.mark.parametrize("place", [-1, 2])
def test_what_lies_outside_is_refused(place: int) -> None:
    rows, copies = np.zeros((2, 4, 6)), np.zeros((1, 4, 3))
    with pytest.raises(ValueError, match="must be there"):
        copy_blocks(np.array([place]), rows, slice(0, 2), rows, 0, copies)
    with pytest.raises(ValueError, match="so many rows and columns"):
        copy_blocks(np.array([0]), rows, slice(5, 7), rows, 0, copies)
    with pytest.raises(ValueError, match="C-contiguous"):
        copy_blocks(np.array([0]), rows[:, :, ::2], slice(0, 2), rows, 0, copies)
