"""Broken URDF files and options: each gives one clear sentence."""

import pytest

from steelyard.errors import InputError, MissingExtraError
from steelyard.robot import Robot

A, B, C = '<link name="a"/>', '<link name="b"/>', '<link name="c"/>'


def joint(name="j", kind="revolute", parent="a", child="b", inner="") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inner}</joint>'


def robot(*elements: str) -> str:
    return '<robot name="r">\n' + "\n".join(elements) + "\n</robot>"


def inertial(inner: str) -> str:
    return robot(A, f'<link name="b"><inertial>{inner}</inertial></link>', joint())


MASS = '<mass value="1"/>'
TENSOR = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'

BROKEN = {
    "empty file": ("", "line 1: not well-formed XML"),
    "cut off": (robot(A, B)[:-4], "line 4: not well-formed XML"),
    "mismatched tags": ("<robot>\n<link name='a'>\n</robot>", "line 3: not well-formed XML"),
    "not XML": ("kind: robot", "line 1: not well-formed XML"),
    "another format": ("<sdf><model/></sdf>", "begins with <robot>, found <sdf>"),
    "xacro": (
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro">\n<xacro:include filename="x"/></robot>',
        "the xacro cannot be expanded|needs the package xacro",
    ),
    "xacro expression": (robot(A, B, joint(inner='<origin xyz="${x} 0 0"/>')), "expand the xacro first"),
    "entities": (
        '<!DOCTYPE robot [<!ENTITY e SYSTEM "file:///etc/hostname">]>\n<robot>&e;</robot>',
        "DOCTYPE declaration, which a URDF does not need",
    ),
    "no link": (robot(), "no <link>"),
    "no joint": (robot(A), "no joint moves"),
    "only fixed joints": (robot(A, B, joint(kind="fixed")), "no joint moves"),
    "link without a name": (robot("<link/>"), "line 2: a link has no name"),
    "joint without a name": (robot(A, B, joint(name="")), "line 4: a joint has no name"),
    "joint without a type": (
        robot(A, B, '<joint name="j"><parent link="a"/><child link="b"/></joint>'),
        'joint "j" has no type',
    ),
    "two links of one name": (robot(A, B, A, joint()), 'line 4: the link "a" was already on line 2'),
    "two joints of one name": (
        robot(A, B, C, joint(), joint(child="c")),
        'line 6: the joint "j" was already on line 5',
    ),
    "unknown parent": (robot(A, B, joint(parent="aa")), 'its parent link "aa" is not in the file; did you mean "a"'),
    "unknown child": (robot(A, B, joint(child="x")), 'its child link "x" is not in the file; known are "a", "b"'),
    "no parent": (robot(A, B, '<joint name="j" type="fixed"><child link="b"/></joint>'), "has no <parent>"),
    "no child": (robot(A, B, '<joint name="j" type="fixed"><parent link="a"/></joint>'), "has no <child>"),
    "two roots": (robot(A, B, C, joint()), r"2 links have no parent joint \(a, c\)"),
    "two parents": (
        robot(A, B, C, joint(), joint("k", child="c"), joint("l", parent="c")),
        'link "b" is the child of joint "j" and of joint "l"',
    ),
    "a ring": (robot(A, B, joint(), joint("k", parent="b", child="a")), "the links a, b form a cycle"),
    "a ring beside the tree": (
        robot(
            A, B, C, '<link name="d"/>', joint(), joint("k", parent="c", child="d"), joint("l", parent="d", child="c")
        ),
        "the links c, d form a cycle",
    ),
    "its own child": (robot(A, B, joint(), joint("k", parent="b", child="b")), 'link "b" is the child of joint'),
    "zero axis": (robot(A, B, joint(inner='<axis xyz="0 0 0"/>')), 'joint "j": its axis is "0 0 0"'),
    "short axis": (robot(A, B, joint(inner='<axis xyz="0 1"/>')), "xyz of <axis> must be 3 numbers, finite, got '0 1'"),
    "word for a number": (robot(A, B, joint(inner='<axis xyz="0 0 one"/>')), "got '0 0 one'"),
    "underscore in a number": (robot(A, B, joint(inner='<axis xyz="0 0 1_0"/>')), "got '0 0 1_0'"),
    "NaN origin": (robot(A, B, joint(inner='<origin rpy="0 nan 0"/>')), "rpy of <origin> must be 3 numbers, finite"),
    "limits exchanged": (
        robot(A, B, joint(inner='<limit lower="1" upper="-1"/>')),
        "its lower limit 1 is above its upper limit -1",
    ),
    "NaN limit": (robot(A, B, joint(inner='<limit effort="nan"/>')), "effort of <limit> must be one number"),
    "infinite damping": (robot(A, B, joint(inner='<dynamics damping="inf"/>')), "damping of <dynamics> must be"),
    "two origins": (robot(A, B, joint(inner="<origin/><origin/>")), 'joint "j" has 2 <origin> elements; keep one'),
    "mimics nobody": (robot(A, B, joint(inner='<mimic joint="jj"/>')), 'mimics the unknown joint "jj"'),
    "mimic without a joint": (robot(A, B, joint(inner="<mimic/>")), 'joint "j", <mimic> has no joint'),
    "mimics itself": (robot(A, B, joint(inner='<mimic joint="j"/>')), 'joint "j" mimics itself through j -> j'),
    "mimic ring": (
        robot(
            A, B, C, joint(inner='<mimic joint="k"/>'), joint("k", parent="b", child="c", inner='<mimic joint="j"/>')
        ),
        "mimics itself through j -> k -> j",
    ),
    "no mass": (inertial(TENSOR), 'link "b": its <inertial> has no <mass>'),
    "no inertia": (inertial(MASS), 'link "b": its <inertial> has no <inertia>'),
    "mass without a value": (inertial("<mass/>" + TENSOR), "<mass> has no value"),
    "inertia without izz": (inertial(MASS + TENSOR.replace(' izz="1"', "")), "<inertia> has no izz"),
    "infinite mass": (
        inertial('<mass value="inf"/>' + TENSOR),
        "value of <mass> must be one number, finite, got 'inf'",
    ),
    "floating joint": (robot(A, B, joint(kind="floating")), r'is of type "floating"; .* lock it: locked=\["j"\]'),
    "misspelt type": (robot(A, B, joint(kind="revolut")), r'is of type "revolut"; .*did you mean "revolute"'),
}


@pytest.mark.parametrize(("text", "phrase"), BROKEN.values(), ids=BROKEN)
def test_each_broken_file_is_refused_in_one_sentence(tmp_path, text, phrase):
    path = tmp_path / "broken.urdf"
    path.write_text(text)
    with pytest.raises((InputError, MissingExtraError), match=phrase) as caught:
        Robot.from_urdf(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_entities_do_not_grow(tmp_path):
    path = tmp_path / "laughs.urdf"
    entities = '<!ENTITY e0 "ha">' + "".join(f'<!ENTITY e{n + 1} "{f"&e{n};" * 10}">' for n in range(30))
    path.write_text(f'<!DOCTYPE robot [{entities}]>\n<robot name="&e30;"><link name="a"/></robot>')
    with pytest.raises(InputError, match=r"not well-formed|DOCTYPE"):
        Robot.from_urdf(path)


def test_bytes_that_are_no_text(tmp_path):
    path = tmp_path / "binary.urdf"
    path.write_bytes(b'<robot name="\xff\xfe"/>')
    with pytest.raises(InputError, match="line 1: not well-formed XML"):
        Robot.from_urdf(path)


def test_absent_files_and_folders(tmp_path):
    with pytest.raises(InputError, match=r"none\.urdf: cannot be read \(No such file"):
        Robot.from_urdf(tmp_path / "none.urdf")
    with pytest.raises(InputError, match=r"is a folder"):
        Robot.from_urdf(tmp_path)


@pytest.mark.parametrize(
    ("options", "phrase"),
    [
        ({"locked": ["elbw"]}, 'there is no joint "elbw" to lock; did you mean "elbow"'),
        ({"locked": "elbow"}, "locked must be a list of joint names"),
        ({"locked": {"elbow": float("nan")}}, 'locked joint "elbow": its position must be a finite number'),
        ({"locked": {"elbow": "0"}}, "its position must be a finite number"),
        ({"locked": {"free": 0.5}}, 'locked joint "free" is floating and can only be locked at 0'),
        ({"locked": ["elbow", "hand", "free"]}, "no joint moves"),
        ({"tip": "lowr"}, 'there is no link "lowr" for the tip; did you mean "lower"'),
        ({"tip": "base"}, "no joint moves between the root and the tip"),
        ({"tip": "hand", "locked": ["free"]}, 'joint "hand" mimics "elbow", which is not between the root and the tip'),
    ],
)
def test_broken_options(tmp_path, options, phrase):
    path = tmp_path / "arm.urdf"
    path.write_text(
        robot(
            *(f'<link name="{name}"/>' for name in ("base", "lower", "hand", "ship")),
            joint("elbow", child="lower", parent="base"),
            joint("hand", child="hand", parent="base", inner='<mimic joint="elbow"/>'),
            joint("free", "floating", child="ship", parent="base"),
        )
    )
    with pytest.raises(InputError, match=phrase):
        Robot.from_urdf(path, **options)
