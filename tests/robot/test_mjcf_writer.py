"""Writing estimates into a copy of an MJCF, which MuJoCo then reads."""

from pathlib import Path

import numpy as np
import pytest

from steelyard.dynamics import Offset
from steelyard.errors import InputError
from steelyard.robot import Drives, Inertia, Robot
from steelyard.robot.mjcf_writer import write_mjcf

mujoco = pytest.importorskip("mujoco", reason="MuJoCo (extra `mjcf`) is not installed")

from described_robots import (  # noqa: E402
    difference_from_mujoco,
    difference_when_written,
    random_bodies,
    random_drives,
    with_rotors,
)
from mjcf_readings import EXACT  # noqa: E402
from random_mjcf import random_forest  # noqa: E402

pytestmark = pytest.mark.usefixtures("mujoco_in_this_process")

ARM = """<?xml version="1.0"?>
<!-- kept: Größe > 1 -->
<mujoco   model='arm' >
  <compiler angle="degree"/>
  <default>
    <joint damping="0.5"/>
    <default class="elbow"><joint armature="0.02" frictionloss="0.3"/></default>
  </default>
  <worldbody>
    <body name="stand"><geom size="0.2"/></body>
    <body name="upper" pos="0 0 1">
      <!-- weighed on the kitchen scale -->
      <inertial  pos='0.1 0 0' mass="2" quat="1 0.1 0 0"   diaginertia="0.2 0.3 0.25"/>
      <joint name="shoulder" axis="0 1 0"/>
      <body name="plate" pos="0.2 0 0"><geom type="box" size="0.1 0.1 0.1" mass="0.5"/></body>
      <body name="lower" pos="0.5 0 0" euler="0 90 0">
        <joint name="elbow" class="elbow" axis="0 0 1" damping='0.7'/>
        <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.05"/>
        <body name="hand" pos="0.4 0 0"><joint name="wrist" axis="1 0 0"/><geom size="0.03"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
BODY = Inertia.from_com(3.0, (0.2, -0.1, 0.05), [[0.3, 0.01, 0.02], [0.01, 0.4, 0.03], [0.02, 0.03, 0.5]])


def written(folder: Path, text: str, name: str = "robot.xml") -> Path:
    path = folder / name
    path.write_bytes(text.encode())
    return path


def known(robot: Robot, **values) -> Drives:
    return Drives.unknown(robot.dof).with_known(**values)


def own(robot: Robot) -> Drives:
    names = ("damping", "friction")
    return known(robot, **{name: [getattr(joint, name) for joint in robot.felt_joints] for name in names})


def test_only_what_changes_is_written(tmp_path):
    source, target = written(tmp_path, ARM), tmp_path / "out.xml"
    robot = Robot.from_mjcf(source, locked=["wrist"])
    parameters = np.array(robot.parameters)
    parameters[:10] = BODY.parameters
    write_mjcf(robot, parameters, known(robot, damping=[0.5, 0.25], rotor_inertia=[np.nan, 0.0]), source, target)
    old, new = ARM.splitlines(), target.read_text("utf-8").splitlines()
    changed = [(a, b) for a, b in zip(old, new, strict=True) if a != b]
    assert [a for a, _ in changed] == [old[12], old[14], old[16]]
    inertial, plate, elbow = [b for _, b in changed]
    assert inertial.startswith("      <inertial  pos='0.2")
    assert inertial.split('"')[2::2] == [" quat=", "   diaginertia=", "/>"]
    assert plate.replace(" ", "").startswith(
        '<bodyname="plate"pos="0.200"><inertialpos="000"mass="0"diaginertia="000"/><geom'
    )
    assert elbow == """        <joint name="elbow" class="elbow" axis="0 0 1" damping='0.25' armature="0.0"/>"""
    world = mujoco.MjModel.from_xml_path(str(target))
    assert world.dof_damping.tolist() == [0.5, 0.25, 0.5]
    assert world.dof_frictionloss.tolist() == [0.0, 0.3, 0.0]
    assert world.dof_armature.tolist() == [0.0, 0.0, 0.0]
    assert world.body("upper").mass[0] == 3.0
    assert source.read_bytes() == ARM.encode()


def test_a_copy_without_changes_is_the_same(tmp_path):
    source, target = written(tmp_path, ARM.replace("\n", "\r\n")), tmp_path / "out.xml"
    robot = Robot.from_mjcf(source)
    write_mjcf(robot, robot.parameters, own(robot), source, target)
    assert target.read_bytes() == source.read_bytes()


def test_mujoco_computes_with_the_parameters_that_were_written(tmp_path):
    source, target = written(tmp_path, ARM), tmp_path / "out.xml"
    robot = Robot.from_mjcf(source)
    assert difference_when_written(robot, source, target) < 1e-9
    again = Robot.from_mjcf(target)
    assert np.allclose(again.parameters, random_bodies(robot), rtol=1e-9, atol=1e-12)
    for name in ("damping", "friction", "rotor_inertia"):
        assert [getattr(joint, name) for joint in again.joints] == getattr(random_drives(robot, 1), name).tolist()


def test_offsets_stand_among_the_numbers_of_the_user(tmp_path):
    source, target, third = written(tmp_path, ARM), tmp_path / "out.xml", tmp_path / "third.xml"
    robot = Robot.from_mjcf(source)
    write_mjcf(robot, robot.parameters, known(robot, offset=[0.5, np.nan, -0.25]), source, target)
    world = mujoco.MjModel.from_xml_path(str(target))
    assert world.numeric("steelyard:offset:shoulder").data.tolist() == [0.5]
    assert world.numeric("steelyard:offset:wrist").data.tolist() == [-0.25]
    again = Robot.from_mjcf(target)
    write_mjcf(again, again.parameters, known(robot, offset=[0.5, np.nan, -0.25]), target, third)
    assert third.read_bytes() == target.read_bytes()
    write_mjcf(again, again.parameters, known(robot, offset=[0.75, np.nan, -0.25]), target, third)
    assert third.read_bytes() == target.read_bytes().replace(b'"0.5"/>\n    <numeric', b'"0.75"/>\n    <numeric')


@EXACT
def test_actuators_give_joints_armature_and_damping(tmp_path):
    """Each times its gear squared; the joint alone has what is written."""
    classes = ARM.replace("<default>", '<default><motor armature="0.002"/>', 1)
    motors = '<motor joint="shoulder" gear="-10"/><position joint="elbow" gear="5" armature="0.1" damping="0.3"/>'
    text = classes.replace("</mujoco>", f"<actuator>{motors}</actuator></mujoco>")
    source, target = written(tmp_path, text), tmp_path / "out.xml"
    robot = Robot.from_mjcf(source)
    assert [joint.rotor_inertia for joint in robot.joints] == pytest.approx([0.2, 2.52, 0.0])
    assert [joint.damping for joint in robot.joints] == pytest.approx([0.5, 0.7 + 0.3 * 25, 0.5])
    assert "The rotor inertia of shoulder, elbow is that of the joint and of its actuators." in robot.remarks
    assert "The damping of elbow is that of the joint and of its actuators." in robot.remarks
    assert difference_when_written(robot, source, target) < 1e-9
    written_drives = random_drives(robot, 1)
    again = mujoco.MjModel.from_xml_path(str(target))
    np.testing.assert_allclose(again.dof_armature, written_drives.rotor_inertia)
    assert not again.actuator_armature.any()
    assert not again.actuator_damping.any()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 33))
def test_random_trees(tmp_path, seed):
    """With several joints a body, and settings of the compiler that change inertias."""
    source = random_forest(tmp_path, seed)
    robot = Robot.from_mjcf(source)
    assert difference_when_written(robot, source, tmp_path / "out.xml", seed) < 1e-9
    same = tmp_path / "same.xml"
    write_mjcf(robot, robot.parameters, own(robot), source, same)
    assert same.read_bytes() == source.read_bytes()


THREE = """<mujoco><worldbody>
  <body name="ball" pos="0 0 1" gravcomp="0" childclass="soft">
    <geom size="0.1"/>
    <joint name="x" axis="1 0 0" ref="10"/>
    <joint name="y" axis="0 1 0" pos="0 0 0.2"/>
    <joint name="z" axis="0 0 1" range="-10 20"/>
    <body name="tip" pos="0.3 0 0"><joint name="slide" type="slide"/><geom size="0.05"/></body>
  </body>
</worldbody>
<default><default class="soft"><joint damping="0.2"/></default></default>
<sensor><framepos objtype="body" objname="ball"/></sensor></mujoco>
"""


def test_a_body_between_two_joints_is_added(tmp_path):
    source, target = written(tmp_path, THREE), tmp_path / "out.xml"
    robot = Robot.from_mjcf(source)
    assert robot.link_names == ("ball_x", "ball_y", "ball", "tip")
    assert difference_when_written(robot, source, target) < 1e-9
    assert Robot.from_mjcf(target).link_names == robot.link_names
    # A body is added where there is mass alone.
    parameters = random_bodies(robot)
    parameters[:10] = 0.0
    write_mjcf(robot, parameters, own(robot), source, target)
    world = mujoco.MjModel.from_xml_path(str(target))
    assert world.nbody == 4
    assert [world.joint(k).name for k in range(4)] == ["x", "y", "z", "slide"]
    assert difference_from_mujoco(target, robot, with_rotors(robot, parameters, np.zeros(4))) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    "compiler",
    ['settotalmass="9"', 'inertiafromgeom="true"', 'boundmass="5" boundinertia="1"', 'balanceinertia="true"'],
)
def test_settings_of_the_compiler_do_not_change_what_is_written(tmp_path, compiler):
    source, target = (
        written(tmp_path, ARM.replace('angle="degree"', f'angle="degree" {compiler}')),
        tmp_path / "out.xml",
    )
    robot = Robot.from_mjcf(source, locked=["wrist"])
    hand = Robot.from_mjcf(source, tip="hand").links[2].inertia.parameters
    held = robot.links[1].attachments[0]
    parameters = random_bodies(robot)
    parameters[10:20] += held.inertia.moved(held.placement).parameters
    write_mjcf(robot, parameters, known(robot), source, target)
    again = Robot.from_mjcf(target, locked=["wrist"])
    assert np.allclose(again.parameters, parameters, rtol=1e-9, atol=1e-12)
    assert np.allclose(Robot.from_mjcf(target).links[2].inertia.parameters, hand, rtol=1e-9, atol=1e-12)


def test_a_locked_body_heavier_than_the_estimate_keeps_a_part(tmp_path):
    source, target = written(tmp_path, ARM), tmp_path / "out.xml"
    robot = Robot.from_mjcf(source, locked=["wrist"])
    parameters = random_bodies(robot)
    parameters[10:20] *= 0.01
    write_mjcf(robot, parameters, known(robot), source, target)
    assert np.allclose(Robot.from_mjcf(target, locked=["wrist"]).parameters, parameters, rtol=1e-9, atol=1e-12)
    model, before = (mujoco.MjModel.from_xml_path(str(path)) for path in (target, source))
    hand = model.body("hand").id
    share = model.body_mass[hand] / before.body_mass[hand]
    assert 0.0 < share < 1.0
    assert np.allclose(model.body_inertia[hand], share * before.body_inertia[hand], rtol=1e-9)


def test_offsets_are_read_again(tmp_path):
    source, target, again = written(tmp_path, ARM), tmp_path / "out.xml", tmp_path / "again.xml"
    robot = Robot.from_mjcf(source)
    write_mjcf(robot, robot.parameters, known(robot, offset=[0.5, np.nan, -0.25]), source, target)
    offsets = [joint.torque_offset for joint in Robot.from_mjcf(target).joints]
    assert np.array_equal(offsets, [0.5, np.nan, -0.25], equal_nan=True)
    nominal = Robot.from_mjcf(target).with_terms(Offset()).parameters[10::11]
    assert np.array_equal(nominal, offsets, equal_nan=True)
    again.write_text(target.read_text("utf-8").replace('data="-0.25"', 'data="-0.25 1"'), encoding="utf-8")
    with pytest.raises(InputError, match=r"data of 'steelyard:offset:wrist' must be one finite number, got '-0\.25 1'"):
        Robot.from_mjcf(again)


def test_moments_that_mujoco_refuses_are_not_written_as_others(tmp_path):
    """As estimates have them that are consistent in their inertia alone."""
    source, target = written(tmp_path, ARM), tmp_path / "out.xml"
    robot = Robot.from_mjcf(source)
    parameters = random_bodies(robot)
    parameters[:10] = Inertia.from_com(1.0, (0.1, 0.2, 0.3), np.diag([0.1, 0.1, 0.3])).parameters
    with pytest.raises(InputError, match=r'body "upper": .* 0\.1, 0\.1, 0\.3 kg·m², .* the consistency "full"'):
        write_mjcf(robot, parameters, known(robot), source, target)
    assert not target.exists()


def test_an_inertia_on_the_bound_of_what_is_possible(tmp_path):
    """MuJoCo refuses a moment that exceeds the sum of the two others by whatever little."""
    source, target = written(tmp_path, ARM), tmp_path / "out.xml"
    robot = Robot.from_mjcf(source)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    flat = Inertia.from_com(1.0, (0.1, 0.2, 0.3), turn @ np.diag([0.1, 0.2, 0.3]) @ turn.T)
    rod = Inertia.from_com(1e-3, (0.0, 0.0, 0.3), turn @ np.diag([1e-7, 1e-7, 0.0]) @ turn.T)
    point = Inertia.from_com(1e-3, (0.0, 0.0, 0.3), np.zeros((3, 3)))
    parameters = np.concatenate([one.parameters for one in (flat, rod, point)])
    write_mjcf(robot, parameters, known(robot), source, target)
    assert difference_from_mujoco(target, robot, with_rotors(robot, parameters, [0.0, 0.02, 0.0])) < 1e-9


def parted(folder: Path) -> Path:
    """The arm with its parts in included files, one of them in another folder."""
    (folder / "parts").mkdir(parents=True)
    head, _, tail = ARM.partition('    <body name="upper"')
    body, _, end = f'    <body name="upper"{tail}'.partition("  </worldbody>")
    defaults = head[head.index("  <default>") : head.index("  <worldbody>")]
    written(folder, f"<x>{defaults}</x>", "parts/defaults.xml")
    written(folder, f"<x>\n{body}</x>", "parts/upper.xml")
    text = head.replace(defaults, '  <include file="parts/defaults.xml"/>\n')
    return written(folder, f'{text}    <include file="parts/upper.xml"/>\n  </worldbody>{end}')


@pytest.mark.parametrize("elsewhere", [False, True])
def test_included_files(tmp_path, elsewhere):
    source = parted(tmp_path / "arm")
    target = (tmp_path if elsewhere else source.parent) / "out.xml"
    robot = Robot.from_mjcf(source)
    assert difference_when_written(robot, source, target) < 1e-9
    text = target.read_text("utf-8")
    assert "<!-- weighed on the kitchen scale -->" in text
    assert text.count("<include") == 1
    assert ('<include file="parts/defaults.xml"/>' in text) == (not elsewhere)
    same = tmp_path / "same.xml"
    write_mjcf(robot, robot.parameters, own(robot), source, same)
    assert same.read_bytes() == source.read_bytes()


@pytest.mark.slow
def test_meshes_are_found_from_another_folder(tmp_path):
    (tmp_path / "arm" / "meshes").mkdir(parents=True)
    text = ARM.replace("  <default>", '  <asset><mesh file="a.obj"/></asset>\n  <default>', 1)
    text = text.replace('<geom size="0.03"/>', '<geom type="mesh" mesh="a"/>').replace(
        'angle="degree"', 'meshdir="meshes"'
    )
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "arm" / "meshes" / "a.obj").write_text(corners)
    source, target = written(tmp_path / "arm", text), tmp_path / "out.xml"
    robot = Robot.from_mjcf(source)
    assert difference_when_written(robot, source, target) < 1e-9
    bare = text.replace('meshdir="meshes"', 'angle="radian"').replace("a.obj", "meshes/a.obj")
    source = written(tmp_path / "arm", bare.replace('  <compiler angle="radian"/>\n', ""))
    assert difference_when_written(Robot.from_mjcf(source), source, target) < 1e-9


def test_damping_that_the_compiler_makes_of_a_spring(tmp_path):
    text = ARM.replace('<joint damping="0.5"/>', '<joint springdamper="0.1 1"/>')
    source, target = written(tmp_path, text), tmp_path / "out.xml"
    robot = Robot.from_mjcf(source)
    before = mujoco.MjModel.from_xml_path(str(source))
    assert before.jnt_stiffness.min() > 0.0
    write_mjcf(robot, random_bodies(robot), known(robot, damping=[0.1, np.nan, 0.3]), source, target)
    world = mujoco.MjModel.from_xml_path(str(target))
    assert world.dof_damping[[0, 2]].tolist() == [0.1, 0.3]
    assert world.jnt_stiffness[[0, 2]].tolist() == before.jnt_stiffness[[0, 2]].tolist()


def test_coupled_joints_share_what_is_written(tmp_path):
    equality = '<equality><joint joint1="wrist" joint2="elbow" polycoef="0 2 0 0 0"/></equality>'
    equality = '<equality><joint joint1="wrist" joint2="elbow" polycoef="0 2 0 0 0"/></equality>'
    coupled = ARM.replace("</worldbody>", f"</worldbody>{equality}")
    source, target = written(tmp_path, coupled), tmp_path / "out.xml"
    robot = Robot.from_mjcf(source)
    assert difference_when_written(robot, source, target) < 1e-9
    world = mujoco.MjModel.from_xml_path(str(target))
    assert world.dof_damping[2] == world.dof_armature[2] == 0.0
    write_mjcf(robot, robot.parameters, own(robot), source, target)
    assert target.read_bytes() == source.read_bytes()


REPLICATED = """<mujoco><worldbody><replicate count="2" offset="0 1 0">
<body name="a"><joint name="j"/><geom size="0.1"/></body></replicate></worldbody></mujoco>"""


def test_what_cannot_be_written_is_refused(tmp_path):
    source, target = written(tmp_path, ARM), tmp_path / "out.xml"
    robot = Robot.from_mjcf(source)
    good = random_bodies(robot)
    with pytest.raises(InputError, match=r'joint "elbow": its rotor inertia is -1'):
        write_mjcf(robot, good, known(robot, rotor_inertia=[1, -1, 1]), source, target)
    with pytest.raises(InputError, match="this is the MJCF that was read"):
        write_mjcf(robot, good, known(robot), source, source)
    with pytest.raises(InputError, match='link "upper": its mass is 0 kg'):
        write_mjcf(robot, np.concatenate([np.zeros(10), good[10:]]), known(robot), source, target)
    other = written(tmp_path, ARM.replace("elbow", "knee"), "other.xml")
    with pytest.raises(InputError, match=r'other\.xml: it has no joint "elbow"'):
        write_mjcf(robot, good, known(robot), other, target)
    copies = written(tmp_path, REPLICATED, "copies.xml")
    robot = Robot.from_mjcf(copies)
    assert robot.dof == 2
    with pytest.raises(InputError, match=r'the body "a0" is a copy that MuJoCo makes'):
        write_mjcf(robot, random_bodies(robot), known(robot), copies, target)
    assert not target.exists()


def test_names_in_any_script(tmp_path):
    text = THREE.replace('"ball"', '"Kugel &amp; größe"')
    source, target = written(tmp_path, text), tmp_path / "out.xml"
    robot = Robot.from_mjcf(source)
    assert difference_when_written(robot, source, target) < 1e-9
    assert Robot.from_mjcf(target).link_names == robot.link_names
