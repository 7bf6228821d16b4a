"""The dynamics at a tool: the joint accelerations and torques that a task needs (thesis section 2.4.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.files.arguments import per_joint, positive

from .model_part import ModelPart
from .poses import PoseTarget, rotation_vector
from .sampled_loop import Feedback
from .tool import Tool

__all__ = ["NullSpaceControl", "TaskDynamics", "TaskState", "applied", "task_axes"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class NullSpaceControl:
    """Joint accelerations ``stiffness (q_0 - q) - damping dq`` in the null space of a task.

    Without damping, the motions of a redundant arm that do not move its tool are not controlled: they drift.

    Attributes
    ----------
    q : array_like, optional
        (N,) joint positions to which the joints return, rad or m; needed with a stiffness.
    stiffness : array_like
        A number or (N,), 1/s².
    damping : array_like
        A number or (N,), 1/s.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")]))
    >>> NullSpaceControl([1.0], stiffness=4.0, damping=2.0).of(model).acceleration(np.zeros(1), np.ones(1)).tolist()
    [2.0]
    """

    q: ArrayLike | None = None
    stiffness: ArrayLike = 0.0
    damping: ArrayLike = 10.0

    def of(self, model: Model) -> NullSpaceControl:
        """Return a copy whose attributes are arrays, checked for a robot.

        Raises
        ------
        InputError
            If the shape of an attribute does not fit, or there is a stiffness without positions.
        """
        count = model.dof
        stiffness = per_joint(self.stiffness, count, "the null space's stiffness", finite=True)
        if self.q is None and stiffness.any():
            raise InputError("The null space has a stiffness and no positions; give it q, or leave the stiffness out.")
        rest = np.zeros(count) if self.q is None else np.array(self.q, dtype=np.float64)
        if rest.shape != (count,) or not np.isfinite(rest).all():
            raise InputError(f"The null space's q must be {count} finite numbers, got {self.q!r}.")
        return NullSpaceControl(
            rest, stiffness, per_joint(self.damping, count, "the null space's damping", finite=True)
        )

    def acceleration(self, q: Array, dq: Array) -> Array:
        """Return joint accelerations (..., N); to be called on an object that `of` returned."""
        rest, stiffness, damping = (np.asarray(a, dtype=np.float64) for a in (self.q, self.stiffness, self.damping))
        return stiffness * (rest - q) - damping * dq


_AXES = ("x", "y", "z", "rx", "ry", "rz")
# A direction in which the mobility is a smaller part of the largest one counts as unreachable, for
# instance out of the plane of a planar arm, where rounding errors leave far less than this.
_UNREACHABLE = 1e-9
_DEFAULT_MASS = 100.0  # kg, the largest mass where the tool cannot move in any configuration that was tried
_NAMED = {"pose": _AXES, "position": _AXES[:3], "orientation": _AXES[3:]}


def task_axes(axes: str | Sequence[str]) -> tuple[int, ...]:
    """Return the components of a twist that a task controls.

    Parameters
    ----------
    axes : str or sequence of str
        ``"pose"``, ``"position"``, ``"orientation"``, or some of ``"x" "y" "z" "rx" "ry" "rz"``, along and about the
        axes of the base.

    Raises
    ------
    InputError
        If an axis is something else, or comes twice.

    Examples
    --------
    >>> task_axes("position"), task_axes(("x", "rz"))
    ((0, 1, 2), (0, 5))
    """
    names = _NAMED.get(axes, (axes,)) if isinstance(axes, str) else tuple(axes)
    if not names or len(set(names)) < len(names) or not set(names) <= set(_AXES):
        raise InputError(
            f"axes must be 'pose', 'position', 'orientation' or some of {', '.join(_AXES)}, each once, got {axes!r}."
        )
    return tuple(_AXES.index(name) for name in names)


def applied(matrix: Array, vector: Array) -> Array:
    """Return the products of matrices (..., m, n) and vectors (..., n)."""
    if vector.ndim == 1:
        return matrix @ vector
    result: Array = (matrix @ vector[..., None])[..., 0]
    return result


@dataclass(frozen=True, eq=False)
class TaskState:
    """Kinematics and dynamics of the tool at one instant.

    Attributes
    ----------
    q, dq : ndarray
        (..., N).
    pose : ndarray
        (..., 4, 4).
    full : ndarray
        (..., 6, N) Jacobian, base frame, linear rows first.
    jacobian : ndarray
        (..., k, N) rows of the Jacobian that the task controls.
    drift : ndarray
        (..., k) acceleration of the tool at zero joint accelerations, ``dJ/dt dq``.
    lever : ndarray
        (..., N, k) ``M^-1 J'``.
    inertia : ndarray
        (..., k, k) A of thesis eq. 2.29: ``(J M^-1 J')^-1``, reduced near singularities.
    velocity : ndarray
        (..., k) ``J dq``.
    """

    q: Array
    dq: Array
    pose: Array
    full: Array
    jacobian: Array
    drift: Array
    lever: Array
    inertia: Array
    velocity: Array


class TaskDynamics:
    """Pose, Jacobian and inertia of a tool, and the joint torques for a desired motion of the tool.

    Near a singularity the apparent inertia of a direction grows without bound. The directions are the eigenvectors of
    ``J M^-1 J'``, with rotations weighted by `length`. Where the apparent mass of a direction exceeds `largest_mass`,
    the inertia that turns accelerations into forces falls smoothly to zero, so that the task demands nothing that the
    robot cannot do, and the null-space motion applies there instead. In all other directions nothing is changed.

    By default `largest_mass` is five times the lower quartile, over random configurations, of the apparent mass in the
    heaviest direction, so that it takes effect only in configurations that are far closer to a singularity than common
    ones.

    Parameters
    ----------
    part : ModelPart
        The model with the functions of :meth:`needed`.
    tool : Tool
    axes : str or sequence of str
        See :func:`task_axes`.
    compensate_drives : bool
        Whether inertia and torques include rotors, friction and the like.
    largest_mass : float, optional
        kg.
    length : float
        Lever arm by which a moment of inertia is compared with a mass, m.

    Attributes
    ----------
    part : ModelPart
    rows : tuple of int
        Components of a twist that the task controls.
    largest_mass : float
        kg.

    Raises
    ------
    InputError
        If the task has more axes than the robot has joints.
    """

    def __init__(
        self,
        part: ModelPart,
        tool: Tool,
        axes: str | Sequence[str],
        *,
        compensate_drives: bool = False,
        largest_mass: float | None = None,
        length: float = 0.3,
    ) -> None:
        self.part = part
        self._tool = tool
        self.rows = task_axes(axes)
        if len(self.rows) > part.dof:
            raise InputError(
                f"A task of {len(self.rows)} axes is too much for {part.model.robot.name} with {part.dof} "
                "joints; name fewer axes, such as axes='position'."
            )
        self._chosen = slice(None) if self.rows == tuple(range(6)) else list(self.rows)  # a slice copies nothing
        self._compensates = compensate_drives
        self._matrix, self._torque, *_ = self.needed(tool, compensate_drives)
        weights = np.array([1.0, 1.0, 1.0, *[positive(length, "length", "m")] * 3])[list(self.rows)]
        self._squares = np.outer(weights, weights)
        self.largest_mass = (
            self._default_largest_mass() if largest_mass is None else positive(largest_mass, "largest_mass", "kg")
        )
        self._least = 1.0 / self.largest_mass

    @staticmethod
    def needed(tool: Tool, compensate_drives: bool = False) -> tuple[str, ...]:
        """Return the names of the model functions that are called."""
        dynamics = (
            ("total_inertia_matrix", "inverse_dynamics") if compensate_drives else ("inertia_matrix", "computed_torque")
        )
        return (*dynamics, tool.pose, tool.jacobian, tool.jacobian_rate)

    def _default_largest_mass(self) -> float:
        """Return five times the lower quartile, over random configurations, of the mass in the heaviest direction."""
        count = self.part.dof
        q = self.part.configurations()
        jacobian = self.chosen_rows(self.part.matrix(self._tool.jacobian, (6, count), q))
        matrix = self.part.matrix(self._matrix, (count, count), q)
        mobility = jacobian @ np.linalg.pinv(matrix, hermitian=True) @ np.swapaxes(jacobian, -1, -2)
        values = np.linalg.eigvalsh(mobility * self._squares)
        values = np.where(values > _UNREACHABLE * values[:, -1:], values, np.inf)
        least = values.min(axis=-1)
        least = least[np.isfinite(least) & (least > 0.0)]
        return 5.0 / float(np.quantile(least, 0.75)) if len(least) else _DEFAULT_MASS

    def chosen_rows(self, jacobian: Array) -> Array:
        """Return the controlled rows (..., k, N) of a Jacobian (..., 6, N)."""
        return jacobian[..., self._chosen, :]

    def state(self, q: Array, dq: Array) -> TaskState:
        """Compute kinematics and dynamics of the tool.

        Parameters
        ----------
        q, dq : ndarray
            (..., N).
        """
        count = self.part.dof
        pose = self.pose(q)
        full = self.part.matrix(self._tool.jacobian, (6, count), q)
        rate = self.part.matrix(self._tool.jacobian_rate, (6, count), q, dq)
        matrix = self.part.matrix(self._matrix, (count, count), q)
        drift = self.chosen(applied(rate, dq))
        jacobian = self.chosen_rows(full)
        lever = _solved(matrix, np.swapaxes(jacobian, -1, -2))
        mobility: Array = jacobian @ lever
        return TaskState(q, dq, pose, full, jacobian, drift, lever, self._inverse(mobility), applied(jacobian, dq))

    def pose(self, q: Array) -> Array:
        """Return the pose of the tool (..., 4, 4) in the base frame."""
        return self.part.matrix(self._tool.pose, (4, 4), q) @ self._tool.placement

    def error(self, state: TaskState, target: PoseTarget) -> Array:
        """Return displacement (m) and rotation vector (rad) from the tool to its target (..., k), base axes."""
        displacement = target.pose[..., :3, 3] - state.pose[..., :3, 3]
        if max(self.rows) < 3:
            return self.chosen(displacement)
        rotation = target.pose[..., :3, :3] @ np.swapaxes(state.pose[..., :3, :3], -1, -2)
        return self.chosen(np.concatenate((displacement, rotation_vector(rotation)), axis=-1))

    def chosen(self, values: Array) -> Array:
        """Return the controlled components (..., k) of vectors (..., 6); (..., 3) are enough for positions."""
        return values[..., self._chosen]

    def acceleration(self, state: TaskState, wanted: Array, null_space: Array, force: Array | float = 0.0) -> Array:
        """Return joint accelerations that give the tool a desired acceleration.

        Among all such accelerations they are closest, in the metric of the inertia matrix, to those of `null_space`:
        the generalised inverse of thesis eq. 2.30, ``ddq = J+ (a - dJ/dt dq) + (I - J+ J) null_space``.

        Parameters
        ----------
        state : TaskState
        wanted : ndarray
            (..., k) desired acceleration of the tool.
        null_space : ndarray
            (..., N) desired joint accelerations in the null space.
        force : ndarray
            (..., k) additional force on the tool, N and N·m.

        Returns
        -------
        ndarray
            (..., N).
        """
        asked = wanted - state.drift - applied(state.jacobian, null_space)
        return null_space + applied(state.lever, applied(state.inertia, asked) + force)

    def feedback(
        self, q: Array, stiffness: Array, damping: Array, null_space: NullSpaceControl, *, forces: bool = False
    ) -> Feedback:
        """Return the feedback of joint errors near rest that a feedback of the tool's error and velocity amounts to.

        Parameters
        ----------
        q : ndarray
            (P, N).
        stiffness, damping : ndarray
            (k, k) or (P, k, k): 1/s² and 1/s, or with `forces` N/m and N·s/m.
        null_space : NullSpaceControl
            As `of` returned it.
        forces : bool
            Whether the gains give forces at the tool, instead of accelerations.
        """
        state, matrix = self.state(q, 0.0 * q), self.part.nominal(self._matrix, q)
        back = np.swapaxes(state.jacobian, -1, -2)
        pressed = back if forces else matrix @ state.lever @ state.inertia
        rest = matrix - matrix @ state.lever @ state.inertia @ state.jacobian
        own = (np.asarray(x, dtype=np.float64) for x in (null_space.stiffness, null_space.damping))
        holds, damps = (
            pressed @ gains @ state.jacobian + rest * free
            for gains, free in zip((stiffness, damping), own, strict=True)
        )
        if self._compensates:  # compensation of friction cancels its damping
            damps = damps - self.part.resistance(q)[1]
        return Feedback(holds, damps)

    def torque(self, state: TaskState, acceleration: Array) -> Array:
        """Return the joint torques (..., N) for joint accelerations."""
        return self.part(self._torque, state.q, state.dq, acceleration)

    def _inverse(self, mobility: Array) -> Array:
        """Invert J M^-1 J', with a smooth fall to zero in directions whose apparent mass is above the largest."""
        weighed = mobility * self._squares
        sound = np.asarray(np.isfinite(weighed).all(axis=(-1, -2)))
        if not sound.all():  # a run that diverged stays NaN, and does not stop the others
            weighed = np.where(sound[..., None, None], weighed, np.eye(len(self.rows)))
        values, vectors = np.linalg.eigh(weighed)
        share = values / self._least
        if (share >= 1.0).all():
            inverse = 1.0 / values
        else:
            # 1/x has the value and the slope of x (3 - 2 x) at x = 1.
            below = np.clip(share, 0.0, 1.0)
            inverse = np.where(share < 1.0, below * (3.0 - 2.0 * below) / self._least, 1.0 / np.maximum(values, 1e-300))
        result: Array = (vectors * inverse[..., None, :]) @ np.swapaxes(vectors, -1, -2) * self._squares
        return result if sound.all() else np.where(sound[..., None, None], result, np.nan)


def _solved(matrix: Array, right: Array) -> Array:
    """Solve linear equations; an exactly singular matrix, which impossible parameters may give, has NaN as solution."""
    try:
        return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    except np.linalg.LinAlgError:
        regular = np.asarray(np.linalg.cond(matrix))[..., None, None] < 1.0 / np.finfo(np.float64).eps
        safe = np.where(regular, matrix, np.eye(matrix.shape[-1]))
        return np.where(regular, np.linalg.solve(safe, right), np.nan)
