"""Filters of positions against SciPy, against sines and polynomials whose derivatives are known, and by their keys."""

import numpy as np
import pytest
from scipy import signal

from steelyard.errors import InputError
from steelyard.recording import Butterworth, FourierFit, KalmanSmoother, Processing, Recording, SavitzkyGolay

RATE = 500.0
FILTERS = [
    Butterworth(cutoff=8.0, order=3),
    SavitzkyGolay(window=0.15, degree=4),
    SavitzkyGolay(degree=3, cutoff=8.0),
    KalmanSmoother(cutoff=8.0),
    KalmanSmoother(cutoff=8.0, model="jerk"),
]


def sine(frequency: float, seconds: float = 12.0) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(round(seconds * RATE)) / RATE
    return t, np.sin(2 * np.pi * frequency * t + 0.4)[:, None]


@pytest.mark.parametrize(
    "frequency", [0.7, pytest.param(3.0, marks=pytest.mark.slow), 8.0, pytest.param(13.0, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("one", FILTERS, ids=str)
def test_response_is_what_becomes_of_a_sine(one, frequency):
    t, q = sine(frequency)
    motion = one.motion(t, q, RATE, "sine")
    w = 2 * np.pi * frequency
    truth = (q[:, 0], w * np.cos(w * t + 0.4), -(w**2) * q[:, 0])
    response = one.response([frequency], RATE)
    middle = slice(1500, 4500)
    for found, gain, exact in zip(motion, response, truth, strict=True):
        # The Kalman smoother's response is that of continuous time.
        tolerance = 2e-3 if isinstance(one, KalmanSmoother) else 1e-8
        np.testing.assert_allclose(found[middle, 0], gain[0] * exact[middle], atol=tolerance * np.abs(exact).max())


@pytest.mark.parametrize("degree", [2, 4, 5])
def test_savitzky_golay_is_scipys(degree):
    rng = np.random.default_rng(1)
    t, q = sine(1.0)
    q = q + 1e-3 * rng.normal(size=q.shape)
    motion = SavitzkyGolay(window=0.1, degree=degree).motion(t, q, RATE, "sine")
    for order, found in enumerate(motion):
        np.testing.assert_allclose(
            found, signal.savgol_filter(q, 51, degree, deriv=order, delta=1 / RATE, axis=0), atol=1e-9
        )


@pytest.mark.parametrize(("cutoff", "degree"), [(2.0, 2), (8.0, 4), (40.0, 6)])
def test_savitzky_golay_halves_the_amplitude_at_the_cutoff(cutoff, degree):
    one = SavitzkyGolay(cutoff=cutoff, degree=degree)
    half = one.half_window(RATE)
    gains = []
    for size in (half - 1, half, half + 1):
        coefficients = signal.savgol_coeffs(2 * size + 1, degree)
        _, response = signal.freqz(coefficients, worN=[cutoff], fs=RATE)
        gains.append(abs(abs(response[0]) - 0.5))
    assert np.argmin(gains) == 1


def test_polynomials_pass_savitzky_golay_unchanged():
    t = np.arange(300) / 100.0
    q = (1.0 - t + 0.5 * t**2 - 0.3 * t**3 + 0.02 * t**4)[:, None]
    motion = SavitzkyGolay(window=0.4, degree=4).motion(t, q, 100.0, "polynomial")
    np.testing.assert_allclose(motion.dq[:, 0], -1.0 + t - 0.9 * t**2 + 0.08 * t**3, atol=1e-9)
    np.testing.assert_allclose(motion.ddq[:, 0], 1.0 - 1.8 * t + 0.24 * t**2, atol=1e-7)


@pytest.mark.parametrize(
    ("kind", "options"),
    [("savitzky_golay", {"degree": 3}), ("kalman", {"model": "jerk"}), ("butterworth", {"order": 2})],
)
def test_processing_takes_filters_by_name_and_by_table(kind, options):
    t, q = sine(1.0)
    recording = Recording(t=t, q=q, torque=q)
    table = Processing.from_dict(
        {"cutoff": 6.0, "filter": {"kind": kind, **options}, "trim": 0.0, "velocity_threshold": "none"}
    )
    assert Processing.from_dict(table.to_dict()) == table
    assert table.to_dict()["filter"] == {"kind": kind, **options}
    found = recording.process(table)
    expected = table.filter.settled(6.0, 3, "").motion(t, q, RATE, "")
    np.testing.assert_array_equal(found.ddq, expected.ddq)
    assert recording.process(cutoff=6.0, filter=kind, trim=0.0, velocity_threshold=None).count == recording.count


def test_fourier_fit_is_exact_for_periodic_motion_at_any_times(random):
    t = np.sort(random.uniform(0.0, 9.0, 1500))
    w = 2 * np.pi / 2.5
    q = 0.3 + np.sin(w * t) - 0.2 * np.cos(4 * w * t)
    motion = FourierFit(period=2.5, harmonics=5).motion(t, q[:, None], 166.0, "series")
    np.testing.assert_allclose(motion.dq[:, 0], w * np.cos(w * t) + 0.8 * w * np.sin(4 * w * t), atol=1e-10)
    np.testing.assert_allclose(motion.ddq[:, 0], -(w**2) * np.sin(w * t) + 3.2 * w**2 * np.cos(4 * w * t), atol=1e-9)
    # Harmonics that are there are found, and no more.
    assert FourierFit(period=2.5).series(t, q[:, None]).harmonics == 4
    noisy = q + 1e-3 * random.normal(size=q.shape)
    series = FourierFit(period=2.5).series(t, noisy[:, None])
    assert series.harmonics == 4
    assert series.noise[0] == pytest.approx(1e-3, rel=0.08)


def test_fourier_fit_passes_over_missing_rows():
    t, q = sine(0.8)
    holes = q.copy()
    holes[700:900] = np.nan
    motion = FourierFit(period=1.25, harmonics=2).motion(t, holes, RATE, "holes")
    np.testing.assert_allclose(motion.q, q, atol=1e-10)


@pytest.mark.parametrize(
    ("options", "phrase"),
    [
        ({"filter": "buterworth"}, 'did you mean "butterworth"'),
        ({"filter": {"kind": "kalman", "modle": "jerk"}}, 'did you mean "model"'),
        ({"filter": {"window": 0.1}}, "whose `kind`"),
        ({"filter": {"kind": "kalman", "model": "snap"}}, "'acceleration' or 'jerk'"),
        ({"filter": {"kind": "kalman", "density": 1.0}}, "needs `noise`"),
        ({"filter": {"kind": "savitzky_golay", "degree": 1}}, "whole number from 2 to 8"),
        ({"filter": {"kind": "savitzky_golay", "window": -0.1}}, "a time in s"),
        ({"filter": "savitzky_golay", "cutoff": "none"}, "needs `window` in s, or a `cutoff`"),
        ({"filter": "kalman", "cutoff": "none"}, "needs a `cutoff` in Hz"),
        ({"filter": "kalman", "cutoff": 300.0}, "not below half of it"),
        ({"filter": {"kind": "savitzky_golay", "window": 60.0}}, "the window of the filter takes"),
        ({"filter": {"kind": "fourier", "period": 50.0}}, "less than the period"),
        ({"filter": {"kind": "fourier", "period": 1.0, "harmonics": 400}}, "lower `harmonics`"),
        ({"filter": {"kind": "kalman", "cutoff": 5.0, "noise": [1.0, 2.0]}}, "give one each"),
        ({"filter": "kalman", "velocity": "measured"}, 'goes with the filter "butterworth" alone'),
        ({"average": True}, 'goes with `filter = "fourier"` alone'),
        ({"average": True, "filter": "fourier", "decimate": 5}, "does not go with `decimate`"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_sentence(options, phrase):
    t, q = sine(1.0)
    with pytest.raises(InputError) as caught:
        Recording(t=t, q=q, torque=q).process(**options)
    assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)
