"""Signal processing against closed forms and against SciPy."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from steelyard.errors import InputError
from steelyard.recording import Processing, Recording, Samples
from steelyard.recording.filters.zero_phase import motion_frequency

RATE = 1000.0


def recording_of(q: np.ndarray, rate: float = RATE, torque: np.ndarray | None = None, **more: object) -> Recording:
    t = np.arange(len(q)) / rate
    return Recording(t=t, q=q, torque=np.cos(3 * t)[:, None] + q if torque is None else torque, **more)  # type: ignore[arg-type]


def sines(*frequencies: float, seconds: float = 20.0, rate: float = RATE) -> np.ndarray:
    t = np.arange(round(seconds * rate)) / rate
    return np.column_stack([np.sin(2 * np.pi * f * t + 0.3) for f in frequencies])


@pytest.mark.parametrize("order", [1, 3, 4])
@pytest.mark.parametrize("frequency", [1.0, 4.8, 10.0])
def test_filter_gain_is_the_squared_butterworth(order: int, frequency: float) -> None:
    # Digital Butterworth by the bilinear transform: |H|^2 = 1 / (1 + (tan(pi f h) / tan(pi fc h))^(2 order)).
    samples = recording_of(sines(frequency)).process(cutoff=4.8, order=order, trim=0.0, velocity_threshold=None)
    gain = 1.0 / (1.0 + (np.tan(np.pi * frequency / RATE) / np.tan(np.pi * 4.8 / RATE)) ** (2 * order))
    middle = slice(5000, 15000)
    np.testing.assert_allclose(samples.q[middle], gain * sines(frequency)[middle], atol=1e-9)


def test_filter_equals_filtfilt() -> None:
    rng = np.random.default_rng(7)
    q = sines(0.5, 1.3) + 1e-3 * rng.normal(size=(20000, 2))
    samples = recording_of(q).process(cutoff=25.0, torque_cutoff=40.0, trim=0.0, velocity_threshold=None)
    b, a = signal.butter(3, 25.0 / (RATE / 2))
    np.testing.assert_allclose(samples.q, signal.filtfilt(b, a, q, axis=0), atol=1e-10)
    b, a = signal.butter(3, 40.0, fs=RATE)
    torque = np.cos(3 * np.arange(20000) / RATE)[:, None] + q
    np.testing.assert_allclose(samples.torque, signal.filtfilt(b, a, torque, axis=0), atol=1e-10)


@pytest.mark.parametrize("rate", [50.0, 100.0, 400.0])
def test_derivatives_are_of_fourth_order(rate: float) -> None:
    t = np.arange(round(4 * rate)) / rate
    omega = 2 * np.pi
    samples = recording_of(np.sin(omega * t)[:, None], rate).process(cutoff=None, trim=0.0, velocity_threshold=None)
    velocity, acceleration, step = omega * np.cos(omega * t), -(omega**2) * np.sin(omega * t), omega / rate
    # Differences over five rows of a sine: exact up to a factor, its square for the second derivative.
    factor = (8.0 * np.sin(step) - np.sin(2.0 * step)) / (6.0 * step)
    assert abs(factor - 1.0) < step**4 / 30.0
    np.testing.assert_allclose(samples.dq[2:-2, 0], velocity[2:-2] * factor, atol=1e-9)
    np.testing.assert_allclose(samples.ddq[4:-4, 0], acceleration[4:-4] * factor**2, atol=1e-7)
    # The ends, of second order: the error of the one-sided difference is h²/3 times the third derivative.
    for row, share in ((0, 3), (1, 6), (-2, 6), (-1, 3)):
        assert abs(samples.dq[row, 0] - velocity[row]) < 1.01 * omega * step**2 / share


def test_polynomials_of_second_degree_are_exact() -> None:
    t = np.arange(50) / 10.0
    q = (1.0 - 2.0 * t + 3.0 * t**2)[:, None]
    samples = recording_of(q, rate=10.0).process(cutoff=None, trim=0.0, velocity_threshold=None)
    np.testing.assert_allclose(samples.dq[:, 0], -2.0 + 6.0 * t, atol=1e-11)
    np.testing.assert_allclose(samples.ddq[:, 0], 6.0, atol=1e-10)


def test_measured_velocity_is_filtered_and_derived_once() -> None:
    q = sines(1.0)
    t = np.arange(20000) / RATE
    velocity = 2 * np.pi * np.cos(2 * np.pi * t + 0.3)[:, None]
    samples = recording_of(q, velocity=velocity).process(
        cutoff=25.0, velocity="measured", trim=0.0, velocity_threshold=None
    )
    b, a = signal.butter(3, 25.0, fs=RATE)
    dq = signal.filtfilt(b, a, velocity, axis=0)
    np.testing.assert_allclose(samples.dq, dq, atol=1e-10)
    once = (8.0 * (dq[3:-1] - dq[1:-3]) - (dq[4:] - dq[:-4])) * RATE / 12.0
    np.testing.assert_allclose(samples.ddq[2:-2], once, atol=1e-6)


def test_decimation_equals_scipy_in_two_steps() -> None:
    q = sines(0.5, 1.3)
    whole = recording_of(q).process(cutoff=None, trim=(0.5, 1.0), velocity_threshold=None)
    samples = recording_of(q).process(cutoff=None, trim=(0.5, 1.0), decimate=[10, 4], velocity_threshold=None)
    for name in ("q", "dq", "ddq", "torque"):
        expected = signal.decimate(signal.decimate(getattr(whole, name), 10, axis=0), 4, axis=0)
        np.testing.assert_allclose(getattr(samples, name), expected, atol=1e-12)
    assert whole.t is not None
    assert samples.t is not None
    np.testing.assert_array_equal(samples.t, whole.t[::40])
    assert (whole.count, samples.count) == (18500, 463)


def test_trimming_counts_from_both_ends() -> None:
    samples = recording_of(sines(1.0)).process(cutoff=None, trim=(1.0, 2.5), velocity_threshold=None)
    assert samples.t is not None
    assert samples.t[0] == pytest.approx(1.0)
    assert samples.t[-1] == pytest.approx(20.0 - 2.5 - 0.001)


def test_slow_rows_are_masked_joint_by_joint() -> None:
    samples = recording_of(sines(0.5, 1.3)).process(cutoff=None, velocity_threshold=[1.0, 0.0], trim=0.0)
    assert samples.mask is not None
    np.testing.assert_array_equal(samples.mask[:, 0], np.abs(samples.dq[:, 0]) >= 1.0)
    assert samples.mask[:, 1].all()
    # |cos| >= 1/pi for the share 1 - 2 asin(1/pi)/pi of the time.
    assert samples.used[0] / samples.count == pytest.approx(1 - 2 * np.arcsin(1 / np.pi) / np.pi, abs=1e-3)


@pytest.mark.parametrize("mask", [None, np.array([[True, False], [False, False], [True, True]])])
def test_rows_are_used_that_no_mask_leaves_out(mask: NDArray[np.bool_] | None) -> None:
    zeros = np.zeros((3, 2))
    samples = Samples(q=zeros, dq=zeros, ddq=zeros, torque=zeros, mask=mask)
    rows, counts = ([[True] * 2] * 3, [3, 3]) if mask is None else (mask.tolist(), [2, 1])
    assert samples.used_rows.tolist() == rows
    assert samples.used.tolist() == counts
    assert Samples.joined([samples, samples]).used.tolist() == [2 * count for count in counts]


def test_excluded_joints_are_masked() -> None:
    named = recording_of(sines(0.5, 1.3), joint_names=("elbow", "wrist"))
    for joint in (2, "wrist"):
        samples = named.process(cutoff=None, exclude_joints=[joint], trim=0.0, velocity_threshold=None)
        assert samples.used.tolist() == [20000, 0]


def test_frequency_of_the_motion() -> None:
    t = np.arange(37500) / RATE
    noise = 1e-4 * np.random.default_rng(3).normal(size=t.size)
    q = (np.sin(2 * np.pi * 0.08 * t) + 0.5 * np.sin(2 * np.pi * 0.48 * t) + noise)[:, None]
    # Within the width of the window's main lobe, two lines of 1/37.5 s each way.
    assert motion_frequency(q, RATE) == pytest.approx(0.48, abs=2 / 37.5)
    choice = recording_of(q).choose_cutoff()
    assert choice.rule == pytest.approx(10 * motion_frequency(q, RATE))


@pytest.mark.parametrize("key", ["cutoff", "trim", "velocity_threshold"])
def test_what_the_data_decides_has_one_name(key: str) -> None:
    assert Processing.from_dict({key: "auto"}) == Processing()
    with pytest.raises(InputError, match=f'{key}.*"automatic".*is called "auto"'):
        Processing.from_dict({key: "automatic"})


@pytest.mark.parametrize(
    ("options", "seconds"),
    [
        # The slowest pole of a Butterworth filter of order 3, at -w/2, and that of order 1, at -w.
        ({"cutoff": 8.0}, 2.0 * np.log(1e3) / (2 * np.pi * 8.0)),
        ({"cutoff": 8.0, "order": 1}, np.log(1e3) / (2 * np.pi * 8.0)),
        ({"cutoff": 20.0, "torque_cutoff": 8.0}, 2.0 * np.log(1e3) / (2 * np.pi * 8.0)),
        ({"cutoff": None}, 0.0),
        ({"cutoff": 8.0, "filter": "kalman"}, 2.0 * np.log(1e3) / (2 * np.pi * 8.0)),
        ({"filter": {"kind": "savitzky_golay", "window": 0.4}}, 0.2),
        # No more than 15 % of the log.
        ({"cutoff": 0.5}, 1.5),
    ],
)
def test_spoilt_ends_are_dropped_by_default(options: dict, seconds: float) -> None:
    t = np.arange(10000) / RATE
    recording = recording_of(np.sin(2 * np.pi * 0.5 * t + 0.7)[:, None])
    samples = recording.process(**options, velocity_threshold=None)
    assert samples.t is not None
    assert samples.t[0] == pytest.approx(seconds, abs=0.01)
    assert t[-1] - samples.t[-1] == pytest.approx(seconds, abs=0.01)


def test_kept_rows_of_a_log_cut_in_motion_are_right() -> None:
    """The log ends in motion: what a filter makes of its ends is off by the size of the motion itself."""
    t = np.arange(10000) / RATE
    w = 2 * np.pi * 0.5
    recording = recording_of(np.sin(w * t + 0.7)[:, None])
    errors = [
        np.abs(found.ddq[:, 0] + w**2 * np.sin(w * found.t + 0.7)).max() / w**2
        for found in (recording.process(cutoff=8.0, trim=trim, velocity_threshold=None) for trim in (0.0, "auto"))
    ]
    assert errors[0] > 0.5
    assert errors[1] < 0.02


def test_small_jitter_is_accepted_and_said() -> None:
    t = np.arange(1000) / RATE
    even = t.copy()
    t[1::2] += 0.04 / RATE
    samples = Recording(t=t, q=np.sin(even)[:, None], torque=np.cos(t)[:, None]).process(
        cutoff=None, trim=0.0, velocity_threshold=None
    )
    assert len(samples.remarks) == 1
    assert "by up to 4 %; even sampling was assumed" in samples.remarks[0]


def test_resampling_restores_an_uneven_log() -> None:
    rng = np.random.default_rng(11)
    t = np.sort(np.concatenate([[0.0, 10.0], np.arange(1, 2000) / 200 + rng.uniform(-0.002, 0.002, 1999)]))
    keep = np.ones(t.size, bool)
    keep[600:604] = False
    t = t[keep]
    uneven = Recording(t=t, q=np.sin(2 * t)[:, None], torque=np.cos(t)[:, None])
    samples = uneven.process(cutoff=None, resample=200.0, longest_gap=0.05, trim=0.0, velocity_threshold=None)
    assert samples.t is not None
    np.testing.assert_allclose(np.diff(samples.t), 1 / 200, atol=1e-12)
    inside = slice(5, -5)
    np.testing.assert_allclose(samples.q[inside, 0], np.sin(2 * samples.t)[inside], atol=1e-7)
    np.testing.assert_allclose(samples.torque[:, 0], np.cos(samples.t), atol=1e-4)
    # The rows inside the gap are made up, and so not used.
    assert samples.mask is not None
    inside_gap = (samples.t > t[599]) & (samples.t < t[600])
    assert inside_gap.sum() == 5
    np.testing.assert_array_equal(samples.mask[:, 0], ~inside_gap)
    with pytest.raises(InputError, match=r"asks for 50 Hz.*decimate"):
        uneven.process(resample=50.0, longest_gap=0.05, trim=0.0, velocity_threshold=None)


def test_processing_survives_its_dictionary() -> None:
    processing = Processing(
        cutoff=None, order=4, trim=(1.0, 2.0), decimate=(10, 10), velocity_threshold=(0.1, 0.2), exclude_joints=(1, "b")
    )
    assert processing.to_dict()["cutoff"] == "none"
    assert Processing.from_dict(processing.to_dict()) == processing
    assert Processing().to_dict() == {}
    assert Processing.from_dict({"decimate": 5}).step == 5


def test_samples_check_what_they_are_given() -> None:
    good = np.zeros((4, 2))
    with pytest.raises(InputError, match=r"`ddq` of Samples has shape \(3, 2\) where q has \(4, 2\)"):
        Samples(q=good, dq=good, ddq=good[:3], torque=good)
    with pytest.raises(InputError, match=r"`dq` of Samples is not finite in 1 places, first in row 3, column 2"):
        Samples(q=good, dq=np.where(np.arange(8).reshape(4, 2) == 5, np.nan, 0.0), ddq=good, torque=good)
    with pytest.raises(InputError, match="must be boolean"):
        Samples(q=good, dq=good, ddq=good, torque=good, mask=np.ones((4, 2)))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"`torque` of Samples must be .*, NaN where .*, got an array with masked"):
        Samples(q=good, dq=good, ddq=good, torque=np.ma.array(good, mask=good == 0.0))
    with pytest.raises(InputError, match="one row per sample"):
        Samples(q=np.zeros(4), dq=good, ddq=good, torque=good)


def test_samples_join() -> None:
    one = Samples(q=np.zeros((4, 2)), dq=np.zeros((4, 2)), ddq=np.zeros((4, 2)), torque=np.ones((4, 2)))
    masked = Samples(q=one.q, dq=one.dq, ddq=one.ddq, torque=one.torque, mask=np.array([[True, False]] * 4))
    both = Samples.joined([one, masked])
    assert both.used.tolist() == [8, 4]
    assert repr(both) == "Samples(8 rows x 2 joints, 12 of 16 joint rows used)"
    assert "<td>4</td>" in both._repr_html_()
    with pytest.raises(InputError, match="1 and 2 joints"):
        Samples.joined([one, Samples(q=one.q[:, :1], dq=one.q[:, :1], ddq=one.q[:, :1], torque=one.q[:, :1])])


def test_fortran_arrays_become_c_order() -> None:
    q = np.asfortranarray(np.random.default_rng(0).normal(size=(5, 3)))
    samples = Samples(q=q, dq=q, ddq=q, torque=q)
    assert samples.q.flags.c_contiguous
    np.testing.assert_array_equal(samples.q, q)


def test_options_are_given_in_one_way():
    recording = Recording(
        t=np.arange(2000) / RATE, q=np.sin(np.arange(2000) / 300.0)[:, None], torque=np.ones((2000, 1))
    )
    options = {"cutoff": 5.0, "velocity_threshold": None, "exclude_joints": [1], "trim": 0.1}
    with pytest.raises(InputError, match=r"a Processing and trim beside it; give one or the other"):
        recording.process(Processing(cutoff=5.0), trim=0.1)
    with pytest.raises(InputError, match=r"given 4\.8; give a Processing, or its options by name"):
        recording.process(4.8)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="leaves none to use"):
        recording.process(**options)
    moving = Recording(t=recording.t, q=recording.q, torque=recording.q)
    del options["exclude_joints"]
    both = moving.process(Processing.from_dict(options)), moving.process(**options)
    np.testing.assert_array_equal(both[0].ddq, both[1].ddq)
