"""The parts of the predicted torque of each joint: gravity, inertia, friction and so on."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.recording import Samples

__all__ = ["shares", "torque_sources"]

Array = NDArray[np.float64]


def torque_sources(model: Model, parameters: Array, samples: Samples) -> dict[str, Array]:
    """Return the parts of the torque, (S, N), by where they come from; together they are the inverse dynamics.

    Torques are linear in the parameters: those of the links alone give gravity at rest, inertia as what acceleration
    adds to it, and what speed adds, Coriolis and centrifugal forces; the parameters of the terms give the rest.

    Parameters
    ----------
    parameters : (n,)
    samples : Samples
        Of the motion; the torque is not used.

    Examples
    --------
    >>> import numpy as np, steelyard as sy
    >>> robot = sy.Robot.from_dh([(0, 0.0, 0, "q")], gravity=(0, -9.81, 0)).with_terms(sy.Viscous())
    >>> one = np.array([[0.0]])
    >>> samples = sy.Samples(q=one, dq=one + 2.0, ddq=one + 3.0, torque=one)
    >>> delta = [0, 0, 0, 0, 0, 0.5, 0.2, 0, 0, 1.0, 0.1]
    >>> {name: round(float(part[0, 0]), 3) for name, part in torque_sources(sy.Model(robot), delta, samples).items()}
    {'gravity': 1.962, 'inertia': 1.5, 'Coriolis and centrifugal': 0.0, 'friction': 0.2}
    """
    names = list(model.parameter_names)
    delta = np.asarray(parameters, dtype=float)
    groups: dict[str, list[int]] = {}
    for term in model.robot.terms:
        for one in term.parameters:
            columns = [k for k, name in enumerate(names) if re.fullmatch(re.escape(one.symbol) + r"\d+", name)]
            groups.setdefault(_source(one.description), []).extend(columns)
    of_terms = np.zeros(len(names), dtype=bool)
    of_terms[[column for columns in groups.values() for column in columns]] = True
    links = np.where(of_terms, 0.0, delta)
    zero = np.zeros_like(samples.q)

    def torque(values: Array, dq: Array, ddq: Array) -> Array:
        return np.asarray(model.inverse_dynamics(samples.q, dq, ddq, values, channels=samples.channels))

    gravity = torque(links, zero, zero)
    found = {
        "gravity": gravity,
        "inertia": torque(links, zero, samples.ddq) - gravity,
        "Coriolis and centrifugal": torque(links, samples.dq, zero) - gravity,
    }
    for name, columns in groups.items():
        chosen = np.zeros(len(names))
        chosen[columns] = delta[columns]
        found[name] = torque(chosen, samples.dq, samples.ddq)
    return found


def _source(description: str) -> str:
    """The name of a group of terms by what their parameters are: all kinds of friction are one."""
    if "friction" in description:
        return "friction"
    if "rotor" in description or "inertia" in description:
        return "rotor"
    return "offset" if "offset" in description else description


def shares(sources: dict[str, Array]) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return the root mean square of each source, and its share in the mean square of their sum, (N,) each.

    The share is the mean of the product of source and sum over the mean square of the sum: shares add up to 1, and one
    is negative whose source mostly acts against the others.
    """
    total = np.sum(list(sources.values()), axis=0)
    power = np.mean(total**2, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        part = {name: np.mean(one * total, axis=0) / power for name, one in sources.items()}
    return {name: np.sqrt(np.mean(one**2, axis=0)) for name, one in sources.items()}, part
