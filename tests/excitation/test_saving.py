"""Trajectories in files: the same one from JSON, the same samples from the others."""

import json

import numpy as np
import pytest

import steelyard as sy
from steelyard.excitation import QuinticTrajectory, load_trajectory, save_trajectory
from steelyard.excitation.family import FourierFamily, QuinticFamily, SplineFamily

FAMILIES = [
    FourierFamily(2.0, 2, 0.5, 2),
    FourierFamily(2.0, 2, 0.0),
    SplineFamily(2.0, 6),
    QuinticFamily(2.0, 4),
    FourierFamily(2.0, 2, 0.3, 2, slow_time=0.5),
]


def trajectory_of(family):
    return family.trajectory(np.random.default_rng(8).normal(size=(2, family.size)))


@pytest.mark.parametrize("family", FAMILIES, ids=repr)
def test_json_gives_the_same_trajectory(family, tmp_path):
    trajectory = trajectory_of(family)
    trajectory.save(tmp_path / "motion.json")
    loaded = load_trajectory(tmp_path / "motion.json")
    assert type(loaded) is type(trajectory)
    assert loaded.duration == trajectory.duration
    t = np.linspace(-0.5, trajectory.duration + 0.5, 57)
    for ours, theirs in zip(loaded.motion(t), trajectory.motion(t), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("suffix", ["csv", "parquet", "yaml"])
@pytest.mark.parametrize("family", FAMILIES[:1] + FAMILIES[2:], ids=repr)
def test_samples_are_read_again(family, suffix, tmp_path):
    trajectory = trajectory_of(family)
    path = tmp_path / f"motion.{suffix}"
    save_trajectory(trajectory, path, rate=250.0, joint_names=["shoulder", "elbow"])
    loaded = load_trajectory(path)
    t, *motion = trajectory.sample(250.0)
    for ours, theirs in zip(loaded.motion(t), motion, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-12)
    between = t[:-1] + 0.002
    tolerance = 1e-7 if not isinstance(trajectory, QuinticTrajectory) else 1e-3  # which has steps of jerk
    np.testing.assert_allclose(loaded.motion(between)[0], trajectory.motion(between)[0], atol=tolerance)
    assert sorted(p.name for p in tmp_path.iterdir()) == [path.name]


def test_csv_is_a_log_that_recordings_read(tmp_path):
    trajectory = trajectory_of(FAMILIES[0])
    trajectory.save(tmp_path / "motion.csv")
    header = (tmp_path / "motion.csv").read_text().splitlines()[0]
    assert header == "t,q1,q2,dq1,dq2,ddq1,ddq2"


def test_yaml_is_a_joint_trajectory(tmp_path):
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    trajectory = trajectory_of(FAMILIES[2])
    save_trajectory(trajectory, tmp_path / "motion.yaml", joint_names=['a "b"', "Gelenk é"])
    message = yaml.safe_load((tmp_path / "motion.yaml").read_text(encoding="utf-8"))
    assert set(message) == {"header", "joint_names", "points"}
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert message["joint_names"] == ['a "b"', "Gelenk é"]
    t, q, dq, ddq = trajectory.sample(100.0)
    assert len(message["points"]) == len(t)
    last = message["points"][151]
    assert last["time_from_start"] == {"sec": 1, "nanosec": 510000000}
    np.testing.assert_array_equal(last["positions"], q[151])
    np.testing.assert_array_equal(last["velocities"], dq[151])
    np.testing.assert_array_equal(last["accelerations"], ddq[151])


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("absent.json", None, "absent.json: cannot be read"),
        ("motion.txt", "", "got the suffix '.txt'"),
        ("motion.json", "{", "is not JSON"),
        ("motion.json", "[]", "is not a trajectory"),
        ("motion.json", json.dumps({"format": "other"}), "format is 'other', expected 'steelyard-trajectory-1'"),
        ("motion.json", json.dumps({"format": "steelyard-trajectory-1", "family": "waves"}), "family is 'waves'"),
        ("motion.json", json.dumps({"format": "steelyard-trajectory-1", "family": "spline"}), "is not a trajectory"),
        (
            "motion.json",
            json.dumps({"format": "steelyard-trajectory-1", "family": "spline", "points": [[1]], "duration": 1}),
            "motion.json: A spline trajectory needs",
        ),
        ("motion.csv", "t,q1,dq1,ddq1\n", "there are none"),
        ("motion.csv", "t,q1,dq1\n0,0,0\n1,0,0\n", "ddq1 is missing"),
        ("motion.csv", "", "cannot be read as CSV"),
        ("motion.csv", "t,q1,dq1,ddq1\n0,0,0,x\n1,0,0,0\n", "cannot be read as numbers"),
        ("motion.csv", "t,q1,dq1,ddq1\n0,0,0,0\n0,0,0,0\n", "must increase"),
        ("motion.yaml", "joint_names: []\n", "no line 'points:'"),
        ("motion.yaml", "points:\n- positions: [1]\n", "line 2 is not a point"),
        ("motion.yaml", "points:\n", "has 0 points"),
    ],
)
def test_other_files_are_refused_in_one_sentence(name, text, message, tmp_path):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(sy.InputError, match=message) as caught:
        load_trajectory(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_nothing_is_written_where_something_is_wrong(tmp_path):
    trajectory = trajectory_of(FAMILIES[0])
    with pytest.raises(sy.InputError, match="suffix"):
        trajectory.save(tmp_path / "motion.xml")
    with pytest.raises(sy.InputError, match="2 different joint names"):
        save_trajectory(trajectory, tmp_path / "motion.json", joint_names=["a", "a"])
    with pytest.raises(sy.InputError, match="rate must be positive"):
        save_trajectory(trajectory, tmp_path / "motion.csv", rate=-1.0)
    assert list(tmp_path.iterdir()) == []
