"""How far estimates may be off because friction near standstill is not that of the model."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.estimators.cross_validation import SHOWN
from steelyard.recording import Samples
from steelyard.regression import Estimate, Information, ParameterCovariance
from steelyard.regression.factor import eigenvectors
from steelyard.regression.parameter_covariance import inverse_root_of

__all__ = ["standstill_errors"]

Array = NDArray[np.float64]
SLOW = (0.05, 0.1)
"""Parts of a joint's own root mean square velocity below which its rows are slow. A sign that turns slowly, or too
late, shows best by the first, and friction that rises towards standstill by the second. With 0.2 beside them intervals
of a model that is right are up to 22 % wider, and no more of the others hold the truth than by taking the joints
together."""
MOST_ROWS = 16_000
"""Rows that are looked at, of stretches that are evenly spread: 10 to 15 ms of the processor for seven joints."""
FALL = 0.4
"""Part of that velocity by which friction beside the model's has fallen to 1/e of what it is at standstill."""
FALLEN = 2.0
"""How many times that velocity is looked at: 2 % of it are left."""
SURE = 3.0
"""Standard errors from zero at which the size of a Coulomb friction is known well enough to compare others with it, and
at which friction falls off with speed. Where it does not, intervals stay as wide as without this test; with 2 they are
up to 12 % wider."""


def standstill_errors(
    model: Model,
    information: Information,
    unconstrained: Estimate,
    stretches: Iterable[tuple[Samples, Array]],
    base: Array,
) -> Array | None:
    """Return by how much base parameters differ without slow rows, or with friction that falls off with speed.

    Where the model is right, the estimate from all rows and that from the faster ones of each joint differ by noise
    alone, whose covariance is known (Hausman's test). The excess of the square of the difference over its variance is
    the square of an error of the model, as far as one log tells it; zero where there is none. Of Coulomb friction the
    joints are also taken together, for in each the deviation is about as large a part of it, and that of one alone is
    hidden by noise.

    Friction that falls off over a wider range of speeds moves estimates from faster rows as well. So they are also
    compared with those of a model with two more columns for each joint: friction of the slowest rows, and
    ``sgn(v) exp(-(v / w)²)`` of the others. The larger error of a parameter counts, of these and of the two slownesses
    in `SLOW`.

    Parameters
    ----------
    information : Information
        In the base parameters of the model, with batch means.
    unconstrained : Estimate
        Its least squares.
    stretches : iterable of (Samples, ndarray)
        Rows of its logs, and what is left of their torques (S, N), NaN where a row is not used. Where they are a part
        of all rows, they stand for all.
    base : ndarray
        (n_b,) base parameters that leave this of the torques.

    Returns
    -------
    ndarray or None
        (n_b,), not negative, for `ParameterCovariance.with_independent_errors`; None where nothing is told.

    References
    ----------
    J. A. Hausman, Specification tests in econometrics, Econometrica 46, 1978.
    """
    covariance = ParameterCovariance.of(information, unconstrained.base, unconstrained.weights)
    if covariance.correlation is None or len(information.factors) != model.dof:
        return None
    kept = list(stretches)
    count = sum(samples.count for samples, _ in kept)
    kept = kept[:: max(-(-count // MOST_ROWS), 1)]
    count = sum(samples.count for samples, _ in kept)
    squares = np.sum([np.sum(samples.dq**2, axis=0) for samples, _ in kept], axis=0)
    if not np.any(squares):
        return None
    usual = np.sqrt(squares / count)
    frictions = _coulomb(model, unconstrained, covariance)
    found = np.zeros(information.base_count)
    weights = information.joint_weights(unconstrained.weights)
    rows = _SlowRows.of(model, weights, kept, FALLEN * FALL * usual, base - unconstrained.base)
    # Fewer rows tell less, which must not widen the intervals of a model that is right.
    stand_for = max(information.count / max(float(rows.counts.sum()), 1.0), 1.0)
    for part in SLOW:
        change, variance = _without(information, weights, covariance, rows.slower(part * usual), stand_for)
        variance = stand_for * variance
        excess = np.maximum(change**2 - variance, 0.0)
        if part == max(SLOW) and len(frictions) > 1:
            sizes = unconstrained.base[frictions] ** 2
            ratios, noise = change[frictions] ** 2 / sizes, variance[frictions] / sizes
            trust = np.where(noise > 0.0, noise, np.inf) ** -2.0
            if trust.sum() > 0.0:
                common = max(float(trust @ (ratios - noise) / trust.sum()), 0.0)
                excess[frictions] = np.maximum(excess[frictions], common * sizes)
        found = np.maximum(found, excess)
    columns = rows.columns(min(SLOW) * usual, FALL * usual)
    change, variance = _with(information, weights, covariance, columns, stand_for)
    found = np.maximum(found, change**2 - variance)
    found[covariance.unknown] = 0.0
    return np.sqrt(found) if found.any() else None


def _coulomb(model: Model, unconstrained: Estimate, covariance: ParameterCovariance) -> list[int]:
    """Return which base parameters are a Coulomb friction of which the data show the size."""
    kinds = dict(zip(map(str, model.parameter_names), model.described_as, strict=True))
    return [
        index
        for index, (name, value, error) in enumerate(
            zip(unconstrained.base_expressions, unconstrained.base, covariance.standard_error, strict=True)
        )
        if kinds.get(name) == "friction" and value > SURE * error
    ]


@dataclass(frozen=True, eq=False)
class _SlowRows:
    """Rows of each joint that are slow, weighted: (s,), (s, c) and (s,); and how many it has, slow or not, (N,)."""

    velocities: list[Array]
    regressors: list[Array]
    errors: list[Array]
    counts: Array
    weights: Array

    @classmethod
    def of(
        cls, model: Model, weights: Array, stretches: Sequence[tuple[Samples, Array]], limits: Array, more: Array
    ) -> _SlowRows:
        """Take those below limits (N,) from stretches; `more` (n_b,) base parameters explain more of the errors."""
        columns = model.base_columns
        parts: list[list[tuple[Array, Array, Array]]] = [[] for _ in columns.joints]
        counts = np.zeros(model.dof)
        for samples, left in stretches:
            used = np.isfinite(left)
            counts += used.sum(axis=0)
            slow = used & (np.abs(samples.dq) < limits)
            places = np.flatnonzero(slow.any(axis=1))
            by_joint = columns.by_joint(samples.entries_for(model, places))
            for k, (own, regressor) in enumerate(zip(columns.joints, by_joint, strict=True)):
                chosen = slow[places, k]
                rows, at = regressor[chosen], places[chosen]
                errors = left[at, k] + rows @ more[own]
                parts[k].append((samples.dq[at, k], weights[k] * rows, weights[k] * errors))
        joined = [[np.concatenate(one) for one in zip(*own, strict=True)] for own in parts]
        return cls([one[0] for one in joined], [one[1] for one in joined], [one[2] for one in joined], counts, weights)

    def columns(self, slowest: Array, widths: Array) -> Iterator[tuple[Array, Array, Array]]:
        """Yield of each joint C'C, W'C and C'r of two columns: friction below a velocity, and what falls off beyond."""
        given = zip(self.velocities, self.regressors, self.errors, slowest, widths, self.weights, strict=True)
        for velocity, regressor, error, least, width, weight in given:
            still = np.abs(velocity) < least
            falling = np.where(still, 0.0, np.exp(-((velocity / width) ** 2)))
            columns = weight * np.sign(velocity)[:, None] * np.column_stack([still, falling])
            yield columns.T @ columns, regressor.T @ columns, columns.T @ error

    def slower(self, limits: Array) -> Iterator[tuple[Array, Array]]:
        """Yield of each joint's rows below limits (N,) the products W'W and W'r."""
        for velocity, regressor, error, limit in zip(
            self.velocities, self.regressors, self.errors, limits, strict=True
        ):
            slow = np.abs(velocity) < limit
            own = regressor[slow]
            yield own.T @ own, own.T @ error[slow]


def _without(
    information: Information,
    weights: Array,
    covariance: ParameterCovariance,
    slow: Iterable[tuple[Array, Array]],
    stand_for: float,
) -> tuple[Array, Array]:
    """Return by how much base parameters change without the slow rows, and its variance where the model is right.

    In coordinates in which A, the weighted normal matrix of all rows, is one, let P be that of all slow rows. Those
    that were seen have p, and stand for n = P / p times as many. The change is ``-n (1 - P)⁻¹`` times the products of
    those that were seen with their residuals. These are ``(1 - p)`` times their own noise less ``p`` times that of all
    other rows.
    """
    assert covariance.correlation is not None
    inverse, _, _ = inverse_root_of(information, weights)
    long_run = covariance.correlation.widening * covariance.correlation.long_run_variance * weights**2
    size = inverse.shape[1]
    moved, seen, noise_of_all, noise_of_slow = np.zeros(size), *np.zeros((3, size, size))
    for factor, weight, (gram, product), own in zip(information.factors, weights, slow, long_run, strict=True):
        part = inverse[factor.columns]
        rows = weight * factor.triangle[:, :-1] @ part
        share = part.T @ gram @ part
        moved += part.T @ product
        seen += share
        noise_of_slow += own * share
        noise_of_all += own * (rows.T @ rows)
    values, vectors = eigenvectors(np.eye(size) - stand_for * seen)
    shown = values > SHOWN
    left = stand_for * inverse @ (vectors[:, shown] / values[shown]) @ vectors[:, shown].T
    by_others = left @ seen
    by_slow = left - by_others
    variance = np.einsum("ij,ij->i", by_slow @ noise_of_slow, by_slow)
    variance += np.einsum("ij,ij->i", by_others @ (noise_of_all - noise_of_slow), by_others)
    return -left @ moved, variance


def _with(
    information: Information,
    weights: Array,
    covariance: ParameterCovariance,
    columns: Iterable[tuple[Array, Array, Array]],
    stand_for: float,
) -> tuple[Array, Array]:
    """Return by how much base parameters change with columns beside the model's, and its variance.

    Those of a joint count where the last of them, friction that falls off, is surely there, see `SURE`. In the
    coordinates of `_without` the columns C of all rows, n times those that were seen, leave ``S = C'C - G'G`` with
    ``G = W'C`` beside the model's. Their sizes are ``S⁻¹ C'r``, and the base parameters change by -G times these.
    """
    assert covariance.correlation is not None
    inverse, _, _ = inverse_root_of(information, weights)
    long_run = covariance.correlation.widening * covariance.correlation.long_run_variance * weights**2
    change, variance = np.zeros((2, information.base_count))
    for factor, (squares, products, errors), own in zip(information.factors, columns, long_run, strict=True):
        there = np.diagonal(squares) > 0.0  # of the slowest rows there may be none
        if not there[-1]:
            continue
        length = np.sqrt(stand_for * np.diagonal(squares)[there])
        shared = stand_for * inverse[factor.columns].T @ products[:, there] / length
        own_squares = stand_for * squares[np.ix_(there, there)] / np.outer(length, length)
        values, vectors = eigenvectors(own_squares - shared.T @ shared)
        if values[0] <= SHOWN:  # the model explains them, as far as these rows tell
            continue
        solution = vectors / values @ vectors.T
        sizes = solution @ (stand_for * errors[there] / length)
        # Of the noise of all rows, of which one in n was seen, the model took its part.
        noise = own_squares - shared.T @ shared / stand_for
        errors_of_sizes = stand_for * own * solution @ noise @ solution
        if sizes[-1] < SURE * np.sqrt(errors_of_sizes[-1, -1]):
            continue
        moves = inverse @ shared
        change -= moves @ sizes
        variance += np.einsum("ij,jk,ik->i", moves, errors_of_sizes, moves)
    return change, variance
