"""Residuals of a robot that stays as it is, and of one that changes: false alarms, and how soon a change is noticed."""

import numpy as np
import pytest
from numpy.typing import NDArray

from steelyard.online.change_detector import ChangeDetector


def alarms(detector: ChangeDetector, residuals: NDArray[np.float64]) -> list[int]:
    """Numbers of the rows, each a stretch of its own, with which a change is noticed."""
    used, found = np.ones((1, residuals.shape[1]), dtype=bool), []
    for number, row in enumerate(residuals):
        if detector.add(np.array([0.05 * number]), row[None], used):
            found.append(number)
            detector.rest()
    return found


@pytest.mark.slow
@pytest.mark.parametrize("joints", [1, 2, 7])
def test_ten_minutes_of_noise_are_no_change_and_a_change_is_noticed_at_once(joints: int) -> None:
    """From zero the sum passes 100 with a probability of e^(-0.47 * 100), practically never, also with one joint.

    There 0.47 is the root of (1 - 2 x)^(-1/2) = e^(3 x), as squares of normal residuals less 3 are added (Cramér).
    """
    random = np.random.default_rng(joints)
    residuals = random.normal(size=(12000, joints))
    residuals[6000] = 1e6  # a jolt
    detector = ChangeDetector(joints, 1)
    assert alarms(detector, residuals) == []
    changed = random.normal(size=(50, joints)) + 4.0
    assert alarms(detector, changed)[0] < 10
