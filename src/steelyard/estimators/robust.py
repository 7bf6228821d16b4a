"""Robust regression by iterated re-weighting: rows with large residuals count less."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.files import read_number
from steelyard.recording import Samples
from steelyard.regression import Factor, Information, least_squares
from steelyard.regression.information import FILTERED
from steelyard.regression.reduction import reduce_by_joint, residuals

from .reduced_fit import fit_reduced

__all__ = ["HuberWeights", "RobustInformation", "robust_information"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

NORMAL_DEVIATION = 1.482602218505602
"""Ratio of the standard deviation of a normal distribution to its median absolute deviation."""

LEAST_SCALE = 1e-9
"""Scales are at least this part of the root mean square torque of all joints. Where most residuals are exactly zero, as
in simulated data, the median is zero, and every other row would count as an outlier."""


@dataclass(frozen=True, eq=False)
class HuberWeights:
    """The weights that the robust regression gave to the rows.

    Attributes
    ----------
    threshold : float
        In units of the scale; rows with smaller residuals have weight 1.
    scales : (N,)
        Standard deviation of the undisturbed residuals of each joint, in N·m or N.
    share : float
        Share of the rows that were weighted down.
    joint_share : (N,)
    least_weight : float
        Smallest weight of any row.
    iterations : int
    converged : bool
    """

    threshold: float
    scales: Vector
    share: float
    joint_share: Vector
    least_weight: float
    iterations: int
    converged: bool

    def __str__(self) -> str:
        state = "" if self.converged else f", not converged after {self.iterations} iterations"
        worst = int(np.argmax(self.joint_share))
        return (
            f"Huber weights: {self.share:.2%} of the rows count less (most of joint {worst + 1}: "
            f"{self.joint_share[worst]:.2%}), the least with weight {self.least_weight:.2g}{state}."
        )


@dataclass(frozen=True, eq=False)
class RobustInformation(Information):
    """An Information with weighted rows, and how they were weighted.

    Attributes
    ----------
    huber : HuberWeights
    """

    huber: HuberWeights | None = field(default=None, repr=False)


@in_one_thread
def robust_information(
    model: Model,
    samples: Samples | Sequence[Samples],
    feasible_set: FeasibleSet | None = None,
    threshold: float = 1.345,
    weights: Literal["joint"] | npt.ArrayLike | None = "joint",
    accuracy: float = 1e-3,
    iterations: int = 50,
    **options: Any,
) -> RobustInformation:
    """Reduce samples with Huber weights, with which rows beyond `threshold` standard deviations count less.

    Wrong samples (a spike, a collision, a joint that stuck) pull least squares towards them. Huber's estimator
    minimises Σ ρ(r / s), where ρ is quadratic for small residuals and linear for large ones. It is found iteratively:
    each fit gives residuals, their median absolute deviation gives the scale s of each joint, and a row with
    |r| > threshold · s gets the weight threshold · s / |r|. After convergence, a fit of the returned Information is the
    estimate.

    Parameters
    ----------
    model : Model
    samples : Samples or sequence of Samples
        They are read once in each iteration, a few thousand rows at a time.
    feasible_set : FeasibleSet, optional
        If given, each fit is restricted to feasible parameters; otherwise it is plain least squares.
    threshold : float
        With 1.345 the estimator is 95 % as efficient as least squares if all noise is normal (Huber 1981).
    weights : "joint", None or (N,)
        Weights of the joints in each fit; use the same ones afterwards.
    accuracy : float
        The iterations end when the root mean square change of the predictions is below this, in units of the scale.
    iterations : int
        Largest number of fits.
    **options
        Options of the feasible fits, see `fit_reduced`: `prefer`, `residual_slack`, `prior`, `prior_weight`, `solver`.

    Returns
    -------
    RobustInformation
        Its `huber` holds the weights' summary; errors (`relative_error`) are those of the unweighted rows. The sum of
        two of them is a plain Information.

    Raises
    ------
    InputError
        For a threshold or number of iterations that is not positive, or samples of another robot.

    References
    ----------
    P. J. Huber, Robust Statistics, Wiley, 1981.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> random = np.random.default_rng(1)
    >>> q, dq, ddq = random.normal(size=(3, 500, 1))
    >>> torque = model.inverse_dynamics(q, dq, ddq, np.ones(10)) + 0.1 * random.normal(size=(500, 1))
    >>> torque[::50] += 30.0
    >>> samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque)
    >>> truth = model.base_parameters().values(np.ones(10))
    >>> plain = least_squares(sy.Information.from_samples(model, samples)).base
    >>> robust = robust_information(model, samples)
    >>> bool(np.abs(least_squares(robust).base - truth).max() < 0.1 * np.abs(plain - truth).max())
    True
    >>> robust.huber.converged
    True
    """
    for name, value, example in (
        ("threshold", threshold, 1.345),
        ("iterations", iterations, 50),
        ("accuracy", accuracy, 1e-3),
    ):
        read_number(value, name, f"a positive number, such as {example:g}", above=0)
    if options and feasible_set is None:
        raise InputError(
            f"robust_information takes {', '.join(options)} only with feasible_set=...; give a FeasibleSet."
        )
    chunks = [samples] if isinstance(samples, Samples) else list(samples)
    if not chunks:
        raise InputError("there are no samples to reduce; give at least one Samples.")
    measured = _reduced(model, chunks, None)
    plain = Information.empty(model)
    information = replace(plain, factors=measured)
    base = _fitted(information, feasible_set, weights, options)
    record: HuberWeights | None = None
    for iteration in range(1, int(iterations) + 1):
        scales, factors, record = _weighted(model, chunks, base, float(threshold), iteration)
        information = replace(plain, factors=factors, torque_factors=measured)
        before, base = base, _fitted(information, feasible_set, weights, options)
        step = base - before
        moved = [np.sqrt(f.prediction2(step) / max(f.count, 1)) for f in measured]
        if np.all(np.array(moved) <= accuracy * scales):
            record = replace(record, converged=True)
            break
    assert record is not None
    filtered = any(chunk.is_biased_for(model) for chunk in chunks)
    remarks = (*((FILTERED,) if filtered else ()), str(record))
    return RobustInformation.of(replace(information, remarks=remarks, filtered_torque=filtered), huber=record)


def _fitted(
    information: Information, feasible_set: FeasibleSet | None, weights: Any, options: dict[str, Any]
) -> Vector:
    if feasible_set is None:
        return least_squares(information, weights).base
    return fit_reduced(information.reduced(weights), feasible_set, **options).base


def _reduced(model: Model, chunks: Sequence[Samples], scales: list[Matrix] | None) -> tuple[Factor, ...]:
    total: tuple[Factor, ...] | None = None
    for index, chunk in enumerate(chunks):
        factors = reduce_by_joint(model, chunk, None if scales is None else scales[index])
        total = factors if total is None else tuple(a + b for a, b in zip(total, factors, strict=True))
    assert total is not None
    return total


def _weighted(
    model: Model, chunks: Sequence[Samples], base: Vector, threshold: float, iteration: int
) -> tuple[Vector, tuple[Factor, ...], HuberWeights]:
    """Scales, weighted factors and the summary of the weights, from the residuals of a fit."""
    errors = [np.vstack([part for _, part in residuals(model, chunk, base)]) for chunk in chunks]
    used = [chunk.used_rows for chunk in chunks]
    torque = np.sqrt(np.mean([np.mean(chunk.torque**2) for chunk in chunks]))
    scales = np.full(model.dof, max(LEAST_SCALE * torque, np.finfo(float).tiny))
    for k in range(model.dof):
        own = np.concatenate([e[u[:, k], k] for e, u in zip(errors, used, strict=True)])
        if len(own):
            scales[k] = max(scales[k], NORMAL_DEVIATION * float(np.median(np.abs(own - np.median(own)))))
    limits = threshold * scales
    weights = [np.where(np.abs(e) > limits, limits / np.maximum(np.abs(e), limits), 1.0) for e in errors]
    lower = sum(np.sum((w < 1.0) & u, axis=0) for w, u in zip(weights, used, strict=True))
    counts = np.maximum(sum(np.sum(u, axis=0) for u in used), 1)
    least = min(float(w[u].min(initial=1.0)) for w, u in zip(weights, used, strict=True))
    record = HuberWeights(
        threshold, scales, float(np.sum(lower) / np.sum(counts)), lower / counts, least, iteration, False
    )
    return scales, _reduced(model, chunks, [np.sqrt(w) for w in weights]), record
