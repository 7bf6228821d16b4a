"""Defects of descriptions that are named before anything moves."""

import numpy as np
import pytest
from planted_defects import DEFECTS, ROBOTS, installed, named, planted

from steelyard.identification.preflight import preflight
from steelyard.robot import Inertia, Robot

pytestmark = pytest.mark.usefixtures("meshes_in_this_process", "installed_shapes_once")
NEEDED = pytest.mark.skipif(not (installed() / ROBOTS[0]).exists(), reason="example-robot-data is not installed")


@NEEDED
@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_good_arms_pass(name):
    found = preflight(Robot.from_urdf(installed() / name))
    assert found.findings == ()
    assert all(one.possible and one.margin > 0.0 for one in found.links)


@NEEDED
@pytest.mark.parametrize(
    "defect",
    [
        "mass in g",
        pytest.param("inertia in kg mm²", marks=pytest.mark.slow),
        pytest.param("decimal slip of ixx", marks=pytest.mark.slow),
        pytest.param("swapped axes", marks=pytest.mark.slow),
        pytest.param("copied link", marks=pytest.mark.slow),
        pytest.param("placeholder", marks=pytest.mark.slow),
    ],
)
def test_the_cause_of_a_planted_defect_is_named(defect):
    robot, link = planted(installed() / ROBOTS[1], defect)
    found = {one.link: one for one in preflight(robot).findings}
    assert named(found[link].cause, defect)


@NEEDED
@pytest.mark.slow
def test_most_of_thirty_planted_defects_are_named():
    right = 0
    for name in ROBOTS:
        for defect in DEFECTS:
            robot, link = planted(installed() / name, defect)
            found = {one.link: one.cause for one in preflight(robot).findings}
            right += named(found.get(link, ""), defect)
    assert right >= 25


@pytest.mark.slow
@NEEDED
def test_a_unit_is_mended():
    truth = Robot.from_urdf(installed() / ROBOTS[1])
    robot, _ = planted(installed() / ROBOTS[1], "inertia in kg mm²")
    assert np.allclose(preflight(robot).repaired(), truth.parameters, rtol=1e-9, atol=1e-12)


def test_every_impossible_link_is_found_and_mended():
    """Beside an independent test: a body can have moments of inertia where none is more than the two others."""
    random = np.random.default_rng(4)
    for _ in range(16):
        inertias, expected = {}, []
        for number in (1, 2, 3):
            turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
            moments = random.uniform(0.01, 0.1, 3)
            tensor = turn @ np.diag(moments) @ turn.T
            inertias[f"link{number}"] = Inertia.from_com(random.uniform(1, 3), random.normal(size=3) * 0.1, tensor)
            expected.append(bool(moments.max() <= moments.sum() - moments.max()))
        robot = Robot.from_dh([(0, 0.3, 0, "q"), ("pi/2", 0.3, 0, "q"), (0, 0.2, 0, "q")], inertias=inertias)
        found = preflight(robot)
        assert [one.possible for one in found.links] == expected
        repaired = found.repaired()
        for start in robot.link_starts:
            body = Inertia.from_parameters(repaired[start : start + 10])
            assert np.linalg.eigvalsh(body.pseudo_inertia)[0] > 0.0


def test_robots_without_size_or_inertia():
    body = Inertia.from_com(1.0, (0.1, 0, 0), np.diag([0.01, 0.01, 0.05]))
    found = preflight(Robot.from_dh([(0, "a1", 0, "q")], inertias={"link1": body}))
    assert [one.cause for one in found.findings] == ["impossible"]
    assert preflight(Robot.from_dh([(0, 0.3, 0, "q")])).links == ()


def box(mass, sizes, place="0 0 0"):
    """An inertial of URDF: a homogeneous box."""
    x, y, z = (mass / 12.0 * (sum(one**2 for one in sizes) - own**2) for own in sizes)
    return (
        f'<inertial><origin xyz="{place}"/><mass value="{mass}"/>'
        f'<inertia ixx="{x}" ixy="0" ixz="0" iyy="{y}" iyz="0" izz="{z}"/></inertial>'
    )


def test_nothing_is_wrong_with_a_gantry_of_boxes(tmp_path):
    """Carriages are shorter than their ways; the tool alone has a shape, the one that its inertial is of."""
    sizes = (0.05, 0.05, 0.07)
    shape = f'<visual><geometry><box size="{" ".join(map(str, sizes))}"/></geometry></visual>'
    links = [box(8.0, (0.3, 0.2, 0.1)), box(5.0, (0.2, 0.2, 0.3)), box(3.0, (0.1, 0.1, 0.8)), box(0.8, sizes) + shape]
    ways = [
        ("prismatic", "1 0 0", 2.0),
        ("prismatic", "0 1 0", 1.5),
        ("prismatic", "0 0 1", 1.0),
        ("revolute", "0 0 1", 3),
    ]
    text = "".join(f'<link name="l{k}">{link}</link>' for k, link in enumerate(["", *links]))
    text += "".join(
        f'<joint name="j{k}" type="{kind}"><parent link="l{k}"/><child link="l{k + 1}"/><axis xyz="{axis}"/>'
        f'<origin xyz="0 0 {-0.5 * (k == 3)}"/><limit lower="{-way}" upper="{way}" effort="1" velocity="1"/></joint>'
        for k, (kind, axis, way) in enumerate(ways)
    )
    path = tmp_path / "gantry.urdf"
    path.write_text(f'<robot name="gantry">{text}</robot>')
    assert preflight(Robot.from_urdf(path)).findings == ()


def test_legs_that_are_alike_are_no_copies_where_one_has_no_shape(tmp_path):
    """Two legs with the same inertials, of which the description shows all links but one."""
    links, joints = '<link name="trunk"/>', ""
    for side, place in (("left", 0.1), ("right", -0.1)):
        for name, above, size, origin in (
            ("thigh", "trunk", 0.05, f"0 {place} 0"),
            ("calf", f"{side}_thigh", 0.04, "0 0 -0.3"),
        ):
            shape = f'<geometry><box size="{size} {size} 0.3"/></geometry>'
            shape = f'<visual><origin xyz="0 0 -0.15"/>{shape}</visual>' * ((side, name) != ("right", "calf"))
            inertial = box(1.2e3 * 0.3 * size**2, (size, size, 0.3), "0 0.001 -0.15")
            links += f'<link name="{side}_{name}">{inertial}{shape}</link>'
            joints += (
                f'<joint name="{side}_{name}" type="revolute"><parent link="{above}"/><child link="{side}_{name}"/>'
                f'<origin xyz="{origin}"/><axis xyz="0 1 0"/></joint>'
            )
    path = tmp_path / "legs.urdf"
    path.write_text(f'<robot name="legs">{links}{joints}</robot>')
    assert preflight(Robot.from_urdf(path)).findings == ()
