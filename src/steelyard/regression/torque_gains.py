"""How estimates change where the torques of one joint are all measured too large by one factor."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .information import Information
from .parameter_covariance import inverse_root_of

__all__ = ["torque_gains"]

Array = NDArray[np.float64]


def torque_gains(info: Information, weights: str | ArrayLike | None = "joint") -> Array | None:
    """Return how least squares change with the gain of the torque of each joint, ``A⁻¹ w_k² W_k' omega_k``.

    The torques of a joint are multiplied by ``1 + g`` where its current sensor has another scale, or its motor another
    torque constant, than is taken for granted. The weighted regression is linear in the torques: the base parameters
    change by g times the column of that joint, whatever the size of g. The columns add up to the base parameters.

    Parameters
    ----------
    info : Information
    weights : "joint", None or array_like
        With which the base parameters are estimated, see :func:`steelyard.least_squares`.

    Returns
    -------
    ndarray or None
        (n_b, N). None where the rows of the joints are not known apart.

    Examples
    --------
    >>> import numpy as np, steelyard as sy
    >>> robot = sy.Robot.from_dh([(0, 0.4, 0, "q"), (0, 0.3, 0, "q")], gravity=(0, -9.81, 0))
    >>> model = sy.Model(robot)
    >>> q, dq, ddq = np.random.default_rng(1).normal(size=(3, 200, 2))
    >>> torque = model.inverse_dynamics(q, dq, ddq, np.tile([0, 0, 0, 0, 0, 0.3, 0.5, 0, 0, 1], 2))
    >>> def of(torque):
    ...     return sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    >>> known, scaled = of(torque), of(torque * [1.0, 1.05])
    >>> change = sy.least_squares(scaled, None).base - sy.least_squares(known, None).base
    >>> bool(np.allclose(change, 0.05 * torque_gains(known, None)[:, 1]))
    True
    """
    if not info.by_joint:
        return None
    used = info.joint_weights(weights)
    root, _, _ = inverse_root_of(info, used)
    columns = np.zeros((info.base_count, len(info.factors)))
    for k, (factor, weight) in enumerate(zip(info.factors, used, strict=True)):
        columns[factor.columns, k] = weight**2 * (factor.triangle[:, :-1].T @ factor.triangle[:, -1])
    return np.asarray(root @ (root.T @ columns))
