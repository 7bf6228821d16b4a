"""Batches: robots of one kind that fall into two heaps, as after a change of a supplier.

Where a third of all is among them, what they have in common counts as what siblings vary by, and nobody is named; where
fewer are, each of them is. So the amplitudes of each cause are tried for two heaps first. Where there are two, the
cause is told that explains best by what their means differ; it is taken off the smaller heap, whose robots are held
against all others without it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import exp, log, tanh

import numpy as np
from numpy.typing import NDArray

from .causes import IMPOSSIBLE, Cause
from .variation import SiblingVariation, pseudo_inverse

__all__ = ["Heap", "beside_each_other", "common_part", "find_heap", "two_heaps"]

Array = NDArray[np.float64]
Numbers = NDArray[np.intp]
Directions = Callable[[Numbers, int], Array]

CHANCE = 0.01
"""Probability, as odds of one heap beside two, by which a fleet without batches may have one told."""

FEWEST_OF_BATCH, LEAST_OF_BATCH = 4, 0.05
"""Robots, and part of all, of which a batch has as many at least; fewer are named one by one."""

WIDE = 8.0
"""Standard deviations beyond which an amplitude says no more of where two heaps part."""

LIGHTEST_TAILS = 2.0
"""Degrees of freedom above which those of the shape of a heap lie: its variance is finite."""

MOST_SKEWED = 1.5
"""Logarithm of the root of the ratio of the scales at both sides of a heap, below which it lies."""

OF_DRIVES = ("friction", "term")
"""Kinds of causes by whose own size robots vary in them."""

WIDEST, FARTHEST = 50.0, 1e60
"""Logarithm of the scale of a heap, and distance of a robot, beyond which they do not count; in deviations of all."""

GRADIENT = 0.03
"""Largest derivative of the logarithm of a likelihood where it is as large as it can be."""

STEPS = 5
"""The most times that robots are sorted anew by what was found to be different."""


@dataclass(frozen=True, eq=False)
class Heap:
    """Robots that differ from the others in the same way; amplitudes are in units of `Cause.nominal`.

    Attributes
    ----------
    robots : ndarray
        Their numbers, in ascending order.
    cause : int
        Its number.
    near : tuple of int
        Numbers of other causes that explain it about as well.
    amplitudes, information : ndarray
        (k,) and (k, k): of the cause, and the inverse of the covariance of their errors.
    change : ndarray
        (len(robots), n_b) of the base parameters of each.
    weights : ndarray
        (n_b, k): of the deviation of one robot in its amplitudes, on average.
    explained : float
        Squared standard deviations, of the difference of the means.
    apart : float
        How far the heaps lie apart, in standard deviations of one robot.
    odds : float
        Logarithm of how much likelier two heaps are than one.
    """

    robots: Numbers
    cause: int
    near: tuple[int, ...]
    amplitudes: Array = field(repr=False)
    information: Array = field(repr=False)
    change: Array = field(repr=False)
    weights: Array = field(repr=False)
    explained: float
    apart: float
    odds: float


def two_heaps(amplitudes: Array, causes: int = 1) -> tuple[float, Numbers, float] | None:
    """Split amplitudes of robots in two, where two heaps of one shape are surely likelier than one heap of any.

    The shape is a Student's distribution with two scales, one at each side, so that no skew and no tails of what
    siblings vary by pass for a second heap. The criterion is the integrated likelihood of the classification
    (C. Biernacki, G. Celeux and G. Govaert, Assessing a mixture model for clustering with the integrated completed
    likelihood, 2000), which counts what is not known of who belongs where: two heaps that overlap much are not told
    apart.

    Parameters
    ----------
    amplitudes : (R,)
        NaN where nothing is known.
    causes : int
        How many are tried, of which the best counts.

    Returns
    -------
    tuple or None
        The logarithm of the odds, the numbers of the robots of the smaller heap, and how far it is from the other.

    Examples
    --------
    >>> amplitudes = np.concatenate([np.linspace(-0.1, 0.1, 30), np.linspace(0.9, 1.1, 10)])
    >>> _, robots, apart = two_heaps(amplitudes)
    >>> robots.tolist(), round(apart, 2)
    ([30, 31, 32, 33, 34, 35, 36, 37, 38, 39], 1.0)
    >>> two_heaps(np.linspace(-1.0, 1.0, 40)) is None
    True
    """
    known = np.flatnonzero(np.isfinite(amplitudes))
    count, least = len(known), _least(len(known))
    if count < 2 * least:
        return None
    order = known[np.argsort(amplitudes[known], kind="stable")]
    values = amplitudes[order]
    middle = float(np.median(values))
    size = 1.4826 * float(np.median(np.abs(values - middle)))
    values = (values - middle) / max(size, 1e-9 * float(np.max(np.abs(values - middle))), 1e-300)
    values = np.clip(values, -FARTHEST, FARTHEST)
    # Distances from medians tell the best place at once, and whether it is worth while to go on; those of two heaps of
    # Laplace's distribution, which a few robots that are far out do not draw.
    near = np.clip(values, -WIDE, WIDE)
    sums, sizes = np.concatenate([[0.0], np.cumsum(near)]), np.arange(1, count)

    def away(begin: Numbers | int, end: Numbers | int) -> Array:
        half = (np.asarray(end) - begin) // 2
        return np.asarray(sums[end] - sums[end - half] - sums[begin + half] + sums[begin])

    whole = max(float(away(0, count)), 1e-300)
    within = np.maximum(away(0, sizes) + away(sizes, count), 1e-9 * whole)
    share = sizes / count
    unsure = -share * np.log(share) - (1.0 - share) * np.log(1.0 - share)
    gains = count * (np.log(whole / within) - unsure)
    best = int(np.argmax(gains))
    # Where few part best from the others, these are named one by one. With a sound one to make them a heap, of eleven
    # arms of which three read twice the torque at a joint the sound one was told, and the three were not.
    if not gains[best] > log(count) or not least <= sizes[best] <= count - least:
        return None
    lower, upper = values[: best + 1], values[best + 1 :]
    # The second heap has two numbers of its own, each of which costs half of log(count).
    two = _of_two(lower, upper) - count * float(unsure[best]) - log(count)
    odds = two - _of_one(values, two - log(causes / CHANCE))
    if not odds > log(causes / CHANCE):
        return None
    first = 2 * len(lower) >= count
    robots = order[best + 1 :] if first else order[: best + 1]
    centre = amplitudes[order[best + 1 :]].mean() - amplitudes[order[: best + 1]].mean()
    return odds, np.sort(robots), float(centre if first else -centre)


def _least(count: int) -> int:
    return max(FEWEST_OF_BATCH, int(np.ceil(LEAST_OF_BATCH * count)))


def _log_likelihood(values: Array, scale: float, skew: float, tails: float) -> tuple[float, Array]:
    """Of values around zero, with a Student's distribution that has its own scale at each side.

    Returns
    -------
    tuple of float and ndarray
        It, and its derivatives by the place of the distribution, `scale`, `skew` and `tails`.
    """
    from scipy.special import gammaln, psi

    # Of robots that are exactly alike the likelihood has no end.
    spread, freedom = exp(np.clip(scale, -WIDEST, WIDEST)), LIGHTEST_TAILS + exp(np.clip(tails, -WIDEST, 7.0))
    skewed = MOST_SKEWED * tanh(skew / MOST_SKEWED)
    side = np.where(values > 0.0, 1.0, -1.0)
    own = spread * np.where(values > 0.0, exp(skewed), exp(-skewed))
    squares = (values / own) ** 2
    logarithms = float(np.sum(np.log1p(squares / freedom)))
    constant = gammaln(0.5 * (freedom + 1.0)) - gammaln(0.5 * freedom) - 0.5 * log(freedom * np.pi)
    constant -= log(spread * np.cosh(skewed))
    told = float(len(values) * constant - 0.5 * (freedom + 1.0) * logarithms)
    pulls = (freedom + 1.0) * squares / (freedom + squares)
    by_place = float((freedom + 1.0) * np.sum(values / own**2 / (freedom + squares)))
    by_skewed = float(side @ pulls) - len(values) * tanh(skewed)
    by_freedom = 0.5 * len(values) * (psi(0.5 * (freedom + 1.0)) - psi(0.5 * freedom) - 1.0 / freedom)
    by_freedom += 0.5 * (float(pulls.sum()) / freedom - logarithms)
    derivatives = (
        by_place,
        (float(pulls.sum()) - len(values)) * (abs(scale) < WIDEST),
        by_skewed * (1.0 - tanh(skew / MOST_SKEWED) ** 2),
        by_freedom * (freedom - LIGHTEST_TAILS) * (-WIDEST < tails < 7.0),
    )
    return told, np.array(derivatives)


def _most(told: Callable[[Array], tuple[float, Array]], start: Sequence[float]) -> float:
    """The largest logarithm of a likelihood, to a hundredth; its derivatives save nine tenths of the evaluations."""
    from scipy.optimize import minimize

    def negative(parameters: Array) -> tuple[float, Array]:
        value, derivatives = told(parameters)
        return -value, -derivatives

    return -float(minimize(negative, np.array(start), jac=True, method="BFGS", options={"gtol": GRADIENT}).fun)


def _of_one(values: Array, enough: float) -> float:
    """The largest logarithm of the likelihood of one heap, from four starts: plain, skewed to each side, heavy tails.

    One that has no tails at all, as where parts are sorted by size, is as likely all over. What reaches `enough` is not
    improved any more: the first start does in most heaps.
    """
    found = -len(values) * log(max(float(np.ptp(values)), 1e-300))
    for where, skew, tails in ((0.5, 0.0, 1.5), (0.3, 0.7, 1.5), (0.7, -0.7, 1.5), (0.5, 0.0, -2.0)):
        if found < enough:
            start = float(np.quantile(values, where)), 0.0, skew, tails
            found = max(found, _most(lambda p: _log_likelihood(values - p[0], *p[1:]), start))
    return found


def _of_two(lower: Array, upper: Array) -> float:
    """The largest logarithm of the likelihood of two heaps of one shape, of which each robot's is known."""
    centres = float(np.median(lower)), float(np.median(upper))
    within = np.concatenate([lower - centres[0], upper - centres[1]])
    size = log(max(1.4826 * float(np.median(np.abs(within))), 1e-6))

    def told(parameters: Array) -> tuple[float, Array]:
        below, above = (
            _log_likelihood(values - parameters[k], *parameters[2:]) for k, values in enumerate((lower, upper))
        )
        return below[0] + above[0], np.array([below[1][0], above[1][0], *(below[1] + above[1])[1:]])

    return _most(told, (*centres, size, 0.0, 1.5))


def find_heap(
    variation: SiblingVariation,
    amplitudes: Sequence[tuple[int, Array]],
    causes: Sequence[Cause],
    directions: Directions,
    beside: Callable[[int, int, float], float],
    likely: float,
) -> tuple[Heap, SiblingVariation] | None:
    """Find robots that all have another amount of something, and how siblings vary within both heaps.

    Parameters
    ----------
    variation : SiblingVariation
        Settled.
    amplitudes : sequence of (int, (R,))
        Of each robot, each cause by itself, with the number of the cause.
    causes : sequence of Cause
    directions : callable
        How base parameters of robots change with a cause, (len(robots), n_b, k), by the numbers of both.
    beside : callable
        An amplitude, of a robot and a cause, as a part of what siblings have.
    likely : float
        By how much the logarithm of the likelihood of another cause may be below, to be told beside the best.
    """
    splits = [(two_heaps(values, len(amplitudes)), cause, values) for cause, values in amplitudes]
    told = [(*split, k, values) for split, k, values in splits if split is not None]
    tried = []
    for odds, robots, apart, cause, values in sorted(told, key=lambda one: -one[0]):
        sides = [(robots, apart)]
        if causes[cause].kind == "gain":
            # What a torque that reads wrong does to the base parameters depends on each robot's motion; those that read
            # right are alike. So which heap reads wrong is known, however large it is.
            sides.append((np.setdiff1d(np.flatnonzero(np.isfinite(values)), robots), -apart))
        for side, distance in sides:
            within = variation.copied()
            change, taken = distance * directions(side, cause)[:, :, 0], cause
            for _ in range(STEPS):
                moved = within.bases.copy()
                moved[side] -= change
                within.begin(moved)
                # How siblings vary within a heap tells causes apart, and not how they vary in both.
                within.settle(moved, {})
                found = common_part(within, side, causes, directions, beside, likely, odds)
                again, sign = side, 1.0
                if found.cause == taken:  # another one leaves some of the difference in how siblings vary
                    again, sign = _sorted(within, found, directions, causes)
                    if np.array_equal(again, side) or not _least(within.count) <= len(again) < within.count:
                        break
                side, taken = again, found.cause
                change = sign * directions(again, found.cause) @ found.amplitudes
            # Robots that are out of order in several ways may look alike in one; what they have in common is not all.
            alike = _alike(found.robots, robots, np.flatnonzero(np.isfinite(values)))
            usual = np.sum(within.weights[found.robots] >= 1.0) >= _least(within.count)
            if alike and usual and not _each_its_own(within, found, causes, directions):
                left = float(np.linalg.slogdet(np.mean(within.errors, axis=0) + within.spread_matrix)[1])
                tried.append((left, found, within))
    # What splits robots in one part shows in others, as torques of another unit do in all; least is left beside itself.
    return min(tried, key=lambda one: one[0])[1:] if tried else None


def _alike(found: Numbers, robots: Numbers, known: Numbers) -> bool:
    """Whether a heap that was sorted anew is still the one, or the other, that was told apart: only these are two."""
    inside = np.isin(known, found)
    shared = [np.sum(inside & one) / np.sum(inside | one) for one in (np.isin(known, robots), ~np.isin(known, robots))]
    return bool(max(shared) > 0.5)


def _each_its_own(variation: SiblingVariation, heap: Heap, causes: Sequence[Cause], directions: Directions) -> bool:
    """Whether most robots of a heap show some other cause more clearly, each its own, than what they have in common.

    Robots of which each has another heavier link are all beyond the others in what joints before these links carry. Of
    150 arms ten such ones were told as a batch, of one of the links, and one to four of them were named. That a cause
    is chosen for each robot is counted, and no robot speaks for many: one may be out of order as well.
    """
    robots = heap.robots
    inverses = np.linalg.inv(variation.errors[robots] + variation.spread_matrix)
    away = variation.bases[robots] - variation.mean
    seen = np.einsum("rij,rj->ri", inverses, away)

    def explained(cause: int) -> Array:
        along = directions(robots, cause)[:, :, 0]
        told = np.maximum(np.einsum("ri,rij,rj->r", along, inverses, along), 1e-300)
        return np.asarray(np.einsum("ri,ri->r", along, seen) ** 2 / told)

    if len(heap.amplitudes) == 1:  # of which each may have its own amount
        together = explained(heap.cause)
    else:
        left = away - heap.change
        together = np.einsum("ri,ri->r", away, seen) - np.einsum("ri,rij,rj->r", left, inverses, left)
    others = [k for k, one in enumerate(causes) if k != heap.cause and one.directions.shape[1] == 1]
    if causes[heap.cause].kind in OF_DRIVES:  # more friction varies by more, and in the cold all joints have more
        others = [k for k in others if causes[k].kind not in OF_DRIVES]
    if not others:
        return False
    chosen = log(len(causes))
    better = 0.5 * (np.max([explained(k) for k in others], axis=0) - together) - chosen
    return bool(np.clip(better, -chosen, chosen).sum() > 0.0)


def common_part(
    variation: SiblingVariation,
    robots: Numbers,
    causes: Sequence[Cause],
    directions: Directions,
    beside: Callable[[int, int, float], float],
    likely: float,
    odds: float,
) -> Heap:
    """Tell by what the mean of some robots differs from that of the others, by generalised least squares for both.

    With W_r the inverse covariance of one robot and P that of the mean, the information on amplitudes along G_r is
    ``sum G_r' W_r G_r - (sum G_r' W_r) P⁻¹ (sum W_r G_r)``.
    """
    own = variation.mean_weights[robots]
    together, left = own.sum(axis=0), variation.mean_covariance
    others = variation.precision - together
    total = variation.precision @ variation.mean - np.einsum("rij,rj->i", own, variation.moved[robots])
    mean = np.linalg.solve(others, total)
    away = variation.bases[robots] - mean
    seen = np.einsum("rij,rj->ri", own, away)
    seen_all = seen.sum(axis=0)
    # What any difference of the means would explain, of which each cause leaves some.
    score = seen_all - together @ left @ seen_all
    most = float(score @ np.linalg.pinv(together - together @ left @ together, rcond=1e-9, hermitian=True) @ score)
    tried, alongs = [], []
    for k, cause in enumerate(causes):
        along = directions(robots, k)
        if cause.kind == "scale":  # a multiple of the mean itself, from which medians are further than it is known
            along = np.broadcast_to(mean[:, None], along.shape)
        alongs.append(along)
        weighed = own @ along  # (m, n_b, k)
        crossed = weighed.sum(axis=0)
        told = np.einsum("rij,rik->jk", along, weighed) - crossed.T @ left @ crossed
        score = np.einsum("rij,ri->j", along, seen) - crossed.T @ left @ seen_all
        amplitude, size = pseudo_inverse(told) @ score, int(np.linalg.matrix_rank(told, hermitian=True))
        prior = cause.log_prior(np.nan, np.nan)
        if len(amplitude) == 1:
            ratio = 1.0 + beside(int(robots[0]), k, float(amplitude[0]))
            prior = cause.log_prior(ratio, ratio)
        weights = (crossed - together @ left @ crossed) @ pseudo_inverse(told)
        tried.append((amplitude, told, weights, float(score @ amplitude), size, prior))
    most = max([most, *(one[3] for one in tried)])
    degrees = max(float(variation.weights.sum()) - 2.0, 1.0)
    chances = np.full(len(causes), -np.inf)
    for k, (_, _, _, explained, size, prior) in enumerate(tried):
        if size:
            chances[k] = prior - 0.5 * (degrees + variation.width) * np.log1p((most - explained) / degrees)
            chances[k] -= 0.5 * size * np.log1p(explained / size)
    order = [int(k) for k in np.argsort(-chances, kind="stable")]
    best = order[0]
    near = tuple(k for k in order[1:] if chances[best] - chances[k] <= likely and tried[k][5] > IMPOSSIBLE)
    amplitude, told, weights, explained, _, _ = tried[best]
    change = alongs[best] @ amplitude
    apart = float(np.sqrt(np.median(np.einsum("ri,rij,rj->r", change, own, change))))
    return Heap(robots, best, near, amplitude, told, change, weights, explained, apart, odds)


def beside_each_other(variation: SiblingVariation, heaps: Sequence[Heap], directions: Directions) -> list[Heap]:
    """Estimate anew in what the same robots differ in several parts, which were taken off, each beside the others.

    The first that was found had taken what it could of the others: of arms in the cold, whose viscous friction was 3.3
    times and Coulomb friction 1.5 times that of the others, viscous friction was 2.9 times, and no interval held.
    """
    robots = heaps[0].robots
    alongs = [directions(robots, one.cause) for one in heaps]
    along, own = np.concatenate(alongs, axis=2), variation.mean_weights[robots]
    together, left = own.sum(axis=0), variation.mean_covariance
    total = variation.precision @ variation.mean - np.einsum("rij,rj->i", own, variation.moved[robots])
    away = variation.bases[robots] - np.linalg.solve(variation.precision - together, total)
    weighed, seen = own @ along, np.einsum("rij,rj->ri", own, away)
    crossed = weighed.sum(axis=0)
    told = np.einsum("rij,rik->jk", along, weighed) - crossed.T @ left @ crossed
    covariance = pseudo_inverse(told)
    more = covariance @ (np.einsum("rij,ri->j", along, seen) - crossed.T @ left @ seen.sum(axis=0))
    weights = (crossed - together @ left @ crossed) @ covariance
    found, column = [], 0
    for heap, directed in zip(heaps, alongs, strict=True):
        place = slice(column, column := column + directed.shape[2])
        amplitudes, information = heap.amplitudes + more[place], pseudo_inverse(covariance[place, place])
        change = heap.change + directed @ more[place]
        found.append(
            replace(
                heap,
                amplitudes=amplitudes,
                information=information,
                change=change,
                weights=weights[:, place],
                explained=float(amplitudes @ information @ amplitudes),
                apart=float(np.sqrt(np.median(np.einsum("ri,rij,rj->r", change, own, change)))),
            )
        )
    return found


def _sorted(
    variation: SiblingVariation, found: Heap, directions: Directions, causes: Sequence[Cause]
) -> tuple[Numbers, float]:
    """Sort robots into the heap by what it has in common: those that are the likelier in it (linear discriminant).

    Robots that tell less of it than their own standard deviation stay with the others. Where most of those that tell it
    are in the heap, and all are alike, the others become the heap, which has the opposite: -1, beside their numbers.
    """
    every = np.arange(variation.count)
    change = directions(every, found.cause) @ found.amplitudes
    inverses = np.linalg.inv(variation.errors + variation.spread_matrix)
    middle = variation.bases - variation.mean - 0.5 * change
    score = np.einsum("ri,rij,rj->r", change, inverses, middle)
    tells = np.einsum("ri,rij,rj->r", change, inverses, change) > 1.0
    others = max(int(np.sum(tells)) - len(found.robots), 1)
    inside = tells & (score + log(len(found.robots) / others) > 0.0)
    if causes[found.cause].kind != "gain" and 2 * np.sum(inside) > np.sum(tells):
        return np.flatnonzero(tells & ~inside), -1.0
    return np.flatnonzero(inside), 1.0
