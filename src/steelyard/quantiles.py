"""Quantiles of the normal distribution and of Student's.

SciPy has them in `scipy.special`, and to import that takes 60 ms, a twentieth of a first identification.
"""

import math
from functools import lru_cache
from statistics import NormalDist

__all__ = ["normal_quantile", "student_quantile"]

LARGE = 30.0
"""Of ν / 2, from which on a series tells the quotient of gamma functions that two logarithms would tell less well."""

MANY, MODERATE = 1000.0, 5.0
"""Degrees of freedom and normal quantile up to which what the series leaves out is 1e-12 of t."""

FEW = 5.0
"""Degrees of freedom up to which the series may be far off."""


def normal_quantile(probability: float) -> float:
    """Return what a standard normal number is below with a probability between 0 and 1.

    Examples
    --------
    >>> round(normal_quantile(0.975), 6)
    1.959964
    """
    return NormalDist().inv_cdf(probability)


@lru_cache(maxsize=4096)
def student_quantile(probability: float, degrees: float) -> float:
    """Return what a number with Student's distribution is below with a probability between 0 and 1.

    Of many degrees of freedom a series in their inverse suffices. Otherwise Newton's method begins there: the logarithm
    of the tail falls ever more steeply with the logarithm of t, so that from its second step on it comes from one side.

    Parameters
    ----------
    probability : float
    degrees : float
        Degrees of freedom ν, not necessarily whole, perhaps infinite.

    Examples
    --------
    >>> round(student_quantile(0.975, 3.0), 6), round(student_quantile(0.025, math.inf), 6)
    (3.182446, -1.959964)
    """
    if not math.isfinite(degrees):
        return normal_quantile(probability)
    if probability == 0.5:
        return 0.0
    if probability > 0.5:
        return -student_quantile(1.0 - probability, degrees)
    z = -normal_quantile(probability)
    t = _by_series(z, degrees)
    if degrees >= MANY and z <= MODERATE:
        return -t
    wanted, place = math.log(probability), math.log(t if degrees > FEW else z)
    step = math.inf
    while abs(step) > 1e-8:  # what is then left is the square of it
        t = math.exp(place)
        tail, density = _tail_and_density(t, degrees)
        step = (math.log(tail) - wanted) * tail / (t * density)
        place += step
    return -math.exp(place)


def _by_series(z: float, degrees: float) -> float:
    """Return Student's quantile for the normal one (Abramowitz and Stegun 26.7.5)."""
    square = z * z
    terms = (
        (square + 1.0) / 4.0,
        ((5.0 * square + 16.0) * square + 3.0) / 96.0,
        (((3.0 * square + 19.0) * square + 17.0) * square - 15.0) / 384.0,
        ((((79.0 * square + 776.0) * square + 1482.0) * square - 1920.0) * square - 945.0) / 92160.0,
    )
    return z * (1.0 + sum(term / degrees**power for power, term in enumerate(terms, start=1)))


def _tail_and_density(t: float, degrees: float) -> tuple[float, float]:
    """Return the probability to be above t > 0, and the density there."""
    a, share = 0.5 * degrees, t * t / degrees
    logarithm = a * math.log1p(share)
    density = math.exp(_gamma_quotient(a) - logarithm - 0.5 * math.log1p(share)) / math.sqrt(degrees * math.pi)
    x = 1.0 / (1.0 + share)
    # Of the two forms of the incomplete beta function, the continued fraction of one converges soon.
    if x < (a + 1.0) / (a + 2.5):
        return t * density / degrees * _fraction(a, 0.5, x), density
    return 0.5 - t * density * _fraction(0.5, a, share * x), density


def _gamma_quotient(a: float) -> float:
    """Return the logarithm of Γ(a + 1/2) / Γ(a)."""
    if a < LARGE:
        return math.lgamma(a + 0.5) - math.lgamma(a)
    return 0.5 * math.log(a) - 1.0 / (8.0 * a) + 1.0 / (192.0 * a**3) - 1.0 / (640.0 * a**5)


def _fraction(a: float, b: float, x: float) -> float:
    """Return the continued fraction of the incomplete beta function, by Lentz's method (DLMF 8.17.22)."""
    c, d = 1.0, 1.0 / (1.0 - (a + b) * x / (a + 1.0))
    found = d
    for m in range(1, 10000):
        even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1.0))
        change = 1.0
        for term in (even, odd):
            d, c = 1.0 / (1.0 + term * d), 1.0 + term / c
            change *= c * d
        found *= change
        if abs(change - 1.0) < 1e-16:
            break
    return found
