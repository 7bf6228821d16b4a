"""Joints that a log names in columns beside its numbers, as ROS's JointState does."""

from pathlib import Path

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.recording import Processing, Recording, Samples, process_chunks

T = np.arange(300) / 100
JOINTS = ("shoulder", "elbow")
# ROS sorts joints by their names, and the hand comes along.
ORDER = ("elbow", "finger", "shoulder")
Q = {"shoulder": np.sin(T), "elbow": np.cos(2 * T), "finger": 0.01 * T}


def write(folder: Path, suffix: str, order: tuple[str, ...] = ORDER, last: tuple[str, ...] = ORDER) -> Path:
    """Write a log whose last row names the joints as `last`."""
    path = folder / f"log{suffix}"
    if suffix == ".npz":
        q = np.column_stack([Q[name] for name in order])
        np.savez(path, t=T, name=np.array(order), position=q, effort=2 * q)
        return path
    import polars as pl

    labels = {f"name[{k}]": [name] * 299 + [last[k]] for k, name in enumerate(order)}
    numbers = {f"position[{k}]": Q[name] for k, name in enumerate(order)}
    efforts = {f"effort[{k}]": 2 * Q[name] for k, name in enumerate(order)}
    frame = pl.DataFrame({"time": T, **labels, **numbers, **efforts})
    frame.write_csv(path) if suffix == ".csv" else frame.write_parquet(path)
    return path


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz"])
def test_columns_are_those_of_the_joints_that_the_log_names(suffix: str, tmp_path: Path) -> None:
    path = write(tmp_path, suffix)
    log = Recording.read(path, joints=JOINTS)
    expected = np.column_stack([Q[name] for name in JOINTS])
    np.testing.assert_allclose(log.q, expected, atol=1e-15)
    np.testing.assert_allclose(log.torque, 2 * expected, atol=1e-15)
    processing = Processing(cutoff=None, trim=0.0, velocity_threshold=None)
    joined = Samples.joined(list(process_chunks(path, None, processing, 120, JOINTS)))
    np.testing.assert_allclose(joined.q, expected, atol=1e-15)


def test_columns_that_are_stated_are_taken(tmp_path: Path) -> None:
    columns = {"position": ["position[0]", "position[2]"], "torque": ["effort[0]", "effort[2]"]}
    log = Recording.read(write(tmp_path, ".csv"), columns, JOINTS)
    np.testing.assert_allclose(log.q[:, 0], Q["elbow"], atol=1e-15)


def test_a_joint_that_the_log_does_not_name_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"joints elbow, finger, shoulder, and has no 'wrist'.*`position` of \[log\]"):
        Recording.read(write(tmp_path, ".csv"), joints=("shoulder", "wrist"))


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_names_that_change_are_refused(suffix: str, tmp_path: Path) -> None:
    path = write(tmp_path, suffix, last=("shoulder", "finger", "elbow"))
    with pytest.raises(InputError, match=r"'name\[0\]' names the joint 'elbow' in some rows and 'shoulder' in others"):
        Recording.read(path, joints=JOINTS)


def test_numbers_are_no_names(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{t},1,2,{np.sin(t)},{np.cos(t)},1,{t}" for t in T]
    path.write_text("t,name1,name2,q1,q2,tau1,tau2\n" + "\n".join(rows))
    assert Recording.read(path, joints=JOINTS).q[0].tolist() == [0.0, 1.0]
