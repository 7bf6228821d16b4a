"""Logs with numbered columns of more joints than move: those of joints that are locked, or beyond the tip."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.recording import LogColumns
from steelyard.recording.formats import LogFiles
from steelyard.recording.logged_joints import locked_that_move
from steelyard.recording.recognition import find_columns


def columns(kind, numbers, pattern="{}_{}"):
    return [pattern.format(kind, number) for number in numbers]


@pytest.mark.parametrize(
    ("joints", "numbers", "expected"),
    [
        (["joint1", "joint3"], (1, 2, 3), ("q_1", "q_3")),
        (["joint3", "joint1"], (1, 2, 3), ("q_3", "q_1")),
        (["joint1", "joint3"], (0, 1, 2), ("q_0", "q_2")),
        (["joint_0", "joint_2"], (0, 1, 2), ("q_0", "q_2")),
        (["joint2", "joint1"], (1, 2, 3), ("q_2", "q_1")),
        (["arm2_joint1", "arm2_joint2"], (1, 2, 3), ("q_1", "q_2")),
    ],
)
def test_the_numbers_in_the_names_of_the_joints_choose(joints, numbers, expected):
    names = ["time", *columns("q", numbers), *columns("tau", numbers)]
    found = find_columns(names, joints=joints)
    assert found.position == expected
    assert found.torque == tuple(name.replace("q", "tau") for name in expected)
    assert f"{expected[0]}, {expected[1]} of 3 numbered columns" in found.guesses[0]


@pytest.mark.parametrize(
    ("joints", "numbers"),
    [
        (["joint1", "joint2"], (0, 1, 2)),  # joint1 may be the first or the second column
        (["joint1", "joint4"], (1, 2, 3)),
        (["joint1", "joint1b"], (1, 2, 3)),
        (["shoulder", "elbow"], (1, 2, 3)),
    ],
)
def test_nothing_is_guessed_where_the_numbers_do_not_tell(joints, numbers):
    names = ["time", *columns("q", numbers), *columns("tau", numbers)]
    with pytest.raises(InputError, match=r"positions of 3 joints .* but the robot has 2"):
        find_columns(names, joints=joints)


@pytest.mark.slow
def test_rows_with_a_locked_and_an_excluded_joint(tmp_path):
    """The log of the whole arm serves: the locked joint has no parameters, the torque of the excluded one no say."""
    rows = '[[0, 0.3, 0, "q"], [0, 0.3, 0, "q"], ["pi/2", 0.3, 0, "q"]]'
    path = tmp_path / "robot.toml"
    path.write_text(
        f'[description]\nrows = {rows}\nlocked = {{joint2 = 0.4}}\n[processing]\nexclude_joints = ["joint3"]\n'
        "cutoff = 8\n"
    )
    model = sy.Model.load(path)
    assert model.robot.joint_names == ("joint1", "joint3")
    t = np.arange(0.0, 8.0, 0.01)
    random = np.random.default_rng(0)
    turns = 2 * np.pi * np.array([0.25, 0.5, 0.75])
    waves = random.normal(size=(3, 2)) * 0.4
    q, dq, ddq = (
        sum(f(w * t)[:, None] * w**k * s * a for w, a in zip(turns, waves, strict=True))
        for f, k, s in ((np.sin, 0, 1), (np.cos, 1, 1), (np.sin, 2, -1))
    )
    body = sy.Inertia.from_com(2.0, (-0.1, 0.02, 0.03), np.diag([0.02, 0.03, 0.04]))
    parameters = np.concatenate([np.append(body.parameters, (0.1, 0.2, 0.0))] * 2)
    torque = model.inverse_dynamics(q, dq, ddq, parameters) + 0.01 * random.normal(size=q.shape)
    torque[:, 1] = 99.0  # a sensor that is broken
    still = np.full(len(t), 0.4)
    table = {"time": t, "q_1": q[:, 0], "q_2": still, "q_3": q[:, 1]}
    table |= {"tau_1": torque[:, 0], "tau_2": still, "tau_3": torque[:, 1]}
    found = sy.identify(path, table)
    error = np.linalg.norm(
        model.inverse_dynamics(q, dq, ddq, found.estimate.parameters)[:, 0]
        - model.inverse_dynamics(q, dq, ddq, parameters)[:, 0]
    ) / np.linalg.norm(model.inverse_dynamics(q, dq, ddq, parameters)[:, 0])
    assert error < 0.01


CHAIN = '<robot name="chain"><link name="l0"/>' + "".join(
    f'<link name="l{k}"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    f'<joint name="{name}" type="continuous"><parent link="l{k - 1}"/><child link="l{k}"/></joint>'
    for k, name in enumerate(("waist", "elbow", "wrist"), start=1)
)
SWING = 0.4 * np.sin(np.arange(0.0, 7.0, 0.01))
LISTS = {"position": ["q1", "q3"], "torque": ["tau1", "tau3"]}


@pytest.mark.parametrize(
    ("names", "stated", "scale", "told"),
    [
        (("1", "2", "3"), LISTS, 1.0, "(from -0.4 to 0.4, 'q2')"),
        (("1", "2", "3"), LISTS | {"position_unit": "deg"}, 180.0 / np.pi, "(from -0.4 to 0.4, 'q2')"),
        (("_waist", "_elbow", "_wrist"), {}, 1.0, "(from -0.4 to 0.4, 'q_elbow')"),
        (("1", "2", "3"), LISTS, 0.0, None),  # it stands still
        (("1", "2", "3"), LISTS, 1e-3, None),  # by the noise of its encoder
        (("1", "7", "3"), LISTS, 1.0, None),  # no column is that of the elbow
        (("3", "2", "1"), LISTS | {"position": ["q3", "q1"], "torque": ["tau3", "tau1"]}, 1.0, None),  # another order
    ],
)
@pytest.mark.parametrize("described", ["urdf", "rows"])
def test_a_locked_joint_that_moves_is_told_where_its_column_is_sure(names, stated, scale, told, described, tmp_path):
    if described == "urdf":
        (tmp_path / "chain.urdf").write_text(CHAIN + "</robot>")
        robot = sy.Robot.from_urdf(tmp_path / "chain.urdf", locked=["elbow"])
    else:
        if "_elbow" in names:
            names, told = ("_joint1", "_joint2", "_joint3"), told.replace("elbow", "joint2")
        (tmp_path / "chain.toml").write_text(f"[description]\nrows = {[[0, 1, 0, 'q']] * 3}\nlocked = ['joint2']\n")
        robot = sy.Model.load(tmp_path / "chain.toml").robot
    turns = 180.0 / np.pi if "position_unit" in stated else 1.0
    table = {"t": 0.01 * np.arange(len(SWING))}
    table |= {f"q{name}": SWING * (scale if k == 1 else turns) for k, name in enumerate(names)}
    table |= {f"tau{name}": np.cos(5.0 * SWING) for name in names}
    columns = LogColumns.from_dict(stated, "[log]")
    said = locked_that_move(table, columns, LogFiles(table, columns).layout(list(robot.joint_names)), robot)
    assert said == "" if told is None else told in said
