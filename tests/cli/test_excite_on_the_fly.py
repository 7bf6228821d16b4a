"""``steelyard excite --on-the-fly``: what it learns, writes, prints and refuses."""

import json
import re

import numpy as np
import pytest

import steelyard as sy

LIMITS = "acceleration = 8\nvelocity = 2.5\n"


@pytest.mark.slow
def test_masses_that_the_controller_is_not_told_are_learned_within_the_limits(run, place):
    (place / "limits.toml").write_text(LIMITS)
    code, out, err = run(
        "excite", place / "robot.toml", "--limits", place / "limits.toml", "--on-the-fly", "-o", place / "out"
    )
    assert code == 0, err
    assert "the controller was not told its masses" in out
    assert len(out.splitlines()) <= 25
    assert sorted(path.name for path in (place / "out").iterdir()) == [
        "estimate.json", "excite.html", "excite.json", "log.csv",
        "trajectory.csv", "trajectory.json", "trajectory.parquet", "trajectory.yaml",
    ]  # fmt: skip
    model = sy.Model.load(place / "robot.toml")
    found = sy.Estimate.load(place / "out" / "estimate.json")
    random = np.random.default_rng(5)
    motion = [random.uniform(-size, size, (300, 2)) for size in (2.5, 2.0, 6.0)]
    true = model.inverse_dynamics(*motion, np.nan_to_num(model.robot.parameters))
    error = np.linalg.norm(model.inverse_dynamics(*motion, found.parameters) - true) / np.linalg.norm(true)
    assert error < 0.04  # twice the accuracy that was asked for
    assert sy.FeasibleSet(model).contains(found.parameters)
    t, q, dq, _ = sy.load_trajectory(place / "out" / "trajectory.csv").sample(1000.0)
    assert np.abs(q).max() <= 3.0
    assert np.abs(dq).max() <= 2.5
    record = json.loads((place / "out" / "excite.json").read_text())
    assert record["reached"]
    assert record["duration"] == pytest.approx(t[-1], abs=0.02)
    errors = [step["expected_error"] for step in record["steps"]]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] <= 0.02 < errors[-2]
    log = sy.Recording.read(place / "out" / "log.csv")
    assert log.q[-1] == pytest.approx(q[-1], abs=1e-3)


@pytest.mark.slow
def test_without_any_mass_a_robot_is_drawn_and_too_little_time_exits_with_3(run, place):
    urdf = (place / "pair.urdf").read_text()
    (place / "pair.urdf").write_text(re.sub(r"<inertial>.*?</inertial>", "", urdf, flags=re.DOTALL))
    (place / "limits.toml").write_text(LIMITS)
    options = ("--on-the-fly", "--limits", place / "limits.toml", "--longest", 5, "-o", place / "out")
    code, out, err = run("excite", place / "robot.toml", *options)
    assert code == 3, err
    assert "a random one with these kinematics" in out
    assert "not reached within 5 s" in out
    # What little was learned is possible by the definition: the pseudo-inertia of every link is positive definite.
    model = sy.Model.load(place / "robot.toml")
    found = sy.Estimate.load(place / "out" / "estimate.json").parameters
    for columns in model.link_columns:
        xx, xy, xz, yy, yz, zz, x, y, z, mass = found[np.asarray(columns)]
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        first = np.array([x, y, z])
        matrix = np.block([[0.5 * np.trace(inertia) * np.eye(3) - inertia, first[:, None]], [first[None], mass]])
        assert np.linalg.eigvalsh(matrix)[0] > 0.0
    assert sy.check(sy.FeasibleSet(model), parameters=found).feasible
    _, q, dq, _ = sy.load_trajectory(place / "out" / "trajectory.csv").sample(1000.0)
    assert np.abs(q).max() <= 3.0
    assert np.abs(dq).max() <= 2.5
    used = json.loads((place / "out" / "excite.json").read_text())["use_of_limits"]
    assert set(used) == {"position", "velocity", "torque"}
    assert max(used.values()) <= 1.0


HEAVY = """<robot name="arm"><link name="base"/>
<link name="l1"><inertial><origin xyz="-0.06 0.27 -0.16"/><mass value="4.1"/>
  <inertia ixx="0.115" iyy="0.111" izz="0.085" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0.05 0 0.1"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" velocity="5" effort="300"/></joint>
<link name="l2"><inertial><origin xyz="-0.18 -0.1 -0.01"/><mass value="1.4"/>
  <inertia ixx="0.024" iyy="0.033" izz="0.029" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.05 0 0.3"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" velocity="5" effort="300"/></joint>
<link name="l3"><inertial><origin xyz="-0.12 0.1 -0.06"/><mass value="4.5"/>
  <inertia ixx="0.079" iyy="0.127" izz="0.115" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j3" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="0.05 0 0.3"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" velocity="5" effort="1"/></joint></robot>
"""
"""A last link of 4.5 kg, which its kinematics, without another joint behind it, do not make credible, and which its
drive cannot hold."""


@pytest.mark.slow
def test_a_limit_that_the_true_motion_exceeds_is_said_everywhere(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(HEAVY)
    (tmp_path / "limits.toml").write_text("velocity = 2.0\nacceleration = 6.0\n")
    options = ("--on-the-fly", "--limits", tmp_path / "limits.toml", "--longest", 5, "-o", tmp_path / "out")
    code, out, err = run("excite", "-q", tmp_path / "arm.urdf", *options)
    assert code == 3, err
    said = re.search(r"exceeds a limit: j3 uses (\d+\.\d)% of its limit of velocity, at", " ".join(out.split()))
    assert "Its drive was at its limit of torque" in " ".join(out.split())
    log = sy.Recording.read(tmp_path / "out" / "log.csv")
    measured = np.abs(np.gradient(log.q[:, 2], log.t)).max()  # by the encoders
    assert float(said[1]) == pytest.approx(100.0 * measured / 2.0, abs=2.0)
    assert "j3 uses" in (tmp_path / "out" / "excite.html").read_text()
    assert "j3 uses" in json.loads((tmp_path / "out" / "excite.json").read_text())["exceeded"][0]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--on-the-fly",), "shoulder has no limit of velocity or acceleration"),
        (("--on-the-fly", "--period", 3), "--period belongs to a motion that is designed beforehand"),
        (("--on-the-fly", "--criterion", "condition"), "--criterion condition belongs to a motion that is designed"),
        (("--longest", 30), "--longest belongs to a motion on the fly; add --on-the-fly"),
        (("--on-the-fly", "--limits", "limits.toml", "--noise", "1,2,3"), "noise must be one number, or 2 for the"),
        (("--on-the-fly", "--limits", "limits.toml", "--rate", 20), "rate must be at least 100 Hz"),
    ],
)
def test_what_cannot_be_done_is_one_sentence_and_nothing_is_written(run, place, monkeypatch, options, told):
    monkeypatch.chdir(place)
    (place / "limits.toml").write_text(LIMITS)
    code, out, err = run("excite", "robot.toml", *options, "-o", "out")
    assert (code, out) == (2, "")
    assert told in err
    assert not list(place.glob("out/*"))
