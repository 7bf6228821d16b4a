"""Whether the answer has the mass of a robot of its size: torques in wrong units scale every mass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.recording import Samples
from steelyard.regression import Estimate

__all__ = ["implausible_mass"]

Array = NDArray[np.float64]
_OF_DESCRIPTION = 8.0
"""Largest ratio of the masses of the answer and of the description that CAD without drives or cables explains."""
_LIGHTEST, _HEAVIEST = 1.0, 1500.0
"""kg per m³ of the longest reach, cubed. Robots have 20 to 100 (a servo with a horn, a dog's leg, arms of 0.8 to 3 m);
the lightest possible answer may have a few times less, where the motion does not show all the masses."""
_GRAVITY_SEEN = 0.05
"""Share of the torques that gravity has where they tell masses."""
_SHORTEST = 0.05
"""m of reach below which the description tells no size."""
_SCALES = {"mN·m": 1e3}


def implausible_mass(model: Model, estimate: Estimate, samples: Samples) -> tuple[str, ...]:
    """Compare the total mass of an estimate with the description's, or else with what a robot of its reach has.

    Parameters
    ----------
    model : Model
    estimate : Estimate
        With parameters of every link.
    samples : Samples
        Of the motion that it comes from.

    Returns
    -------
    tuple of str
        One sentence at most.
    """
    parameters = estimate.parameters
    assert parameters is not None
    columns = [int(link[9]) for link in model.link_columns]
    mass = float(parameters[columns].sum())
    described = np.asarray(model.robot.parameters)[columns]
    if np.all(described > 0.0):
        expected = float(described.sum())
        low, high = expected / _OF_DESCRIPTION, expected * _OF_DESCRIPTION
        what = f"the description's {expected:.4g} kg"
    else:
        reach = _reach(model)
        if reach < _SHORTEST:
            return ()
        low, high = _LIGHTEST * reach**3, _HEAVIEST * reach**3
        what = f"the {low:.2g} to {high:.2g} kg of robots that reach {reach:.3g} m"
    if low <= mass <= high:
        return ()
    if mass < low:
        gravity = model.gravity(samples.q, parameters)
        if np.linalg.norm(gravity) < _GRAVITY_SEEN * np.linalg.norm(samples.torque):
            return ()
    units = [f'`torque_unit = "{unit}"`' for unit, scale in _SCALES.items() if low <= mass / scale <= high]
    remedy = f"{units[0]} in [log] would fit" if units else "check `torque_unit`, `gain` and gear ratios in [log]"
    return (f"The links weigh {mass:.4g} kg together by these torques, far from {what}: {remedy}.",)


def _reach(model: Model) -> float:
    """Length in m of the longest chain of joints, stretched, from the first joint on."""
    lengths: list[float] = []
    for joint in model.robot.joints:
        own = float(np.linalg.norm(joint.after[:3, 3]))
        if joint.parent >= 0:
            own += lengths[joint.parent] + float(np.linalg.norm(joint.before[:3, 3]))
        if not joint.rotates and np.isfinite(joint.upper - joint.lower):
            own += joint.upper - joint.lower
        lengths.append(own)
    return max(lengths, default=0.0)
