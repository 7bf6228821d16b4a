"""What is no motion among positions that arrive: wild readings, slips, turns; and what is one all the same."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import steelyard as sy
from steelyard.online.position_jumps import PositionJumps

Array = NDArray[np.float64]


def of(rate: float, *positions: Array) -> Array:
    """Rows of time, positions, and zero torques."""
    t = np.arange(len(positions[0])) / rate
    return np.column_stack([t, *positions, *np.zeros((len(positions), len(t)))])


def added(rows: Array, size: int, rate: float = 1000.0, rotates: bool = True) -> tuple[PositionJumps, Array, int]:
    """The positions that pass in parts of so many rows, and how often they begin anew."""
    joints = (rows.shape[1] - 1) // 2
    jumps = PositionJumps(rate, np.full(joints, rotates), 0.02)
    found = [one for k in range(0, len(rows), size) for one in jumps.add(rows[k : k + size])]
    return jumps, np.vstack([part for _, part in found]), sum(begins for begins, _ in found)


@pytest.mark.parametrize("size", [1, 7, 10, 1000])
def test_wild_readings_are_left_out_and_a_slip_begins_anew(size: int) -> None:
    t = np.arange(1000) / 1000.0
    smooth = np.column_stack([np.sin(3.0 * t), np.cos(2.0 * t)])
    q = smooth.copy()
    q[[0, 300, 301, 999], 0] += [5.0, -0.2, 40.0, 3.0]  # the very first, two in a row, the last, which may be a slip
    q[600:, 1] += 0.7
    jumps, passed, begun = added(of(1000.0, *q.T), size)
    kept = np.delete(np.arange(1000), [300, 301, 999])
    assert np.array_equal(passed[:, 0], t[kept])
    assert np.array_equal(passed[:, 1:3], q[kept])
    assert begun == 2  # after the first reading, and where the encoder slipped
    assert (jumps.counts["wild"], jumps.counts["jumps"]) == (2, 2)


@pytest.mark.parametrize("size", [1, 7, 1000])
@pytest.mark.parametrize("slip", [-0.19, 0.11, 0.15])
def test_a_slip_within_what_a_joint_may_do_in_two_samples_is_one(size: int, slip: float) -> None:
    """At 200 Hz; a single reading as far away, from which the joint comes back, is no slip."""
    t = np.arange(1000) / 200.0
    q = np.sin(2.0 * t)
    q[300] += slip
    q[600:] += slip
    jumps, passed, begun = added(of(200.0, q), size, 200.0)
    assert np.array_equal(passed[:, 1], np.delete(q, 300))
    assert begun == 1
    assert jumps.counts == {"wild": 1, "jumps": 1, "turns": 0}


@pytest.mark.parametrize(
    ("rate", "q"),
    [
        (1000.0, 300.0 * np.arange(500) / 1000.0),  # a spindle that turns when it is first seen
        (1000.0, np.round(np.sin(np.arange(3000) / 500.0) / 0.04) * 0.04),  # 157 counts a turn
        (50.0, 3.0 * np.sin(np.arange(500) / 25.0)),
        (1000.0, np.minimum(2.0 * np.arange(500) / 1000.0, 0.5)),  # an arm that meets a wall
    ],
)
def test_motions_pass_as_they_are(rate: float, q: Array) -> None:
    rows = of(rate, q)
    jumps, passed, begun = added(rows, 10, rate)
    assert np.array_equal(passed, rows)
    assert begun == 0
    assert not any(jumps.counts.values())


def test_turns_are_put_together_where_a_joint_turns() -> None:
    angle = 7.0 * np.arange(3000) / 1000.0
    rows = of(1000.0, np.mod(angle, 2.0 * np.pi))
    jumps, passed, begun = added(rows, 10)
    assert passed[:, 1] == pytest.approx(angle, abs=1e-9)
    assert (begun, jumps.counts["turns"]) == (0, 3)
    sliding, _, begun = added(rows, 10, rotates=False)
    assert (begun, sliding.counts["turns"]) == (3, 0)


def test_rows_that_others_count_pass_and_a_gap_ends_all_doubt() -> None:
    rows = of(1000.0, np.sin(np.arange(300) / 100.0))
    rows[50, 1] = np.nan
    rows[100:102, 0] = rows[99, 0]  # repeated
    rows[199, 1] += 2.0
    rows[200:, 0] += 1.0
    jumps, passed, begun = added(rows, 10)
    assert len(passed) == 299
    assert begun == 0
    assert jumps.counts == {"wild": 1, "jumps": 0, "turns": 0}


def test_five_wild_readings_in_twenty_seconds_do_not_move_the_estimate() -> None:
    """They moved it by up to 36 standard errors, without a word."""
    arm = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")])
    model = sy.Model(arm)
    links = np.tile(sy.Inertia.from_com(2.0, [-0.1, 0.0, 0.0], 0.02 * np.eye(3)).parameters, 2)
    random = np.random.default_rng(1)
    t, pace = np.arange(20000)[:, None] / 1000.0, np.array([2.0, 3.1])
    q, dq, ddq = np.sin(pace * t), pace * np.cos(pace * t), -(pace**2) * np.sin(pace * t)
    torque = model.inverse_dynamics(q, dq, ddq, links) + 0.2 * random.normal(size=q.shape)
    q[random.integers(0, len(q), 5), random.integers(0, 2, 5)] += 10.0
    estimator = sy.OnlineEstimator(model)
    estimator.update(t[:, 0], q, torque)
    truth = model.base_parameters().values(links)
    away = (estimator.intervals().mean(axis=1) - truth) / np.diff(estimator.intervals())[:, 0] * 2.0
    assert np.all(np.abs(away) < 2.0)  # in halves of intervals of 95 %
    assert estimator.stream_counts["wild"] == 5
    assert "5 samples had a position that is too far from those before and after" in " ".join(estimator.remarks)
