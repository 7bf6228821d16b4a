"""Periods that are known are found; averages and their noise against plain NumPy."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.identification.wam import simulated_log
from steelyard.recording import Recording, average_periods, find_period

RATE = 1000.0


def log_of(period: float, periods: float, noise=(0.3, 0.1), seed: int = 0, rate: float = RATE) -> Recording:
    random = np.random.default_rng(seed)
    t = np.arange(round(periods * period * rate)) / rate
    w = 2 * np.pi / period
    q = np.column_stack([np.sin(w * t), 0.5 * np.cos(2 * w * t) + 0.2 * np.sin(3 * w * t)])
    torque = np.column_stack([3 * np.cos(w * t) + np.sign(np.cos(w * t)), 2 * np.sin(2 * w * t)])
    mixing = np.array([[1.0, 0.0], [0.5, 1.0]]) * noise
    return Recording(
        t=t,
        q=q + 1e-4 * random.normal(size=q.shape),
        torque=torque + random.normal(size=q.shape) @ mixing.T,
        source="periodic",
    )


@pytest.mark.parametrize("period", [0.731, 1.0, 2.34567, 12.5 / 6])
@pytest.mark.parametrize("periods", [2.2, 3.0, 7.6])
def test_period_is_found(period, periods):
    log = log_of(period, periods)
    found = find_period(log.t, log.q)
    # Noise of 1e-4 on a motion of size one.
    assert found.period == pytest.approx(period, rel=1e-4)
    assert found.difference < 1e-2


def test_period_of_the_thesis(wam):
    log = simulated_log(wam, "A", 3)
    assert find_period(log.t, log.q).period == pytest.approx(12.5, rel=1e-5)


def test_no_period_is_told(random):
    t = np.arange(4000) / RATE
    with pytest.raises(InputError, match="no period was found"):
        find_period(t, np.column_stack([np.sin(2 * t), np.sin(2 * np.sqrt(2) * t + t**2)]))
    with pytest.raises(InputError, match="no joint moves"):
        find_period(t, np.zeros((4000, 1)))


def test_average_is_numpys():
    log = log_of(1.5, 8)
    average = average_periods(log, period=1.5, harmonics=3)
    folded = log.torque.reshape(8, 1500, 2)
    mean = folded.mean(axis=0)
    np.testing.assert_allclose(average.samples.torque, mean, atol=1e-12)
    rest = (folded - mean).reshape(-1, 2)
    np.testing.assert_allclose(average.torque_covariance, rest.T @ rest / (7 * 1500), rtol=1e-9)
    np.testing.assert_allclose(average.covariance, average.torque_covariance / 8)
    np.testing.assert_allclose(average.position_deviation, 1e-4, rtol=0.05)
    mixing = np.array([[0.3, 0.0], [0.15, 0.1]])
    np.testing.assert_allclose(average.torque_covariance, mixing @ mixing.T, rtol=0.1)
    # The motion is that of the series: its derivatives hardly have noise.
    w = 2 * np.pi / 1.5
    t = np.arange(1500) / RATE
    np.testing.assert_allclose(average.samples.ddq[:, 0], -(w**2) * np.sin(w * t), atol=3e-5 * w**2)
    assert "8 periods of 1.5 s" in average.samples.remarks[0]
    assert "<table>" in average._repr_html_()


def test_periods_between_rows_are_interpolated():
    period = 1.23456
    log = log_of(period, 6.3, noise=(0.0, 0.0))
    average = average_periods(log, period=period)
    t = average.samples.t
    smooth = 2 * np.sin(2 * 2 * np.pi / period * t)
    np.testing.assert_allclose(average.samples.torque[:, 1], smooth, atol=1e-3)
    assert average.periods == 6
    assert average.torque_deviation[1] < 1e-3


def test_missing_torques_do_not_count():
    log = log_of(1.0, 5)
    absent = np.zeros(log.torque.shape, dtype=bool)
    absent[1100:1200, 0] = True
    absent[np.arange(5)[:, None] * 1000 + np.arange(400, 420), 1] = True
    wild = Recording(t=log.t, q=log.q, torque=np.where(absent, 1e6, log.torque), torque_missing=absent, source="holes")
    average = average_periods(wild, period=1.0)
    others = np.delete(log.torque[:, 0].reshape(5, 1000)[:, 100:200], 1, axis=0)
    np.testing.assert_allclose(average.samples.torque[100:200, 0], others.mean(axis=0), atol=1e-12)
    assert average.samples.used.tolist() == [1000, 980]
    np.testing.assert_allclose(average.torque_deviation, [0.3, np.hypot(0.15, 0.1)], rtol=0.1)


def test_processing_averages(wam):
    log = simulated_log(wam, "A", 5, rate=200.0)
    filter_ = {"kind": "fourier", "period": 12.5, "harmonics": 6}
    samples = log.process(filter=filter_, average=True)
    assert samples.count == 2500
    whole = log.process(filter=filter_)
    assert whole.count == 7500
    # The estimate of the average is that of all the periods.
    one, all_ = (sy.least_squares(sy.Information.from_samples(wam, s), None) for s in (samples, whole))
    np.testing.assert_allclose(one.base, all_.base, atol=1e-6 * np.abs(all_.base).max())
    assert one.relative_error < all_.relative_error
    thresholds = log.process(filter=filter_, average=True, velocity_threshold=0.1, exclude_joints=[7])
    assert thresholds.used[6] == 0
    assert 0 < thresholds.used[0] < 2500


@pytest.mark.slow
def test_known_covariance_gives_generalised_least_squares():
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")]).with_terms(sy.Viscous())
    model = sy.Model(robot)
    t = np.arange(10000) / RATE
    w = np.pi
    q = np.column_stack([np.sin(w * t), np.cos(2 * w * t)])
    dq = np.column_stack([w * np.cos(w * t), -2 * w * np.sin(2 * w * t)])
    ddq = np.column_stack([-(w**2) * np.sin(w * t), -4 * w**2 * np.cos(2 * w * t)])
    parameters = np.linspace(0.5, 1.0, model.parameter_count)
    exact = model.inverse_dynamics(q, dq, ddq, parameters)
    truth = model.base_parameters().values(parameters)
    mixing = np.array([[0.5, 0.0], [0.45, 0.1]])
    scores = []
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(size=q.shape) @ mixing.T
        average = average_periods(Recording(t=t, q=q, torque=exact + noise), period=2.0, harmonics=2)
        information = sy.Information.from_samples(model, average.samples, average.covariance)
        R = information.reduced(None).R
        rest = R @ (sy.least_squares(information).base - truth)
        scores.append(rest @ rest / len(truth))
    # With the right covariance the whitened error has unit variance; there is no other scale.
    assert np.mean(scores) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize(
    ("options", "phrase"),
    [
        ({"period": 4.0}, "hold 1 whole periods"),
        ({"trim": 3.0}, "trimming leaves"),
        ({"trim": 2.5, "period": 0.9}, "whole periods"),
    ],
)
def test_what_cannot_be_averaged_is_refused(options, phrase):
    with pytest.raises(InputError, match=phrase):
        average_periods(log_of(1.0, 5.9), **options)
