"""Reading URDF: what is merged, locked, mimicked and left out."""

import math

import numpy as np
import pytest

from steelyard.robot import Inertia, Robot

INERTIAL = (
    '<inertial><origin xyz="{x} 0 0"/><mass value="{m}"/>'
    '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.25"/></inertial>'
)


def link(name: str, mass: float | None = 1.0, x: float = 0.0) -> str:
    return f'<link name="{name}">{"" if mass is None else INERTIAL.format(m=mass, x=x)}</link>'


def joint(name: str, kind: str, parent: str, child: str, inner: str = '<axis xyz="0 0 1"/>', xyz: str = "0 0 0") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}"/><parent link="{parent}"/>'
        f'<child link="{child}"/>{inner}</joint>'
    )


@pytest.fixture
def read(tmp_path):
    def reader(*elements: str, **options) -> Robot:
        path = tmp_path / "robot.urdf"
        path.write_text(f'<?xml version="1.0"?>\n<robot name="bench">{"".join(elements)}</robot>')
        return Robot.from_urdf(path, **options)

    return reader


def body(mass: float, x: float) -> Inertia:
    return Inertia.from_com(mass, (x, 0, 0), np.diag([0.1, 0.2, 0.25]))


ARM = (
    link("world", None),
    link("base", 5.0),
    link("upper", 2.0, 0.1),
    link("bolt", 0.5),
    link("lower", 1.0, 0.2),
    link("finger_a", 0.1),
    link("finger_b", 0.1),
    link("camera", 0.3),
    joint("mount", "fixed", "world", "base", xyz="0 0 1"),
    joint(
        "shoulder", "revolute", "base", "upper",
        '<axis xyz="0 0 1"/><limit lower="-1" upper="2" velocity="3" effort="4"/>',
    ),
    joint("screw", "fixed", "upper", "bolt", xyz="1 0 0"),
    joint("elbow", "continuous", "bolt", "lower", '<axis xyz="0 1 0"/><dynamics damping="0.7"/>', xyz="0 2 0"),
    joint("grip", "prismatic", "lower", "finger_a"),
    joint(
        "grip_mirror", "prismatic", "lower", "finger_b",
        '<axis xyz="0 0 -1"/><mimic joint="grip" multiplier="2" offset="0.01"/>',
    ),
    joint("pan", "revolute", "base", "camera"),
)  # fmt: skip


def test_the_tree_comes_depth_first_in_the_order_of_the_document(read):
    robot = read(*ARM)
    assert robot.name == "bench"
    assert [one.name for one in robot.joints] == ["shoulder", "elbow", "grip", "grip_mirror", "pan"]
    assert robot.joint_names == ("shoulder", "elbow", "grip", "pan")
    assert [one.parent for one in robot.joints] == [-1, 0, 1, 1, -1]
    assert [one.coordinate for one in robot.joints] == [0, 1, 2, 2, 3]
    assert robot.base_link == "world"
    assert [one.name for one in robot.base_attachments] == ["base"]


def test_fixed_links_are_merged_with_their_inertia_moved(read):
    robot = read(*ARM)
    upper = robot.links[0]
    assert upper.absorbed == ("bolt",)
    assert not upper.attachments[0].locked
    assert np.allclose(upper.inertia.parameters, (body(2.0, 0.1) + body(0.5, 1.0)).parameters, atol=1e-15)
    assert np.allclose(upper.own_inertia.parameters, body(2.0, 0.1).parameters, atol=1e-15)
    # The base's mass is not among the parameters: nothing that moves carries it.
    masses = [value for name, value in zip(robot.parameter_names, robot.parameters, strict=True) if name[0] == "m"]
    assert np.allclose(masses, [2.5, 1.0, 0.1, 0.1, 0.3])


def test_placements_of_merged_links_are_composed(read):
    robot = read(*ARM)
    assert np.allclose(robot.joints[0].placement(0.0)[:3, 3], [0, 0, 1])
    assert np.allclose(robot.joints[1].placement(0.0)[:3, 3], [1, 2, 0])
    assert robot.frame("bolt")[0] == 0
    assert np.allclose(robot.frame("bolt")[1][:3, 3], [1, 0, 0])
    assert robot.frame("base")[0] == -1


def test_limits_damping_and_friction(read):
    shoulder, elbow, *_ = read(*ARM).joints
    assert (shoulder.lower, shoulder.upper, shoulder.velocity_limit, shoulder.effort_limit) == (-1, 2, 3, 4)
    assert math.isnan(shoulder.damping)
    assert (elbow.lower, elbow.upper, elbow.velocity_limit, elbow.effort_limit) == (-math.inf, *[math.inf] * 3)
    assert elbow.damping == 0.7
    assert math.isnan(elbow.friction)


def test_a_limit_without_bounds_leaves_them_unknown_and_with_one_the_other_is_zero(read):
    chain = (link("a"), link("b"), link("c"))
    first, second = read(
        *chain,
        joint("j", "revolute", "a", "b", '<limit effort="1" velocity="2"/>'),
        joint("k", "revolute", "b", "c", '<limit upper="2" effort="1" velocity="inf"/>'),
    ).joints
    assert (first.lower, first.upper) == (-math.inf, math.inf)
    assert (second.lower, second.upper, second.velocity_limit) == (0.0, 2.0, math.inf)


def test_the_axis_defaults_to_x_and_is_normalised(read):
    robot = read(
        link("a"), link("b"), link("c"), joint("j", "revolute", "a", "b", ""),
        joint("k", "prismatic", "b", "c", '<axis xyz="0 3 4"/>'),
    )  # fmt: skip
    assert np.allclose(robot.joints[0].placement(math.pi / 2)[:3, :3], [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-15)
    assert np.allclose(robot.joints[1].placement(0.5)[:3, 3], [0, 0.3, 0.4], atol=1e-15)


def test_the_inertia_is_turned_by_the_inertial_origin(read):
    turned = (
        '<link name="b"><inertial><origin xyz="0 0 0" rpy="0 0 1.5707963267948966"/><mass value="1"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="2.5"/></inertial></link>'
    )
    robot = read(link("a"), turned, joint("j", "revolute", "a", "b"))
    assert np.allclose(robot.links[0].inertia.about_origin, np.diag([2, 1, 2.5]), atol=1e-15)


def test_mimic_joints_have_a_link_but_share_the_coordinate(read):
    mirror = read(*ARM).joints[3]
    assert (mirror.multiplier, mirror.offset, mirror.mimics) == (2.0, 0.01, "grip")
    assert np.allclose(mirror.placement(0.1)[:3, 3], [0, 0, -0.21])


def test_a_mimic_of_a_mimic_follows_the_driving_joint(read):
    chain = [link(name) for name in "abcd"]
    robot = read(
        *chain,
        joint("j", "revolute", "a", "b", '<axis xyz="0 0 1"/><mimic joint="k" multiplier="3" offset="1"/>'),
        joint("k", "revolute", "b", "c", '<axis xyz="0 0 1"/><mimic joint="l" multiplier="-2" offset="0.5"/>'),
        joint("l", "revolute", "c", "d"),
    )
    first = robot.joints[0]
    assert (first.mimics, first.multiplier, first.offset) == ("l", -6.0, 1.0 + 3 * 0.5)
    assert robot.joint_names == ("l",)


def test_a_locked_joint_is_merged_at_its_position(read):
    robot = read(*ARM, locked={"elbow": math.pi / 2, "grip": 0.2})
    assert robot.joint_names == ("shoulder", "pan")
    upper = robot.links[0]
    assert {one.name: one.locked for one in upper.attachments} == {
        "bolt": False,
        "lower": True,
        "finger_a": True,
        "finger_b": True,
    }
    # The elbow turns by a quarter about y, so the finger's slide along z points along x.
    assert np.allclose(robot.frame("finger_a")[1][:3, 3], [1 + 0.2, 2, 0])
    assert np.allclose(robot.frame("finger_b")[1][:3, 3], [1 - (2 * 0.2 + 0.01), 2, 0])
    assert robot.links[0].inertia.mass == pytest.approx(2.0 + 0.5 + 1.0 + 0.1 + 0.1)


def test_locked_names_alone_mean_position_zero(read):
    robot = read(*ARM, locked=["elbow", "grip", "pan"])
    assert robot.dof == 1
    assert np.allclose(robot.frame("finger_b")[1][:3, 3], [1, 2, -0.01])


def test_a_mimic_with_multiplier_zero_stands_still(read):
    robot = read(
        link("a"), link("b"), link("c"), joint("j", "revolute", "a", "b"),
        joint("k", "prismatic", "b", "c", '<axis xyz="0 0 1"/><mimic joint="j" multiplier="0" offset="0.3"/>'),
    )  # fmt: skip
    assert robot.dof == len(robot.joints) == 1
    assert robot.frame("c")[1][2, 3] == 0.3


@pytest.mark.parametrize("kind", ["floating", "planar", "spherical"])
def test_joints_of_more_freedom_can_be_locked(read, kind):
    robot = read(
        link("a"), link("b"), link("c"), joint("free", kind, "a", "b", "", xyz="1 0 0"),
        joint("j", "revolute", "b", "c", xyz="0 0 1"), locked=["free"],
    )  # fmt: skip
    assert robot.joint_names == ("j",)
    assert np.allclose(robot.joints[0].before[:3, 3], [1, 0, 1])


def test_the_tip_keeps_the_chain_and_what_is_fixed_to_it(read):
    robot = read(*ARM, tip="lower")
    assert robot.joint_names == ("shoulder", "elbow")
    assert robot.links[0].absorbed == ("bolt",)
    assert robot.links[1].absorbed == ()
    assert robot.links[1].inertia.mass == 1.0


def test_what_the_tip_leaves_out_is_known(read):
    """Of what moving links carry: a branch of the base moves nothing."""
    robot = read(*ARM, tip="lower")
    assert [one.carrier for one in robot.left_out] == ["lower", "lower"]
    assert {name for one in robot.left_out for name in one.joints} == {"grip"}
    assert sum(one.mass for one in robot.left_out) == pytest.approx(0.2)
    assert read(*ARM, tip="lower", locked=["grip"]).left_out == ()
    assert read(*ARM).left_out == ()
    (branch,) = read(*ARM, tip="bolt").left_out
    assert (branch.carrier, branch.joints, branch.mass) == ("upper", ("elbow", "grip"), pytest.approx(1.2))


def test_locked_side_branches_stay_on_the_chain(read):
    robot = read(*ARM, tip="lower", locked=["grip"])
    assert robot.links[1].absorbed == ("finger_a", "finger_b")
    assert robot.links[1].inertia.mass == pytest.approx(1.2)


def test_a_joint_off_the_chain_may_be_of_any_kind(read):
    robot = read(*ARM, link("leaf"), joint("free", "floating", "upper", "leaf", ""), tip="upper")
    assert robot.joint_names == ("shoulder",)


def test_a_link_without_inertial_has_no_mass(read):
    robot = read(
        link("a"), link("b"), link("c", None), joint("j", "revolute", "a", "b"), joint("k", "revolute", "b", "c")
    )
    assert robot.links[1].inertia.parameters.tolist() == [0.0] * 10
    assert robot.links[1].own_inertia is None


def test_where_no_moving_link_has_an_inertial_the_inertia_is_unknown(read):
    robot = read(link("a", 3.0), link("b", None), joint("j", "revolute", "a", "b"))
    assert robot.links[0].inertia is None
    assert np.isnan(robot.parameters).all()


def test_unknown_tags_comments_and_foreign_namespaces_are_ignored(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro" xmlns:s="http://example.org/s"><!-- link -->'
        '<s:link/><gazebo><link name="a"/></gazebo><ros2_control name="x"><joint name="j"/></ros2_control>'
        '<transmission name="t"><joint name="j"/></transmission>'
        f"{link('a')}{link('b')}{joint('j', 'revolute', 'a', 'b')}</robot>"
    )
    assert Robot.from_urdf(str(path)).joint_names == ("j",)


def test_a_chain_of_thousands_of_links(read):
    count = 3000
    links = [link(f"l{index}", None) for index in range(count + 1)]
    joints = [joint(f"j{index}", "fixed", f"l{index}", f"l{index + 1}", xyz="0 0 1") for index in range(count)]
    robot = read(*links, *joints, link("end"), joint("last", "revolute", f"l{count}", "end"))
    assert robot.joints[0].before[2, 3] == count


def test_exact_entries_survive_the_composition(read):
    robot = read(
        link("a"), link("b"), link("c"),
        '<joint name="f" type="fixed"><origin rpy="1.5707963267948966 0 -1.5707963267948966"/>'
        '<parent link="a"/><child link="b"/></joint>',
        joint("j", "revolute", "b", "c", '<axis xyz="-1 0 0"/>'),
    )  # fmt: skip
    assert set(np.unique(robot.joints[0].before)) <= {-1.0, 0.0, 1.0}
    assert set(np.unique(robot.joints[0].after)) <= {-1.0, 0.0, 1.0}


def test_limits_that_stand_for_none_are_none(read):
    """As of the planar bases of some descriptions, whose slides would be thousands of kilometres long."""
    limit = '<axis xyz="1 0 0"/><limit lower="-999999" upper="0.5" velocity="4" effort="87"/>'
    slide = read(link("base", None), link("cart"), joint("slide", "prismatic", "base", "cart", limit)).joints[0]
    assert (slide.lower, slide.upper) == (-math.inf, 0.5)
    unset = '<axis xyz="1 0 0"/><limit lower="-1" upper="0.5" velocity="0" effort="0"/>'
    slide = read(link("base", None), link("cart"), joint("slide", "prismatic", "base", "cart", unset)).joints[0]
    assert (slide.lower, slide.velocity_limit, slide.effort_limit) == (-1.0, math.inf, math.inf)
