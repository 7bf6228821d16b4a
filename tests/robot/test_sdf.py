"""The reader of SDF: what it takes, what it refuses, and hostile files."""

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.robot import Robot, RobotFile

HINGE = """<joint name="hinge" type="revolute"><parent>a</parent><child>b</child><axis><xyz>0 1 0</xyz>
<limit><lower>-1e16</lower><upper>2</upper><effort>-1</effort><velocity>3</velocity></limit>
<dynamics><damping>0.2</damping><spring_stiffness>5</spring_stiffness></dynamics></axis></joint>"""
DOOR = f'<model name="door"><link name="a"/><link name="b"><pose>1 0 0 0 0 0</pose></link>{HINGE}</model>'


def read(tmp_path, body, version="1.7", **options):
    path = tmp_path / "robot.sdf"
    path.write_text(f'<sdf version="{version}">{body}</sdf>')
    return Robot.from_sdf(path, **options)


def test_what_a_joint_says(tmp_path):
    robot = read(tmp_path, DOOR)
    (joint,) = robot.joints
    assert (joint.lower, joint.upper, joint.velocity_limit, joint.effort_limit) == (-np.inf, 2.0, 3.0, np.inf)
    assert joint.damping == 0.2
    assert np.isnan(joint.friction)
    assert "spring of 5 N m/rad" in robot.remarks[0]
    # What the format gives to a link without inertial.
    assert robot.links[0].inertia.parameters.tolist() == [1, 0, 0, 1, 0, 1, 0, 0, 0, 1]


def test_a_mimic_and_a_locked_joint(tmp_path):
    more = """<link name="c"/><joint name="follow" type="prismatic"><parent>b</parent><child>c</child><axis>
    <mimic joint="hinge"><multiplier>2</multiplier><offset>0.5</offset><reference>0.1</reference></mimic>
    </axis></joint></model>"""
    text = DOOR.replace("</model>", more)
    joint = read(tmp_path, text, "1.11").joints[1]
    assert (joint.mimics, joint.multiplier, joint.offset) == ("hinge", 2.0, 0.3)
    assert read(tmp_path, text.replace("<mimic", "<x").replace("</mimic", "</x"), locked={"hinge": 0.2}).dof == 1


def test_gravity_is_that_of_the_world_in_the_frame_of_the_root(tmp_path):
    tilted = DOOR.replace('<link name="a"/>', '<link name="a"/><pose>0 0 0 1.5707963267948966 0 0</pose>', 1)
    floor = "<model name='floor'><static>1</static><link name='x'/></model>"
    world = f"<world name='w'><gravity>0 0 -3.7</gravity>{{}}{floor}</world>"
    robot = read(tmp_path, world.format(tilted))
    assert np.allclose(robot.gravity, [0, -3.7, 0], atol=1e-12)
    assert any("floor" in remark for remark in robot.remarks)
    held = '<joint name="hold" type="fixed"><parent>world</parent><child>a</child></joint></model>'
    robot = read(tmp_path, world.format(tilted.replace("</model>", held)))
    assert robot.base_link == "world"
    assert robot.gravity.tolist() == [0, 0, -3.7]
    assert read(tmp_path, world.format(tilted), gravity=(0, 0, -1)).gravity.tolist() == [0, 0, -1]


def test_the_format_is_known_by_its_root(tmp_path):
    for name in ("door.sdf", "door.world", "door.xml"):
        (tmp_path / name).write_text(f'<?xml version="1.0"?><!-- <robot/> -->\n<sdf version="1.6">{DOOR}</sdf>')
        assert RobotFile.load(tmp_path / name).robot.joint_names == ("hinge",)
    (tmp_path / "robot.toml").write_text('[description]\nfile = "door.sdf"\ngravity = [0, 0, -2]\n')
    assert RobotFile.load(tmp_path / "robot.toml").robot.gravity.tolist() == [0, 0, -2]


def changed(old, new):
    assert old in DOOR
    return DOOR.replace(old, new)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("", "it describes no model; give an SDF of a robot"),
        ('<model name="m"><link name="a"/></model>', "no model with a joint that moves"),
        (DOOR + DOOR.replace('"door"', '"gate"'), r"2 robots \(door, gate\); keep one"),
        (DOOR + DOOR, 'the name "door" was already given to a model on line 1'),
        (changed('"revolute"', '"ball"'), '"hinge" is of type "ball".*three degrees of freedom.*lock it'),
        (changed('"revolute"', '"universal"'), "two degrees of freedom"),
        (changed('"revolute"', '"screw"'), "turns and slides"),
        (changed('"revolute"', '"gearbox"'), "closes a loop"),
        (changed('"revolute"', '"revolut"'), 'did you mean "revolute"'),
        (changed("<child>b", "<child>c"), r'line 1: there is no link, joint or frame "c"'),
        (changed("<child>b", "<child>world"), "the world cannot be its child"),
        (changed("0 1 0", "0 0 0"), 'its axis is "0 0 0"'),
        (changed("0 1 0", "0 nan 0"), r"the text of <xyz> must be 3 numbers, finite, got '0 nan 0'"),
        (changed("1 0 0 0 0 0", "1 0 0 0 0"), "the text of <pose> must be 6 numbers"),
        (changed("<pose>", '<pose relative_to="hinge">'), "are placed in each other"),
        (changed("<pose>", '<pose frame="a">'), "in the manner of version 1.6"),
        (changed("<pose>", '<pose rotation_format="deg">'), "rotation_format must be"),
        (changed("<lower>-1e16", "<lower>5"), "above its upper limit"),
        (changed('<link name="a"/>', '<link name="a"/><include/>'), "has no <uri>"),
        (
            changed('<link name="a"/>', '<link name="a"/><include><uri>model://no-such-model</uri></include>'),
            "is not found",
        ),
        (changed('<link name="a"/>', "<link/>"), "a link has no name"),
        (
            changed('<link name="a"/>', '<link name="a"/><include><uri>model://../x</uri></include>'),
            "leads out of its package",
        ),
        (
            changed(
                '<link name="a"/>', '<link name="a"/><frame name="f" attached_to="g"/><frame name="g" attached_to="f"/>'
            ).replace("<child>b", "<child>f"),
            "are placed in each other",
        ),
    ],
)
def test_what_is_refused(tmp_path, body, message):
    with pytest.raises(InputError, match=message):
        read(tmp_path, body)


@pytest.mark.parametrize("version", ["1.3", "1.99", "2.0", "", "x"])
def test_versions_that_are_not_known_are_refused(tmp_path, version):
    with pytest.raises(InputError, match=r"versions 1\.4 to 1\.12 of SDF can be read"):
        read(tmp_path, DOOR, version)


def test_files_that_include_each_other(tmp_path):
    for one, other in (("p", "q"), ("q", "p")):
        (tmp_path / f"{one}.sdf").write_text(
            f'<sdf version="1.9"><model name="{one}"><include><uri>{other}.sdf</uri></include></model></sdf>'
        )
    with pytest.raises(InputError, match=r"includes itself \(p.sdf -> q.sdf -> p.sdf\)"):
        Robot.from_sdf(tmp_path / "p.sdf")
    # Two of each other are two to the power of their number.
    for k in range(30):
        uri = f"<uri>m{k + 1}.sdf</uri>"
        twice = "".join(f"<include><name>{side}</name>{uri}</include>" for side in "lr") if k < 29 else ""
        (tmp_path / f"m{k}.sdf").write_text(f'<sdf version="1.9"><model name="m">{twice}</model></sdf>')
    with pytest.raises(InputError, match="more than 200 files are included"):
        Robot.from_sdf(tmp_path / "m0.sdf")


@pytest.mark.slow
def test_a_large_file_is_not_included_many_times(tmp_path):
    """A hundred times eight megabytes took minutes."""
    frames = "".join(f'<frame name="f{k}"/>' for k in range(20_000))
    (tmp_path / "part.sdf").write_text(
        f'<sdf version="1.9"><model name="part"><link name="l"/><!-- {"x" * 3_000_000} -->{frames}</model></sdf>'
    )
    for count, told in ((2, "no model with a joint that moves"), (4, r"that are included have more than 10 MB")):
        parts = "".join(f"<include><uri>part.sdf</uri><name>p{k}</name></include>" for k in range(count))
        (tmp_path / "all.sdf").write_text(f'<sdf version="1.9"><model name="m"><link name="l"/>{parts}</model></sdf>')
        with pytest.raises(InputError, match=told):
            Robot.from_sdf(tmp_path / "all.sdf")


def test_bombs_of_entities(tmp_path):
    path = tmp_path / "bomb.sdf"
    path.write_text('<!DOCTYPE sdf [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><sdf version="1.9">&b;</sdf>')
    with pytest.raises(InputError, match="DOCTYPE"):
        Robot.from_sdf(path)
