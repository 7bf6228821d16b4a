"""Defects of descriptions that are named before anything moves."""

import re

import numpy as np
import pytest
from planted_defects import DEFECTS, ROBOTS, installed, named, planted

import steelyard as sy
from steelyard.identification.preflight import preflight
from steelyard.robot import Inertia, Robot
from steelyard.robot.described_inertia import remark_on_base

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


BODY = """<inertial><origin xyz="0 0 0.08"/><mass value="1.5"/>
<inertia ixx="0.0046" iyy="0.0048" izz="{}" ixy="0" ixz="0" iyz="0.0014"/></inertial>"""
POSSIBLE, IMPOSSIBLE = BODY.format(0.007), BODY.format(0.0722)
STANDING_URDF = """<robot name="standing">
<link name="root">{root}</link><link name="plate">{plate}</link><link name="arm">{arm}</link>
<joint name="fixed" type="fixed"><parent link="root"/><child link="plate"/></joint>
<joint name="hinge" type="revolute"><parent link="plate"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="9" velocity="3"/></joint></robot>
"""


@pytest.mark.parametrize("standing", [("root",), ("plate",), ("root", "plate")])
def test_what_stands_still_and_no_body_can_be_is_mended(standing, tmp_path) -> None:
    """MuJoCo is the judge: it refuses the description, and takes what is mended, which is all else the same."""
    mujoco = pytest.importorskip("mujoco")
    texts = {name: IMPOSSIBLE if name in standing else POSSIBLE for name in ("root", "plate", "arm")}
    source, target = tmp_path / "standing.urdf", tmp_path / "mended.urdf"
    source.write_text(STANDING_URDF.format(**texts))
    with pytest.raises(ValueError, match=r"A \+ B >= C"):
        mujoco.MjModel.from_xml_path(str(source))
    robot = Robot.from_urdf(source)
    found = preflight(robot)
    assert [one.link for one in found.findings] == list(standing)
    assert remark_on_base(robot).startswith(f"{', '.join(standing)} stand")
    assert [link for link, _ in found.write(target)] == list(standing)
    mujoco.MjModel.from_xml_path(str(target))
    mended = Robot.from_urdf(target)
    assert not preflight(mended).findings
    assert not remark_on_base(mended)
    np.testing.assert_array_equal(mended.parameters, robot.parameters)
    rest = re.compile(f'<link name="({"|".join(standing)})">.*?</link>', re.DOTALL)
    assert rest.sub("", target.read_text()) == rest.sub("", source.read_text())
    (body, *_) = [one for one in found.links if one.link in standing]
    assert body.mended.mass == body.described.mass
    np.testing.assert_allclose(body.mended.com, body.described.com)


def test_what_stands_still_in_an_sdf_is_mended(tmp_path) -> None:
    moments = "<inertia><ixx>0.0046</ixx><iyy>0.0048</iyy><izz>{}</izz></inertia>"
    link = '<link name="{}"><inertial><mass>1.5</mass>' + moments + "</inertial></link>"
    links = link.format("plate", 0.0722) + link.format("arm", 0.007)
    anchor = '<joint name="held" type="fixed"><parent>world</parent><child>plate</child></joint>'
    hinge = '<joint name="hinge" type="revolute"><parent>plate</parent><child>arm</child><axis><xyz>0 1 0</xyz></axis>'
    source, target = tmp_path / "standing.sdf", tmp_path / "mended.sdf"
    source.write_text(f'<sdf version="1.9"><model name="standing">{links}{anchor}{hinge}</joint></model></sdf>')
    found = preflight(Robot.from_sdf(source))
    assert [link for link, _ in found.write(target)] == ["plate"]
    izz = [float(text) for text in re.findall("<izz>(.*?)</izz>", target.read_text())]
    ixx = [float(text) for text in re.findall("<ixx>(.*?)</ixx>", target.read_text())]
    iyy = [float(text) for text in re.findall("<iyy>(.*?)</iyy>", target.read_text())]
    assert izz[0] < ixx[0] + iyy[0]
    assert izz[1] == 0.007
    assert not preflight(Robot.from_sdf(target)).findings


@pytest.mark.data
def test_base_of_a_gen3(shared_data, tmp_path) -> None:
    mujoco = pytest.importorskip("mujoco")
    folder = shared_data / "kinova_gen3"
    result = sy.identify(folder / "gen3.urdf", folder / "opti_traj_testing2.csv")
    (remark,) = (one for one in result.remarks if one.startswith("base_link stands still"))
    assert remark.endswith(f"steelyard inspect {folder / 'gen3.urdf'} --repair --output REPAIRED.urdf")
    result.save(tmp_path / "out")
    with pytest.raises(ValueError, match=r"A \+ B >= C"):
        mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "robot.urdf"))
    preflight(Robot.from_urdf(tmp_path / "out" / "robot.urdf")).write(tmp_path / "mended.urdf")
    mujoco.MjModel.from_xml_path(str(tmp_path / "mended.urdf"))


def arm_of_boxes(tensor_of_second):
    """Two links that are homogeneous boxes of 1000 kg/m³, the second with another tensor about its centre of mass."""
    sizes, com, mass = np.array([0.08, 0.06, 0.3]), np.array([0.01, 0.02, 0.15]), 1.44
    tensor = np.diag(mass / 12.0 * (np.sum(sizes**2) - sizes**2))
    steiner = mass * (com @ com * np.eye(3) - np.outer(com, com))
    links = '<link name="base"/>'
    for name, own in (("l1", tensor), ("l2", tensor_of_second(tensor, steiner))):
        moments = "".join(f' i{"xyz"[i]}{"xyz"[j]}="{own[i, j]}"' for i in range(3) for j in range(i, 3))
        shape = f'<geometry><box size="{" ".join(map(str, sizes))}"/></geometry>'
        place = f'<origin xyz="{" ".join(map(str, com))}"/>'
        links += (
            f'<link name="{name}"><inertial>{place}<mass value="{mass}"/><inertia{moments}/></inertial>'
            f"<collision>{place}{shape}</collision></link>"
        )
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="{above}"/><child link="l{k}"/><axis xyz="0 1 0"/>'
        '<origin xyz="0 0 0.3"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        for k, above in ((1, "base"), (2, "l1"))
    )
    return f'<robot name="boxes">{links}{joints}</robot>'


@pytest.mark.parametrize(
    ("tensor_of_second", "evidence"),
    [
        (lambda tensor, steiner: 0.0 * tensor, "its moments of inertia are zero"),
        (lambda tensor, steiner: tensor - steiner, "no body has these moments of inertia"),
    ],
    ids=["zeros", "offset taken twice"],
)
def test_no_cause_is_named_that_leaves_an_impossible_body(tmp_path, tensor_of_second, evidence):
    """Zeros were called inertia about the origin, by the rounding of what is left about the centre of mass."""
    path = tmp_path / "boxes.urdf"
    path.write_text(arm_of_boxes(tensor_of_second))
    found = preflight(Robot.from_urdf(path))
    (one,) = found.findings
    assert one.link == "l2"
    assert not one.possible
    assert (one.cause, one.is_guess) == ("impossible", False)
    assert one.evidence.startswith(evidence)
    assert np.linalg.eigvalsh(one.mended.pseudo_inertia)[0] > 0.0


@pytest.mark.parametrize("digits", [3, 5, 6])
def test_plates_whose_moments_are_rounded_are_told_so(tmp_path, digits):
    """Of a plate one moment is the sum of the others: rounded, half of them are less than that or more."""
    random = np.random.default_rng(digits)
    plates = [(random.uniform(0.5, 3.0), *random.uniform(0.1, 0.4, 2)) for _ in range(12)]
    told = []
    for number, (mass, a, b) in enumerate(plates):
        moments = [float(f"{mass / 12.0 * value:.{digits}g}") for value in (b * b, a * a, a * a + b * b)]
        path = tmp_path / f"{number}.urdf"
        path.write_text(
            f"""<robot name="plate"><link name="base"/><link name="plate"><inertial><origin xyz="0.1 0.02 0"/>
            <mass value="{mass}"/><inertia ixx="{moments[0]}" iyy="{moments[1]}" izz="{moments[2]}" ixy="0" ixz="0"
            iyz="0"/></inertial></link><joint name="j" type="revolute"><parent link="base"/><child link="plate"/>
            <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
        )
        (link,) = preflight(sy.Robot.from_urdf(path)).links
        beyond = moments[2] - moments[0] - moments[1]
        assert (link.cause == "rounding") == (beyond > 1e-12 * moments[2])
        told.append(link.cause)
    assert 1 < told.count("rounding") < 12
    worse = path.read_text().replace(f'izz="{moments[2]}"', f'izz="{1.1 * moments[2]}"')
    path.write_text(worse)
    (link,) = preflight(sy.Robot.from_urdf(path)).links
    assert link.cause != "rounding"


def test_a_sound_arm_of_boxes_passes(tmp_path):
    path = tmp_path / "boxes.urdf"
    path.write_text(arm_of_boxes(lambda tensor, steiner: tensor))
    assert preflight(Robot.from_urdf(path)).findings == ()
