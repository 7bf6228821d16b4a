"""The scheme of thesis section 4.3.2, for comparison: COBYLA on the condition number with a penalty on the limits."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.excitation.design_problem import DesignProblem, Stopped

__all__ = ["minimise_with_cobyla"]

Array = NDArray[np.float64]
_SHARP = 1e4  # exponent of the norm of the eigenvalues, which is then the largest of them to a tenth of a per cent
_WEIGHT = 1e3  # weight of the mean squared violation of the limits, each violation as a fraction of its limit
_STEP = 0.25  # change of each unknown in COBYLA's first linear model


def minimise_with_cobyla(
    problem: DesignProblem, start: Array, stop: Callable[[], bool], evaluations: int = 20_000
) -> Array:
    """Minimise the criterion plus squared violations, by linear approximation without gradients (Powell 1994).

    Parameters
    ----------
    problem : DesignProblem
    start : ndarray
        (N P,).
    stop : callable
        Asked before every evaluation.
    evaluations : int
        Largest number.

    Returns
    -------
    ndarray
        (N P,) the best motion that was evaluated.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], gravity=(0, -9.81, 0)))
    >>> limits = {"lower": -1.5, "upper": 1.5, "velocity": 2.0, "acceleration": 6.0}
    >>> from steelyard.excitation import SearchOptions
    >>> search = SearchOptions(minimiser=minimise_with_cobyla, starts=2, workers=1, time_limit=0.5)
    >>> design = sy.design_excitation(model, limits, period=5.0, harmonics=2, search=search)
    >>> design.method
    'minimise_with_cobyla'
    """
    import scipy.optimize

    best: list[Any] = [np.inf, start]

    def evaluate(x: Array) -> float:
        if stop():
            raise Stopped
        motion = problem.motion(x)
        own = [np.ascontiguousarray(part[: problem.period_count]) for part in motion]
        value = problem.criterion.evaluate(problem.spectrum(own[0], own[1], own[2])[0], _SHARP)[0]
        for fractions in problem.clearances(motion):
            value += _WEIGHT * float(np.square(np.minimum(fractions, 0.0)).sum()) / problem.period_count
        if value < best[0]:
            best[:] = [value, np.array(x)]
        return value

    minimize: Any = scipy.optimize.minimize
    with contextlib.suppress(Stopped):
        minimize(evaluate, start, method="COBYLA", options={"rhobeg": _STEP, "maxiter": evaluations})
    return np.asarray(best[1], dtype=np.float64)
