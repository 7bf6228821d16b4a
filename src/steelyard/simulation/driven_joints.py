"""Joints under a position controller, in time: many stretches of a motion at once, with their exact sensitivities.

What each joint feels is ``tau = Kp (command - q) - Kd dq + offset + gain signal``, less its drive's own rotor inertia,
spring, viscous and Coulomb friction. Where the drive's torque falls behind its law, ``m = Kp (command - q) - Kd dq +
gain signal``, it is ``m (1 - loss |m|)`` in the place of m, up to its greatest value, ``1 / (4 loss)``. The links'
part is that of the compiled inverse dynamics and its derivatives.

Coulomb friction may vary over a joint's travel: its values at both ends and in the middle are joined by lines. It may
grow with the load, the torque of the links, ``Fc = Fc(q) + mu |tau_links|``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.robot import Robot

__all__ = ["COULOMB", "DRIVE_PARAMETERS", "Branch", "Directions", "DrivenMotion", "FrictionLaw", "branches_of", "drive"]

Array = NDArray[np.float64]

COULOMB = ("coulomb_lower", "coulomb_middle", "coulomb_upper")
"""Coulomb friction at the lower end, in the middle and at the upper end of a joint's travel."""

DRIVE_PARAMETERS = (
    "rotor_inertia",
    "viscous",
    *COULOMB,
    "load_friction",
    "stiffness",
    "offset",
    "kp",
    "kd",
    "gain",
    "torque_loss",
    "delay",
)
"""What a drive has at each joint. Its spring is at rest in the middle of the travel."""

ITERATIONS, LOADED_ITERATIONS = 2, 4
"""The most iterations of Newton's method in a step; what centripetal torques change within a step is of order h. Where
friction grows with the load, each iteration has the load of the one before."""

TRIALS, RELAXATIONS = 3, 200
"""The most trials of Newton's method to find which joints stick, and the most sweeps of relaxation where that goes in
circles. Newton's method finds it in two trials, or not at all: with 6 the sweeps of a leg robot take a quarter more of
the processor."""


@dataclass(frozen=True)
class FrictionLaw:
    """Coulomb friction that a simulation can follow: ``clip((dq + ahead ddq) / softness, -Fc, Fc)``.

    This is the law of MuJoCo's ``frictionloss``, whose force is the minimiser of a convex problem in the accelerations
    (Todorov 2014, "Convex and analytically-invertible dynamics with contacts and constraints", eq. 6): friction looks
    `ahead` by half its time constant, and the softness is `slip` times `ahead` over the joint's inertia. The equation
    of a step is piecewise linear and monotone in the accelerations, has one solution, and sticks where the torque is
    below Fc but for a creep of ``slip ahead Fc`` over the inertia.

    Parameters
    ----------
    ahead : float
        s; 0 stands for the end of the step, which is Coulomb friction proper as far as steps of time resolve it.
    slip : float
        Softness of the constraint as a part of the joint's inverse inertia.

    Examples
    --------
    >>> law = FrictionLaw.mujoco()
    >>> round(law.ahead, 6), round(law.slip, 6)
    (0.0095, 0.111111)
    """

    ahead: float
    slip: float

    @classmethod
    def mujoco(cls, time_constant: float = 0.02, impedance: tuple[float, float] = (0.9, 0.95)) -> FrictionLaw:
        """The law of MuJoCo with its ``solreffriction`` (time constant, damping ratio 1) and ``solimpfriction``.

        Its reference acceleration is ``-2 / (dmax time_constant)`` times the velocity, and its softness ``(1 - d0) /
        d0`` of the inverse inertia.
        """
        least, most = impedance
        return cls(0.5 * most * time_constant, (1.0 - least) / least)

    @classmethod
    def coulomb(cls) -> FrictionLaw:
        """Friction that follows the velocity at the end of each step, with a softness of one hundredth."""
        return cls(0.0, 0.01)


@dataclass(frozen=True, eq=False)
class Branch:
    """Joints that move independently of all others, since their links hang on the base by themselves.

    Attributes
    ----------
    model : Model
        Of these joints alone, without terms.
    coordinates : tuple of int
        Their places among the coordinates of the robot.
    links : tuple of int
        The places of their links among those of the robot.
    """

    model: Model
    coordinates: tuple[int, ...]
    links: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number n of joints."""
        return len(self.coordinates)


def branches_of(robot: Robot) -> tuple[Branch, ...]:
    """Part a robot on a fixed base into branches.

    Raises
    ------
    InputError
        If a joint mimics another: its drive moves both, which this does not know.

    Examples
    --------
    >>> [branch.coordinates for branch in branches_of(Robot.from_dh([(0, 0.3, 0, "q"), (0, 0.3, 0, "q")]))]
    [(0, 1)]
    """
    mimic = next((joint for joint in robot.joints if joint.mimics is not None), None)
    if mimic is not None:
        raise InputError(
            f'joint "{mimic.name}" mimics "{mimic.mimics}"; drives are identified from positions without such joints: '
            "lock it in [description]."
        )
    root: list[int] = []
    for index, joint in enumerate(robot.joints):
        root.append(index if joint.parent < 0 else root[joint.parent])
    found = []
    for first in dict.fromkeys(root):
        links = [index for index, one in enumerate(root) if one == first]
        place = {link: k for k, link in enumerate(links)}
        joints = [
            replace(robot.joints[index], coordinate=k, parent=place.get(robot.joints[index].parent, -1))
            for k, index in enumerate(links)
        ]
        part = replace(
            robot,
            joints=tuple(joints),
            links=tuple(robot.links[index] for index in links),
            terms=(),
            base_attachments=(),
        )
        found.append(Branch(Model(part), tuple(robot.joints[index].coordinate for index in links), tuple(links)))
    return tuple(found)


@dataclass(frozen=True, eq=False)
class Directions:
    """The m variables by which the motion of a branch is differentiated, and the change of the simulation with each.

    Attributes
    ----------
    drives : ndarray
        (13, n, m) the drive parameters of each joint.
    encoder : ndarray
        (n, m) what encoders read more than the joints stand at.
    inertials : ndarray
        (10 n, m) the parameters of the links.
    """

    drives: Array
    encoder: Array
    inertials: Array

    @property
    def count(self) -> int:
        """The number m."""
        return int(self.drives.shape[-1])


@dataclass(frozen=True, eq=False)
class DrivenMotion:
    """The simulated motion of a batch of K stretches of L intervals, for each of B branches of n joints.

    Attributes
    ----------
    q : ndarray
        (L + 1, B, K, n) positions at the beginning of each interval, and at the end.
    dq : ndarray
        (L + 1, B, K, n) velocities there.
    by_start, by_parameters : ndarray or None
        (L + 1, B, K, n, 2 n) and (L + 1, B, K, n, m) derivatives of the positions.
    end_by_start, end_by_parameters : ndarray or None
        (B, K, 2 n, 2 n) and (B, K, 2 n, m).
    """

    q: Array
    dq: Array
    by_start: Array | None = None
    by_parameters: Array | None = None
    end_by_start: Array | None = None
    end_by_parameters: Array | None = None

    @property
    def end(self) -> Array:
        """Positions and velocities (B, K, 2 n) at the end."""
        return np.concatenate([self.q[-1], self.dq[-1]], axis=-1)


def drive(
    branches: Sequence[Branch],
    inertials: Sequence[Array],
    drives: Array,
    encoder: Array,
    travel: Array,
    start: Array,
    steps: Array,
    command: Array,
    command_by_delay: Array,
    law: FrictionLaw,
    *,
    substeps: int = 1,
    period: float = 0.0,
    directions: Sequence[Directions] | None = None,
) -> DrivenMotion:
    """Drive branches with as many joints each through a batch of stretches of time.

    A step of length h is a kick at the place of half a drift, ``q + h dq / 2``, with what depends on velocities taken
    in its middle, ``dq + h ddq / 2``: second order, and stable for stiff drives. Its accelerations solve inverse
    dynamics, and the derivatives are those of that solution by the implicit function theorem, no differences.

    Parameters
    ----------
    branches : sequence of Branch
        B of them, of n joints each.
    inertials : sequence of ndarray
        (10 n,) parameters of the links of each branch.
    drives : ndarray
        (B, 13, n) in the order of `DRIVE_PARAMETERS`; the delay is in the commands already.
    encoder : ndarray
        (B, n) by how much encoders read more than the joints stand at.
    travel : ndarray
        (B, 2, n) lower and upper end of each joint's travel, over which Coulomb friction varies.
    start : ndarray
        (B, K, 2 n) position and velocity.
    steps : ndarray
        (L, K) lengths of the intervals, s.
    command, command_by_delay : ndarray
        (L substeps, B, K, n) the mean of the delayed command in each step, and its derivative by the delay.
    law : FrictionLaw
    substeps : int
        Steps in an interval.
    period : float
        s, for which drives hold each torque that they compute; 0 where their law acts all the time.
    directions : sequence of Directions, optional
        By what the motion of each branch is differentiated, as many m each; by nothing without them.
    """
    n, parts = branches[0].count, len(branches)
    length, each = steps.shape
    joints = _Joints(branches, inertials, drives, encoder, travel, law, period, directions, each)
    count = parts * each
    flat = start.reshape(count, 2 * n)
    q, v = flat[:, :n].copy(), flat[:, n:].copy()
    a = np.zeros_like(v)
    positions = np.empty((length + 1, count, n))
    positions[0] = q
    velocities = np.empty_like(positions)
    velocities[0] = v
    cut, width = 2 * n, 0 if directions is None else directions[0].count
    changes = np.zeros((count, cut, cut + width))
    changes[:, :, :cut] = np.eye(cut)
    traces = None if directions is None else np.zeros((length + 1, count, n, cut + width))
    if traces is not None:
        traces[0] = changes[:, :n]
    for row in range(length):
        h = np.tile(steps[row] / substeps, parts)[:, np.newaxis]
        for place in range(row * substeps, (row + 1) * substeps):
            step = joints.step(h, q, v, a, command[place].reshape(count, n))
            if traces is not None:
                joints.follow(step, changes, command_by_delay[place].reshape(count, n))
            a = step.a
            v = v + h * a
            q = step.middle + 0.5 * h * v
        positions[row + 1], velocities[row + 1] = q, v
        if traces is not None:
            traces[row + 1] = changes[:, :n]
    shape = (parts, each)
    places, speeds = (part.reshape(length + 1, *shape, n) for part in (positions, velocities))
    if traces is None:
        return DrivenMotion(places, speeds)
    traced, last = traces.reshape(length + 1, *shape, n, -1), changes.reshape(*shape, cut, -1)
    return DrivenMotion(places, speeds, traced[..., :cut], traced[..., cut:], last[..., :cut], last[..., cut:])


@dataclass(eq=False)
class _Step:
    """What a step of time found for S stretches of n joints, each (S, n) but for the matrices.

    Attributes
    ----------
    h : ndarray
        (S, 1) its length.
    command, middle, stands, along
        Of the drives; the positions of encoders and joints in the middle of the step; and where that is between the
        middle of the travel and its ends, -1 to 1.
    at, a
        Velocities in the middle, and accelerations.
    torque
        Of the links.
    slips
        Signs of the joints that slip, 0 for those that stick.
    softness
        Of the friction of those that stick.
    kept, by_loss
        Which part of a change of its law a drive keeps, and the derivative of its torque by the loss.
    inertia : ndarray
        (S, n, n) by which the accelerations follow changes.
    """

    h: Array
    command: Array
    middle: Array
    stands: Array
    along: Array
    at: Array
    a: Array
    torque: Array
    slips: Array
    softness: Array
    kept: Array
    by_loss: Array
    inertia: Array


class _Joints:
    """The joints and drives of all branches, a row for each stretch: their accelerations, and how these change."""

    def __init__(
        self,
        branches: Sequence[Branch],
        inertials: Sequence[Array],
        drives: Array,
        encoder: Array,
        travel: Array,
        law: FrictionLaw,
        period: float,
        directions: Sequence[Directions] | None,
        each: int,
    ) -> None:
        n, acting = branches[0].count, _acting(period)
        own = [slice(b * each, (b + 1) * each) for b in range(len(branches))]
        self.links = list(zip(branches, inertials, own, strict=True))
        self.ahead, self.softness = law.ahead, np.empty((len(branches) * each, n))
        for (branch, values, rows), own_inertia in zip(self.links, drives[:, 0], strict=True):
            at_zero = branch.model.total_inertia_matrix(np.zeros(n), values) + np.diag(own_inertia)
            self.softness[rows] = np.diag(np.linalg.inv(at_zero)) * law.slip
        self.directions = [replace(one, drives=np.tensordot(acting, one.drives, 1)) for one in directions or ()]
        repeated = np.repeat((acting @ drives).transpose(1, 0, 2), each, axis=1)
        self.armature, viscous, *self.levels, self.load, self.stiffness, self.offset = repeated[:8]
        self.kp, self.kd, self.gain, self.loss, _ = repeated[8:]
        self.braking = viscous + self.kd
        self.has_load = bool(self.load.any()) or any(one.drives[5].any() for one in self.directions)
        self.has_loss = bool(self.loss.any()) or any(one.drives[-2].any() for one in self.directions)
        self.shift = np.repeat(encoder, each, axis=0)
        low, high = np.repeat(travel.transpose(1, 0, 2), each, axis=1)
        self.center, self.half = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-9)
        lower, level, upper = self.levels
        self.slopes = (level - lower) / self.half, (upper - level) / self.half
        self.torque = np.empty((len(branches) * each, n))
        self.derivatives = np.empty((len(branches) * each, 3, n, n))
        self.by_q, self.by_v, self.by_a = self.derivatives.swapaxes(0, 1)
        self.diagonal = np.arange(n)

    def _slope(self, along: Array) -> Array:
        """Return by how much Coulomb friction grows with the position."""
        slope: Array = np.where(along > 0.0, self.slopes[1], self.slopes[0])
        return slope

    def step(self, h: Array, q: Array, v: Array, a: Array, command: Array) -> _Step:
        """Find the accelerations of a step from positions, velocities, and the accelerations of the step before."""
        ahead = 0.5 * h if self.ahead == 0.0 else self.ahead
        reach, softness = 0.5 * h + ahead, self.softness * ahead
        middle = q + 0.5 * h * v
        stands = middle - self.shift
        along = np.clip((stands - self.center) / self.half, -1.0, 1.0)
        friction = self.levels[1] + along * self._slope(along) * self.half
        pushed = self.kp * (command - middle) + self.gain * command
        driven = pushed + self.offset - self.stiffness * (stands - self.center)
        at = v + 0.5 * h * a
        for branch, values, rows in self.links:
            branch.model.inverse_dynamics_derivatives(
                stands[rows], at[rows], a[rows], values, out=self.derivatives[rows]
            )
        smooth = self.by_a + 0.5 * h[:, :, np.newaxis] * self.by_v
        smooth[:, self.diagonal, self.diagonal] += self.armature + 0.5 * h * self.braking
        loaded, kept, by_loss, torque = friction, np.ones_like(a), np.zeros_like(a), self.torque
        for _ in range(LOADED_ITERATIONS if self.has_load or self.has_loss else ITERATIONS):
            for branch, values, rows in self.links:
                branch.model.inverse_dynamics(stands[rows], at[rows], a[rows], values, out=torque[rows])
            if self.has_load:
                loaded = friction + self.load * np.abs(torque)
            wanted = (smooth @ a[:, :, np.newaxis])[..., 0]
            wanted += driven - torque - self.armature * a - self.braking * at
            if self.has_loss:
                lost, kept, by_loss = _lost(pushed - self.kd * at, self.loss)
                wanted -= lost
            a, slips, inertia = _with_friction(smooth, wanted, v, a, reach, softness, loaded)
            before, at = at, v + 0.5 * h * a
            if np.max(np.abs(at - before)) < 1e-9:
                break
        return _Step(h, command, middle, stands, along, at, a, torque, slips, softness, kept, by_loss, inertia)

    def follow(self, step: _Step, changes: Array, command_by_delay: Array) -> None:
        """Carry the derivatives (S, 2 n, 2 n + m) of positions and velocities from the beginning of a step to its end.

        They are those by the state at the start of a stretch, then those by the variables of `directions`.
        """
        n, h3, diagonal = step.a.shape[1], step.h[:, :, np.newaxis], self.diagonal
        by_place, by_speed, inertia = self.by_q.copy(), self.by_v.copy(), step.inertia
        slips, kept, along = step.slips, step.kept, step.along
        sign = slips * np.sign(step.torque) if self.has_load else slips
        if self.has_load:  # where a joint slips, its friction follows what changes the torque of the links
            more = (self.load * sign)[:, :, np.newaxis]
            by_place += more * self.by_q
            by_speed += more * self.by_v
            inertia = inertia + more * (self.by_a + 0.5 * h3 * self.by_v)
        if self.has_loss:  # of what the law of the drive adds, it loses a part
            inertia[:, diagonal, diagonal] -= 0.5 * step.h * self.kd * (1.0 - kept)
            by_speed[:, diagonal, diagonal] -= self.kd * (1.0 - kept)
        by_place[:, diagonal, diagonal] += self.stiffness + slips * (np.abs(along) < 1.0) * self._slope(along)
        by_drives = (
            step.a,
            step.at,
            slips * np.maximum(-along, 0.0),
            slips * (1.0 - np.abs(along)),
            slips * np.maximum(along, 0.0),
            sign * step.torque,
            step.stands - self.center,
            np.full_like(step.a, -1.0),
            kept * (step.middle - step.command),
            kept * step.at,
            -kept * step.command,
            step.by_loss,
            -kept * (self.kp + self.gain) * command_by_delay,
        )
        columns = self._columns(step, by_drives, by_place, sign)
        by_place[:, diagonal, diagonal] += kept * self.kp
        by_speed[:, diagonal, diagonal] += self.braking + (slips == 0.0) / step.softness
        right = by_place @ changes[:, :n] + (by_speed + 0.5 * h3 * by_place) @ changes[:, n:]
        right[:, :, 2 * n :] += columns
        change = np.linalg.solve(inertia, right)
        changes[:, :n] += h3 * changes[:, n:] - (0.5 * h3 * h3) * change
        changes[:, n:] -= h3 * change

    def _columns(self, step: _Step, by_drives: Sequence[Array], by_place: Array, sign: Array) -> Array:
        """Return the derivatives (S, n, m) of the equation of motion by the variables of `directions`.

        `by_drives` are the derivatives (S, n) of each joint's own equation by its drive parameters, in their order.
        """
        stacked = np.stack(by_drives, axis=-1)
        found = np.empty((*stacked.shape[:2], self.directions[0].count))
        for (branch, _, rows), one in zip(self.links, self.directions, strict=True):
            found[rows] = (stacked[rows].transpose(1, 0, 2) @ one.drives.transpose(1, 0, 2)).transpose(1, 0, 2)
            if one.encoder.any():
                found[rows] -= by_place[rows] @ one.encoder
            if one.inertials.any():
                regressor = branch.model.regressor(step.stands[rows], step.at[rows], step.a[rows])
                if self.has_load:
                    regressor = regressor * (1.0 + self.load[rows] * sign[rows])[:, :, np.newaxis]
                found[rows] += regressor @ one.inertials
        return found


def _acting(period: float) -> Array:
    """Return (13, 13): from drive parameters to those with which a law that acts all the time moves a joint alike.

    A torque that is held for a period h rests on a motion that is older by s, evenly from 0 to h. On average ``q - s dq
    + s² ddq / 2`` and ``dq - s ddq`` stand in the place of q and dq: kp takes ``kp h / 2`` from what brakes, and adds
    ``kp h² / 6`` to the inertia, from which kd takes ``kd h / 2``.
    """
    inertia, kp, kd = (DRIVE_PARAMETERS.index(kind) for kind in ("rotor_inertia", "kp", "kd"))
    found = np.eye(len(DRIVE_PARAMETERS))
    found[kd, kp] = -period / 2.0
    found[inertia, kp], found[inertia, kd] = period**2 / 6.0, -period / 2.0
    return found


def _lost(law: Array, loss: Array) -> tuple[Array, Array, Array]:
    """What a drive loses of the torque of its law, which part of a change it keeps, and the derivative by the loss."""
    size = np.abs(law)
    greatest = 0.5 / np.maximum(loss, 1e-300)  # from where on the torque stays
    beyond = size >= greatest
    lost = np.where(beyond, size - 0.5 * greatest, loss * size**2)
    by_loss = np.minimum(size, greatest) ** 2
    return np.sign(law) * lost, np.where(beyond, 0.0, 1.0 - 2.0 * loss * size), np.sign(law) * by_loss


def _with_friction(
    smooth: Array, wanted: Array, v: Array, a: Array, reach: Array, soft: Array, friction: Array
) -> tuple[Array, Array, Array]:
    """Solve ``smooth a + clip((v + reach a) / soft, -Fc, Fc) = wanted`` for a: which joints stick is found by trial.

    Returns the accelerations, the signs of the joints that slip (0 for those that stick), and the matrix by which the
    accelerations follow changes.
    """
    diagonal = np.arange(v.shape[1])
    reach = np.broadcast_to(reach, v.shape)
    slips = _slipping(v, a, reach, soft, friction)
    found, inertia = np.empty_like(a), smooth.copy()
    rows, still = np.arange(len(v)), slips
    given = smooth, wanted, v, reach, soft, friction
    for trial in range(4 * TRIALS):  # of those whose trial was wrong; after the first one these are few
        sticks = still == 0.0
        matrix = given[0].copy()
        matrix[:, diagonal, diagonal] += sticks * (given[3] / given[4])
        right = given[1] - np.where(sticks, given[2] / given[4], still * given[5])
        own = np.asarray(np.linalg.solve(matrix, right[:, :, np.newaxis])[..., 0], dtype=np.float64)
        found[rows], inertia[rows] = own, matrix
        after = _slipping(given[2], own, *given[3:])
        differ = (after != still).any(axis=1)
        if not differ.any():
            break
        rows, still = rows[differ], after[differ]
        given = tuple(one[differ] for one in given)
        if trial == TRIALS:  # Newton's method may go in circles, one joint setting off another
            still = _slips_by_relaxation(*given)
        slips[rows] = still
    return found, slips, inertia


def _slips_by_relaxation(smooth: Array, wanted: Array, v: Array, reach: Array, soft: Array, friction: Array) -> Array:
    """Find which joints slip by relaxing the friction of one joint after the other, which always converges."""
    inverse = np.linalg.inv(smooth)
    free = v + reach * (inverse @ wanted[:, :, np.newaxis])[..., 0]
    force = np.clip(free / soft, -friction, friction)
    own = np.diagonal(inverse, axis1=1, axis2=2)
    for _ in range(RELAXATIONS):
        largest = 0.0
        for k in range(v.shape[1]):
            others = free[:, k] - reach[:, k] * (np.einsum("sj,sj->s", inverse[:, k], force) - own[:, k] * force[:, k])
            after = np.clip(others / (soft[:, k] + reach[:, k] * own[:, k]), -friction[:, k], friction[:, k])
            largest = max(largest, float(np.max(np.abs(after - force[:, k]))))
            force[:, k] = after
        if largest < 1e-12:
            break
    found: Array = np.where(np.abs(force) >= friction, np.sign(force), 0.0)
    return found


def _slipping(v: Array, a: Array, reach: Array, soft: Array, friction: Array) -> Array:
    ahead = (v + reach * a) / soft
    found: Array = np.where(np.abs(ahead) >= friction, np.sign(ahead), 0.0)
    return found
