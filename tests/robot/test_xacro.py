"""Xacro: expanded without ROS, with arguments and packages, and in spite of hostile files."""

import sys

import numpy as np
import pytest
from child_programs import run_here

from steelyard.errors import InputError, MissingExtraError
from steelyard.robot import Robot, RobotFile, write_urdf, xacro
from steelyard.robot.xacro import _Expansion, expand_xacro

pytest.importorskip("xacro", reason="xacro (pip install 'steelyard[xacro]') is not installed")

HEAD = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
ARM = (
    HEAD
    + """
  <xacro:arg name="reach" default="0.5"/>
  <xacro:arg name="load" default="false"/>
  <xacro:include filename="$(find parts)/urdf/link.xacro"/>
  <link name="base"/>
  <xacro:body name="upper" mass="${2 * 1.5}" length="$(arg reach)"/>
  <xacro:if value="$(arg load)"><xacro:body name="load" mass="1" length="0.1"/></xacro:if>
  <joint name="one" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
  <xacro:if value="$(arg load)">
    <joint name="two" type="revolute"><parent link="upper"/><child link="load"/>
      <origin xyz="$(arg reach) 0 0"/></joint>
  </xacro:if>
</robot>"""
)
PART = (
    HEAD
    + """
  <xacro:macro name="body" params="name mass length">
    <link name="${name}"><!-- a rod --><inertial><origin xyz="${length / 2} 0 0"/><mass value="${mass}"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="${mass * length**2 / 12}" iyz="0" izz="${mass * length**2 / 12}"/>
    </inertial></link>
  </xacro:macro>
</robot>"""
)


@pytest.fixture
def arm(tmp_path, monkeypatch):
    for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(name, raising=False)
    for name, text in (("arm/urdf/arm.urdf.xacro", ARM), ("parts/urdf/link.xacro", PART)):
        path = tmp_path / name
        path.parent.mkdir(parents=True)
        path.write_text(text)
    return tmp_path / "arm" / "urdf" / "arm.urdf.xacro"


def test_a_xacro_is_expanded(arm):
    robot = Robot.from_urdf(arm)
    assert robot.joint_names == ("one",)
    assert robot.links[0].inertia.mass == 3.0
    assert robot.links[0].inertia.com[0] == 0.25
    assert "was expanded; what is identified is written as plain URDF" in robot.remarks[0]
    robot = Robot.from_urdf(arm, xacro_arguments={"reach": "0.8", "load": "true"})
    assert robot.joint_names == ("one", "two")
    assert robot.joints[1].before[0, 3] == 0.8
    assert "with reach = 0.8, load = true" in robot.remarks[0]
    # A .urdf with elements of xacro in it.
    plain = arm.with_name("arm.urdf")
    plain.write_text(ARM)
    assert Robot.from_urdf(plain).links[0].inertia.mass == 3.0


def test_arguments_from_robot_toml_and_from_the_command_line(arm, run):
    toml = arm.with_name("robot.toml")
    toml.write_text(
        '[description]\nurdf = "arm.urdf.xacro"\nxacro_arguments = { reach = 0.8, load = true }\nlocked = ["two"]\n'
    )
    file = RobotFile.load(toml)
    assert file.robot.joint_names == ("one",)
    assert file.robot.links[0].inertia.mass == 4.0
    assert file.description["xacro_arguments"] == {"reach": "0.8", "load": "true"}
    assert RobotFile.load(f"{arm} load:=true reach:=0.3").robot.joints[1].before[0, 3] == 0.3
    _, out, err = run("inspect", f"{arm} load:=true")
    assert "arm: 2 joints" in out, err
    toml.write_text('[description]\nurdf = "plain.urdf"\nxacro_arguments = { a = 1 }\n')
    arm.with_name("plain.urdf").write_text('<robot name="r"><link name="a"/></robot>')
    with pytest.raises(InputError, match="it is no xacro, so it takes no arguments"):
        RobotFile.load(toml)
    toml.write_text('[description]\nurdf = "plain.urdf"\nxacro_arguments = { a = [1] }\n')
    with pytest.raises(InputError, match="xacro_arguments must be a table of texts"):
        RobotFile.load(toml)


def test_what_is_identified_is_written_as_plain_urdf(arm, tmp_path):
    robot = Robot.from_urdf(arm, xacro_arguments={"load": "true"})
    parameters = robot.parameters.copy()
    parameters[[9, 19]] *= 1.1
    target = tmp_path / "weighed.urdf"
    write_urdf(robot, parameters, [0.1, 0.2], [np.nan] * 2, arm, target)
    text = target.read_text()
    assert "xacro:" not in text
    assert "<!-- a rod -->" in text
    weighed = Robot.from_urdf(target)
    assert np.allclose(weighed.parameters, parameters, rtol=1e-12)
    assert weighed.joints[1].damping == 0.2


def test_a_file_that_is_included_may_change(arm, tmp_path, monkeypatch):
    part = tmp_path / "parts" / "urdf" / "link.xacro"
    before = expand_xacro(arm)
    part.write_text(PART.replace("<link ", "<!-- another --><link ", 1))
    assert b"another" not in before
    after = expand_xacro(arm)
    assert b"another" in after
    monkeypatch.setattr("steelyard.robot.xacro.run_child", None)  # nothing is expanded twice
    assert expand_xacro(arm) == after


def test_packages_are_found_without_ros(arm, tmp_path, monkeypatch):
    elsewhere = tmp_path / "elsewhere" / "share"
    elsewhere.mkdir(parents=True)
    (tmp_path / "parts").rename(elsewhere / "parts_description")
    with pytest.raises(InputError, match=r'the package "parts" is not found .*set ROS_PACKAGE_PATH'):
        Robot.from_urdf(arm)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(elsewhere))
    assert Robot.from_urdf(arm).dof == 1
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(elsewhere.parent))
    (elsewhere / "parts_description").rename(elsewhere / "parts")
    assert Robot.from_urdf(arm.rename(arm.with_name("other.xacro"))).dof == 1


@pytest.fixture
def in_this_process(monkeypatch):
    """Run the program that expands xacro here, with a xacro of its own, which it changes."""

    def loaded():
        return [name for name in sys.modules if name.partition(".")[0] == "xacro"]

    def run(*given):
        with monkeypatch.context() as patch:
            for name in loaded():
                patch.delitem(sys.modules, name)
            answer = run_here(*given)
            for name in loaded():
                del sys.modules[name]
        return answer

    monkeypatch.setattr("steelyard.robot.xacro.run_child", run)


ESCAPE = "[c for c in ().__class__.__base__.__subclasses__()]"


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<xacro:include filename="arm.urdf.xacro"/>', "include each other more than 50 deep"),
        ('<xacro:include filename="../../secret/x.xacro"/>', "lies outside of the package"),
        ('<xacro:include filename="/etc/passwd"/>', "/etc/passwd lies outside of the package"),
        (
            '<xacro:property name="p" value="${xacro.load_yaml(\'/etc/passwd\')}"/><a b="${p}"/>',
            "outside of the package",
        ),
        ('<xacro:include filename="$(find ..)/secret/x.xacro"/>', "'..' cannot be the name of a package"),
        ('<xacro:include filename="no.xacro"/>', "No such file"),
        ('<xacro:include filename="bomb.xacro"/>', "bomb.xacro has a DOCTYPE declaration"),
        (f'<a b="${{{ESCAPE}}}"/>', "uses __"),
        ('<a b="${(x for x in ()).gi_frame}"/>', "uses gi_frame, which no description needs"),
        ('<a b="$(eval x.gi_frame)"/>', "uses gi_frame"),
        ('<a b="${python.vars(1)}"/>', "vars"),
        ('<a b="$(arg nobody)"/>', "the argument nobody has no value"),
        ('<a b="${unknown}"/>', "in arm.urdf.xacro: name 'unknown' is not defined"),
        ('<a b="${1 / 0}"/>', "division by zero"),
        ('<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>', "a macro or property needs itself|recursion"),
        ("<b>", "mismatched tag"),
        ("", r"arm.urdf.xacro, expanded, line \d+: the robot has no <link>; it may hold macros alone"),
        ('<link name="a"/><joint name="j"/>', r"expanded, line \d+: joint \"j\" has no type"),
    ],
)
def test_what_is_refused(arm, tmp_path, in_this_process, body, message):
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "x.xacro").write_text(HEAD + "</robot>")
    arm.with_name("bomb.xacro").write_text('<!DOCTYPE r [<!ENTITY a "aa">]><robot>&a;</robot>')
    arm.write_text(f"{HEAD}{body}</robot>")
    with pytest.raises(InputError, match=message) as caught:
        Robot.from_urdf(arm)
    assert str(arm) in str(caught.value)


def test_memory_and_time_are_bounded(arm):
    arm.write_text(HEAD + "<a b=\"${'x' * 10**10}\"/></robot>")
    with pytest.raises(InputError, match="cannot be expanded"):
        Robot.from_urdf(arm)


@pytest.mark.parametrize(
    "told",
    [
        "$(optenv ROBOT_ACCESS_KEY none)",
        "${('{0.__globals__[os].environ[ROBOT_ACCESS_KEY]%c' % 125).format(xacro.load_yaml)}",
        "$(optenv ROBOT_STORE none)",
        "$(optenv ROBOT_SOURCE none)",
    ],
)
def test_secrets_of_the_environment_do_not_reach_a_description(arm, monkeypatch, told):
    """A stranger's file would have them written into all that is made of it."""
    monkeypatch.setenv("ROBOT_ACCESS_KEY", "s3cr3t")
    monkeypatch.setenv("ROBOT_STORE", "sftp://robot:s3cr3t@host/logs")
    monkeypatch.setenv("ROBOT_SOURCE", "git+https://robot:s3cr3t@host/arm.git")
    monkeypatch.setenv("ROBOT_SIDE", "left")
    arm.write_text(f'<robot name="arm"><link name="{told}"/><link name="$(env ROBOT_SIDE)"/></robot>')
    try:
        said = expand_xacro(arm).decode()
    except InputError as error:
        said = str(error)
    else:
        assert 'name="left"' in said
    assert "s3cr3t" not in said


def test_the_message_without_the_package(arm, monkeypatch, tmp_path):
    hidden = tmp_path / "hidden" / "xacro"
    hidden.mkdir(parents=True)
    (hidden / "__init__.py").write_text("raise ImportError('no', name='xacro')\n")
    monkeypatch.syspath_prepend(str(hidden.parent))
    arm.write_text(ARM.replace("a rod", "another rod"))
    with pytest.raises(MissingExtraError, match=r"xacro needs the package xacro.*xacro>="):
        Robot.from_urdf(arm)


def test_expansion_agrees_with_xacrodoc(arm):
    xacrodoc = pytest.importorskip("xacrodoc", reason="xacrodoc is not installed")
    from xml.etree import ElementTree

    xacrodoc.packages.look_in([str(arm.parents[2])])
    (arm.parents[2] / "parts" / "package.xml").write_text("<package><name>parts</name></package>")
    other = xacrodoc.XacroDoc.from_file(str(arm), subargs={"load": "true"}).to_urdf_string()
    ours = expand_xacro(arm, {"load": "true"})

    def elements(text):
        return [(one.tag, one.attrib) for one in ElementTree.fromstring(text).iter()]

    assert elements(ours) == elements(other)


class Shared(dict):
    """A dictionary of which another thread has just taken an entry."""

    def __iter__(self):
        return iter(["what another thread took", *super().__iter__()])


def test_threads_may_forget_each_others_expansions(monkeypatch, tmp_path):
    monkeypatch.setattr(xacro, "_EXPANDED", Shared())
    monkeypatch.setattr(xacro, "MOST_KEPT", 1)
    monkeypatch.setattr(xacro, "_expanded", lambda path, _: _Expansion(path.name.encode(), {}))
    for name in ("one", "two", "three"):
        assert expand_xacro(tmp_path / name) == name.encode()
    assert len(xacro._EXPANDED) == 1
