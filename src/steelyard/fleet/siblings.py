"""Siblings beside each other: how much robots of one kind vary, and which of them vary by more, in what part.

A robot is held against the mean of the others, by generalised least squares with the covariance of its own error and
that by which siblings vary (see `variation`), which uses all correlations of its parameters; the amplitude of each
cause has a standard error, and Student's distribution, whose degrees of freedom count the siblings. Before, robots of
two batches are told apart (see `batches`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.regression.factor import eigenvectors

from .batches import Heap, beside_each_other, common_part, find_heap
from .causes import IMPOSSIBLE, TURNABLE, Cause
from .tails import tails_of
from .variation import (
    ASSUMED,
    EFFICIENCY,
    LEAST,
    UNKNOWN,
    SiblingVariation,
    drawn_together,
    known_amplitudes,
    median_of_shown,
    pseudo_inverse,
    scaled_errors,
    shown_parameters,
    unexplained,
    usual_size,
)

__all__ = [
    "Batch",
    "Deviation",
    "SiblingComparison",
    "compare_siblings",
    "deviations_of",
    "false_discoveries",
]

Array = NDArray[np.float64]

FEWEST = 3
"""Siblings, without which nothing can be said: of two that differ, nobody knows which is unusual."""

NOISE_FREEDOM = 30.0
"""Degrees of freedom that the covariance of one estimate has at most, as where two results are compared: tens of
batches. Short logs have fewer: with 30 for all, one robot whose log had 140 rows was named in two of six sound fleets
of ten."""

MOST_BATCHES = 4
"""Batches that are told, each with as many parts as it differs in."""

SURELY_ALSO = 0.001
"""Probability by which a batch may have a further part told, of all causes together. Of 200 fleets of 12 and 20 robots
whose batch has one part none has another one told; with a hundredth, three."""

ROUNDS = 3
"""Times that the variances are found anew without what was found to be unusual."""

MOST_CAUSES = 4
"""The most causes of one robot; what differs in more parts is another robot."""

MOST_VARIED = 20.0
"""The largest multiple by which a robot is taken to vary by more than its siblings."""

FEW_SIBLINGS = 10
"""Siblings below which those of one part are too few to tell how much it varies: it is taken to vary by as much as most
parts of its kind at least. A robot is named where chance made the others look alike, so that intervals of gearboxes
held the truth in 6 of 10 fleets of four."""

LEAST_VARIED = {"friction": 0.05, "mass": 0.01, "gain": 0.01}
"""Standard deviations, as parts of what siblings have, by which fewer than `FEW_SIBLINGS` are taken to vary at least:
all of a drive by what a change of temperature makes of friction, links and scales of torques by what is made to one
drawing. Of three arms two are alike in all parts now and then, as where their joints were as warm. *Measured*, arms in
MuJoCo, each with its own programme: with what they varied by alone, robots were named in 9 of 20 sound fleets of three
and 3 of 20 of five; with this in none, and more faults are named. Twelve arms tell their own variation: with this, 4 of
20 sound fleets had a false alarm, without it none."""

LEAST_HELD = 0.1
"""Part of what siblings have that a robot is taken to have had at least: of nearly nothing, no multiple is known."""

HIDDEN = 0.02
"""Part of what a cause shows beside those that are found already, below which it cannot be told from them."""

LIKELY = 3.8
"""By how much the logarithm of the likelihood of another cause may be below that of the best, to be told beside it:
half the square of the 0.995 quantile of Student's distribution for `NOISE_FREEDOM`. Beyond that, the best is needed."""


@dataclass(frozen=True, eq=False)
class Deviation:
    """A robot that differs, in one part.

    Attributes
    ----------
    robot : int
        Its number among the siblings.
    cause : Cause
    amplitude, standard_error : float
        In units of `cause.nominal`; NaN for a link as a whole. The error is that of its own data and of the mean of its
        siblings, and what siblings vary by.
    lower, upper : float
        Of 95 %.
    deviations : float
        How far out it is, in standard deviations of what siblings and noise make likely.
    probability : float
        Of one sibling being so far out by chance in this part.
    alternatives : tuple of Cause
        Other causes that explain it about as well, the likeliest first.
    weights : ndarray or None
        (n_b,): the amplitude is their product with the deviation of the base parameters from those of the siblings; of
        a link as a whole, the product is one, and a part of it where it differed in the same way by less.
    """

    robot: int
    cause: Cause
    amplitude: float
    standard_error: float
    lower: float
    upper: float
    deviations: float
    probability: float
    alternatives: tuple[Cause, ...] = ()
    weights: Array | None = field(default=None, repr=False)


@dataclass(frozen=True, eq=False)
class Batch:
    """Robots that all differ from the others in the same way, as after a change of a supplier.

    Attributes
    ----------
    robots : tuple of int
        Their numbers, in ascending order: the smaller of two heaps, or the one whose torque reads wrong.
    deviation : Deviation
        Of what they have in common, from the mean of the others; its `robot` is the first of them.
    apart : float
        How far the two heaps lie apart, in standard deviations of one robot.
    odds : float
        Logarithm of how much likelier two heaps are than one heap with any tails and any skew.
    """

    robots: tuple[int, ...]
    deviation: Deviation
    apart: float
    odds: float


@dataclass(frozen=True, eq=False)
class SiblingComparison:
    """A comparison of robots of one kind: the values that they have in common, and where single ones differ.

    Attributes
    ----------
    causes : tuple of Cause
    mean : ndarray
        (n_b,) of the siblings.
    mean_covariance : ndarray
        (n_b, n_b) of its error.
    amplitude, error : ndarray
        (R, len(causes)) of each robot against the mean of the others, each cause by itself, and the standard deviation
        that noise and what siblings vary by give it; NaN for links as a whole.
    common : ndarray
        (R, len(causes)): the part of the amplitude that robots of a batch have in common; zero for the others.
    among : ndarray
        (R, len(causes)) the part of that standard deviation by which siblings vary.
    noise : ndarray
        (R, len(causes)) the part of it that the robot's own noise makes.
    tails : ndarray
        (len(causes),): how heavy the tails are of what siblings vary by, as reciprocals of the degrees of freedom of
        Student's distribution; zero where it is normal.
    freedom : ndarray
        (R, len(causes)): degrees of freedom of Student's distribution by which being as far out is held against chance.
    probability : ndarray
        (R, len(causes)) of being as far out by chance.
    robot_probability : ndarray
        (R,) of any cause being so, for one robot.
    deviations : tuple of Deviation
        Of robots that differ, the surest first.
    hidden : ndarray
        (len(causes),): of which causes too few robots show anything for any to be compared in them.
    threshold : float
        Probability of a cause of a robot below which it is named.
    batches : tuple of Batch
        What many robots have in common, which is taken off before each of them is held against the others. A robot may
        belong to several. The mean is that of robots of none.
    """

    causes: tuple[Cause, ...]
    mean: Array = field(repr=False)
    mean_covariance: Array = field(repr=False)
    amplitude: Array = field(repr=False)
    error: Array = field(repr=False)
    among: Array = field(repr=False)
    noise: Array = field(repr=False)
    common: Array = field(repr=False)
    tails: Array = field(repr=False)
    freedom: Array = field(repr=False)
    probability: Array = field(repr=False)
    robot_probability: Array = field(repr=False)
    deviations: tuple[Deviation, ...] = field(repr=False)
    hidden: NDArray[np.bool_] = field(repr=False)
    threshold: float = 0.0
    batches: tuple[Batch, ...] = field(default=(), repr=False)

    @property
    def spread(self) -> Array:
        """(len(causes),): standard deviation of each amplitude among siblings, NaN for links as a whole."""
        return np.asarray(np.median(self.among, axis=0))

    @property
    def shrunk(self) -> tuple[Array, Array]:
        """Amplitudes of least expected error, where siblings are all that is known beforehand, and their errors.

        (R, len(causes)) each: what noise alone may have made is taken away, the more the less a robot's data tells,
        see `drawn_together`. What a batch has in common is known of many, and stays. Nor is a robot that differs one
        of its siblings, so that these tell nothing of it: its own data alone does.
        """
        value, error = self.amplitude.copy(), np.sqrt(np.maximum(self.error**2 - self.among**2, 0.0))
        usual = np.ones(len(value), dtype=bool)
        usual[list(self.differs)] = False
        for k in np.flatnonzero(np.isfinite(self.amplitude).any(axis=0)):
            chosen = usual & np.isfinite(self.amplitude[:, k])
            common = self.common[chosen, k]
            # A robot is 1 + 1 / (R - 1) times as far from the mean of the others as from that of all.
            from_all = (self.amplitude[chosen, k] - common) * (1.0 - 1.0 / max(len(common), 2))
            drawn, error[chosen, k] = drawn_together(from_all, self.noise[chosen, k])
            value[chosen, k] = drawn + common
        return value, error

    @property
    def differs(self) -> tuple[int, ...]:
        """Numbers of the robots that differ, in ascending order."""
        return tuple(sorted({one.robot for one in self.deviations}))

    @property
    def least_named(self) -> Array:
        """(len(causes),): the amplitude of each cause that half of the robots that have it would be named for."""
        from scipy.special import stdtrit

        freedom = np.median(self.freedom, axis=0)
        return np.asarray(-stdtrit(freedom, 0.5 * max(self.threshold, 1e-300)) * np.median(self.error, axis=0))


def deviations_of(probability: float) -> float:
    """Return beyond how many standard deviations, to either side, a normal deviate is with a probability.

    Examples
    --------
    >>> round(deviations_of(0.05), 2)
    1.96
    """
    from scipy.special import ndtri

    return float(-ndtri(0.5 * max(probability, 1e-300)))


def false_discoveries(probabilities: ArrayLike, rate: float) -> NDArray[np.bool_]:
    """Tell which of many hypotheses are rejected, so that at most this part of the rejected ones is true as a rule.

    The least probability is held against the rate over their number, the next against twice that, and so on, up to the
    last one that is below (Y. Benjamini and Y. Hochberg, Controlling the false discovery rate, 1995).

    Examples
    --------
    >>> false_discoveries([0.01, 0.04, 0.03, 0.5], 0.05).tolist()
    [True, False, False, False]
    >>> false_discoveries([0.01, 0.02, 0.03, 0.5], 0.05).tolist()
    [True, True, True, False]
    """
    given = np.asarray(probabilities, dtype=float)
    order = np.argsort(given, kind="stable")
    kept = np.nonzero(given[order] <= rate * np.arange(1, len(given) + 1) / max(len(given), 1))[0]
    rejected = np.zeros(len(given), dtype=bool)
    if kept.size:
        rejected[order[: kept[-1] + 1]] = True
    return rejected


@in_one_thread
def compare_siblings(
    bases: ArrayLike,
    covariances: ArrayLike,
    causes: Sequence[Cause],
    directions: ArrayLike,
    *,
    rate: float = 0.05,
    confidence: float = 0.95,
    freedoms: ArrayLike | None = None,
    own: Mapping[int, ArrayLike] | None = None,
    before: ArrayLike | None = None,
    own_before: Mapping[int, ArrayLike] | None = None,
) -> SiblingComparison:
    """Tell which robots differ from their siblings, in which part, and by how much.

    Parameters
    ----------
    bases : (R, n_b)
        Base parameters of each robot by its data alone.
    covariances : (R, n_b, n_b)
        Of their errors; infinite on the diagonal, and zero beside it, where the data shows nothing.
    causes : sequence of Cause
    directions : (n_b, c)
        In which siblings vary, see `variations`.
    rate : float
        At most this part of the robots that are named differ by chance (Benjamini and Hochberg over the robots; the
        causes of one robot by Bonferroni).
    confidence : float
        Of intervals.
    freedoms : (R,), optional
        Degrees of freedom of each covariance: how much data its size was estimated from. 30 by default, and at most.
    own : mapping, optional
        By the number of a cause with one amplitude, what takes the place of its `directions` in each robot, (R, n_b);
        see `gains_in_own_motion`. It is a part of what the robot itself has, so a change of it by a is one of
        a / (1 - a) of what siblings have, and told so. NaN where the `directions` of the cause hold.
    before : (R, n_b), optional
        What the base parameters were, where `bases` are changes of them.
    own_before : mapping, optional
        As `own`, of what the robot itself had before, of which a change by a is one of a. NaN where `own` holds.

    Returns
    -------
    SiblingComparison

    Raises
    ------
    InputError
        If there are fewer than three robots.

    Examples
    --------
    Twenty pendulums, one of them with half as much friction again:

    >>> import numpy as np, steelyard as sy
    >>> from steelyard.fleet.causes import possible_causes, variations
    >>> robot = sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)).with_terms(sy.Viscous(), sy.Coulomb())
    >>> model = sy.Model(robot)
    >>> usual = np.array([0, 0, 0, 0, 0, 0.3, 0.5, 0, 0, 1, 0.1, 2])
    >>> causes = possible_causes(model, usual)
    >>> random = np.random.default_rng(2)
    >>> base = model.base_parameters().K @ usual
    >>> bases = base * (1 + 0.02 * random.normal(size=(20, len(base))))
    >>> bases[7, -2:] *= 1.5
    >>> covariances = np.broadcast_to(np.diag((0.01 * base) ** 2 + 1e-8), (20, len(base), len(base)))
    >>> found = compare_siblings(bases, covariances, causes, variations(model, causes))
    >>> [(one.robot, one.cause.name, round(one.amplitude, 1)) for one in found.deviations]
    [(7, 'friction of joint1', 0.5)]
    """
    given, errors = np.asarray(bases, dtype=float), np.asarray(covariances, dtype=float)
    if len(given) < FEWEST:
        raise InputError(
            f"Robots are compared with {FEWEST} siblings or more, got {len(given)}; add robots to the group."
        )
    shown = shown_parameters(given, errors)
    # What a robot's data does not show has any value there, which must not count, however many robots have the same.
    given = np.where(shown, given, median_of_shown(given, shown))
    errors = np.where(shown[:, :, None] & shown[:, None, :], errors, np.where(np.eye(given.shape[1]), np.inf, 0.0))
    scale = usual_size(given, errors, shown)
    degrees = np.full(len(given), NOISE_FREEDOM)
    if freedoms is not None:
        degrees = np.minimum(degrees, np.asarray(freedoms, dtype=float))
    noise, varied = scaled_errors(errors, scale), np.asarray(directions, dtype=float) / scale[:, None]
    scaled = [cause.directions / scale[:, None] for cause in causes]
    least = least_variations(causes, scaled) if len(given) < FEW_SIBLINGS else None
    problem = SiblingVariation(given / scale, noise, shown, degrees, varied, least)
    each = {k: np.asarray(one, dtype=float) / scale for k, one in (own or {}).items()}
    of_robot = {k: np.asarray(np.isfinite(one).all(axis=1)) for k, one in each.items()}
    each = {k: np.where(of_robot[k][:, None], one, scaled[k][:, 0]) for k, one in each.items()}
    for k, given_before in (own_before or {}).items():
        first = np.asarray(given_before, dtype=float) / scale
        told = np.asarray(np.isfinite(first).all(axis=1))
        each[k], of_robot[k] = np.where(told[:, None], first, each[k]), of_robot[k] & ~told
    was = None
    if before is not None:
        earlier = np.asarray(before, dtype=float)
        was = np.where(shown, earlier - median_of_shown(earlier, shown), 0.0) / scale
    tests = _Tests(problem, causes, scaled, each, of_robot, scale, rate, was)
    heaps: dict[tuple[int, ...], list[tuple[Heap, SiblingVariation]]] = {}
    if before is None:  # what has changed is told robot by robot, and as the change of all
        problem.settle(problem.bases, {})
        tests.measure()
    while before is None and len(heaps) < MOST_BATCHES and (split := tests.heap()) is not None:
        parts = heaps.setdefault(tuple(map(int, split[0].robots)), [])
        if any(one.cause == split[0].cause for one, _ in parts):  # which taking it off does not change
            break
        part: tuple[Heap, SiblingVariation] | None = split
        while part is not None:
            parts.append(part)
            tests.take_off(*part)
            part = tests.more_in_common(parts)
    batches = [
        Batch(robots, _in_common(heap, within, tests, confidence), heap.apart, heap.odds)
        for robots, parts in heaps.items()
        for heap, within in tests.beside_each_other(parts)
    ]
    problem.settle_each()
    tests.measure()
    moved = problem.bases
    found: list[_Found] = []
    for number in range(ROUNDS):
        if number:
            own_parts: dict[int, list[Array]] = {}
            for one in found:
                own_parts.setdefault(one.robot, []).append(tests.direction(one.robot, one.cause))
            problem.settle(moved, {robot: np.column_stack(parts) for robot, parts in own_parts.items()})
            tests.measure()
        again = tests.named()
        same = [(one.robot, one.cause) for one in again] == [(one.robot, one.cause) for one in found]
        found = again
        if same:
            break
        moved = problem.bases.copy()
        for one in found:  # the part that is unusual does not say how much siblings vary
            moved[one.robot] -= one.change
    deviations = [
        _of_siblings(_deviation(one, tests, confidence), of_robot.get(one.cause))
        for one in sorted(found, key=lambda one: (one.probability, one.robot))
    ]
    # How uncertain a mean is, robots show by how they differ; no part of that is taken to be known.
    alone = problem if least is None else problem.without_least()
    return SiblingComparison(
        tuple(causes),
        scale * alone.mean,
        np.outer(scale, scale) * alone.mean_covariance,
        tests.amplitude + tests.common,
        tests.error,
        tests.among,
        tests.noise,
        tests.common,
        tests.tails,
        tests.degrees,
        tests.probability,
        tests.robot_probability,
        tuple(deviations),
        np.array([not np.any(one.directions[shown.sum(axis=0) >= FEWEST]) for one in causes], dtype=bool),
        tests.threshold,
        tuple(batches),
    )


def held_before(weights: Array, was: Array, mean: Array) -> float:
    """Return how many times what siblings have now a robot had of a cause; a tenth where it had less.

    Parameters
    ----------
    weights : (n_b,)
        Of the amplitude of the cause.
    was : (n_b,)
        What the robot had more than its siblings.
    mean : (n_b,)
        What changed in the siblings.
    """
    return max(1.0 + float(weights @ (was - mean)), LEAST_HELD)


def least_variations(causes: Sequence[Cause], directions: Sequence[Array]) -> Array:
    """Return how few siblings are taken to vary at least: each part that has a number by itself, (n_b, k).

    `directions` are those of the causes, (n_b, ...) each.
    """
    single = [k for k, one in enumerate(directions) if one.shape[1] == 1]
    return np.column_stack([least_varied(causes[k], causes) * directions[k] for k in single])


def least_varied(cause: Cause, causes: Sequence[Cause]) -> float:
    """Return by how much few siblings are taken to vary in a part at least, in units of its `nominal`.

    Examples
    --------
    >>> friction = Cause("Fcj3", "term", "elbow", "Coulomb friction", "N·m", 5.0, np.ones((1, 1)))
    >>> offset = Cause("Foj3", "term", "elbow", "torque offset", "N·m", 1.0, np.ones((1, 1)))
    >>> least_varied(friction, [friction]), least_varied(offset, [friction, offset])
    (0.05, 0.25)
    """
    if cause.kind == "term" and cause.has_ratio:
        return LEAST_VARIED["friction"]
    if cause.what == "torque offset":  # which is as uncertain as the friction that it is told beside
        like = [one for one in causes if one.part == cause.part and one.unit == cause.unit and one.has_ratio]
        return LEAST_VARIED["friction"] * max((one.nominal for one in like), default=0.0)
    return LEAST_VARIED.get(cause.kind, 0.0)


@dataclass(frozen=True, eq=False)
class _Found:
    robot: int
    cause: int
    probability: float
    others: tuple[int, ...]  # that explain it about as well
    beside: tuple[int, ...]  # that were found in this robot before
    change: Array = field(repr=False)  # of base parameters
    inverse: Array = field(repr=False)  # of the covariance of a robot that has these parts


class _Tested(NamedTuple):
    """What one robot shows of each cause, (len(causes),) each; of all robots, (R, len(causes)).

    Amplitudes, their standard deviations, and the parts that siblings vary by and that are the noise of the robot, are
    NaN where there is no one amplitude.
    Then what each explains, in squared standard deviations, with how many amplitudes; the degrees of freedom of the
    variance, and the part of it that siblings vary by.
    """

    amplitude: Array
    error: Array
    among: Array
    noise: Array
    explained: Array
    sizes: Array
    freedom: Array
    share: Array

    def degrees(self, tails: Array | float) -> Array:
        """Degrees of freedom of the variances, where siblings vary with these tails (see `tails_of`).

        By Satterthwaite's rule: a variance that differs from robot to robot is as one of which little is known.
        """
        return np.asarray(1.0 / (1.0 / self.freedom + tails * self.share**2))

    def chances(self, tails: Array | float) -> Array:
        """Probabilities of explaining as much by chance, where siblings vary with these tails."""
        from scipy.special import fdtrc

        return np.asarray(fdtrc(self.sizes, self.degrees(tails), self.explained / self.sizes))


class _Tests:
    """Each robot against the mean of the others, cause by cause."""

    def __init__(
        self,
        problem: SiblingVariation,
        causes: Sequence[Cause],
        directions: Sequence[Array],
        own: Mapping[int, Array],
        of_robot: Mapping[int, NDArray[np.bool_]],
        scale: Array,
        rate: float,
        was: Array | None = None,
    ) -> None:
        self.problem, self.directions, self.own, self.scale, self.rate = problem, directions, own, scale, rate
        self.causes, self.of_robot, self.was = causes, of_robot, was
        self.taken_off = np.zeros_like(problem.bases)  # what robots of batches have in common
        self.single = [k for k, one in enumerate(directions) if one.shape[1] == 1]
        self.several = [k for k, one in enumerate(directions) if one.shape[1] > 1]
        self.columns = (
            np.column_stack([directions[k][:, 0] for k in self.single]) if self.single else np.zeros((problem.width, 0))
        )

    def direction(self, robot: int, cause: int) -> Array:
        """How a robot's base parameters change with each amplitude of a cause, (n_b, k)."""
        return self.own[cause][robot, :, None] if cause in self.own else self.directions[cause]

    def directions_of(self, robots: NDArray[np.intp], cause: int) -> Array:
        """The same of several robots, (len(robots), n_b, k)."""
        if cause in self.own:
            return self.own[cause][robots, :, None]
        return np.broadcast_to(self.directions[cause], (len(robots), *self.directions[cause].shape))

    def columns_of(self, robot: int) -> Array:
        """The same of all causes with one amplitude, (n_b, k)."""
        if not self.own:
            return self.columns
        found = self.columns.copy()
        for cause, directions in self.own.items():
            found[:, self.single.index(cause)] = directions[robot]
        return found

    def measure(self) -> None:
        """Hold each robot against the mean of the others, each cause by itself."""
        count, causes = self.problem.count, len(self.directions)
        self.common = np.zeros((count, causes))
        told = []
        for robot in range(count):
            inverse, away = self.against_others(robot)
            told.append(self.tested(robot, inverse, away, inverse))
            if self.taken_off[robot].any():
                self.common[robot] = self.tested(robot, inverse, self.taken_off[robot], inverse).amplitude
        whole = _Tested(*(np.array(one) for one in zip(*told, strict=True)))
        self.amplitude, self.error, self.among, self.noise = whole.amplitude, whole.error, whole.among, whole.noise
        self.tails = self.tails_of_siblings(whole)
        self.probability, self.degrees = whole.chances(self.tails), whole.degrees(self.tails)

    def tails_of_siblings(self, whole: _Tested) -> Array:
        """Reciprocals of degrees of freedom of what siblings vary by, of each cause, see `tails_of`."""
        found = np.isin(np.arange(self.problem.count), list(self.problem.taken))
        amplitude, error = whole.amplitude[:, self.single], whole.error[:, self.single]
        known = [known_amplitudes(*one) for one in zip(amplitude.T, error.T**-2.0, strict=True)]
        deviations = np.array(known).reshape(amplitude.T.shape).T / error
        share = median_of_shown(whole.share[:, self.single], np.isfinite(deviations))
        own, of_all = tails_of(deviations, share, found)
        tails = np.full(len(self.directions), of_all)
        tails[self.single] = own
        return tails

    def named(self) -> list[_Found]:
        """Which robots differ, and in what."""
        count, causes = self.probability.shape
        best = self.probability.min(axis=1, initial=1.0)
        self.robot_probability = np.minimum(best * causes, 1.0)
        named = false_discoveries(self.robot_probability, self.rate)
        # Further causes of robots that are named are held to the same (Benjamini and Bogomolov, Selective inference on
        # multiple families of hypotheses, 2014).
        self.threshold = self.rate * max(int(named.sum()), 1) / max(count, 1) / max(causes, 1)
        return [one for robot in np.nonzero(named)[0] for one in self.parts_of(int(robot))]

    def heap(self) -> tuple[Heap, SiblingVariation] | None:
        """Find robots that all have another amount of something, see `find_heap`."""
        tried = [(k, known_amplitudes(self.amplitude[:, k], self.error[:, k] ** -2)) for k in self.single]
        # What a gain does to a robot was found with what has been taken off, which therefore looks like a gain.
        moved = self.taken_off.any(axis=1)
        tried += [(k, np.where(moved, np.nan, self.problem.amplitudes_of(own))) for k, own in self.own.items()]
        return find_heap(self.problem, tried, self.causes, self.directions_of, self.beside, LIKELY)

    def take_off(self, heap: Heap, within: SiblingVariation) -> None:
        """Take what robots have in common off their base parameters, and hold all robots against each other anew."""
        self.taken_off[heap.robots] += heap.change
        if heap.cause in self.own:
            self.own[heap.cause][heap.robots] -= heap.change
        problem = self.problem
        problem.bases = problem.bases.copy()
        if self.causes[heap.cause].kind == "scale":  # of the noise, too, and of what siblings vary by
            times = 1.0 + float(heap.amplitudes[0])
            problem.errors = problem.errors.copy()
            problem.bases[heap.robots] /= times
            problem.errors[heap.robots] /= times**2
            for own in self.own.values():
                own[heap.robots] /= times
            problem.begin(problem.bases)
        else:
            problem.bases[heap.robots] -= heap.change
            problem.variances, problem.spread_matrix, problem.mean = within.variances, within.spread_matrix, within.mean
        problem.settle(problem.bases, {})
        self.measure()

    def more_in_common(self, parts: Sequence[tuple[Heap, SiblingVariation]]) -> tuple[Heap, SiblingVariation] | None:
        """In what the robots of a batch differ beside its parts, by a test of two means: who belongs to it is known.

        A part in which two heaps overlap parts no robots; left alone, it counts as what siblings vary by, and draws the
        others by how the errors of both are correlated.
        """
        from scipy.special import fdtrc

        last = parts[-1][0]
        given = last.robots, self.causes, self.directions_of, self.beside, LIKELY, last.odds
        moved, within = self.problem.bases.copy(), self.problem.copied()
        moved[last.robots] -= common_part(self.problem, *given).change
        within.begin(moved)
        within.settle(moved, {})
        found = common_part(within, *given)
        size, freedom = len(found.amplitudes), max(self.problem.count - 2.0, 1.0)
        if float(fdtrc(size, freedom, found.explained / size)) > SURELY_ALSO / len(self.causes):
            return None
        # What a gain does to these robots was found with what was taken off.
        taken = [one.cause for one, _ in parts]
        told = found.cause not in taken and self.causes[found.cause].kind not in TURNABLE
        return (found, within) if told else None

    def beside_each_other(self, parts: list[tuple[Heap, SiblingVariation]]) -> list[tuple[Heap, SiblingVariation]]:
        """Estimate what one batch has in common in several parts together, and take off what that changes."""
        alone = [one for one in parts if self.causes[one[0].cause].kind in TURNABLE]  # of which no more is taken off
        several = [heap for heap, _ in parts if self.causes[heap.cause].kind not in TURNABLE]
        if len(several) < 2:
            return parts
        several = self.by_links(self.by_terms(several))
        found = beside_each_other(self.problem, several, self.directions_of)
        robots = several[0].robots
        more = np.sum([new.change - old.change for new, old in zip(found, several, strict=True)], axis=0)
        self.taken_off[robots] += more
        self.problem.bases[robots] -= more
        self.problem.settle(self.problem.bases, {})
        self.measure()
        return alone + [(heap, self.problem.copied()) for heap in found]

    def by_terms(self, heaps: list[Heap]) -> list[Heap]:
        """Tell friction that differs as a whole, and in one of its two terms as well, by both terms."""
        found = list(heaps)
        for place, whole in enumerate(heaps):
            of = self.causes[whole.cause]
            if of.kind != "friction":
                continue
            for index, term in enumerate(heaps):
                own = self.causes[term.cause]
                left = self.directions[whole.cause] - self.directions[term.cause]
                same = own.kind == "term" and own.part == of.part
                others = [k for k in self.single if same and np.allclose(self.directions[k], left, rtol=1e-9)]
                if others:
                    change = whole.amplitudes[0] * self.directions[term.cause][:, 0]
                    amplitudes = term.amplitudes + whole.amplitudes
                    found[index] = replace(term, amplitudes=amplitudes, change=term.change + change)
                    found[place] = replace(whole, cause=others[0], near=(), change=whole.change - change)
        return found

    def by_links(self, heaps: list[Heap]) -> list[Heap]:
        """Tell a mass that differs, of a link that differs in more, by the link, beside which it has no number."""
        found = list(heaps)
        for mass in [one for one in heaps if self.causes[one.cause].kind == "mass"]:
            for place, link in enumerate(found):
                of = self.causes[link.cause]
                if of.kind == "link" and of.part == self.causes[mass.cause].part:
                    also = np.linalg.pinv(self.directions[link.cause]) @ mass.change[0]
                    found[place] = replace(link, amplitudes=link.amplitudes + also, change=link.change + mass.change)
                    found.remove(mass)
                    break
        return found

    def against_others(self, robot: int) -> tuple[Array, Array]:
        """The inverse covariance of a robot's deviation from the mean of the others, and the deviation."""
        problem = self.problem
        own = problem.mean_weights[robot]
        left = np.linalg.inv(problem.precision - own)
        total = problem.precision @ problem.mean
        mean = left @ (total - own @ problem.moved[robot])
        covariance = problem.errors[robot] + problem.spread_matrix + left
        inverse = np.linalg.inv(covariance)
        return 0.5 * (inverse + inverse.T), problem.bases[robot] - mean

    def tested(self, robot: int, inverse: Array, away: Array, whole: Array) -> _Tested:
        """Hold what a robot shows against each cause.

        `inverse` is that of the covariance, without what causes that were found already explain; `whole` with it.
        """
        causes = len(self.directions)
        amplitude, error, among, noise = np.full((4, causes), np.nan)
        explained, share = np.zeros((2, causes))
        sizes, freedom = np.ones((2, causes))
        columns = self.columns_of(robot)
        weighed = inverse @ columns
        told = np.einsum("ij,ij->j", columns, weighed)
        all_told = np.einsum("ij,ij->j", columns, whole @ columns)
        seen = told > HIDDEN * np.maximum(all_told, 1e-300)
        safe = np.where(seen, told, 1.0)
        score = weighed.T @ away
        weights = weighed / safe
        degrees, share[self.single] = self.freedom(robot, weights)
        freedom[self.single] = np.where(seen, degrees, 1.0)
        varied = np.einsum("ik,ik->k", weights, self.problem.spread_matrix @ weights)
        among[self.single] = np.where(seen, np.sqrt(np.maximum(varied, 0.0)), np.nan)
        own_noise = np.einsum("ik,ik->k", weights, self.problem.errors[robot] @ weights)
        noise[self.single] = np.where(seen, np.sqrt(np.maximum(own_noise, 0.0)), np.nan)
        amplitude[self.single] = np.where(seen, score / safe, np.nan)
        error[self.single] = np.where(seen, 1.0 / np.sqrt(safe), np.nan)
        explained[self.single] = np.where(seen, score**2 / safe, 0.0)
        for k in self.several:
            own = self.directions[k]
            weighed = inverse @ own
            matrix, score = own.T @ weighed, weighed.T @ away
            values, vectors = eigenvectors(matrix)
            shown = values > 1e-6 * max(float(np.linalg.eigvalsh(own.T @ whole @ own)[-1]), 1e-300)
            if not shown.any():
                continue
            along = (vectors[:, shown].T @ score) / np.sqrt(values[shown])
            degrees, shares = self.freedom(robot, (weighed @ vectors[:, shown]) / values[shown])
            sizes[k], explained[k] = shown.sum(), along @ along
            freedom[k], share[k] = np.min(degrees), np.max(shares)
        return _Tested(amplitude, error, among, noise, explained, sizes, freedom, share)

    def likelihood(
        self, robot: int, inverse: Array, away: Array, free: int, tested: _Tested, possible: NDArray[np.intp]
    ) -> tuple[Array, Array]:
        """Logarithms of how likely each cause makes what a robot shows, and of how likely it is itself.

        Both up to a constant, (len(causes),); only of those that are `possible`. What a cause leaves unexplained
        has a multivariate Student's distribution, as the size of the covariance is itself estimated: where each cause
        leaves much, because the changes are too large for the directions to be exact, their ratio counts. Amplitudes
        are taken to be about as large as they were found (the marginal likelihood of a g-prior with local empirical
        Bayes: F. Liang et al., Mixtures of g priors for Bayesian variable selection, 2008), which counts their number
        against causes that have several.

        Probabilities of chance do not order causes: each has its own degrees of freedom, by which those of two that
        are equally far out differ by many powers of ten.
        """
        amplitude, error, explained, sizes = tested.amplitude, tested.error, tested.explained, tested.sizes
        siblings = max(float(self.problem.weights.sum()) - 1.0, 1.0)
        degrees = min(float(self.problem.freedoms[robot]), siblings)
        likely, before = np.full((2, len(self.causes)), -np.inf)
        total = float(away @ inverse @ away)
        for k in map(int, possible):
            left, tells, size = total - explained[k], explained[k], sizes[k]
            if np.isfinite(amplitude[k]):
                has, had = self.held(robot, k, float(amplitude[k]), inverse)
                before[k] = self.causes[k].log_prior(has / had, (has + 2.0 * float(error[k])) / had)
                roots = self.varied(robot, k, has, had)
                # The determinant of the covariance that is larger by them is left out: it grows with a gain of that
                # joint as well, in what the robot itself has, and would speak for whatever makes less.
                if roots is not None:
                    wider = _wider(inverse, *roots)
                    own = self.direction(robot, k)[:, 0]
                    weighed = wider @ own
                    tells = float(weighed @ away) ** 2 / max(float(weighed @ own), 1e-300)
                    left = float(away @ wider @ away) - tells
            else:
                before[k] = self.causes[k].log_prior(np.nan, np.nan)
            unexplained_part = np.log1p(max(left, 0.0) / degrees)
            likely[k] = -0.5 * ((degrees + free) * unexplained_part + size * np.log1p(tells / size))
        return likely, before

    def held(self, robot: int, cause: int, amplitude: float, inverse: Array) -> tuple[float, float]:
        """What a robot has of a cause, and what it had where changes are compared, as multiples of its siblings'."""
        if self.was is None or self.causes[cause].kind == "gain":
            return 1.0 + self.beside(robot, cause, amplitude), 1.0
        own = self.direction(robot, cause)[:, 0]
        weights = inverse @ own / max(float(own @ inverse @ own), 1e-300)
        common = float(weights @ self.problem.mean)
        had = held_before(weights, self.was[robot], self.problem.mean)
        return had + common + amplitude, had

    def varied(self, robot: int, cause: int, has: float, had: float) -> tuple[Array, Array] | None:
        """How much more than siblings a robot varies in what is so many times theirs: directions, and variances.

        Siblings vary by factors. A gearbox with four times the friction, whose Coulomb friction was 4 % above that of
        its siblings, has it 16 % of theirs above the other three; without that, it was told as a gain of the torque,
        or its viscous friction was told apart. None where that does not change how much it varies.
        """
        if self.causes[cause].kind not in ("friction", "term", "scale") or not self.causes[cause].has_ratio:
            return None
        nothing = self.direction(robot, cause)[:, 0] == 0.0
        least = self.problem.least[:, ~np.any(self.problem.least[nothing], axis=0)]
        within = ~np.any(self.problem.directions[nothing], axis=0)
        squares = np.array([has] if self.was is None else [has, had]) ** 2
        if self.causes[cause].kind != "scale":  # of which all that a robot has is a multiple
            squares = np.clip([has] if self.was is None else [has, had], 0.0, MOST_VARIED) ** 2
        more = float(squares.mean()) - 1.0  # a change varies with what there is after it, and with what was before
        variances = np.concatenate([self.problem.variances[within], np.ones(least.shape[1])])
        return (np.hstack([self.problem.directions[:, within], least]), more * variances) if len(variances) else None

    def usual_spread(self, kind: str) -> float:
        """By how much siblings vary in the median of the parts of a kind, in units of what they have."""
        return float(np.nanmedian(self.among[:, [k for k, cause in enumerate(self.causes) if cause.kind == kind]]))

    def is_own(self, robot: int, cause: int) -> bool:
        """Whether the amplitude of a cause is a part of what the robot itself has."""
        return cause in self.of_robot and bool(self.of_robot[cause][robot])

    def beside(self, robot: int, cause: int, amplitude: float) -> float:
        """An amplitude as a part of what siblings have."""
        return _beside(amplitude) if self.is_own(robot, cause) else amplitude

    def freedom(self, robot: int, weights: Array) -> tuple[Array, Array]:
        """Degrees of freedom of the variances of combinations of base parameters, (k,), by Satterthwaite's rule.

        And the part of these variances that siblings vary by.
        """
        problem = self.problem
        noise = np.maximum(np.einsum("ik,ik->k", weights, problem.errors[robot] @ weights), 0.0)
        assumed = np.maximum(np.einsum("ik,ik->k", weights, problem.assumed @ weights), 0.0)
        among = np.maximum(np.einsum("ik,ik->k", weights, problem.spread_matrix @ weights), 0.0)
        # A sibling whose data does not show the combination tells nothing of how much siblings vary in it.
        unseen = UNKNOWN**2 * (weights.T**2 @ ~problem.shown.T)
        tells = np.where(unseen <= (noise + among)[:, None], problem.weights, 0.0)
        if robot in problem.taken:
            tells[:, robot] = 0.0
        # Bounded squares tell of a variance what fewer siblings would. Counted in full, of sound fleets of ten arms 9 %
        # had a false alarm where 5 % are asked for.
        siblings = np.maximum(EFFICIENCY * (tells.sum(axis=1) - 1.0), 1.0)
        spread = noise**2 / problem.freedoms[robot] + np.maximum(among - assumed, 0.0) ** 2 / siblings
        spread += assumed**2 / ASSUMED
        whole = np.maximum(noise + among, 1e-300)
        return whole**2 / np.maximum(spread, 1e-300), among / whole

    def parts_of(self, robot: int) -> list[_Found]:
        """The causes that differ in one robot: the likeliest, then what is left beside it, and so on."""
        whole, away = self.against_others(robot)
        inverse = whole
        parts: list[tuple[int, float, tuple[int, ...]]] = []
        while len(parts) < MOST_CAUSES:
            tested = self.tested(robot, inverse, away, whole)
            taken_already = [k for k, _, _ in parts]
            chances = tested.chances(self.tails)
            # That the robot differs is sure. Where its part is one in which siblings vary most, tails would leave that
            # part out, and another one that explains less would be told.
            possible = (chances if parts else tested.chances(0.0)) <= self.threshold
            possible[taken_already] = False
            free = self.problem.width - sum(self.directions[k].shape[1] for k in taken_already)
            likely, before = self.likelihood(robot, inverse, away, free, tested, np.flatnonzero(possible))
            order = np.argsort(-(likely + before), kind="stable")
            best = int(order[0])
            # What no body and no drive can be is no further part.
            if not np.isfinite(likely[best]) or (parts and before[best] <= IMPOSSIBLE):
                break
            as_well = (likely[best] - likely <= LIKELY) & (before > IMPOSSIBLE)
            near = tuple(int(k) for k in order if as_well[k] and k != best)
            parts.append((best, float(chances[best]), near))
            times = 1.0 + float(tested.amplitude[best])
            whole = self.wider(robot, whole, inverse, best, float(tested.amplitude[best]))
            if self.causes[best].kind == "scale" and not 0.5 < times < 2.0:
                break  # a log in another unit: what else differs is told once it is in the right one
            inverse = unexplained(whole, np.column_stack([self.direction(robot, k) for k, _, _ in parts]))
            inverse = 0.5 * (inverse + inverse.T)
        parts = self.needed(robot, whole, away, parts)
        taken = np.column_stack([self.direction(robot, k) for k, _, _ in parts])
        seen = whole @ taken
        amplitudes = pseudo_inverse(taken.T @ seen) @ (seen.T @ away)
        found, column = [], 0
        for index, (k, chance, likely_too) in enumerate(parts):
            direction = self.direction(robot, k)
            width = direction.shape[1]
            change = direction @ amplitudes[column : column + width]
            column += width
            beside = tuple(other for other, _, _ in parts if other != k)
            found.append(_Found(robot, k, chance, likely_too if index == 0 else (), beside, change, whole))
        return found

    def wider(self, robot: int, whole: Array, inverse: Array, cause: int, amplitude: float) -> Array:
        """The inverse covariance of a robot that has more of a cause, and varies by more in it."""
        more = None
        if np.isfinite(amplitude):
            more = self.varied(robot, cause, *self.held(robot, cause, amplitude, inverse))
        if more is None:
            return whole
        found = _wider(whole, *more)
        return 0.5 * (found + found.T)

    def needed(
        self, robot: int, whole: Array, away: Array, parts: list[tuple[int, float, tuple[int, ...]]]
    ) -> list[tuple[int, float, tuple[int, ...]]]:
        """Leave out, one by one, the parts that the parts found after them explain as well.

        Such as the mass of a link, where the link was then found to be another one in more than its mass: beside that
        no number of the mass is known.
        """
        kept = list(parts)
        while len(kept) > 1:
            chances = []
            for k, _, _ in kept:
                others = np.column_stack([self.direction(robot, other) for other, _, _ in kept if other != k])
                inverse = unexplained(whole, others)
                tested = self.tested(robot, 0.5 * (inverse + inverse.T), away, whole)
                chances.append(float(tested.chances(0.0)[k]))
            worst = int(np.argmax(chances))
            if chances[worst] <= self.threshold:
                break
            del kept[worst], chances[worst]
        if len(kept) == 1:
            return [(k, min(chance, float(self.probability[robot, k])), near) for k, chance, near in kept]
        return kept


def _of_siblings(one: Deviation, of_robot: NDArray[np.bool_] | None) -> Deviation:
    """Tell a part of what the robot itself has as a part of what its siblings have.

    What a robot has by a factor g beside its siblings is more by (g - 1) / g of its own. The difference is of the
    second order in the change: of torques that read half, the part of its own is -1.
    """
    if of_robot is None or not of_robot[one.robot]:
        return one
    weights, amplitude = one.weights, _beside(one.amplitude)
    lower, upper = _beside(one.lower), _beside(one.upper)
    if one.lower < 1.0 <= one.upper:  # no factor is too large, of the sign that is the likelier
        lower, upper = (lower, np.inf) if one.amplitude < 1.0 else (-np.inf, upper)
    if weights is not None and np.isfinite(amplitude) and one.amplitude != 0.0:
        weights = weights * (amplitude / one.amplitude)
    error = one.standard_error / max(abs(1.0 - one.amplitude), LEAST) ** 2
    return replace(one, amplitude=amplitude, standard_error=error, lower=lower, upper=upper, weights=weights)


def _wider(inverse: Array, directions: Array, variances: Array) -> Array:
    """Return the inverse of a covariance that has these variances more along these directions (Woodbury)."""
    inside = np.eye(directions.shape[1]) + variances[:, None] * (directions.T @ inverse @ directions)
    seen = inverse @ directions
    return np.asarray(inverse - seen @ np.linalg.solve(inside, variances[:, None] * seen.T))


def _beside(part: float) -> float:
    """A part of what is there as a part of what would be there without it; beyond one, what is there has turned."""
    return part / (1.0 - part) if part != 1.0 else np.inf


def _in_common(heap: Heap, problem: SiblingVariation, tests: _Tests, confidence: float) -> Deviation:
    """Tell what robots have in common; the size has the interval of a difference of the means of two heaps."""
    from scipy.special import fdtrc, stdtr, stdtrit

    cause, first = tests.causes[heap.cause], int(heap.robots[0])
    count, many = problem.count, len(heap.robots)
    freedom, size = max(count - 2.0, 1.0), float(np.sqrt(heap.explained))
    alternatives = tuple(tests.causes[k] for k in heap.near)
    if len(heap.amplitudes) > 1:
        unknown, rank = float("nan"), len(heap.amplitudes)
        chance = float(fdtrc(rank, freedom, heap.explained / rank))
        return Deviation(first, cause, unknown, unknown, unknown, unknown, size, chance, alternatives)
    amplitude, weights = float(heap.amplitudes[0]), heap.weights[:, 0]
    noise = float(np.mean(np.einsum("i,rij,j->r", weights, problem.errors[heap.robots], weights)))
    among = float(weights @ problem.spread_matrix @ weights)
    # Siblings vary by factors. Those that all have more vary by as much more, and so does the ratio with what the
    # others have; what robots of both heaps vary by was found as one variance.
    wider = 1.0
    if cause.has_ratio and cause.kind != "gain":
        squared = (1.0 + amplitude) ** 2
        wider = squared * count / (squared * many + count - many)
    error = float(np.sqrt((noise + wider * among) / (noise + among) / heap.information[0, 0]))
    freedom = min(freedom, problem.freedom_of_interval(first, weights, float(np.sqrt(noise + among))))
    reach = float(stdtrit(freedom, 0.5 + 0.5 * confidence)) * error
    chance = 2.0 * float(stdtr(freedom, -size))
    told = Deviation(first, cause, amplitude, error, amplitude - reach, amplitude + reach, size, chance, alternatives)
    return _of_siblings(told, tests.of_robot.get(heap.cause))


def _deviation(one: _Found, tests: _Tests, confidence: float) -> Deviation:
    """Tell the size of a cause, beside the others of that robot."""
    from scipy.special import stdtrit

    cause, own = tests.causes[one.cause], tests.direction(one.robot, one.cause)
    alternatives = tuple(tests.causes[k] for k in one.others)
    out = deviations_of(one.probability)
    whole, away = one.inverse, tests.against_others(one.robot)[1]
    if own.shape[1] > 1:
        unknown, seen = float("nan"), whole @ one.change
        weights = seen / max(float(one.change @ seen), 1e-300) / tests.scale
        return Deviation(
            one.robot, cause, unknown, unknown, unknown, unknown, out, one.probability, alternatives, weights
        )
    if cause.kind == "scale" and tests.was is None:
        # A multiple of the mean itself, from which medians are further than it is known: of torques with the other sign
        # intervals held in 14 of 24 robots.
        own = tests.problem.mean[:, None]
    beside = [tests.direction(one.robot, k) for k in one.beside]
    inverse = unexplained(whole, np.column_stack(beside)) if beside else whole
    weighed = inverse @ own[:, 0]
    told = float(own[:, 0] @ weighed)
    weights = weighed / told
    amplitude = float(weights @ away)
    error = float(1.0 / np.sqrt(told))
    among = float(weights @ tests.problem.spread_matrix @ weights)
    if cause.kind == "mass":
        # Siblings vary by factors: what a fault made three times as much was by as much more or less before.
        error = float(np.sqrt(max(error**2 - among, 0.0) + among * (1.0 + amplitude) ** 2))
    if tests.problem.count < FEW_SIBLINGS:
        factor = 1.0 if cause.kind == "gain" else (1.0 + amplitude) ** 2
        error = float(np.sqrt(error**2 + factor * max(tests.usual_spread(cause.kind) ** 2 - among, 0.0)))
    freedom = tests.problem.freedom_of_interval(one.robot, weights, error, float(tests.tails[one.cause]))
    reach = float(stdtrit(freedom, 0.5 + 0.5 * confidence)) * error
    return Deviation(
        one.robot,
        cause,
        amplitude,
        error,
        amplitude - reach,
        amplitude + reach,
        out,
        one.probability,
        alternatives,
        weights / tests.scale,
    )
