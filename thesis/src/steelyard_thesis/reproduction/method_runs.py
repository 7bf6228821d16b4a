"""Runs identification methods, and measures their time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from steelyard.dynamics.threads import one_thread
from steelyard.errors import SteelyardError
from steelyard.feasibility import FeasibleSet
from steelyard.regression import Estimate, Information

__all__ = ["MethodRun", "run_method"]


@dataclass(frozen=True)
class MethodRun:
    """The estimate of a method, its verdict and its time.

    Attributes
    ----------
    relative_error : float
    feasible : bool
        Proved exactly.
    seconds : float
        Least time of the calls.
    """

    relative_error: float
    feasible: bool
    seconds: float


class _TimeIsUpError(Exception):
    pass


def run_method(
    fit: Callable[..., Estimate],
    information: Information,
    feasible_set: FeasibleSet,
    *,
    limit: float | None = None,
    quick: float = 1.0,
    repetitions: int = 5,
    **options: Any,
) -> MethodRun | None:
    """Run a method in one thread.

    Parameters
    ----------
    fit : callable
        Such as `steelyard.fit` or the ``fit`` of an earlier method.
    information : Information
    feasible_set : FeasibleSet
    limit : float, optional
        Seconds after which the method is stopped. Only for methods that take ``progress``: they are stopped when they
        next tell of it.
    quick : float
        Calls that take less than so many seconds are repeated.
    repetitions : int
        How often at most; the fastest counts.
    **options
        For `fit`, such as ``weights``.

    Returns
    -------
    MethodRun or None
        None where it was stopped or found no answer.

    Examples
    --------
    >>> from steelyard.estimators import fit
    >>> from steelyard_thesis.reproduction.free_links import free_links_problem
    >>> information, model = free_links_problem(1)
    >>> run_method(fit, information, FeasibleSet(model)).feasible
    True
    """
    estimate: Estimate | None = None
    seconds: list[float] = []
    with one_thread():
        while not seconds or (seconds[0] < quick and len(seconds) < repetitions):
            begin = time.perf_counter()
            if limit is not None:
                options["progress"] = _clock(begin + limit)
            try:
                estimate = fit(information, feasible_set, **options)
            except (_TimeIsUpError, SteelyardError):
                return None
            seconds.append(time.perf_counter() - begin)
    assert estimate is not None
    return MethodRun(float(estimate.relative_error), estimate.consistency is not None, min(seconds))


def _clock(end: float) -> Callable[[str], None]:
    def look(_: str) -> None:
        if time.perf_counter() > end:
            raise _TimeIsUpError

    return look
