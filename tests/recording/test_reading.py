"""Reading logs: formats, units, matrices, header rules."""

from collections.abc import Callable
from math import pi
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from steelyard.errors import InputError
from steelyard.recording import LogColumns, Recording

Columns = dict[str, np.ndarray]


def assert_is_log(recording: Recording, log: Columns) -> None:
    np.testing.assert_array_equal(recording.t, log["t"])
    np.testing.assert_array_equal(recording.q, np.column_stack([log["q1"], log["q2"]]))
    np.testing.assert_array_equal(recording.torque, np.column_stack([log["tau1"], log["tau2"]]))
    assert recording.velocity is not None
    np.testing.assert_array_equal(recording.velocity, np.column_stack([log["dq1"], log["dq2"]]))
    assert recording.rate == pytest.approx(100.0)
    assert recording.duration == pytest.approx(2.99)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_csv(separator: str, log: Columns, write: Callable[..., Path]) -> None:
    assert_is_log(Recording.read(write(log, separator=separator)), log)


def test_csv_with_everything_unusual(log: Columns, write: Callable[..., Path]) -> None:
    path = write(log)
    lines = path.read_text().splitlines()
    lines[5] = " " + lines[5].replace(",", " , ")
    lines.insert(100, "")
    lines.insert(50, "# the operator coughed")
    lines.insert(0, "# robot 7")
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join([*lines, "", ""]).encode())
    assert_is_log(Recording.read(path), log)


def test_line_numbers_count_comments(log: Columns, write: Callable[..., Path]) -> None:
    path = write(log)
    lines = ["# one", "", *path.read_text().splitlines()]
    lines.insert(10, "# two")
    lines[20] = lines[20].replace(lines[20].split(",")[1], "bad")
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match="line 21, holds 'bad'"):
        Recording.read(path)


def test_decimal_comma(log: Columns, write: Callable[..., Path]) -> None:
    path = write(log, separator=";")
    path.write_text(path.read_text().replace(".", ","))
    assert_is_log(Recording.read(path), log)


def test_header_of_savetxt(log: Columns, tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    np.savetxt(path, np.column_stack(list(log.values())), delimiter=",", header=",".join(log), fmt="%.17g")
    assert_is_log(Recording.read(path), log)


def test_parquet(log: Columns, tmp_path: Path) -> None:
    pl.DataFrame(log).write_parquet(tmp_path / "log.parquet")
    assert_is_log(Recording.read(tmp_path / "log.parquet"), log)


def test_parquet_with_dates(log: Columns, tmp_path: Path) -> None:
    frame = pl.DataFrame(log).with_columns(t=pl.from_epoch((pl.col("t") * 1e6).round().cast(pl.Int64), time_unit="us"))
    frame.write_parquet(tmp_path / "log.parquet")
    np.testing.assert_allclose(Recording.read(tmp_path / "log.parquet").t, log["t"], atol=1e-9)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npz(save: Callable[..., None], order: str, log: Columns, tmp_path: Path) -> None:
    stacked = {
        key: np.asarray(np.column_stack([log[f"{key}1"], log[f"{key}2"]]), order=order) for key in ("q", "dq", "tau")
    }
    save(tmp_path / "log.npz", t=log["t"], note=np.array("by hand"), **stacked)
    assert_is_log(Recording.read(tmp_path / "log.npz"), log)


def test_npz_of_columns(log: Columns, tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", **log)
    assert_is_log(Recording.read(tmp_path / "log.npz"), log)


def test_files_side_by_side(log: Columns, write: Callable[..., Path]) -> None:
    motion = write({name: log[name] for name in ("t", "q1", "q2", "dq1", "dq2")}, "motion.csv")
    torque = write({name: log[name] for name in ("t", "tau1", "tau2")}, "torque.csv")
    assert_is_log(Recording.read([motion, torque]), log)
    assert_is_log(Recording.read(f"{motion}+{torque}"), log)


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet"])
def test_saved_recordings_read_back(suffix: str, log: Columns, write: Callable[..., Path], tmp_path: Path) -> None:
    saved = Recording.read(write(log)).save(tmp_path / f"again{suffix}")
    assert_is_log(Recording.read(saved), log)
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"again{suffix}", "log.csv"]


def test_saving_refuses_other_suffixes(log: Columns, write: Callable[..., Path], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"suffix '\.mat'"):
        Recording.read(write(log)).save(tmp_path / "log.mat")


@pytest.mark.parametrize(
    ("names", "joints"),
    [
        (("Time", "Q_1", "Q_2", "TAU_1", "TAU_2"), None),
        (("timestamp", "pos0", "pos1", "effort0", "effort1"), 2),
        (("t", "position[1]", "position[2]", "torque[1]", "torque[2]"), 2),
        (("t", "elbow_pos", "wrist_pos", "elbow_torque", "wrist_torque"), ("elbow", "wrist")),
        (("t", "elbow", "wrist", "elbow.effort", "wrist.effort"), ("elbow", "wrist")),
    ],
)
def test_header_rules(names: tuple[str, ...], joints: object, log: Columns, write: Callable[..., Path]) -> None:
    old = ("t", "q1", "q2", "tau1", "tau2")
    path = write({new: log[name] for new, name in zip(names, old, strict=True)})
    recording = Recording.read(path, joints=joints)  # type: ignore[arg-type]
    np.testing.assert_array_equal(recording.q[:, 1], log["q2"])
    np.testing.assert_array_equal(recording.torque[:, 0], log["tau1"])
    assert recording.velocity is None
    assert recording.joint_names == (joints if isinstance(joints, tuple) else None)


def test_joint_names_in_patterns(log: Columns, write: Callable[..., Path]) -> None:
    path = write({"t": log["t"], "a/q": log["q1"], "b/q": log["q2"], "b/i": log["tau2"], "a/i": log["tau1"]})
    recording = Recording.read(path, {"position": "{name}/q", "torque": "{name}/i"}, joints=("b", "a"))
    np.testing.assert_array_equal(recording.q[:, 0], log["q2"])
    np.testing.assert_array_equal(recording.torque[:, 0], log["tau2"])


def test_units(log: Columns, write: Callable[..., Path]) -> None:
    path = write(
        {
            "time_ms": log["t"] * 1e3,
            "q1": log["q1"] * 180 / pi,
            "q2": log["q2"] * 1e3,
            "dq1": log["dq1"] * 180 / pi,
            "dq2": log["dq2"] * 1e3,
            "i1": log["tau1"] * 1e3 / -7.0,
            "i2": log["tau2"] / 3.0,
        }
    )
    section = {
        "position_unit": ["deg", "mm"],
        "torque": "i{}",
        "torque_unit": ["mA", "A"],
        "gain": [7.0, 3],
        "torque_sign": [-1, 1],
    }
    recording = Recording.read(path, section)
    np.testing.assert_allclose(recording.t, log["t"], atol=1e-12)
    np.testing.assert_allclose(recording.q, np.column_stack([log["q1"], log["q2"]]), atol=1e-12)
    assert recording.velocity is not None
    np.testing.assert_allclose(recording.velocity[:, 1], log["dq2"], atol=1e-12)
    np.testing.assert_allclose(recording.torque, np.column_stack([log["tau1"], log["tau2"]]), atol=1e-12)


def test_matrices_take_motors_to_joints(log: Columns, write: Callable[..., Path]) -> None:
    # Motor 2 turns with both joints: m1 = 45 q1, m2 = 32 q1 + 32 (q2 - pi/2); the torques follow from the same power.
    path = write(
        {
            "m1": 45 * log["q1"],
            "m2": 32 * log["q1"] + 32 * (log["q2"] - pi / 2),
            "f1": (log["tau1"] - log["tau2"]) / 45,
            "f2": log["tau2"] / 32,
        }
    )
    section = {
        "rate": 100,
        "position": "m{}",
        "torque": "f{}",
        "position_matrix": [["1/45", 0], ["-1/45", "1/32"]],
        "position_offset": [0, "pi/2"],
        "torque_matrix": [[45, 32], [0, 32]],
    }
    recording = Recording.read(path, section, joints=2)
    np.testing.assert_allclose(recording.q, np.column_stack([log["q1"], log["q2"]]), atol=1e-13)
    np.testing.assert_allclose(recording.torque, np.column_stack([log["tau1"], log["tau2"]]), atol=1e-13)
    np.testing.assert_allclose(recording.t, log["t"], atol=1e-15)
    columns = LogColumns.from_dict(section)
    assert LogColumns.from_dict(columns.to_dict()) == columns
    assert columns.position_offset == (0.0, pi / 2)
    counts = LogColumns.from_dict({"position_matrix": [["2*pi/4096/101", 0], ["-pi / 2 / 3", "1e-3/2/5"]]})
    assert counts.position_matrix == ((2 * pi / (4096 * 101), 0.0), (-pi / 6, 1e-4))
    for wrong in ("2*pi/4096/", "2*pi/4096/0", "1//2", "1/2/x"):
        with pytest.raises(InputError, match=r"must be a finite number|a division by zero"):
            LogColumns.from_dict({"position_matrix": [[wrong]]})


def test_a_stated_rate_replaces_rounded_stamps(log: Columns, write: Callable[..., Path]) -> None:
    path = write({**log, "t": 5.0 + np.floor(log["t"] * 40) / 40})
    recording = Recording.read(path, {"time": "t", "rate": 100.0})
    np.testing.assert_allclose(recording.t, 5.0 + log["t"], atol=1e-12)
    assert recording.rate == 100.0


def test_velocities_can_be_left_unread(log: Columns, write: Callable[..., Path]) -> None:
    assert Recording.read(write(log), {"velocity": "none"}).velocity is None


def test_remarks_on_what_is_not_certain(log: Columns, write: Callable[..., Path]) -> None:
    held = Recording.read(write({**log, "q2": np.full(300, 0.7), "dq2": np.zeros(300)}))
    assert held.remarks == ("The position of joint 2 is 0.7 throughout: it is held, or its sensor is stuck.",)
    scaled = Recording.read(write({**log, "dq1": 1.2 * log["dq1"]}))
    assert "joint 1 changes 0.833 times as fast" in scaled.remarks[0]
    wild = Recording.read(write({**log, "dq1": np.cos(17 * log["t"])}))
    assert "joint 1 follows the derivative of its position poorly" in wild.remarks[0]
    turns = Recording.read(write({"t": log["t"], "q1": 60 * log["q1"], "tau1": log["tau1"]}))
    assert "many turns" in turns.remarks[0]


def test_limits(log: Columns, write: Callable[..., Path]) -> None:
    recording = Recording.read(write(log), joints=("elbow", "wrist"))
    wide, fast = np.array([1.0, 1.0]), np.array([3.0, 3.0])
    assert recording.check_against(-wide, wide, fast) == ()
    assert recording.check_against(-wide * np.inf, wide * np.inf, fast * np.inf) == ()
    swapped = recording.check_against([-0.55, -1.0], [0.55, 1.0], fast)
    assert len(swapped) == 1
    assert "joint 'elbow'" in swapped[0]
    assert "with joint 'wrist' in its place both would fit" in swapped[0]
    slow = recording.check_against(-wide, wide, [1.0, 3.0])
    assert "velocity limit of 1" in slow[0]
    with pytest.raises(InputError, match="2 joints but there are limits for 3"):
        recording.check_against(np.zeros(3), np.ones(3), np.ones(3))
    degrees = Recording(t=recording.t, q=np.degrees(recording.q), torque=recording.torque, source="deg.csv")
    with pytest.raises(InputError, match=r"deg.csv: the position of joint 1 goes from .* as degrees.*position_unit"):
        degrees.check_against(-wide, wide, fast)


def test_recordings_cannot_be_changed(log: Columns, write: Callable[..., Path]) -> None:
    recording = Recording.read(write(log))
    with pytest.raises(ValueError, match="read-only"):
        recording.q[0, 0] = 1.0
    assert repr(recording) == "Recording('log.csv', 300 rows x 2 joints, 2.99 s at 100 Hz, with measured velocities)"
    assert "<table>" in recording._repr_html_()
