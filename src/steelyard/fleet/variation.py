"""How much robots of one kind vary, and their mean: restricted maximum likelihood that few unusual robots do not draw.

Each robot has base parameters ``y_r = mu + b_r + e_r``: what all siblings have, what is its own, and the error of its
estimate. The error has the covariance that its own data tells, ``C_r``; what is its own has one covariance for all
siblings, ``T = sum_j tau_j² v_j v_j'`` over the directions in which assembly, temperature and castings change robots.
The variances tau_j² are those of restricted maximum likelihood (REML), found by the iteration of H. Zhou et al., MM
algorithms for variance components models, J. Comput. Graph. Stat. 28, 2019, in which the square of each standardised
deviation is bounded as in Huber's second proposal, so that robots that are out of order do not widen what counts as
usual.
"""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "EFFICIENCY",
    "LEAST",
    "UNKNOWN",
    "SiblingVariation",
    "drawn_together",
    "known_amplitudes",
    "median_of_shown",
    "pseudo_inverse",
    "scaled_errors",
    "shown_parameters",
    "unexplained",
    "usual_size",
]

Array = NDArray[np.float64]

BOUND = 1.5
"""Standardised deviations beyond which a robot no longer widens what counts as usual. So up to E[min(z², BOUND²)] over
BOUND², a third, of the robots may be far out in the same part; with 2 it would be a quarter."""

WHOLE, OUT = 0.99, 3.0
"""Robots as far from the mean as one in a hundred normal ones, or by so many standard deviations in one of the ways
in which siblings vary, count less in the mean, by the square of how far. By the distance alone, of which many base
parameters have much, three of fourteen with three times the friction of a joint drew the mean towards them, what
siblings vary by was ten times too wide, and none was named."""

ITERATIONS, SETTLED = 60, 0.02
"""The most iterations for the variances, and the relative change of the spread of every cause below which they have
settled."""

FEW, FEW_ITERATIONS = 100, 15
"""Siblings from which the variances beside one cause are found, and iterations; they need not be exact."""

SUBSET = 200
"""Siblings from which the variances are begun; all of them settle them afterwards."""

LEAST = 1e-3
"""Standard deviation that every base parameter has at least, in the same units: exact data, as of a simulation without
noise, would leave matrices that cannot be inverted."""

TRACE = 1e-6
"""Part of what a robot tells of the mean that is left along what was taken from it."""

TELLS = 1e-4
"""Part of what the robot that tells most of an amplitude tells of it (by the inverse of the variance), below which
another one tells nothing: where a joint stands still, all have one amplitude, which is no heap."""

SPREADS, WIDEST = 200, 6.0
"""Standard deviations of what siblings vary by that are tried, up to so many times what they, or noise, differ by."""

UNKNOWN = 1e4
"""Standard deviations, in units of what is usual, of parameters that a robot's data does not show."""

ASSUMED = 10.0
"""Degrees of freedom of what siblings are taken to vary by at least."""


def unexplained(inverse: Array, taken: Array) -> Array:
    """Return the inverse of a covariance, (n_b, n_b), without what changes along the columns of `taken` explain."""
    seen = inverse @ taken
    return np.asarray(inverse - seen @ pseudo_inverse(taken.T @ seen) @ seen.T)


def pseudo_inverse(gram: Array) -> Array:
    """Return the inverse of a matrix of scalar products, of which some directions may have none."""
    return np.asarray(np.linalg.pinv(gram, rcond=1e-9, hermitian=True))


def shown_parameters(bases: Array, errors: Array) -> NDArray[np.bool_]:
    """Tell which base parameters the data of each robot shows, (R, n_b).

    The noise of a joint that stands still moves it a little, so that the data tells some number, by 10⁵ times as
    uncertain as that of siblings whose joint moves, and of any size.
    """
    deviations = np.sqrt(np.diagonal(errors, axis1=1, axis2=2))
    # The robot that shows a parameter best tells its size, also where the others, and their median, show nothing.
    size = np.min(np.hypot(bases, deviations), axis=0)
    shown = np.isfinite(deviations) & (deviations <= UNKNOWN * size)
    return np.asarray(shown & (deviations <= UNKNOWN * usual_size(bases, errors, shown)))


def median_of_shown(values: ArrayLike, shown: NDArray[np.bool_]) -> Array:
    """Return the medians of columns over the rows that are shown; zero where none is.

    Examples
    --------
    >>> median_of_shown([[1.0, 5.0], [2.0, 0.0], [9.0, 0.0]], np.array([[True, False], [True, False], [False, False]]))
    array([1.5, 0. ])
    """
    some = shown.any(axis=0)
    kept = np.where(shown | ~some, values, np.nan)
    return np.where(some, np.nanmedian(kept, axis=0), 0.0)


def _deviation_of_shown(bases: Array, shown: NDArray[np.bool_]) -> Array:
    """How far base parameters are from their median as a rule, (n_b,): the standard deviation of normal ones."""
    return 1.4826 * median_of_shown(np.abs(bases - median_of_shown(bases, shown)), shown)


def usual_size(bases: Array, errors: Array, shown: NDArray[np.bool_]) -> Array:
    """Return how far base parameters are from each other as a rule, (n_b,), so that matrices are well conditioned."""
    middle, away = median_of_shown(bases, shown), _deviation_of_shown(bases, shown)
    own = np.sqrt(median_of_shown(np.diagonal(errors, axis1=1, axis2=2), shown))
    largest = np.abs(middle).max(initial=1.0)
    size = np.maximum(np.hypot(away, own), 1e-9 * largest)
    # What none shows is unknown by `UNKNOWN` of these: in the smallest unit, it was known to be as it was in all.
    return np.asarray(np.where(shown.any(axis=0), size, largest))


def known_amplitudes(amplitudes: Array, told: Array) -> Array:
    """Return amplitudes, NaN of robots that tell nearly nothing of them; `told` are inverse variances, (R,) both."""
    return np.where(told > TELLS * np.nanmax(told, initial=0.0), amplitudes, np.nan)


def drawn_together(values: Array, errors: Array) -> tuple[Array, Array]:
    """Return what robots have beyond what all siblings would have on average, and how uncertain that is, (R,) each.

    Estimates with these errors are drawn towards their mean by as much as noise makes likely. By how much siblings vary
    is not known from few of them, and where one number stood for it intervals held the truth in 55 to 88 % of fleets of
    four to eight, in 70 % of thirty where noise is three times as large. So all standard deviations are taken to be
    equally likely before the data is seen, as are all means (D. Rubin, Estimation in parallel randomized experiments,
    J. Educ. Stat. 6, 1981; A. Gelman, Prior distributions for variance parameters in hierarchical models, Bayesian
    Anal. 1, 2006). Of fewer than three none is drawn.

    Examples
    --------
    >>> schools = np.array([28.0, 8.0, -3.0, 7.0, -1.0, 1.0, 18.0, 12.0])
    >>> value, error = drawn_together(schools, np.array([15.0, 10.0, 16.0, 11.0, 9.0, 11.0, 10.0, 18.0]))
    >>> (value + 7.9).round(0).tolist()
    [11.0, 8.0, 6.0, 8.0, 5.0, 6.0, 11.0, 8.0]
    """
    if len(values) < 3:
        return values, errors
    own = np.maximum(errors, 1e-12 * max(float(np.abs(values).max()), 1e-300)) ** 2
    # Noise that is known for a robot or two beyond all others says nothing of the size of what they vary by.
    widest = WIDEST * max(float(np.std(values)), float(np.sqrt(np.median(own))))
    spreads = widest * (np.arange(SPREADS) + 0.5) / SPREADS
    precision = 1.0 / (own + spreads[:, None] ** 2)  # (SPREADS, R)
    total = precision.sum(axis=1)
    mean = precision @ values / total
    away = values - mean[:, None]
    likely = 0.5 * (np.log(precision).sum(axis=1) - np.log(total) - np.sum(precision * away**2, axis=1))
    chance = np.exp(likely - likely.max())
    chance /= chance.sum()
    kept = spreads[:, None] ** 2 * precision
    middle = kept * away
    variance = kept * own + kept**2 / total[:, None]
    found = chance @ middle
    return found, np.sqrt(chance @ (variance + (middle - found) ** 2))


def scaled_errors(errors: Array, scale: Array) -> Array:
    """Return covariances in units of `scale`, where what the data does not show has a large one instead of none."""
    found = errors / np.outer(scale, scale)
    return np.where(np.isfinite(found), found, UNKNOWN**2) + LEAST**2 * np.eye(len(scale))


class SiblingVariation:
    """Base parameters of siblings, their errors, and how siblings vary; all in units of `usual_size`.

    Parameters
    ----------
    bases : (R, n_b)
    errors : (R, n_b, n_b)
        Their covariances.
    shown : (R, n_b)
        What the data of each robot shows.
    freedoms : (R,)
        Degrees of freedom of the covariances.
    directions : (n_b, c)
        In which siblings vary.
    least : (n_b, k), optional
        In which siblings are taken to vary by a standard deviation of one at least; beyond that the data says by how
        much they vary. None by default.
    """

    def __init__(
        self,
        bases: Array,
        errors: Array,
        shown: NDArray[np.bool_],
        freedoms: Array,
        directions: Array,
        least: Array | None = None,
    ) -> None:
        self.bases, self.errors, self.shown, self.freedoms = bases, errors, shown, freedoms
        lengths = np.linalg.norm(directions, axis=0)
        self.directions = directions / np.where(lengths > 0.0, lengths, 1.0)
        self.count, self.width = bases.shape
        self.least = np.zeros((self.width, 0)) if least is None else least
        self.assumed = self.least @ self.least.T
        self.begin(bases)
        self.weights = np.ones(self.count)
        self.mean_covariance = np.eye(self.width)
        self.precision = np.eye(self.width)
        self.each = False
        self.taken: dict[int, Array] = {}
        self.information: Array | None = None

    def copied(self) -> SiblingVariation:
        """Return another one, which may be settled by itself."""
        other = copy(self)
        other.weights = self.weights.copy()
        return other

    def without_least(self) -> SiblingVariation:
        """Return another one, settled in the same way, which takes nothing for known of how much siblings vary."""
        other = self.copied()
        other.least, other.assumed = self.least[:, :0], np.zeros((self.width, self.width))
        other.begin(self.moved)
        other.settle(self.moved, self.taken)
        return other

    def begin(self, moved: Array) -> None:
        """Guess how siblings vary, and their mean, from bases from which unusual parts were taken away."""
        noise = median_of_shown(np.diagonal(self.errors, axis1=1, axis2=2), self.shown)
        away = _deviation_of_shown(moved, self.shown) ** 2
        usual = np.maximum(away - noise, 0.05 * away + 1e-6)
        self.variances = (self.directions**2).T @ usual / max(1, self.directions.shape[1] // self.width)
        self._spread()
        self.mean = median_of_shown(moved, self.shown)

    def _spread(self) -> None:
        """Put the covariance of the siblings, T (n_b, n_b), together."""
        self.spread_matrix = self.assumed + (self.directions * self.variances) @ self.directions.T

    def settle_each(self) -> None:
        """Find the variances anew, from robots that count less in the mean where they are far out in one direction.

        Not while batches are looked for: a batch of a fifth would count little, and all of what its motions make of a
        gain would be that of the others.
        """
        self.each = True
        self.begin(self.bases)
        self.settle(self.bases, {})

    def settle(self, moved: Array, taken: dict[int, Array]) -> None:
        """Find the variances, the mean and the weights from bases from which unusual parts were taken away.

        Along what was taken from a robot it tells nothing of its siblings. Counted as one of them all the same, which
        are then alike there, it made four robots vary by a third less, and two beside a third by half.
        """
        self.moved, self.taken, self.information = moved, taken, None
        if self.count > 2 * SUBSET:
            self._iterate(np.linspace(0, self.count - 1, SUBSET).round().astype(int))
        self._iterate(np.arange(self.count))
        self._means(np.arange(self.count))

    def amplitudes_of(self, own: Array) -> Array:
        """Amplitudes of a cause with a direction of its own in each robot, (R, n_b), whatever siblings vary by in it.

        Where many robots have it, what siblings vary by in all of these directions counts as theirs: of 20 fleets, in
        which 35 robots of 100 had a torque of 1.1 times the scale, batches were told in two. So the variances are those
        of what is left when each robot tells nothing along its own direction. Up to a constant, since no mean is known
        along it.
        """
        chosen = np.unique(np.linspace(0, self.count - 1, min(self.count, FEW)).round().astype(int))
        beside = self.copied()
        beside.taken = {int(robot): own[robot][:, None] for robot in chosen}
        beside._iterate(chosen, FEW_ITERATIONS)
        inverses = np.linalg.inv(self.errors + beside.spread_matrix)
        weights = np.einsum("rij,rj->ri", inverses, own)
        told = np.einsum("ri,ri->r", weights, own)
        found = np.einsum("ri,ri->r", weights, self.bases - beside.mean) / np.maximum(told, 1e-300)
        return known_amplitudes(found, told)

    def _means(self, chosen: NDArray[np.intp]) -> tuple[Array, Array, Array]:
        """Find the mean of some siblings.

        Returns
        -------
        shown : (R, n_b, c)
            The inverses of their covariances times the directions in which siblings vary.
        told : (R, c)
            What each tells of an amplitude in each of these.
        away : (R, n_b)
            Their deviations from the mean.
        """
        from scipy.special import chdtri

        inverses = np.linalg.inv(self.errors[chosen] + self.spread_matrix)
        inverses = 0.5 * (inverses + inverses.transpose(0, 2, 1))
        for place in np.nonzero(np.isin(chosen, list(self.taken)))[0]:
            without = unexplained(inverses[place], self.taken[int(chosen[place])])
            # A trace is left, so that there is a mean where something was taken from each robot.
            inverses[place] = (1.0 - TRACE) * 0.5 * (without + without.T) + TRACE * inverses[place]
        bases = self.moved[chosen]
        shown = inverses @ self.directions
        told = np.sum(self.directions * shown, axis=1)
        least = np.maximum(told, 1e-300)
        usual = float(chdtri(self.width, 1.0 - WHOLE))
        for _ in range(2):  # the first mean is the median, so that no robot draws it before its weight is known
            away = bases - self.mean
            distance = np.einsum("ri,rij,rj->r", away, inverses, away) / usual
            if self.each:
                furthest = np.max((away[:, None, :] @ shown)[:, 0, :] ** 2 / least, axis=1, initial=0.0)
                distance = np.maximum(distance, furthest / OUT**2)
            weights = 1.0 / np.maximum(1.0, distance)
            weighted = weights[:, None, None] * inverses
            precision = weighted.sum(axis=0)
            self.mean_covariance = np.linalg.inv(precision)
            self.mean = self.mean_covariance @ np.einsum("rij,rj->i", weighted, bases)
        away = bases - self.mean
        self.weights[chosen] = weights
        if len(chosen) == self.count:
            self.precision, self.mean_weights = precision, weighted
        return shown, told, away

    def _iterate(self, chosen: NDArray[np.intp], most: int = ITERATIONS) -> None:
        for _ in range(most):
            shown, told, away = self._means(chosen)
            lost = np.sum((np.linalg.cholesky(self.mean_covariance).T @ shown) ** 2, axis=1)
            usual = np.maximum(told - lost, 1e-3 * told)  # REML: the mean has taken some of it
            squares = (away[:, None, :] @ shown)[:, 0, :] ** 2
            bounded = np.minimum(squares, BOUND**2 * usual) / EXPECTED
            before = np.sqrt(np.maximum(np.diagonal(self.spread_matrix), 1e-300))
            ratio = bounded.sum(axis=0) / np.maximum(usual.sum(axis=0), 1e-300)
            self.variances = self.variances * np.sqrt(ratio)
            self._spread()
            after = np.sqrt(np.maximum(np.diagonal(self.spread_matrix), 1e-300))
            if np.max(np.abs(after - before) / np.maximum(before, 0.02)) < SETTLED:
                break

    def freedom_of_interval(self, robot: int, weights: Array, error: float, tails: float = 0.0) -> float:
        """Degrees of freedom of the variance of a combination of base parameters, of which an interval is told.

        By Satterthwaite's rule from how well the variances are known of which siblings vary, by their Fisher
        information (D. Giesbrecht and J. Burns, Two-stage analysis based on a mixed model, Biometrics 41, 1985). A
        variance for each parameter is known worse than the one of a single parameter would be: of twenty arms, that
        of the mass of a link as by nine siblings. Tests, of which only the least probability counts, take the number of
        siblings (see `siblings`), with which sound fleets have about as few false alarms as is asked for.
        """
        if self.information is None:
            chosen = np.unique(np.linspace(0, self.count - 1, min(self.count, SUBSET)).round().astype(int))
            shown, _, _ = self._means(np.arange(self.count))
            between = np.swapaxes(self.directions[None], 1, 2) @ shown[chosen]
            # The mean takes what one sibling tells.
            self.information = 0.5 * (between**2).sum(axis=0) * (self.count - 1.0) / len(chosen)
        squares = (weights @ self.directions) ** 2
        among = float(squares @ self.variances)
        known = np.linalg.pinv(self.information, rcond=1e-8, hermitian=True)
        of_siblings = EFFICIENCY * 2.0 * among**2 / max(float(squares @ known @ squares), 1e-300)
        noise = float(weights @ self.errors[robot] @ weights)
        assumed = float(weights @ self.assumed @ weights)
        among = max(error**2 - noise - assumed, 0.0)  # more than of siblings, where what varies has grown
        spread = noise**2 / self.freedoms[robot] + among**2 * (1.0 / max(of_siblings, 1.0) + tails)
        spread += assumed**2 / ASSUMED
        return float((noise + assumed + among) ** 2 / max(spread, 1e-300))


def _of_bounded(bound: float) -> tuple[float, float]:
    """Return the expected square of a normal deviate that is bounded, and how much such squares tell of its variance.

    The latter is the variance that the logarithm of the variance of normal deviates has by all their squares, 2, over
    that which it has by bounded ones.
    """
    from math import erf, exp, pi, sqrt

    within = erf(bound / sqrt(2.0))
    tail = 2.0 * exp(-0.5 * bound**2) / sqrt(2.0 * pi)
    second = within - bound * tail
    fourth = 3.0 * within - (bound**3 + 3.0 * bound) * tail
    expected = second + bound**2 * (1.0 - within)
    variance = fourth + bound**4 * (1.0 - within) - expected**2
    return expected, 2.0 * second**2 / variance


EXPECTED, EFFICIENCY = _of_bounded(BOUND)
