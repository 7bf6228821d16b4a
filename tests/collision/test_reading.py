"""Collision geometry from URDF and SRDF files, and the files of meshes."""

import os
import sys

import numpy as np
import pytest

from steelyard import Robot
from steelyard.collision import Box, Capsule, Cylinder, Mesh, PlacedShape, RobotGeometry, Sphere, shapes
from steelyard.collision.mesh_files import find_mesh, read_mesh
from steelyard.collision.self_collision import read_srdf
from steelyard.errors import InputError, MissingExtraError

LINKS = """
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2"/></joint>
  <joint name="hold" type="fixed"><parent link="arm"/><child link="hand"/>
    <origin xyz="0.5 0 0" rpy="0 0 1.5707963"/></joint>
  <joint name="slide" type="prismatic"><parent link="hand"/><child link="finger"/><origin xyz="0 0.1 0"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.1"/></joint>
"""
PYRAMID = "v 0 0 0\nv 2 0 0\nv 0 2 0\nv 0 0 2\nv 0.1 0.1 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def write(folder, collisions, name="robot.urdf"):
    """A URDF with collision elements by link."""
    folder.mkdir(parents=True, exist_ok=True)
    links = "".join(
        f'<link name="{link}">{collisions.get(link, "")}</link>\n' for link in ("base", "arm", "hand", "finger")
    )
    path = folder / name
    path.write_text(f'<robot name="gripper">\n{links}{LINKS}</robot>')
    return path


def shape(text, origin=""):
    return f"<collision>{origin}<geometry>{text}</geometry></collision>"


def read(path, locked=(), **options):
    return RobotGeometry.from_urdf(Robot.from_urdf(path, locked=locked), **options)


def test_shapes_are_placed_in_the_frames_of_moving_links(tmp_path):
    origin = '<origin xyz="0.1 0.2 0.3"/>'
    path = write(
        tmp_path,
        {
            "base": shape('<box size="1 2 3"/>'),
            "hand": shape('<cylinder radius="0.1" length="0.2"/>', origin),
            "finger": shape('<sphere radius="0.05"/>') + shape('<capsule radius="0.01" length="0.04"/>', origin),
        },
    )
    geometry = read(path, locked={"slide": 0.04})
    assert geometry.links == ("base", "hand", "finger")
    assert geometry.bodies == (-1, 0)
    base, hand, ball, rod = geometry.shapes
    assert base.shape == Box((1.0, 2.0, 3.0))
    assert hand.shape == Cylinder(0.1, 0.2)
    assert (ball.shape, rod.shape) == (Sphere(0.05), Capsule(0.01, 0.04))
    assert [one.body for one in geometry.shapes] == [-1, 0, 0, 0]
    # The hand is turned by a quarter: its y is -x of the arm.
    np.testing.assert_allclose(hand.placement[:3, 3], [0.5 - 0.2, 0.1, 0.3], atol=1e-6)
    np.testing.assert_allclose(ball.placement[:3, 3], [0.5 - 0.1, 0.04, 0.0], atol=1e-6)
    assert "finger: Sphere(radius=0.05), Capsule(radius=0.01, length=0.04)" in repr(geometry)
    assert geometry.between("base", "finger") == ("arm", "hand")


def test_side_branches_beyond_the_tip_are_left_out(tmp_path):
    path = write(tmp_path, {"arm": shape('<sphere radius="1"/>'), "finger": shape('<sphere radius="1"/>')})
    robot = Robot.from_urdf(path, tip="hand")
    assert RobotGeometry.from_urdf(robot).links == ("arm",)


@pytest.mark.parametrize("library", ["coal", "trimesh"])
def test_meshes_are_scaled_and_read_by_either_library(library, tmp_path, monkeypatch, meshes_in_this_process):
    pytest.importorskip(library, reason=f"{library} is not installed")
    if library == "trimesh":
        monkeypatch.setattr("steelyard.collision.mesh_files.coal_or_none", lambda: None)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "pyramid.obj").write_text(PYRAMID)
    path = write(tmp_path, {"arm": shape('<mesh filename="meshes/pyramid.obj" scale="1 -0.5 0.25"/>')})
    mesh = read(path).shapes[0].shape
    corners = {tuple(corner) for corner in mesh.hull[0].round(6).tolist()}
    assert corners == {(0, 0, 0), (2, 0, 0), (0, -1, 0), (0, 0, 0.5)}
    exact = read(path, meshes="exact").shapes[0].shape
    assert exact.surface_only
    assert len(exact.triangles) == 4


def test_packages_are_found(tmp_path, monkeypatch):
    for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(name, raising=False)
    urdf = tmp_path / "own" / "urdf" / "robot.urdf"
    places = {
        "option": tmp_path / "given" / "thing_description",
        "itself": tmp_path / "direct" / "thing_description",
        "ros": tmp_path / "workspace" / "thing_description",
        "ament": tmp_path / "install" / "share" / "thing_description",
        "parent": tmp_path / "own" / "thing_description",
        "beside": tmp_path / "own" / "urdf" / "thing_description",
    }
    reference = "package://thing_description/meshes/a.stl"

    def make(place):
        (places[place] / "meshes").mkdir(parents=True)
        (places[place] / "meshes" / "a.stl").write_text("")
        return places[place] / "meshes" / "a.stl"

    with pytest.raises(InputError, match=r"stl\" is not found \(looked for .*ROS.*, or put it beside the description"):
        find_mesh(reference, urdf)
    made = make("parent")
    assert find_mesh(reference, urdf) == made
    made = make("beside")
    assert find_mesh(reference, urdf) == made
    made = make("ament")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    assert find_mesh(reference, urdf) == made
    made = make("ros")
    monkeypatch.setenv("ROS_PACKAGE_PATH", os.pathsep.join([str(tmp_path / "none"), str(tmp_path / "workspace")]))
    assert find_mesh(reference, urdf) == made
    made = make("option")
    assert find_mesh(reference, urdf, [tmp_path / "given"]) == made
    made = make("itself")
    assert find_mesh(reference.replace("package", "model"), urdf, [places["itself"]]) == made


def test_a_package_above_the_urdf_that_holds_it(tmp_path, monkeypatch):
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    urdf = tmp_path / "thing" / "urdf" / "robot.urdf"
    mesh = tmp_path / "thing" / "meshes" / "a.stl"
    for folder in (mesh.parent, urdf.parent):
        folder.mkdir(parents=True)
    mesh.write_text("")
    assert find_mesh("package://thing/meshes/a.stl", urdf) == mesh
    spaced = tmp_path / "a b.stl"
    spaced.write_text("")
    assert find_mesh(f"file://{tmp_path}/a%20b.stl", urdf) == spaced
    assert find_mesh("../meshes/a.stl", urdf).samefile(mesh)
    assert find_mesh(str(mesh), urdf) == mesh


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<collision/>", r'robot.urdf, line 3: link "arm": a <collision> has no <geometry>'),
        (shape(""), "holds one shape, found 0"),
        (shape('<sphere radius="1"/><box size="1 1 1"/>'), "holds one shape, found 2"),
        (shape("<sphere/>"), "<sphere> has no radius"),
        (shape('<sphere radius="0"/>'), r'line 3: link "arm": a sphere: radius must be positive'),
        (shape('<box size="1 1"/>'), "size of <box> must be 3 numbers, finite, got '1 1'"),
        (shape('<cylinder radius="1" length="x"/>'), "length of <cylinder> must be one number"),
        (shape('<cylindre radius="1" length="1"/>'), '<cylindre> cannot be read as a shape; did you mean "cylinder"'),
        (shape("<mesh/>"), "has no filename"),
        (shape('<mesh filename="no.stl"/>'), r'line 3: link "arm": the mesh "no.stl" is not found .*no.stl\); mend'),
        (shape('<mesh filename="file:///no/a.stl"/>'), "is not found"),
        (shape('<mesh filename="http://a.b/a.stl"/>'), "only package://, model:// and file:// can be read"),
        (shape('<mesh filename="bad.stl"/>'), r"bad.stl: the mesh cannot be read \(.+\); export it again"),
        (shape('<mesh filename="flat.obj" scale="1 0 1"/>'), "the scale of a mesh must not be 0"),
        (shape('<mesh filename="line.obj"/>'), r"line.obj: a mesh: its 4 different vertices span no surface"),
    ],
)
@pytest.mark.usefixtures("meshes_in_this_process")
def test_broken_collision_elements_say_where(text, message, tmp_path):
    pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")
    (tmp_path / "bad.stl").write_text("no mesh at all")
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "line.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nv 3 0 0\nf 1 2 3\nf 2 3 4\n")
    path = write(tmp_path, {"arm": text})
    with pytest.raises(InputError, match=message) as caught:
        read(path)
    assert "\n" not in str(caught.value)


def test_robots_without_urdf_say_what_to_do():
    arm = Robot.from_dh([(0, 0.5, 0, "q")], name="arm")
    with pytest.raises(InputError, match='robot "arm" was not read from a URDF'):
        RobotGeometry.from_urdf(arm)
    with pytest.raises(InputError, match='"hull" or "exact", got \'fast\''):
        RobotGeometry.from_urdf(arm, meshes="fast")
    with pytest.raises(InputError, match='no link "hand"'):
        PlacedShape.on(arm, "hand", Sphere(1.0))


def test_without_packages_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("steelyard.collision.mesh_files.coal_or_none", lambda: None)
    monkeypatch.setitem(sys.modules, "trimesh", None)
    path = tmp_path / "a.stl"
    path.write_text("")
    with pytest.raises(InputError, match="is empty; export it again"):  # /proc/kmsg took 20 s
        read_mesh(path)
    path.write_text("solid")
    with pytest.raises(MissingExtraError, match=r"pip install 'coal>="):
        read_mesh(path)
    monkeypatch.setattr(shapes, "coal_or_none", lambda: None)
    with pytest.raises(MissingExtraError, match=r"need the package coal.*pip install 'coal>="):
        shapes.require_coal()


def test_srdf(tmp_path):
    path = tmp_path / "robot.srdf"
    path.write_text(
        '<robot name="x"><disable_collisions link1="a" link2="b" reason="Never"/>'
        '<disable_default_collisions link="c"/><enable_collisions link1="c" link2="d"/></robot>'
    )
    pairs = read_srdf(path)
    assert pairs.links == {"a", "b", "c", "d"}
    assert pairs.disables("b", "a")
    assert pairs.disables("c", "a")
    assert not pairs.disables("d", "c")
    assert not pairs.disables("a", "d")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "cannot be read .*give the path of an SRDF"),
        ("<robot", "not well-formed XML"),
        ("<sdf/>", "an SRDF begins with <robot>, found <sdf>"),
        ('<robot>\n<disable_collisions link1="a"/></robot>', "line 2: <disable_collisions> has no link2"),
    ],
)
def test_broken_srdf(text, message, tmp_path):
    path = tmp_path / "robot.srdf"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_srdf(path)


def test_meshes_print_themselves():
    corners = np.vstack([np.zeros(3), np.eye(3)])
    assert repr(Mesh(corners)) == "Mesh(convex hull of 4 vertices)"
    assert repr(Mesh(corners, [[0, 1, 2]], exact=True)) == "Mesh(surface of 1 triangles)"


def test_no_path_leaves_the_package(tmp_path, monkeypatch):
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    secret = tmp_path / "secret.stl"
    secret.write_bytes(b"solid")
    urdf = tmp_path / "thing" / "urdf" / "deep" / "thing.urdf"
    urdf.parent.mkdir(parents=True)
    for reference in ("package://thing/../secret.stl", "model://../secret.stl", "package://thing/a/../../secret.stl"):
        with pytest.raises(InputError, match="leads out of its package"):
            find_mesh(reference, urdf)
    with pytest.raises(InputError, match="leads out of its package"):
        find_mesh("package://thing//etc/passwd", urdf)
    with pytest.raises(InputError, match=r"leads out of .*thing/urdf, to which the description belongs"):
        find_mesh("../../../secret.stl", urdf)
    # A package.xml says how far a package reaches, and may give it another name than its folder.
    (tmp_path / "thing" / "package.xml").write_text("<package><name>other</name></package>")
    inside = tmp_path / "thing" / "a.stl"
    inside.write_bytes(b"solid")
    assert find_mesh("../../a.stl", urdf).samefile(inside)
    assert find_mesh("package://other/a.stl", urdf) == inside
    with pytest.raises(InputError, match=r"leads out of .*thing, to which"):
        find_mesh("../../../secret.stl", urdf)
