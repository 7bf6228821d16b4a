"""Regression by what robots are made of: how well a motion and torques go together in any robot that could be this one.

Least squares hide mistakes in a log: a torque of the wrong sign is explained by negative masses and by friction that
drives. Here every link is drawn to the body of the description (where that has none, to its shape, or to one that spans
its joints) with wide tolerance, and friction dissipates. A fit takes a millisecond, so that hundreds of hypotheses can
be compared.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv

from steelyard.dynamics import Model
from steelyard.feasibility.constraints import Constraint
from steelyard.recording import Samples
from steelyard.robot.inertia import pseudo_inertia

from .kinematic_bodies import reach_of
from .physical_prior import PhysicalPrior, physical_prior

__all__ = [
    "BodyPrior",
    "LikeliestRobot",
    "Moments",
    "believable_bodies",
    "body_priors",
    "gains_of_factors",
    "likeliest_factors",
    "likeliest_robot",
    "moments",
]

Array = NDArray[np.float64]

BLOCKS = 4
"""Stretches of time that are left out in turn."""
EFFECTIVE_ROWS = 60.0
"""Independent rows that a joint's torques count for, whatever the length of the log: what the model lacks is correlated
over much of a swing, and comes back in the next. With all rows the smallest flaw of the model outweighs the prior."""
FACTOR_PASSES, FACTOR_ACCURACY = 20, 0.01
"""Changes of the joints' weights, and steps between, after which factors of torques stay as they are; six are usual."""
LEAST_ERROR = 0.02
"""Relative error of a joint below which errors are all alike: what little noise there is must not decide."""
PASSES = 3
"""Fits after each of which joints are weighted by their errors."""

SCALE_SPREAD, MASS_SPREAD, SHIFT_SPREAD, INERTIA_SPREAD = 0.4, 0.4, 0.3, 0.5
"""Standard deviations of a body of the description: of its scale, of its mass, of its first moments (in mass times
size) and of its moments of inertia (in mass times size squared). CAD without drives and cables is that wrong."""
ASSUMED_SPREAD = 2.0
"""Times so much where shapes or the kinematics stand in for the bodies."""
SCALE_OF_ALL = 1.3
"""Standard deviation of the logarithm of the total mass where it is not known."""
PAYLOAD_SIZE = 0.2
"""m. What a hand carries is smaller than this about its frame."""
LEAST_MASS, LEAST_ASSUMED_MASS, MASS_STIFFNESS = 0.5, 0.2, 0.15
"""Share of the mean mass of a link below which a spring holds it, where the description tells it and where it does not,
and the standard deviation of the spring: normal distributions are too kind to masses near zero and below."""
LOG_TORQUE_SPREAD, LEAST_SHARE = 1.3, 0.03
"""Standard deviation of the logarithm of a joint's torques, compared with those that its bodies need, or with this
share of those of the strongest joint: that of friction in wrists."""
FRICTION = 0.5
"""Standard deviation of what a term (friction, offset, rotor) has of the torques of its joint."""


@dataclass(frozen=True, eq=False)
class BodyPrior:
    """A normal prior of the links: the mean and the covariance of their parameters.

    Attributes
    ----------
    mean : ndarray
        (n,) with zeros for the terms.
    precision : ndarray
        (n, n) inverse of the covariance of the links' parameters, with zeros for the terms.
    log_determinant : float
        Of the precision of the links.
    log_scale : float
        Logarithm of the scale of all the masses, in standard deviations; 0 where the description tells them.
    """

    mean: Array
    precision: Array
    log_determinant: float
    penalty: float
    masses: NDArray[np.intp]
    weighed: NDArray[np.intp]
    widening: float

    @property
    def least(self) -> float:
        """Share of the mean masses below which springs hold them."""
        return LEAST_MASS if self.widening == 1.0 else LEAST_ASSUMED_MASS

    def with_payload(self, columns: NDArray[np.intp], mass: float) -> BodyPrior:
        """Return the same with one link that may be heavier by about a mass, kg, within PAYLOAD_SIZE of its frame."""
        places = np.ix_(columns, columns)
        body: Array = np.asarray(np.linalg.inv(self.precision[places]))
        sizes = mass * PAYLOAD_SIZE ** np.array([2.0] * 6 + [1.0] * 3 + [0.0])
        inverse, log_determinant = _inverse(body + np.diag(sizes**2))
        precision = self.precision.copy()
        precision[places] = inverse
        difference = log_determinant - _inverse(body)[1]
        others = self.masses[self.masses != columns[9]]
        return replace(self, precision=precision, log_determinant=self.log_determinant + difference, weighed=others)

    def light(self, parameters: Array) -> NDArray[np.bool_]:
        """(n,) which masses are so far below the mean that a normal distribution finds them too likely."""
        found = np.zeros(len(parameters), dtype=bool)
        found[self.weighed] = parameters[self.weighed] < self.least * self.mean[self.weighed]
        return found

    def expected_torques(self, gram: Array, counts: Array) -> Array:
        """(N,) root mean squares of the torques that these bodies need, or of those of friction in a wrist."""
        size = len(self.mean)
        rigid = np.sqrt(np.maximum((gram[:, :size, :size] @ self.mean) @ self.mean, 0.0) / counts)
        return np.asarray(np.maximum(rigid, max(LEAST_SHARE * float(rigid.max()), 1e-300)))

    def torque_surprise(self, gram: Array, power: Array, counts: Array) -> Array:
        """(N,) what speaks against torques of another magnitude than these bodies need."""
        away = np.log(np.sqrt(power) / self.expected_torques(gram, counts))
        # What is not known of single masses adds to the spread; the mass of all of them has a place of its own.
        spread = np.hypot(LOG_TORQUE_SPREAD, MASS_SPREAD * (self.widening - 1.0))
        return np.asarray(0.5 * (away / spread) ** 2)


def body_priors(
    model: Model, constraints: Sequence[Constraint] = (), known: PhysicalPrior | None = None
) -> tuple[BodyPrior, ...]:
    """Return what the links of a robot may be, or one for each of several total masses where the masses are not known.

    See `physical_prior` for what takes the place of bodies that the description does not have, and for the masses that
    constraints state; `known` is what it returned of these, where that was asked before.
    """
    described = believable_bodies(model)
    if described is not None and not constraints:
        return (_prior(model, described, 1.0, 0.0),)
    assumed = physical_prior(model, constraints) if known is None else known
    bodies = assumed.parameters[np.array(model.link_columns)]
    if not assumed.scale_is_free:
        return (_prior(model, bodies, 1.0, 0.0),)
    scales = np.exp2(np.arange(-5, 6))
    penalties = 0.5 * (np.log(scales) / SCALE_OF_ALL) ** 2
    return tuple(
        _prior(model, bodies * scale, ASSUMED_SPREAD, penalty) for scale, penalty in zip(scales, penalties, strict=True)
    )


def believable_bodies(model: Model) -> Array | None:
    """(links, 10) of the description, where all of them are possible and none is a placeholder; otherwise None."""
    bodies = np.asarray(model.robot.parameters)[np.array(model.link_columns)]
    masses = bodies[:, 9]
    if not np.isfinite(bodies).all() or not (masses > 0.0).all():
        return None
    if len(masses) > 1 and np.ptp(masses) < 1e-9 * masses.max():
        return None
    least = np.linalg.eigvalsh(pseudo_inertia(bodies))[:, 0]
    return bodies if (least > -1e-9 * masses).all() else None


def link_points(model: Model) -> tuple[tuple[Array, Array], ...]:
    """For each link a point of its own joint's axis and the origins of the joints that it carries, in its frame, m."""
    joints = model.robot.joints
    found = []
    for k, joint in enumerate(joints):
        after = np.asarray(joint.after, dtype=float)
        own = -after[:3, :3].T @ after[:3, 3]
        children = [np.asarray(child.before, dtype=float)[:3, 3] for child in joints if child.parent == k]
        found.append((own, np.array(children).reshape(-1, 3)))
    return tuple(found)


def _prior(model: Model, bodies: Array, widening: float, penalty: float) -> BodyPrior:
    n = model.parameter_count
    mean, precision, log_determinant = np.zeros(n), np.zeros((n, n)), 0.0
    least = 0.03 * max(reach_of(model.robot), 0.05)
    typical = 0.3 * float(bodies[:, 9].mean())
    for columns, body, (own, children) in zip(model.link_columns, bodies, link_points(model), strict=True):
        mass = max(float(body[9]), 0.1 * typical)
        com = body[6:9] / max(body[9], 1e-12)
        spans = np.linalg.norm(children - own, axis=1)
        gyration = np.sqrt(max(body[[0, 3, 5]].sum() / (2.0 * max(body[9], 1e-12)) - com @ com, 0.0))
        size = max(least, 0.5 * float(spans.max(initial=0.0)), float(np.linalg.norm(com - own)), gyration)
        far = float(np.linalg.norm(own)) + size
        deviations = widening * np.concatenate(
            [np.full(6, INERTIA_SPREAD * mass * far**2), np.full(3, SHIFT_SPREAD * mass * far), [MASS_SPREAD * mass]]
        )
        covariance = np.diag(deviations**2) + (widening * SCALE_SPREAD) ** 2 * np.outer(body, body)
        mean[columns], mean[columns[9]] = body, mass
        inverse, of_link = _inverse(covariance)
        precision[np.ix_(columns, columns)] = inverse
        log_determinant += of_link
    masses = np.array([columns[9] for columns in model.link_columns])
    return BodyPrior(mean, precision, log_determinant, penalty, masses, masses, widening)


def _inverse(covariance: Array) -> tuple[Array, float]:
    """The inverse of a covariance of very different deviations, and the logarithm of its determinant."""
    sizes = np.sqrt(np.diag(covariance))
    scaled = covariance / np.outer(sizes, sizes)
    inverse = np.linalg.inv(scaled) / np.outer(sizes, sizes)
    return inverse, -float(np.linalg.slogdet(scaled)[1]) - 2.0 * float(np.log(sizes).sum())


@dataclass(frozen=True, eq=False)
class Moments:
    """Second moments of regressor and torques: all that fits to one motion need, whatever is done with the torques.

    Attributes
    ----------
    total : ndarray
        (N, n + N, n + N) of the columns of the regressor's row of each joint and the torques of all joints.
    counts : ndarray
        (B, N) rows in each of B stretches of time.
    rows : tuple of (ndarray, ndarray)
        For each joint which of the columns are not zero, (c,), and their rows in all stretches, (S, c).
    bounds : ndarray
        (B + 1,) where the stretches begin and end.
    """

    total: Array
    counts: Array
    rows: tuple[tuple[NDArray[np.intp], Array], ...] = ()
    bounds: NDArray[np.intp] = field(default_factory=lambda: np.zeros(1, dtype=np.intp))

    @property
    def joints(self) -> int:
        """N."""
        return int(self.counts.shape[1])

    @property
    def columns(self) -> int:
        """n."""
        return int(self.total.shape[1]) - self.joints

    def stretches(self) -> Iterator[Array]:
        """Yield the same of each stretch alone; most hypotheses are told apart by the sums over all of them."""
        for start, stop in pairwise(self.bounds):
            found = np.zeros_like(self.total)
            for own, (places, rows) in zip(found, self.rows, strict=True):
                own[np.ix_(places, places)] = rows[start:stop].T @ rows[start:stop]
            yield found


def moments(
    model: Model,
    samples: Samples,
    *,
    gravity: Array | None = None,
    extra: Array | None = None,
    without: Sequence[int] | NDArray[np.intp] = (),
    coupling: Array | None = None,
) -> Moments:
    """Reduce samples.

    Parameters
    ----------
    model : Model
    samples : Samples
    gravity : ndarray, optional
        (3,) m/s², in place of the robot's own.
    extra : ndarray, optional
        (S, N, e) further columns.
    without : sequence of int
        Parameters of the model that have no effect.
    coupling : ndarray, optional
        (N, N), by which torques of motors become those of joints: errors are then those of the motors, each of which
        shows at all joints that its motor moves.
    """
    count, joints = samples.q.shape
    if gravity is None:
        regressor = model.regressor(samples.q, samples.dq, samples.ddq, channels=samples.channels)
    else:
        kernel = model.kernel("regressor", gravity="argument")
        flat = kernel(samples.q, samples.dq, samples.ddq, np.asarray(gravity, dtype=float))
        regressor = flat.reshape(count, joints, -1)
    if len(without):
        regressor = regressor.copy()
        regressor[:, :, without] = 0.0
    if extra is not None:
        regressor = np.concatenate([regressor, extra], axis=2)
    width, torque, mask = regressor.shape[2], samples.torque, samples.mask
    if coupling is not None:
        motors = np.linalg.inv(coupling)
        regressor, torque = np.einsum("mj,sjc->smc", motors, regressor), torque @ motors.T
        mask = None if mask is None else ~((~mask) @ (motors.T != 0.0))
    bounds = np.linspace(0, count, BLOCKS + 1).round().astype(np.intp)
    mask = np.ones((count, joints), dtype=bool) if mask is None else mask
    counts = np.array([np.count_nonzero(mask[start:stop], axis=0) for start, stop in pairwise(bounds)])
    total, kept = np.zeros((joints, width + joints, width + joints)), []
    for k, used in enumerate(np.any(regressor != 0.0, axis=0)):
        own = np.flatnonzero(used)
        rows = np.concatenate([regressor[:, k, own], torque], axis=1)
        if samples.mask is not None:
            rows *= mask[:, k, None]
        places = np.concatenate([own, width + np.arange(joints)])
        total[k][np.ix_(places, places)] = rows.T @ rows
        kept.append((places, rows))
    return Moments(total, counts, tuple(kept), bounds)


@dataclass(frozen=True, eq=False)
class LikeliestRobot:
    """The most probable robot for a motion and torques.

    Attributes
    ----------
    parameters : ndarray
        (n,)
    cost : float
        Negative logarithm of the marginal likelihood (Laplace), up to a constant: of two hypotheses the one with the
        lower cost is the likelier, however many parameters either has.
    errors : ndarray
        (N,) relative errors of the joints.
    held_out : ndarray
        (N,) relative errors of the joints, each stretch of time predicted by the others; empty where not asked for.
    power : ndarray
        (N,) mean squares of the torques.
    torque_surprise : ndarray
        (N,) what speaks against torques of this magnitude, as a logarithm of odds.
    precision : ndarray
        (n, n) inverse of the covariance of the parameters, of those that are not held at zero.
    free : ndarray
        (n,) which these are.
    """

    parameters: Array
    cost: float
    errors: Array
    held_out: Array
    power: Array
    torque_surprise: Array
    precision: Array
    free: NDArray[np.bool_]

    def standard_deviation(self, column: int) -> float:
        """Standard deviation of one parameter that is not held at zero."""
        alone = np.zeros(len(self.free))
        alone[column] = 1.0
        places = np.ix_(self.free, self.free)
        return float(np.sqrt(np.linalg.solve(self.precision[places], alone[self.free]) @ alone[self.free]))

    @property
    def error(self) -> float:
        """Relative error of all the torques together."""
        return float(np.sqrt((self.errors**2 @ self.power) / self.power.sum()))

    @property
    def held_out_error(self) -> float:
        """Relative error of all the torques together, each stretch of time predicted by the others."""
        return float(np.sqrt((self.held_out**2 @ self.power) / self.power.sum()))


def likeliest_robot(
    moments: Moments,
    prior: BodyPrior,
    nonnegative: NDArray[np.bool_],
    matrix: Array | None = None,
    held_out: bool = False,
) -> LikeliestRobot:
    """Fit the parameters of links and terms.

    Parameters
    ----------
    prior : BodyPrior
        Of the first n columns or less; further columns are terms.
    nonnegative : ndarray
        (n,) booleans: friction and rotor inertia.
    matrix : ndarray, optional
        (N, N): the torques are this times those of the samples.
    held_out : bool
        Whether to predict stretches by each other.
    """
    n = moments.columns
    gram, cross, square = _normal_equations(moments.total, n, matrix)
    counts = np.maximum(moments.counts.sum(axis=0), 1)
    power = square / counts
    power = np.maximum(power, 1e-12 * max(float(power.max()), 1e-100))
    mean, precision, log_determinant = _with_terms(prior, gram, counts, power)
    pulled, light = precision @ mean, np.zeros(n, dtype=bool)
    spring = _springs(prior, n)
    flat = gram.reshape(len(gram), -1)
    variance = power
    for _ in range(PASSES):
        weights = EFFECTIVE_ROWS / (counts * variance)
        normal = (weights @ flat).reshape(n, n) + precision
        normal[light, light] += spring[light]
        held = np.where(light, spring * prior.least * mean, 0.0)
        parameters, free, half = _nonnegative_solution(normal, weights @ cross + pulled + held, nonnegative)
        light = light | prior.light(parameters)
        residual = np.maximum(_residuals(parameters, gram, cross, square), 0.0)
        variance = np.maximum(residual / counts, LEAST_ERROR**2 * power)
    deviation, surprise = parameters - mean, prior.torque_surprise(gram, power, counts)
    cost = (
        0.5 * EFFECTIVE_ROWS * float(np.log(variance).sum())
        + 0.5 * float(deviation @ precision @ deviation)
        + half
        - 0.5 * (log_determinant - float(np.log(np.diag(precision)[~free]).sum()))
        + prior.penalty
        + float(surprise.sum())
        + 0.5 * float(spring[light] @ (parameters - prior.least * mean)[light].clip(max=0.0) ** 2)
    )
    if matrix is not None:
        cost -= EFFECTIVE_ROWS * float(np.linalg.slogdet(matrix)[1])
    outside = np.empty(0)
    if held_out:
        outside = _held_out_errors(moments, matrix, mean, precision, nonnegative, variance)
    errors = np.sqrt(residual / np.maximum(square, 1e-300))
    return LikeliestRobot(parameters, cost, errors, outside, power, surprise, normal, free)


def gains_of_factors(moments: Moments, prior: BodyPrior, fit: LikeliestRobot) -> Array:
    """Return what a factor of the torques of each joint alone would gain, by the slope of the cost at none.

    Bodies follow a wrong factor, so that the errors hardly tell it; what they are drawn to does. It is the test of Rao:
    half the square of the slope over the curvature in the logarithm of the factor, with parameters that follow it. One
    solution does for all joints, and stands for a search only where it says that nothing is to be found.

    Parameters
    ----------
    fit : LikeliestRobot
        Of these, to the torques as they are.

    Returns
    -------
    ndarray
        (N,) logarithms of odds.
    """
    gram, cross, _ = _normal_equations(moments.total, moments.columns, None)
    counts = np.maximum(moments.counts.sum(axis=0), 1)
    precision = _with_terms(prior, gram, counts, fit.power)[1]
    weights = EFFECTIVE_ROWS / (counts * np.maximum(fit.errors, LEAST_ERROR) ** 2 * fit.power)
    modelled = gram @ fit.parameters
    slope = weights * ((cross - modelled) @ fit.parameters)
    changed = weights[:, None] * modelled
    followed = np.linalg.solve(np.tensordot(weights, gram, 1) + precision, changed.T)
    curvature = changed @ fit.parameters - np.einsum("kc,ck->k", changed, followed)
    return np.asarray(0.5 * slope**2 / np.maximum(curvature, 1e-9))


def likeliest_factors(moments: Moments, prior: BodyPrior, first: Array) -> Array:
    """Find what the torques of each joint are to be multiplied by to go best with these bodies.

    The cost of `likeliest_robot` with such factors has many valleys, for a robot follows whatever factors it is given.
    Here robot and factors move together: with the weights of the joints held, the cost is convex in the factors, and
    weights follow the errors.

    Parameters
    ----------
    first : ndarray
        (N,) factors to begin with.

    Returns
    -------
    ndarray
        (N,) positive.
    """
    n, factors = moments.columns, np.array(first, dtype=float)
    gram, cross, square = _normal_equations(moments.total, n, None)
    counts = np.maximum(moments.counts.sum(axis=0), 1)
    variance = (0.3 * factors) ** 2 * square / counts
    for _ in range(FACTOR_PASSES):
        before, power = factors, factors**2 * square / counts
        mean, precision, _ = _with_terms(prior, gram, counts, power)
        weights = EFFECTIVE_ROWS / (counts * variance)
        mixed = (weights[:, None] * cross).T
        normal = np.tensordot(weights, gram, 1) + precision
        solved = np.linalg.solve(normal, np.column_stack([mixed, precision @ mean]))
        curvature = np.diag(weights * square) - mixed.T @ solved[:, :-1]
        pull = mixed.T @ solved[:, -1]
        for _ in range(FACTOR_PASSES):
            gradient = curvature @ factors - pull - EFFECTIVE_ROWS / factors
            step = -np.linalg.solve(curvature + np.diag(EFFECTIVE_ROWS / factors**2), gradient)
            factors = factors + min(1.0, 0.9 / float(np.max(-step / factors, initial=0.9))) * step
        parameters = solved[:, :-1] @ factors + solved[:, -1]
        residual = np.array(
            [
                _residuals(parameters, gram[k : k + 1], factors[k] * cross[k : k + 1], factors[k] ** 2 * square[k])[0]
                for k in range(len(gram))
            ]
        )
        variance = np.maximum(residual, LEAST_ERROR**2 * factors**2 * square) / counts
        if np.abs(np.log(factors / before)).max() < FACTOR_ACCURACY:
            break
    return factors


def _springs(prior: BodyPrior, n: int) -> Array:
    """(n,) stiffness of what holds masses from below."""
    found = np.zeros(n)
    found[prior.weighed] = 1.0 / (MASS_STIFFNESS * prior.mean[prior.weighed]) ** 2
    return found


def _normal_equations(sums: Array, n: int, matrix: Array | None) -> tuple[Array, Array, Array]:
    """Y'Y, Y'tau and tau'tau of every joint."""
    gram, torque = sums[:, :n, :n], sums[:, n:, n:]
    if matrix is None:
        joints = range(len(sums))
        return gram, np.array([sums[k, :n, n + k] for k in joints]), np.array([torque[k, k, k] for k in joints])
    cross = (sums[:, :n, n:] @ matrix[:, :, None])[:, :, 0]
    return gram, cross, (matrix[:, None] @ torque @ matrix[:, :, None])[:, 0, 0]


def _with_terms(prior: BodyPrior, gram: Array, counts: Array, power: Array) -> tuple[Array, Array, float]:
    """Give every term the scale that it would have with all the torque of its joint."""
    n = gram.shape[1]
    mean, precision = np.zeros(n), np.zeros((n, n))
    mean[: len(prior.mean)] = prior.mean
    precision[: len(prior.mean), : len(prior.mean)] = prior.precision
    terms = np.diag(precision) == 0.0
    sizes = np.einsum("kii->ki", gram)[:, terms] / (counts * power)[:, None]  # (share of the torque's power) per unit²
    scale = np.maximum(sizes.max(axis=0), 1e-300) / FRICTION**2
    precision[terms, terms] = scale
    return mean, precision, prior.log_determinant + float(np.log(scale).sum())


def _residuals(parameters: Array, gram: Array, cross: Array, square: Array) -> Array:
    return np.asarray(square - 2.0 * cross @ parameters + (gram @ parameters) @ parameters)


def _nonnegative_solution(
    normal: Array, right: Array, nonnegative: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_], float]:
    """Solve with those that would be negative at zero; what is once at zero stays there.

    Also returns which are not at zero, and half the logarithm of the determinant of their matrix.
    """
    n = len(right)
    sizes = np.sqrt(np.diagonal(normal))
    scaled = normal / (sizes[:, None] * sizes)
    scaled.flat[:: n + 1] += 1e-12
    target = right / sizes
    free = np.ones(n, dtype=bool)
    while True:
        chosen = np.flatnonzero(free)
        own = scaled if len(chosen) == n else scaled[np.ix_(chosen, chosen)]
        # Symmetric, so that its transpose, which LAPACK takes without a change of its order, is the same.
        factor, solution, failed = dposv(own.T, target[chosen])
        if failed:
            raise np.linalg.LinAlgError("the normal equations are not positive definite")
        found = np.zeros(n)
        found[chosen] = solution / sizes[chosen]
        wrong = nonnegative & (found < 0.0)
        if not wrong.any():
            return found, free, float(np.log(np.diag(factor)).sum() + np.log(sizes[chosen]).sum())
        free &= ~wrong


def _held_out_errors(
    moments: Moments,
    matrix: Array | None,
    mean: Array,
    precision: Array,
    nonnegative: NDArray[np.bool_],
    variance: Array,
) -> Array:
    n = moments.columns
    error, power = np.zeros(moments.joints), np.zeros(moments.joints)
    for own, count in zip(moments.stretches(), moments.counts, strict=True):
        gram, cross, _ = _normal_equations(moments.total - own, n, matrix)
        weights = EFFECTIVE_ROWS / (np.maximum(moments.counts.sum(axis=0) - count, 1) * variance)
        normal = np.tensordot(weights, gram, 1) + precision
        parameters, _, _ = _nonnegative_solution(normal, weights @ cross + precision @ mean, nonnegative)
        gram, cross, square = _normal_equations(own, n, matrix)
        error += np.maximum(_residuals(parameters, gram, cross, square), 0.0)
        power += square
    return np.asarray(np.sqrt(error / np.maximum(power, 1e-300)))
