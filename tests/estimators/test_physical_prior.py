"""What is known of a robot before it moves, beside closed forms, Pinocchio, CVXPY, and the true masses of robots."""

import struct
import sysconfig
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.spatial
from hypothesis import given
from hypothesis import strategies as st

import steelyard as sy
from steelyard.estimators.kinematic_bodies import kinematic_bodies, lengths_beyond
from steelyard.feasibility.constraints import CenterOfMassBox, MeasuredMass, SymmetricLink, TotalMass
from steelyard.identification import physical_prior
from steelyard.robot.described_inertia import possible_body
from steelyard.robot.inertia import Inertia, pseudo_inertia

pytestmark = pytest.mark.usefixtures("meshes_in_this_process")

ROBOTS = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
BOX = '<geometry><box size="0.1 0.2 0.4"/></geometry>'
LIMIT = '<limit lower="-3" upper="3" effort="1" velocity="1"/>'
GOOD = (2.3, "0.01 0.02 0.15", (0.031, 0.027, 0.009))


def inertial(mass, com="0 0 0", moments=(1.0, 1.0, 1.0)):
    xx, yy, zz = moments
    return (
        f'<inertial><origin xyz="{com}"/><mass value="{mass}"/>'
        f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>'
    )


def shape(geometry=BOX, tag="collision", xyz="0 0 0.2"):
    return f'<{tag}><origin xyz="{xyz}"/>{geometry}</{tag}>'


def arm(folder, *links, extra=""):
    """Write a chain of links l1, l2, ... on joints 0.4 m apart, and return its model."""
    text = '<robot name="arm"><link name="base"/>'
    for number, content in enumerate(links, start=1):
        parent = f"l{number - 1}" if number > 1 else "base"
        text += f'<link name="l{number}">{content}</link><joint name="j{number}" type="revolute">'
        text += f'<parent link="{parent}"/><child link="l{number}"/><origin xyz="0 0 {0.4 * (number > 1)}"/>'
        text += f'<axis xyz="{number % 2} {1 - number % 2} 0"/>{LIMIT}</joint>'
    path = folder / "arm.urdf"
    path.write_text(f"{text}{extra}</robot>")
    return sy.Model(sy.Robot.from_urdf(path).with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))


def fixed(name, content, parent):
    return (
        f'<link name="{name}">{content}</link><joint name="to_{name}" type="fixed"><parent link="{parent}"/>'
        f'<child link="{name}"/><origin xyz="0 0 0.4"/></joint>'
    )


def body(prior, index):
    return Inertia.from_parameters(prior.links[index].parameters)


def said(prior, *words):
    return [sentence for sentence in prior.sentences if all(word in sentence for word in words)]


def satisfied(model, prior, parameters=None, user=()):
    """Whether inertial parameters, those of the prior itself by default, lie within the set that it makes."""
    feasible = sy.FeasibleSet(model, constraints=[*user, *prior.constraints])
    values = np.nan_to_num(prior.parameters if parameters is None else parameters, nan=1.0)
    return bool(np.all(feasible.stack.smallest_eigenvalues(values) > 0.0)) and feasible.satisfies_equations(values)


def test_a_sound_description_is_used_as_it_is(tmp_path):
    model = arm(tmp_path, *[inertial(*GOOD) + shape()] * 2)
    prior = physical_prior(model)
    assert prior.sources == ("description", "description")
    assert not prior.scale_is_free
    columns = np.ravel(model.link_columns)
    assert np.array_equal(prior.parameters[columns], np.asarray(model.robot.parameters)[columns])
    assert np.isnan(np.delete(prior.parameters, columns)).all()
    assert said(prior, "all 2 links")
    assert satisfied(model, prior)


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ("", "no inertial"),
        (inertial(1), "placeholder (1 kg, 1 kg m²"),
        (inertial(1, moments=(1e-3,) * 3), "placeholder (1 kg, 0.001 kg m²"),
        (inertial(0.1, moments=(0.03,) * 3), "placeholder (0.1 kg"),
        (inertial(0), "no mass"),
        (inertial(-1, moments=(0.01, 0.02, 0.025)), "mass of -1 kg"),
        (inertial(0.001, "0 0 0.1", (1e-6, 2e-6, 2e-6)), "density"),
        (inertial(2300, *GOOD[1:]), "density"),
    ],
)
def test_what_nobody_weighed_is_replaced_by_the_shape(tmp_path, content, word):
    prior = physical_prior(arm(tmp_path, inertial(*GOOD) + shape(), content + shape()))
    assert prior.sources == ("description", "shape")
    assert said(prior, "`l2`", word, "shape at uniform density")
    found = body(prior, 1)
    # A box of uniform density about its centre: m (b² + c²) / 12.
    assert found.com == pytest.approx([0, 0, 0.2], abs=1e-12)
    expected = found.mass / 12 * np.diag([0.2**2 + 0.4**2, 0.1**2 + 0.4**2, 0.1**2 + 0.2**2])
    assert np.allclose(found.about_com, expected, rtol=1e-12)
    assert 2.3 / 2 < found.mass < 2.3 * 2  # the described link, of the same shape, tells how heavy it is


@pytest.mark.parametrize(
    "content",
    [
        inertial(1, "0 0 0.1", (1e-3,) * 3),  # a centre of mass was computed
        inertial(1.37, "0 0 0", (1e-3,) * 3),  # somebody weighed it
        inertial(1, "0 0 0", (1e-2, 1.2e-2, 3e-3)),  # moments were computed
        inertial(2, "0 0 0", (0.0123,) * 3),
    ],
)
def test_round_numbers_alone_are_no_placeholder(tmp_path, content):
    prior = physical_prior(arm(tmp_path, inertial(*GOOD) + shape(), content + shape(xyz="0 0 0")))
    assert prior.sources[1] == "description"


def test_one_inertial_for_all_links_of_an_arm_is_a_placeholder(tmp_path):
    same = inertial(2.35, "0 0 0", (0.012, 0.013, 0.014))
    prior = physical_prior(arm(tmp_path, *[same + shape()] * 3))
    assert prior.sources == ("shape",) * 3
    assert said(prior, "the same for 3 links")
    # Modules that are alike, with their centres of mass where a drawing has them, are none.
    same = inertial(*GOOD)
    assert physical_prior(arm(tmp_path, *[same + shape()] * 3)).sources == ("description",) * 3


def test_alike_branches_are_no_placeholders(tmp_path):
    text = '<robot name="drone"><link name="base"/>'
    for k in range(4):
        text += f'<link name="rotor{k}">{inertial(0.025, "0 0 0", (1e-5, 1e-5, 2e-5))}{shape()}</link>'
        text += f'<joint name="j{k}" type="continuous"><parent link="base"/><child link="rotor{k}"/></joint>'
    (tmp_path / "drone.urdf").write_text(text + "</robot>")
    prior = physical_prior(sy.Model(sy.Robot.from_urdf(tmp_path / "drone.urdf")))
    assert not said(prior, "the same for 4")


def test_shapes_agree_with_pinocchio(tmp_path):
    pinocchio = pytest.importorskip("pinocchio")
    kinds = {
        "sphere": ('<sphere radius="0.13"/>', lambda m: pinocchio.Inertia.FromSphere(m, 0.13)),
        "box": ('<box size="0.1 0.2 0.4"/>', lambda m: pinocchio.Inertia.FromBox(m, 0.1, 0.2, 0.4)),
        "cylinder": (
            '<cylinder radius="0.1" length="0.4"/>',
            lambda m: pinocchio.Inertia.FromCylinder(m, 0.1, 0.4),
        ),
        "capsule": ('<capsule radius="0.1" length="0.4"/>', lambda m: pinocchio.Inertia.FromCapsule(m, 0.1, 0.4)),
    }
    for geometry, expected in kinds.values():
        found = body(physical_prior(arm(tmp_path, "", shape(f"<geometry>{geometry}</geometry>", xyz="0.1 0 0.2"))), 1)
        oracle = expected(found.mass)
        assert found.com == pytest.approx([0.1, 0.0, 0.2], abs=1e-12)
        assert np.allclose(found.about_com, oracle.inertia, rtol=1e-9, atol=1e-12)


def test_visual_elements_come_before_collision_elements(tmp_path):
    both = shape('<geometry><sphere radius="0.1"/></geometry>', "visual", "0 0 0.1") + shape()
    assert body(physical_prior(arm(tmp_path, "", both)), 1).com == pytest.approx([0, 0, 0.1], abs=1e-12)


def test_without_shapes_bodies_span_the_joints():
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q"), (0, 0.4, 0, "q")])
    prior = physical_prior(sy.Model(robot))
    assert prior.sources == ("kinematics",) * 3
    assert prior.scale_is_free
    # Standard DH: the second link reaches from -0.5 m along x of its frame to its origin.
    assert body(prior, 1).com == pytest.approx([-0.25, 0, 0], abs=1e-12)
    second, third = kinematic_bodies(robot)[1:]
    assert (second.shape.length, third.shape.length) == (pytest.approx(0.5), pytest.approx(0.4))
    assert second.shape.radius == pytest.approx(0.06 * (0.9 + 0.9))  # reach 0.9 m, all of it beyond the joint
    assert third.shape.radius == pytest.approx(0.06 * (0.9 + 0.4))
    volume = np.pi * second.shape.radius**2 * 0.5 + 4 / 3 * np.pi * second.shape.radius**3
    assert prior.masses[1] == pytest.approx(300 * volume)
    assert satisfied(sy.Model(robot), prior)


def test_lengths_along_an_axis_are_shared():
    # A spherical shoulder, 0.6 m along the axis of the third joint, an elbow: half of it before that joint.
    robot = sy.Robot.from_dh([("-pi/2", 0, 0, "q"), ("pi/2", 0, 0, "q"), ("-pi/2", 0, 0.6, "q"), (0, 0.5, 0, "q")])
    assert [one.shape.length for one in kinematic_bodies(robot)[1:3]] == pytest.approx([0.3, 0.3])


@pytest.mark.slow
def test_a_link_with_many_frames_spans_the_farthest_of_them(tmp_path):
    """With 3000 of them not all pairs are compared: by 10^5 that would take 224 GiB."""
    places = np.random.default_rng(3).normal(size=(3000, 3)) * [0.02, 0.05, 0.2]
    frames = "".join(
        f'<link name="f{k}"/><joint name="g{k}" type="fixed"><parent link="l"/><child link="f{k}"/>'
        f'<origin xyz="{x} {y} {z}"/></joint>'
        for k, (x, y, z) in enumerate(places)
    )
    (tmp_path / "many.urdf").write_text(
        '<robot name="r"><link name="b"/><link name="l"/><joint name="j" type="continuous"><parent link="b"/>'
        f'<child link="l"/><axis xyz="0 0 1"/></joint>{frames}</robot>'
    )
    robot = sy.Robot.from_urdf(tmp_path / "many.urdf")
    exact = scipy.spatial.distance.pdist(places).max()
    (body,) = kinematic_bodies(robot)
    assert 0.97 * exact <= body.shape.length <= exact * (1.0 + 1e-12)


def test_strokes_count_but_for_that_of_a_rail():
    """A telescope grows; what moves along a rail does not, unless its stroke is all that is known."""
    limits = {"lower": 0.0, "upper": 1.0}
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0, "q", 0), (0, 0.4, 0, "q")])
    turn, slide, last = robot.joints
    telescope = replace(robot, joints=(turn, replace(slide, **limits), last))
    assert lengths_beyond(robot) == pytest.approx([0.9, 0.4, 0.4])
    assert lengths_beyond(telescope) == pytest.approx([1.9, 1.4, 0.4])
    arm = sy.Robot.from_dh([(0, 0, "q", 0), (0, 0.4, 0, "q")])
    rail = replace(arm, joints=(replace(arm.joints[0], lower=0.0, upper=10.0), arm.joints[1]))
    assert [lengths_beyond(one).tolist() for one in (rail, arm)] == [pytest.approx([0.4, 0.4])] * 2
    masses, known = (physical_prior(sy.Model(one)).masses for one in (rail, arm))
    assert masses == pytest.approx(known)
    cart = sy.Robot.from_dh([(0, 0, "q", 0)])
    assert lengths_beyond(replace(cart, joints=(replace(cart.joints[0], **limits),))) == pytest.approx([1.0])


def test_links_that_only_join_axes_weigh_little_beside_described_ones(tmp_path):
    joint = f'<link name="tip">{inertial(*GOOD)}{shape()}</link><joint name="last" type="revolute"><parent link="l2"/>'
    joint += f'<child link="tip"/><axis xyz="0 0 1"/>{LIMIT}</joint>'
    prior = physical_prior(arm(tmp_path, inertial(*GOOD) + shape(), "", extra=joint))
    assert prior.sources == ("description", "kinematics", "description")
    assert prior.masses[1] < 0.05 * prior.masses[0]


@pytest.mark.slow
def test_moments_of_no_body_become_the_nearest_possible(tmp_path):
    cvxpy = pytest.importorskip("cvxpy")
    # As the Kinova Gen3 gives them: the largest moment is twice the sum of the others.
    given_inertia = Inertia.from_com(1.16, (-2e-5, -0.01, -0.07), np.diag([0.0146, 0.0048, 0.0004]))
    found, problem = possible_body(given_inertia.parameters, np.eye(4))
    assert problem == "belong to no body"
    answer = Inertia.from_parameters(found)
    assert answer.mass == pytest.approx(1.16)
    assert answer.com == pytest.approx(given_inertia.com)

    def second(inertia):
        return 0.5 * np.trace(inertia.about_com) * np.eye(3) - inertia.about_com

    largest = np.abs(np.linalg.eigvalsh(second(given_inertia) / 1.16)).max()
    unknown = cvxpy.Variable((3, 3), symmetric=True)
    least = 0.05**2 * largest * 1.16
    problem = cvxpy.Problem(
        cvxpy.Minimize(cvxpy.norm(1e3 * (unknown - second(given_inertia)), "fro")), [unknown >> least * np.eye(3)]
    )
    problem.solve(solver="CLARABEL")
    assert np.allclose(second(answer), unknown.value, atol=1e-6 * 1.16 * largest / 1e-3)

    content = inertial(1.16, "0 -0.01 0.2", (0.0146, 0.0048, 0.0004))
    model = arm(tmp_path, inertial(*GOOD) + shape(), content + shape())
    prior = physical_prior(model)
    assert prior.sources[1] == "description"
    assert said(prior, "`l2`", "belong to no body", "nearest possible")
    assert satisfied(model, prior)


def test_points_and_rods_get_an_extent(tmp_path):
    point = physical_prior(arm(tmp_path, inertial(*GOOD) + shape(), inertial(0.2, "0 0 0.1", (0, 0, 0)) + shape()))
    assert said(point, "`l2`", "are zero")
    found = body(point, 1)
    assert (found.mass, found.com[2]) == (pytest.approx(0.2), pytest.approx(0.1))
    assert found.about_com[0, 0] == pytest.approx(0.2 * (0.2**2 + 0.4**2) / 12)  # that of its shape
    rod = physical_prior(arm(tmp_path, inertial(*GOOD) + shape(), inertial(0.3, "0 0 0.2", (4e-3, 4e-3, 0)) + shape()))
    assert said(rod, "`l2`", "thinner")
    assert np.linalg.eigvalsh(pseudo_inertia(rod.links[1].parameters))[0] > 0


def test_a_centre_of_mass_outside_its_shape_is_drawn_in(tmp_path):
    # In millimetres, as some exporters write it.
    model = arm(tmp_path, inertial(*GOOD) + shape(), inertial(1.7, "0 0 150", (0.02, 0.02, 0.004)) + shape())
    prior = physical_prior(model)
    assert said(prior, "`l2`", "outside the shape")
    assert prior.links[1].lower[2] < body(prior, 1).com[2] < prior.links[1].upper[2]
    assert body(prior, 1).mass == pytest.approx(1.7)
    assert satisfied(model, prior)


def test_without_shapes_a_centre_of_mass_far_away_is_drawn_in_and_a_near_one_believed(tmp_path):
    far = arm(tmp_path, inertial(*GOOD), inertial(1.7, "0 0 150", (0.02, 0.02, 0.004)))
    prior = physical_prior(far)
    assert said(prior, "`l2`", "outside the body that spans the joints")
    assert satisfied(far, prior)
    near = arm(tmp_path, inertial(*GOOD), inertial(1.7, "0 0 0.9", (0.02, 0.02, 0.004)))
    prior = physical_prior(near)
    assert body(prior, 1).com[2] == pytest.approx(0.9)
    assert satisfied(near, prior)


def test_masses_that_no_link_of_its_length_has_are_not_believed(tmp_path):
    prior = physical_prior(arm(tmp_path, inertial(*GOOD), inertial(2.3e6, *GOOD[1:])))
    assert prior.sources == ("description", "kinematics")
    assert said(prior, "`l2`", "2.3e+06 kg")


def test_a_unit_that_is_wrong_is_wrong_for_what_is_fixed_to_a_link_too(tmp_path):
    """Masses in grams: links of 2.3 kg are impossible as 2300 kg, and a tool of 60 g is none of 60 kg."""
    links = [inertial(2300, *GOOD[1:]), inertial(2300, *GOOD[1:])]
    tool = fixed("tool", inertial(60, "0 0 0.02", (0.01, 0.01, 0.01)), "l2")
    wrong = physical_prior(arm(tmp_path, *links, extra=tool))
    assert wrong.sources == ("kinematics",) * 2
    assert wrong.scale_is_free
    right = physical_prior(arm(tmp_path, *[inertial(*GOOD)] * 2, extra=tool))
    assert right.masses[1] == pytest.approx(62.3)  # a heavy tool of a robot whose links can exist


def test_links_of_small_robots_are_as_thick_as_their_motors(tmp_path):
    """A pan-tilt head of 0.25 and 0.35 kg, without inertials, was taken for one of 3 and 7 g."""
    text = '<robot name="head"><link name="base"/><link name="pan"/><link name="tilt"/>'
    for name, parent, child, axis, height in (
        ("p", "base", "pan", "0 0 1", 0.03),
        ("t", "pan", "tilt", "0 1 0", 0.06),
    ):
        text += f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>{LIMIT}'
        text += f'<origin xyz="0 0 {height}"/><axis xyz="{axis}"/></joint>'
    (tmp_path / "head.urdf").write_text(text + "</robot>")
    masses = physical_prior(sy.Model(sy.Robot.from_urdf(tmp_path / "head.urdf"))).masses
    assert np.all(masses > 0.1 * np.array([0.25, 0.35]) * 0.9)
    assert np.all(masses < np.array([0.25, 0.35]))


def test_a_total_that_was_changed_in_code_counts(tmp_path):
    robot = arm(tmp_path, *[inertial(*GOOD) + shape()] * 2, extra=fixed("tool", inertial(1), "l2")).robot
    links = [replace(link, inertia=Inertia.from_com(4.4, (0.0, 0.0, 0.1), np.eye(3) * 0.02)) for link in robot.links]
    prior = physical_prior(sy.Model(replace(robot, links=tuple(links))))
    assert prior.masses == pytest.approx([4.4, 4.4])
    assert not prior.scale_is_free


def test_shapes_that_stand_for_nothing_are_no_shapes(tmp_path):
    point = physical_prior(arm(tmp_path, "", shape('<geometry><sphere radius="1e-7"/></geometry>')))
    assert point.sources == ("kinematics",) * 2
    model = arm(tmp_path, "", shape('<geometry><box size="0.3 0.3 1e-6"/></geometry>'))
    plate = physical_prior(model)
    assert np.linalg.eigvalsh(pseudo_inertia(plate.links[1].parameters / plate.masses[1]))[0] > 1e-7
    assert satisfied(model, plate)


def test_moments_larger_than_the_robot_are_replaced(tmp_path):
    model = arm(tmp_path, inertial(*GOOD) + shape(), inertial(1.7, "0 0 0.1", (30, 30, 10)) + shape())
    prior = physical_prior(model)
    assert said(prior, "`l2`", "larger than the robot")
    assert satisfied(model, prior)


def test_what_is_fixed_to_a_link_counts(tmp_path):
    links = [inertial(*GOOD) + shape()] * 2
    tool = inertial(0.8, "0 0 0.05", (0.002, 0.003, 0.004))
    sound = physical_prior(arm(tmp_path, *links, extra=fixed("tool", tool + shape(), "l2")))
    assert sound.masses[1] == pytest.approx(3.1)
    assert not sound.scale_is_free
    placeholder = physical_prior(arm(tmp_path, *links, extra=fixed("tool", inertial(1) + shape(), "l2")))
    assert said(placeholder, "`tool`, fixed to `l2`", "placeholder", "shape")
    assert placeholder.scale_is_free
    assert placeholder.links[1].fixed[9] == pytest.approx(2.3)
    frame = physical_prior(arm(tmp_path, *links, extra=fixed("tool", inertial(1), "l2")))
    assert said(frame, "`tool`, fixed to `l2`", "left out")
    assert frame.masses[1] == pytest.approx(2.3)
    # Next to nothing, as simulators want it of every frame, is not worth a word.
    quiet = physical_prior(arm(tmp_path, *links, extra=fixed("tool", inertial(0.001, moments=(1e-6,) * 3), "l2")))
    assert not said(quiet, "tool")


def test_parts_that_are_assumed_may_be_scaled_to_anything(tmp_path):
    # Moments of no body beside a tool that nobody weighed.
    links = [inertial(*GOOD) + shape(), inertial(1.16, "0 -0.01 0.2", (0.0146, 0.0048, 0.0004)) + shape()]
    model = arm(tmp_path, *links, extra=fixed("tool", inertial(1) + shape(), "l2"))
    for factor in (1e-3, 1.0, 10.0):
        prior = physical_prior(model).scaled(factor)
        assert np.linalg.eigvalsh(pseudo_inertia(prior.links[1].parameters))[0] > 1e-6
        assert satisfied(model, prior)


def test_links_that_weigh_next_to_nothing_leave_room_for_a_fit(tmp_path):
    model = arm(tmp_path, inertial(*GOOD), inertial(1.3e-7, "0 0 0.01", (1.1e-11, 1.2e-11, 1.3e-11)))
    prior = physical_prior(model)
    truth = np.nan_to_num(prior.parameters, nan=0.3)
    estimate = sy.fit(moved(model, truth), sy.FeasibleSet(model, constraints=list(prior.constraints)), prefer=None)
    assert estimate.relative_error < 0.05


def test_a_last_link_may_carry_a_tool_that_is_not_described(tmp_path):
    """However light its flange is; a link that carries others is as heavy as its description says, within limits."""
    flange = (0.15, "0 0 0.02", (2e-4, 2e-4, 3e-4))
    model = arm(tmp_path, inertial(*GOOD), inertial(*GOOD), inertial(*flange))
    prior = physical_prior(model)
    masses = [link.parameters[9] for link in prior.links]
    most = {one.links: one.maximum for one in prior.constraints if isinstance(one, TotalMass)}
    assert most["l2",] == pytest.approx(10.0 * masses[1])
    assert most["l3",] == pytest.approx(0.5 * sum(masses))
    tool = Inertia.from_com(2.0, (0.0, 0.02, 0.1), np.diag([0.01, 0.01, 0.008])).parameters
    carrying = np.nan_to_num(prior.parameters, nan=1.0)
    carrying[model.link_columns[2]] += tool
    assert satisfied(model, prior, carrying)


# Meshes


def write_stl(path, vertices, triangles):
    data = bytearray(b"\0" * 80 + struct.pack("<I", len(triangles)))
    for triangle in triangles:
        data += struct.pack("<12fH", 0, 0, 0, *np.asarray(vertices)[list(triangle)].ravel(), 0)
    path.write_bytes(data)


CORNERS = np.array([[x, y, z] for x in (-0.05, 0.05) for y in (-0.1, 0.1) for z in (-0.2, 0.2)])
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
TRIANGLES = [triangle for a, b, c, d in FACES for triangle in ((a, b, c), (a, c, d))]


def mesh(name="part.stl", scale="1 1 1"):
    return shape(f'<geometry><mesh filename="{name}" scale="{scale}"/></geometry>')


def test_meshes_count_by_their_convex_hulls(tmp_path):
    pytest.importorskip("coal")
    write_stl(tmp_path / "part.stl", CORNERS, TRIANGLES[2:])  # two sides are missing
    found = body(physical_prior(arm(tmp_path, "", mesh())), 1)
    assert found.about_com[2, 2] == pytest.approx(found.mass / 12 * (0.1**2 + 0.2**2), rel=1e-6)


@pytest.mark.slow
def test_missing_damaged_flat_and_large_meshes_are_left_out(tmp_path, monkeypatch):
    pytest.importorskip("coal")
    write_stl(tmp_path / "flat.stl", CORNERS[:4], [(0, 1, 3), (0, 3, 2)])
    (tmp_path / "damaged.stl").write_bytes(b"solid nothing")
    write_stl(tmp_path / "far.stl", 1e3 * CORNERS, TRIANGLES)
    for name, word in (
        ("absent.stl", "is not found"),
        ("damaged.stl", "cannot be read"),
        ("flat.stl", ""),
        ("far.stl", "millimetres"),
    ):
        model = arm(tmp_path, "", mesh(name))
        prior = physical_prior(model)
        assert prior.sources == ("kinematics", "kinematics"), name
        assert said(prior, "`l2`", word)
        assert satisfied(model, prior)
    assert physical_prior(arm(tmp_path, "", mesh("far.stl", "0.001 0.001 0.001"))).sources[1] == "shape"
    monkeypatch.setitem(physical_prior.__globals__, "LARGEST_MESH", 200)
    write_stl(tmp_path / "part.stl", CORNERS, TRIANGLES)
    assert said(physical_prior(arm(tmp_path, "", mesh())), "`l2`", "MB")


def test_masses_of_water_are_scaled_together(tmp_path):
    pytest.importorskip("coal")
    write_stl(tmp_path / "part.stl", CORNERS, TRIANGLES)
    whole = inertial(8.0, "0 0 0.2", tuple(8.0 / 12 * np.array([0.2**2 + 0.4**2, 0.1**2 + 0.4**2, 0.1**2 + 0.2**2])))
    prior = physical_prior(arm(tmp_path, *[whole + mesh()] * 2))
    assert said(prior, "1000 kg/m³", "no material")
    assert prior.scale_is_free
    assert prior.scaled(0.5).masses == pytest.approx([4.0, 4.0])


# What the user states


def test_stated_masses_and_symmetries_are_used_as_they_are():
    model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q"), ("pi/2", 0.1, 0, "q")]))
    user = [
        TotalMass(equal=12.0),
        MeasuredMass(3.0, "link2", standard_deviation=0.01),
        SymmetricLink("link3", plane="xz"),
        CenterOfMassBox("link1", lower=(-0.1, -0.1, -0.1), upper=(0.1, 0.1, 0.1)),
    ]
    prior = physical_prior(model, user)
    assert prior.masses.sum() == pytest.approx(12.0)
    assert prior.masses[1] == pytest.approx(3.0)
    assert not prior.scale_is_free
    assert satisfied(model, prior, user=user)
    kinds = [(type(one).__name__, getattr(one, "link", None)) for one in prior.constraints]
    assert ("CenterOfMassBox", "link1") not in kinds
    assert ("CenterOfMassBox", "link2") in kinds
    assert "TotalMass" not in [kind for kind, _ in kinds]  # no ranges beside what was weighed


def test_a_bound_of_the_total_mass_leaves_the_scale_free():
    model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")]))
    user = [TotalMass(maximum=1.0)]
    prior = physical_prior(model, user)
    assert prior.masses.sum() == pytest.approx(1.0)
    assert prior.scale_is_free
    assert prior.scaled(10.0).masses.sum() == pytest.approx(1.0)
    assert prior.scaled(0.1).masses.sum() == pytest.approx(0.1)


def test_a_symmetry_that_the_shape_does_not_have_is_imposed(tmp_path):
    content = shape(xyz="0.03 0.04 0.2")
    user = [SymmetricLink("l2", axis="z")]
    model = arm(tmp_path, "", content)
    prior = physical_prior(model, user)
    assert body(prior, 1).com[:2] == pytest.approx([0, 0], abs=1e-12)
    assert satisfied(model, prior, user=user)


# What the data say


def moved(model, parameters, count=400, seed=3):
    random = np.random.default_rng(seed)
    q, dq, ddq = random.uniform(-2, 2, size=(3, count, model.dof))
    torque = model.inverse_dynamics(q, dq, ddq, parameters)
    torque += 0.01 * np.abs(torque).mean() * random.normal(size=torque.shape)
    return sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))


@pytest.mark.parametrize("factor", [0.2, 3.0])
def test_the_data_tell_the_common_density(factor):
    rows = [("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q"), (0, 0.4, 0, "q")]
    model = sy.Model(sy.Robot.from_dh(rows).with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))
    prior = physical_prior(model)
    truth = prior.scaled(factor).parameters
    names = list(model.parameter_names)
    for index in np.flatnonzero(np.isnan(truth)):
        truth[index] = {"Fv": 0.3, "Fc": 0.5, "Fo": -0.4}[names[index][:2]]
    found = prior.scaled_to(moved(model, truth), sy.FeasibleSet(model))
    assert found.masses == pytest.approx(factor * prior.masses, rel=0.15)
    assert said(found, "By the data")
    assert found.scaled_to(moved(model, truth), sy.FeasibleSet(model)).masses == pytest.approx(found.masses, rel=0.1)


def test_data_without_masses_leave_the_density_as_it_is():
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")], gravity=(0, 0, 0))
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))
    prior = physical_prior(model)
    random = np.random.default_rng(3)
    q, dq = random.uniform(-2, 2, size=(2, 300, 2))
    samples = sy.Samples(q=q, dq=1e-3 * dq, ddq=np.zeros_like(q), torque=0.5 * np.sign(dq))
    found = prior.scaled_to(sy.Information.from_samples(model, samples), sy.FeasibleSet(model))
    assert found.masses == pytest.approx(prior.masses, rel=0.3)


def test_reduced_data_will_do():
    model = sy.Model(sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], gravity=(0, -9.81, 0)))
    prior = physical_prior(model)
    base = model.base_parameters()
    beta = base.K @ prior.scaled(2.0).parameters
    info = sy.Information.from_factor(30 * np.eye(base.count), 30 * beta, 1e-3, 1000, base.names)
    assert prior.scaled_to(info, sy.FeasibleSet(model)).masses == pytest.approx(2 * prior.masses, rel=0.15)


def test_symbolic_lengths_are_refused():
    with pytest.raises(sy.InputError, match="a1"):
        physical_prior(sy.Model(sy.Robot.from_dh([(0, "a1", 0, "q"), (0, 0.3, 0, "q")])))


def test_a_robot_without_any_length_is_not_bounded():
    prior = physical_prior(sy.Model(sy.Robot.from_dh([(0, 0, 0, "q")])))
    assert [type(one).__name__ for one in prior.constraints] == ["TotalMass"]
    assert said(prior, "one point")


def test_a_described_robot_without_any_length_is_used_as_it_is(tmp_path):
    text = f'<robot name="wheel"><link name="base"/><link name="l1">{inertial(*GOOD)}</link>'
    joint = '<joint name="j" type="continuous"><parent link="base"/><child link="l1"/></joint></robot>'
    (tmp_path / "wheel.urdf").write_text(text + joint)
    prior = physical_prior(sy.Model(sy.Robot.from_urdf(tmp_path / "wheel.urdf")))
    assert prior.sources == ("description",)
    assert body(prior, 0).com == pytest.approx([0.01, 0.02, 0.15])
    assert said(prior, "the link.")


lengths = st.sampled_from([0.0, 0.0, 0.03, 0.2, -0.5, 1.3])
angles = st.sampled_from(["0", "pi/2", "-pi/2", "0.3"])
rows = st.lists(st.tuples(angles, lengths, lengths, st.booleans()), min_size=1, max_size=7)


@given(rows)
def test_any_chain_gets_possible_bodies_within_their_bounds(chain):
    robot = sy.Robot.from_dh([(alpha, a, "q", 0.3) if slides else (alpha, a, d, "q") for alpha, a, d, slides in chain])
    model = sy.Model(robot)
    prior = physical_prior(model)
    for link in prior.links:
        assert np.linalg.eigvalsh(pseudo_inertia(link.parameters))[0] > 0
    assert satisfied(model, prior)


# Robots with known masses

ARMS = {
    "panda": ("panda_description/urdf/panda.urdf", "panda_link8"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "ee_link"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", "link7"),
    "talos": ("talos_data/robots/talos_left_arm.urdf", None),
    "tiago": ("tiago_description/robots/tiago_no_hand.urdf", "arm_tool_link"),
    "kinova": ("kinova_description/robots/kinova.urdf", "j2s6s200_link_6"),
}


def stripped(robot, shapes):
    """Return a robot without inertials, and without its shapes where they are not wanted."""
    links = tuple(
        replace(
            link,
            inertia=None,
            own_inertia=None,
            attachments=tuple(replace(one, inertia=None) for one in link.attachments),
        )
        for link in robot.links
    )
    return replace(robot, links=links, source=robot.source if shapes else None)


@pytest.mark.parametrize("shapes", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["kinematics", "shapes"])
@pytest.mark.parametrize("name", [pytest.param(name, marks=() if name == "ur5" else pytest.mark.slow) for name in ARMS])
def test_masses_of_robots_from_little_and_their_bounds(name, shapes):
    path, tip = ARMS[name]
    if not (ROBOTS / path).exists():
        pytest.skip("example-robot-data is not installed")
    if shapes:
        pytest.importorskip("coal")
    robot = sy.Robot.from_urdf(ROBOTS / path, tip=tip)
    truth = np.asarray(robot.parameters)
    model = sy.Model(stripped(robot, shapes))
    prior = physical_prior(model)
    assert set(prior.sources) == {"shape" if shapes else "kinematics"}
    assert satisfied(model, prior)
    found = prior.scaled_to(moved(sy.Model(robot), truth), sy.FeasibleSet(model))
    columns = np.array(model.link_columns)[:, 9]
    assert 0.5 < found.masses.sum() / truth[columns].sum() < 2.0
    assert np.all(np.abs(np.log(found.masses / truth[columns])) < np.log(10.0))
    assert satisfied(model, found, truth)
    # With its description, that is what counts, and the true robot is within the bounds too.
    described = physical_prior(sy.Model(replace(robot, source=robot.source if shapes else None)))
    assert set(described.sources) == {"description"}
    assert satisfied(sy.Model(robot), described, truth)


@pytest.mark.data
def test_real_robots(shared_data):
    """The TX40 lacks its meshes and the moments of link 6; two links of the Gen3 have moments of no body."""
    gen3 = physical_prior(sy.Model(sy.Robot.from_urdf(shared_data / "kinova_gen3" / "gen3.urdf")))
    assert set(gen3.sources) == {"description"}
    assert said(gen3, "shoulder_link", "belong to no body")
    tx40 = physical_prior(sy.Model(sy.Robot.from_urdf(shared_data / "staubli_tx40" / "tx40_mdh_modified.urdf")))
    assert said(tx40, "`link_6`", "are zero")
    assert said(tx40, "cannot be used", "link_1.stl")


@pytest.mark.data
def test_a_real_ur10_from_its_kinematics(shared_data):
    """The manufacturer's masses of the moving links add up to 28.7 kg."""
    result = sy.identify(
        Path(__file__).resolve().parents[2] / "examples" / "ur10.toml", [shared_data / "ur10_unisa" / "exciting.csv"]
    )
    prior = physical_prior(result.model).scaled_to(result.information, result.feasible_set)
    assert 28.7 / 2 < prior.masses.sum() < 28.7 * 2
    known = np.array([7.778, 12.93, 3.87, 1.96, 1.96, 0.202])
    assert np.all(np.abs(np.log(prior.masses / known)) < np.log(10.0))


def test_axes_of_a_gantry_whose_strokes_are_not_told_are_no_grams(tmp_path) -> None:
    """A bridge carries what slides on it; by its kinematics it weighs no less, and is said to be assumed."""
    text = '<robot name="gantry"><link name="base"/>'
    axes = (("bridge", "base", "1 0 0"), ("carriage", "bridge", "0 1 0"), ("ram", "carriage", "0 0 1"))
    for name, parent, axis in axes:
        text += f"""<link name="{name}"/><joint name="to_{name}" type="prismatic"><parent link="{parent}"/>
        <child link="{name}"/><axis xyz="{axis}"/><limit velocity="1" effort="900"/></joint>"""
    (tmp_path / "gantry.urdf").write_text(text + "</robot>")
    prior = physical_prior(sy.Model(sy.Robot.from_urdf(tmp_path / "gantry.urdf")))
    bridge, carriage, ram = prior.masses
    assert bridge >= carriage >= ram > 0.05
    assert set(prior.sources) == {"kinematics"}
