"""What only torques would tell that no log has: the friction of a joint whose torque was not measured."""

from __future__ import annotations

from steelyard.dynamics import Model
from steelyard.regression import Information

__all__ = ["told_by_unlogged_torques"]


def told_by_unlogged_torques(model: Model, information: Information) -> dict[str, str]:
    """Return the base parameters that take part in the torques of joints alone of which the data has no torque.

    No motion shows them as long as these torques are not logged, where others that the data does not determine ask for
    another motion.

    Parameters
    ----------
    model : Model
        Whose base parameters those of `information` are.

    Returns
    -------
    dict of str to str
        The expression of each such base parameter, and the joint whose torque would tell it.

    Examples
    --------
    >>> import numpy as np
    >>> import steelyard as sy
    >>> robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")]).with_terms(sy.Viscous())
    >>> model, random = sy.Model(robot), np.random.default_rng(0)
    >>> q, dq, ddq, torque = random.normal(size=(4, 50, 2))
    >>> mask = np.ones((50, 2), bool)
    >>> mask[:, 1] = False  # the torque of joint2 was not logged
    >>> information = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, mask=mask))
    >>> told_by_unlogged_torques(model, information)["Fvj2"]
    'joint2'
    """
    if not information.has_joint_errors or len(information.measured) != model.dof:
        return {}
    felt = tuple(set(columns.tolist()) for columns in model.base_columns.joints)
    logged: set[int] = set().union(*(felt[k] for k, factor in enumerate(information.measured) if factor.count))
    found: dict[str, str] = {}
    for columns, joint in zip(felt, model.robot.joint_names, strict=True):
        found.update((information.base_expressions[j], joint) for j in sorted(columns - logged))
    return found
