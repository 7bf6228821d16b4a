"""Logs with numbered columns of more joints than move: those of joints that are locked, or beyond the tip."""

import tempfile
from pathlib import Path

import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.recording import LogColumns
from steelyard.recording.formats import LogFiles
from steelyard.recording.logged_joints import locked_that_move
from steelyard.recording.recognition import find_columns, numbered_columns


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


def chain(count, locked=(), names=None):
    """Return a robot of so many joints, some of which are locked."""
    names = names or [f"part_{'abcdefgh'[k]}" for k in range(count)]
    links = "".join(f'<link name="l{k}"/>' for k in range(count + 1))
    joints = "".join(
        f'<joint name="{name}" type="continuous"><parent link="l{k}"/><child link="l{k + 1}"/></joint>'
        for k, name in enumerate(names)
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "chain.urdf"
        path.write_text(f'<robot name="chain">{links}{joints}</robot>')
        return sy.Robot.from_urdf(path, locked=locked)


@pytest.mark.parametrize("stated", [{}, {"position": "q_{}", "torque": "tau_{}"}], ids=["found", "patterns"])
@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("locked", ["part_a", "part_b", "part_c"])
def test_numbers_of_columns_count_the_joints_that_are_locked(stated, first, locked):
    robot = chain(3, [locked])
    numbers = range(first, first + 3)
    names = ["time", *columns("q", numbers), *columns("tau", numbers)]
    found = find_columns(names, LogColumns.from_dict(stated), robot)
    moving = [k + first for k in range(3) if robot.described_joints[k] != locked]
    assert found.position == tuple(columns("q", moving))
    assert found.torque == tuple(columns("tau", moving))
    if not stated or found.position != numbered_columns("q_{}", 2, names):
        assert f"of 3 numbered columns, which count joints that are locked, too ({locked})" in found.guesses[0]


def test_numbers_of_columns_count_the_joints_that_move_where_there_are_no_others():
    stated = LogColumns.from_dict({"position": "q_{}", "torque": "tau_{}"})
    for first in (0, 1):
        numbers = range(first, first + 2)
        names = ["time", *columns("q", numbers), *columns("tau", numbers)]
        for locked in ("part_a", "part_b", "part_c"):
            for one in (stated, None):
                found = find_columns(names, one, chain(3, [locked]))
                assert found.position == tuple(columns("q", numbers))
                assert not found.guesses


def test_patterns_before_a_matrix_count_the_joints_that_are_locked():
    """A matrix with nothing beside its diagonal makes radians of counts; it does not say which columns there are."""
    names = ["time", *columns("q", (1, 2, 3)), *columns("tau", (1, 2, 3))]
    stated = {"position": "q_{}", "torque": "tau_{}", "position_matrix": [["2*pi/4096", 0], [0, "2*pi/4096"]]}
    found = find_columns(names, LogColumns.from_dict(stated), chain(3, ["part_b"]))
    assert found.position == ("q_1", "q_3")
    assert found.torque == ("tau_1", "tau_3")
    assert "q_1, q_3 of 3 numbered columns, which count joints that are locked, too (part_b)" in found.guesses[0]


def test_a_list_that_counts_the_joints_that_move_is_a_question_beside_columns_of_all():
    names = ["time", *columns("q", (1, 2, 3)), *columns("tau", (0, 1, 2))]
    robot = chain(3, ["part_b"])
    with pytest.raises(
        InputError, match=r"position is stated .* q_1, q_2, and torque is tau_0, tau_2 of 3 .* as a list"
    ):
        find_columns(names, LogColumns.from_dict({"position": ["q_1", "q_2"]}), robot)
    found = find_columns(names, LogColumns.from_dict({"position": ["q_1", "q_3"]}), robot)
    assert found.torque == ("tau_0", "tau_2")


def test_a_pattern_that_may_count_either_is_a_question():
    robot = chain(5, ["part_a", "part_b"])  # wheels, of which the log says nothing, before an arm with a gripper
    names = ["time", *columns("q", (1, 2, 3, 4)), *columns("tau", (1, 2, 3, 4))]
    stated = {"position": "q_{}", "torque": "tau_{}"}
    with pytest.raises(
        InputError, match=r"4 columns 'q_\{\}', which may count the 3 joints that move or all 5 .* list of"
    ):
        find_columns(names, LogColumns.from_dict(stated), robot)
    with pytest.raises(InputError, match=r"positions of 4 joints .* name the right columns with `position` in"):
        find_columns(names, None, robot)
    lists = {"position": columns("q", (1, 2, 3)), "torque": columns("tau", (1, 2, 3))}
    assert find_columns(names, LogColumns.from_dict(lists), robot).position == ("q_1", "q_2", "q_3")
    # Fingers behind the arm take no columns from it, whatever is logged of them.
    behind = chain(5, ["part_d", "part_e"])
    for many in (3, 4, 5):
        names = ["time", *columns("q", range(1, many + 1)), *columns("tau", range(1, many + 1))]
        found = find_columns(names, LogColumns.from_dict(stated), behind)
        assert found.position == ("q_1", "q_2", "q_3")


def test_which_joints_a_description_counts(tmp_path):
    path = tmp_path / "hand.urdf"
    joints = (
        ("turn", "continuous", "base", "a", ""),
        ("weld", "fixed", "a", "b", ""),
        ("free", "floating", "b", "c", ""),
        ("bend", "revolute", "c", "d", '<limit lower="-1" upper="1" effort="1" velocity="1"/>'),
        ("twin", "continuous", "c", "e", '<mimic joint="bend"/>'),
        ("tool", "continuous", "d", "f", ""),
    )
    links = "".join(f'<link name="{name}"/>' for name in ("base", *"abcdef"))
    path.write_text(
        f'<robot name="hand">{links}'
        + "".join(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{more}</joint>'
            for name, kind, parent, child, more in joints
        )
        + "</robot>"
    )
    assert sy.Robot.from_urdf(path, locked=["free", "bend"]).described_joints == ("turn", "bend", "tool")
    assert sy.Robot.from_urdf(path, locked=["free"], tip="d").described_joints == ("turn", "bend")
    rows = [(0, 1, 0, "q")] * 3
    assert sy.Robot.from_dh(rows, locked=["joint2"]).described_joints == ("joint1", "joint2", "joint3")
    assert sy.Robot.from_dh(rows).described_joints == ()


@pytest.mark.slow
def test_an_answer_is_the_same_by_patterns_and_by_lists(tmp_path):
    t = np.arange(0.0, 8.0, 0.01)
    table = {"t": t}
    for k, numbers in enumerate((0.4 * np.sin(t), np.full(len(t), 0.4), 0.6 * np.cos(2.3 * t)), start=1):
        table |= {f"q{k}": numbers, f"tau{k}": np.cos(k * t + k)}
    path = tmp_path / "robot.toml"
    description = (
        f"[description]\nrows = {[[0, 0.3, 0, 'q']] * 3}\nlocked = {{ joint2 = 0.4 }}\n[processing]\ncutoff = 8\n"
    )
    answers = []
    for position, torque in (('"q{}"', '"tau{}"'), ('["q1", "q3"]', '["tau1", "tau3"]')):
        path.write_text(f"{description}[log]\nposition = {position}\ntorque = {torque}\n")
        answers.append(sy.identify(path, table).estimate.parameters)
    np.testing.assert_array_equal(*answers)


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
        (("1", "2", "3"), {"position": "q{}", "torque": "tau{}"}, 1.0, "(from -0.4 to 0.4, 'q2')"),
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
    said = locked_that_move(table, columns, LogFiles(table, columns).layout(robot), robot)
    if told is None:
        assert said is None
    else:
        assert told in said.statement
        assert said.statement.endswith(".")
        assert said.advice.startswith("Take them out of `locked`")
