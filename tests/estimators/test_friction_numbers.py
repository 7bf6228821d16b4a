"""Numbers of laws of friction by all joints together, against weighted least squares with the covariance, by SciPy."""

import numpy as np
import pytest
from scipy.linalg import block_diag, toeplitz
from scipy.optimize import curve_fit
from scipy.signal import lfilter

from steelyard.estimators.friction_numbers import MovableLaw, NumberedJoint, WhiteRows, numbers_together

ROWS, MEMORY = 800, 0.9
TRUTH = (1.5, 0.8, 0.4, 0.5, 0.3)  # of both joints, of each one, and size and velocity of the law of the second


def stribeck(speeds, dq):
    return [(np.sign(dq) * np.exp(-((dq / speed) ** 2)))[:, None] for (speed,) in speeds]


def torques(rows, both, first, second, size, speed):
    one, two = rows
    return np.concatenate(
        [both * one[0] + first * one[1], both * two[0] + second * two[1] + size * stribeck([(speed,)], two[1])[0][:, 0]]
    )


@pytest.fixture
def experiment():
    """Rows of two joints that share a parameter, their noise, and which rows count."""
    random = np.random.default_rng(3)
    t = np.arange(ROWS) / 50.0
    phases = random.uniform(0.0, 6.0, (4, 3))
    signals = np.array([np.sin(np.outer(t, [0.7, 1.9, 3.1]) + phase).sum(axis=1) for phase in phases])
    rows = ((signals[0], signals[1]), (signals[2], signals[3]))
    noise = lfilter([1.0], [1.0, -MEMORY], random.normal(size=(2, ROWS)) * [[0.05], [0.15]], axis=1)
    used = np.ones((2, ROWS), dtype=bool)
    used[0, 300:306] = used[1, 500:503] = used[1, 600:700] = False
    return rows, noise, used


def test_numbers_are_those_of_least_squares_with_the_covariance_of_the_noise(experiment):
    rows, noise, used = experiment
    flags = used.ravel()
    measured = torques(rows, *TRUTH) + noise.ravel()
    whites = [WhiteRows(noise[k], used[k], [0]) for k in range(2)]
    parts = []
    for white in whites:  # the noise as it was found: what it makes of an impulse tells a memory and a deviation
        response = white.of(np.eye(ROWS, 1, -10))[10:, 0]
        assert abs(response[2] / response[0]) < 1e-12
        memory, deviation = -response[1] / response[0], 1.0 / response[0]
        assert memory == pytest.approx(MEMORY, abs=0.05)
        parts.append(deviation**2 / (1.0 - memory**2) * toeplitz(memory ** np.arange(ROWS)))
    covariance = block_diag(*parts)[np.ix_(flags, flags)]
    expected, spread = curve_fit(
        lambda _, *numbers: torques(rows, *numbers)[flags],
        None,
        measured[flags],
        p0=(1.0, 1.0, 1.0, 1.0, 0.25),
        sigma=covariance,
        absolute_sigma=True,
    )
    joints = []
    for k, (one, two) in enumerate(rows):
        law = MovableLaw(lambda shapes, dq=two: stribeck(shapes, dq), (0.25,), (0,), (0.05,), (2.0,))
        own = measured[k * ROWS : (k + 1) * ROWS]
        joints.append(NumberedJoint(whites[k], np.column_stack([one, two]), own, [0, 1 + k], (law,) * k))
    found = numbers_together(joints, 3)
    numbers = [*found.base, found.coefficients[1][0][0], found.shapes[1][0][0]]
    assert found.coefficients[0] == found.shapes[0] == []
    errors = np.sqrt(np.diag(spread))
    assert np.abs((numbers - expected) / errors).max() < 0.02
    assert np.all(np.abs(numbers - np.array(TRUTH)) < 4.0 * errors)
    told = [found.coefficient_errors[1][0][0], found.free_errors[1][0][0] * found.shapes[1][0][0]]
    assert told == pytest.approx(errors[3:], rel=0.02)
    plain, _ = curve_fit(
        lambda _, *values: torques(rows, *values)[flags], None, measured[flags], p0=(1.0, 1.0, 1.0, 1.0, 0.25)
    )
    assert np.abs((plain - expected) / errors).max() > 0.5


def test_rows_that_do_not_count_change_nothing(experiment):
    rows, noise, used = experiment
    white = WhiteRows(noise[1], used[1], [0, 600])
    values = np.column_stack([*rows[1], noise[1]])
    other = np.where(used[1][:, None], values, 1e6)
    assert np.abs(white.of(values) - white.of(other)).max() < 1e-9
    assert not white.of(values)[~used[1]].any()
