"""Our own reading of MJCF, without MuJoCo, beside what MuJoCo compiles."""

import sys

import pytest
from mjcf_readings import EXACT, differences, readings
from random_mjcf import random_forest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.robot import Robot

pytestmark = pytest.mark.usefixtures("mujoco_in_this_process")

NESTED = """<mujoco model="nested"><compiler angle="radian" eulerseq="ZyX" autolimits="true"/>
<default><joint damping="1" armature="0.1"/><geom density="500" type="capsule" size="0.05 0.1" euler="0.1 0.2 0.3"/>
 <general gainprm="7"/><equality active="false"/>
 <default class="a"><joint frictionloss="0.5" range="-1 1"/><geom size="0.07" zaxis="1 1 0"/><position kp="30"/>
  <default class="b"><joint damping="2" type="slide"/><geom type="box" size="0.1 0.2 0.3" quat="1 1 0 0"/></default>
 </default>
 <default class="c"><joint actuatorfrcrange="-5 6" limited="false"/><geom mass="0"/></default>
</default>
<default><joint damping="9"/></default>
<worldbody><body name="base" childclass="a" pos="0 0 1" axisangle="1 1 0 0.3"><joint name="one"/><geom/>
 <frame pos="0.1 0.2 0.3" euler="0.3 0.2 0.1" childclass="b"><body name="tip" xyaxes="0 1 0 1 1 0">
  <joint name="two" axis="1 1 1" pos="0.1 0 0" ref="0.2"/><geom/><geom class="a" fromto="0 0 0 0.1 0.2 0.3"/>
  <geom class="c" type="mesh" mesh="absent" density="0"/>
  <frame zaxis="0 1 1"><joint name="three" class="c" axis="0 1 0" pos="0 0.1 0"/>
   <geom type="cylinder" size="0.1 0.1"/></frame>
  <body name="end" mocap="false" gravcomp="0.5"><joint name="four" class="main" stiffness="3 0.1" damping="0.1 0.2"/>
  <inertial pos="0.1 0 0" euler="0.1 0 0" mass="2" diaginertia="0.1 0.2 0.25"/><geom type="ellipsoid" size="1 2 3"/>
  </body></body></frame></body>
 <body name="thing" pos="1 0 0"><freejoint name="free"/><geom type="sphere" mass="3"/></body></worldbody>
<tendon><fixed name="t"><joint joint="one" coef="1"/><joint joint="two" coef="2"/></fixed></tendon>
<equality><joint name="e" joint1="one" joint2="two" polycoef="0.1 2" active="true"/><weld body1="thing"/></equality>
<actuator><position name="p" joint="one" class="a"/><motor joint="two" gear="3"/><general joint="three"/>
<velocity joint="four" kv="2"/><motor tendon="t"/><position joint="one"/></actuator></mujoco>"""
SETTINGS = (
    '<compiler settotalmass="20"/>',
    '<compiler boundmass="1" boundinertia="0.4"/>',
    '<compiler inertiafromgeom="true" inertiagrouprange="0 1"/>',
    '<compiler balanceinertia="true"/>',
    '<option gravity="0 1 -5"/><option><flag gravity="disable"/></option>',
)


@pytest.fixture
def without_mujoco(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)


def written(folder, text, name="robot.xml"):
    (folder / name).write_text(text)
    return folder / name


def read(folder, text, **options):
    return Robot.from_mjcf(written(folder, text), **options)


@EXACT
@pytest.mark.parametrize("settings", ["", *SETTINGS])
def test_classes_frames_and_settings_come_to_what_mujoco_makes_of_them(tmp_path, settings):
    document, ours, theirs = readings(
        written(tmp_path, NESTED.replace("<default><joint damp", f"{settings}<default><joint damp", 1))
    )
    assert not isinstance(ours, Exception), ours
    assert not isinstance(theirs, Exception), theirs
    assert differences(document, ours, theirs) == []


@EXACT
def test_what_actuators_weigh_is_read_as_mujoco_reads_it(tmp_path):
    weighing = NESTED.replace("<default>", '<default><motor armature="0.1" damping="0.2 0 0.3"/>', 1)
    weighing = weighing.replace('kv="2"/>', 'kv="2" armature="0.7"/>').replace(
        '<fixed name="t"', '<fixed name="t" armature="2"'
    )
    document, ours, theirs = readings(written(tmp_path, weighing))
    assert not isinstance(theirs, Exception), theirs
    assert differences(document, ours, theirs) == []
    assert ours.of_actuators(1) == pytest.approx({"armature": 0.9, "damping": 1.8})


def test_motors_that_are_not_read_are_told(tmp_path, without_mujoco):
    text = NESTED.replace("<actuator>", '<actuator><dcmotor joint="one" motorconst="0.1" armature="0.2"/>')
    assert "the motors (dcmotor) of one, with their armature and damping" in " ".join(
        read(tmp_path, text, locked=["free"]).remarks
    )


@EXACT
@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 17))])
def test_random_trees_come_to_what_mujoco_makes_of_them(tmp_path, seed):
    document, ours, theirs = readings(random_forest(tmp_path, seed))
    assert differences(document, ours, theirs) == []


def test_a_common_file_is_read_and_written_without_mujoco(tmp_path, without_mujoco):
    from steelyard.robot import Drives
    from steelyard.robot.mjcf_writer import write_mjcf

    robot = read(tmp_path, NESTED, locked=["free"])
    assert robot.joint_names == ("two", "three", "four")
    assert [joint.mimics for joint in robot.joints] == ["two", None, None, None]
    heavier, target = 1.25 * robot.parameters, tmp_path / "other.xml"
    write_mjcf(robot, heavier, Drives.unknown(3), tmp_path / "robot.xml", target)
    assert Robot.from_mjcf(target, locked=["free"]).parameters == pytest.approx(heavier)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('type="sphere"', 'type="mesh" mesh="m"'), r"line \d+: an inertia that follows from a mesh is read with the"),
        (('<geom type="sphere"', '<replicate count="2"/><geom type="sphere"'), "<replicate> is read with the package"),
        (('type="sphere"', 'type="sphere" shellinertia="true"'), "the inertia of a shell is read with"),
        (('mass="3"', 'mas="3"'), "the attribute mas of <geom> is read with the package mujoco"),
        (('name="one"', 'name="one" springdamper="1 1"'), "a springdamper, whose damping"),
    ],
)  # fmt: skip
def test_what_takes_mujoco_names_the_extra(tmp_path, without_mujoco, change, message):
    with pytest.raises(sy.MissingExtraError, match=message) as told:
        read(tmp_path, NESTED.replace(*change))
    assert "pip install 'mujoco>=" in str(told.value)
    assert str(tmp_path / "robot.xml") in str(told.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('class="b">', 'class="a">'), 'line 5: the default class "a" was already there'),
        (('<default class="b">', "<default>"), "line 5: a <default> within another one has no class"),
        (('class="c" axis', 'class="cc" axis'), 'there is no default class "cc"; did you mean "c"'),
        (('childclass="b"', 'childclass="bb"'), 'there is no default class "bb"'),
        (('name="two"', 'name="one"'), 'two joints have the name "one"'),
        (('axis="1 1 1"', 'axis="0 0 0"'), "line 12: the axis of a joint is '0 0 0'"),
        (('axis="1 1 1"', 'axis="1 1"'), "axis of <joint> must be 3 numbers, got '1 1'"),
        (('size="0.1 0.1"', 'size="0.1 -0.1"'), "the size of a cylinder is 0.1 -0.1"),
        (('type="cylinder"', 'type="cone"'), "the type of a geom is one of .* got 'cone'"),
        (('range="-1 1"', 'range="1 -1"'), "the lower limit 1 is not below the upper limit -1"),
        (('zaxis="0 1 1"', 'zaxis="0 1 1" euler="0 0 1"'), "<frame> has euler and zaxis; keep one"),
        (('quat="1 1 0 0"', 'quat="0 0 0 0"'), "quat of <geom> has no direction"),
        (('eulerseq="ZyX"', 'eulerseq="abc"'), "eulerseq must be three of x, y, z"),
        (('angle="radian"', 'angle="grad"'), "angle of <compiler> must be degree or radian"),
        (('joint2="two"', 'joint2="too"'), 'joint2 of <joint> names "too", which is not there; did you mean "two"'),
        (("<freejoint", '<joint type="hinge"/><freejoint'), "a free joint is the only joint of a body in the world"),
        (('mass="3"', 'mass="-3"'), "a geom weighs less than nothing"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_line(tmp_path, without_mujoco, change, message):
    text = NESTED.replace(*change)
    assert text != NESTED
    with pytest.raises(InputError, match=message) as told:
        read(tmp_path, text, locked=["free"])
    assert "\n" not in str(told.value)
    assert not isinstance(told.value, sy.MissingExtraError)


def test_an_impossible_body_is_read_and_inspect_finds_it(tmp_path, without_mujoco):
    """MuJoCo refuses such files as a whole; here the link is named."""
    from steelyard.identification.preflight import preflight

    text = NESTED.replace('diaginertia="0.1 0.2 0.25"', 'diaginertia="0.1 0.2 2.5"')
    found = {one.link: one for one in preflight(read(tmp_path, text, locked=["free"])).links}
    assert [name for name, one in found.items() if not one.possible] == ["end"]


@pytest.mark.slow
def test_many_bodies_are_read(tmp_path, without_mujoco):
    body = '<body name="b{0}"><joint name="j{0}"/><geom size="0.1"/></body>'
    text = f"<mujoco><worldbody>{''.join(map(body.format, range(5_000)))}</worldbody></mujoco>"
    from steelyard.robot.mjcf_tree import read_mjcf_tree

    assert len(read_mjcf_tree(written(tmp_path, text)).tree.joints) == 5_000


BODY = '<body name="a"><joint/><geom size="0.1"/>{}</body>'
MANY = {
    "replicate": BODY.format('<replicate count="1000000000" offset="0 0 1"><geom size="0.1"/></replicate>'),
    "an empty one": BODY.format('<replicate count="1000000000" offset="0 0 1"/>'),
    "replicates in each other": BODY.format(
        6 * '<replicate count="100" offset="0 0 1">' + '<geom size="0.1"/>' + 6 * "</replicate>"
    ),
    "many replicates": BODY.format(300 * '<replicate count="100" offset="0 0 1"><geom size="0.1"/></replicate>'),
    "composite": BODY.format("")
    + '<composite type="cable" curve="s" count="1000000000 1 1" size="1"><geom type="capsule" size=".01"/></composite>',
    "flexcomp": BODY.format(
        '<flexcomp type="grid" name="f" count="1000 1000 1000" spacing=".1 .1 .1" dim="3" mass="1"/>'
    ),
}


@pytest.mark.parametrize("bodies", MANY.values(), ids=MANY)
def test_more_copies_than_a_robot_has_are_refused_before_they_are_made(tmp_path, bodies):
    """MuJoCo would take 60 s, after which it is stopped and another sentence is said."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    with pytest.raises(InputError, match=r"line 1: with <\w+> the elements of the file become more than 20000 copies"):
        read(tmp_path, f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")


def test_models_that_attach_each_other_many_times_are_refused_before_they_are_made(tmp_path):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    for k in range(8):
        attached = "".join(f'<attach model="m{k + 1}" body="a" prefix="p{n}_"/>' for n in range(10))
        (tmp_path / f"m{k}.xml").write_text(
            f'<mujoco model="m{k}"><asset><model name="m{k + 1}" file="m{k + 1}.xml"/></asset>'
            f"<worldbody>{BODY.format(attached)}</worldbody></mujoco>"
        )
    (tmp_path / "m8.xml").write_text(f'<mujoco model="m8"><worldbody>{BODY.format("")}</worldbody></mujoco>')
    with pytest.raises(InputError, match=r"m[34].xml, line 1: with <attach> the elements of the file become more than"):
        Robot.from_mjcf(tmp_path / "m0.xml")
    assert Robot.from_mjcf(tmp_path / "m7.xml").dof == 11


def test_copies_that_a_robot_has_are_read(tmp_path):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    fingers = '<replicate count="5" euler="0 0 1"><body><joint axis="0 1 0"/><geom size="0.1"/></body></replicate>'
    assert read(tmp_path, f"<mujoco><worldbody>{BODY.format(fingers)}</worldbody></mujoco>").dof == 6
