"""The smoother against conditioning of a dense Gaussian process, at uneven times and with missing positions."""

from math import factorial

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.recording import KalmanSmoother, Processing, Recording, process_chunks
from steelyard.recording.samples import Samples


def covariance(s: np.ndarray, t: np.ndarray, a: int, b: int, n: int) -> np.ndarray:
    """Of the a-th derivative at s and the b-th at t of n-fold integrated white noise of density 1 that begins at 0."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    end = np.minimum(s[:, None], t)
    u = 0.5 * end[..., None] * (nodes + 1.0)
    i, j = n - 1 - a, n - 1 - b
    values = (s[:, None, None] - u) ** i / factorial(i) * (t[None, :, None] - u) ** j / factorial(j)
    return 0.5 * end * (values @ weights)


def polynomials(t: np.ndarray, derivative: int, n: int) -> np.ndarray:
    return np.column_stack(
        [t ** (k - derivative) / factorial(k - derivative) if k >= derivative else 0 * t for k in range(n)]
    )


def dense(t, y, seen, n, density, noise):
    """Posterior mean and deviation of q, dq, ddq with a flat prior on the initial state: universal kriging."""
    K = density * covariance(t[seen], t[seen], 0, 0, n) + noise**2 * np.eye(seen.sum())
    H = polynomials(t[seen], 0, n)
    Ki = np.linalg.inv(K)
    C = np.linalg.inv(H.T @ Ki @ H)
    beta = C @ H.T @ Ki @ y[seen]
    results = []
    for order in range(3):
        k = density * covariance(t, t[seen], order, 0, n)
        h = polynomials(t, order, n)
        mean = h @ beta + k @ Ki @ (y[seen] - H @ beta)
        lift = h - k @ Ki @ H
        own = density * np.diagonal(covariance(t, t, order, order, n))
        variance = own - np.einsum("ij,jk,ik->i", k, Ki, k) + np.einsum("ij,jk,ik->i", lift, C, lift)
        results.append((mean, np.sqrt(variance)))
    return results


@pytest.mark.parametrize(("model", "n"), [("acceleration", 3), ("jerk", 4)])
@pytest.mark.parametrize("even", [True, False])
def test_smoother_is_dense_conditioning(model, n, even, random):
    count = 60
    t = np.arange(count) / 50.0 if even else np.sort(random.uniform(0.0, 1.2, count))
    q = np.column_stack([np.sin(3 * t), np.cos(2 * t)]) + 0.01 * random.normal(size=(count, 2))
    seen = np.ones((count, 2), dtype=bool)
    seen[20:31, 0] = seen[45, 0] = False
    q[~seen] = np.nan
    noise, density = (0.01, 0.02), (30.0, 5.0)
    one = KalmanSmoother(model=model, noise=noise, density=density)
    # The rate relates densities to noise of single rows; density itself must not depend on it.
    for rate in (50.0, 20.0):
        found = one.smooth(t, q, rate=rate)
        for j in range(2):
            expected = dense(t, q[:, j], seen[:, j], n, density[j], noise[j])
            pairs = ((found.q, found.q_deviation), (found.dq, found.dq_deviation), (found.ddq, found.ddq_deviation))
            for (mean, spread), (exact, deviation) in zip(pairs, expected, strict=True):
                np.testing.assert_allclose(mean[:, j], exact, atol=2e-5 * np.abs(exact).max())
                np.testing.assert_allclose(spread[:, j], deviation, rtol=1e-4)


def test_steady_gains_change_nothing(random):
    t = np.arange(3000) / 1000.0
    q = np.sin(4 * t)[:, None] + 1e-4 * random.normal(size=(3000, 1))
    one = KalmanSmoother(cutoff=6.0)
    fast = one.smooth(t, q)
    # Steps that differ in the eighth digit never take the short way.
    slow = one.smooth(t + 1e-11 * (np.arange(3000) % 2), q)
    np.testing.assert_allclose(fast.ddq, slow.ddq, atol=1e-5)
    np.testing.assert_allclose(fast.ddq_deviation, slow.ddq_deviation, rtol=1e-5)


@pytest.mark.slow
def test_noise_is_measured_where_it_is_not_given(random):
    t = np.arange(20000) / 1000.0
    q = np.column_stack([np.sin(2 * t), 0.5 * np.cos(3 * t)]) + random.normal(size=(20000, 2)) * (1e-3, 3e-4)
    found = KalmanSmoother(cutoff=5.0).smooth(t, q)
    np.testing.assert_allclose(found.noise, [1e-3, 3e-4], rtol=0.03)


@pytest.mark.slow
def test_uneven_times_and_gaps_need_no_resampling(random):
    t = np.cumsum(random.uniform(0.5e-3, 1.5e-3, 6000))
    t = np.delete(t, slice(3000, 3040))
    recording = Recording(t=t, q=np.sin(3 * t)[:, None], torque=np.cos(t)[:, None])
    with pytest.raises(InputError, match="resample"):
        recording.process(cutoff=20.0, resample=False, trim=0.0, velocity_threshold=None)
    samples = recording.process(cutoff=20.0, filter="kalman", trim=0.2, velocity_threshold=None)
    assert samples.t is not None
    np.testing.assert_allclose(samples.ddq[:, 0], -9 * np.sin(3 * samples.t), atol=2e-2)
    # What needs even rows makes them.
    with pytest.raises(InputError, match="resample"):
        recording.process(cutoff=20.0, filter="kalman", decimate=4, resample=False, trim=0.0, velocity_threshold=None)
    fewer = recording.process(cutoff=20.0, filter="kalman", decimate=4, trim=0.0, velocity_threshold=None)
    np.testing.assert_allclose(np.median(np.diff(fewer.t)), 4e-3, rtol=0.01)


def test_missing_positions_are_bridged_and_not_used():
    t = np.arange(4000) / 1000.0
    absent = np.zeros((4000, 1), dtype=bool)
    absent[1500:1560] = True
    q = np.where(absent, 99.0, np.sin(3 * t)[:, None])
    recording = Recording(t=t, q=q, torque=np.cos(t)[:, None], position_missing=absent)
    samples = recording.process(cutoff=10.0, filter="kalman", trim=0.0, velocity_threshold=None)
    np.testing.assert_allclose(samples.q[100:-100, 0], np.sin(3 * t)[100:-100], atol=1e-3)
    np.testing.assert_array_equal(samples.mask, ~absent)
    assert samples.remarks == ("Rows left out because they are without a position: 60 of joint 1.",)


@pytest.mark.slow
def test_chunks_equal_the_whole(tmp_path, random):
    t = np.arange(6000) / 1000.0
    q = np.column_stack([np.sin(3 * t), np.cos(2 * t)]) + 1e-4 * random.normal(size=(6000, 2))
    path = Recording(t=t, q=q, torque=q).save(tmp_path / "log.npz")
    for one in ({"kind": "kalman"}, {"kind": "savitzky_golay"}, {"kind": "savitzky_golay", "window": 0.05}):
        processing = Processing.from_dict({"filter": one, "cutoff": 12.0, "trim": 0.1})
        whole = Recording.read(path).process(processing)
        joined = Samples.joined(list(process_chunks(path, processing=processing, rows=1700)))
        for name in ("q", "dq", "ddq"):
            expected = getattr(whole, name)
            np.testing.assert_allclose(getattr(joined, name), expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("t", "q", "phrase"),
    [
        ([0.0, 1.0, 1.0, 2.0, 3.0, 4.0], np.zeros((6, 1)), "must increase"),
        ([0.0, 1.0], np.zeros((3, 1)), r"expected \(S,\) and \(S, N\)"),
        (np.arange(6.0), np.full((6, 1), np.nan), "joint 1 has 0 positions"),
    ],
)
def test_what_cannot_be_smoothed_is_refused(t, q, phrase):
    with pytest.raises(InputError, match=phrase):
        KalmanSmoother(cutoff=0.1).smooth(t, q)
