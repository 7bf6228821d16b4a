"""An arm of two joints with friction, and the parameters of its links."""

import steelyard as sy

LINKS = [[0.3, 0.0, 0.0, 0.3, 0.0, 0.2, 0.4, 0.05, 0.1, 2.0], [0.1, 0.0, 0.0, 0.2, 0.0, 0.2, 0.3, 0.0, 0.05, 1.5]]


def two_joint_model():
    """Return its model with viscous friction, Coulomb friction and an offset at each joint."""
    rows = [("pi/2", 0.0, 0.3, "q"), (0, 0.4, 0, "q")]
    return sy.Model(sy.Robot.from_dh(rows).with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))
