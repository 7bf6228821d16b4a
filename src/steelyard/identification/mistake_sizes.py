"""The size of a mistake as exactly as all rows of a log tell it, by least squares.

The search in `mistakes` must not let little noise decide which mistake a log has: errors below 2 % are all alike to it,
rows count for few, and the description has a say. With CAD that is wrong by 20 % the factor of one joint came out 8 %
too small.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.recording import Samples

__all__ = ["exact_scale", "exact_tilt"]

Array = NDArray[np.float64]

STEPS, SETTLED = 8, 1e-5
"""The most steps of Gauss and Newton, and the change with which they have converged; four are usual."""
CERTAIN, CERTAIN_TILT = 0.01, 0.0025
"""Largest standard errors, relative and in rad, with which the rows tell a factor and a tilt; taken as if rows were
independent, which makes them some three times too small. Of simulated arms with Stribeck friction that the model lacks,
whose CAD was wrong by 30 %, tilts that are told so surely were wrong by 0.2 degrees, and by 0.35 as the search has
them; of motions that tell less, those of the search are as good or better.
"""
MOST = 0.1
"""Part of the certainty that is asked for below which no further step is taken."""
ROUNDING = 1e-9
"""Singular values relative to the largest below which directions of the parameters are not told."""


def exact_scale(model: Model, samples: Samples, joint: int, log: float) -> float | None:
    """Return the logarithm of the factor by which the torques of a joint are to be multiplied, by least squares.

    It shows where the links beyond a joint also load others, whose torques are right.

    Parameters
    ----------
    model : Model
        Rotors are taken to have inertia, whether it has such terms or not: they would pass for a factor.
    log : float
        The logarithm to begin with.

    Returns
    -------
    float or None
        None where the rows do not tell it.
    """
    columns = _columns(model, samples, np.asarray(model.robot.gravity, dtype=np.float64))
    for _ in range(STEPS):
        scaled = columns.copy()
        scaled[:, joint] *= np.exp(-log)

        def change(parameters: Array, scaled: Array = scaled) -> Array:
            found = np.zeros((*samples.torque.shape, 1))
            found[:, joint, 0] = -scaled[:, joint] @ parameters
            return found

        told = _step(scaled, samples, change)
        if told is None:
            return None
        log += float(told[0][0])
        if abs(told[0][0]) < SETTLED:
            return log if told[1] < CERTAIN else None
    return None


def exact_tilt(model: Model, samples: Samples, gravity: Array) -> Array | None:
    """Return gravity (3,) in m/s² as least squares find its direction, from one close by; see `exact_scale`."""
    size = float(np.linalg.norm(gravity))
    for _ in range(STEPS):
        across = size * np.asarray(np.linalg.svd(gravity[None, :])[2], dtype=np.float64)[1:]
        columns = _columns(model, samples, gravity)
        others = [_columns(model, samples, gravity + aside) - columns for aside in across]

        def change(parameters: Array, others: list[Array] = others) -> Array:
            return np.stack([other @ parameters for other in others], axis=2)

        told = _step(columns, samples, change)
        if told is None:
            return None
        gravity = gravity + told[0] @ across
        gravity = gravity * (size / float(np.linalg.norm(gravity)))
        if np.abs(told[0]).max() < SETTLED:
            return gravity if told[1] < CERTAIN_TILT else None
    return None


def _columns(model: Model, samples: Samples, gravity: Array) -> Array:
    """Return the regressor (S, N, n) under a gravity, with rotors at all joints."""
    kernel = model.kernel("regressor", gravity="argument")
    flat = kernel(samples.q, samples.dq, samples.ddq, gravity)
    rotors = samples.ddq[:, :, None] * np.eye(samples.joint_count)
    return np.concatenate([flat.reshape(*samples.q.shape, -1), rotors], axis=2)


def _step(columns: Array, samples: Samples, change: Callable[[Array], Array]) -> tuple[Array, float] | None:
    """Return a step of what is sought, and its largest standard error; None where the rows tell next to nothing of it.

    `change` returns by how much the torques (S, N, k) of parameters (n,) change with what is sought.
    """
    used = samples.used_rows
    sizes = np.sqrt(np.einsum("sjc,sjc->c", columns, columns))
    sizes = np.where(sizes == 0.0, 1.0, sizes)
    # Twice: the residuals of the joints are their weights.
    weights = 1.0 / np.maximum(np.std(samples.torque, axis=0, where=used), 1e-300)
    for _ in range(2):
        weighed = (weights[:, None] * columns / sizes)[used]
        torques = (weights * samples.torque)[used]
        factor = _triangle(np.column_stack([weighed, torques]))
        parameters = np.linalg.lstsq(factor[:, :-1], factor[:, -1], rcond=ROUNDING)[0] / sizes
        residual = np.where(used, samples.torque - columns @ parameters, 0.0)
        variance = np.sum(residual**2, axis=0) / np.maximum(used.sum(axis=0), 1)
        weights = 1.0 / np.sqrt(np.maximum(variance, 1e-12 * np.sum(samples.torque**2, axis=0) + 1e-300))
    weighed = (weights[:, None] * columns / sizes)[used]
    sought = (weights[:, None] * change(parameters))[used]
    # What no other parameters explain of the change and of the torques (Frisch, Waugh and Lovell).
    given = np.column_stack([sought, (weights * samples.torque)[used]])
    factor = _triangle(np.column_stack([weighed, given]))
    many = weighed.shape[1]
    left = factor[:, many:] - factor[:, :many] @ np.linalg.lstsq(factor[:, :many], factor[:, many:], rcond=ROUNDING)[0]
    own = np.linalg.svd(left[:, :-1], compute_uv=False)
    if own[-1] < MOST / CERTAIN:
        return None
    step = np.asarray(np.linalg.lstsq(left[:, :-1], left[:, -1], rcond=None)[0], dtype=np.float64)
    return step, float(1.0 / own[-1])


def _triangle(rows: Array) -> Array:
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)
