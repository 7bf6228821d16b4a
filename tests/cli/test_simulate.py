"""``steelyard simulate`` on files."""

import json

import numpy as np
import polars
import pytest

import steelyard as sy
from steelyard.excitation import FourierTrajectory, save_trajectory
from steelyard.identification.wam import robot_toml


@pytest.fixture
def place(place):
    """The first joint ends at 1 rad."""
    urdf = (place / "pair.urdf").read_text()
    (place / "pair.urdf").write_text(urdf.replace('lower="-3" upper="3"', 'lower="-1" upper="1"', 1))
    return place


def test_a_fall_leaves_samples_a_record_and_a_page(place, run):
    out = place / "out"
    code, text, _ = run(
        "simulate", place / "pair.urdf", "-o", out, "--duration", 0.5, "--initial", "0,0.5", "--rate", 100
    )
    assert code == 0
    assert "finished at 0.5 s" in text
    assert sorted(p.name for p in out.iterdir()) == ["simulation.csv", "simulation.html", "simulation.json"]
    frame = polars.read_csv(out / "simulation.csv")
    assert len(frame) == 51
    assert frame["q2"][0] == 0.5
    energy = (frame["kinetic_energy"] + frame["potential_energy"]).to_numpy()
    assert np.diff(energy).max() <= 1e-9
    record = json.loads((out / "simulation.json").read_text())
    assert record["status"] == "finished"
    assert record["options"]["initial"] == [0.0, 0.5]
    assert len(record["inputs"][0]["sha256"]) == 64
    page = (out / "simulation.html").read_text()
    assert "finished at 0.5 s" in page
    assert "shoulder" in page
    assert "http://" not in page.split("<script>")[0]


def test_limits_that_are_zero_in_the_description_keep_no_robot_from_falling(place, run):
    zeros = (place / "pair.urdf").read_text().replace('lower="-3" upper="3"', 'lower="0" upper="0"')
    (place / "zeros.urdf").write_text(zeros)
    code, _, err = run("simulate", place / "zeros.urdf", "-o", place / "out", "--duration", 0.1)
    assert code == 0, err


def test_torques_of_a_file_and_limits(place, run):
    t = np.arange(100) / 100
    (place / "torque.csv").write_text("t,tau1,tau2\n" + "\n".join(f"{a},{-5.0},{0.3 * np.sin(9 * a)}" for a in t))
    code, text, _ = run("simulate", place / "pair.urdf", "-o", place / "out", "--torque", place / "torque.csv")
    assert code == 0
    frame = polars.read_csv(place / "out" / "simulation.csv")
    assert len(frame) == 991  # 100 Hz are sampled at 1 kHz
    held = np.repeat(0.3 * np.sin(9 * t), 10)[:991]
    np.testing.assert_allclose(frame["tau2"].to_numpy(), held, atol=1e-12)
    assert "Note: each row's torques are held until the next, for 0.01 s" in text
    assert "the table" not in text
    code, text, _ = run(
        "simulate", place / "pair.urdf", "-o", place / "out", "--torque", place / "torque.csv", "--stop-at-limits"
    )
    assert code == 0
    assert "event at" in text
    assert "joint 'shoulder' passed its upper limit 1" in text


@pytest.mark.slow
def test_a_slow_table_that_starts_late_and_ends_early(place, run):
    rows = [(2.0, -1.0), (2.5, 3.0), (3.0, -2.0), (3.5, 1.0)]
    (place / "torque.csv").write_text("t,tau1,tau2\n" + "\n".join(f"{t},{x},0" for t, x in rows))
    out, options = place / "out", ["--torque", place / "torque.csv", "--duration", 1.6]
    code, text, _ = run("simulate", place / "pair.urdf", "-o", out, *options)
    assert code == 0
    assert "Note: the table's first time, 2 s, is 0 s of the simulation." in text
    assert "Note: the table ends after 1.5 s; the torques of its last row are held from there." in text
    frame = polars.read_csv(out / "simulation.csv")
    assert len(frame) == 1601
    t = frame["t"].to_numpy()
    given = np.array([x for _, x in rows])
    np.testing.assert_array_equal(frame["tau1"].to_numpy(), given[np.clip((t + 1e-9) // 0.5, 0, 3).astype(int)])
    assert len(json.loads((out / "simulation.json").read_text())["options"]["notes"]) == 3
    for rate, count in ((50, 81), (2, 4), (1, 2), (2000, 3201)):
        assert run("simulate", place / "pair.urdf", "-o", out, *options, "--rate", rate)[0] == 0
        assert len(polars.read_csv(out / "simulation.csv")) == count
    code, _, error = run("simulate", place / "pair.urdf", "-o", out, *options, "--rate", 3)
    assert code == 2
    assert "--rate must be that of the torques, 2 Hz, times or divided by a whole number, got 3 Hz." in error


def test_a_start_beyond_a_limit_ends_there(place, run):
    out = place / "out"
    code, text, _ = run("simulate", place / "pair.urdf", "-o", out, "--initial", "1.5,0", "--stop-at-limits")
    assert code == 0
    assert "event at 0 s: joint 'shoulder' passed its upper limit 1 at 0 s, where it starts" in text
    frame = polars.read_csv(out / "simulation.csv")
    assert frame["q1"].to_list() == [1.5]


@pytest.mark.slow
def test_a_trajectory_is_followed(place, run):
    trajectory = FourierTrajectory(
        a=np.array([[0.3, -0.2], [0.5, 0.1]]), b=np.array([[0.1, 0.2], [-0.1, 0.3]]), center=np.zeros(2), frequency=0.5
    )
    trajectory.save(place / "motion.json")
    code, text, _ = run("simulate", place / "pair.urdf", "-o", place / "out", "--follow", place / "motion.json")
    assert code == 0
    frame = polars.read_csv(place / "out" / "simulation.csv")
    wanted = trajectory.motion(frame["t"].to_numpy())[0]
    off = np.abs(frame.select("q1", "q2").to_numpy() - wanted).max()
    assert off < 1.5e-3  # friction near rest
    assert f"Note: the robot comes off the trajectory by up to {off:.3g} rad." in text
    far = ("--initial", "0.9,-0.9")  # to get there takes a while
    _, text, _ = run("simulate", place / "pair.urdf", "-o", place / "out", "--follow", place / "motion.json", *far)
    assert "the trajectory" not in text


@pytest.mark.parametrize(("friction", "follows"), [(0.5, True), (50.0, False)])
def test_a_joint_that_friction_keeps_from_the_trajectory_is_told(place, run, friction, follows):
    """A wrist of 0.01 kg m² about its axis: 0.5 N·m change its acceleration by 50 rad/s² where it turns."""
    (place / "wrist.urdf").write_text(
        '<robot name="wrist"><link name="base"/><link name="hand"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>'
        '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="roll" type="continuous"><parent link="base"/><child link="hand"/><axis xyz="0 0 1"/>'
        f'<dynamics damping="0" friction="{friction}"/></joint></robot>'
    )
    trajectory = FourierTrajectory(a=[[0.8]], b=[[0.0]], center=[0.0], frequency=0.5)
    trajectory.save(place / "roll.json")
    code, text, _ = run("simulate", place / "wrist.urdf", "-o", place / "out", "--follow", place / "roll.json")
    assert code == 0
    frame = polars.read_csv(place / "out" / "simulation.csv")
    off = np.abs(frame["q1"].to_numpy() - trajectory.motion(frame["t"].to_numpy())[0][:, 0]).max()
    said = f"this is not the motion of the trajectory, off which come roll by {off:.3g} rad"
    assert (said not in text) == follows
    assert (off < 0.05) == follows


def test_torques_that_no_drive_gives_are_told(place, run):
    """The torque that holds an arm against gravity, by its lever, beyond an effort of 1 N·m."""
    (place / "arm.urdf").write_text(
        '<robot name="arm"><link name="base"/><link name="rod"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>'
        '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="lift" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    hold = FourierTrajectory(a=[[0.0]], b=[[0.0]], center=[0.0], frequency=5.0)
    hold.save(place / "hold.json")
    code, text, _ = run("simulate", place / "arm.urdf", "-o", place / "out", "--follow", place / "hold.json")
    assert code == 0
    assert f"the efforts of the description are passed: lift takes {2 * 9.81 * 0.5:.4g} of 1 N·m" in text
    code, text, _ = run("simulate", place / "arm.urdf", "-o", place / "out", "--duration", 0.1)
    assert "Note" not in text


def test_a_trajectory_of_other_joints_is_not_followed(place, run):
    hold = FourierTrajectory(a=np.zeros((2, 1)), b=np.zeros((2, 1)), center=np.zeros(2), frequency=5.0)
    for suffix in ("json", "yaml"):
        path = place / f"hold.{suffix}"
        save_trajectory(hold, path, joint_names=["elbow", "shoulder"])
        code, _, error = run("simulate", place / "pair.urdf", "-o", place / "out", "--follow", path)
        assert code == 2
        assert (
            "is a motion of the joints elbow, shoulder, but those of pair are shoulder, elbow, in this order" in error
        )
        save_trajectory(hold, path, joint_names=["shoulder", "elbow"])
        assert run("simulate", place / "pair.urdf", "-o", place / "out", "--follow", path)[0] == 0


@pytest.mark.data
def test_an_impossible_estimate_diverges(place, run, wam, table_4_9):
    (place / "robot.toml").write_text(robot_toml())
    base = wam.base_parameters()
    estimate = sy.Estimate(
        method="weighted least squares",
        base_names=base.names,
        base_expressions=base.expressions,
        base=table_4_9["WLS"],
        standard_error=np.zeros(76),
        joint_names=tuple(wam.robot.joint_names),
        relative_error=0.1,
        row_count=1000,
        condition_number=100.0,
    )
    estimate.save(place / "estimate.json")
    code, text, _ = run("simulate", place / "robot.toml", place / "estimate.json", "-o", place / "out", "--duration", 6)
    assert code == 1
    assert "diverged at 0.0388" in text
    assert "not physically possible" in text
    assert json.loads((place / "out" / "simulation.json").read_text())["status"] == "diverged"


def test_bad_input_is_one_sentence_and_leaves_nothing(place, run):
    out = place / "out"
    (place / "bare.toml").write_text('[description]\nrows = [[0, 0.5, 0, "q"]]\n')
    (place / "text.csv").write_text("t,tau1,tau2\n0,a,1\n0.1,b,2\n")
    (place / "few.csv").write_text("t,tau1\n0,1\n0.1,2\n")
    (place / "uneven.csv").write_text("t,tau1,tau2\n0,1,1\n0.1,2,2\n0.5,3,3\n")
    cases = [
        (["bare.toml"], "bare: the description gives no inertia for the link 'link1'; give an estimate"),
        (["pair.urdf", "--initial", "0,x"], "--initial must be numbers with commas between"),
        (["pair.urdf", "--initial", "0"], "--initial gives 1 positions, but pair has 2 joints"),
        (["pair.urdf", "--torque", place / "text.csv"], "cannot be read as numbers"),
        (["pair.urdf", "--torque", place / "few.csv"], "has no column 'tau2'"),
        (["pair.urdf", "--torque", place / "uneven.csv"], "must increase in equal steps"),
        (["pair.urdf", "--torque", place / "none.csv"], "cannot be read"),
        (["pair.urdf", "--duration", "-1"], "duration must be a positive number"),
        (
            ["pair.urdf", "--torque", place / "few.csv", "--follow", place / "few.csv"],
            "Give either --torque or --follow",
        ),
        (["none.urdf"], "none.urdf"),
    ]
    for arguments, words in cases:
        code, _, error = run("simulate", place / arguments[0], *arguments[1:], "-o", out)
        assert code == 2, arguments
        assert words in error, error
        assert len(error.strip().splitlines()[-1]) > 20
        assert "Traceback" not in error
        assert not out.exists() or not list(out.iterdir())
