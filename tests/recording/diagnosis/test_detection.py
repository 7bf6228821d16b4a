"""Faults of known place and size are found there, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import maximum_filter1d

import steelyard as sy
from steelyard.errors import InputError
from steelyard.recording import (
    LogColumns,
    Processing,
    Recording,
    Samples,
    clock_statistics,
    find_repeated,
    find_saturation,
    find_stiction,
    find_stuck_torque,
    process_chunks,
)
from steelyard.recording.diagnosis import advanced, noise_deviation, resolution, saturation_levels
from steelyard.recording.diagnosis.detectors import _largest_around, _may_rest, stuck_torque_duration
from steelyard.recording.diagnosis.rest import HeldJoints

RATE = 1000.0
T = np.arange(12000) / RATE


def smooth_log(joints: int = 2, step: float = 0.0, noise: float = 0.0, seed: int = 0) -> Recording:
    random = np.random.default_rng(seed)
    w = np.array([2.0, 3.1, 4.3])[:joints]
    q = np.sin(T[:, None] * w + 0.3)
    q = np.round(q / step) * step if step else q
    torque = 6.0 * np.cos(T[:, None] * w * 1.3) + noise * random.normal(size=(T.size, joints))
    return Recording(t=T, q=q, torque=torque, source="smooth")


@pytest.mark.parametrize("step", [0.0, 1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_nothing_is_found_in_a_sound_log(step, noise):
    log = smooth_log(3, step, noise)
    assert not find_stiction(log)
    assert not find_saturation(log)
    assert not find_repeated(log)
    assert log.diagnose().sentences() == ()
    assert repr(log.diagnose()) == "Diagnosis('smooth': nothing found)"


@pytest.mark.parametrize("size", [3, 5, 31, 199])
def test_the_largest_of_neighbours_is_that_of_scipy(size):
    for count in (200, 201, 997):
        values = np.random.default_rng(count).normal(size=count)
        expected = maximum_filter1d(values, size, mode="nearest")
        np.testing.assert_array_equal(_largest_around(values, size), expected)
        flags = values > 2.0
        flags[: size // 2] = flags[count - size // 2 :] = False
        expected = maximum_filter1d(flags.astype(np.uint8), size, mode="constant") > 0
        np.testing.assert_array_equal(_largest_around(flags, size), expected)


def test_no_rest_is_passed_over_by_its_blocks():
    """Where any window of so many rows stays within the tolerance, so does a block of half as many."""
    random = np.random.default_rng(5)
    rests = 0
    for _ in range(300):
        count = int(random.integers(10, 200))
        q = np.cumsum(random.normal(size=count) * random.choice([0.0, 0.1, 1.0], size=count, p=[0.6, 0.2, 0.2]))
        half, tolerance = int(random.integers(1, count // 3 + 1)), float(random.choice([1e-9, 0.1, 0.5]))
        windows = np.lib.stride_tricks.sliding_window_view(q, 2 * half + 1)
        if np.any(np.ptp(windows, axis=1) <= tolerance):
            assert _may_rest(q, half, tolerance)
            rests += 1
    assert rests > 50


def stuck(step: float = 1e-5) -> tuple[Recording, slice]:
    """Joint 2 stands still from 4 s to 4.6 s, and its torque goes on."""
    log = smooth_log(2)
    rest = slice(4000, 4600)
    clock = np.concatenate([T[:4000], np.full(600, T[4000]), T[4000:-600]])
    q = log.q.copy()
    q[:, 1] = np.sin(3.1 * clock)
    return Recording(t=T, q=np.round(q / step) * step, torque=log.torque, source="stuck"), rest


def test_stiction_is_found_where_it_is():
    log, rest = stuck()
    found = find_stiction(log)
    assert found.count[0] == 0
    (one,) = found
    # The joint begins and ends at full speed, so that its encoder tells the place to a row.
    assert (one.joint, one.start, one.stop) == (1, pytest.approx(rest.start, abs=3), pytest.approx(rest.stop, abs=3))
    samples = log.process(cutoff=None, stiction=True, trim=0.0, velocity_threshold=None)
    np.testing.assert_array_equal(samples.mask, ~found.flags)
    assert samples.remarks == (
        f"Rows left out because they are at rest while the torque changes: {found.count[1]} of joint 2.",
    )
    # A shorter rest than asked for is none, and a rest at constant torque is no stiction.
    assert log.process(cutoff=None, stiction=0.8, trim=0.0, velocity_threshold=None).mask is None
    torque = log.torque.copy()
    torque[rest, 1] = 1.0
    assert not find_stiction(Recording(t=T, q=log.q, torque=torque))


def test_rests_of_a_few_rows_have_no_empty_parts():
    """At 125 Hz the shortest rest is three rows, fewer than the parts whose means are compared."""
    t = np.arange(1000) / 125.0
    q = np.sin(3.0 * t)
    q[500:504] = q[500]
    torque = np.cos(2.0 * t)
    torque[500:504] += [0.0, 1.0, 2.0, 3.0]
    found = find_stiction(Recording(t=t, q=np.round(q, 5)[:, None], torque=torque[:, None]))
    assert [(one.start, one.stop) for one in found] == [(500, 504)]


def test_turning_around_is_no_rest():
    t = np.arange(60000) / 5000.0
    slow = Recording(t=t, q=np.round(np.sin(0.5 * t) / 1e-4)[:, None] * 1e-4, torque=np.cos(t)[:, None])
    assert not find_stiction(slow)


def test_saturation_is_found_at_its_level():
    log = smooth_log(2)
    torque = np.column_stack([np.clip(log.torque[:, 0], -4.0, 5.5), log.torque[:, 1]])
    clipped = Recording(t=T, q=log.q, torque=torque, source="clipped")
    np.testing.assert_array_equal(saturation_levels(torque), [[-4.0, 5.5], [-np.inf, np.inf]])
    found = find_saturation(clipped)
    beyond = (log.torque[:, 0] <= -4.0) | (log.torque[:, 0] >= 5.5)
    widened = beyond | np.roll(beyond, 1) | np.roll(beyond, -1)
    np.testing.assert_array_equal(found.flags[:, 0], widened)
    assert found.count[1] == 0
    samples = clipped.process(cutoff=None, saturation=True, trim=0.0, velocity_threshold=None)
    np.testing.assert_array_equal(samples.mask, ~found.flags)
    assert f"{widened.sum()} of joint 1" in samples.remarks[0]
    # A level that is stated counts on both sides.
    stated = clipped.process(cutoff=None, saturation=[4.0, 100.0], trim=0.0, velocity_threshold=None)
    above = np.abs(torque[:, 0]) >= 4.0
    assert stated.used[0] == np.count_nonzero(~(above | np.roll(above, 1) | np.roll(above, -1)))
    with pytest.raises(InputError, match="3 levels"):
        clipped.process(cutoff=None, saturation=[4.0, 100.0, 1.0], trim=0.0, velocity_threshold=None)


@pytest.mark.parametrize("quantum", [1e-3, 0.05])
def test_saturation_of_quantised_and_noisy_torques(quantum, random):
    torque = 6.0 * np.cos(2.6 * T) + 0.1 * random.normal(size=T.size)
    free = np.round(torque / quantum) * quantum
    assert not np.isfinite(saturation_levels(free[:, None])).any()
    clipped = np.clip(free, -5.0, 5.0)
    np.testing.assert_allclose(saturation_levels(clipped[:, None]), [[-5.0, 5.0]])


@pytest.mark.parametrize("seconds", [0.5, 1.0])
@pytest.mark.parametrize("hold", [1, 10])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_torque_that_stands_still_is_found_where_it_is(noise, hold, seconds):
    """Also where torques come less often than the positions; what the joint beside it does is no fault."""
    log = smooth_log(2, 1e-5, noise)
    torque = log.torque[np.arange(T.size) // hold * hold]
    rows = slice(4000, 4000 + int(seconds * RATE))
    torque[rows, 1] = torque[4000, 1]
    broken = replace(log, torque=torque)
    found = find_stuck_torque(broken)
    expected = np.zeros(torque.shape, dtype=bool)
    expected[rows, 1] = True
    np.testing.assert_array_equal(found.flags, expected)
    (sentence,) = broken.diagnose().sentences()
    assert sentence.startswith(f"Joint 2: {1000 * seconds:.0f} rows in 1 intervals are of a torque that stands still,")
    assert "`stuck_torque = true`" in sentence
    samples = broken.process(cutoff=None, stuck_torque=True, trim=0.0, velocity_threshold=None)
    np.testing.assert_array_equal(samples.mask, ~expected)


@pytest.mark.parametrize("digits", [None, 4])
def test_a_gap_of_a_torque_that_a_logger_filled_with_a_line_is_found(digits):
    log = smooth_log(2, 1e-5, 0.05)
    torque = log.torque.copy()
    torque[4000:4501, 1] = np.interp(np.arange(501), [0, 500], torque[[4000, 4500], 1])
    if digits is not None:
        torque = torque.round(digits)
    (one,) = find_stuck_torque(replace(log, torque=torque))
    assert (one.joint, one.stop) == (1, 4501)
    assert 4000 <= one.start <= 4001


def test_lines_between_torques_that_come_seldom_are_no_fault():
    """And a smooth torque of a simulation, which has no noise, may run along a line."""
    log = smooth_log(2, 1e-5, 0.05)
    seldom = np.column_stack([np.interp(T, T[::40], own[::40]) for own in log.torque.T])
    assert not find_stuck_torque(replace(log, torque=seldom))
    ramps = np.interp(T, [0, 3, 4, 8, 12], [0, 5, 5.5, -3, 1])
    assert not find_stuck_torque(replace(log, torque=np.column_stack([log.torque[:, 0], ramps])))


@pytest.mark.parametrize("rate", [20.0, 50.0])
def test_a_torque_that_stands_still_in_a_slow_log(rate):
    """Over five rows, fewer than the parts whose velocities are compared."""
    t = np.arange(400) / rate
    torque = 6.0 * np.cos(2.6 * t)
    torque[200:205] = torque[200]
    found = find_stuck_torque(Recording(t=t, q=np.sin(2.0 * t)[:, None], torque=torque[:, None]))
    assert [(one.start, one.stop) for one in found] == [(200, 205)]


def test_a_torque_of_a_joint_that_is_held_stands_still_while_others_move() -> None:
    """There no rest leaves out its rows; where the whole robot rests, they are as good as any."""
    log = smooth_log(2, 1e-5, 0.05)
    q, torque = log.q.copy(), log.torque.copy()
    q[:, 1] = 0.3 + 2e-5 * np.random.default_rng(2).normal(size=T.size)
    q[:2000, 0] = q[2000, 0]
    torque[5000:5600, 1], torque[500:1500, 1] = torque[5000, 1], torque[500, 1]
    found = find_stuck_torque(replace(log, q=q, torque=torque))
    assert [(one.joint, one.start, one.stop) for one in found] == [(1, 5000, 5600)]
    # What a controller asks for that sees no error is steady, and nothing tells it from a sensor that is not read.
    asked = np.column_stack([torque[:, 0], np.repeat([1.0, 1.2, 1.1, 1.0], 3000)])
    assert not find_stuck_torque(replace(log, q=q, torque=asked))


def legitimate_torques() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Positions and torques of sound joints, which stand still for a second or for long."""
    random = np.random.default_rng(3)
    smooth, motion = 6.0 * np.cos(0.7 * T), np.sin(1.1 * T + 0.3)
    noisy = smooth + 0.05 * random.normal(size=T.size)
    updates = np.flatnonzero(np.append(True, random.random(T.size - 1) < 0.05))
    speed = np.interp(T, [0, 0.4, 0.5, 1, 2, 2.1, 6, 6.1, 11, 12], [0, 1, 1, -1, -1, 0.3, 0.3, -0.5, -0.5, 0])
    rest = np.interp(T, [0, 4, 6, 12], [0, 4, 4, 10])
    return {
        "coarse": (motion, np.round(smooth / 0.5) * 0.5),
        "turns around in steps": (motion, np.round(smooth, 2)),
        "comes seldom": (motion, noisy[np.arange(T.size) // 200 * 200]),
        "comes now and then": (motion, noisy[updates[np.searchsorted(updates, np.arange(T.size), side="right") - 1]]),
        "at rest": (np.sin(rest), np.where((T >= 4) & (T < 6), 1.0, noisy)),
        "clipped": (motion, np.clip(noisy, -4.0, 4.0)),
        "steady motion": (np.cumsum(speed) / RATE, np.round(2.0 * np.sign(speed) + speed + np.gradient(speed, T), 3)),
        "drive off": (motion, np.where(T < 7.0, 0.0, noisy)),
        "throughout": (motion, np.full(T.size, 1.5)),
    }


@pytest.mark.parametrize("kind", legitimate_torques())
def test_a_torque_that_stands_still_by_nature_is_no_fault(kind):
    q, torque = legitimate_torques()[kind]
    q = np.round(q / 1e-5) * 1e-5
    runs = np.diff(np.flatnonzero(np.diff(torque, prepend=np.nan, append=np.nan) != 0.0))
    assert runs.max() >= 100  # long enough to be told where nothing speaks for it
    assert not find_stuck_torque(Recording(t=T, q=q[:, None], torque=torque[:, None]))


@pytest.mark.parametrize("hold", [1, 10, 50])
def test_clipping_is_told_from_torques_that_come_less_often(hold, random):
    """The largest of them stands for many rows, too, but for no more than any other."""
    torque = 6.0 * np.cos(2.6 * T) + 0.05 * random.normal(size=T.size)
    seldom = torque[np.arange(T.size) // hold * hold, None]
    assert not np.isfinite(saturation_levels(seldom)).any()
    np.testing.assert_array_equal(saturation_levels(np.clip(seldom, -5.0, np.inf)), [[-5.0, np.inf]])


def test_repeated_rows_are_found_where_they_are():
    log = smooth_log(2, 1e-5)
    q, torque = log.q.copy(), log.torque.copy()
    places = [300, 301, 302, 5000, 7777]
    for k in places:
        q[k], torque[k] = q[k - 1], torque[k - 1]
    broken = Recording(t=T, q=q, torque=torque)
    found = find_repeated(broken)
    np.testing.assert_array_equal(np.flatnonzero(found.flags[:, 0]), places)
    samples = broken.process(cutoff=None, repeated=True, trim=0.0, velocity_threshold=None)
    assert samples.used.tolist() == [11995, 11995]
    assert "All joints: 5 rows in 3 intervals" in found.sentences()[0]
    # The smoother goes on without them.
    smooth = broken.process(cutoff=30.0, filter="kalman", repeated=True, trim=0.0, velocity_threshold=None)
    np.testing.assert_allclose(smooth.q[100:-100], log.q[100:-100], atol=2e-5)


def test_clock_is_measured(random):
    kept = np.setdiff1d(np.arange(12000), [500, 501, 900])
    jitter = 2e-5 * random.normal(size=kept.size)
    log = Recording(t=kept / RATE + jitter, q=np.sin(2 * kept / RATE)[:, None], torque=np.ones((kept.size, 1)))
    found = clock_statistics(log)
    assert found.period == pytest.approx(1e-3, rel=1e-6)
    assert found.jitter == pytest.approx(2e-5, rel=0.05)
    assert found.missing == 3
    np.testing.assert_allclose(found.gaps, [[0.499, 0.502], [0.899, 0.901]], atol=2e-4)
    # The rows were taken evenly here, and only the stamps are off.
    assert found.verdict == "even clock"
    assert found.share == pytest.approx(0.0, abs=4 * found.share_deviation)
    assert "the rows were taken evenly" in found.sentences()[1]
    true = Recording(t=log.t, q=np.sin(2 * log.t)[:, None], torque=log.torque)
    assert clock_statistics(true).verdict == "stamps"
    assert clock_statistics(true).share == pytest.approx(1.0, abs=0.02)
    assert clock_statistics(smooth_log()).verdict == "even"
    noisy = Recording(t=log.t, q=log.q + 0.01 * random.normal(size=log.q.shape), torque=log.torque)
    assert clock_statistics(noisy).verdict == "unclear"


@pytest.mark.parametrize(
    ("delay", "known"),
    [
        pytest.param(0.0037, True, marks=pytest.mark.slow),
        (-0.0021, True),
        pytest.param(0.0, True, marks=pytest.mark.slow),
        pytest.param(0.0037, False, marks=pytest.mark.slow),
        pytest.param(-0.0021, False, marks=pytest.mark.slow),
        pytest.param(0.0, False, marks=pytest.mark.slow),
    ],
)
def test_delay_is_found(delay, known):
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")]).with_terms(sy.Viscous(), sy.Coulomb())
    model = sy.Model(robot)
    random = np.random.default_rng(2)

    def motion(t):
        w = np.array([1.7, 2.9])
        a = np.outer(t, w)
        return (
            np.sin(a) + 0.2 * np.cos(2.3 * a),
            w * (np.cos(a) - 0.46 * np.sin(2.3 * a)),
            -(w**2) * (np.sin(a) + 0.2 * 2.3**2 * np.cos(2.3 * a)),
        )

    parameters = np.abs(random.normal(size=model.parameter_count)) + 0.2
    torque = model.inverse_dynamics(*motion(T - delay), parameters) + 0.05 * random.normal(size=(T.size, 2))
    q, dq, ddq = motion(T)
    samples = Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=T)
    found = sy.recording.estimate_delay(samples, model if known else None)
    assert found.delay == pytest.approx(delay, abs=1.5e-4)
    assert found.standard_deviation < (1.5e-4 if known else 1e-3)
    assert abs(found.delay - delay) < 4 * found.standard_deviation
    # Processing takes it out again.
    log = Recording(t=T, q=q, torque=torque)
    corrected = log.process(
        Processing(cutoff=20.0, delay="automatic", trim=0.0, velocity_threshold=None), model if known else None
    )
    stated = log.process(cutoff=20.0, delay=delay, trim=0.0, velocity_threshold=None)
    exact = model.inverse_dynamics(q, dq, ddq, parameters)
    middle = slice(100, -100)
    for one in (corrected, stated):
        np.testing.assert_allclose(np.sqrt(np.mean((one.torque - exact)[middle] ** 2)), 0.05, rtol=0.25)
    assert ("moved back" if delay else "were not moved") in corrected.remarks[0]
    if delay:
        assert stated.used[0] == T.size - np.ceil(abs(delay) * RATE) - 1


def test_delay_of_each_joint_and_a_delay_too_long():
    log = smooth_log(2)
    samples = log.process(cutoff=None, delay=[0.0025, 0.0], trim=0.0, velocity_threshold=None)
    np.testing.assert_array_equal(samples.torque[:, 1], log.torque[:, 1])
    expected = 6.0 * np.cos((T + 0.0025) * 2.6)
    np.testing.assert_allclose(samples.torque[samples.mask[:, 0], 0], expected[samples.mask[:, 0]], atol=1e-7)
    with pytest.raises(InputError, match="3 values"):
        log.process(cutoff=None, delay=[0.1, 0.2, 0.3], trim=0.0, velocity_threshold=None)
    q, dq, ddq = np.sin(T)[:, None], np.cos(T)[:, None], -np.sin(T)[:, None]
    late = Samples(q=q, dq=dq, ddq=ddq, torque=np.sin(T - 0.2)[:, None] + np.sign(np.cos(T - 0.2))[:, None], t=T)
    model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, 0, -9.81)).with_terms(sy.Coulomb()))
    with pytest.raises(InputError, match="raise `longest`"):
        sy.recording.estimate_delay(late, model)


@pytest.mark.parametrize("rows", [0.0, 3.0, -2.0, 0.25, 7.75, -1.4])
def test_fractional_shift_is_exact_for_cubics(rows):
    x = np.arange(60.0)
    later, known = advanced(1.0 + x - 0.2 * x**2 + 0.01 * x**3, rows)
    y = x + rows
    np.testing.assert_allclose(later[known], (1.0 + y - 0.2 * y**2 + 0.01 * y**3)[known], atol=1e-9)
    assert known.sum() >= 60 - np.ceil(abs(rows)) - 3


@pytest.mark.parametrize("value", [1e308, -1.7e308, 1e20])
@pytest.mark.parametrize("missing", [99, 101])
def test_a_huge_number_beside_a_missing_one_is_refused_as_it_is_anywhere(value, missing):
    t = np.arange(500) / 100
    q = np.sin(t)
    q[[100, 102]], q[missing] = (value, -value), np.nan
    log = {"t": t, "q1": q, "tau1": np.cos(t)}
    with pytest.raises(InputError, match=r"a number beyond .* in row 101, which no robot reaches"):
        Recording.read(log, {"missing": "fill"})


def test_missing_values_are_filled_and_masked(tmp_path):
    q, torque = np.sin(2 * T), np.cos(3 * T)
    q[4000:4005] = np.nan
    torque[8000] = np.nan
    torque[9000] = np.inf
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack([T, q, torque]), delimiter=",", header="t,q1,tau1", comments="")
    with pytest.raises(InputError, match='missing = "fill"'):
        Recording.read(path)
    log = Recording.read(path, {"missing": "fill"})
    assert log.remarks == (
        "5 positions and 2 torques are missing, or too far from those before and after for a joint to move there and "
        "back, or zero for a moment among torques that are not; they were filled in, and are not used.",
    )
    np.testing.assert_allclose(log.q[:, 0], np.sin(2 * T), atol=1e-5)
    samples = log.process(cutoff=10.0, trim=0.0, velocity_threshold=None)
    dropped = [*range(4000, 4005), 8000, 9000]
    np.testing.assert_array_equal(np.flatnonzero(~samples.mask[:, 0]), dropped)
    assert samples.remarks[1:] == (
        "Rows left out because they are without a position: 5 of joint 1.",
        "Rows left out because they are without a torque: 2 of joint 1.",
    )
    assert log.missing.count.tolist() == [7]
    # Saved, it is missing again; resampled, the rows beside it are masked.
    again = Recording.read(log.save(tmp_path / "again.npz"), {"missing": "fill"})
    np.testing.assert_array_equal(again.missing.flags, log.missing.flags)
    finer = log.process(cutoff=10.0, resample=2000.0, trim=0.0, velocity_threshold=None)
    absent = np.flatnonzero(~finer.mask[:, 0]) / 2.0
    assert set(dropped) <= set(np.round(absent).astype(int))
    assert len(absent) <= 3 * len(dropped) + 6
    joined = Samples.joined(
        list(
            process_chunks(
                path, {"missing": "fill"}, Processing(cutoff=10.0, trim=0.0, velocity_threshold=None), rows=1500
            )
        )
    )
    np.testing.assert_array_equal(joined.mask, samples.mask)
    assert LogColumns.from_dict({"missing": "fill"}).to_dict() == {"missing": "fill"}
    with pytest.raises(InputError, match="'refuse' or 'fill'"):
        LogColumns.from_dict({"missing": "drop"})


def test_masks_and_counts_are_the_same_chunk_by_chunk(tmp_path):
    log, _ = stuck()
    torque = np.clip(log.torque, -5.0, 5.0)
    path = Recording(t=T, q=log.q, torque=torque).save(tmp_path / "log.npz")
    for options in (
        {"stiction": 0.2, "saturation": 5.0, "repeated": True},
        {"stiction": 0.2, "saturation": 5.0, "decimate": 5, "delay": 0.0033, "torque_cutoff": 60.0},
    ):
        processing = Processing.from_dict({"cutoff": 10.0, "velocity_threshold": "none", **options})
        whole = Recording.read(path).process(processing)
        parts = list(process_chunks(path, processing=processing, rows=12000 if "delay" in options else 4000))
        joined = Samples.joined(parts)
        assert whole.used.min() < whole.count
        np.testing.assert_array_equal(joined.mask, whole.mask)
        assert parts[-1].remarks == whole.remarks


def test_wrong_torques_spread_with_a_torque_filter_and_decimation():
    log = smooth_log(1)
    torque = np.clip(log.torque, -5.0, 5.0)
    clipped = Recording(t=T, q=log.q, torque=torque)
    plain = clipped.process(cutoff=None, saturation=True, trim=0.0, velocity_threshold=None)
    filtered = clipped.process(cutoff=None, saturation=True, torque_cutoff=10.0, trim=0.0, velocity_threshold=None)
    thinned = clipped.process(cutoff=None, saturation=True, decimate=10, trim=0.0, velocity_threshold=None)
    assert filtered.used[0] < plain.used[0]
    assert 0.08 * plain.used[0] < thinned.used[0] < 0.1 * plain.used[0]


def test_resolution_and_noise_are_told(random):
    values = np.column_stack([np.sin(2 * T), np.round(np.sin(3 * T) / 2e-4) * 2e-4])
    np.testing.assert_allclose(resolution(values), [0.0, 2e-4], rtol=1e-6)
    noisy = np.sin(2 * T)[:, None] + 3e-3 * random.normal(size=(T.size, 1))
    assert noise_deviation(noisy)[0] == pytest.approx(3e-3, rel=0.05)
    assert resolution(noisy)[0] == 0.0


def test_whole_log_filters_refuse_chunks(tmp_path):
    path = smooth_log().save(tmp_path / "log.npz")
    for options in ({"filter": "fourier"}, {"filter": "fourier", "average": True}):
        with pytest.raises(InputError, match="needs the log whole, in memory"):
            list(process_chunks(path, processing=Processing.from_dict(options)))


def test_joints_with_names_are_called_by_them() -> None:
    """The number of a column is not that of parameters, which count joints that no log has."""
    t = np.arange(0.0, 10.0, 0.005)
    q = np.column_stack([np.sin(t), np.sin(1.3 * t)])
    torque = np.column_stack([np.cos(t), np.clip(2.0 * np.cos(1.3 * t), -1.0, 1.0)])
    recording = Recording(t=t, q=q, torque=torque, joint_names=("Elbow", "joint4"))
    [clipped] = recording.diagnose().saturation.sentences()
    assert clipped.startswith("Joint 'joint4': ")
    [unnamed] = replace(recording, joint_names=None).diagnose().saturation.sentences()
    assert unnamed.startswith("Joint 2: ")
    still = replace(recording, q=q * [0.0, 1.0])
    assert HeldJoints.of(still).remarks(still)[0].startswith("Joint 'Elbow' does not move")
    samples = recording.process(cutoff=10.0, saturation=True)
    assert any("of joint 'joint4'" in remark for remark in samples.remarks)


@pytest.mark.parametrize("seed", range(12))
def test_no_stretch_is_missed_by_looking_at_bends_first(seed: int) -> None:
    random = np.random.default_rng(seed)
    rate = (250.0, 500.0, 1000.0, 2000.0)[seed % 4]
    t = np.arange(12000) / rate
    q = np.stack([np.sin(1.7 * t) + np.sin(0.9 * t), np.cos(1.1 * t) + np.sin(2.3 * t)], axis=1)
    torque = 5.0 * np.stack([np.cos(1.3 * t + seed), np.sin(2.1 * t)], axis=1)
    torque += (0.0, 0.02, 0.3)[seed % 3] * random.normal(size=torque.shape)
    rows = int(0.6 * rate)
    torque[4000 : 4000 + rows, 0] = torque[4000, 0]
    torque[7000 : 7000 + rows, 1] = np.linspace(torque[7000, 1], torque[7000 + rows, 1], rows)
    recording = Recording(t=t, q=q, torque=torque)
    tolerance, duration = stuck_torque_duration(recording)
    searched = find_stuck_torque(recording, duration, tolerance)
    assert searched
    assert np.array_equal(find_stuck_torque(recording).flags, searched.flags)
