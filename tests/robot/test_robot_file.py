"""The robot file robot.toml."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.robot import Robot, RobotFile
from steelyard.robot.description import DESCRIPTION_FORMATS, description_format
from steelyard.robot.references import find_package

URDF = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/></joint>
<joint name="k" type="prismatic"><parent link="b"/><child link="c"/></joint>
<joint name="l" type="revolute"><parent link="a"/><child link="d"/></joint></robot>"""
ROWS = '[description]\nrows = [["pi/2", 0, 0.1273, "q"], [0, -0.612, 0, "q2"]]\n'

URDF_DOOR = """<robot name="door"><link name="frame"/><link name="leaf"/><joint name="hinge" type="continuous">
<parent link="frame"/><child link="leaf"/></joint></robot>"""
SDF_DOOR = """<sdf version="1.9"><world name="moon"><gravity>0 0 -1.6</gravity><model name="door"><link name="frame"/>
<link name="leaf"/><joint name="hinge" type="continuous"><parent>frame</parent><child>leaf</child><axis/></joint>
</model></world></sdf>"""


@pytest.fixture
def write(tmp_path):
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "arm.urdf").write_text(URDF)

    def writer(text: str):
        path = tmp_path / "bench.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return writer


def test_a_urdf_is_found_beside_the_file(write, monkeypatch, tmp_path_factory):
    path = write('name = "bench arm"\n[description]\nurdf = "robots/arm.urdf"\ntip = "c"\nlocked = {k = 0.25}\n')
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    robot = RobotFile.load(str(path)).robot
    assert robot.name == "bench arm"
    assert robot.joint_names == ("j",)
    assert np.allclose(robot.frame("c")[1][:3, 3], [0.25, 0, 0])
    assert robot.source == path.parent / "robots" / "arm.urdf"


def test_locked_names_and_gravity(write):
    robot = RobotFile.load(
        write('[description]\nurdf = "robots/arm.urdf"\nlocked = ["k", "l"]\ngravity = [0, 9.81, 0]')
    ).robot
    assert robot.name == "r"
    assert robot.joint_names == ("j",)
    assert robot.gravity.tolist() == [0.0, 9.81, 0.0]


def test_dh_rows_are_those_of_from_dh(write):
    robot = RobotFile.load(write(ROWS + 'convention = "modified"\ngravity = [0, 0, 9.8]')).robot
    same = Robot.from_dh([("pi/2", 0, 0.1273, "q"), (0, -0.612, 0, "q2")], convention="modified")
    assert robot.name == "bench"
    assert robot.gravity[2] == 9.8
    for ours, theirs in zip(robot.joints, same.joints, strict=True):
        assert np.array_equal(ours.before, theirs.before)
        assert np.array_equal(ours.after, theirs.after)


def test_sections_are_kept_as_written(write):
    file = RobotFile.load(
        write(
            ROWS
            + '[[terms]]\nkind = "viscous"\n[[terms]]\nkind = "x"\na = 1\n[log]\nq = ["q1"]\n'
            + "[limits]\nlower = [-1, -2]\nvelocity = 3.0\n"
        )
    )
    assert file.robot.terms == ()
    assert file.terms == ({"kind": "viscous"}, {"kind": "x", "a": 1})
    assert file.section("log") == {"q": ["q1"]}
    assert file.section("limits") == {"lower": [-1, -2], "velocity": 3.0}
    assert [joint.lower for joint in file.robot.joints] == [-1.0, -2.0]
    assert [joint.velocity_limit for joint in file.robot.joints] == [3.0, 3.0]
    assert [joint.upper for joint in file.robot.joints] == [np.inf, np.inf]
    assert file.section("processing") == {}
    assert file.section("constraints") == {}


def test_without_a_word_on_terms_every_description_has_the_friction_of_a_bare_urdf(write, tmp_path):
    bare = sy.Model.load(tmp_path / "robots" / "arm.urdf").parameter_names
    assert [name for name in bare if name[0] == "F"] == [f"F{kind}j{j}" for j in (1, 2, 3) for kind in "vco"]
    assert sy.Model.load(write('[description]\nurdf = "robots/arm.urdf"\n[log]\n')).parameter_names == bare
    assert len(sy.Model.load(write(ROWS)).parameter_names) == 2 * 13
    assert len(sy.Model.load(write("terms = []\n" + ROWS)).parameter_names) == 2 * 10
    assert len(sy.Model.load(write(ROWS + '[[terms]]\nkind = "viscous"\n')).parameter_names) == 2 * 11


def test_a_section_can_be_changed_without_changing_the_file(write):
    file = RobotFile.load(write(ROWS + '[log]\nq = ["q1"]\n'))
    file.section("log")["q"].append("x")
    assert file.section("log") == {"q": ["q1"]}


def test_a_plain_urdf_has_friction_and_no_settings(write):
    path = write("").parent / "robots" / "arm.urdf"
    file = RobotFile.load(path)
    assert file.robot.joint_names == ("j", "k", "l")
    assert [term["kind"] for term in file.terms] == ["viscous", "coulomb", "offset"]
    assert file.section("log") == {}


def test_an_unknown_table_is_refused(write):
    with pytest.raises(InputError, match=r'"lgo" is no table .* did you mean "log"'):
        RobotFile.load(write(ROWS)).section("lgo")


INERTIAL = (
    '[[description.inertials]]\nlink = "link2"\nmass = 2\ncenter_of_mass = [0, 0.1, 0]\ninertia = [3, 0, 0, 2, 1, 2]\n'
)


def test_inertials_of_dh_rows(write):
    robot = RobotFile.load(write(ROWS + INERTIAL)).robot
    assert robot.links[0].inertia is None
    assert robot.links[1].inertia.parameters.tolist() == pytest.approx([3.02, 0, 0, 2, 1, 2.02, 0, 0.2, 0, 2])
    same = Robot.from_dh([("pi/2", 0, 0.1273, "q"), (0, -0.612, 0, "q2")], inertias={"link2": robot.links[1].inertia})
    assert np.array_equal(np.isnan(robot.parameters), np.isnan(same.parameters))
    assert np.array_equal(np.nan_to_num(robot.parameters), np.nan_to_num(same.parameters))
    with pytest.raises(InputError, match="given for 'link3', which is no link"):
        Robot.from_dh([(0, 0, 0, "q")], inertias={"link3": robot.links[1].inertia})


BROKEN = {
    "syntax": ("name = \n", r"not valid TOML \(Invalid value \(at line 1"),
    "empty": ("", r"it has no table \[description\]"),
    "unknown section": (ROWS + "[limit]\n", r"'limit' is no section of a robot file; did you mean \"limits\""),
    "description is no table": ("description = 3", r"it has no table \[description\]"),
    "description without a robot": ("[description]\ngravity = [0, 0, 1]", "urdf = ... or rows = ... is needed"),
    "two robots": (ROWS + 'urdf = "x.urdf"', "both urdf and rows"),
    "unknown key": (
        '[description]\nurdf = "robots/arm.urdf"\ntipp = "c"',
        "'tipp' does not belong to a URDF; did you mean",
    ),
    "tip with rows": (ROWS + 'tip = "c"', "'tip' does not belong to DH rows"),
    "name is a number": ("name = 3\n" + ROWS, "name must be a string of one line, got 3"),
    "urdf is a number": ("[description]\nurdf = 3", "urdf must be a path, got 3"),
    "absent urdf": ('[description]\nurdf = "none.urdf"', r"none\.urdf: cannot be read"),
    "tip is a list": ('[description]\nurdf = "robots/arm.urdf"\ntip = ["c"]', "tip must be the name of a link"),
    "locked is a name": (
        '[description]\nurdf = "robots/arm.urdf"\nlocked = "k"',
        "locked must be a list of joint names",
    ),
    "locked holds words": ('[description]\nurdf = "robots/arm.urdf"\nlocked = {k = "0"}', "locked must be a list"),
    "unknown locked joint": ('[description]\nurdf = "robots/arm.urdf"\nlocked = ["kk"]', 'no joint "kk" to lock'),
    "gravity of two": (ROWS + "gravity = [0, 9.81]", r"gravity must be three numbers in m/s², got \[0, 9.81\]"),
    "infinite gravity": (ROWS + "gravity = [0, 0, inf]", "gravity must be three numbers"),
    "rows is a string": ('[description]\nrows = "q"', "rows must be a list"),
    "short row": ('[description]\nrows = [[0, 0, "q"]]', r"\[description\], row 1: four cells"),
    "bad cell": (
        '[description]\nrows = [[0, 0, 0, "phi"]]',
        r"bench.toml, \[description\], row 1, theta: cannot read 'phi'",
    ),
    "bad convention": (ROWS + 'convention = "khalil"', 'must be "standard" or "modified", got \'khalil\''),
    "terms is a table": (ROWS + "[terms]\n", r"terms must be written as \[\[terms\]\]"),
    "terms holds words": ('terms = ["viscous"]\n' + ROWS, r"terms must be written as \[\[terms\]\]"),
    "log is an array": (ROWS + "[[log]]\n", r"log must be one table \[log\]"),
    "unknown limit": (ROWS + "[limits]\nlow = 1\n", r"'low' is no limit; did you mean \"lower\""),
    "limits for another robot": (ROWS + "[limits]\nlower = [1, 2, 3]\n", r"lower has 3 values, but bench has 2 joints"),
    "limit is text": (ROWS + '[limits]\nlower = ["a", 1]\n', r"lower of joint1 must be a number, got 'a'"),
    "velocity limit negative": (ROWS + "[limits]\nvelocity = -1\n", r"velocity of joint1 must be positive"),
    "limits crossed": (ROWS + "[limits]\nlower = 2\nupper = 1\n", r"lower limit of joint1 is 2, above its upper"),
    "inertials of a URDF": (
        '[description]\nurdf = "robots/arm.urdf"\n' + INERTIAL,
        "'inertials' does not belong to a URDF",
    ),
    "inertials as a number": (ROWS + "inertials = 3", r"must be written as \[\[description.inertials\]\]"),
    "unknown key of an inertia": (ROWS + INERTIAL + "com = [0, 0, 0]\n", r"number 1: 'com' is not known of an inertia"),
    "inertia of no link": (ROWS + INERTIAL.replace("link2", "link4"), "given for 'link4', which is no link; "),
    "two inertias": (ROWS + INERTIAL + INERTIAL, r"inertials\]\] number 2: link2 has an inertia already"),
    "no mass": (ROWS + INERTIAL.replace("mass = 2", ""), "lacks 'mass'; give link, mass, center_of_mass and inertia"),
    "negative mass": (ROWS + INERTIAL.replace("mass = 2", "mass = -2"), "mass must be a mass in kg, not negative"),
    "inertia of three": (ROWS + INERTIAL.replace("[3, 0, 0, 2, 1, 2]", "[3, 2, 2]"), "inertia must be six numbers"),
    "link is a number": (ROWS + INERTIAL.replace('"link2"', "2"), "link must be the name of a link"),
    "limits is a number": ("limits = 3\n" + ROWS, r"limits must be one table \[limits\]"),
}


@pytest.mark.parametrize(("text", "phrase"), BROKEN.values(), ids=BROKEN)
def test_each_broken_file_is_refused_in_one_sentence(write, text, phrase):
    with pytest.raises(InputError, match=phrase) as caught:
        RobotFile.load(write(text))
    assert "\n" not in str(caught.value)


def test_other_files_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"a \.urdf, .*or a \.toml file, got the suffix '\.yaml'"):
        RobotFile.load(tmp_path / "robot.yaml")
    with pytest.raises(InputError, match="got no suffix, and nothing is there"):
        RobotFile.load(tmp_path / "robot")
    with pytest.raises(InputError, match="got a folder; give the path of one"):
        RobotFile.load(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        RobotFile.load(tmp_path / "robot.toml")
    latin = tmp_path / "latin.toml"
    latin.write_bytes(b'name = "\xe9"')
    with pytest.raises(InputError, match="byte 8 is not UTF-8"):
        RobotFile.load(latin)


def test_lengths_of_rows_may_have_names(tmp_path):
    path = tmp_path / "arm.toml"
    text = '[description]\nrows = [[0, "a1", 0, "q"], [0, "a2", "d2", "q"]]\nlengths = {}\n'
    path.write_text(text.format("{ a1 = 0.5, d2 = 1 }"))
    robot = RobotFile.load(path).robot
    assert robot.lengths == ("a2",)
    assert robot.joints[0].after[0, 3] == 0.5
    assert robot.joints[1].before[2, 3] == 1.0
    path.write_text(text.format('{ a1 = "long" }'))
    with pytest.raises(InputError, match="lengths must be a table of names and numbers in m"):
        RobotFile.load(path)
    path.write_text(text.format("{ a3 = 1.0 }"))
    with pytest.raises(InputError, match='no symbolic length "a3"; it has a1, d2, a2'):
        RobotFile.load(path)


def test_joints_of_rows_are_locked(tmp_path):
    path = tmp_path / "arm.toml"
    text = (
        '[description]\nrows = [["pi/2", 0, 0.3, "q"], [0, "a2", 0, "q"], [0, 0.1, 0, "q"]]\nlengths = { a2 = 0.5 }\n'
    )
    path.write_text(text + "locked = { joint2 = 0.4 }\n")
    robot = RobotFile.load(path).robot
    assert robot.joint_names == ("joint1", "joint3")
    assert np.allclose(robot.frame("link2")[1], Robot.from_dh([(0, 0.5, 0, "q")]).joints[0].placement(0.4), atol=1e-15)
    path.write_text(text + "locked = 2\n")
    with pytest.raises(InputError, match="locked must be a list of joint names or a table of positions"):
        RobotFile.load(path)


@pytest.mark.parametrize(
    ("text", "suffix"),
    [
        ('<?xml version="1.0"?><!-- <mujoco> -->\n<sdf>', "sdf"),
        ('<!DOCTYPE robot [<!ENTITY a "b">]><mujoco>', "mujoco"),
        ("<!-- > --><robot>", "robot"),
        ("<!-- <sdf>", "robot"),
        ("no element", "robot"),
        # With a search for the end of a comment at each beginning, these took hours.
        ("<!--" * 1_000_000, "robot"),
        ("<!-- >" * 1_000_000, "robot"),
        ("<?" * 1_000_000, "robot"),
    ],
)
def test_the_first_element_tells_the_format(tmp_path, text, suffix):
    path = tmp_path / "robot.xml"
    path.write_text(text)
    assert description_format(path) is DESCRIPTION_FORMATS.get(suffix)


def test_a_package_whose_mark_has_nothing_but_beginnings_of_names(tmp_path):
    (tmp_path / "package.xml").write_text("<name" * 200_000)  # at each of which the end was looked for, for hours
    with pytest.raises(InputError, match='the package "arm_of_nobody" is not found'):
        find_package("arm_of_nobody", tmp_path / "robot.urdf")
    (tmp_path / "package.xml").write_text('<package><name a="b">arm_of_nobody</name></package>')
    assert find_package("arm_of_nobody", tmp_path / "robot.urdf") == tmp_path


@pytest.mark.parametrize("key", ["urdf", "file"])
@pytest.mark.parametrize(
    ("name", "text", "gravity"),
    [
        ("door.urdf", URDF_DOOR, (0.0, 0.0, -9.81)),
        ("door.txt", URDF_DOOR, (0.0, 0.0, -9.81)),
        ("door.xml", URDF_DOOR, (0.0, 0.0, -9.81)),
        ("door.xml", SDF_DOOR, (0.0, 0.0, -1.6)),
        ("door.sdf", SDF_DOOR, (0.0, 0.0, -1.6)),
    ],
)
def test_the_key_of_a_description_does_not_say_its_format(key, name, text, gravity, tmp_path):
    (tmp_path / name).write_text(text)
    path = tmp_path / "robot.toml"
    path.write_text(f'[description]\n{key} = "{name}"\n')
    if (key, name) == ("file", "door.txt"):
        with pytest.raises(InputError, match=r"got the suffix '.txt'"):
            RobotFile.load(path)
        return
    robot = RobotFile.load(path).robot
    assert robot.joint_names == ("hinge",)
    assert tuple(robot.gravity) == gravity
