"""Self-collision is watched where nobody asked, and what is not checked is said; Pinocchio looks at the motions."""

import re
from dataclasses import replace

import numpy as np
import pytest

import steelyard as sy
from steelyard.collision import RobotGeometry, SelfCollision, surroundings
from steelyard.collision.surroundings import _geometry
from steelyard.excitation import SearchOptions

URDF = """<robot name="arm">
  <link name="base"><collision><origin xyz="0 0 0.05"/><geometry><cylinder radius="0.08" length="0.1"/></geometry>
    </collision></link>
  <link name="upper"><collision><origin xyz="0.2 0 0" rpy="0 1.5707963267948966 0"/>
    <geometry><cylinder radius="0.05" length="0.3"/></geometry></collision>
    <inertial><origin xyz="0.2 0 0"/><mass value="3"/>
    <inertia ixx="0.01" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="fore"><collision><origin xyz="0.15 0 0" rpy="0 1.5707963267948966 0"/>
    <geometry><cylinder radius="0.04" length="0.25"/></geometry></collision>
    <inertial><origin xyz="0.15 0 0"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tool0"/>
  <joint name="lift" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.3"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="3" effort="90"/></joint>
  <joint name="bend" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-2.9" upper="2.9" velocity="3" effort="50"/></joint>
  <joint name="mount" type="fixed"><parent link="fore"/><child link="tool0"/><origin xyz="0.32 0 0"/></joint>
</robot>"""
QUICK = {"period": 5.0, "harmonics": 2, "search": SearchOptions(starts=1, workers=1)}
LIMITS = {"velocity": 3.0, "acceleration": 8.0}


@pytest.fixture
def path(tmp_path):
    place = tmp_path / "arm.urdf"
    place.write_text(URDF)
    return place


def need_coal():
    pytest.importorskip("coal", reason="coal (the collision library) is not installed")


def design_of(path, limits=LIMITS, **options):
    return sy.design_excitation(sy.Model(sy.Robot.from_urdf(path)), limits, **(QUICK | options))


def tip_heights(q):
    """Return the height of the lowest point of the forearm (a cylinder along x from 0.025 to 0.275), closed form."""
    elbow = 0.3 - 0.4 * np.sin(q[:, 0])
    along = np.sin(q[:, 0] + q[:, 1])
    return np.minimum(elbow - 0.025 * along, elbow - 0.275 * along) - 0.04 * np.abs(np.cos(q.sum(axis=1)))


def pinocchio_clearance(path, q):
    """Return the least distance of forearm and base, m."""
    need_coal()
    pinocchio = pytest.importorskip("pinocchio", reason="the extra oracles (pin) is not installed")
    model = pinocchio.buildModelFromUrdf(str(path))
    shapes = pinocchio.buildGeomFromUrdf(model, str(path), pinocchio.GeometryType.COLLISION)
    shapes.addCollisionPair(pinocchio.CollisionPair(shapes.getGeometryId("base_0"), shapes.getGeometryId("fore_0")))
    data, found = model.createData(), pinocchio.GeometryData(shapes)
    least = np.inf
    for configuration in q:
        pinocchio.computeDistances(model, data, shapes, found, configuration)
        least = min(least, found.distanceResults[0].min_distance)
    return least


@pytest.mark.slow
def test_links_keep_clear_where_nothing_is_said(path):
    # A motion that folds the forearm into the base, if it is let to.
    limits = LIMITS | {"lower": [0.6, 0.9], "upper": [1.9, 2.8]}
    careless = design_of(path, limits, self_collision=False)
    assert pinocchio_clearance(path, careless.trajectory.sample(200.0)[1]) < 0.0
    assert careless.unchecked[0] == "Self-collision was NOT checked: it is turned off."
    design = design_of(path, limits)
    assert pinocchio_clearance(path, design.trajectory.sample(2000.0)[1]) >= surroundings.MARGIN - 1e-5
    assert any(margin.name == "self-collision" for margin in design.margins)
    assert not any("Self-collision" in sentence for sentence in design.unchecked)
    _, _, dq, ddq = design.trajectory.sample(10_000.0)
    assert np.abs(dq).max() <= 3.0
    assert np.abs(ddq).max() <= 8.0


def test_limits_that_fold_the_arm_into_itself_are_refused_with_the_way_out(path):
    need_coal()
    with pytest.raises(
        sy.SolverError, match=r"keeps self-collision, fore to base; .* `self = false` in .collision. .* watches none"
    ) as caught:
        design_of(path, LIMITS | {"lower": [1.5, 2.8], "upper": [1.55, 2.9]})
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_what_was_given_is_not_watched_twice(path):
    need_coal()
    own = SelfCollision(RobotGeometry.from_urdf(sy.Robot.from_urdf(path)), 0.03)
    design = design_of(path, constraints=[own])
    assert sum(margin.name == "self-collision" for margin in design.margins) == len(own.labels)


@pytest.mark.slow
def test_without_a_table_the_lowest_point_is_told_with_the_remedy(path):
    need_coal()
    design = design_of(path)
    lowest = tip_heights(design.trajectory.sample(1000.0)[1]).min()
    assert lowest < -0.1
    assert design.unchecked == design.warnings
    assert f"fore comes down to {-lowest:.3f} m below the origin of the base" in design.unchecked[-1]
    limits = path.parent / "limits.toml"
    limits.write_text("velocity = 3.0\nacceleration = 8.0\n[table]\noffset = 0.0\n")
    kept = design_of(path, limits)
    assert kept.unchecked == kept.warnings == ()
    assert {"table plane", "self-collision"} <= {margin.name for margin in kept.margins}
    assert tip_heights(kept.trajectory.sample(2000.0)[1]).min() >= -1e-9


@pytest.mark.slow
def test_down_is_where_gravity_pulls(path):
    robot = sy.Robot.from_urdf(path, gravity=(9.81, 0.0, 0.0))
    design = sy.design_excitation(sy.Model(robot), LIMITS, self_collision=False, **QUICK)
    q = design.trajectory.sample(1000.0)[1]
    reach = 0.4 * np.cos(q[:, 0]) + np.array([0.025, 0.275])[:, None] * np.cos(q.sum(axis=1))
    reach = reach + 0.04 * np.abs(np.sin(q.sum(axis=1)))
    assert f"comes down to {reach.max():.3f} m below" in design.unchecked[-1]
    assert "normal = [-1.0, 0.0, 0.0]" in design.unchecked[-1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            "coal",
            "Self-collision was NOT checked: the package coal is not installed; pip install",
        ),
        pytest.param(
            "mesh",
            'Self-collision of upper was NOT checked: .* the mesh "package://absent/a.stl" is not found .* ROS_PACKAGE',
            marks=pytest.mark.slow,
        ),
        ("none", "Self-collision was NOT checked: the description has no collision geometry; add <collision>"),
        pytest.param("gone", "Self-collision was NOT checked: .*arm.urdf", marks=pytest.mark.slow),
        pytest.param("file", "Self-collision was NOT checked: it is turned off", marks=pytest.mark.slow),
    ],
)
def test_what_cannot_be_watched_is_a_remark_and_no_refusal(path, monkeypatch, change, message):
    if change == "mesh":  # what else is watched needs the library
        need_coal()
    model = sy.Model(sy.Robot.from_urdf(path))
    limits = LIMITS
    if change == "coal":
        monkeypatch.setattr(surroundings, "coal_or_none", lambda: None)
    elif change == "mesh":
        path.write_text(
            URDF.replace('<cylinder radius="0.05" length="0.3"/>', '<mesh filename="package://absent/a.stl"/>')
        )
    elif change == "none":
        path.write_text(URDF.replace("<collision>", "<visual>").replace("</collision>", "</visual>"))
    elif change == "gone":
        path.unlink()
    else:
        limits = path.parent / "limits.toml"
        limits.write_text("velocity = 3.0\nacceleration = 8.0\n[collision]\nself = false\n")
    design = sy.design_excitation(model, limits, **QUICK)
    sentence = design.unchecked[0]
    assert re.search(message, sentence), sentence
    assert design.remarks[: len(design.unchecked)] == design.unchecked
    assert design.to_dict()["unchecked"] == list(design.unchecked)
    assert "\n" not in "".join(design.unchecked)
    # Where one link cannot be read, those on either side of it are watched.
    assert any(margin.name == "self-collision" for margin in design.margins) == (change == "mesh")


@pytest.mark.slow
def test_robots_without_any_bodies_tell_how_low_their_frames_come():
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], gravity=(0, -9.81, 0))
    design = sy.design_excitation(sy.Model(robot), {"lower": -1.5, "upper": 1.5} | LIMITS, **QUICK)
    q = design.trajectory.sample(1000.0)[1]
    tip = 0.5 * np.sin(q[:, 0]) + 0.4 * np.sin(q.sum(axis=1))
    assert "comes without collision geometry" in design.unchecked[0]
    assert f"the origin of link2 comes down to {-tip.min():.3f} m below" in design.unchecked[1]


@pytest.mark.slow
def test_an_arm_with_meshes_is_looked_at_by_pinocchio():
    distances = pytest.importorskip("pinocchio_distances")
    path = distances.urdf("ur5_robot")
    robot = sy.Robot.from_urdf(path)
    design = sy.design_excitation(
        sy.Model(robot),
        {"velocity": 2.5, "acceleration": 8.0},
        period=4.0,
        harmonics=2,
        search=SearchOptions(starts=1, workers=1),
    )
    assert [sentence[:5] for sentence in design.unchecked] == ["Floor"]
    geometry = RobotGeometry.from_urdf(robot)
    numbers = {shape.link: number for number, shape in enumerate(geometry.shapes)}
    watched = SelfCollision(geometry, surroundings.MARGIN)
    pairs = [(numbers[first], numbers[second]) for links in watched.watched for first, second in links]
    oracle = distances.PinocchioDistances(path, geometry, pairs)
    found = oracle(design.trajectory.sample(500.0)[1]).min(axis=0)
    least = [margin for margin, links in zip(watched.margins, watched.watched, strict=True) for _ in links]
    assert np.all(found >= np.array(least) - 1e-5)
    assert len(pairs) > 12


def test_a_description_without_shapes_is_told_as_such(tmp_path, monkeypatch):
    """And not as a damaged URDF."""
    path = tmp_path / "arm.table"
    path.write_text("<mujoco/>")
    monkeypatch.setattr("steelyard.collision.robot_geometry.description_format", lambda path: object())
    robot = replace(sy.Robot.from_dh([(0, 0.5, 0, "q")], name="arm"), source=path)
    problems: list[str] = []
    assert _geometry(robot, problems, []) is None
    (told,) = problems
    assert (
        "shapes are read from a URDF, an SDF or an MJCF alone, and arm.table is none; add [[collision.shapes]]" in told
    )
