"""What counts as a number that a user gives."""

import math

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.files import is_number, read_number


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2.0), np.int64(2)])
def test_numbers_of_python_and_numpy_are_read(value):
    assert read_number(value, "gain") == 2.0
    assert type(read_number(value, "gain")) is float


@pytest.mark.parametrize(
    "value", ["2", None, True, np.True_, 2j, [2.0], np.array([2.0]), math.nan, math.inf, 1e16, 10**400]
)
def test_what_is_no_number_of_a_robot_is_refused(value):
    assert not is_number(value)
    with pytest.raises(InputError, match="gain must be a number, got ") as caught:
        read_number(value, "gain")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("value", "limits", "good"),
    [
        (0, {"above": 0}, False),
        (0, {"least": 0}, True),
        (-1e-9, {"least": 0}, False),
        (1, {"below": 1}, False),
        (0.5, {"above": 0, "below": 1}, True),
        (math.inf, {"infinite": True}, True),
        (-math.inf, {"infinite": True}, True),
        (-math.inf, {"infinite": True, "least": 0}, False),
        (-math.inf, {"infinite": True, "above": 0}, False),
        (math.inf, {"infinite": True, "below": 1}, False),
        (math.nan, {"infinite": True}, False),
        (1e16, {"infinite": True}, False),
    ],
)
def test_limits(value, limits, good):
    if good:
        assert read_number(value, "gain", **limits) == value
    else:
        with pytest.raises(InputError):
            read_number(value, "gain", **limits)
