"""Effects of wrong parameters on each term of a model, on simulations and on controllers, beside the true ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from steelyard.dynamics import Model
from steelyard.feasibility import FeasibleSet, correct
from steelyard.simulation import SimulationResult, StoppingConditions, simulate

from .noisy_estimates import Subject

__all__ = ["Effects", "States", "effects", "guided", "hangs_unstably", "held", "identities", "reach", "released"]

Array = NDArray[np.float64]
_STEP = 1e-6  # rad, of central differences
_LARGEST_SPEED = 20.0  # rad/s, of the safety stop of the controlled arm


@dataclass(frozen=True, eq=False)
class States:
    """Random states of an arm with the torques that move the true one in them.

    Attributes
    ----------
    q, dq, ddq, torque : (S, N)
    """

    q: Array
    dq: Array
    ddq: Array
    torque: Array

    @classmethod
    def random(cls, subject: Subject, count: int, seed: int = 81) -> States:
        """Draw configurations from the whole turn, velocities of 1 rad/s and accelerations of 3 rad/s², rms."""
        random = np.random.default_rng(seed)
        n = subject.model.dof
        q = random.uniform(-np.pi, np.pi, (count, n))
        dq, ddq = random.normal(size=(count, n)), 3.0 * random.normal(size=(count, n))
        return cls(q, dq, ddq, subject.model.inverse_dynamics(q, dq, ddq, subject.truth))


@dataclass(frozen=True)
class Effects:
    """Errors against the true arm, relative to the rms of the true values, and shares of impossible states.

    Attributes
    ----------
    gravity, coriolis, torque : float
        Rms error of gravity torques, of Coriolis and centripetal torques, and of the whole inverse dynamics.
    acceleration, worst_acceleration : float
        Error of forward dynamics: median over the states, and that which one state in twenty exceeds.
    indefinite : float
        Share of the configurations at which the inertia matrix has a negative eigenvalue.
    negative_energy : float
        Share of the states with a negative kinetic energy.
    driving_friction : float
        Share of the states in which friction gives power instead of taking it.
    """

    gravity: float
    coriolis: float
    torque: float
    acceleration: float
    worst_acceleration: float
    indefinite: float
    negative_energy: float
    driving_friction: float


def _matrices(model: Model, q: Array, base: Array) -> Array:
    n = model.dof
    return np.asarray(model.kernel("total_inertia_matrix", base=True)(q, base)).reshape(len(q), n, n)


def effects(subject: Subject, base: Array, states: States) -> Effects:
    """Compare base parameters with the true ones in random states."""
    model, truth = subject.model, subject.base
    gravity, coriolis = (model.kernel(name, base=True) for name in ("gravity", "coriolis"))
    inverse = model.kernel("inverse_dynamics", base=True)
    q, dq, ddq = states.q, states.dq, states.ddq

    def relative(ours: Array, true: Array) -> float:
        return float(np.linalg.norm(ours - true) / np.linalg.norm(true))

    matrices = _matrices(model, q, base)
    bias = inverse(q, dq, np.zeros_like(q), base)
    predicted = np.linalg.solve(matrices, (states.torque - bias)[..., None])[..., 0]
    error = np.linalg.norm(predicted - ddq, axis=1) / np.sqrt(np.mean(np.sum(ddq**2, axis=1)))
    energy = np.einsum("si,sij,sj->s", dq, matrices, dq)
    drives, still = model.kernel("drive_torque", base=True), np.zeros_like(q)
    # Without the offset, which is there at rest too.
    friction = np.sum(dq * (drives(q, dq, still, base) - drives(q, still, still, base)), axis=1)
    return Effects(
        gravity=relative(gravity(q, base), gravity(q, truth)),
        coriolis=relative(coriolis(q, dq, base), coriolis(q, dq, truth)),
        torque=relative(inverse(q, dq, ddq, base), states.torque),
        acceleration=float(np.median(error)),
        worst_acceleration=float(np.quantile(error, 0.95)),
        indefinite=float(np.mean(np.linalg.eigvalsh(matrices)[:, 0] < 0.0)),
        negative_energy=float(np.mean(energy < 0.0)),
        driving_friction=float(np.mean(friction < 0.0)),
    )


def identities(subject: Subject, base: Array, states: States) -> tuple[float, float]:
    """Return how far two identities are from holding, relative: they hold for any parameters, possible or not.

    ``dq' (dM/dt - 2 C) dq = 0``, and that gravity torques are the gradient of the potential energy; both derivatives
    are central differences.
    """
    model, q, dq = subject.model, states.q, states.dq
    rate = (_matrices(model, q + _STEP * dq, base) - _matrices(model, q - _STEP * dq, base)) / (2.0 * _STEP)
    power = np.einsum("si,sij,sj->s", dq, rate, dq)
    twice = 2.0 * np.sum(dq * model.kernel("coriolis", base=True)(q, dq, base), axis=1)
    skew = float(np.abs(power - twice).max() / np.abs(twice).max())
    potential = model.kernel("potential_energy", base=True)
    gravity = model.kernel("gravity", base=True)(q, base)
    steps = _STEP * np.eye(model.dof)
    gradient = np.stack([(_flat(potential(q + s, base)) - _flat(potential(q - s, base))) for s in steps], axis=1)
    return skew, float(np.abs(gradient / (2.0 * _STEP) - gravity).max() / np.abs(gravity).max())


def _flat(values: Array) -> Array:
    return np.asarray(values).reshape(-1)


def reach(subject: Subject, base: Array, states: States) -> dict[str, float]:
    """Return how near a possible robot can come to each term of an estimate *by itself*: rms difference, relative.

    The distance from the feasible set is measured in the torques of that term alone, so that 0 means that a possible
    robot has exactly these torques, whatever its others are.
    """
    model = subject.model
    q, dq, ddq = states.q, states.dq, states.ddq
    still = np.zeros_like(q)
    inverse = model.kernel("inverse_dynamics", base=True)
    units = np.eye(len(base))

    def columns(speeds: Array, accelerations: Array) -> Array:
        return np.stack([_flat(inverse(q, speeds, accelerations, unit)) for unit in units], axis=1)

    weight = columns(still, still)
    coriolis = model.kernel("coriolis", base=True)
    terms = {
        "gravity": np.stack([_flat(model.kernel("gravity", base=True)(q, unit)) for unit in units], axis=1),
        "Coriolis and centripetal": np.stack([_flat(coriolis(q, dq, unit)) for unit in units], axis=1),
        "inertia": columns(still, ddq) - weight,
    }
    feasible_set = FeasibleSet(model, "full")
    result = {}
    for name, regressor in terms.items():
        torques = regressor @ base
        gram = regressor.T @ regressor / float(torques @ torques)
        scale = float(np.trace(gram)) / len(base)
        found = correct(feasible_set, base=base, metric=gram + 1e-12 * scale * np.eye(len(base)))
        result[name] = float(np.linalg.norm(regressor @ (base - found.base)) / np.linalg.norm(torques))
    return result


def _batch(subject: Subject, bases: Sequence[Array], starts: Array) -> tuple[Array, Array]:
    """Return parameters and starts of runs: every base from every start."""
    return np.repeat(np.array(bases), len(starts), axis=0), np.tile(starts, (len(bases), 1))


def _each(function: Callable[..., Array], bases: Sequence[Array], *arguments: Array) -> Array:
    """Evaluate a kernel for every run of `_batch`, whose rows share a base."""
    parts = zip(bases, *(np.split(a, len(bases)) for a in arguments), strict=True)
    return np.concatenate([np.asarray(function(*rest, base)) for base, *rest in parts])


def released(subject: Subject, bases: Sequence[Array], starts: Array, duration: float) -> SimulationResult:
    """Let arms with these base parameters fall from rest, with motors and friction off: energy is conserved."""
    rigid = np.array([not text.startswith("F") for text in subject.model.base_parameters().expressions])
    parameters, q = _batch(subject, [base * rigid for base in bases], starts)
    return simulate(
        subject.model,
        parameters,
        q,
        np.zeros_like(q),
        duration,
        base=True,
        rate=100.0,
        method="dormand_prince",
        relative_tolerance=1e-6,
        absolute_tolerance=1e-8,
    )


def hangs_unstably(subject: Subject, base: Array) -> bool:
    """Return whether an arm with these base parameters leaves the configuration in which its weight lies lowest.

    Small motions about it obey ``M ddq + K dq = 0`` with the gradient K of the gravity torques, which has no negative
    eigenvalue there; they grow where M⁻¹ K has one that is negative or complex.
    """
    model = subject.model
    potential, gravity = (model.kernel(name, base=True) for name in ("potential_energy", "gravity"))

    def height(q: Array) -> float:
        return float(_flat(potential(q[None], base))[0])

    def slope(q: Array) -> Array:
        return _flat(gravity(q[None], base))

    found: Any = minimize(height, np.full(model.dof, 0.1), jac=slope, method="BFGS")
    steps = 1e-5 * np.eye(model.dof)
    stiffness = np.stack(
        [_flat(gravity((found.x + s)[None], base) - gravity((found.x - s)[None], base)) for s in steps]
    )
    stiffness = (stiffness + stiffness.T) / 4e-5
    modes = np.linalg.eigvals(np.linalg.solve(_matrices(model, found.x[None], base)[0], stiffness))
    largest = float(np.abs(modes).max())
    return bool(np.any(modes.real < -1e-6 * largest) or np.any(np.abs(modes.imag) > 1e-6 * largest))


def _without_friction(subject: Subject) -> Array:
    """Return the true base parameters with friction and offsets left out."""
    rigid = np.array([not text.startswith("F") for text in subject.model.base_parameters().expressions])
    return np.asarray(subject.base * rigid)


def _largest_inertia(subject: Subject, starts: Array) -> Array:
    """Return the mean inertia of each joint of the true arm, (N,)."""
    return np.asarray(np.mean(np.diagonal(_matrices(subject.model, starts, subject.base), axis1=1, axis2=2), axis=0))


def guided(subject: Subject, bases: Sequence[Array], starts: Array, duration: float) -> SimulationResult:
    """Carry the true arm, its friction left out, by the gravity torques of these base parameters, with damping.

    The damping of a joint is its mean inertia, a second.
    """
    _, q = _batch(subject, bases, starts)
    gravity = subject.model.kernel("gravity", base=True)
    damping = _largest_inertia(subject, starts)
    plant = np.tile(_without_friction(subject), (len(q), 1))

    def torque(t: Array, positions: Array, velocities: Array) -> Array:
        return _each(gravity, bases, positions).reshape(positions.shape) - damping * velocities

    return _controlled(subject, plant, q, duration, torque)


def held(subject: Subject, bases: Sequence[Array], starts: Array, duration: float) -> SimulationResult:
    """Hold the true arm, its friction left out, 0.05 rad from where it starts by computed torque with these parameters.

    ``tau = M a + C dq + g`` with ``a = 100 e - 20 dq``: critically damped if the parameters are the true ones.
    """
    _, q = _batch(subject, bases, starts)
    model = subject.model
    n = model.dof
    matrix, bias = model.kernel("total_inertia_matrix", base=True), model.kernel("coriolis", base=True)
    gravity = model.kernel("gravity", base=True)
    plant = np.tile(_without_friction(subject), (len(q), 1))
    goal = q + 0.05

    def torque(t: Array, positions: Array, velocities: Array) -> Array:
        wanted = 100.0 * (goal - positions) - 20.0 * velocities
        matrices = _each(matrix, bases, positions).reshape(-1, n, n)
        carried = _each(bias, bases, positions, velocities) + _each(gravity, bases, positions)
        return (matrices @ wanted[..., None])[..., 0] + carried.reshape(positions.shape)

    return _controlled(subject, plant, q, duration, torque)


def _controlled(
    subject: Subject, plant: Array, q: Array, duration: float, torque: Callable[[Array, Array, Array], Array]
) -> SimulationResult:
    return simulate(
        subject.model,
        plant,
        q,
        np.zeros_like(q),
        duration,
        torque,
        base=True,
        rate=50.0,
        method="runge_kutta_4",
        step=2e-3,
        sample_time=2e-3,
        stopping_conditions=StoppingConditions(velocity=_LARGEST_SPEED),
    )
