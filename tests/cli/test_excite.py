"""``steelyard excite``: what it writes, prints and refuses."""

import json

import numpy as np
import pytest

import steelyard as sy

from .conftest import URDF

QUICK = ("--period", 4, "--harmonics", 2, "--starts", 1)


def test_a_robot_file_is_enough(run, place):
    code, out, err = run("excite", place / "robot.toml", "-o", place / "out", *QUICK)
    assert code == 0, err
    assert sorted(p.name for p in (place / "out").iterdir()) == [
        "excite.html", "excite.json", "trajectory.csv", "trajectory.json", "trajectory.parquet", "trajectory.yaml",
    ]  # fmt: skip
    assert "every limit above is kept at 1 kHz" in out
    assert "torque" in out
    assert "gives no numbers" not in out  # far from its limits friction does not matter
    record = json.loads((place / "out" / "excite.json").read_text())
    assert (record["format"], record["criterion"], record["seed"], record["starts"]) == (
        "steelyard-excitation-1", "condition", 0, 1,
    )  # fmt: skip
    assert out.splitlines()[0] == " ".join(record["unchecked"])
    assert out.startswith("Self-collision was NOT checked: the description has no collision geometry; add <collision>")
    assert "Floor and table were NOT checked: " in out.splitlines()[0]
    assert out.count("NOT checked") == 2
    assert min(margin["margin"] for margin in record["margins"]) >= 0.0
    _, q, dq, ddq = sy.load_trajectory(place / "out" / "trajectory.json").sample(1000.0)
    assert np.abs(q).max() <= 3.0
    assert np.abs(dq).max() <= 5.0
    model = sy.Model.load(place / "robot.toml")
    torque = model.inverse_dynamics(q, dq, ddq, np.nan_to_num(model.robot.parameters))
    assert np.abs(torque).max() <= 50.0
    assert (place / "out" / "trajectory.yaml").read_text().count("positions") > 100


@pytest.mark.slow
def test_limits_and_prior_information(run, place):
    (place / "limits.toml").write_text("acceleration = 12\n[velocity]\nelbow = 1.0\n")
    assert run("excite", place / "robot.toml", "-o", place / "one", *QUICK)[0] == 0
    code, out, err = run(
        "excite", place / "robot.toml", "--limits", place / "limits.toml", "-o", place / "two", *QUICK,
        "--prior-information", place / "one" / "trajectory.json", "--criterion", "a", "--subset", "elbow",
    )  # fmt: skip
    assert code == 0, err
    assert "together with the prior information" in out
    _, _, dq, ddq = sy.load_trajectory(place / "two" / "trajectory.csv").sample(1000.0)
    assert np.abs(dq[:, 1]).max() <= 1.0
    assert np.abs(ddq).max() <= 12.0
    record = json.loads((place / "two" / "excite.json").read_text())
    assert record["limits"]["velocity"] == {"shoulder": 5.0, "elbow": 1.0}


def test_a_motion_that_shows_nothing_is_told_in_the_first_line_and_exits_with_3(run, place):
    (place / "limits.toml").write_text("velocity = 0.002\nacceleration = 0.01\nupper = 3.5\n")
    code, out, _ = run("excite", place / "robot.toml", "--limits", place / "limits.toml", "-o", place / "out", *QUICK)
    assert code == 3
    assert "Some limits are wider than those of the description: upper of shoulder (3.5, there 3)" in out
    first = out.splitlines()[0]
    assert "cannot identify what was asked: with torque noise of 1% the standard deviations of " in first
    assert "try wider limits of velocity, which the motion uses up, a period longer than 4 s, or fewer terms" in first
    record = json.loads((place / "out" / "excite.json").read_text())
    assert not record["identifies"]
    assert record["unidentifiable"]
    assert record["remarks"][0] in first


@pytest.mark.slow
def test_model_lead_and_start_are_told(run, place):
    code, out, err = run("excite", place / "pair.urdf", "-o", place / "out", *QUICK)
    assert code == 0, err
    record = json.loads((place / "out" / "excite.json").read_text())
    model = sy.Model.load(place / "pair.urdf")
    assert f"viscous, coulomb, offset; {model.parameter_count} parameters, {record['base_parameters']} base" in out
    assert (record["terms"], record["ramp_time"], record["duration"]) == (["viscous", "coulomb", "offset"], 2.0, 8.0)
    assert "motion of 8 s, 2 s of it to start and as much to stop" in out
    first = np.loadtxt(place / "out" / "trajectory.csv", delimiter=",", skiprows=1, max_rows=1)
    assert list(record["start"].values()) == pytest.approx(first[1:3])
    assert f"Start at shoulder {first[1]:.4f}, elbow {first[2]:.4f}" in out


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("velocity = ", "limits.toml: not valid TOML"),
        ("speed = 1", "limits.toml: 'speed' is no limit"),
        ("velocity = [1]", "limits.toml: velocity has 1 values, but there are 2 joints: shoulder, elbow"),
        ("velocity = {wrist = 1}", "limits.toml: velocity names a joint 'wrist'"),
        ("[tables]\nheight = 1", "limits.toml: 'tables' is no table of geometry"),
        ("torque = 0.1", "cannot even rest within its limits: no configuration was found that keeps torque, shoulder"),
    ],
)
def test_bad_limits_end_with_one_sentence_and_no_files(run, place, text, message):
    (place / "limits.toml").write_text(text)
    code, out, err = run("excite", place / "robot.toml", "--limits", place / "limits.toml", "-o", place / "out", *QUICK)
    assert (code, out) == (2, "")
    lines = [line for line in err.splitlines() if line.startswith("steelyard:")]
    assert len(lines) == 1
    assert message in lines[0]
    assert not (place / "out").exists()


WEAK = URDF.replace('effort="50"', 'effort="8"', 1).replace('<dynamics damping="0.1" friction="0.2"/>', "")


def test_torques_that_friction_may_drive_beyond_their_limits_are_told(run, place):
    (place / "weak.urdf").write_text(WEAK)
    code, out, err = run("excite", place / "weak.urdf", "-o", place / "out", *QUICK)
    assert code == 0, err
    told = " ".join(out.split())
    assert "the description gives no numbers (viscous of all joints; coulomb of all joints): torque, shoulder" in told
    # With such friction the torque does pass the limit.
    robot = sy.Robot.from_urdf(place / "weak.urdf").with_terms(sy.Coulomb())
    whole, (_, q, dq, ddq) = sy.Model(robot), sy.load_trajectory(place / "out" / "trajectory.json").sample(1000.0)
    parameters = np.array(robot.parameters)
    parameters[np.isnan(parameters)] = 0.0
    assert np.abs(whole.inverse_dynamics(q, dq, ddq, parameters)[:, 0]).max() <= 8.0
    parameters[list(whole.parameter_names).index("Fcj1")] = 3.0
    assert np.abs(whole.inverse_dynamics(q, dq, ddq, parameters)[:, 0]).max() > 8.0


def test_limits_that_are_missing_are_named_for_all_joints_and_the_advice_works(run, place):
    limit = '<limit lower="-3" upper="3" effort="50" velocity="5"/>'
    free = URDF.replace('type="revolute"', 'type="continuous"').replace(limit, "")
    (place / "free.urdf").write_text(free)
    code, _, err = run("excite", place / "free.urdf", "-o", place / "out", *QUICK)
    assert code == 2
    assert "Nothing limits the position, the velocity or the acceleration of shoulder, elbow" in err
    (place / "limits.toml").write_text(err.partition('the line "')[2].partition('"')[0] + "\n")
    code, out, err = run("excite", place / "free.urdf", "-o", place / "out", "--limits", place / "limits.toml", *QUICK)
    assert code == 0, err
    assert "No limit was given for the acceleration of all joints" in out
    assert "and the torque of all joints, which reaches " in " ".join(out.split())


@pytest.mark.slow
def test_a_payload_of_a_robot_with_two_hands_is_named_by_its_link(run, place):
    hand = '<link name="{0}"/><joint name="{0}" type="revolute"><parent link="upper"/><child link="{0}"/>'
    hand = hand.format("other") + '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="9" velocity="2"/></joint>'
    (place / "hands.urdf").write_text(URDF.replace("</robot>", f"{hand}</robot>"))
    code, _, err = run("excite", place / "hands.urdf", "-o", place / "out", "--subset", "payload", *QUICK)
    assert code == 2
    assert "several last links, fore, other; name the one that carries the payload in place of the word payload" in err
    code, _, err = run("excite", place / "hands.urdf", "-o", place / "out", "--subset", "fore", *QUICK)
    assert code in (0, 3), err


def test_a_motion_that_is_too_slow_is_to_be_faster(run, place):
    """Nothing but positions is used up, so that a longer period would show less still."""
    (place / "limits.toml").write_text("lower = -0.002\nupper = 0.002\n")
    code, out, _ = run("excite", place / "robot.toml", "-o", place / "out", "--limits", place / "limits.toml", *QUICK)
    assert code == 3
    assert "wider limits of position, which the motion uses up, a period shorter than 4 s" in out.splitlines()[0]
