"""Reading of MJCF, compared with MuJoCo."""

import struct
from pathlib import Path

import numpy as np
import pytest

import steelyard as sy
from steelyard.collision import RobotGeometry
from steelyard.errors import InputError
from steelyard.robot import Robot
from steelyard.robot.file import RobotFile

mujoco = pytest.importorskip("mujoco", reason="MuJoCo (extra `mjcf`) is not installed")

from described_robots import difference_from_mujoco  # noqa: E402
from mjcf_readings import EXACT  # noqa: E402
from random_mjcf import random_forest  # noqa: E402

ARM = """<mujoco model="arm">
  <compiler angle="degree" autolimits="true"/>
  <option gravity="0 0 -9.8"/>
  <default>
    <joint damping="0.5"/>
    <default class="elbow"><joint armature="0.02" frictionloss="0.3" range="-90 45"/></default>
  </default>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="1 1 1" material="missing"/>
    <body name="upper" pos="0 0 1">
      <inertial pos="0.1 0 0" mass="2" fullinertia="0.2 0.3 0.25 0.01 0.02 0.03"/>
      <joint axis="0 1 0"/>
      <body name="plate" pos="0.2 0 0"><geom type="box" size="0.1 0.1 0.1" mass="0.5"/></body>
      <body pos="0.5 0 0" euler="0 90 0">
        <joint name="elbow" class="elbow" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.05"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="elbow" gear="50"/></actuator>
  <keyframe><key qpos="1 2 3 4"/></keyframe>
</mujoco>
"""
FREE = """<mujoco><worldbody><body name="trunk" pos="0 0 1"><freejoint/><geom size="0.2"/>
<body name="leg"><joint name="hip" axis="0 1 0"/><geom size="0.1" pos="0 0 -0.3"/></body></body></worldbody></mujoco>"""
PAIR = """<mujoco><compiler angle="radian"/><worldbody>
<body name="a"><joint name="one" axis="0 1 0" ref="0.2" armature="0.1"/><geom size="0.1" pos="0.3 0 0"/></body>
<body name="b" pos="0 1 0"><joint name="two" axis="0 1 0" ref="-0.3" armature="0.2" damping="0.5" frictionloss="0.25"/>
<geom size="0.1" pos="0.2 0 0"/><body name="c"><joint name="three"/><geom size="0.1" pos="0.2 0 0.1"/></body></body>
</worldbody>{}</mujoco>"""


def written(folder: Path, text: str, name: str = "robot.xml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def read(folder: Path, text: str, **options) -> Robot:
    return Robot.from_mjcf(written(folder, text), **options)


@EXACT
def test_defaults_and_inertias_are_those_of_mujoco(tmp_path):
    text = ARM.replace(' material="missing"', "").replace('"1 2 3 4"', '"1 2"')
    robot = read(tmp_path, ARM)
    assert robot.name == "arm"
    assert robot.joint_names == ("upper_joint", "elbow")
    assert robot.link_names == ("upper", "body3")
    assert robot.links[0].absorbed == ("plate",)
    assert robot.gravity.tolist() == [0.0, 0.0, -9.8]
    elbow = robot.joints[1]
    assert (elbow.damping, elbow.friction, elbow.rotor_inertia) == (0.5, 0.3, 0.02)
    assert np.allclose([elbow.lower, elbow.upper], [-np.pi / 2, np.pi / 4], rtol=1e-15)
    assert robot.joints[0].kind == "continuous"
    assert difference_from_mujoco(written(tmp_path, text), robot) < 1e-12


@pytest.mark.slow
@EXACT
@pytest.mark.parametrize("seed", range(1, 33))
def test_random_trees(tmp_path, seed):
    path = random_forest(tmp_path, seed)
    robot = Robot.from_mjcf(path)
    assert robot.dof > 10
    assert difference_from_mujoco(path, robot) < 1e-9


def test_the_default_terms_have_rotors_where_the_file_has(tmp_path):
    kinds = [term["kind"] for term in RobotFile.load(written(tmp_path, ARM)).terms]
    assert kinds == ["viscous", "coulomb", "offset", "rotor_inertia"]
    plain = ARM.replace('armature="0.02"', "")
    assert "rotor_inertia" not in [term["kind"] for term in RobotFile.load(written(tmp_path, plain)).terms]


def test_a_robot_file_names_an_mjcf(tmp_path):
    written(tmp_path, ARM, "arm.mjcf")
    text = '[description]\nfile = "arm.mjcf"\nlocked = {elbow = 0.4}\n'
    toml = written(tmp_path, text, "robot.toml")
    robot = RobotFile.load(toml).robot
    assert robot.joint_names == ("upper_joint",)
    assert robot.gravity.tolist() == [0.0, 0.0, -9.8]
    toml.write_text(text + "gravity = [0, 9.81, 0]\n")
    assert RobotFile.load(toml).robot.gravity.tolist() == [0.0, 9.81, 0.0]
    assert sy.Model.load(toml).robot.terms[-1].kind == "offset"


def test_what_is_told_of_where_numbers_come_from(tmp_path):
    robot = read(tmp_path, ARM.replace('axis="0 1 0"', 'axis="0 1 0" stiffness="3"'))
    assert robot.remarks == (
        "Inertias that the file gives (<inertial>): upper.",
        "Inertias that follow from shapes and their densities: plate, body3.",
        "The damping of upper_joint, elbow is that of the default class main (robot.xml, line 5).",
        "The friction of elbow is that of the default class elbow (robot.xml, line 6).",
        "The armature of elbow is that of the default class elbow (robot.xml, line 6).",
        "Actuators, with the torque of a control of 1: elbow (50); "
        "a log must hold torques of joints, or [log] the gains.",
        "Not part of the robot: springs at the joints upper_joint.",
    )


def test_gravity_that_is_switched_off(tmp_path):
    text = ARM.replace("<option", '<option><flag gravity="disable"/></option><option')
    assert read(tmp_path, text).gravity.tolist() == [0.0, 0.0, 0.0]
    assert read(tmp_path, text, gravity=(0, 0, -9.81)).gravity.tolist() == [0.0, 0.0, -9.81]


def test_a_floating_base_is_refused_or_held_still(tmp_path):
    with pytest.raises(InputError, match=r'joint "trunk_joint" is of type "floating".*locked=\["trunk_joint"\]'):
        read(tmp_path, FREE)
    robot = read(tmp_path, FREE, locked=["trunk_joint"])
    assert robot.joint_names == ("hip",)
    assert robot.frame("trunk")[1][:3, 3].tolist() == [0.0, 0.0, 1.0]
    assert difference_from_mujoco(tmp_path / "robot.xml", robot) < 1e-12


def test_a_ball_joint_is_refused(tmp_path):
    with pytest.raises(InputError, match='joint "hip" is of type "spherical"'):
        read(tmp_path, FREE.replace('name="hip"', 'name="hip" type="ball"'), locked=["trunk_joint"])


def test_a_coupled_joint_mimics(tmp_path):
    text = PAIR.format('<equality><joint joint1="two" joint2="one" polycoef="0.1 -2 0 0 0"/></equality>')
    robot = read(tmp_path, text).with_terms(sy.Viscous(), sy.Coulomb(), sy.RotorInertia())
    two = robot.joints[1]
    # y - y0 = 0.1 - 2 (x - x0)
    assert (two.mimics, two.multiplier) == ("one", -2.0)
    assert two.offset == pytest.approx(-0.3 + 0.1 + 2 * 0.2, rel=1e-15)
    # The driver feels the damping and the rotor twice as fast and twice as strong, the friction twice as strong.
    assert robot.parameters[10:13] == pytest.approx([4 * 0.5, 2 * 0.25, 0.1 + 4 * 0.2])
    assert difference_from_mujoco(tmp_path / "robot.xml", robot) < 1e-12


def test_a_joint_that_is_held_by_an_equality(tmp_path):
    robot = read(tmp_path, PAIR.format('<equality><joint joint1="two" polycoef="0.5 0 0 0 0"/></equality>'))
    assert robot.joint_names == ("one", "three")
    angle = 0.5  # from the reference
    expected = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    assert np.allclose(robot.frame("b")[1][np.ix_([0, 2], [0, 2])], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("equality", "message", "locked"),
    [
        ('<joint joint1="two" joint2="one" polycoef="0 1 0.5 0 0"/>', '"two" follows "one" by a curved', "two"),
        ('<connect body1="a" body2="c" anchor="0 0 0"/>', 'ties the bodies "a" and "c" together', None),
        ('<weld name="w" body1="b"/>', 'the equality "w" ties the bodies "b" and "world" together', "two"),
    ],
)  # fmt: skip
def test_loops_and_curved_couplings_are_refused(tmp_path, equality, message, locked):
    text = PAIR.format(f"<equality>{equality}</equality>")
    with pytest.raises(InputError, match=message):
        read(tmp_path, text)
    if locked is not None:
        assert locked not in read(tmp_path, text, locked=[locked]).joint_names
    idle = text.replace("/></equality>", ' active="false"/></equality>')
    assert read(tmp_path, idle).dof == 3
    assert read(tmp_path, text, tip="a").joint_names == ("one",)


def test_coupled_tendons_are_refused(tmp_path):
    tendon = '<tendon><fixed name="t"><joint joint="one" coef="1"/><joint joint="three" coef="-1"/></fixed></tendon>'
    text = PAIR.format(tendon + '<equality><tendon tendon1="t"/></equality>')
    with pytest.raises(InputError, match="of tendons couples the joints one, three"):
        read(tmp_path, text)
    assert read(tmp_path, PAIR.format(tendon)).dof == 3


def stl(path: Path, corners: np.ndarray, triangles: list[tuple[int, int, int]]) -> None:
    data = b"\0" * 80 + struct.pack("<I", len(triangles))
    for triangle in triangles:
        data += struct.pack("<12fH", 0, 0, 0, *corners[list(triangle)].ravel(), 0)
    path.write_bytes(data)


def tetrahedron(path: Path) -> None:
    corners = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0, 0, 0.4]])
    stl(path, corners, [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])


MESHED = """<mujoco><compiler meshdir="meshes"/>
<asset><mesh name="skin" file="missing.obj"/><mesh file="solid.stl" scale="2 1 1"/></asset>
<worldbody><body name="a"><inertial pos="0 0 0.1" mass="1" diaginertia="1 1 1"/><joint/><geom type="mesh" mesh="skin"/>
<body name="b" pos="0 0 1"><joint axis="1 0 0"/><geom type="mesh" mesh="solid" density="500"/></body></body>
<body><geom type="mesh" mesh="skin"/></body></worldbody></mujoco>"""


def test_meshes_are_read_where_an_inertia_needs_them(tmp_path, mujoco_in_this_process):
    (tmp_path / "meshes").mkdir()
    path = written(tmp_path, MESHED)
    with pytest.raises(InputError, match=r'line 2, which an inertia needs: the mesh "meshes/solid\.stl" is not'):
        Robot.from_mjcf(path)
    tetrahedron(tmp_path / "meshes" / "solid.stl")
    robot = Robot.from_mjcf(path)
    assert robot.links[1].inertia.mass == pytest.approx(500 * 2 * 0.3 * 0.2 * 0.4 / 6, rel=1e-6)
    assert robot.links[1].inertia.com == pytest.approx([0.15, 0.05, 0.1], rel=1e-6)
    tetrahedron(tmp_path / "meshes" / "missing.obj")
    (tmp_path / "meshes" / "solid.stl").write_bytes(b"solid nothing")
    with pytest.raises(InputError, match="MuJoCo cannot compile it") as told:
        Robot.from_mjcf(path)
    assert "\n" not in str(told.value)


@pytest.mark.usefixtures("mujoco_in_this_process", "meshes_in_this_process")
@pytest.mark.parametrize(
    ("setting", "file"),
    [pytest.param("", "in\\solid.stl", marks=EXACT), ('strippath="true"', "x\\y/solid.stl")],
)
def test_paths_of_meshes_are_those_of_mujoco(tmp_path, setting, file):
    """Written on Windows, or with folders that do not count."""
    (tmp_path / "meshes" / "in").mkdir(parents=True)
    tetrahedron(tmp_path / "meshes" / "solid.stl")
    tetrahedron(tmp_path / "meshes" / "in" / "solid.stl")
    text = f"""<mujoco><compiler meshdir="meshes" {setting}/><asset><mesh name="m" file="{file}"/></asset>
<worldbody><body><joint/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>"""
    path = written(tmp_path, text)
    robot = Robot.from_mjcf(path)
    assert robot.links[0].inertia.mass == mujoco.MjModel.from_xml_path(str(path)).body_mass[1]
    pytest.importorskip("trimesh", reason="no package that reads meshes is installed")
    assert len(RobotGeometry.from_description(robot).shapes) == 1


def test_included_files(tmp_path):
    (tmp_path / "parts").mkdir()
    head, _, tail = ARM.partition("  <default>")
    defaults, _, tail = tail.partition("</default>\n  <worldbody>")
    written(tmp_path, f"<mujocoinclude><default>{defaults}</default></mujocoinclude>", "parts/defaults.xml")
    written(tmp_path, '<x><include file="defaults.xml"/></x>', "parts/all.xml")
    text = f'{head}<include file="parts/all.xml"/><worldbody>{tail}'
    whole, parted = read(tmp_path, ARM), read(tmp_path, text)
    assert parted.parameters.tolist() == whole.parameters.tolist()
    assert parted.joints[1].damping == 0.5


def test_nothing_is_printed_or_left_behind(tmp_path, monkeypatch, capfd):
    """MuJoCo warns of settotalmass on standard output, and in a file in the current folder."""
    monkeypatch.chdir(tmp_path)
    robot = read(tmp_path, PAIR.format("<compiler settotalmass='7'/>"))
    assert sum(link.inertia.mass for link in robot.links) == pytest.approx(7.0, rel=1e-12)
    assert capfd.readouterr() == ("", "")
    assert [one.name for one in tmp_path.iterdir()] == ["robot.xml"]


ENTITIES = '<!DOCTYPE mujoco [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>\n<mujoco model="&b;"/>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ENTITIES, "it has a DOCTYPE declaration, which a description does not need"),
        ('<mujoco><include file="robot.xml"/></mujoco>', "line 1: 'robot.xml' is included a second time"),
        ('<mujoco><include file="../../none.xml"/></mujoco>', 'the included file "../../none.xml" leads out of'),
        ('<mujoco><include file="/dev/zero"/></mujoco>', 'the included file "/dev/zero" is not found'),
        ("<mujoco><include/></mujoco>", "<include> has no file"),
        ('<mujoco><include file="."/></mujoco>', r'the included file "\." is not found'),
        (
            ARM.replace('mass="2"', 'mass="nan"'),
            r"line 12: mass of <inertial> is 'nan', but no robot has such a number",
        ),
        (ARM.replace('pos="0 0 1"', 'pos="0 0 1e300"'), "line 11: pos of <body> is '0 0 1e300'"),
        (ARM.replace('damping="0.5"', 'damping="-inf"'), "line 5: damping of <joint> is '-inf'"),
        (ARM.replace('mass="2"', 'mass="2kg"'), "line 12: mass of <inertial> must be 1 number, got '2kg'"),
        (ARM.replace("fullinertia", "halfinertia"), "MuJoCo cannot compile it .*halfinertia"),
        (ARM[:400], "cannot be read as XML"),
        ("<mujoco>" + "<body>" * 400 + "</body>" * 400 + "</mujoco>", "nested more than 250 times"),
        ("<robot/>", "an MJCF begins with <mujoco>, found <robot>"),
        ("<mujoco/>", "no joint moves"),
        ("", "cannot be read as XML"),
    ],
)
def test_hostile_and_broken_files_are_refused_in_one_sentence(tmp_path, text, message):
    with pytest.raises(InputError, match=message) as told:
        read(tmp_path, text)
    assert "\n" not in str(told.value)
    assert len(str(told.value)) < 1000
