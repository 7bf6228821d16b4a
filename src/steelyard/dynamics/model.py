"""The dynamic model of a robot: compiled functions of motion and parameters."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.graph import Kernel
from steelyard.robot import Robot, RobotFile

from . import kinematics
from .base_parameters import BaseParameters, base_parameters_of
from .conditions import ModelCondition, model_conditions
from .functions import BaseColumns, CompiledFunctions
from .layout import ParameterLayout
from .terms import term_from_dict

__all__ = ["Model"]

Array = NDArray[np.float64]


class Model:
    """The dynamic model of a robot, linear in its parameters: ``H(q, dq, ddq) delta = tau`` (thesis eq. 2.22).

    Functions take one sample or any batch: arrays of positions, velocities and accelerations with shape (..., N).
    They are compiled for the robot at their first use.

    Parameters
    ----------
    robot : Robot
        With its terms.

    Examples
    --------
    >>> import numpy as np
    >>> import steelyard as sy
    >>> pendulum = sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)).with_terms(sy.Viscous())
    >>> model = sy.Model(pendulum)
    >>> delta = np.zeros(model.parameter_count)
    >>> delta[model.parameter_names.index("m1")] = 2.0
    >>> bool(np.isclose(model.inverse_dynamics([0.0], [0.0], [0.0], delta)[0], 2.0 * 9.81 * 1.0))
    True
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._layout = ParameterLayout(robot)
        self._functions = CompiledFunctions(self._layout)

    def __repr__(self) -> str:
        return f"Model({self.robot.name}: {self.robot.dof} joints, {self.parameter_count} parameters)"

    @classmethod
    def load(cls, path: str | Path) -> Model:
        """Read a model from a ``robot.toml`` (description and terms) or a URDF (links, friction and offset).

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        Model

        Raises
        ------
        InputError
            If the file, the description or a term cannot be used.
        """
        return cls.from_file(RobotFile.load(path))

    @classmethod
    def from_file(cls, file: RobotFile) -> Model:
        """Build the model that a robot file describes."""
        terms = [term_from_dict(t, f"{file.path}: [[terms]] number {i + 1}") for i, t in enumerate(file.terms)]
        return cls(file.robot.with_terms(*terms) if terms else file.robot)

    @property
    def joint_count(self) -> int:
        """Number N of joints."""
        return self.robot.dof

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the n parameters: for each link ten, then those of the terms at its joint (thesis eq. 4.13)."""
        return self._layout.names

    @property
    def parameter_count(self) -> int:
        """Number n of parameters."""
        return len(self.parameter_names)

    # Functions of motion and parameters

    def inverse_dynamics(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, parameters: ArrayLike) -> Array:
        """Return the joint torques (..., N), N·m or N, of links and terms.

        Parameters
        ----------
        q, dq, ddq : array_like
            (..., N): rad or m, and per s, per s².
        parameters : array_like
            (n,) in the order of `parameter_names`.

        Returns
        -------
        ndarray
        """
        return self._evaluate("inverse_dynamics", (q, dq, ddq), parameters)

    def gravity(self, q: ArrayLike, parameters: ArrayLike) -> Array:
        """Return the torques (..., N) that hold the links still, ``g(q)`` of thesis eq. 2.7."""
        return self._evaluate("gravity", (q,), parameters)

    def coriolis(self, q: ArrayLike, dq: ArrayLike, parameters: ArrayLike) -> Array:
        """Return the Coriolis and centripetal torques (..., N), ``C(q, dq) dq`` of thesis eq. 2.8."""
        return self._evaluate("coriolis", (q, dq), parameters)

    def coriolis_matrix(self, q: ArrayLike, dq: ArrayLike, parameters: ArrayLike) -> Array:
        """Return C(q, dq) (..., N, N) with the Christoffel symbols: ``dM/dt - 2 C`` is skew-symmetric."""
        flat = self._evaluate("coriolis_matrix", (q, dq), parameters)
        return flat.reshape((*flat.shape[:-1], self.joint_count, self.joint_count))

    def drive_torque(self, dq: ArrayLike, ddq: ArrayLike, parameters: ArrayLike, q: ArrayLike | None = None) -> Array:
        """Return the torques (..., N) of all the terms, ``h`` of thesis eq. 2.9; `q` matters to springs only."""
        return self._evaluate("drive_torque", (np.zeros_like(dq) if q is None else q, dq, ddq), parameters)

    def joint_friction(self, parameters: ArrayLike) -> tuple[Array, Array]:
        """Return viscous and Coulomb friction (N,) of each joint moving alone, all the terms together.

        Coupled motors count with what the joint feels of them. NaN where no term models friction.

        Parameters
        ----------
        parameters : array_like
            (n,).

        Returns
        -------
        damping, friction : ndarray
            (N,) each: N·m·s/rad and N·m, or N·s/m and N.
        """
        n = self.joint_count
        if not self.robot.terms:
            return np.full(n, np.nan), np.full(n, np.nan)
        still, each = np.zeros((n, n)), np.eye(n)

        def own(speed: float) -> Array:
            torques = self._drive_torque_with_numpy(
                still, speed * each, still, np.asarray(parameters, dtype=np.float64)
            )
            return np.diagonal(torques).copy()

        forward, backward, faster = own(1.0), own(-1.0), own(2.0)
        damping = faster - forward
        return damping, 0.5 * (forward - backward) - damping

    def inertia_matrix(self, q: ArrayLike, parameters: ArrayLike) -> Array:
        """Return the inertia matrix of the links M(q) (..., N, N) of thesis eq. 2.7."""
        flat = self._evaluate("inertia_matrix", (q,), parameters)
        n = self.joint_count
        rows, columns = np.tril_indices(n)
        matrix = np.empty((*flat.shape[:-1], n, n))
        matrix[..., rows, columns] = flat
        matrix[..., columns, rows] = flat
        return matrix

    def regressor(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Return H(q, dq, ddq) (..., N, n) of thesis eq. 2.22."""
        n, count = self.joint_count, self.parameter_count
        if not self._functions.regressor_is_sparse:
            return self._evaluate("regressor", (q, dq, ddq)).reshape((*np.shape(q)[:-1], n, count))
        entries = sorted(self._functions.regressor_nodes)
        flat = self._evaluate("regressor", (q, dq, ddq))
        result = np.zeros((*flat.shape[:-1], n, count))
        result[..., [e[0] for e in entries], [e[1] for e in entries]] = flat
        return result

    def forward_dynamics(self, q: ArrayLike, dq: ArrayLike, tau: ArrayLike, parameters: ArrayLike) -> Array:
        """Return the accelerations (..., N) that joint torques cause, thesis eq. 5.1.

        Parameters
        ----------
        q, dq, tau : array_like
            (..., N).
        parameters : array_like
            (n,).

        Returns
        -------
        ndarray
            rad/s² or m/s².

        Raises
        ------
        InputError
            If the inertia matrix is singular at some sample: such parameters are not physically possible.
        """
        (q, dq, tau), shape = self._motion((q, dq, tau))
        still = np.zeros_like(q)
        rest = tau - self.inverse_dynamics(q, dq, still, parameters)
        matrix = self.inertia_matrix(q, parameters)
        # What terms add per acceleration (rotors): they are linear in it.
        base = self.drive_torque(dq, still, parameters, q)
        for k, unit in enumerate(np.eye(self.joint_count)):
            matrix[:, :, k] += self.drive_torque(dq, np.broadcast_to(unit, q.shape), parameters, q) - base
        try:
            acceleration = np.asarray(np.linalg.solve(matrix, rest[..., None])[..., 0], dtype=np.float64)
        except np.linalg.LinAlgError:
            raise InputError(
                f"The inertia matrix of {self.robot.name} is singular with these parameters; "
                "steelyard.check tells which link is not physically possible."
            ) from None
        return acceleration.reshape((*shape, self.joint_count))

    def pose(self, q: ArrayLike, link: str | int) -> Array:
        """Return the pose of a link frame in the base frame, (..., 4, 4).

        Parameters
        ----------
        q : array_like
            (..., N).
        link : str or int
            Name or index.

        Returns
        -------
        ndarray
        """
        index = self._link_index(link)
        (q,), shape = self._motion((q,))
        return self._poses(q)[index].reshape((*shape, 4, 4))

    def jacobian(self, q: ArrayLike, link: str | int) -> Array:
        """Return the Jacobian of a link frame's origin in the base frame, (..., 6, N), linear rows first.

        Parameters
        ----------
        q : array_like
            (..., N).
        link : str or int
            Name or index.

        Returns
        -------
        ndarray
            Rows: m/rad or 1 (linear), then 1 or 0 (angular).
        """
        index = self._link_index(link)
        (q,), shape = self._motion((q,))
        poses = self._poses(q)
        origin = poses[index][:, :3, 3]
        result = np.zeros((len(q), 6, self.joint_count))
        while index >= 0:
            joint = self.robot.joints[index]
            before = np.broadcast_to(np.eye(4), poses[index].shape) if joint.parent < 0 else poses[joint.parent]
            frame = before @ np.asarray(joint.before)
            axis = joint.multiplier * frame[:, :3, 2]
            if joint.kind == "prismatic":
                result[:, :3, joint.coordinate] += axis
            else:
                result[:, :3, joint.coordinate] += np.cross(axis, origin - frame[:, :3, 3])
                result[:, 3:, joint.coordinate] += axis
            index = joint.parent
        return result.reshape((*shape, 6, self.joint_count))

    def _link_index(self, link: str | int) -> int:
        names = self.robot.link_names
        if isinstance(link, str):
            if link not in names:
                raise InputError(f"{self.robot.name} has no link {link!r}; its moving links are {', '.join(names)}.")
            return names.index(link)
        if not 0 <= link < len(names):
            raise InputError(f"{self.robot.name} has moving links 0 to {len(names) - 1}, got {link}.")
        return link

    def _poses(self, q: Array) -> list[Array]:
        """Return the poses of all link frames, (S, 4, 4) each."""
        result = []
        for turn, place in kinematics.link_poses(self.robot, list(q.T), np):
            pose = np.zeros((len(q), 4, 4))
            pose[:, 3, 3] = 1.0
            for i in range(3):
                pose[:, i, 3] = place[i]
                for j in range(3):
                    pose[:, i, j] = turn[i][j]
            result.append(pose)
        return result

    # What the model is made of

    def base_parameters(self) -> BaseParameters:
        """Return the base parameters of links and terms together (thesis section 2.5.1)."""
        return self._base

    def conditions(self, consistency: str = "full") -> tuple[ModelCondition, ...]:
        """Return the matrices that must be positive semidefinite for the parameters to be physically possible.

        Parameters
        ----------
        consistency : {"full", "inertia"}
            See :class:`steelyard.FeasibleSet`.
        """
        return model_conditions(self.robot, consistency)

    def operation_count(self, function: str, *, base: bool = False) -> dict[str, int]:
        """Count the operations of one sample of a function.

        Parameters
        ----------
        function : str
            ``"inverse_dynamics"``, ``"regressor"``, ``"inertia_matrix"``, ``"gravity"`` or ``"coriolis"``.
        base : bool
            Count the regressor of the base parameters alone.

        Returns
        -------
        dict
            See :func:`steelyard.graph.operation_count`.
        """
        if base:
            if function != "regressor":
                raise InputError(f"Operations of base parameters are counted for 'regressor', got {function!r}.")
            return self.base_columns.kernel.operation_count
        return self.kernel(function).operation_count

    def kernel(self, function: str) -> Kernel:
        """Return a compiled function, for arrays that are laid out already; see `operation_count` for the names."""
        return self._functions.kernel(function)

    @cached_property
    def base_columns(self) -> BaseColumns:
        """The kernel of the base regressor, which the regression reads joint by joint."""
        return self._functions.base_columns(self._base.independent)

    @cached_property
    def _base(self) -> BaseParameters:
        rows_wanted = 3 * self.parameter_count + 50
        count = max(20, -(-rows_wanted // self.joint_count))
        generator = np.random.default_rng(20140101)
        q = generator.uniform(-np.pi, np.pi, (count, self.joint_count))
        dq = generator.uniform(-3.0, 3.0, q.shape)
        ddq = generator.uniform(-9.0, 9.0, q.shape)
        regressor = self._regressor_with_numpy(q, dq, ddq)
        return base_parameters_of(regressor.reshape(-1, self.parameter_count), self.parameter_names)

    def _regressor_with_numpy(self, q: Array, dq: Array, ddq: Array) -> Array:
        entries = self._layout.regressor(list(q.T), list(dq.T), list(ddq.T), np)
        result = np.zeros((len(q), self.joint_count, self.parameter_count))
        for (row, column), value in entries.items():
            result[:, row, column] = value
        return result

    def _drive_torque_with_numpy(self, q: Array, dq: Array, ddq: Array, parameters: Array) -> Array:
        torques = np.zeros_like(q)
        for row, column, value in self._layout.terms(list(q.T), list(dq.T), list(ddq.T), np):
            torques[:, row] += parameters[column] * value
        return torques

    @property
    def link_columns(self) -> tuple[NDArray[np.intp], ...]:
        """For each link the indices of its ten parameters ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m``."""
        return self._layout.links

    # Shapes

    def _motion(self, arrays: Sequence[ArrayLike]) -> tuple[list[Array], tuple[int, ...]]:
        converted = [np.asarray(a, dtype=np.float64) for a in arrays]
        n = self.joint_count
        for array in converted:
            if array.ndim == 0 or array.shape[-1] != n:
                raise InputError(
                    f"{self.robot.name} has {n} joints: expected arrays of shape (..., {n}), got {array.shape}."
                )
        try:
            shape = np.broadcast_shapes(*(a.shape for a in converted))
        except ValueError:
            raise InputError(f"Motion arrays do not fit each other: {[a.shape for a in converted]}.") from None
        return [np.broadcast_to(a, shape).reshape(-1, n) for a in converted], shape[:-1]

    def _evaluate(self, function: str, motion: Sequence[ArrayLike], parameters: ArrayLike | None = None) -> Array:
        arrays, shape = self._motion(motion)
        if parameters is not None:
            vector = np.asarray(parameters, dtype=np.float64)
            if vector.shape != (self.parameter_count,):
                raise InputError(
                    f"{self.robot.name} has {self.parameter_count} parameters: "
                    f"expected shape ({self.parameter_count},), got {vector.shape}."
                )
            arrays.append(vector)
        kernel = self.kernel(function)
        return kernel(*arrays).reshape((*shape, len(kernel.outputs)))
