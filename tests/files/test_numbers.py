"""What counts as a number that a user gives."""

import math

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.files import is_number, read_number
from steelyard.files.arguments import real_array


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


@pytest.mark.parametrize(
    ("value", "found"),
    [
        (np.array([[1.0, 2.0 + 1e-20j]]), "an array of complex128"),
        (np.ma.array([[1.0, 2.0]], mask=[[False, True]]), "an array with masked numbers"),
        (["1.0", "2.0"], "['1.0', '2.0']"),
        ([[1.0], [1.0, 2.0]], "[[1.0], [1.0, 2.0]]"),
        (np.array(["2026-01-01"], dtype="datetime64[s]"), "an array of datetime64[s]"),
        ([None, "a"], "[None, 'a']"),
    ],
)
def test_what_are_no_real_numbers_is_refused(value, found):
    with pytest.raises(InputError) as caught:
        real_array(value, "q")
    assert str(caught.value) == f"q must be real numbers, got {found}."


@pytest.mark.parametrize("value", [[1, 2], (True, 2.0), np.array([1.0, 2.0], dtype=object), np.ma.array([1.0, 2.0])])
def test_real_numbers_become_floats(value):
    found = real_array(value, "q")
    assert found.dtype == np.float64
    assert found.tolist() == [1.0, 2.0]
