"""Impedance control: the tool responds to forces as a chosen mass, damper and spring (thesis section 2.4.3)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.simulation import Measurement

from .poses import PoseTarget
from .sampled_loop import Feedback
from .task_dynamics import applied
from .task_space import TaskControl, TaskOptions, symmetric_gains
from .tool import ForceSensing, Tool

__all__ = ["ImpedanceControl"]

Array = NDArray[np.float64]


class ImpedanceControl(TaskControl):
    """Makes the tool respond to external forces with a chosen impedance (thesis eq. 2.35 to 2.39; Hogan 1985).

    With a force sensor and a desired `inertia` A, the deviation e of the tool from its reference obeys
    ``A e'' + D e' + K e = mu_e``: the measured force is compensated, and acts through the desired inertia instead.

    Without `inertia` no force sensor is read, and the deviation obeys ``A(q) e'' + D e' + K e = mu_e`` with the natural
    inertia A(q) of the arm at its tool. This needs a less accurate model, and the loop stays passive, which may be lost
    with a desired inertia far below the natural one.

    Parameters
    ----------
    model : Model
    parameters : array_like
        (n,), or (n_b,) with `base`.
    tool : Tool
    reference : object
        As in :class:`TaskSpaceControl`.
    stiffness, damping : array_like
        A number, one number for each axis, or a symmetric matrix (k, k): N/m and N·m/rad, N·s/m and N·m·s/rad.
    inertia : array_like, optional
        Desired inertia, in the same forms and positive definite, kg and kg·m².
    frame : {"base", "target"}
        The frame whose axes stiffness, damping and inertia refer to; ``"target"`` needs a task of whole poses,
        positions or orientations.
    axes
        As in :class:`TaskSpaceControl`.

    Other Parameters
    ----------------
    null_space, base, compensate_drives, sign_width, largest_mass, length, sample_time, velocity : optional
        As in :class:`TaskSpaceControl`.

    Attributes
    ----------
    reference : PoseReference

    Raises
    ------
    InputError
        If a matrix does not fit, or, at the start, if forces are needed and not measured.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q"), (0, 1.0, 0, "q")], gravity=(0, 0, -9.81)))
    >>> delta = np.zeros(model.parameter_count)
    >>> for name, value in {"m1": 2.0, "Lzz1": 0.5, "m2": 1.0, "Lzz2": 0.2}.items():
    ...     delta[model.parameter_names.index(name)] = value
    >>> tool = Tool(model.robot.link_names[-1])
    >>> here = Measurement(t=0.0, q=np.array([0.0, np.pi / 2]))
    >>> pose = model.pose(here.q, tool.link)
    >>> pose[0, 3] += 0.01
    >>> controller = ImpedanceControl(model, delta, tool, pose, stiffness=500.0, damping=30.0, axes=("x", "y"))
    >>> controller.start(here)
    >>> controller.torque(here).round(6).tolist()  # 5 N along x, at levers of -1 m
    [-5.0, -5.0]
    """

    def __init__(
        self,
        model: Model,
        parameters: ArrayLike,
        tool: Tool,
        reference: Any,
        *,
        stiffness: ArrayLike,
        damping: ArrayLike,
        inertia: ArrayLike | None = None,
        frame: str = "base",
        axes: str | Sequence[str] = "pose",
        **options: Unpack[TaskOptions],
    ) -> None:
        super().__init__(model, parameters, tool, reference, axes, **options)
        rows = self._task.rows
        self._stiffness = symmetric_gains(stiffness, len(rows), "stiffness")
        self._damping = symmetric_gains(damping, len(rows), "damping")
        self._softness: Array | None = None
        self._sensor = ForceSensing()
        if inertia is not None:
            wanted = symmetric_gains(inertia, len(rows), "inertia", definite=True)
            self._softness = np.asarray(np.linalg.inv(wanted), dtype=np.float64)
        if frame not in ("base", "target"):
            raise InputError(f"frame must be 'base' or 'target', got {frame!r}.")
        if frame == "target" and rows not in (tuple(range(6)), (0, 1, 2), (3, 4, 5)):
            raise InputError(
                "frame='target' turns the axes of the task, which needs axes='pose', 'position' or 'orientation'."
            )
        self._turned = frame == "target"
        self._check_gains(self._part.configurations(), share=0.5)

    @property
    def sensing(self) -> bool:
        """Whether the controller reads the force at the tool."""
        return self._softness is not None

    def start(self, measurement: Measurement) -> None:
        """Forget all state and begin at this measurement."""
        super().start(measurement)
        if self.sensing:
            self._sensor.start(measurement)

    def _feedback(self, q: Array) -> Feedback:
        stiffness, damping = self._stiffness, self._damping
        if self._softness is not None:
            stiffness, damping = self._softness @ stiffness, self._softness @ damping
        if self._turned:  # the axes of the target at 0 s, because the check is for one instant
            turn = self.reference.target(0.0).pose[..., :3, :3].reshape(-1, 3, 3)[0]
            turns = np.kron(np.eye(len(stiffness) // 3), turn)
            stiffness, damping = turns @ stiffness @ turns.T, turns @ damping @ turns.T
        return self._task.feedback(q, stiffness, damping, self._null_space, forces=self._softness is None)

    def _command(self, measurement: Measurement) -> Array:
        q, dq = measurement.q, self._velocity.velocity(measurement)
        task = self._task
        state, target = task.state(q, dq), self.reference.target(measurement.t)
        error, rate = task.error(state, target), task.chosen(target.twist) - state.velocity
        acceleration = task.chosen(target.acceleration)
        null_space = self._null_space.acceleration(q, dq)
        restoring = self._in_base(self._stiffness, target, error) + self._in_base(self._damping, target, rate)
        if self._softness is None:
            return task.torque(state, task.acceleration(state, acceleration, null_space, restoring))
        force = self._sensor.wrench(measurement)
        answer = self._in_base(self._softness, target, restoring + task.chosen(force))
        torque = task.torque(state, task.acceleration(state, acceleration + answer, null_space))
        torque -= applied(np.swapaxes(state.full, -1, -2), force)
        return torque

    def _in_base(self, matrix: Array, target: PoseTarget, vector: Array) -> Array:
        """Return the product of a matrix and a vector in base axes, where the matrix may be in axes of the target."""
        if not self._turned:
            return applied(matrix, vector)
        turn = target.pose[..., :3, :3]
        halves = vector.reshape((*vector.shape[:-1], -1, 3))
        inside = (halves @ turn).reshape(vector.shape)
        outside = applied(matrix, inside).reshape(halves.shape)
        result: Array = (outside @ np.swapaxes(turn, -1, -2)).reshape(vector.shape)
        return result
