"""One step of the fixed-step methods, over arrays of numbers or of graph nodes alike."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

__all__ = ["DAMPING", "rosenbrock", "runge_kutta_4"]

# The velocity's coefficient, which makes the method L-stable: the larger root of g² - 2 g + 1/2. The smaller one would
# do so too, but with it a step overshoots the point where a joint sticks, and Coulomb friction chatters.
DAMPING = 1.0 + np.sqrt(0.5)
# The position's coefficient: the smaller root. For an undamped oscillator the step then has determinant one, so that
# energy neither grows nor decays.
POSITION = 1.0 - np.sqrt(0.5)

Acceleration = Callable[[float, Any, Any], Any]


def runge_kutta_4(acceleration: Acceleration, q: Any, dq: Any, step: Any) -> tuple[Any, Any]:
    """Make a step of the classical Runge-Kutta method of order 4.

    Parameters
    ----------
    acceleration : callable
        Of the fraction of the step that has passed, q and dq.
    q, dq : array
        (..., N).
    step : scalar
        s.

    Returns
    -------
    q, dq : array

    Examples
    --------
    >>> q, dq = runge_kutta_4(lambda fraction, q, dq: -q, np.array([1.0]), np.array([0.0]), 0.1)
    >>> float(abs(q[0] - np.cos(0.1))) < 1e-7
    True
    """
    half = step * 0.5
    a1 = acceleration(0.0, q, dq)
    v2 = dq + a1 * half
    a2 = acceleration(0.5, q + dq * half, v2)
    v3 = dq + a2 * half
    a3 = acceleration(0.5, q + v2 * half, v3)
    v4 = dq + a3 * step
    a4 = acceleration(1.0, q + v3 * step, v4)
    sixth = step * (1.0 / 6.0)
    return q + (dq + (v2 + v3) * 2.0 + v4) * sixth, dq + (a1 + (a2 + a3) * 2.0 + a4) * sixth


def rosenbrock(
    damped: Callable[[Any, Any, Any], tuple[Any, Callable[[Any], Any]]],
    acceleration: Acceleration,
    q: Any,
    dq: Any,
    step: Any,
) -> tuple[Any, Any]:
    """Make a step of the Rosenbrock-W method ROS2 of order 2 (Verwer et al. 1999, SIAM J. Sci. Comput. 20(4)).

    A W-method keeps its order whatever matrix stands for the Jacobian. Here it holds the damping D of friction alone,
    ``dv/dt = -M⁻¹ D v``. For the smooth sign that is its slope ``w² / (v² + w²)^(3/2)``; where an explicit step would
    reverse a velocity, it is the secant ``1 / sqrt(v² + w²)`` instead. The slope is blind to the friction that waits at
    rest for a joint that still moves; the secant brings the joint to rest within a few steps, however large they are.

    Parameters
    ----------
    damped : callable
        Of q, dq and the factor ``g step``: the acceleration with the inertia ``M + g step D``, and the function
        ``x -> (M + g step D)⁻¹ M x`` with the same M and D.
    acceleration : callable
        Of the fraction of the step that has passed, q and dq.
    q, dq : array
        (..., N).
    step : scalar
        s.

    Returns
    -------
    q, dq : array

    Examples
    --------
    >>> damped = lambda q, dq, factor: (-1e6 * dq / (1 + 1e6 * factor), lambda x: x / (1 + 1e6 * factor))
    >>> q, dq = rosenbrock(damped, lambda fraction, q, dq: -1e6 * dq, np.zeros(1), np.ones(1), 1e-3)
    >>> float(abs(dq[0])) < 0.01
    True
    """
    position = step * POSITION
    a1, filtered = damped(q, dq, step * DAMPING)
    v1 = dq + a1 * position
    v2 = dq + a1 * step
    a2 = filtered(acceleration(1.0, q + v1 * step, v2) - a1 * 2.0)
    half = step * 0.5
    return q + (v1 + v2 + a2 * position) * half, dq + (a1 * 3.0 + a2) * half
