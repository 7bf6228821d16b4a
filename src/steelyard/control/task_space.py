"""Computed torque in task space (thesis section 2.4.2), and the base class of the controllers of a tool."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.simulation import Measurement

from .block import ControlBlock
from .model_part import ModelPart
from .poses import pose_reference
from .sampled_loop import Feedback
from .task_dynamics import NullSpaceControl, TaskDynamics, applied
from .tool import ForceSensing, Tool
from .velocities import VelocityEstimator

__all__ = ["TaskControl", "TaskOptions", "TaskSpaceControl", "symmetric_gains"]

Array = NDArray[np.float64]


class TaskOptions(TypedDict, total=False):
    """The options that every controller of a tool takes by keyword; :class:`TaskSpaceControl` documents them."""

    null_space: NullSpaceControl | None
    base: bool
    compensate_drives: bool
    sign_width: float
    largest_mass: float | None
    length: float
    sample_time: float
    velocity: VelocityEstimator | None


class TaskControl(ControlBlock):
    """Base class of the controllers of a tool: the dynamics at the tool, its reference, and the null-space motion.

    Parameters
    ----------
    model, parameters, tool, reference, axes
        As in :class:`TaskSpaceControl`.
    null_space, base, compensate_drives, sign_width, largest_mass, length, sample_time, velocity
        The `TaskOptions`, with their defaults; as in :class:`TaskSpaceControl`.

    Attributes
    ----------
    reference : PoseReference
    """

    def __init__(
        self,
        model: Model,
        parameters: ArrayLike,
        tool: Tool,
        reference: Any,
        axes: str | Sequence[str],
        *,
        null_space: NullSpaceControl | None = None,
        base: bool = False,
        compensate_drives: bool = False,
        sign_width: float = 0.01,
        largest_mass: float | None = None,
        length: float = 0.3,
        sample_time: float = 0.001,
        velocity: VelocityEstimator | None = None,
    ) -> None:
        functions = TaskDynamics.needed(tool, compensate_drives)
        width = sign_width if compensate_drives else 0.0
        part = ModelPart(model, parameters, functions, base=base, point=tool.point, sign_width=width)
        super().__init__(part, sample_time, velocity)
        self._task = TaskDynamics(
            part, tool, axes, compensate_drives=compensate_drives, largest_mass=largest_mass, length=length
        )
        self.reference = pose_reference(reference)
        self._null_space = (NullSpaceControl() if null_space is None else null_space).of(model)


class TaskSpaceControl(TaskControl):
    """Linearises the robot at its tool and tracks a motion of it (thesis eq. 2.28 to 2.34).

    The commanded acceleration of the tool is ``a = d²x_r/dt² + Kd (dx_r/dt - dx/dt) + Kp e``, where e is the
    displacement and the rotation vector to the target. Joint accelerations come from the dynamically consistent inverse
    (eq. 2.30), torques from the model: ``tau = M ddq + C dq + g (+ h) (- J' force)``. These are eq. 2.31 and 2.33, with
    one difference: gravity and Coriolis torques are also compensated in the null space of the task, where eq. 2.31
    leaves them uncompensated.

    With the robot's true parameters and `compensate_drives`, the tool obeys ``d²x/dt² = a`` (eq. 2.34) away from
    singularities. Near a singularity, the command along directions that cannot be reached falls to zero, see
    :class:`TaskDynamics`.

    Parameters
    ----------
    model : Model
    parameters : array_like
        (n,), or (n_b,) with `base`.
    tool : Tool
    reference : object
        A pose (4, 4) in the base frame, a :class:`PoseTrajectory`, or a function from a time to pose, twist and its
        derivative.
    kp, kd : array_like
        A number, one number for each axis, or a symmetric matrix, 1/s² and 1/s.
    axes : str or sequence of str
        ``"pose"``, ``"position"``, ``"orientation"``, or some of ``"x" "y" "z" "rx" "ry" "rz"`` (base frame).
    sensing : bool
        Whether the measured force of the environment is compensated, ``mu_e`` of eq. 2.33.

    Other Parameters
    ----------------
    null_space : NullSpaceControl, optional
        Motion of a redundant arm in the null space of the task; damping by default.
    base, compensate_drives : bool
        Whether `parameters` are base parameters; whether friction and rotors are compensated.
    sign_width : float
        See :class:`ComputedTorque`.
    largest_mass, length : float, optional
        Limit of the apparent mass near singularities, kg, and the lever arm by which moments of inertia are compared
        with it, m; see :class:`TaskDynamics`.
    sample_time : float
        s.
    velocity : VelocityEstimator, optional
        How velocities are obtained; by numerical differences by default.

    Attributes
    ----------
    reference : PoseReference

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q"), (0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> delta = np.zeros(model.parameter_count)
    >>> for name, value in {"m1": 2.0, "Lzz1": 0.5, "m2": 1.0, "Lzz2": 0.2}.items():
    ...     delta[model.parameter_names.index(name)] = value
    >>> tool = Tool(model.robot.link_names[-1])
    >>> here = Measurement(t=0.0, q=np.array([0.3, 0.9]))
    >>> pose = model.pose(here.q, tool.link)
    >>> controller = TaskSpaceControl(model, delta, tool, pose, kp=100.0, kd=20.0, axes=("x", "y"))
    >>> controller.start(here)
    >>> bool(np.allclose(controller.torque(here), model.gravity(here.q, delta)))
    True
    """

    def __init__(
        self,
        model: Model,
        parameters: ArrayLike,
        tool: Tool,
        reference: Any,
        *,
        kp: ArrayLike,
        kd: ArrayLike,
        axes: str | Sequence[str] = "pose",
        sensing: bool = False,
        **options: Unpack[TaskOptions],
    ) -> None:
        super().__init__(model, parameters, tool, reference, axes, **options)
        self._kp = symmetric_gains(kp, len(self._task.rows), "kp")
        self._kd = symmetric_gains(kd, len(self._task.rows), "kd")
        self._sensing = ForceSensing() if sensing else None
        self._check_gains(self._part.configurations(), share=0.5)

    def start(self, measurement: Measurement) -> None:
        """Forget all state and begin at this measurement."""
        super().start(measurement)
        if self._sensing is not None:
            self._sensing.start(measurement)

    def _feedback(self, q: Array) -> Feedback:
        return self._task.feedback(q, self._kp, self._kd, self._null_space)

    def _command(self, measurement: Measurement) -> Array:
        q, dq = measurement.q, self._velocity.velocity(measurement)
        task = self._task
        state = task.state(q, dq)
        target = self.reference.target(measurement.t)
        wanted = task.chosen(target.acceleration) + applied(self._kp, task.error(state, target))
        wanted = wanted + applied(self._kd, task.chosen(target.twist) - state.velocity)
        torque = task.torque(state, task.acceleration(state, wanted, self._null_space.acceleration(q, dq)))
        if self._sensing is not None:
            torque -= applied(np.swapaxes(state.full, -1, -2), self._sensing.wrench(measurement))
        return torque


def symmetric_gains(values: ArrayLike, count: int, name: str, *, definite: bool = False) -> Array:
    """Return gains in task space as a symmetric matrix.

    Parameters
    ----------
    values : array_like
        A number, (k,) for a diagonal, or a symmetric (k, k) matrix.
    count : int
        k.
    name : str
        What the gains are called in messages.
    definite : bool
        Whether the matrix must be positive definite, instead of semidefinite.

    Returns
    -------
    ndarray
        (k, k).

    Raises
    ------
    InputError
        If the shape is another one, or the matrix is not symmetric, finite and positive.

    Examples
    --------
    >>> symmetric_gains([1.0, 2.0], 2, "stiffness").tolist()
    [[1.0, 0.0], [0.0, 2.0]]
    """
    try:
        gains = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be numbers, got {values!r}.") from None
    if gains.shape not in ((), (count,), (count, count)):
        raise InputError(
            f"{name} must be one number, {count} numbers or a {count} x {count} matrix, one row for each axis of the "
            f"task, got shape {gains.shape}."
        )
    matrix = gains if gains.ndim == 2 else np.diag(np.broadcast_to(gains, (count,)))
    if not np.isfinite(matrix).all() or not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
        raise InputError(f"{name} must be finite and symmetric, got {gains.tolist()}.")
    values_, scale = np.linalg.eigvalsh(matrix), float(np.abs(matrix).max(initial=0.0))
    if (values_.min() <= 0.0) if definite else (values_.min() < -1e-9 * scale):
        word = "definite" if definite else "semidefinite"
        raise InputError(f"{name} must be positive {word}; its smallest eigenvalue is {values_.min():.3g}.")
    return np.array(matrix)
