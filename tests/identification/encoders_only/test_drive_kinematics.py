"""The doctor tells wrong ratios and backlash of transmissions by their second encoders."""

import numpy as np
import pytest
from gap_logs import gap_log

from steelyard.errors import InputError
from steelyard.identification import examine
from steelyard.identification.encoders_only.drive_kinematics import transmission_findings
from steelyard.recording import LogColumns, Recording
from steelyard.recording.correction import toml_text
from steelyard.robot import RobotFile

ROBOT = """\
[description]
rows = [[0, 0.3, 0, "q"]]
gravity = [0, -9.81, 0]
[[terms]]
kind = "viscous"
[[terms]]
kind = "coulomb"
[[terms]]
kind = "rotor_inertia"
[log]
position = "q{}"
torque = "tau{}"
[elastic]
joints = [1]
position = "link{}"
"""


def robot_file(folder, further=""):
    path = folder / "robot.toml"
    path.write_text(ROBOT + further)
    return path


def told(path, log):
    """Return kinds, remedies and facts without the rest of the examination."""
    file = RobotFile.load(path)
    log = dict(log)
    columns = LogColumns.from_dict(file.section("log"))
    names = list(file.robot.joint_names)
    return transmission_findings(log, file, columns, Recording.read(log, columns, names), names)


def sine():
    t = np.arange(2000) / 100
    q = np.sin(t) + 0.4 * np.sin(2.7 * t)
    noise = 1e-5 * np.random.default_rng(0).normal(size=(3, t.size))
    torque = 40.0 * np.cos(q) + 5.0 * np.sign(np.gradient(q)) + noise[2]
    return {"t": t, "q1": q + 40.0 * np.cos(q) / 2e5 + noise[0], "tau1": torque, "link1": q + noise[1]}


@pytest.mark.slow
def test_a_wrong_ratio_has_a_line_that_mends_it(tmp_path):
    log = sine()
    assert told(robot_file(tmp_path), log)[0] == []
    for factor, line in (
        (-1.0, "scale = [-1.0]"),
        (180.0 / np.pi, 'position_unit = "deg"'),
        (0.01, "scale = [100.0]"),
    ):
        wrong = {**log, "link1": factor * log["link1"]}
        ((finding,), _) = told(robot_file(tmp_path), wrong)
        assert finding.kind == "gear ratio"
        assert toml_text(finding.remedy).splitlines()[-1] == line
        assert told(robot_file(tmp_path, line), wrong)[0] == []
    backwards = {**log, "q1": log["link1"], "link1": 1.01 * log["q1"]}
    ((finding,), _) = told(robot_file(tmp_path, 'side = "motor"'), backwards)
    assert "101:1 where 100:1" in finding.statement
    assert finding.remedy["elastic"]["scale"] == [pytest.approx(1 / 1.01, abs=1e-6)]


def test_columns_that_are_missing_or_another_joints_are_told(tmp_path):
    log = sine()
    path = robot_file(tmp_path)
    ((finding,), _) = told(path, {name: values for name, values in log.items() if name != "link1"})
    assert "no column 'link1'" in finding.statement
    ((finding,), _) = told(path, {**log, "link1": np.sin(5.1 * log["t"])})
    assert "does not follow the first" in finding.statement
    ((finding,), _) = told(path, {**log, "link1": log["q1"]})
    assert "it is a copy, and shows no deflection" in finding.statement
    _, facts = told(path, {name: values[:100] for name, values in log.items()})
    assert facts["backlash, joint 'joint1'"] == "not told: the log is too short, or the joint rests"


def test_commands_in_another_unit_are_told(tmp_path):
    log = sine()
    path = robot_file(tmp_path, '[drive]\ncommand = "target{}"\nkp = 100.0\nkd = 1.0\n')
    assert told(path, {**log, "target1": log["q1"] + log["tau1"] / 100.0})[0] == []
    ((finding,), _) = told(path, {**log, "target1": np.rad2deg(log["q1"])})
    assert finding.kind == "command unit"
    assert "degrees in the commands" in finding.statement
    from_0 = {**log, "target0": np.rad2deg(log["q1"])}
    assert "its commands target0 are 57.3" in told(path, from_0)[0][0].statement
    path = robot_file(tmp_path, "[drive]\ncommand = 5\nkp = 100.0\n")
    with pytest.raises(InputError, match="key 'command', is 5; give a list of texts"):
        told(path, log)


@pytest.mark.slow
def test_the_doctor_tells_a_gap(tmp_path):
    motor, link, torque, rate = gap_log(5, backlash=1e-3, delay=3e-3, seconds=20.0)
    log = {"t": np.arange(len(motor)) / rate, "q1": motor, "tau1": torque, "link1": link}
    found = examine(log, robot_file(tmp_path))
    (finding,) = (one for one in found.findings if one.kind == "backlash")
    assert "has a backlash of" in finding.statement
    assert abs(finding.weight / 1e-3 - 1.0) < 0.1
    sound = gap_log(5, backlash=0.0, delay=3e-3, seconds=20.0)
    log |= {"q1": sound[0], "link1": sound[1], "tau1": sound[2]}
    found = examine(log, robot_file(tmp_path))
    assert not [one for one in found.findings if one.kind in ("backlash", "gear ratio")]
    assert found.facts["backlash, joint 'joint1'"].startswith("at most ")
