"""Stiffness and damping of an elastic joint from the deflection between its two encoders.

The transmission is a spring and a damper between motor and link (M. W. Spong, Modeling and control of elastic joint
robots, J. Dyn. Syst. Meas. Control 109, 1987), all of it on the joint side of the gear::

    B ddtheta + friction(dtheta) + tau = tau_m          motor side
    tau = K (theta - q) + D (dtheta - dq)               transmission
    tau = M(q) ddq + C(q, dq) dq + g(q)                 link side

The rows are those of the deflection, not of the torque: ``theta - q = tau / K - (D / K) d/dt (tau / K)``. The noise of
encoders, which is a good part of a deflection, then stands where noise belongs. In rows of the torque,
``K (theta - q)``, it stands in the regressor, and draws the stiffness towards zero. What the second encoder adds is
linear, too: its zero, and its delay, which appears as a deflection in proportion to the speed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.files import is_number, plain, shown
from steelyard.regression import Information, ParameterCovariance
from steelyard.regression.batch_means import BatchSums
from steelyard.regression.factor import Factor, solve, triangular
from steelyard.regression.parameter_covariance import NORMAL

__all__ = [
    "ENCODER_ERRORS",
    "DeflectionRows",
    "JointStiffness",
    "estimate_joint_stiffness",
    "motion_behind",
    "stiffness_table",
    "torque_scale",
]

Array = NDArray[np.float64]
Motion = tuple[Array, Array, Array]
"""Positions, velocities and accelerations, (S, N) each."""

ENCODER_ERRORS: dict[str, tuple[str, ...]] = {
    "scale": ("scale error",),
    "eccentricity": ("eccentricity, sine", "eccentricity, cosine"),
    "lost motion": ("lost motion",),
}
"""Errors of a second encoder beyond zero and delay, each with its columns."""

SIGNIFICANT = 3.0
"""Standard errors above which an error of an encoder is taken in. With 2, one in twenty sound encoders gets one."""

_TURNED = 0.25
"""Part of the squared deflection that a spring of the wrong sign may leave of what one of the right sign leaves, above
which nothing is said of exchanged encoders: errors of encoders that go against the torque explain less."""

_WIDE = 0.03
"""Half of a relative interval above which a stiffness is told as an interval: what deflects by less than the noise of
its encoders, as the last joints of a Panda by 9 µrad under 10, is told to 5 % at best."""

MOST_WIDENING = 2.0
"""By which an error of an encoder may raise the standard error of the compliance; one that raises it further could be
the torque of the links under another name."""

_BOUNDED = _COMPLIANCE, _RELAXATION, _INERTIA = "compliance", "relaxation", "motor inertia"


@dataclass(frozen=True, eq=False)
class DeflectionRows:
    """The quantities that make the rows of the deflection of one joint, at S instants of one or more logs.

    Parameters
    ----------
    deflection : (S,) array
        Motor position less link position as logged, the delay that is known already taken out, rad or m.
    velocity, acceleration : (S,) array
        Of the motor, on the joint side.
    position : (S,) array
        Of the joint.
    torque, torque_rate : (S,) array
        What the transmission carries, by the model of the links, N·m or N, and its rate of change.
    log : (S,) array of int, optional
        Number of the log of each row: the zero of an encoder is that of one log.
    """

    deflection: Array
    velocity: Array
    acceleration: Array
    position: Array
    torque: Array
    torque_rate: Array
    log: NDArray[np.intp] | None = None


@dataclass(frozen=True, eq=False)
class JointStiffness:
    """Stiffness, damping and second encoder of one joint.

    Attributes
    ----------
    joint : str
    verdict : {"measured", "bounded"}
        ``"bounded"`` where the compliance is not told from zero (by one encoder alone: not by three standard errors):
        the stiffness has a lower bound alone.
    stiffness : float
        K, N·m/rad or N/m; infinite where the best compliance is zero.
    stiffness_interval : tuple of float
        95 %; the upper end is infinite where the compliance is not told from zero.
    compliance, compliance_standard_error : float
        1 / K. The error holds the noise of the deflection, with its correlation in time, and that of the torque.
    damping, damping_bound : float
        D, N·m·s/rad or N·s/m, and the upper end of its interval.
    motor_inertia, motor_inertia_standard_error : float
        B on the joint side, kg·m² or kg, at which the torque was computed, or as found; the error is NaN where it was
        given.
    delay, delay_standard_error : float
        By which the second encoder is logged later than the first, s.
    zeros : tuple of float
        Motor position less link position of the unloaded transmission in each log, rad or m.
    encoder_errors : mapping
        Coefficients of further errors of the second encoder that are significant, by name.
    deflection, unexplained : float
        RMS of the deflection that the spring makes, and of what is left of the measured one, rad or m; NaN without a
        second encoder.
    count : int
        Rows.
    unit : str
        Of the stiffness.

    Examples
    --------
    >>> one = JointStiffness("elbow", "bounded", float("inf"), (2e5, float("inf")), 0.0, 2.5e-6)
    >>> print(one.sentence)
    elbow: the deflection is below what the log resolves; the stiffness is at least 2e+05 N·m/rad (95 %).
    """

    joint: str
    verdict: str
    stiffness: float
    stiffness_interval: tuple[float, float]
    compliance: float
    compliance_standard_error: float
    damping: float = 0.0
    damping_bound: float = np.inf
    motor_inertia: float = 0.0
    motor_inertia_standard_error: float = np.nan
    delay: float = 0.0
    delay_standard_error: float = 0.0
    zeros: tuple[float, ...] = (0.0,)
    encoder_errors: Mapping[str, float] = field(default_factory=dict)
    deflection: float = 0.0
    unexplained: float = 0.0
    count: int = 0
    unit: str = "N·m/rad"

    @classmethod
    def of_compliance(
        cls, joint: str, compliance: float, standard_error: float, unit: str, told_from: float = NORMAL
    ) -> JointStiffness:
        """Return what a compliance and its standard error tell of the stiffness; all else is unknown.

        A compliance below `told_from` standard errors has a lower bound of the stiffness alone.

        Examples
        --------
        >>> JointStiffness.of_compliance("elbow", 0.0, 2.5e-6, "N·m/rad").verdict
        'bounded'
        """
        low, high = compliance - NORMAL * standard_error, compliance + NORMAL * standard_error
        if compliance <= told_from * standard_error:
            low = 0.0
        return cls(
            joint=joint,
            verdict="measured" if low > 0.0 else "bounded",
            stiffness=1.0 / compliance if compliance > 0.0 else np.inf,
            stiffness_interval=(1.0 / high, 1.0 / low if low > 0.0 else np.inf),
            compliance=compliance,
            compliance_standard_error=standard_error,
            unit=unit,
        )

    @property
    def is_wide(self) -> bool:
        """Whether the interval says more than the number in its middle, since it is wider than 3 % to either side."""
        low, high = self.stiffness_interval
        return not high - low <= 2.0 * _WIDE * self.stiffness

    @property
    def sentence(self) -> str:
        """The result in a sentence."""
        low, high = self.stiffness_interval
        if self.verdict == "bounded":
            return (
                f"{self.joint}: the deflection is below what the log resolves; the stiffness is at least "
                f"{low:.3g} {self.unit} (95 %)."
            )
        if self.is_wide:
            return (
                f"{self.joint}: the stiffness lies between {low:.4g} and {high:.4g} {self.unit} (95 %), at best near "
                f"{_rounded(self.stiffness)}."
            )
        return (
            f"{self.joint}: the stiffness is {self.stiffness:.4g} {self.unit}, 95 % interval {low:.4g} to {high:.4g}."
        )

    def deflections(self, torque: ArrayLike, torque_rate: ArrayLike | None = None) -> Array:
        """Return the deflection of the transmission under a torque, motor position less link position, (S,).

        Parameters
        ----------
        torque, torque_rate : (S,) array
            What the transmission carries, and its rate of change, without which damping is left out.
        """
        found = self.compliance * np.asarray(torque, dtype=np.float64)
        if torque_rate is not None:
            found = found - self.compliance**2 * self.damping * np.asarray(torque_rate, dtype=np.float64)
        return np.asarray(found)

    def encoder_error(self, position: ArrayLike, velocity: ArrayLike) -> Array:
        """Return what the errors of the second encoder add to the measured deflection, less a constant, (S,)."""
        q, dq = np.asarray(position, dtype=np.float64), np.asarray(velocity, dtype=np.float64)
        total = np.zeros_like(q)
        for name, columns in ENCODER_ERRORS.items():
            if columns[0] in self.encoder_errors:
                for column, values in zip(columns, error_columns(q, dq, name), strict=True):
                    total += self.encoder_errors[column] * values
        return total

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data, with None for numbers that are not finite."""
        found: dict[str, Any] = plain(self)
        return found

    @classmethod
    def from_dict(cls, document: Mapping[str, Any], where: str = "elastic joint") -> JointStiffness:
        """Build from what `to_dict` returned.

        Raises
        ------
        InputError
            If a value is missing or of a wrong kind; `where` is named in the message.
        """
        values: dict[str, Any] = {}
        for item in fields(cls):
            value = document.get(item.name)
            if item.name in ("joint", "verdict", "unit"):
                good = isinstance(value, str)
            elif item.name in ("zeros", "stiffness_interval"):
                listed = list(value) if isinstance(value, list | tuple) else [value]
                good = isinstance(value, list | tuple) and all(one is None or is_number(one) for one in listed)
                good = good and (item.name == "zeros" or len(listed) == 2)
                value = tuple(np.inf if one is None else float(one) for one in listed) if good else value
            elif item.name == "encoder_errors":
                good = isinstance(value, Mapping) and all(is_number(one) for one in value.values())
            else:
                unknown = np.nan if item.name.startswith(("motor_inertia", "unexplained")) else np.inf
                good = item.name in document and (value is None or is_number(value))
                value = unknown if value is None else value
            if not good:
                raise InputError(f"{where}: {item.name!r} of an elastic joint is {shown(value)}; identify it anew.")
            values[item.name] = value
        return cls(**values)


def _rounded(value: float) -> str:
    """A number of two digits, without an exponent where it is short."""
    return f"{float(f'{value:.2g}'):.4g}"


def motion_behind(motion: Motion, t: Array, places: Sequence[int], deflections: Array) -> Motion:
    """Return the motion of the links behind springs: that of the motors less the deflections.

    Parameters
    ----------
    motion : tuple of ndarray
        (S, N) positions, velocities and accelerations of the motors, on the joint side.
    t : ndarray
        (S,) s.
    places : sequence of int
        The J elastic joints.
    deflections : ndarray
        (S, J) of them.
    """
    q, dq, ddq = (np.array(values) for values in motion)
    rates = np.gradient(deflections, t, axis=0)
    chosen = list(places)
    q[:, chosen] -= deflections
    dq[:, chosen] -= rates
    ddq[:, chosen] -= np.gradient(rates, t, axis=0)
    return q, dq, ddq


def stiffness_table(joints: Sequence[JointStiffness]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """The table of elastic joints: its heads and its rows.

    Damping and motor inertia are in the SI units that go with the stiffness; deflections are RMS values.
    """
    heads: tuple[str, ...]
    heads = (
        *("joint", "verdict", "stiffness", "from", "to", "unit"),
        *("damping", "motor inertia", "delay (ms)", "deflection", "unexplained"),
    )
    rows: list[tuple[str, ...]] = []
    for one in joints:
        low, high = one.stiffness_interval
        bounded = one.verdict == "bounded"
        second = np.isfinite(one.unexplained)
        length = one.unit.rpartition("/")[2]
        inertia_error = one.motor_inertia_standard_error
        inertia = f"{one.motor_inertia:.4g}" if np.isfinite(one.motor_inertia) else "-"
        rows.append(
            (
                one.joint,
                one.verdict,
                "-" if bounded else f"near {_rounded(one.stiffness)}" if one.is_wide else f"{one.stiffness:.4g}",
                f"{low:.4g}",
                "-" if not np.isfinite(high) else f"{high:.4g}",
                one.unit,
                "-" if bounded else f"{one.damping:.3g}",
                inertia if not np.isfinite(inertia_error) else f"{inertia} ± {inertia_error:.2g}",
                f"{1e3 * one.delay:.3f} ± {1e3 * one.delay_standard_error:.3f}" if second else "-",
                f"{one.deflection:.2g} {length}",
                f"{one.unexplained:.2g} {length}" if second else "-",
            )
        )
    return heads, rows


@dataclass(frozen=True, eq=False)
class _Known:
    """What is known beside the rows: the inertia of the motor with its standard error, whether the delay is."""

    motor_inertia: float
    inertia_error: float
    delay: bool
    scale_error: float

    @property
    def inertia(self) -> bool:
        """Whether the inertia of the motor is not looked for."""
        return self.inertia_error == 0.0


@dataclass(frozen=True, eq=False)
class _Solution:
    names: tuple[str, ...]
    values: Array
    root: Array
    """The covariance of the values is root root'."""
    residual: Array
    unknown: frozenset[str]

    def error(self, name: str) -> float:
        """Standard error of a value; infinite where the rows do not tell it from others."""
        return np.inf if name in self.unknown else float(np.linalg.norm(self.root[self.names.index(name)]))


@in_one_thread
def estimate_joint_stiffness(
    joint: str,
    rows: DeflectionRows,
    *,
    motor_inertia: float = 0.0,
    motor_inertia_error: float = 0.0,
    encoder_errors: str = "automatic",
    delay_is_given: bool = False,
    torque_scale_error: float = 0.0,
    unit: str = "N·m/rad",
) -> JointStiffness:
    """Estimate stiffness and damping of one joint, and zero and delay of its second encoder, together.

    Least squares with the compliance 1 / K, the damping and the inertia of the motor not negative.

    Parameters
    ----------
    joint : str
        Its name.
    rows : DeflectionRows
    motor_inertia : float
        B on the joint side, kg·m² or kg, with which the torque was computed.
    motor_inertia_error : float
        Standard error of B: 0 where it is known, infinite where nothing tells it. Above 0 it is found with the
        stiffness, and both sources are weighed: torques do not tell B from the inertia of the links where the joint is
        the first or the second of an arm, and elsewhere often poorly, so that the deflection has to.
    encoder_errors : {"automatic", "none"}
        Whether a wrong scale, an eccentricity and a lost motion of the second encoder are taken in where they are
        significant (three standard errors), and can be told from the torque.
    delay_is_given : bool
        Whether the whole delay of the second encoder is out of the rows.
    torque_scale_error : float
        Relative standard error of the torque as a whole, see `torque_scale`.
    unit : str
        Of the stiffness.

    Raises
    ------
    InputError
        Where the joint does not move, or carries no torque that changes.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(0.0, 40.0, 0.01)
    >>> q, dq, ddq = np.sin(t), np.cos(t), -np.sin(t)
    >>> torque, rate = 50 * np.cos(q), -50 * np.sin(q) * dq
    >>> noise = 1e-5 * np.random.default_rng(0).normal(size=t.size)
    >>> deflection = torque / 2e4 + 0.003 * dq + 0.01 + noise
    >>> rows = DeflectionRows(deflection, dq, ddq, q, torque, rate)
    >>> found = estimate_joint_stiffness("elbow", rows)
    >>> found.verdict, round(found.stiffness, -2), round(1e3 * found.delay, 3), round(found.zeros[0], 4)
    ('measured', 20000.0, 3.0, 0.01)
    """
    if encoder_errors not in ("automatic", "none"):
        raise InputError(f'encoder_errors must be "automatic" or "none", got {encoder_errors!r}.')
    _require_motion(joint, rows)
    taken: list[str] = []
    known = _Known(motor_inertia, motor_inertia_error, delay_is_given, torque_scale_error)
    solution = _solve(rows, taken, known)
    while encoder_errors == "automatic":
        better = _significant(rows, taken, known, solution)
        if better is None:
            break
        taken, solution = better
    _require_right_way_round(joint, rows, taken, known, solution)
    return _result(joint, rows, solution, known, unit)


def torque_scale(
    torque: ArrayLike, motor_torque: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike | None, log: ArrayLike
) -> tuple[float, float]:
    """Return the scale of the torque of the links that the motor's torque tells, and its standard error.

    The scale is 1 where the parameters of the links are the best for this joint. They need not be: a prior draws them.

    The motor's torque is a regression on that of the links, on viscous and Coulomb friction, an offset, and on the
    acceleration where the inertia of the motor is not known; residuals are correlated in time.

    Parameters
    ----------
    torque, motor_torque, velocity : (S,) array
        What the transmission carries by the model; what the motor gives, less friction and inertia of its own as
        far as they are known; speed of the joint.
    acceleration : (S,) array or None
    log : (S,) array of int
        Number of the log of each row.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(0.0, 40.0, 0.01)
    >>> links, speed = np.cos(np.sin(t)), np.cos(t)
    >>> noise = 0.1 * np.random.default_rng(0).normal(size=t.size)
    >>> scale, error = torque_scale(links, 1.1 * links + noise, speed, None, np.zeros(t.size, int))
    >>> bool(abs(scale - 1.1) < 3 * error), bool(0.001 < error < 0.02)
    (True, True)
    """
    links, speed = np.asarray(torque, dtype=np.float64), np.asarray(velocity, dtype=np.float64)
    columns = [links, speed, np.sign(speed), np.ones_like(links)]
    if acceleration is not None:
        columns.append(np.asarray(acceleration, dtype=np.float64))
    size = [float(np.sqrt(np.mean(column**2))) or 1.0 for column in columns]
    rows = np.column_stack([*(column / one for column, one in zip(columns, size, strict=True)), motor_torque])
    names = [f"column {k}" for k in range(len(columns))]
    information = _information(names, rows, np.asarray(log, dtype=np.intp))
    found = solve(information.reduced(None))
    covariance = ParameterCovariance.of(information, found)
    if covariance.unknown[0]:
        return 1.0, np.inf
    return float(found[0] / size[0]), float(covariance.standard_error[0] / size[0])


def _require_motion(joint: str, rows: DeflectionRows) -> None:
    if rows.deflection.size < 100:
        raise InputError(
            f"{joint}: {rows.deflection.size} rows are too few for a stiffness; give a log of 100 or more."
        )
    if not np.ptp(rows.deflection) > 0.0:
        raise InputError(
            f"{joint}: motor and link position differ by the same in every row, so that both are one encoder; name the "
            "column of the second encoder in [elastic]."
        )
    if not np.ptp(rows.torque) > 0.0:
        raise InputError(
            f"{joint}: its transmission carries a constant torque in this motion, which shows no stiffness; record a "
            "motion with other torques, such as one that lifts and accelerates its link."
        )


def _require_right_way_round(
    joint: str, rows: DeflectionRows, taken: list[str], known: _Known, solution: _Solution
) -> None:
    """Refuse a deflection that goes against the torque: no spring does so, but the encoders in each other's place."""
    if solution.values[solution.names.index(_COMPLIANCE)] > 0.0:
        return
    turned = replace(rows, torque=-rows.torque, acceleration=-rows.acceleration, torque_rate=-rows.torque_rate)
    other = _solve(turned, taken, known)
    compliance = other.values[other.names.index(_COMPLIANCE)]
    left = float(np.sum(other.residual**2) / np.sum(solution.residual**2))
    if left < _TURNED and compliance > 5.0 * other.error(_COMPLIANCE):
        raise InputError(
            f"{joint}: the deflection, motor less link position, goes against the torque that bends the joint: the "
            "encoders stand in each other's place, or the torque has the wrong sign; exchange the columns, or "
            'write side = "motor" in [elastic] where the second encoder is that of the motor.'
        )


def _columns(rows: DeflectionRows, taken: list[str], known: _Known) -> dict[str, Array]:
    """The columns of the regression by their names; those of springs, dampers and motors are bounded below."""
    logs = np.zeros(rows.deflection.size, dtype=np.intp) if rows.log is None else rows.log
    found = {f"zero {k}": (logs == k).astype(np.float64) for k in np.unique(logs)}
    if not known.delay:
        found["delay"] = rows.velocity
    found[_COMPLIANCE] = rows.torque if known.inertia else rows.torque + known.motor_inertia * rows.acceleration
    found[_RELAXATION] = -rows.torque_rate
    if not known.inertia:
        found[_INERTIA] = -rows.acceleration
    for name in taken:
        found |= dict(zip(ENCODER_ERRORS[name], error_columns(rows.position, rows.velocity, name), strict=True))
    return found


def error_columns(position: Array, velocity: Array, name: str) -> tuple[Array, ...]:
    """The deflection that an error of a second encoder shows, by its coefficients; (S,) each, of mean zero."""
    if name == "scale":
        return (position - position.mean(),)
    if name == "eccentricity":
        sine, cosine = np.sin(position), np.cos(position)
        return sine - sine.mean(), cosine - cosine.mean()
    speed = np.sqrt(np.mean(velocity**2))
    # A backlash closes over a little way; a sign would jump with the noise of a joint at rest.
    side = np.tanh(velocity / (0.02 * speed)) if speed > 0.0 else np.zeros_like(velocity)
    return (side - side.mean(),)


def _solve(rows: DeflectionRows, taken: list[str], known: _Known) -> _Solution:
    """Least squares with lower bounds; what lies at a bound is held there, and the others keep their covariance."""
    from scipy.optimize import lsq_linear  # what is not asked for is not loaded

    columns = _columns(rows, taken, known)
    names, matrix = tuple(columns), np.column_stack(list(columns.values()))
    # Where torques tell the inertia of the motor, too, it comes to lie above zero with them.
    above_zero = (_COMPLIANCE, _RELAXATION) if np.isfinite(known.inertia_error) else _BOUNDED
    bounded = np.array([name in above_zero for name in names])
    size = np.sqrt(np.mean(matrix**2, axis=0))
    size = np.where(size > 0.0, size, 1.0)
    matrix /= size
    whole = triangular(np.column_stack([matrix, rows.deflection]))
    lower = np.where(bounded, 0.0, -np.inf)
    found = lsq_linear(whole[:-1, :-1], whole[:-1, -1], bounds=(lower, np.inf), method="bvls", tol=1e-14)
    values = found.x
    # A combination of compliance and inertia at a bound of either is still uncertain in both directions: both keep the
    # standard errors of the regression with all the columns there.
    free = ~bounded | (values > 0.0) | np.array([name in (_COMPLIANCE, _INERTIA) for name in names])
    residual = rows.deflection - matrix @ values
    chosen = np.column_stack([matrix[:, free], rows.deflection])
    information = _information([n for n, f in zip(names, free, strict=True) if f], chosen, rows.log)
    covariance = ParameterCovariance.of(information, values[free])
    root = np.zeros((len(names), covariance.root.shape[1]))
    root[free] = covariance.root
    unknown = frozenset(names[k] for k in np.flatnonzero(free)[covariance.unknown])
    solution = _Solution(names, values / size, root / size[:, None], residual, unknown)
    if known.inertia or not np.isfinite(known.inertia_error):
        return solution
    if unknown & {_COMPLIANCE, _INERTIA}:  # the transmission carries nothing but the acceleration of its link
        return _with_known_inertia(rows, taken, known)
    if not solution.values[names.index(_COMPLIANCE)] > 0.0:
        return solution
    return _weighed(solution, known, np.column_stack(list(columns.values())), rows.deflection)


def _weighed(solution: _Solution, known: _Known, matrix: Array, deflection: Array) -> _Solution:
    """Weigh the inertia that deflections tell against that of the torques: least squares of both together."""
    inertia, compliance = (solution.names.index(name) for name in (_INERTIA, _COMPLIANCE))
    values, root = solution.values, solution.root
    apart = root[inertia] - known.motor_inertia * root[compliance]  # of the value of B / K less B times that of 1 / K
    variance = float(apart @ apart)
    noise = (known.inertia_error * values[compliance]) ** 2
    gain = root @ apart / max(variance + noise, 1e-300)
    values = values - gain * (values[inertia] - known.motor_inertia * values[compliance])
    values[inertia] = max(values[inertia], 0.0)
    root = np.column_stack([root - np.outer(gain, apart), gain * np.sqrt(noise)])
    return _Solution(solution.names, values, root, deflection - matrix @ values, solution.unknown)


def _with_known_inertia(rows: DeflectionRows, taken: list[str], known: _Known) -> _Solution:
    """Solve with the inertia that the torques tell, and count how far its error turns the compliance."""
    solution = _solve(rows, taken, replace(known, inertia_error=0.0))
    torque, acceleration = rows.torque - rows.torque.mean(), rows.acceleration - rows.acceleration.mean()
    turned = known.inertia_error * float(torque @ acceleration) / float(torque @ torque)
    place = solution.names.index(_COMPLIANCE)
    column = np.zeros(len(solution.names))
    column[place] = turned * solution.values[place]
    return replace(solution, root=np.column_stack([solution.root, column]))


def _information(names: list[str], rows: Array, log: NDArray[np.intp] | None) -> Information:
    """The rows of one joint, with the sums of neighbours that tell how far their errors are correlated in time."""
    count, width = len(names), rows.shape[1]
    empty = Factor(None, np.arange(count), np.zeros((width, width)), 0)
    sums = BatchSums((empty,))
    for part in [rows] if log is None else [rows[log == k] for k in np.unique(log)]:
        for start in range(0, len(part), 1024):
            sums.add([part[start : start + 1024]])
        sums.end()
    factor = Factor(None, np.arange(count), triangular(rows), len(rows))
    return Information(tuple(names), tuple(names), ("deflection",), (factor,), batch_means=sums.factors())


def _significant(
    rows: DeflectionRows, taken: list[str], known: _Known, now: _Solution
) -> tuple[list[str], _Solution] | None:
    """Return the further error of the encoder that explains most, where it is significant."""
    best: tuple[float, list[str], _Solution] | None = None
    for name, columns in ENCODER_ERRORS.items():
        # Over the range of an arm's joint a scale error is an eccentricity, too.
        if name in taken or {name, *taken} >= {"scale", "eccentricity"}:
            continue
        tried = _solve(rows, [*taken, name], known)
        # The torque of gravity on a single link is a cosine of its position, as an eccentricity is.
        if not tried.error(_COMPLIANCE) <= MOST_WIDENING * now.error(_COMPLIANCE):
            continue
        places = [tried.names.index(column) for column in columns]
        covariance = tried.root[places] @ tried.root[places].T
        distance = float(tried.values[places] @ np.linalg.pinv(covariance) @ tried.values[places]) / len(places)
        if distance > SIGNIFICANT**2 and (best is None or np.sum(tried.residual**2) < np.sum(best[2].residual ** 2)):
            best = (distance, [*taken, name], tried)
    if best is None or not np.sum(best[2].residual ** 2) < np.sum(now.residual**2):
        return None
    return best[1], best[2]


def _result(joint: str, rows: DeflectionRows, solution: _Solution, known: _Known, unit: str) -> JointStiffness:
    values = dict(zip(solution.names, solution.values, strict=True))
    errors = {name: solution.error(name) for name in solution.names}
    compliance = float(values[_COMPLIANCE])
    error = float(np.hypot(errors[_COMPLIANCE], compliance * known.scale_error))
    inertia, inertia_error = known.motor_inertia, np.nan
    if _INERTIA in values:
        inertia = values[_INERTIA] / compliance if compliance > 0.0 else np.nan
        # What is not the motor's of the inertia behind the torque is the links'; their scale is not known better.
        whole = rows.torque + known.motor_inertia * rows.acceleration
        moved = rows.acceleration - rows.acceleration.mean()
        behind = abs(float(whole @ moved) / float(moved @ moved))
        inertia_error = float(np.hypot(_inertia_error(solution), known.scale_error * behind))
    elif not known.inertia:
        inertia_error = known.inertia_error
    relaxation = float(values[_RELAXATION])  # D / K²
    relaxation_bound = relaxation + NORMAL * _error_alone(rows, solution)
    found = JointStiffness.of_compliance(joint, compliance, error, unit)
    return replace(
        found,
        damping=relaxation / compliance**2 if compliance > 0.0 else 0.0,
        damping_bound=relaxation_bound / compliance**2 if found.verdict == "measured" else np.inf,
        motor_inertia=float(inertia),
        motor_inertia_standard_error=float(inertia_error),
        delay=float(values.get("delay", 0.0)),
        delay_standard_error=float(errors.get("delay", 0.0)),
        zeros=tuple(float(value) for name, value in values.items() if name.startswith("zero ")),
        encoder_errors={
            name: float(values[name]) for columns in ENCODER_ERRORS.values() for name in columns if name in values
        },
        deflection=float(np.std(compliance * rows.torque)),
        unexplained=float(np.sqrt(np.mean(solution.residual**2))),
        count=int(rows.deflection.size),
    )


def _inertia_error(solution: _Solution) -> float:
    """Standard error of the inertia, the ratio of two values."""
    n, d = solution.names.index(_INERTIA), solution.names.index(_COMPLIANCE)
    if not solution.values[d] > 0.0:
        return float("nan")
    ratio = solution.values[n] / solution.values[d]
    return float(np.linalg.norm((solution.root[n] - ratio * solution.root[d]) / solution.values[d]))


def _error_alone(rows: DeflectionRows, solution: _Solution) -> float:
    """Standard error of the relaxation; where it is held at zero, that of a row's residual along its own column."""
    own = float(np.linalg.norm(solution.root[solution.names.index(_RELAXATION)]))
    if own > 0.0:
        return own
    size = float(np.sum((rows.torque_rate - rows.torque_rate.mean()) ** 2))
    return float(np.sqrt(np.mean(solution.residual**2) * 100.0 / size)) if size > 0.0 else np.inf
