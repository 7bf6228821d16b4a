"""The first robot.toml loads as it is, states what the log tells, and identifies as well as without it."""

import tomllib

import numpy as np
import pytest

import steelyard as sy
from steelyard.identification import first_robot_file
from steelyard.recording import LogColumns
from steelyard.robot import RobotFile

LINK = """<link name="{name}"><inertial><origin xyz="{x} 0 0.05"/><mass value="{mass}"/>
  <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.02"/></inertial></link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{x} 0 0"/>
  <axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="4" effort="{effort}"/></joint>"""


def description(folder, *, fingers=False, gears=False):
    """Write an arm of two joints, which may have a finger, and gears."""
    parts = ['<link name="base"/>', LINK.format(name="upper", x=0.1, mass=3), LINK.format(name="fore", x=0.15, mass=2)]
    parts.append(
        JOINT.format(name="shoulder", kind="revolute", parent="base", child="upper", x=0, axis="0 1 0", effort=50)
    )
    parts.append(
        JOINT.format(name="elbow", kind="revolute", parent="upper", child="fore", x=0.4, axis="0 1 0", effort=0)
    )
    if fingers:
        parts.append(LINK.format(name="finger", x=0, mass=0.1))
        parts.append(
            JOINT.format(name="grip", kind="prismatic", parent="fore", child="finger", x=0.3, axis="1 0 0", effort=9)
        )
    if gears:
        parts.append(
            '<transmission name="t"><actuator name="m"><mechanicalReduction>100</mechanicalReduction></actuator>'
            "</transmission>"
        )
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm">{"".join(parts)}</robot>')
    return path


T = np.arange(3000) / 150


def motion():
    """Return a motion of both joints that shows everything."""
    w = np.array([[0.7, 1.9, 3.1], [1.1, 2.3, 2.9]])
    a = np.array([[0.8, 0.3, 0.15], [0.7, 0.4, 0.2]])
    angle = w[None] * T[:, None, None]
    q = (a * np.sin(angle)).sum(axis=2)
    return q, (a * w * np.cos(angle)).sum(axis=2), -(a * w * w * np.sin(angle)).sum(axis=2)


def torques(path, rotor=0.0):
    """Return the torques of the described arm, with friction, rotors and noise."""
    robot = sy.Robot.from_urdf(path, locked=["grip"] if "grip" in path.read_text() else [])
    robot = robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset(), sy.RotorInertia())
    model = sy.Model(robot)
    parameters = np.nan_to_num(np.asarray(robot.parameters))
    places = {name: index for index, name in enumerate(model.parameter_names)}
    for number in (1, 2):
        for symbol, value in (("Fvj", 0.6), ("Fcj", 0.9), ("Foj", 0.1), ("Ia", rotor)):
            parameters[places[f"{symbol}{number}"]] = value
    torque = model.inverse_dynamics(*motion(), parameters)
    return torque + 0.02 * torque.std(axis=0) * np.random.default_rng(4).normal(size=torque.shape)


def written(path, heads, columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(heads), comments="", fmt="%.9g")
    return path


def log_of(folder, torque, name="log.csv"):
    return written(folder / name, ["t", "q1", "q2", "tau1", "tau2"], [T, motion()[0], torque])


def loaded(made, folder):
    (folder / "robot.toml").write_text(made.text)
    return RobotFile.load(folder / "robot.toml"), tomllib.loads(made.text)


def kinds(content):
    return [term["kind"] for term in content["terms"]]


@pytest.mark.parametrize("gears", [False, True])
def test_a_description_alone_tells_limits_and_gears(tmp_path, gears):
    made = first_robot_file(description(tmp_path, gears=gears), folder=tmp_path)
    file, content = loaded(made, tmp_path)
    assert file.robot.joint_names == ("shoulder", "elbow")
    assert content["description"]["urdf"] == "arm.urdf"
    assert kinds(content) == ["viscous", "coulomb", "offset", *(["rotor_inertia"] if gears else [])]
    assert ("gears of 100" in made.text) is gears
    # A limit of zero is one that nobody knew.
    assert content["limits"]["effort"] == [50.0, float("inf")]
    assert (content["limits"]["lower"], content["limits"]["velocity"]) == ([-3.0, -3.0], [4.0, 4.0])


@pytest.mark.slow
def test_it_identifies_as_well_as_without_it(tmp_path):
    urdf = description(tmp_path)
    log = log_of(tmp_path, torques(urdf))
    made = first_robot_file(urdf, log, folder=tmp_path)
    file, content = loaded(made, tmp_path)
    assert made.examination.findings == ()
    assert kinds(content) == ["viscous", "coulomb", "offset"]  # there are no rotors
    assert content["log"]["position"] == ["q1", "q2"]
    assert 'q1", # shoulder, rad' in made.text
    own, bare = sy.identify(file, log), sy.identify(urdf, log)
    assert own.estimate.relative_error == pytest.approx(bare.estimate.relative_error, rel=1e-3)
    for guess in made.guesses:
        assert guess.reason, guess
        assert guess.value.strip('"') in made.text or guess.section == "terms"


@pytest.mark.slow
def test_rotors_are_taken_in_where_the_log_shows_them(tmp_path):
    urdf = description(tmp_path)
    log = log_of(tmp_path, torques(urdf, rotor=0.3))
    _, content = loaded(first_robot_file(urdf, log, folder=tmp_path), tmp_path)
    assert "rotor_inertia" in kinds(content)


@pytest.mark.slow
def test_joints_without_columns_are_locked(tmp_path):
    urdf = description(tmp_path, fingers=True)
    q, torque = motion()[0], torques(urdf)
    numbered = log_of(tmp_path, torque)
    heads = ["time", "elbow_position", "elbow_torque", "shoulder_position", "shoulder_torque"]
    named = written(tmp_path / "named.csv", heads, [T, q[:, 1], torque[:, 1], q[:, 0], torque[:, 0]])
    for log, position in ((numbered, ["q1", "q2"]), (named, ["shoulder_position", "elbow_position"])):
        file, content = loaded(first_robot_file(urdf, log, folder=tmp_path), tmp_path)
        assert content["description"]["locked"] == ["grip"]
        assert content["log"]["position"] == position
        assert file.robot.dof == 2
        assert sy.identify(file, log).prediction.word == "good"


@pytest.mark.slow
def test_what_mends_the_log_stands_in_the_file_with_its_reason(tmp_path):
    urdf = description(tmp_path)
    q, torque = motion()[0], torques(urdf)
    level = 0.6 * np.abs(torque[:, 0]).max()
    torque[:, 0] = np.clip(torque[:, 0], -level, level)
    torque[:, 1] *= -1.0
    log = written(tmp_path / "log.csv", ["t", "q1", "q2", "tau1", "tau2"], [1e3 * T, q, torque])
    file, content = loaded(first_robot_file(urdf, log, folder=tmp_path), tmp_path)
    assert content["log"]["time_unit"] == "ms"
    assert content["log"]["torque_sign"] == [1, -1]
    assert content["processing"]["saturation"] is True
    assert "The sign of the torque of elbow looks wrong" in " ".join((tmp_path / "robot.toml").read_text().split())
    assert sy.identify(file, log).prediction.word == "good"


@pytest.mark.slow
def test_a_joint_that_does_not_move_is_locked_where_it_is(tmp_path):
    urdf = description(tmp_path, fingers=True)
    q, torque = motion()[0], torques(urdf)
    noise = 1e-6 * np.random.default_rng(6).normal(size=T.shape)
    heads = ["t", "q1", "q2", "q3", "tau1", "tau2", "tau3"]
    log = written(tmp_path / "log.csv", heads, [T, q, 0.02 + noise, torque, 0.1 + 1e4 * noise])
    file, content = loaded(first_robot_file(urdf, log, folder=tmp_path), tmp_path)
    assert content["description"]["locked"] == {"grip": 0.02}
    assert content["log"]["torque"] == ["tau1", "tau2"]
    assert content["limits"]["effort"] == [50.0, float("inf")]
    assert sy.identify(file, log).prediction.word == "good"


@pytest.mark.slow
def test_units_are_those_of_joints_that_slide(tmp_path):
    urdf = description(tmp_path)
    urdf.write_text(urdf.read_text().replace('name="elbow" type="revolute"', 'name="elbow" type="prismatic"'))
    log = log_of(tmp_path, torques(urdf))
    made = first_robot_file(urdf, log, folder=tmp_path)
    _, content = loaded(made, tmp_path)
    assert '"q1", # shoulder, rad: by number' in made.text
    assert '"q2", # elbow, m: by number' in made.text
    assert '"tau2", # elbow, N: by number' in made.text
    assert content["log"]["position_unit"] == ["rad", "m"]
    assert content["log"]["torque_unit"] == ["N·m", "N"]


def test_names_that_toml_quotes_survive(tmp_path):
    urdf = description(tmp_path)
    text = urdf.read_text().replace('"elbow"', '"left elbow #2"').replace('name="arm"', 'name="a &quot;b&quot; é"')
    urdf.write_text(text)
    file, _ = loaded(first_robot_file(urdf, folder=tmp_path), tmp_path)
    assert file.robot.name == 'a "b" é'
    assert file.robot.joint_names[1] == "left elbow #2"


def test_a_robot_file_is_refused(tmp_path):
    (tmp_path / "robot.toml").write_text("")
    with pytest.raises(sy.InputError, match="is a robot file already, which every other command takes as it is"):
        first_robot_file(tmp_path / "robot.toml")


@pytest.mark.parametrize("heads", [("actual_current_0", "actual_current_1"), ("tau1 [mA]", "tau2 [mA]")])
def test_a_log_of_currents_alone_leaves_one_line_to_complete(tmp_path, heads):
    urdf = description(tmp_path)
    gains, torque = np.array([12.0, 5.0]), torques(urdf)
    scale = 1e3 if "mA" in heads[0] else 1.0
    log = written(tmp_path / "log.csv", ["t", "q1", "q2", *heads], [T, motion()[0], torque / gains * scale])
    made = first_robot_file(urdf, log, folder=tmp_path)
    assert made.to_complete.startswith("log.csv has currents and no torques: state the drive gains, N·m per A")
    assert "# gain = […, …] # shoulder, elbow" in made.text
    file, content = loaded(made, tmp_path)
    assert content["log"]["gain"] == "find"
    with pytest.raises(sy.errors.InputError, match=r"state `gain = \[...\]`, N·m per A of each joint"):
        sy.identify(file, log)
    read = sy.Recording.read(log, LogColumns.from_dict({**content["log"], "gain": gains}))
    np.testing.assert_allclose(read.torque, torque, rtol=1e-7)


@pytest.mark.slow
def test_times_in_two_columns_are_stated_as_such(tmp_path):
    urdf = description(tmp_path)
    seconds = np.floor(T)
    heads = ["sec", "nanosec", "q1", "q2", "tau1", "tau2"]
    log = written(tmp_path / "log.csv", heads, [seconds, np.round(1e9 * (T - seconds)), motion()[0], torques(urdf)])
    _, content = loaded(first_robot_file(urdf, log, folder=tmp_path), tmp_path)
    assert content["log"]["time"] == ["sec", "nanosec"]


@pytest.mark.slow
def test_joints_that_are_coupled_stand_as_matrices(tmp_path):
    """Encoders on the motors of a parallelogram: the second one turns against the first, and so do the torques."""
    path = description(tmp_path)
    (q, *_), torque = motion(), torques(path)
    columns = T, q[:, 0], q[:, 1] - q[:, 0], torque[:, 0] + torque[:, 1], torque[:, 1]
    log = written(tmp_path / "log.csv", ["t", "q1", "q2", "tau1", "tau2"], columns)
    _, content = loaded(first_robot_file(path, log, folder=tmp_path), tmp_path)
    section = content["log"]
    assert section["position_matrix"] == [[1, 0], [1, 1]]
    assert section["torque_matrix"] == [[1, -1], [0, 1]]


@pytest.mark.slow
@pytest.mark.parametrize("own", [pytest.param(True, marks=pytest.mark.slow), False])
def test_a_motor_that_turns_with_two_joints_is_a_term(tmp_path, own):
    """The motor of the elbow stands on the base and drags on both joints; the elbow itself rubs, or does not."""
    path = description(tmp_path, gears=True)
    _, dq, ddq = motion()
    drag = 2.5 * np.sign(dq.sum(axis=1)) + 1.5 * dq.sum(axis=1) + 0.2 * ddq.sum(axis=1)
    torque = torques(path) + drag[:, None]
    if not own:
        torque[:, 1] -= 0.6 * dq[:, 1] + 0.9 * np.sign(dq[:, 1])
    log = log_of(tmp_path, torque)
    file, content = loaded(first_robot_file(path, log, folder=tmp_path), tmp_path)
    assert kinds(content) == (["motor_side", "viscous", "coulomb"] if own else ["motor_side"])
    assert content["terms"][0]["coupling"] == [[1, 1], [0, 1]]
    assert sy.identify(file.path, log).estimate.relative_error < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("factors", [(1.7, 1.0), pytest.param((1.0, 1.7), marks=pytest.mark.slow)])
def test_a_wrong_factor_that_rotors_hide_is_told_beside_them(tmp_path, factors):
    path = description(tmp_path)
    torque = torques(path, rotor=0.5) / factors
    made = first_robot_file(path, log_of(tmp_path, torque), folder=tmp_path)
    _, content = loaded(made, tmp_path)
    assert "rotor_inertia" in kinds(content)
    np.testing.assert_allclose(content["log"]["gain"], factors, rtol=0.01)


@pytest.mark.slow
def test_where_either_joint_may_have_the_wrong_factor_both_are_told(tmp_path):
    path = description(tmp_path)
    torque = torques(path, rotor=0.5) / [0.6, 1.0]  # or, for all that two joints tell, the other one's 1 / 0.6
    made = first_robot_file(path, log_of(tmp_path, torque), folder=tmp_path)
    (finding,) = [one for one in made.examination.findings if one.kind == "torque scale"]
    assert "The torque of elbow looks 1.67 times too small" in finding.statement
    assert "Or: The torque of shoulder looks 1.67 times too large" in finding.statement
