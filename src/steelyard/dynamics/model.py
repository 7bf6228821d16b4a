"""The dynamic model of a robot: compiled functions of motion and parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MethodType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard import dynamics
from steelyard.display import html_table
from steelyard.errors import InputError
from steelyard.files import listed
from steelyard.files.arguments import real_array
from steelyard.graph import Function, Kernel
from steelyard.lmi import AffineBlock
from steelyard.once import cached_property
from steelyard.robot import Drives, Robot, RobotFile
from steelyard.robot.robot import PRESLIDING

from .algorithms.kinematics import joint_frames
from .algorithms.regressor import regressor_with_numpy, term_torques
from .base_parameters import BaseParameters, model_base_parameters
from .catalogue import CATALOGUE, forward_dynamics_function
from .conditions import model_conditions
from .functions import BaseColumns, Call, Evaluator, ModelFunctions, parameter_values
from .layout import ParameterLayout
from .terms import RotorInertia, check_term, is_known_term, term_from_dict
from .threads import one_thread

if TYPE_CHECKING:
    from steelyard import codegen

    from .bristles import Bristles

__all__ = ["Model"]

Array = NDArray[np.float64]

# Methods that take what the function of their name does, in its order, and return what it gives.
_PLAIN = frozenset(
    {
        "inverse_dynamics", "computed_torque", "gravity", "coriolis", "coriolis_matrix", "inertia_matrix",
        "total_inertia_matrix", "momentum", "regressor", "momentum_regressor",
    }
)  # fmt: skip


class Model:
    """The dynamic model of a robot, linear in its parameters: ``H(q, dq, ddq) delta = tau`` (thesis eq. 2.22).

    Functions take one sample or any batch: arrays of positions, velocities and accelerations with shape (..., N).
    They are compiled for the robot at their first use. Where they take parameters, they take an
    :class:`~steelyard.Estimate` or :class:`~steelyard.Identification` of the same robot as well.

    Parameters
    ----------
    robot : Robot
        With its terms.
    threads : int
        How many share a large batch; the result is the same.

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

    def __init__(self, robot: Robot, *, threads: int = 1) -> None:
        for term in robot.terms:
            if not is_known_term(term):
                check_term(term, robot)
        self.robot = robot
        self._layout = ParameterLayout(robot)
        self._functions = ModelFunctions(self._layout, self.base_parameters)
        self._call = Evaluator(self._functions, threads, self._call_directly).compute
        if robot.channels:
            self._call = partial(self._with_channels, self._call)
        self._forward_dynamics: dict[str, str] = {}
        self._direct: dict[str, Callable[..., Any]] = {}

    def _repr_html_(self) -> str:
        robot, base = self.robot, self.base_parameters()
        rows = [
            ("joints", f"{robot.dof}: {', '.join(robot.joint_names)}"),
            ("moving links", len(robot.links)),
            ("terms", ", ".join(term.kind for term in robot.terms) or "none"),
            ("parameters", self.parameter_count),
            ("base parameters", base.count),
        ]
        return html_table(f"Model of {robot.name}", (), rows)

    def __repr__(self) -> str:
        return f"Model({self.robot.name}: {self.robot.dof} joints, {self.parameter_count} parameters)"

    @classmethod
    def load(cls, path: str | Path, *, allow_extensions: bool = False) -> Model:
        """Read a model from a ``robot.toml`` or a URDF; where no terms are stated, with friction and offset.

        Parameters
        ----------
        path : str or Path
        allow_extensions : bool
            See :meth:`steelyard.RobotFile.load`.

        Raises
        ------
        InputError
            If the file, the description or a term cannot be used.
        """
        return cls.from_file(RobotFile.load(path, allow_extensions=allow_extensions))

    @classmethod
    def from_file(cls, file: RobotFile) -> Model:
        """Build the model that a robot file describes."""
        terms = [
            term_from_dict(table, f"{file.path}: [[terms]] number {number}", allow_extensions=file.allow_extensions)
            for number, table in enumerate(file.terms, start=1)
        ]
        return cls(file.robot.with_terms(*terms) if terms else file.robot)

    @property
    def dof(self) -> int:
        """Number N of degrees of freedom: of the joints that move by themselves, without mimic joints."""
        return self.robot.dof

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the n parameters: for each link ten, then those of the terms at its joint (thesis eq. 4.13)."""
        return self._layout.names

    @property
    def described_as(self) -> tuple[str, ...]:
        """As what a robot description holds each of the n parameters, such as friction; empty where it has no place."""
        return self._layout.described_as

    @property
    def parameter_count(self) -> int:
        """Number n of parameters."""
        return len(self.parameter_names)

    # What the model computes from arrays of positions, velocities and accelerations, (..., N)

    def inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        parameters: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        channels: Mapping[str, ArrayLike] | None = None,
        out: Array | None = None,
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
        channels : mapping, optional
            What is logged beside the motion and is needed by terms, such as ``{"temperature": ...}``, (...,) for all
            joints or (..., N) each; see `steelyard.Robot.channels`. Also in the functions below.
        out : ndarray, optional
            What the result is written into and which is then returned; also in the functions below. It must have the
            shape of the result and be C-contiguous, of float64, and not in the memory of another argument. Large
            results take less time so, because new memory has to be fetched from the system and cleared first.

        Examples
        --------
        >>> import numpy as np
        >>> import steelyard as sy
        >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
        >>> q, out = np.zeros((3, 1)), np.empty((3, 1))
        >>> model.inverse_dynamics(q, q, q, np.eye(10)[9], out=out) is out
        True
        """
        given = (q, dq, ddq, parameters) if channels is None else (q, dq, ddq, *self._logged(channels, q), parameters)
        return self._call("inverse_dynamics", given, gravity, out)

    def inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        parameters: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        channels: Mapping[str, ArrayLike] | None = None,
        out: Array | None = None,
    ) -> tuple[Array, Array, Array]:
        """Return the derivatives of the joint torques by q, dq and ddq, (..., N, N) each; row = torque.

        The derivatives by the parameters are the `regressor`. The sign of Coulomb friction counts as constant. What is
        given as `out` is (..., 3, N, N), one behind the other.
        """
        given = (q, dq, ddq, parameters) if channels is None else (q, dq, ddq, *self._logged(channels, q), parameters)
        stacked = self._call("inverse_dynamics_derivatives", given, gravity, out)
        return stacked[..., 0, :, :], stacked[..., 1, :, :], stacked[..., 2, :, :]

    def computed_torque(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        parameters: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        out: Array | None = None,
    ) -> Array:
        """Return the torques (..., N) of the links alone, ``M(q) ddq + C(q, dq) dq + g(q)`` of thesis eq. 5.8."""
        return self._call("computed_torque", (q, dq, ddq, parameters), gravity, out)

    def gravity(
        self, q: ArrayLike, parameters: ArrayLike, *, gravity: ArrayLike | None = None, out: Array | None = None
    ) -> Array:
        """Return the torques (..., N) that hold the links still, ``g(q)`` of thesis eq. 2.7."""
        return self._call("gravity", (q, parameters), gravity, out)

    def coriolis(self, q: ArrayLike, dq: ArrayLike, parameters: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the Coriolis and centripetal torques (..., N), ``C(q, dq) dq`` of thesis eq. 2.8."""
        return self._call("coriolis", (q, dq, parameters), None, out)

    def coriolis_matrix(self, q: ArrayLike, dq: ArrayLike, parameters: ArrayLike, *, out: Array | None = None) -> Array:
        """Return C(q, dq) (..., N, N) with the Christoffel symbols: ``dM/dt - 2 C`` is skew-symmetric."""
        return self._call("coriolis_matrix", (q, dq, parameters), None, out)

    def drive_torque(
        self,
        dq: ArrayLike,
        ddq: ArrayLike,
        parameters: ArrayLike,
        q: ArrayLike | None = None,
        *,
        term: str | None = None,
        channels: Mapping[str, ArrayLike] | None = None,
        out: Array | None = None,
    ) -> Array:
        """Return the torques (..., N) of all the terms, ``h`` of thesis eq. 2.9, or of one kind of term.

        Parameters
        ----------
        dq, ddq : array_like
            (..., N).
        parameters : array_like
            (n,).
        q : array_like, optional
            (..., N), zeros where not given; matters to terms that depend on it, such as springs, cogging, and friction
            by the load.
        term : str, optional
            Kind of the term, such as ``"viscous"``.
        out : ndarray, optional
            See `inverse_dynamics`.
        """
        name = "drive_torque" if term is None else f"drive_torque({term})"
        q = np.zeros_like(dq) if q is None else q
        given = (q, dq, ddq, parameters) if channels is None else (q, dq, ddq, *self._logged(channels, dq), parameters)
        return self._call(name, given, None, out)

    def inertia_matrix(self, q: ArrayLike, parameters: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the inertia matrix of the links M(q) (..., N, N) of thesis eq. 2.7."""
        return self._call("inertia_matrix", (q, parameters), None, out)

    def total_inertia_matrix(self, q: ArrayLike, parameters: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the inertia matrix of links and rotors (..., N, N): the derivative of all torques by ddq."""
        return self._call("total_inertia_matrix", (q, parameters), None, out)

    def momentum(self, q: ArrayLike, dq: ArrayLike, parameters: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the generalised momentum (..., N) of links and rotors, N·m·s or N·s."""
        return self._call("momentum", (q, dq, parameters), None, out)

    def kinetic_energy(self, q: ArrayLike, dq: ArrayLike, parameters: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the kinetic energy (...) of links and rotors, J."""
        return _number(self._call("kinetic_energy", (q, dq, parameters), None, out), out)

    def potential_energy(
        self, q: ArrayLike, parameters: ArrayLike, *, gravity: ArrayLike | None = None, out: Array | None = None
    ) -> Array:
        """Return the potential energy (...), J; zero for mass at the origin of the base frame."""
        return _number(self._call("potential_energy", (q, parameters), gravity, out), out)

    def regressor(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        channels: Mapping[str, ArrayLike] | None = None,
        out: Array | None = None,
    ) -> Array:
        """Return H(q, dq, ddq) (..., N, n) of thesis eq. 2.22: torques are ``H delta``."""
        given = (q, dq, ddq) if channels is None else (q, dq, ddq, *self._logged(channels, q))
        return self._call("regressor", given, None, out)

    def momentum_regressor(self, q: ArrayLike, dq: ArrayLike, *, out: Array | None = None) -> Array:
        """Return (..., N, n): times the parameters it is the generalised momentum."""
        return self._call("momentum_regressor", (q, dq), None, out)

    def energy_regressor(self, q: ArrayLike, dq: ArrayLike, *, out: Array | None = None) -> tuple[Array, Array]:
        """Return (..., n) for the kinetic and for the potential energy: times the parameters they are the energies.

        In base parameters (`function` with ``base=True``) the potential energy is known up to a constant. What is given
        as `out` is (..., 2, n), one behind the other.
        """
        stacked = self._call("energy_regressor", (q, dq), None, out)
        return stacked[..., 0, :], stacked[..., 1, :]

    def forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        parameters: ArrayLike,
        *,
        method: str = "automatic",
        gravity: ArrayLike | None = None,
        channels: Mapping[str, ArrayLike] | None = None,
        out: Array | None = None,
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
        out : ndarray, optional
            See `inverse_dynamics`.

        Returns
        -------
        ndarray
            rad/s² or m/s².

        Raises
        ------
        InputError
            If the inertia matrix is singular at some sample: such parameters are not physically possible.
        """
        function = self._forward_dynamics.get(method)
        if function is None:
            function = self._forward_dynamics[method] = forward_dynamics_function(self.robot, method)
        given = (q, dq, tau, parameters) if channels is None else (q, dq, tau, *self._logged(channels, q), parameters)
        result = self._call(function, given, gravity, out)
        # The sum of one sample is finite unless a number is not, or they are enormous; then all are looked at.
        if result.ndim == 1 and math.isfinite(sum(result.tolist())):
            return result
        given = (q, dq, tau, parameters, 0.0 if gravity is None else gravity)
        if not np.isfinite(result).all() and all(np.isfinite(np.asarray(a, dtype=np.float64)).all() for a in given):
            raise InputError(
                f"The inertia matrix of {self.robot.name} is singular with these parameters; "
                "steelyard.check tells which link is not physically possible."
            )
        return result

    def pose(self, q: ArrayLike, link: str | int, *, out: Array | None = None) -> Array:
        """Return the pose of a link frame in the base frame, (..., 4, 4).

        Parameters
        ----------
        q : array_like
            (..., N).
        link : str or int
            Name, of a link that is fixed to a moving one too ("tool0"), or index of a moving link.
        out : ndarray, optional
            See `inverse_dynamics`.
        """
        return self._call(f"pose({self._link_name(link)})", (q,), None, out)

    def jacobian(
        self, q: ArrayLike, link: str | int, point: ArrayLike = (0.0, 0.0, 0.0), *, out: Array | None = None
    ) -> Array:
        """Return the Jacobian of a point of a link in the base frame, (..., 6, N), linear rows first.

        Parameters
        ----------
        q : array_like
            (..., N).
        link : str or int
            Name, of a link that is fixed to a moving one too ("tool0"), or index of a moving link.
        point : array_like
            (3,) in the link frame, m; the origin where not given.
        out : ndarray, optional
            See `inverse_dynamics`.

        Returns
        -------
        ndarray
            Rows: m/rad or 1 (linear), then 1 or 0 (angular).
        """
        return self._call(f"jacobian({self._link_name(link)})", (q, point), None, out)

    def jacobian_rate(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        link: str | int,
        point: ArrayLike = (0.0, 0.0, 0.0),
        *,
        out: Array | None = None,
    ) -> Array:
        """Return the time derivative of `jacobian` while the robot moves with `dq`, (..., 6, N)."""
        return self._call(f"jacobian_rate({self._link_name(link)})", (q, dq, point), None, out)

    def drives(self, parameters: ArrayLike) -> Drives:
        """Return what the terms add at each joint moving alone: friction, rotor inertia and offset.

        Coupled motors count with what the joint feels of them. NaN where the robot has no terms; rotor inertia and
        offset also where it has none of these.

        Parameters
        ----------
        parameters : array_like
            (n,).
        """
        n = self.robot.dof
        if not self.robot.terms:
            return Drives.unknown(n)
        still, delta = np.zeros((n, n)), parameter_values(parameters, self.parameter_names, self.robot.name)
        described = np.array(self._layout.described_as)
        # Each joint slides steadily where its friction remembers the motion; what else is logged is zero.
        logged = [row for name in self.robot.channels for row in np.eye(n) * (name == PRESLIDING)]
        braking = ("damping", "friction", "quadratic_damping", "cubic_damping")

        def felt(kind: str) -> Array:
            if kind not in described and kind not in ("damping", "friction"):
                return np.full(n, np.nan)
            share = np.where(described == kind, delta, 0.0)
            speed = np.eye(n) if kind in braking else still
            acceleration = np.eye(n) if kind == "rotor_inertia" else still
            forth = term_torques(self._layout, still, speed, acceleration, share, logged)
            if kind not in braking:
                return np.diagonal(forth).copy()
            # Half of the difference of both directions, which is all that a description holds of friction that differs.
            back = term_torques(self._layout, still, -speed, acceleration, share, [-one for one in logged])
            return np.diagonal(0.5 * (forth - back)).copy()

        told = {kind: felt(kind) for kind in (*braking, "rotor_inertia", "offset")}
        return Drives.unknown(n).with_known(**told, **self._springs(delta, described))

    def _springs(self, delta: Array, described: NDArray[np.str_]) -> dict[str, Array]:
        """Stiffness and rest of the springs of joints, where there are any."""
        if "stiffness" not in described:
            return {}
        still, share = np.zeros((self.dof, self.dof)), np.where(described == "stiffness", delta, 0.0)
        at_zero = np.diagonal(term_torques(self._layout, still, still, still, share))
        moved = np.diagonal(term_torques(self._layout, np.eye(self.dof), still, still, share))
        stiffness = moved - at_zero
        rest = np.divide(-at_zero, stiffness, out=np.zeros(self.dof), where=stiffness > 0.0)
        return {"spring_stiffness": stiffness, "spring_rest": rest}

    # What is logged beside the motion

    def channel_values(self, channels: Mapping[str, ArrayLike] | None, shape: tuple[int, ...]) -> Array:
        """Return the channels that the terms need as one array (..., K N), in the order of `Robot.channels`.

        Parameters
        ----------
        channels : mapping
            For each name (...,), the same for all joints, or (..., N).
        shape : tuple of int
            Shape (..., N) of the motion.

        Raises
        ------
        InputError
            If a channel is missing, has another shape, is not finite, or is beyond the range of a term.
        """
        found = []
        for name in self.robot.channels:
            if channels is None or name not in channels:
                raise InputError(self._lacks(name))
            values = real_array(channels[name], f"The channel {name!r}")
            if values.ndim < len(shape):
                values = values[..., None]
            try:
                values = np.broadcast_to(values, shape)
            except ValueError:
                raise InputError(
                    f"The channel {name!r} has shape {np.shape(channels[name])}; expected {shape[:-1]}, or {shape} "
                    "with one value for each joint."
                ) from None
            if not np.isfinite(values).all():
                raise InputError(f"The channel {name!r} is not finite in some rows; remove them, or fill them before.")
            for term in self.robot.terms:
                if name in term.channels:
                    term.check_channel(name, values)
            found.append(values)
        return np.ascontiguousarray(np.concatenate(found, axis=-1)) if found else np.zeros((*shape[:-1], 0))

    @property
    def remembers(self) -> bool:
        """Whether friction has a state, see `presliding`."""
        return PRESLIDING in self.robot.channels

    @cached_property
    def bristles(self) -> Bristles:
        """The bristles of joints whose friction has a state; see `presliding`."""
        from .bristles import Bristles  # few models have any

        return Bristles(self.robot)

    def presliding(self, q: ArrayLike, dq: ArrayLike, starts: Sequence[int] = (0,)) -> Array:
        """Return the state of friction with presliding along a motion, (S, N), which terms need as a channel.

        It is the deflection of the bristles of Dahl's or LuGre's friction over that of steady sliding; zero at joints
        without such friction. Where a motion begins it is taken as zero, and is known once the joint has moved by some
        of its presliding displacements.

        Parameters
        ----------
        q, dq : array_like
            (S, N) rad or m, and per s, row after row in time.
        starts : sequence of int
            Rows at which a motion begins, so that nothing is remembered from the row before.

        Examples
        --------
        >>> import numpy as np
        >>> import steelyard as sy
        >>> from steelyard.dynamics import Dahl
        >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")]).with_terms(Dahl(displacement=0.01)))
        >>> q = np.linspace(0.0, 0.03, 4)[:, None]
        >>> model.presliding(q, np.ones_like(q))[:, 0].round(3)
        array([0.   , 0.632, 0.865, 0.95 ])
        """
        motion = np.asarray(q, dtype=np.float64), np.asarray(dq, dtype=np.float64)
        if any(one.ndim != 2 or one.shape != (len(motion[0]), self.dof) for one in motion):
            raise InputError(
                f"The motion along which presliding is computed must be q and dq of shape (S, {self.dof}), row after "
                f"row in time, got {motion[0].shape} and {motion[1].shape}."
            )
        return self.bristles.along(*motion, starts=starts)[0]

    def refuse_presliding(self, what: str) -> None:
        """Raise InputError where friction remembers the motion, which what is to be done with the model cannot hold.

        Parameters
        ----------
        what : str
            What is not done with such models, such as ``"simulated"``.
        """
        if self.remembers:
            kinds = " and ".join(term.kind for term in self.robot.terms if PRESLIDING in term.channels)
            raise InputError(
                f"The friction of the term {kinds} of {self.robot.name} remembers the motion before, and models with "
                f"such friction are not {what}; state `sliding = true` in the term for its friction in steady sliding, "
                "or model.without_channels in Python."
            )

    def refuse_channels(self) -> None:
        """Raise InputError where a term needs more than the motion, which is all that is known while a robot moves."""
        self.refuse_presliding("identified while they move")
        if self.robot.channels:
            kinds = " and ".join(term.kind for term in self.robot.terms if term.channels)
            names = " and ".join(repr(name) for name in self.robot.channels)
            raise InputError(
                f"The term {kinds} of {self.robot.name} needs the channel {names} of a log, and models with such terms "
                "are not identified while they move; hold it at one value (`held` in [[terms]]), or leave the term out."
            )

    def _logged(self, channels: Mapping[str, ArrayLike], motion: ArrayLike) -> tuple[Array, ...]:
        """Return the channels as an argument of functions, of which there is none where no term needs any."""
        return (self.channel_values(channels, np.shape(motion)),) if self.robot.channels else ()

    @cached_property
    def with_rotors(self) -> Model:
        """The model with the inertia of a rotor at every joint, beside its own terms."""
        return Model(self.robot.with_terms(*self.robot.terms, RotorInertia()))

    @property
    def terms_left_open(self) -> str:
        """Which terms the description gives no numbers of: "viscous of all joints; coulomb of elbow", or nothing."""
        robot, is_open = self.robot, np.isnan(self.robot.parameters)
        found: dict[str, list[str]] = {term.kind.replace("_", " "): [] for term in robot.terms}
        for index in robot.driving_joints:
            column = self.link_columns[index][-1] + 1
            for term in robot.terms:
                if is_open[column : column + len(term.parameters)].any():
                    found[term.kind.replace("_", " ")].append(robot.joints[index].name)
                column += len(term.parameters)
        return "; ".join(
            f"{kind} of {'all joints' if len(joints) == robot.dof else listed(joints)}"
            for kind, joints in found.items()
            if joints
        )

    @cached_property
    def without_channels(self) -> Model:
        """The model with terms that need no channels in place of those that do: itself, as a rule."""
        if not self.robot.channels:
            return self
        plain = (term.without_channels() for term in self.robot.terms)
        return Model(self.robot.with_terms(*(term for term in plain if term is not None)))

    def parameters_without_channels(self, parameters: ArrayLike, base: bool = False) -> Array:
        """Return the parameters (..., n) that `without_channels` has, of those of this model.

        Parameters
        ----------
        parameters : array_like
            (..., n), or (..., n_b) with `base`.
        base : bool
            Whether they are base parameters; then so are those that are returned, of the other model.

        Examples
        --------
        >>> import steelyard as sy
        >>> from steelyard.dynamics import LuGre
        >>> robot = sy.Robot.from_dh([(0, 1.0, 0, "q")])
        >>> model = sy.Model(robot.with_terms(LuGre(displacement=0.01, ratio=0.5, velocity=0.1)))
        >>> model.base_parameters().names
        ('Lzz1', 'Fcj1', 'Fbj1', 'Fvj1')
        >>> model.parameters_without_channels([0.5, 2.0, 0.1, 0.3], base=True)
        array([0.5, 2. , 0.3])
        """
        values, plain = np.asarray(parameters, dtype=np.float64), self.without_channels
        if plain is self:
            return values
        if base:  # parameters Pb beta move the robot as beta does
            values = values @ self.base_parameters().Pb.T
        kept = values[..., [self.parameter_names.index(name) for name in plain.parameter_names]]
        return kept @ plain.base_parameters().K.T if base else kept

    @cached_property
    def without_logged_channels(self) -> Model:
        """The model with terms that need nothing of a log but its motion, which `presliding` follows from."""
        if set(self.robot.channels) <= {PRESLIDING}:
            return self
        plain = (term if set(term.channels) <= {PRESLIDING} else term.without_channels() for term in self.robot.terms)
        return Model(self.robot.with_terms(*(term for term in plain if term is not None)))

    def _lacks(self, name: str) -> str:
        kinds = " and ".join(term.kind for term in self.robot.terms if name in term.channels)
        if name == PRESLIDING:
            return (
                f"The friction of the term {kinds} of {self.robot.name} has a state that follows from the motion "
                f"before, which was not given: give channels={{{name!r}: model.presliding(q, dq)}}; samples get it by "
                "samples.with_presliding(model)."
            )
        return (
            f"The term {kinds} of {self.robot.name} needs the channel {name!r}, which was not given: name its column "
            f'in [log], as in channels = {{ {name} = "..." }}, or give channels={{{name!r}: values}} in Python.'
        )

    def _call_directly(self, function: str, call: Call) -> None:
        """Let machine code stand in the place of a method that was called often; it calls the method where it must."""
        method = _METHODS.get(function)
        replaced = self.__dict__.get(function) is not self._direct.get(function)  # by the user, whose own it stays
        if method is not None and getattr(type(self), function) is method and not replaced and not self.robot.channels:
            direct = call.method(MethodType(method, self))
            if direct is not None:
                self.__dict__[function] = self._direct[function] = direct

    def _with_channels(
        self,
        call: Callable[..., Array],
        function: str,
        given: tuple[Any, ...],
        gravity: ArrayLike | None,
        out: Array | None,
    ) -> Array:
        entry = CATALOGUE[function.partition("(")[0]]
        if entry.drives and len(given) == len(entry.arguments):
            raise InputError(self._lacks(self.robot.channels[0]))
        return call(function, given, gravity, out)

    def __getstate__(self) -> dict[str, Any]:
        # Compiled code stays where it was compiled.
        state = vars(self) | {"_direct": {}}
        state.pop("base_columns", None)
        for name, direct in self._direct.items():
            if state.get(name) is direct:
                del state[name]
        return state

    # What the model is made of

    def base_parameters(self) -> BaseParameters:
        """Return the base parameters of links and terms together (thesis section 2.5.1)."""
        return self._base

    def conditions(self, consistency: str = "full") -> tuple[AffineBlock, ...]:
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
            See `function`.
        base : bool
            In base parameters.

        Returns
        -------
        dict
            See :func:`steelyard.graph.operation_count`.
        """
        return self.function(function, base=base).operation_count

    def function(
        self,
        name: str,
        *,
        base: bool = False,
        gravity: str = "fixed",
        sign: str = "exact",
        parameters: ArrayLike | None = None,
    ) -> Function:
        """Return a function of the model as an expression graph, to print, differentiate or export.

        Parameters
        ----------
        name : str
            ``"inverse_dynamics"``, ``"regressor"`` and so on; `functions` names them all. Those of one link take its
            name in parentheses, ``"pose(link7)"``, and mean the last link without it; ``"drive_torque(viscous)"`` is
            the torque of one kind of term.
        base : bool
            In base parameters instead of standard ones.
        gravity : {"fixed", "argument"}
            The gravity of the robot, or an argument of the functions that depend on it.
        sign : {"exact", "smooth"}
            The sign of Coulomb friction: exact, or ``v / sqrt(v² + w²)``, for simulation and differentiation, with w
            (1,) as the argument ``sign_width`` of the functions that depend on it.
        parameters : array_like, optional
            (n,), or (n_b,) with `base`: numbers that stand in the function instead of an argument.

        Raises
        ------
        InputError
            If there is no such function or link, or base parameters do not apply.
        """
        return self._functions.function(name, base=base, gravity=gravity, sign=sign, parameters=parameters)

    def generate(
        self,
        language: str,
        functions: Sequence[str] | None = None,
        *,
        directory: str | Path,
        base: bool = False,
        gravity: str = "fixed",
        sign: str = "exact",
        parameters: ArrayLike | None = None,
    ) -> tuple[Path, ...]:
        """Write functions of the model as source: a small project with documentation and a self-test.

        Parameters
        ----------
        language : str
            ``"c"``, ``"cpp"``, ``"python"``, ``"rust"``, ``"julia"``, ``"octave"`` (for MATLAB too), ``"casadi"`` or
            ``"jax"``.
        functions : sequence of str, optional
            See `function`; :data:`steelyard.dynamics.DEFAULT_FUNCTIONS` where not given, and ``presliding_step`` where
            friction has a state.
        directory : str or Path
            Where the files go; made where it is missing. A file that was not generated is never overwritten.
        base, gravity, sign, parameters
            See `function`; with `parameters` the source holds the numbers of one robot.

        Returns
        -------
        tuple of Path
            The files.

        Raises
        ------
        InputError
            If the language or a function is unknown, or the directory cannot be written.
        """
        project = dynamics.model_project(
            self._functions, functions, base=base, gravity=gravity, sign=sign, parameters=parameters
        )
        from steelyard import codegen

        return codegen.generate(project, language, Path(directory))

    def symbolic(
        self,
        name: str,
        *,
        closed: bool = True,
        base: bool = False,
        gravity: str = "fixed",
        substitute: Mapping[str, float | str] | None = None,
    ) -> codegen.SymbolicFunction:
        """Return a function of the model as SymPy expressions.

        Parameters
        ----------
        name : str
            See `function`.
        closed : bool
            Single expressions; False keeps intermediate variables.
        base, gravity
            See `function`.
        substitute : mapping, optional
            Numbers or expressions for symbols by name, such as ``{"m1": 0, "lx2": "m2*c"}``.

        Raises
        ------
        InputError
            If there is no such function or symbol, or a closed expression would be too long.
        MissingExtraError
            If SymPy is not installed.
        """
        from steelyard import codegen

        return codegen.sympy_function(
            self.function(name, base=base, gravity=gravity), closed=closed, substitute=substitute or {}
        )

    def casadi(self, name: str, *, base: bool = False, gravity: str = "fixed", sign: str = "exact") -> Any:
        """Return a function of the model as a ``casadi.Function``, which CasADi differentiates; see `function`."""
        from steelyard import codegen

        return codegen.casadi_function(self.function(name, base=base, gravity=gravity, sign=sign))

    def jax(self, name: str, *, base: bool = False, gravity: str = "fixed", sign: str = "exact") -> Any:
        """Return a function of the model for JAX, to compile, map and differentiate; see `function`."""
        from steelyard import codegen

        return codegen.jax_function(self.function(name, base=base, gravity=gravity, sign=sign))

    @property
    def functions(self) -> tuple[str, ...]:
        """Names of all the functions of the model."""
        return tuple(name for name, entry in CATALOGUE.items() if self.remembers or not entry.remembers)

    def kernel(self, function: str, *, base: bool = False, gravity: str = "fixed", sign: str = "exact") -> Kernel:
        """Return a compiled function, for arrays that are laid out already; see `function` for the arguments."""
        return self._functions.kernel(function, base=base, gravity=gravity, sign=sign)

    @cached_property
    def base_columns(self) -> BaseColumns:
        """The kernel of the base regressor, which the regression reads joint by joint."""
        return self._functions.base_columns()

    @cached_property
    def _base(self) -> BaseParameters:
        joint_frames(self.robot, [0.0] * self.dof, np)  # refuses lengths without a value
        with one_thread():
            return model_base_parameters(self._layout, _sampled_regressor)

    @property
    def link_columns(self) -> tuple[NDArray[np.intp], ...]:
        """For each link the indices of its ten parameters ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m``."""
        return self._layout.links

    def _link_name(self, link: str | int) -> str:
        names = self.robot.link_names
        if isinstance(link, str):
            return link
        if not 0 <= link < len(names):
            raise InputError(f"{self.robot.name} has moving links 0 to {len(names) - 1}, got {link}.")
        return names[link]


_METHODS = {name: getattr(Model, name) for name in _PLAIN}  # as they are here, whatever takes their place later


def _number(values: Array, out: Array | None) -> Array:
    """Return what one sample gives as a number rather than an array without dimensions."""
    number: Array = values if out is not None or values.ndim else values[()]
    return number


def _sampled_regressor(layout: ParameterLayout) -> Array:
    """The regressor at random motions, stacked, with three rows for each parameter and some more."""
    joints, parameters = layout.robot.dof, len(layout.names)
    count = max(20, -(-(3 * parameters + 50) // joints)) * len(layout.speeds_of_terms)
    generator = np.random.default_rng(20140101)
    q = generator.uniform(-np.pi, np.pi, (count, joints))
    dq = layout.random_speeds(generator, count)
    ddq = generator.uniform(-9.0, 9.0, q.shape)
    logged = layout.random_channels(generator, count)
    return regressor_with_numpy(layout, q, dq, ddq, logged).reshape(-1, parameters)
