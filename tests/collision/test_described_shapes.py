"""Shapes of SDF and MJCF: where MuJoCo puts them, and as in a URDF of the same robot."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.collision import Mesh, RobotGeometry, shapes_of_moving_links, visual_shapes
from steelyard.collision.described_shapes import ellipsoid
from steelyard.errors import InputError
from steelyard.estimators.physical_prior import physical_prior
from steelyard.robot import Robot, mjcf_compiled, mjcf_document
from steelyard.robot.description import read_description

pytestmark = pytest.mark.usefixtures("meshes_in_this_process")

CORNERS = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0, 0, 0.4]])
OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
MJCF = """<mujoco><compiler angle="radian" meshdir="parts"/>
<default><geom rgba="1 0 0 1"/><default class="shown"><geom contype="0" conaffinity="0"/></default></default>
<asset><mesh name="horn" file="horn.obj" scale="2 1 0.5" refpos="0.1 0 0" refquat="1 1 0 0"/>
<mesh name="inline" vertex="0 0 0 0.1 0 0 0 0.1 0 0 0 0.1"/></asset>
<worldbody><geom name="floor" type="plane" size="1 1 1"/><geom type="box" size="0.1 0.2 0.3" pos="0 0 -1"/>
<body name="upper" pos="0 0 1" euler="0.1 0.2 0.3"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
 <joint name="one" axis="0 1 0" pos="0.1 0 0"/>
 <geom type="capsule" fromto="0 0 0 0.3 0.1 0" size="0.05"/><geom type="mesh" mesh="horn" pos="0.1 0 0" zaxis="0 1 1"/>
 <geom class="shown" type="sphere" size="0.3"/>
 <frame pos="0 0.2 0" euler="0 0 1"><body name="lower"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
  <joint name="two" axis="0 0 1"/><geom type="cylinder" size="0.1 0.2" xyaxes="0 1 0 0 0 1"/>
  <geom type="ellipsoid" size="0.1 0.2 0.3" pos="0.1 0 0"/><geom type="mesh" mesh="inline"/></body></frame>
</body></worldbody></mujoco>"""
INERTIAL = '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
URDF = """<robot name="arm"><link name="base"/><link name="a"><collision><origin xyz="0.1 0 0" rpy="0 1 0"/>
<geometry><cylinder radius="0.05" length="0.4"/></geometry></collision>
<visual><geometry><mesh filename="parts/horn.obj" scale="2 1 1"/></geometry></visual></link>
<link name="b"><collision><origin xyz="0 0 0.2"/><geometry><box size="0.1 0.2 0.4"/></geometry></collision></link>
<joint name="one" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/></joint>
<joint name="two" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/>
</joint></robot>"""
SDF = """<sdf version="1.9"><model name="arm"><link name="base"/><frame name="f"><pose>0.1 0 0 0 0 0</pose></frame>
<link name="a"><collision name="c"><pose relative_to="f">0 0 0 0 1 0</pose><geometry>
<cylinder><radius>0.05</radius><length>0.4</length></cylinder></geometry></collision>
<visual name="v"><geometry><mesh><uri>parts/horn.obj</uri><scale>2 1 1</scale></mesh></geometry></visual></link>
<link name="b"><pose>0.4 0 0 0 0 0</pose><collision name="c"><pose>0 0 0.2 0 0 0</pose><geometry>
<box><size>0.1 0.2 0.4</size></box></geometry></collision>
<visual name="v"><geometry><plane/></geometry></visual></link>
<joint name="one" type="continuous"><parent>base</parent><child>a</child><axis><xyz>0 1 0</xyz></axis></joint>
<joint name="two" type="continuous"><parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz></axis></joint>
</model></sdf>"""


@pytest.fixture
def place(tmp_path):
    pytest.importorskip("trimesh", reason="no package that reads meshes is installed")
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "horn.obj").write_text(OBJ)
    for name, text in (("arm.xml", MJCF), ("arm.urdf", URDF), ("arm.sdf", SDF)):
        (tmp_path / name).write_text(text)
    return tmp_path


def test_geoms_are_where_mujoco_puts_them(place):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (the oracle) is not installed")
    world = mujoco.MjModel.from_xml_path(str(place / "arm.xml"))
    data = mujoco.MjData(world)
    data.qpos[:] = q = np.array([0.4, -0.7])
    mujoco.mj_forward(world, data)
    robot = Robot.from_mjcf(place / "arm.xml")
    model, geometry = sy.Model(robot), RobotGeometry.from_description(robot)
    theirs = [k for k in range(world.ngeom) if world.geom_contype[k] and world.geom_type[k] != 0]
    assert len(theirs) == len(geometry.shapes) == 6
    kinds = {2: "sphere", 3: "capsule", 4: "ellipsoid", 5: "cylinder", 6: "box", 7: "mesh"}
    found = []
    for k in theirs:
        turn, center = data.geom_xmat[k].reshape(3, 3), data.geom_xpos[k]
        size = world.geom_size[k]
        match kinds[int(world.geom_type[k])]:
            case "mesh":
                start = world.mesh_vertadr[world.geom_dataid[k]]
                points = world.mesh_vert[start : start + world.mesh_vertnum[world.geom_dataid[k]]]
            case "capsule":
                points = np.array([[0, 0, size[1]], [0, 0, -size[1]]])
            case _:
                points = np.zeros((1, 3))
        points = points @ turn.T + center
        found.append((world.body(world.geom_bodyid[k]).name, points.min(axis=0), points.max(axis=0)))
    for one in geometry.shapes:
        pose = np.eye(4) if one.body < 0 else model.pose(q, one.link)
        placed = pose @ one.placement
        points = np.zeros((1, 3))
        if isinstance(one.shape, Mesh) and len(one.shape.vertices) < 10:
            points = one.shape.vertices
        elif one.shape.kind == "capsule":
            points = np.array([[0, 0, one.shape.length / 2], [0, 0, -one.shape.length / 2]])
        points = points @ placed[:3, :3].T + placed[:3, 3]
        box = (points.min(axis=0), points.max(axis=0))
        assert any(name == one.link and np.allclose(box, corners, rtol=0.0, atol=1e-6) for name, *corners in found), one


def test_an_ellipsoid_lies_within_the_polyhedron_that_stands_for_it():
    axes = np.array([0.1, 0.2, 0.3])
    directions = np.random.default_rng(0).normal(size=(500, 3))
    # How far a body reaches in a direction.
    reach = (ellipsoid(*axes).vertices @ directions.T).max(axis=0)
    exact = np.linalg.norm(directions * axes, axis=1)
    assert np.all((reach >= exact) & (reach <= 1.02 * exact))


def test_shapes_of_an_sdf_are_those_of_the_same_urdf(place):
    robots = [read_description(place / f"arm.{suffix}") for suffix in ("urdf", "sdf")]
    first, second = (RobotGeometry.from_description(robot) for robot in robots)
    assert [(one.link, one.shape) for one in first.shapes] == [(one.link, one.shape) for one in second.shapes]
    for one, other in zip(first.shapes, second.shapes, strict=True):
        assert np.allclose(one.placement, other.placement, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("suffix", ["sdf", "xml"])
def test_the_prior_takes_shapes_of_every_format(place, suffix):
    """A link without a weight of its own has that of its shape, as with the URDF of the same robot."""
    if suffix == "xml":
        text = """<mujoco><compiler inertiafromgeom="false" meshdir="parts"/><asset><mesh name="h" file="horn.obj"
scale="2 1 1"/></asset><worldbody><body name="a"><joint name="one" axis="0 1 0"/>
<geom type="cylinder" size="0.05 0.2" pos="0.1 0 0" euler="0 57.29577951308232 0"/>
<geom type="mesh" mesh="h" contype="0" conaffinity="0"/><body name="b" pos="0.4 0 0"><joint name="two" axis="0 0 1"/>
<geom type="box" size="0.05 0.1 0.2" pos="0 0 0.2"/></body></body></worldbody></mujoco>"""
        (place / "arm.xml").write_text(text)
    expected, found = (
        physical_prior(sy.Model(read_description(place / f"arm.{one}"))).links for one in ("urdf", suffix)
    )
    assert [one.source for one in expected] == ["shape", "shape"]
    assert [one.source for one in found] == ["shape", "shape"]
    for one, other in zip(expected, found, strict=True):
        assert np.allclose(one.parameters, other.parameters, rtol=1e-9)
        assert np.allclose(one.lower, other.lower, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("arm.xml", ('size="0.1 0.2"', 'size="0.1 -0.2"'), r"arm\.xml, line 11: a cylinder: length"),
        ("arm.xml", ("horn.obj", "../../../horn.obj"), "leads out of"),
        ("arm.xml", ('type="cylinder"', 'type="box" mesh="inline"'), "a box that is fitted to a mesh cannot be read"),
        ("arm.sdf", ("<radius>0.05</radius>", "<radius>0</radius>"), r'arm\.sdf, line 3: link "a": .*radius'),
        ("arm.sdf", ("<uri>parts", "<submesh><name>x</name></submesh><uri>parts"), ""),
        ("arm.sdf", ('<box><size>0.1 0.2 0.4</size></box>', "<cone/>"), "<cone> cannot be read as a shape"),
    ],
)  # fmt: skip
def test_shapes_that_cannot_be_read_are_named_with_their_line(place, name, change, message):
    text = (place / name).read_text()
    (place / name).write_text(text.replace(*change))
    assert change[0] in text
    robot = read_description(place / name)
    if not message:  # what is seen alone keeps clear of nothing
        assert len(RobotGeometry.from_description(robot).shapes) == 2
        return
    with pytest.raises(InputError, match=message):
        RobotGeometry.from_description(robot)


@pytest.mark.slow
def test_what_is_seen_of_an_mjcf_does_not_take_mujoco_again(place, monkeypatch):
    """Nor is the file read a second time for its tree."""
    pytest.importorskip("mujoco", reason="MuJoCo (extra `mjcf`) is not installed")
    path = place / "arm.xml"
    path.write_text(path.read_text().replace('<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>', "", 1))
    robot = Robot.from_mjcf(path)  # the mesh weighs, so that MuJoCo compiles the file
    started, read = [], []
    monkeypatch.setattr(mjcf_compiled, "run_child", lambda *given, **named: started.append(given) or (b"{", 1))
    monkeypatch.setattr(mjcf_document, "read_bytes", lambda *given, **named: read.append(given) or path.read_bytes())
    assert len(shapes_of_moving_links(robot, path, [], 10**6)["visual"]) == 1
    assert len(visual_shapes(robot, path, [], 10**6)) == 1
    assert (len(started), len(read)) == (0, 2)
    with pytest.raises(InputError, match="MuJoCo ended without an answer"):  # the parents of links are of its tree
        RobotGeometry.from_description(robot)
    assert (len(started), len(read)) == (1, 3)
