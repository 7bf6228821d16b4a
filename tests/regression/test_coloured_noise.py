"""Whitening in time has the likelihood of the rows that are used, and Burg's coefficients are those of the noise."""

import numpy as np
import pytest
from scipy.linalg import cholesky, solve_triangular, toeplitz
from scipy.signal import lfilter

import steelyard as sy
from steelyard.regression.coloured_noise import ColouredNoise, autoregression, stretches_of


def autocovariance(reflections, deviation, count):
    """Of the noise that such reflections make, from its impulse response alone."""
    coefficients = np.zeros(0)
    for reflection in reflections:
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
    impulse = np.zeros(20000)
    impulse[0] = deviation
    response = lfilter([1.0], [1.0, *(-coefficients)], impulse)
    return np.array([response[: len(response) - k] @ response[k:] for k in range(count)])


@pytest.mark.parametrize(
    ("reflections", "missing"),
    [
        ((0.8,), []),
        ((0.7, -0.5, 0.3), []),
        ((), [3, 4, 50]),
        ((0.8,), [0, 1, 10, 30, 31, 32, 60, 199]),
        ((0.7, -0.5, 0.3), [2, 10, 11, 14, 17, 18, 100, 101, 102, 103]),
        ((0.9, -0.4), [1, 2, 3, 5, 196, 198]),
    ],
)
def test_whitened_rows_have_the_products_of_the_inverse_covariance(reflections, missing):
    random = np.random.default_rng(1)
    noise = ColouredNoise(("a",), (np.array(reflections),), np.array([0.3]), np.eye(1))
    used = np.ones(200, dtype=bool)
    used[missing] = False
    rows = random.normal(size=(200, 4))
    found, whole = noise.whiten_joint(0, rows, used)
    root = cholesky(toeplitz(autocovariance(reflections, 0.3, 200))[np.ix_(used, used)], lower=True)
    expected = solve_triangular(root, rows[used], lower=True)
    assert np.allclose(
        found.T @ found, expected.T @ expected, rtol=1e-9, atol=1e-9 * np.abs(expected.T @ expected).max()
    )
    assert not found[~used].any()
    assert not whole[~used].any()


def test_a_gap_longer_than_the_noise_lasts_begins_anew():
    noise = ColouredNoise(("a",), (np.array([0.5]),), np.array([1.0]), np.eye(1))
    used = np.ones(60, dtype=bool)
    used[20:40] = False
    rows = np.random.default_rng(2).normal(size=(60, 2))
    found, whole = noise.whiten_joint(0, rows, used)
    parts = [noise.whiten_joint(0, rows[part], used[part])[0] for part in (slice(0, 20), slice(40, 60))]
    assert np.allclose(found[used], np.vstack(parts), rtol=0, atol=1e-12)
    assert whole.sum() == 39


def test_burg_agrees_with_yule_walker_on_a_long_series_and_is_stable_on_a_short_one():
    random = np.random.default_rng(3)
    made = lfilter([1.0], [1.0, -1.2, 0.5], random.normal(size=200_000))
    reflections, variance = autoregression([made[:90_000], made[90_000:]], 2)
    moments = np.array([made[: len(made) - k] @ made[k:] for k in range(3)]) / len(made)
    coefficients = np.linalg.solve(toeplitz(moments[:2]), moments[1:])
    assert reflections[1] == pytest.approx(coefficients[1], abs=1e-4)
    assert reflections[0] == pytest.approx(moments[1] / moments[0], abs=1e-4)
    assert variance == pytest.approx(moments[0] - moments[1:] @ coefficients, rel=1e-4)
    for count in (12, 25, 200):
        short, _ = autoregression([np.cos(0.1 * np.arange(count))])
        assert np.all(np.abs(short) < 1.0)
    assert autoregression([np.zeros(50)])[1] == 0.0
    # White noise has no order by Schwarz, and the order of the noise is found.
    assert autoregression([random.normal(size=5000)], "bic")[0].size == 0
    assert autoregression([made], "bic")[0].size == 2


def test_stretches_end_where_stamps_jump():
    t = np.concatenate([np.arange(10) * 0.01, 0.5 + np.arange(5) * 0.01, np.arange(3) * 0.01])
    one = np.zeros((18, 1))
    assert stretches_of(sy.Samples(q=one, dq=one, ddq=one, torque=one, t=t)) == [
        slice(0, 10),
        slice(10, 15),
        slice(15, 18),
    ]
    assert stretches_of(sy.Samples(q=one, dq=one, ddq=one, torque=one)) == [slice(0, 18)]
