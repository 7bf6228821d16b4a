"""Ends of a region in many directions at once, by a primal-dual interior-point method side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from steelyard.dynamics.threads import in_threads

__all__ = ["Region", "furthest"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Tensor = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

SIDE_BY_SIDE = 64
"""Problems that are solved together by one thread."""

CACHED = 16
"""Hessians that are made together: those of a robot with seven joints stay in the cache."""

FIRST = 0.6
"""Part of the way to the end of the ellipsoid around the center with which the search begins; the ball counts as one
condition there, so that from 0.7 on it may be left."""

TO_BOUNDARY = 0.95
"""Part of the way to the boundary that a step goes at most."""

ENOUGH = 0.4
"""Gap of duality, relative to the way from the center, at which a search ends. The end of the tangent is then within
1.5 % of the way, with 0.2 within 0.8 %, with 0.8 within 4 %; from one to the next takes half a step of four."""

AHEAD = 0.05
"""Part of the way that is left to the tangent, at most. Where few conditions hold the region, the gap alone would leave
half of the way to it; robots have so many that this decides nothing."""

STEPS = 60
"""At most; four to nine are usual."""

SMALLEST = 1e-12
"""Width relative to the widest, below which a direction is one in which the region has no extent."""

LIGHTEST = 1e-7
"""Least part of the denominator at the center by which the accuracy of a ratio is judged; below it, the end of the
tangent tells none."""

RIDGE = 1e-13
"""Relative to the diagonal of a Hessian, and added to it, so that directions in which nothing bounds the region leave a
matrix that has a factor."""


class Region:
    """All y with lines · y + constants ≥ 0, matrices that are positive semidefinite, and ‖ball y + middle‖ ≤ radius.

    Parameters
    ----------
    rows, constants : (m, n), (m,)
        The lines.
    groups : sequence of (indices (b, c), coefficients (b, c, d, d), constants (b, d, d))
        Affine matrices of each shape, as `matrix_conditions` returns them.
    ball, middle : (k, n), (k,)
    radius : float

    Examples
    --------
    Within a circle of radius two, and left of one:

    >>> region = Region(np.array([[-1.0, 0.0]]), np.ones(1), [], np.eye(2), np.zeros(2), 2.0)
    >>> furthest(region, np.array([[1.0, 0.0], [-1.0, 0.0]]))[:, 0].round(1).tolist()
    [1.0, -2.0]
    """

    def __init__(
        self,
        rows: Matrix,
        constants: Vector,
        groups: Sequence[tuple[Indices, Tensor, Tensor]],
        ball: Matrix,
        middle: Vector,
        radius: float,
    ) -> None:
        self.rows, self.constants, self.groups = rows, constants, groups
        self.ball, self.middle, self.radius = ball, middle, radius
        self.size = ball.shape[1]
        self.curvature = ball.T @ ball
        # Where lines and matrices add to a Hessian of so many unknowns, and what each line adds there.
        used = [np.flatnonzero(row) for row in rows]
        places = [(own[:, None] * self.size + own).ravel() for own in used]
        blocks = [(own[:, :, None] * self.size + own[:, None]).ravel() for own, _, _ in groups]
        self.places = np.unique(np.concatenate([np.zeros(0, dtype=np.intp), *places, *blocks]))
        self.products = np.zeros((len(rows), len(self.places)))
        for product, row, own, place in zip(self.products, rows, used, places, strict=True):
            product[np.searchsorted(self.places, place)] = np.outer(row[own], row[own]).ravel()
        self.of_blocks = [np.searchsorted(self.places, own) for own in blocks]
        self.flat = [coefficients.reshape(*coefficients.shape[:2], -1) for _, coefficients, _ in groups]

    @property
    def degree(self) -> int:
        """Conditions of all lines and matrices, and of the ball."""
        return int(1 + len(self.rows) + sum(len(i) * c.shape[-1] for i, _, c in self.groups))

    def change(self, steps: Matrix) -> Slacks:
        """By how much steps (p, n) change the slacks."""
        matrices = [
            np.einsum("pbi,biac->pbac", steps[:, indices], coefficients) for indices, coefficients, _ in self.groups
        ]
        ball = np.zeros((len(steps), len(self.ball) + 1))
        np.matmul(steps, self.ball.T, out=ball[:, 1:])
        return Slacks(steps @ self.rows.T, matrices, ball)

    def slacks(self, points: Matrix) -> Slacks:
        """What lines, matrices and ball are at points (p, n)."""
        found = self.change(points)
        found.lines += self.constants
        for matrices, (_, _, constants) in zip(found.matrices, self.groups, strict=True):
            matrices += constants
        found.ball[:, 0] = self.radius
        found.ball[:, 1:] += self.middle
        return found

    def adjoint(self, duals: Slacks) -> Matrix:
        """The transpose of `change`, (p, n)."""
        found = duals.lines @ self.rows
        found += duals.ball[:, 1:] @ self.ball
        for (indices, _, _), flat, matrices in zip(self.groups, self.flat, duals.matrices, strict=True):
            parts = (flat @ matrices.reshape(*matrices.shape[:2], -1, 1))[..., 0]
            for block, own in enumerate(indices):
                found[:, own] += parts[:, block]
        return found


@dataclass
class Slacks:
    """A value in the cone of each problem: lines (p, m), matrices (p, b, d, d), and radius and ball, (p, 1 + k)."""

    lines: Matrix
    matrices: list[Tensor]
    ball: Matrix

    def at(self, which: Indices) -> Slacks:
        """Those of some of the problems."""
        return Slacks(self.lines[which], [m[which] for m in self.matrices], self.ball[which])

    def put(self, which: Indices, other: Slacks) -> None:
        """Replace those of some of the problems."""
        self.lines[which], self.ball[which] = other.lines, other.ball
        for mine, given in zip(self.matrices, other.matrices, strict=True):
            mine[which] = given

    def combined(self, own: Vector | float, other: Slacks, factor: Vector | float) -> Slacks:
        """own · self + factor · other, each factor a number or one for each problem."""
        a, b = (np.asarray(f, dtype=float)[..., None] for f in (own, factor))
        c, d = a[..., None, None], b[..., None, None]
        return Slacks(
            a * self.lines + b * other.lines,
            [c * m + d * o for m, o in zip(self.matrices, other.matrices, strict=True)],
            a * self.ball + b * other.ball,
        )

    def tangent(self, slacks: Slacks, change: Slacks, factors: Vector) -> Slacks:
        """What this, the inverse of slacks, becomes by a change of these, to first order, times factors."""
        flipped = change.ball / _hyperbolic(slacks.ball, slacks.ball)[:, None]
        flipped[:, 1:] *= -1.0
        along = np.einsum("pi,pi->p", np.broadcast_to(self.ball, change.ball.shape), change.ball)
        f = factors[:, None, None, None]
        return Slacks(
            factors[:, None] * (self.lines - self.lines**2 * change.lines),
            [f * (i - i @ c @ i) for i, c in zip(self.matrices, change.matrices, strict=True)],
            factors[:, None] * (self.ball - 2.0 * along[:, None] * self.ball + flipped),
        )

    def times(self, other: Slacks) -> Vector:
        """The inner product of each problem, (p,)."""
        found = np.einsum("pi,pi->p", self.lines, other.lines) + np.einsum("pi,pi->p", self.ball, other.ball)
        for mine, given in zip(self.matrices, other.matrices, strict=True):
            found += np.einsum("pbac,pbac->p", mine, given)
        return np.asarray(found)

    def inverse(self) -> Slacks:
        """The gradient of the barrier -Σ log - log det - ½ log (radius² - ‖ball‖²), but for its sign."""
        ball = self.ball / _hyperbolic(self.ball, self.ball)[:, None]
        ball[:, 1:] *= -1.0
        return Slacks(1.0 / self.lines, [_inverses(m) for m in self.matrices], ball)


def _hyperbolic(a: Matrix, b: Matrix) -> Vector:
    """The product in which the first element counts positive, and all others negative."""
    return np.asarray(2.0 * a[:, 0] * b[:, 0] - np.einsum("pi,pi->p", a, b))


def _inverses(matrices: Tensor) -> Tensor:
    """Of positive definite matrices (..., d, d), by one elimination for all: half of the time of as many calls."""
    rest = np.ascontiguousarray(np.moveaxis(matrices, (-2, -1), (0, 1)))
    for k in range(len(rest)):
        pivot = 1.0 / rest[k, k]
        row, column = rest[k] * pivot, rest[:, k].copy()
        rest[k], column[k] = 0.0, -1.0
        rest[:, k] = 0.0
        row[k] = pivot
        rest -= column[:, None] * row[None]
    return np.ascontiguousarray(np.moveaxis(rest, (0, 1), (-2, -1)))


def _least_eigenvalues(products: Tensor) -> Matrix:
    """Bounds from below, close ones, of the eigenvalues of matrices (..., d, d) whose eigenvalues are all real.

    Laguerre's method on their characteristic polynomial, whose coefficients are those of traces of powers (Newton's
    identities), begun below all of them, approaches the least one without passing it.
    """
    size = products.shape[-1]
    power, sums = products, [np.einsum("...ii->...", products)]
    for _ in range(size - 1):
        if len(sums) < size - 1:
            power = power @ products
            sums.append(np.einsum("...ii->...", power))
        else:
            sums.append(np.einsum("...ij,...ji->...", power, products))
    coefficients = [np.ones_like(sums[0])]
    for k in range(1, size + 1):
        coefficients.append(-np.sum([coefficients[k - j] * sums[j - 1] for j in range(1, k + 1)], axis=0) / k)
    mean = sums[0] / size
    # No eigenvalue is less (Wolkowicz and Styan, Bounds for eigenvalues using traces, 1980).
    found = mean - np.sqrt((size - 1.0) * np.maximum(sums[1] / size - mean**2, 0.0))
    found -= 1e-9 * np.abs(found)
    for _ in range(2):
        value, slope, bend = np.ones_like(found), np.zeros_like(found), np.zeros_like(found)
        for coefficient in coefficients[1:]:
            bend = bend * found + slope
            slope = slope * found + value
            value = value * found + coefficient
        first = slope / value
        second = first**2 - 2.0 * bend / value
        root = np.sqrt(np.maximum((size - 1.0) * (size * second - first**2), 0.0))
        step = size / (first - root)
        found -= np.where((value > 0.0) & (slope < 0.0) & np.isfinite(step), step, 0.0)
    return np.asarray(found)


def _longest(inverse: Slacks, value: Slacks, change: Slacks) -> Vector:
    """How many times a change can be added to a value inside the cone; at most 10."""
    least = np.min(change.lines * inverse.lines, axis=1, initial=-0.1)
    for matrices, changes in zip(inverse.matrices, change.matrices, strict=True):
        least = np.minimum(least, _least_eigenvalues(matrices @ changes).min(axis=1))
    a, b = _hyperbolic(change.ball, change.ball), _hyperbolic(value.ball, change.ball)
    c = _hyperbolic(value.ball, value.ball)
    root = b * b - a * c
    # The first x with c + 2 b x + a x² = 0, inverted.
    first = np.where(root > 0.0, (np.sqrt(np.maximum(root, 0.0)) - b) / c, 0.0)
    return np.asarray(1.0 / np.maximum(-least, first))


def furthest(region: Region, rows: Matrix, weights: Matrix | None = None, enough: float = ENOUGH) -> Matrix:
    """Where each row · y is largest in the region, to about a hundredth of the way to there.

    Mehrotra's predictor-corrector method (On the implementation of a primal-dual interior point method, SIAM Journal on
    Optimization 2, 1992) from y = 0, which should be near the analytic center. The search stops where the gap of
    duality is still `ENOUGH` of the way: from there the tangent of the central path leads to its end.

    Parameters
    ----------
    region : Region
    rows : (p, n)
    weights : (p, n), optional
        Where rows belong to ratios, 1 + weight · y tells how many times as large as at y = 0 the denominator is.
    enough : float
        In the place of `ENOUGH`; the hundredth is less in proportion.

    Returns
    -------
    (p, n)
        Ends of the path, outside of the region by about the same hundredth.
    """
    found = np.empty_like(rows)
    denominators = np.zeros_like(rows) if weights is None else weights
    chunks = np.array_split(np.arange(len(rows)), max(1, -(-len(rows) // SIDE_BY_SIDE)))

    def solve(own: Indices) -> None:
        with np.errstate(all="ignore"):  # what breaks down stays where it was
            found[own] = _furthest(region, rows[own], denominators[own], enough)

    in_threads(solve, chunks)
    return found


def _furthest(region: Region, rows: Matrix, weights: Matrix, enough: float) -> Matrix:
    slacks = region.slacks(np.zeros((1, region.size)))
    inverse = slacks.inverse()
    # All share the Hessian of the center.
    ahead = _Newton(region, slacks, inverse, inverse).solve(rows[None])[0]
    widths = np.sqrt(np.maximum(np.einsum("pi,pi->p", rows, ahead), 0.0))
    active = np.flatnonzero(widths > SMALLEST * np.max(widths, initial=0.0))
    pulls = np.where(widths > 0.0, widths, 1.0) / FIRST
    points = ahead / pulls[:, None]
    duals = inverse.tangent(slacks, region.change(points), pulls)
    found = np.zeros_like(points)
    for _ in range(STEPS):
        if not len(active):
            break
        point, dual, row = points[active], duals.at(active), rows[active]
        slacks = region.slacks(point)
        inverse = slacks.inverse()
        gap = slacks.times(dual)
        newton = _Newton(region, slacks, inverse, dual)
        solved = newton.solve(np.stack([row, region.adjoint(inverse)], axis=1))
        affine, centering = solved[:, 0], solved[:, 1]
        end = point + affine
        sound = np.isfinite(gap) & np.isfinite(end).all(axis=1)
        found[active[sound]] = end[sound]
        way = np.maximum(np.einsum("pi,pi->p", row, end), widths[active])
        way *= np.clip(1.0 + np.einsum("pi,pi->p", weights[active], end), LIGHTEST, 1.0)
        rest = np.einsum("pi,pi->p", row, affine)
        going = np.flatnonzero(sound & ((gap > enough * way) | (rest > AHEAD * enough / ENOUGH * way)))
        if len(going) < len(active):
            newton.keep(going)
            active, point, dual, gap = active[going], point[going], newton.dual, gap[going]
            slacks, inverse, affine, centering = slacks.at(going), newton.inverse, affine[going], centering[going]
        if not len(active):
            break
        change = region.change(affine)
        answer = dual.combined(-1.0, newton.response(change), -1.0)
        dual_inverse = dual.inverse()
        length = np.minimum(_longest(inverse, slacks, change), _longest(dual_inverse, dual, answer))
        target = (1.0 - np.minimum(length, 1.0)) ** 3 * gap / region.degree
        second = newton.second(change, answer)
        step = affine + target[:, None] * centering + newton.solve(region.adjoint(second)[:, None])[:, 0]
        change = region.change(step)
        answer = inverse.combined(target, dual, -1.0).combined(1.0, newton.response(change), -1.0)
        answer = answer.combined(1.0, second, 1.0)
        points[active] = point + np.minimum(1.0, TO_BOUNDARY * _longest(inverse, slacks, change))[:, None] * step
        length = np.minimum(1.0, TO_BOUNDARY * _longest(dual_inverse, dual, answer))
        duals.put(active, dual.combined(1.0, answer, length))
    return np.asarray(found)


class _Newton:
    """The Newton systems of many problems: the direction of Nesterov and Todd for lines and the ball, and for matrices
    that of Helmberg, Rendl, Vanderbei and Wolkowicz, which needs no root of them.
    """

    def __init__(self, region: Region, slacks: Slacks, inverse: Slacks, dual: Slacks) -> None:
        self.region, self.inverse, self.dual = region, inverse, dual
        self.lines = dual.lines * inverse.lines
        own, other = _hyperbolic(slacks.ball, slacks.ball), _hyperbolic(dual.ball, dual.ball)
        a = slacks.ball / np.sqrt(own)[:, None]
        b = dual.ball / np.sqrt(other)[:, None]
        flipped = b.copy()
        flipped[:, 1:] *= -1.0
        half = np.sqrt(0.5 * (1.0 + np.einsum("pi,pi->p", a, b)))
        self.root = (a + flipped) / (2.0 * half)[:, None]
        self.size = np.sqrt(own / other)
        self.turned = self.root.copy()
        self.turned[:, 1:] *= -1.0
        # The ball adds a multiple of its curvature, and what is highest along one direction of each problem.
        self.along = self.turned[:, 1:] @ region.ball * np.sqrt(2.0 / self.size)[:, None]
        self.factors = self._factor()
        self.across: Matrix | None = None  # comes with the first solution: both together take half of the time

    def keep(self, which: Indices) -> None:
        """Go on with some of the problems."""
        self.inverse, self.dual = self.inverse.at(which), self.dual.at(which)
        self.lines, self.size = self.lines[which], self.size[which]
        self.root, self.turned = self.root[which], self.turned[which]
        self.along = self.along[which]
        self.across = None if self.across is None else self.across[which]
        self.factors = [self.factors[k] for k in which]

    def response(self, change: Slacks) -> Slacks:
        """The change of duals that a change of slacks asks for."""
        matrices = []
        for inverse, dual, given in zip(self.inverse.matrices, self.dual.matrices, change.matrices, strict=True):
            product = inverse @ given @ dual
            matrices.append(0.5 * (product + product.swapaxes(-1, -2)))
        flipped = change.ball.copy()
        flipped[:, 1:] *= -1.0
        along = np.einsum("pi,pi->p", self.turned, change.ball)
        ball = (2.0 * along[:, None] * self.turned - flipped) / self.size[:, None]
        return Slacks(self.lines * change.lines, matrices, ball)

    def second(self, change: Slacks, answer: Slacks) -> Slacks:
        """What the product of both changes adds to the duals (Mehrotra)."""
        matrices = []
        for inverse, own, other in zip(self.inverse.matrices, change.matrices, answer.matrices, strict=True):
            product = inverse @ own @ other
            matrices.append(-0.5 * (product + product.swapaxes(-1, -2)))
        scaled, back, middle = self._back(change.ball), self._forth(answer.ball), self._forth(self.dual.ball)
        product = scaled[:, :1] * back + back[:, :1] * scaled
        product[:, 0] = np.einsum("pi,pi->p", scaled, back)
        first = _hyperbolic(middle, product) / _hyperbolic(middle, middle)
        found = (product - middle * first[:, None]) / middle[:, :1]
        found[:, 0] = first
        return Slacks(-change.lines * answer.lines * self.inverse.lines, matrices, -self._back(found))

    def _forth(self, values: Matrix) -> Matrix:
        return _boosted(self.root, values) * np.sqrt(self.size)[:, None]

    def _back(self, values: Matrix) -> Matrix:
        return _boosted(self.turned, values) / np.sqrt(self.size)[:, None]

    def _factor(self) -> list[Matrix]:
        from scipy.linalg.lapack import dpotrf

        region, factors = self.region, []
        added = self.lines @ region.products
        for flat, places, inverse, dual in zip(
            region.flat, region.of_blocks, self.inverse.matrices, self.dual.matrices, strict=True
        ):
            size = inverse.shape[-1]
            both = inverse[..., :, None, :, None] * dual[..., None, :, None, :]
            both = both.reshape(*both.shape[:2], size * size, size * size)
            found = flat @ both @ flat.swapaxes(-1, -2)
            found = 0.5 * (found + found.swapaxes(-1, -2))
            for block, own in enumerate(np.split(places, len(flat))):
                added[:, own] += found[:, block].reshape(len(added), -1)
        for start in range(0, len(added), CACHED):
            part = slice(start, start + CACHED)
            hessians = region.curvature / self.size[part, None, None]
            hessians.reshape(len(hessians), -1)[:, region.places] += added[part]
            diagonals = hessians.reshape(len(hessians), -1)[:, :: region.size + 1]
            diagonals *= 1.0 + RIDGE
            for hessian, diagonal in zip(hessians, diagonals, strict=True):
                # Symmetric, so that its transpose, which LAPACK takes without a copy, is the same.
                factor, fails = dpotrf(hessian.T, lower=1, clean=0)
                ridge = RIDGE
                while fails and ridge < 1.0:
                    ridge *= 100.0
                    diagonal *= 1.0 + ridge
                    factor, fails = dpotrf(hessian.T, lower=1, clean=0)
                factors.append(factor)
        return factors

    def solve(self, rows: Tensor) -> Tensor:
        """H⁻¹ times the vectors (p, k, n) of each problem."""
        if self.across is None:
            found = self._without_ball(np.concatenate([rows, self.along[:, None]], axis=1))
            found, self.across = found[:, :-1], found[:, -1]
        else:
            found = self._without_ball(rows)
        whole = 1.0 + np.einsum("pn,pn->p", self.along, self.across)
        along = np.einsum("pkn,pn->pk", rows, self.across) / whole[:, None]
        return np.asarray(found - along[:, :, None] * self.across[:, None])

    def _without_ball(self, rows: Tensor) -> Tensor:
        from scipy.linalg.lapack import dpotrs

        found = np.empty_like(rows)
        for factor, own, row in zip(self.factors, found, rows, strict=True):
            own[:] = dpotrs(factor, row.T, lower=1)[0].T
        return found


def _boosted(root: Matrix, values: Matrix) -> Matrix:
    """The hyperbolic rotation that takes (1, 0) to `root`, of values."""
    along = np.einsum("pi,pi->p", root[:, 1:], values[:, 1:])
    found = values + root * (values[:, 0] + along / (1.0 + root[:, 0]))[:, None]
    found[:, 0] = root[:, 0] * values[:, 0] + along
    return np.asarray(found)
