"""Single positions that no joint can have: they count as missing, and nothing else does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import steelyard as sy
from steelyard.recording.survey import position_jumps, without_dropouts, without_wild

ARM = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")], name="arm")
LINKS = np.tile(sy.Inertia.from_com(2.0, [-0.1, 0.0, 0.0], 0.02 * np.eye(3)).parameters, 2)


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.1, 1.0, 10.0])
def test_wild_readings_do_not_move_the_estimate(size: float, tmp_path: Path) -> None:
    """Five of 1 rad moved it by 10 standard errors, and by 10 rad the log was said to be too short."""
    model = sy.Model(ARM)
    t, pace, random = np.arange(20000)[:, None] / 1000.0, np.array([2.0, 3.1]), np.random.default_rng(1)
    q, dq, ddq = np.sin(pace * t), pace * np.cos(pace * t), -(pace**2) * np.sin(pace * t)
    torque = model.inverse_dynamics(q, dq, ddq, LINKS) + 0.2 * random.normal(size=q.shape)
    q[random.integers(10, len(q) - 10, 5), random.integers(0, 2, 5)] += size
    path = tmp_path / "log.csv"
    table = np.hstack([t, q, torque])
    np.savetxt(path, table, delimiter=",", header="t,q1,q2,tau1,tau2", comments="", fmt="%.9g")
    recording = sy.Recording.read(path, joints=2)
    assert "5 positions are missing, or too far from those before and after" in " ".join(recording.remarks)
    found = sy.least_squares(sy.Information.from_samples(model, recording.process(cutoff=10.0)))
    away = (found.base - model.base_parameters().values(LINKS)) / found.standard_error
    assert np.all(np.abs(away) < 3.5)
    if size == 10.0:
        result = sy.identify(model, path)
        assert any("5 positions are missing, or too far from those before and after" in one for one in result.remarks)


@pytest.mark.parametrize(
    "q",
    [
        np.sin(np.arange(500) / 5.0),  # 20 samples a period
        np.round(np.sin(np.arange(3000) / 500.0) / 0.04) * 0.04,  # 157 counts a turn
        np.where(np.arange(500) < 250, 0.0, 1.0),  # an encoder that slips
        np.random.default_rng(1).normal(size=500),
        np.minimum(2.0 * np.arange(500) / 100.0, 3.0),  # an arm that meets a wall
    ],
)
def test_what_moves_or_slips_is_not_wild(q: np.ndarray) -> None:
    assert without_wild(np.arange(len(q)) / 100.0, q[:, None]).tolist() == q[:, None].tolist()


def test_an_encoder_that_slips_by_little_is_seen_where_rows_are_close() -> None:
    """The acceleration that the step would be is computed by hand; what joints do in truth is none."""
    random = np.random.default_rng(4)
    for rate, slip in ((200.0, 0.05), (1000.0, 0.035), (100.0, 0.15)):
        t = np.arange(0.0, 20.0, 1.0 / rate)
        angle = np.sin(2.0 * t) + 0.4 * np.sin(7.0 * t) + 2e-5 * random.normal(size=t.size)
        assert slip * rate**2 > 1000.0
        angle[1234:] += slip
        assert [rows.tolist() for rows in position_jumps(t, angle[:, None])] == [[1234]]
    t = np.arange(0.0, 20.0, 0.005)
    coarse = 0.04 * np.round(np.sin(2.0 * t) / 0.04)  # of an encoder of 157 counts
    stopped = np.where(t < 9.0, 8.0 * t, 72.0)  # at full speed against a wall
    slow = np.arange(0.0, 100.0, 0.1)
    burst = np.zeros(slow.size)
    burst[500:] = 0.25  # 2.5 rad/s for a tenth of a second
    for times, angle in ((t, coarse), (t, stopped), (slow, burst)):
        assert [rows.tolist() for rows in position_jumps(times, angle[:, None])] == [[]]


def test_torques_that_messages_lost_are_left_out(tmp_path: Path) -> None:
    """A zero in one row of twenty made torques 5 % too small, and nothing was said."""
    model = sy.Model(ARM)
    t, pace, random = np.arange(20000)[:, None] / 1000.0, np.array([2.0, 3.1]), np.random.default_rng(1)
    q, dq, ddq = np.sin(pace * t), pace * np.cos(pace * t), -(pace**2) * np.sin(pace * t)
    torque = model.inverse_dynamics(q, dq, ddq, LINKS) + 0.02 * random.normal(size=q.shape)
    lost = random.random(q.shape) < 0.05
    received = np.where(lost, 0.0, torque)
    expected = lost & (np.abs(torque) > 1.0)
    recording = sy.Recording.read({"t": t[:, 0], "q": q, "tau": received}, joints=2)
    assert recording.torque_missing is not None
    assert np.mean(recording.torque_missing[expected]) > 0.8  # beside another one it is not sure
    assert not recording.torque_missing[~lost].any()
    assert "or zero for a moment among torques that are not" in recording.remarks[0]
    found = sy.least_squares(sy.Information.from_samples(model, recording.process(cutoff=10.0)))
    true = model.base_parameters().values(LINKS)
    np.testing.assert_allclose(found.base, true, atol=0.015 * np.abs(true).max())
    before = sy.Samples(q=q, dq=dq, ddq=ddq, torque=received)
    spoiled = sy.least_squares(sy.Information.from_samples(model, before)).base
    assert np.abs(spoiled - true).max() > 0.045 * np.abs(true).max()


@pytest.mark.parametrize(
    "torque",
    [
        np.sin(np.arange(500) / 5.0) * (np.arange(500) % 5 > 0),  # a fifth of the rows, as where a drive is pulsed
        np.round(3.0 * np.sin(np.arange(3000) / 300.0) + 0.3 * np.random.default_rng(1).normal(size=3000)),  # coarse
        np.where(np.arange(500) % 50 < 10, 0.0, 5.0),  # a drive that is off for longer
        np.where(np.arange(500) % 17 == 3, 0.0, np.where(np.arange(500) % 34 < 4, 3.0, -3.0)),  # one that turns around
    ],
)
def test_torques_that_are_zero_by_nature_are_there(torque: np.ndarray) -> None:
    assert without_dropouts(torque[:, None])[:, 0].tolist() == torque.tolist()
