"""``steelyard excite``: what it writes, prints and refuses."""

import json

import numpy as np
import pytest

import steelyard as sy

QUICK = ("--period", 4, "--harmonics", 2, "--starts", 1)


def test_a_robot_file_is_enough(run, place):
    code, out, err = run("excite", place / "robot.toml", "-o", place / "out", *QUICK)
    assert code == 0, err
    assert sorted(p.name for p in (place / "out").iterdir()) == [
        "excite.html", "excite.json", "trajectory.csv", "trajectory.json", "trajectory.parquet", "trajectory.yaml",
    ]  # fmt: skip
    assert "every limit above is kept at 1 kHz" in out
    assert "torque" in out
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
