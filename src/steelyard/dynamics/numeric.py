"""The functions of a model for arrays: one sample or any batch, by compiled code."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.robot import Robot

from .catalogue import forward_dynamics_function
from .evaluation import Evaluator
from .layout import ParameterLayout
from .sampling import term_torques

__all__ = ["NumericFunctions"]

Array = NDArray[np.float64]


class NumericFunctions:
    """What a :class:`steelyard.Model` computes from arrays of positions, velocities and accelerations, (..., N)."""

    robot: Robot
    _layout: ParameterLayout
    _call: Evaluator

    def inverse_dynamics(
        self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, parameters: ArrayLike, *, gravity: ArrayLike | None = None
    ) -> Array:
        """Return the joint torques (..., N), N·m or N, of links and terms.

        Parameters
        ----------
        q, dq, ddq : array_like
            (..., N): rad or m, and per s, per s².
        parameters : array_like
            (n,) in the order of `parameter_names`.
        gravity : array_like, optional
            (3,) in the base frame, m/s², in place of the robot's own; also in the functions below.

        Returns
        -------
        ndarray
        """
        return self._call("inverse_dynamics", (q, dq, ddq), parameters, gravity)

    def inverse_dynamics_derivatives(
        self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, parameters: ArrayLike, *, gravity: ArrayLike | None = None
    ) -> tuple[Array, Array, Array]:
        """Return the derivatives of the joint torques by q, dq and ddq, (..., N, N) each; row = torque.

        The derivatives by the parameters are the `regressor`. The sign of Coulomb friction counts as constant.
        """
        n = self.robot.dof
        flat = self._call("inverse_dynamics_derivatives", (q, dq, ddq), parameters, gravity)
        by_q, by_dq, by_ddq = (
            flat[..., k * n * n : (k + 1) * n * n].reshape((*flat.shape[:-1], n, n)) for k in range(3)
        )
        return by_q, by_dq, by_ddq

    def computed_torque(
        self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, parameters: ArrayLike, *, gravity: ArrayLike | None = None
    ) -> Array:
        """Return the torques (..., N) of the links alone, ``M(q) ddq + C(q, dq) dq + g(q)`` of thesis eq. 5.8."""
        return self._call("computed_torque", (q, dq, ddq), parameters, gravity)

    def gravity(self, q: ArrayLike, parameters: ArrayLike, *, gravity: ArrayLike | None = None) -> Array:
        """Return the torques (..., N) that hold the links still, ``g(q)`` of thesis eq. 2.7."""
        return self._call("gravity", (q,), parameters, gravity)

    def coriolis(self, q: ArrayLike, dq: ArrayLike, parameters: ArrayLike) -> Array:
        """Return the Coriolis and centripetal torques (..., N), ``C(q, dq) dq`` of thesis eq. 2.8."""
        return self._call("coriolis", (q, dq), parameters)

    def coriolis_matrix(self, q: ArrayLike, dq: ArrayLike, parameters: ArrayLike) -> Array:
        """Return C(q, dq) (..., N, N) with the Christoffel symbols: ``dM/dt - 2 C`` is skew-symmetric."""
        return self._call.matrix("coriolis_matrix", (q, dq), parameters)

    def drive_torque(
        self,
        dq: ArrayLike,
        ddq: ArrayLike,
        parameters: ArrayLike,
        q: ArrayLike | None = None,
        *,
        term: str | None = None,
    ) -> Array:
        """Return the torques (..., N) of all the terms, ``h`` of thesis eq. 2.9, or of one kind of term.

        Parameters
        ----------
        dq, ddq : array_like
            (..., N).
        parameters : array_like
            (n,).
        q : array_like, optional
            (..., N); matters to springs only.
        term : str, optional
            Kind of the term, such as ``"viscous"``.

        Returns
        -------
        ndarray
        """
        name = "drive_torque" if term is None else f"drive_torque({term})"
        return self._call(name, (np.zeros_like(dq) if q is None else q, dq, ddq), parameters)

    def inertia_matrix(self, q: ArrayLike, parameters: ArrayLike) -> Array:
        """Return the inertia matrix of the links M(q) (..., N, N) of thesis eq. 2.7."""
        return self._call.matrix("inertia_matrix", (q,), parameters)

    def total_inertia_matrix(self, q: ArrayLike, parameters: ArrayLike) -> Array:
        """Return the inertia matrix of links and rotors (..., N, N): the derivative of all torques by ddq."""
        return self._call.matrix("total_inertia_matrix", (q,), parameters)

    def momentum(self, q: ArrayLike, dq: ArrayLike, parameters: ArrayLike) -> Array:
        """Return the generalised momentum (..., N) of links and rotors, N·m·s or N·s."""
        return self._call("momentum", (q, dq), parameters)

    def kinetic_energy(self, q: ArrayLike, dq: ArrayLike, parameters: ArrayLike) -> Array:
        """Return the kinetic energy (...) of links and rotors, J."""
        return self._call("kinetic_energy", (q, dq), parameters)[..., 0]

    def potential_energy(self, q: ArrayLike, parameters: ArrayLike, *, gravity: ArrayLike | None = None) -> Array:
        """Return the potential energy (...), J; zero for mass at the origin of the base frame."""
        return self._call("potential_energy", (q,), parameters, gravity)[..., 0]

    def regressor(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Return H(q, dq, ddq) (..., N, n) of thesis eq. 2.22: torques are ``H delta``."""
        flat = self._call("regressor", (q, dq, ddq))
        return flat.reshape((*flat.shape[:-1], self.robot.dof, len(self._layout.names)))

    def momentum_regressor(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Return (..., N, n): times the parameters it is the generalised momentum."""
        flat = self._call("momentum_regressor", (q, dq))
        return flat.reshape((*flat.shape[:-1], self.robot.dof, len(self._layout.names)))

    def energy_regressor(self, q: ArrayLike, dq: ArrayLike) -> tuple[Array, Array]:
        """Return (..., n) for the kinetic and for the potential energy: times the parameters they are the energies.

        In base parameters (`function` with ``base=True``) the potential energy is known up to a constant.
        """
        flat = self._call("energy_regressor", (q, dq))
        return flat[..., : len(self._layout.names)], flat[..., len(self._layout.names) :]

    def forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        parameters: ArrayLike,
        *,
        method: str = "automatic",
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Return the accelerations (..., N) that joint torques cause, thesis eq. 5.1.

        Parameters
        ----------
        q, dq, tau : array_like
            (..., N).
        parameters : array_like
            (n,).
        method : {"automatic", "inertia_matrix", "articulated_body"}
            ``"inertia_matrix"`` factors M as ``L' D L``; ``"articulated_body"`` is for robots without mimic joints and
            coupled motors. ``"automatic"`` takes the latter from 9 joints on, where it can.
        gravity : array_like, optional
            (3,) in the base frame, m/s², in place of the robot's own.

        Returns
        -------
        ndarray
            rad/s² or m/s².

        Raises
        ------
        InputError
            If the inertia matrix is singular at some sample: such parameters are not physically possible.
        """
        function = forward_dynamics_function(self.robot, method)
        result = self._call(function, (q, dq, tau), parameters, gravity)
        given = all(np.isfinite(np.asarray(a, dtype=np.float64)).all() for a in (q, dq, tau, parameters))
        if given and not np.isfinite(result).all():
            raise InputError(
                f"The inertia matrix of {self.robot.name} is singular with these parameters; "
                "steelyard.check tells which link is not physically possible."
            )
        return result

    def pose(self, q: ArrayLike, link: str | int) -> Array:
        """Return the pose of a link frame in the base frame, (..., 4, 4).

        Parameters
        ----------
        q : array_like
            (..., N).
        link : str or int
            Name, of a link that is fixed to a moving one too ("tool0"), or index of a moving link.

        Returns
        -------
        ndarray
        """
        flat = self._call(f"pose({self._link_name(link)})", (q,))
        return flat.reshape((*flat.shape[:-1], 4, 4))

    def jacobian(self, q: ArrayLike, link: str | int, point: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """Return the Jacobian of a point of a link in the base frame, (..., 6, N), linear rows first.

        Parameters
        ----------
        q : array_like
            (..., N).
        link : str or int
            Name, of a link that is fixed to a moving one too ("tool0"), or index of a moving link.
        point : array_like
            (3,) in the link frame, m; the origin where not given.

        Returns
        -------
        ndarray
            Rows: m/rad or 1 (linear), then 1 or 0 (angular).
        """
        flat = self._call(f"jacobian({self._link_name(link)})", (q,), point=point)
        return flat.reshape((*flat.shape[:-1], 6, self.robot.dof))

    def jacobian_rate(self, q: ArrayLike, dq: ArrayLike, link: str | int, point: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """Return the time derivative of `jacobian` while the robot moves with `dq`, (..., 6, N)."""
        flat = self._call(f"jacobian_rate({self._link_name(link)})", (q, dq), point=point)
        return flat.reshape((*flat.shape[:-1], 6, self.robot.dof))

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
        n = self.robot.dof
        if not self.robot.terms:
            return np.full(n, np.nan), np.full(n, np.nan)
        still, each = np.zeros((n, n)), np.eye(n)
        delta = np.asarray(parameters, dtype=np.float64)
        forward, backward, faster = (
            np.diagonal(term_torques(self._layout, still, speed * each, still, delta)) for speed in (1.0, -1.0, 2.0)
        )
        damping = faster - forward
        return damping, 0.5 * (forward - backward) - damping

    def _link_name(self, link: str | int) -> str:
        names = self.robot.link_names
        if isinstance(link, str):
            return link
        if not 0 <= link < len(names):
            raise InputError(f"{self.robot.name} has moving links 0 to {len(names) - 1}, got {link}.")
        return names[link]
