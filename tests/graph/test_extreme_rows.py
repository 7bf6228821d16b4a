"""Extremes of groups of rows, beside NumPy."""

import numpy as np
import pytest

from steelyard.graph.extreme_rows import extreme_rows


@pytest.mark.parametrize("width", [1, 3, 4, 7, 8, 17])
@pytest.mark.parametrize("size", [1, 5, 64])
def test_extremes_are_those_of_numpy(width: int, size: int) -> None:
    random = np.random.default_rng(width)
    # Rounded, so that some are equal, of which the first one counts.
    values, others = random.normal(size=(2, 6 * size, width)).round(1)
    found = extreme_rows(values, others, size)
    both = np.concatenate([values, values - others], axis=1).reshape(6, size, 2 * width)
    np.testing.assert_array_equal(found, np.concatenate([both.argmin(axis=1), both.argmax(axis=1)], axis=1))


@pytest.mark.parametrize("width", [0, 1, 9])
def test_no_groups_have_no_extremes(width: int) -> None:
    assert extreme_rows(np.zeros((0, width)), np.zeros((0, width)), 3).shape == (0, 4 * width)


def test_rows_beyond_whole_groups_are_refused() -> None:
    with pytest.raises(ValueError, match="whole groups"):
        extreme_rows(np.zeros((7, 2)), np.zeros((7, 2)), 3)
