"""Positions that were logged modulo a turn."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.recording.survey import turned_on

T = np.arange(0.0, 12.0, 0.004)
ANGLE = np.column_stack([9.0 * np.sin(0.9 * T), 2.0 * np.cos(1.3 * T)])


def test_what_never_was_modulo_a_turn_is_found_again():
    random = np.random.default_rng(1)
    noisy = ANGLE + 5e-2 * random.normal(size=ANGLE.shape)  # which goes to and fro at the seam
    found, jumps = turned_on(np.mod(noisy, 2 * np.pi))
    turns = (found - noisy) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.ones((len(T), 1)) * np.round(turns[0]), atol=1e-12)
    assert jumps[0] > 20
    assert jumps[1] > 0


def test_missing_rows_do_not_hide_a_jump():
    wrapped = np.mod(ANGLE[:, :1], 2 * np.pi)
    wrapped[1::7] = np.nan
    found, _ = turned_on(wrapped)
    there = np.isfinite(found)
    turns = (found - ANGLE[:, :1])[there] / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns[0]), atol=1e-12)


@pytest.mark.parametrize(
    "q", [ANGLE, 40.0 * ANGLE, np.cumsum(np.full((50, 1), 6.3), axis=0), 0.04 * np.arange(300.0)[:, None] ** 2]
)
def test_what_does_not_jump_stays(q):
    """Also motors in front of gears, whose every step is large."""
    found, jumps = turned_on(q)
    assert found is q
    assert not any(jumps)


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_a_log_is_read_as_one_that_counts_its_turns(unit, tmp_path):
    size = 360.0 if unit == "deg" else 2 * np.pi
    wrapped = np.mod(ANGLE / (2 * np.pi), 1.0) * size
    np.savetxt(
        tmp_path / "log.csv",
        np.column_stack([T, wrapped, ANGLE]),
        delimiter=",",
        header=f"t,q1_{unit},q2_{unit},tau1,tau2",
        comments="",
    )
    recording = sy.Recording.read(tmp_path / "log.csv", joints=2)
    np.testing.assert_allclose(np.diff(recording.q, axis=0), np.diff(ANGLE, axis=0), atol=1e-9)
    assert any("joint 1" in remark and "modulo a turn" in remark for remark in recording.remarks)
    whole = recording.process(cutoff=5.0)
    np.testing.assert_allclose(whole.dq[500:-500, 0], 8.1 * np.cos(0.9 * whole.t[500:-500]), atol=2e-2)


def test_damaged_numbers_are_no_turns() -> None:
    """A damaged file had a position of -1.8e308 between sound ones, so that their difference was infinite."""
    q = np.linspace(0.0, 1.0, 50)[:, None]
    q[20], q[30] = 1.7e308, -1.7e308
    found, jumps = turned_on(q)
    assert jumps == (0,)
    np.testing.assert_array_equal(found, q)


@pytest.mark.parametrize("low", [0.0, -180.0])
def test_degrees_modulo_a_turn_are_told_and_the_line_mends_them(low, tmp_path):
    """They were said to be of an encoder that slips, and to leave too few rows: a longer motion was asked for."""
    degrees = np.mod(np.degrees(ANGLE) - low, 360.0) + low
    path = tmp_path / "log.csv"
    table = np.column_stack([T, degrees, np.cos(T), np.sin(T)])
    np.savetxt(path, table, delimiter=",", header="t,q1,q2,tau1,tau2", comments="", fmt="%.9g")
    with pytest.raises(
        sy.InputError, match=r"'q1' jumps by 360 \d+ times .* state `position_unit = \"deg\"` in \[log\]"
    ):
        sy.Recording.read(path, joints=2)
    found = sy.Recording.read(path, {"position_unit": "deg"}, joints=2)
    turns = (found.q - ANGLE) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.ones((len(T), 1)) * np.round(turns[0]), atol=1e-6)
    rail = np.column_stack([T, np.mod(np.degrees(ANGLE), 360.0), np.cos(T), np.sin(T)])  # of motors, by a matrix
    matrix = {"position_matrix": [["pi/180", 0], [0, "pi/180"]]}
    np.savetxt(path, rail, delimiter=",", header="t,q1,q2,tau1,tau2", comments="", fmt="%.9g")
    assert sy.Recording.read(path, matrix, joints=2).q.shape == ANGLE.shape


def test_positions_a_whole_turn_away_are_within_limits():
    """An encoder that counts from 0 to a turn has a joint of +-1 rad go up to 6.28; its zero was to be checked."""
    angle = np.sin(ANGLE) + 2 * np.pi * np.array([1, -2])
    log = sy.Recording(t=T, q=angle, torque=np.column_stack([np.cos(T), np.sin(T)]))
    wide, fast = np.array([1.1, 1.1]), np.array([99.0, 99.0])
    assert log.check_against(-wide, wide, fast) == ()
    told = log.check_against([-1.1, -0.5], [1.1, 0.5], fast)
    assert len(told) == 1
    assert "joint 2" in told[0]
