"""Units of joints that slide beside those that turn, and of joints that turn without end."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from steelyard import InputError, Recording, Robot
from steelyard.recording.survey import LogSurvey, position_jumps

SCARA = Robot.from_dh([(0, 0.4, 0.3, "q"), (0, 0.3, 0, "q"), ("pi", 0, "q", 0), (0, 0, 0.1, "q")], name="scara")
T = np.arange(0.0, 4.0, 0.01)
ANGLES = np.column_stack([np.sin(T + phase) for phase in range(4)])
STROKE = -0.1 + 0.08 * np.sin(3.0 * T)  # m
Columns = dict[str, np.ndarray]


@pytest.fixture
def write(tmp_path: Path) -> Callable[[Columns], Path]:
    def written(columns: Columns) -> Path:
        path = tmp_path / "log.csv"
        table = np.column_stack([T, *columns.values()])
        np.savetxt(path, table, delimiter=",", header=",".join(["t", *columns]), comments="", fmt="%.9g")
        return path

    return written


def as_controllers_write(position: str, torque: str) -> Columns:
    """A log in degrees and millimetres, as controllers show them."""
    shown = np.degrees(ANGLES)
    shown[:, 2] = 1e3 * STROKE
    columns = {position.format(i + 1): shown[:, i] for i in range(4)}
    return columns | {torque.format(i + 1): np.cos(T + i) for i in range(4)}


@pytest.mark.parametrize(("position", "torque"), [("A{}", "$TORQUE_AXIS_ACT[{}]"), ("J{}", "T{}")])
def test_who_writes_degrees_writes_millimetres_of_slides(
    position: str, torque: str, write: Callable[[Columns], Path]
) -> None:
    """As degrees the stroke of 0.16 m was 2.8 m, and a quill of 1.6 kg weighed 0.16 kg with as good a prediction."""
    recording = Recording.read(write(as_controllers_write(position, torque)), joints=SCARA)
    np.testing.assert_allclose(recording.q[:, 2], STROKE, atol=1e-9)
    np.testing.assert_allclose(recording.q[:, :2], ANGLES[:, :2], atol=1e-8)
    assert recording.layout is not None
    assert recording.layout.units["position"] == ("deg", "deg", "mm", "deg")
    assert recording.layout.units["torque"] == ("N·m", "N·m", "N", "N·m")
    assert "read in deg (those of joints that slide in mm)" in recording.layout.guesses[0]


def test_radians_of_joints_that_turn_are_told_by_these_alone(write: Callable[[Columns], Path]) -> None:
    """Strokes in millimetres go beyond all radians, and made degrees of the others."""
    columns = as_controllers_write("J{}", "T{}")
    columns |= {f"J{i + 1}": ANGLES[:, i] for i in (0, 1, 3)}
    recording = Recording.read(write(columns), {"position_unit": ["rad", "rad", "mm", "rad"]}, joints=SCARA)
    np.testing.assert_allclose(recording.q[:, 0], ANGLES[:, 0], atol=1e-8)
    guessed = Recording.read(write(columns), joints=SCARA)
    np.testing.assert_allclose(guessed.q[:, 0], ANGLES[:, 0], atol=1e-8)


def test_degrees_of_a_slide_and_millimetres_of_an_angle_are_refused(write: Callable[[Columns], Path]) -> None:
    plain = {f"q{i + 1}": ANGLES[:, i] for i in range(4)} | {f"tau{i + 1}": np.cos(T + i) for i in range(4)}
    named = {(f"{name}_deg" if name[0] == "q" else name): values for name, values in plain.items()}
    with pytest.raises(InputError, match=r"'q3_deg' of the joint joint3, which slides, is in deg; state its own"):
        Recording.read(write(named), joints=SCARA)
    with pytest.raises(InputError, match=r"joint1, which turns, is in mm; .*position_unit = \[\"deg\", \"rad\", \"m\""):
        Recording.read(write(plain), {"position_unit": ["mm", "rad", "m", "rad"]}, joints=SCARA)
    assert Recording.read(write(plain), joints=SCARA).layout is not None


def test_a_table_that_turns_without_end_is_not_taken_for_degrees() -> None:
    """The doctor told its radians as degrees, and measured the rest in these."""
    t = np.arange(0.0, 60.0, 0.01)
    turning = 2.2 * t + np.sin(t)  # 21 turns
    for q in (turning, (turning + np.pi) % (2.0 * np.pi) - np.pi):
        log = Recording(t=t, q=np.column_stack([q, np.sin(t)]), torque=np.column_stack([np.cos(t), np.sin(t)]))
        assert LogSurvey.of(log).unit_remarks() == ()
    for q in (np.degrees(1.5 * np.sin(t)), 100.0 * np.sin(t)):  # in degrees, and in front of a gear
        log = Recording(t=t, q=np.column_stack([q, np.sin(t)]), torque=np.column_stack([np.cos(t), np.sin(t)]))
        assert "many turns" in " ".join(LogSurvey.of(log).unit_remarks())


def test_millimetres_of_slides_are_told_as_such(write: Callable[[Columns], Path]) -> None:
    """Told as many turns, degrees were advised for a slide, and the log looked as if in other torques then."""
    columns = as_controllers_write("q{}", "tau{}")
    (remark,) = LogSurvey.of(Recording.read(write(columns), joints=SCARA)).unit_remarks()
    assert "many turns of a joint (joint 'joint1', joint 'joint2', joint 'joint4'; the farthest" in remark
    assert "farther than joints slide (joint 'joint3'; the farthest from -1" in remark
    assert '`position_unit = ["deg", "deg", "mm", "deg"]` in [log]' in remark
    columns |= {f"q{i + 1}": ANGLES[:, i] for i in (0, 1, 3)}
    (remark,) = LogSurvey.of(Recording.read(write(columns), joints=SCARA)).unit_remarks()
    assert remark.startswith("Positions go farther than joints slide (joint 'joint3'")
    assert 'in millimetres (`position_unit = "mm"` in [log]), or in a unit of their own' in remark


def test_a_slide_in_millimetres_does_not_jump() -> None:
    """What a joint does to break loose is a jump in no unit; in millimetres it passed all that a joint moves in m."""
    t = np.arange(0.0, 30.0, 0.004)
    loose = 0.3 * sum(np.exp(-(((t - at) / 0.012) ** 2)) for at in np.arange(1.0, 30.0, 2.0))
    metres = np.cumsum(0.5 * np.sin(0.5 * np.pi * t) + loose) * 0.004
    assert [len(rows) for rows in position_jumps(t, metres[:, None])] == [0]
    assert [len(rows) for rows in position_jumps(t, 1e3 * metres[:, None])] == [0]
    metres[3000:] += 0.2
    assert [rows.tolist() for rows in position_jumps(t, 1e3 * metres[:, None])] == [[3000]]
