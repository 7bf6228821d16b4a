"""The weight of a prior, chosen by how well fits predict the parts of the data that they have not seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from steelyard.display import text_table
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError, SolverError
from steelyard.feasibility.barrier import Barrier, log_determinants, minimise
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.files import tell
from steelyard.regression import Information
from steelyard.regression.factor import Factor, column_lengths, eigenvectors, solve
from steelyard.regression.parameter_covariance import inverse_root_of
from steelyard.robot.inertia import pseudo_inertia

from .fitting_problems import start_near
from .prior import Prior
from .reduced_fit import fit_reduced
from .reduced_regression import ReducedRegression

__all__ = ["SHOWN", "CrossValidation", "HeldOutRows", "cross_validation", "term_deviations"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Tensor = npt.NDArray[np.float64]

WEIGHTS = np.geomspace(1e-1, 1e6, 15)
"""The weights of the prior that are tried, for `TYPICAL_COUNT` rows. On twelve simulated arms the best one lay between
1 and 1e5; at the ends the answer is that of the data alone, and the prior itself."""

MANY_PARAMETERS = 150
"""The number of parameters of a robot with eleven joints and three terms. With more, every third weight is tried: a fit
takes the cube of their number, 0.1 s for a humanoid of 29 joints."""

TYPICAL_COUNT = 1e4
"""Rows beyond which the weights grow with their number, as the squared residual does."""

BARRIER = 1e-2
"""Factor of the barrier, in units of half the squared residual over its variance: it moves the fits by a tenth of what
noise does (by at most the number of rows of all blocks times this in the objective)."""

FRICTION = 0.3
"""Standard deviation of a term, relative to the torques of its joint at one rad/s (or at rest): friction is a tenth to
a third of them as a rule. With 1, a joint that moved by a thousandth of the others got nine times its friction."""

FEWEST_FOLDS = 3
"""Fewer tell no standard error."""

SHOWN = 1e-3
"""Part of what all data show of a direction that some of it must show of it, to say anything. Where joints move one at
a time stretches of the log show nothing, or 1e-5, of what others show; where they move together, 1e-3 at least (a real
Gen3 for 15 s) and 0.009 or more as a rule."""


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """The errors with which fits, one for each weight of a prior, predict data that was not used in them.

    Attributes
    ----------
    prior_weights : (k,)
        Ascending.
    losses : (f, k)
        Squared residual of each fold, of the fit of the others, over the variance of the noise.
    training_losses : (k,)
        The same of all the data, of the fit of all the data.
    counts : (f,)
        Rows of each fold.
    joint_errors : (k, N)
        Root mean square of the held-out residuals of each joint, N·m or N; (k, 1) where joints are not known apart.
    plain_joint_errors : (N,)
        As `joint_errors`, of plain least squares.
    parameters : (k, n)
        Fits of all the data, within a per cent of what noise leaves open of the optimum.
    best_index : int
        Where the sum of the losses is least.
    chosen_index : int
        Of the largest weight whose sum is within one standard error of the least one.
    """

    prior_weights: Vector
    losses: Matrix = field(repr=False)
    training_losses: Vector = field(repr=False)
    counts: npt.NDArray[np.intp] = field(repr=False)
    joint_errors: Matrix = field(repr=False)
    plain_joint_errors: Vector = field(repr=False)
    parameters: Matrix = field(repr=False)
    best_index: int
    chosen_index: int

    @property
    def weight(self) -> float:
        """The chosen weight."""
        return float(self.prior_weights[self.chosen_index])

    def __str__(self) -> str:
        total = int(self.counts.sum())
        rows = []
        for index, weight in enumerate(self.prior_weights):
            mark = "chosen" if index == self.chosen_index else "best" if index == self.best_index else ""
            training = float(np.sqrt(self.training_losses[index] / total))
            held_out = float(np.sqrt(self.losses[:, index].sum() / total))
            rows.append((f"{weight:.3g}", f"{training:.4f}", f"{held_out:.4f}", mark))
        return text_table(("weight", "training", "held out", ""), rows, numbers=(0, 1, 2))


@in_one_thread
def term_deviations(info: Information, feasible_set: FeasibleSet) -> Vector:
    """Return standard deviations of the parameters of drive terms about zero, as they are as a rule, (n,).

    Such a parameter, times what multiplies it in the joint where its like is seen best (at least one rad/s, since
    motions for identification are no faster than what follows), makes three tenths of the root mean square of the
    torque of its joint. So joints that hardly move get no friction that nothing speaks for. Infinite for the
    parameters of links.
    """
    count = feasible_set.parameter_count
    terms = np.setdiff1d(np.arange(count), feasible_set.link_columns)
    kinds = [str(feasible_set.model.parameter_names[index]).rstrip("0123456789") for index in terms]
    torque = np.array([np.sqrt(f.norm2 / f.count) if f.count else 0.0 for f in info.measured])
    seen = np.zeros((len(torque), len(terms)))
    for own, factor in zip(seen, info.measured, strict=True):
        if factor.count:
            columns = factor.triangle[:, :-1] @ feasible_set.K[np.ix_(factor.columns, terms)]
            own[:] = column_lengths(columns) / np.sqrt(factor.count)
    sizes = seen.max(axis=0, initial=0.0)
    shown = (seen > 1e-9 * sizes) & (sizes > 0.0)
    scales = np.where(shown, torque[:, None], 0.0).max(axis=0, initial=0.0)
    scales[scales == 0.0] = torque.max(initial=0.0) or 1.0
    likes: dict[str, float] = {}
    for kind, size in zip(kinds, sizes.tolist(), strict=True):
        likes[kind] = max(likes.get(kind, 1.0), size)
    found = np.full(count, np.inf)
    found[terms] = FRICTION * scales / np.array([likes[kind] for kind in kinds])
    return found


@in_one_thread
def cross_validation(
    info: Information,
    stretches: Sequence[Information],
    feasible_set: FeasibleSet,
    prior: Prior,
    *,
    weights: Literal["joint"] | npt.ArrayLike | None = "joint",
    prior_weights: npt.ArrayLike | None = None,
) -> CrossValidation:
    """Choose the weight of a prior by blocked cross-validation.

    Neighbouring rows err alike, so that folds are contiguous stretches of the data, and not random rows (Roberts et
    al., Cross-validation strategies for data with temporal, spatial, hierarchical, or phylogenetic structure,
    Ecography 40, 2017). The chosen weight is the largest whose loss lies within one standard error of the least loss
    (Breiman et al., Classification and regression trees, 1984); the error is that of the difference between the two
    over the folds, since what makes a fold hard to predict counts for both.

    Parameters
    ----------
    info : Information
        All the data.
    stretches : sequence of Information
        Its parts, such as `Information.stretches` returns; at least three.
    feasible_set : FeasibleSet
    prior : Prior
    weights : "joint", None or (N,)
        Of the joints, as in `fit`.
    prior_weights : (k,), optional
        From where the data alone decides to where the prior alone does, where absent.

    Raises
    ------
    InputError
        For fewer than three stretches, or a prior that is impossible.
    SolverError
        If no parameters satisfy all conditions, or the data are too far from all that do for a fit.
    """
    if len(stretches) < FEWEST_FOLDS:
        raise InputError(f"cross-validation needs at least {FEWEST_FOLDS} stretches of data, got {len(stretches)}.")
    used = info.joint_weights(weights) if info.is_weighted(weights) else None
    regression = ReducedRegression.of(info.reduced(used), feasible_set)
    grid = _grid(prior_weights, info.count, feasible_set.parameter_count)
    chosen, folds = len(grid), len(stretches)
    training = list(Information.without_each(stretches))
    problems = [(R.R, R.rho) for R in (data.reduced(used) for data in (info, *training))]
    function = _Fits(problems, regression.variance, feasible_set, prior, grid)
    start = _inside(info, used, feasible_set, prior, function)
    basis = feasible_set.equation_directions
    parameters = np.empty((1 + folds, chosen, start.size))
    try:
        parameters[0] = _path(function, start, basis)
        # What is left out of a fold moves the fit little: all of them start from the fits of all the data.
        starts = np.tile(parameters[0], (folds, 1))
        others = minimise(function, starts, basis, problems=np.arange(chosen, function.count))
    except np.linalg.LinAlgError as error:  # accelerations that are a million times too great do that
        raise SolverError(
            "the torques are so far from those of any robot like the one that is described that rounding leaves no fit "
            "near it; find the unit or the column that is wrong with `steelyard doctor LOG ROBOT`."
        ) from error
    parameters[1:] = others.reshape(folds, chosen, -1)
    bases = parameters @ feasible_set.K.T
    plain = np.array([solve(data.reduced(used)) for data in training])

    squares = _squares([one.measured for one in stretches], bases[1:])
    every = np.ones(len(info.factors)) if used is None else used
    told = HeldOutRows.of(info, stretches, every)
    losses = np.array([rows.squares(own) @ every**2 for rows, own in zip(told, bases[1:], strict=True)])
    plain_squares = _squares([one.measured for one in stretches], plain[:, None])
    counts = np.maximum(np.sum([[f.count for f in s.measured] for s in stretches], axis=0), 1)
    best, largest = _choose(losses)
    return CrossValidation(
        prior_weights=grid,
        losses=losses / regression.variance,
        training_losses=_squares([info.factors], bases[:1])[0] @ every**2 / regression.variance,
        counts=np.array([s.count for s in stretches]),
        joint_errors=np.sqrt(squares.sum(axis=0) / counts),
        plain_joint_errors=np.sqrt(plain_squares.sum(axis=0)[0] / counts),
        parameters=parameters[0],
        best_index=best,
        chosen_index=largest,
    )


def _grid(prior_weights: npt.ArrayLike | None, count: int, parameter_count: int) -> Vector:
    if prior_weights is None:
        weights = WEIGHTS if parameter_count <= MANY_PARAMETERS else WEIGHTS[:: len(WEIGHTS) // 4]
        return weights * max(count / TYPICAL_COUNT, 1.0)
    grid = np.unique(np.asarray(prior_weights, dtype=float))
    if not (len(grid) and np.all(np.isfinite(grid)) and np.all(grid > 0)):
        raise InputError(f"prior_weights must be positive numbers, got {prior_weights!r}.")
    return grid


def _squares(stretches: Sequence[Sequence[Factor]], bases: Tensor) -> Tensor:
    """Squared residuals of each joint, (f, k, N), of the bases (f, k, n_b)."""
    found = [[f.residuals2(own) for f in of] for of, own in zip(stretches, bases, strict=True)]
    return np.array(found).swapaxes(1, 2)


def _path(function: _Fits, start: Vector, basis: Matrix | None) -> Matrix:
    """Fits of all the data with each weight, (k, n), from the heaviest on, each from the fit of the one before.

    From the prior itself, the lightest weights need more than a thousand steps where the data contradict it (a UR5 from
    its shapes), and more than a hundred from a weight ten times as large.
    """
    found, point = np.empty((len(function.weights), start.size)), start[None]
    for k in reversed(range(len(found))):
        tell("fits for each weight of the prior", len(found) - 1 - k, len(found), "weights")
        point = minimise(function, point, basis, problems=np.array([k]))
        found[k] = point[0]
    return found


def _choose(losses: Matrix) -> tuple[int, int]:
    """Return where the sum of the losses (f, k) is least, and the last that is within one standard error of it."""
    totals = losses.sum(axis=0)
    best = int(np.argmin(totals))
    above = losses - losses[:, [best]]
    error = np.sqrt(len(losses)) * above.std(axis=0, ddof=1)
    within = np.flatnonzero(totals - totals[best] <= error)
    return best, int(within[-1])


def _inside(
    info: Information, weights: Vector | None, feasible_set: FeasibleSet, prior: Prior, function: _Fits
) -> Vector:
    """Parameters inside the set: near the prior's, or, where conditions forbid these, a fit close to them."""
    start = start_near(
        function.heaviest,
        float(function.weights[-1]),
        function.curvatures[0],
        function.slopes[0],
        term_deviations(info, feasible_set),
        lambda point: bool(np.isfinite(function.barrier.value(point[None])[0])),
    )
    if start is not None:
        return start
    reduced, heaviest = info.reduced(weights), float(function.weights[-1])
    return fit_reduced(reduced, feasible_set, prior=prior, prior_weight=heaviest).parameters


class _Fits:
    """½ ‖R K δ - ρ‖² / variance + weight · (distance from the prior) + barrier: every weight on every data set.

    The problem of weight k on data set d has the number d · (number of weights) + k.
    """

    def __init__(
        self,
        problems: Sequence[tuple[Matrix, Vector]],
        variance: float,
        feasible_set: FeasibleSet,
        prior: Prior,
        weights: Vector,
    ) -> None:
        rows = [R @ feasible_set.K / np.sqrt(variance) for R, _ in problems]
        self.curvatures = np.array([W.T @ W for W in rows])
        self.slopes = np.array([W.T @ rho / np.sqrt(variance) for W, (_, rho) in zip(rows, problems, strict=True)])
        self.weights, self.barrier = weights, Barrier(feasible_set)
        self.count = len(problems) * len(weights)
        once, self.heaviest = prior.prepare(feasible_set), prior.prepare(feasible_set, float(weights[-1]))
        self.reference = once.reference
        # How far unknown terms are from zero counts once, whatever the weight.
        self.stiffness = np.where(once.known, weights[:, None], 1.0) * once.diagonal
        self.links = replace(once, diagonal=np.zeros_like(self.reference))
        # The barrier has the determinants of the entropic prior, too: their logarithms are taken once for both.
        self.shared = bool(self.links.entropy) and self.barrier.has_bodies
        if self.shared:
            self.slope = self.links.slope(self.reference)
            logarithms = log_determinants(pseudo_inertia(self.links.bodies))
            self.constant = float(logarithms.sum() - self.slope @ self.reference)

    def value(self, points: Matrix, problems: npt.NDArray[np.intp]) -> Vector:
        data, which = np.divmod(problems, len(self.weights))
        weights = self.weights[which]
        if self.shared:
            found = BARRIER * self.barrier.value(points, 1.0 + weights / BARRIER)
            found += weights * (points @ self.slope + self.constant)
        else:
            found = BARRIER * self.barrier.value(points) + weights * self.links.distances(points)
        errors = points - self.reference
        found += 0.5 * np.einsum("pi,pi->p", self.stiffness[which] * errors, errors)
        for number, own in _each(data):
            products = points[own] @ self.curvatures[number]
            found[own] += np.einsum("pi,pi->p", 0.5 * products - self.slopes[number], points[own])
        return found

    def derivatives(self, points: Matrix, problems: npt.NDArray[np.intp]) -> tuple[Matrix, Tensor]:
        data, which = np.divmod(problems, len(self.weights))
        hessians, gradients = self.curvatures[data], np.empty_like(points)
        for number, own in _each(data):
            gradients[own] = points[own] @ self.curvatures[number] - self.slopes[number]
        gradients += self.stiffness[which] * (points - self.reference)
        np.einsum("pii->pi", hessians)[...] += self.stiffness[which]
        weights, factors = self.weights[which], np.full(len(points), BARRIER)
        if self.shared:
            gradients += weights[:, None] * self.slope
            self.barrier.add_derivatives(points, factors, gradients, hessians, 1.0 + weights / BARRIER)
            return gradients, hessians
        self.barrier.add_derivatives(points, factors, gradients, hessians)
        self.links.add_derivatives(points, weights, gradients, hessians)
        return gradients, hessians


def _each(data: npt.NDArray[np.intp]) -> Iterator[tuple[int, slice | npt.NDArray[np.bool_]]]:
    """Yield the number of every data set of some problems, and which of these are about it."""
    numbers = set(data.tolist())
    for number in numbers:
        yield number, slice(None) if len(numbers) == 1 else data == number


@dataclass(frozen=True, eq=False)
class HeldOutRows:
    """The weighted rows of a part of the data, of which the others are to predict what they can.

    Where joints move one at a time, a part may be the only one that shows a base parameter. How it is predicted tells
    nothing of the fit of the others, and drowns what tells. Such directions are free here: they take what they explain.

    Attributes
    ----------
    factors : tuple of Factor
    weights : (N,)
    free : (r, m)
        Orthonormal columns over the rows of all factors, one for each direction that the others do not show.
    """

    factors: tuple[Factor, ...]
    weights: Vector
    free: Matrix

    @classmethod
    def of(cls, info: Information, parts: Sequence[Information], weights: Vector) -> tuple[HeldOutRows, ...]:
        """Return the rows of each of the parts, which together are the whole.

        Parameters
        ----------
        info : Information
        parts : sequence of Information
        weights : (N,)
            Of the joints.
        """
        inverse, _, _ = inverse_root_of(info, weights)
        found = []
        for part in parts:
            # In coordinates in which all data show each direction alike, this is what the part shows of it.
            rows = np.concatenate(
                [w * f.triangle[:, :-1] @ inverse[f.columns] for f, w in zip(part.factors, weights, strict=True)]
            )
            values, vectors = eigenvectors(rows.T @ rows)
            own = values > 1.0 - SHOWN
            found.append(cls(part.factors, weights, rows @ vectors[:, own] / np.sqrt(values[own])))
        return tuple(found)

    def squares(self, bases: Matrix) -> Matrix:
        """Return the squared residuals of each joint (k, N), without weights, of base parameters (k, n_b)."""
        left = [
            w * (f.triangle[:, -1] - bases[:, f.columns] @ f.triangle[:, :-1].T)
            for f, w in zip(self.factors, self.weights, strict=True)
        ]
        if self.free.shape[1]:
            every = np.concatenate(left, axis=1)
            every -= (every @ self.free) @ self.free.T
            left = np.split(every, np.cumsum([one.shape[1] for one in left])[:-1], axis=1)
        return np.column_stack([np.sum(own**2, axis=1) for own in left]) / self.weights**2
