"""Excitation of a robot that could hit itself and its table, looked at by Pinocchio at 1 kHz."""

import numpy as np
import pytest

pytest.importorskip("pinocchio_distances")

from pinocchio_distances import PinocchioDistances, pinocchio, urdf

import steelyard as sy
from steelyard.collision import RobotGeometry, geometry_from_dict
from steelyard.excitation import SearchOptions, design_excitation

LIMITS = {"velocity": 2.0, "acceleration": 6.0}
MARGIN = 0.02


def closest(path, geometry, pairs, q):
    return PinocchioDistances(path, geometry, pairs)(q).min()


def lowest(path, geometry, links, q):
    """The lowest vertex of the meshes of some links, with frames from Pinocchio."""
    oracle = PinocchioDistances(path, geometry, [], exact=True)
    least = np.inf
    for configuration in q:
        pinocchio.updateGeometryPlacements(
            oracle.model, oracle.placements, oracle.geometry, oracle.data, oracle.state(configuration)
        )
        for link in links:
            number = oracle.geometry.getGeometryId(f"{link}_0")
            placed = oracle.data.oMg[number]
            vertices = oracle.geometry.geometryObjects[number].geometry.vertices()
            least = min(least, (vertices @ placed.rotation[2]).min() + placed.translation[2])
    return least


@pytest.mark.slow
def test_a_designed_motion_keeps_clear_of_everything():
    path = urdf("ur5_robot")
    robot = sy.Robot.from_urdf(path)
    srdf = path.parent.parent / "srdf" / "ur5.srdf"
    tables = {
        "collision": {"margin": MARGIN, "srdf": str(srdf)},
        "table": {"margin": MARGIN, "ignore": ["shoulder_link"]},
    }
    constraints = geometry_from_dict(tables, robot)
    model = sy.Model(robot)
    options = {"period": 10.0, "harmonics": 4, "search": SearchOptions(starts=1, seed=3, workers=1)}
    geometry = RobotGeometry.from_urdf(robot)
    moving = ["upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link"]
    watched = [pair for links in constraints[0].watched for pair in links]
    numbers = {shape.link: number for number, shape in enumerate(geometry.shapes)}
    pairs = [(numbers[first], numbers[second]) for first, second in watched]
    least = [
        margin for margin, links in zip(constraints[0].margins, constraints[0].watched, strict=True) for _ in links
    ]

    careless = design_excitation(model, LIMITS, self_collision=False, **options)
    q = careless.trajectory.sample(100.0)[1]
    assert closest(path, geometry, pairs, q) < 0 or lowest(path, geometry, moving, q) < 0, "nothing is in the way"

    design = design_excitation(model, LIMITS, constraints=constraints, **options)
    _, q, dq, ddq = design.trajectory.sample(1000.0)
    assert len(q) >= 10_000
    distances = PinocchioDistances(path, geometry, pairs)(q)
    assert (distances.min(axis=0) >= np.array(least) - 2e-6).all()
    assert lowest(path, geometry, moving, q) >= MARGIN - 1e-9
    oracle = pinocchio.buildModelFromUrdf(str(path))
    data = oracle.createData()
    torque = np.array([pinocchio.rnea(oracle, data, *state) for state in zip(q, dq, ddq, strict=True)])
    assert (np.abs(torque).max(axis=0) <= oracle.upperEffortLimit).all()
    assert (q >= oracle.lowerPositionLimit).all()
    assert (q <= oracle.upperPositionLimit).all()
    assert np.abs(dq).max() <= 2.0
    assert np.abs(ddq).max() <= 6.0
    # What the design itself says agrees with all this.
    assert all(margin.clearance >= 0 for margin in design.margins)
    assert {"self-collision", "table plane"} <= {margin.name for margin in design.margins}
