"""Limits of a motion: positions, velocities, accelerations, torques and power of the joints, and their file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.display import html_table
from steelyard.errors import InputError
from steelyard.files import TomlTable, listed, read_number, read_toml, shown
from steelyard.robot import Robot

from .trajectory import Trajectory

__all__ = ["MotionLimits", "described_limits", "limits_from_file"]

Array = NDArray[np.float64]
JOINT_FIELDS = ("lower", "upper", "velocity", "acceleration", "torque", "power")


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of the motion of each joint; infinite where there is no limit.

    Attributes
    ----------
    joint_names : tuple of str
    lower, upper : ndarray
        (N,) positions, rad or m.
    velocity, acceleration : ndarray
        (N,) largest magnitudes, rad/s or m/s, and rad/s² or m/s².
    torque : ndarray
        (N,) largest magnitudes, N·m or N.
    power : ndarray
        (N,) largest magnitudes of torque times velocity, W.
    total_power : float
        Largest magnitude of the power of all joints together, W.

    Examples
    --------
    >>> limits = MotionLimits.of(["a", "b"], lower=-1, upper=[1, 2], velocity={"a": 3})
    >>> limits.upper.tolist(), limits.velocity.tolist()
    ([1.0, 2.0], [3.0, inf])
    """

    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    torque: Array
    power: Array
    total_power: float = float("inf")

    def __post_init__(self) -> None:
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        for name in JOINT_FIELDS:
            values = np.array(getattr(self, name), dtype=np.float64)
            if values.shape != (len(self.joint_names),) or np.isnan(values).any():
                raise InputError(
                    f"The limits {name!r} must be {len(self.joint_names)} numbers, one for each joint, got {values}."
                )
            object.__setattr__(self, name, values)
        self._check()

    def _check(self) -> None:
        for k, joint in enumerate(self.joint_names):
            if not self.lower[k] < self.upper[k]:
                raise InputError(
                    f"The lower limit of {joint} is {self.lower[k]:g} and the upper one {self.upper[k]:g}: "
                    "the joint cannot move; widen them by lower and upper in the limits, or lock the joint."
                )
            for name in JOINT_FIELDS[2:]:
                if not getattr(self, name)[k] > 0.0:
                    raise InputError(
                        f"The {name} limit of {joint} is {getattr(self, name)[k]:g}, but it must be positive for the "
                        "joint to move; correct it, or give inf where there is no limit."
                    )
        if not self.total_power > 0.0:
            raise InputError(f"total_power must be positive, in W, got {self.total_power}.")

    @classmethod
    def of(cls, joint_names: Sequence[str], **limits: Any) -> MotionLimits:
        """Build limits from numbers, lists, or mappings from joint names.

        Parameters
        ----------
        joint_names : sequence of str
        **limits
            Fields of this class: a number for all joints, a list with one number for each, or a mapping from some joint
            names to numbers. Quantities that are not named have no limit. ``effort`` is another name of ``torque``, as
            in robot.toml.

        Raises
        ------
        InputError
            If a limit or joint is unknown, the number of values is wrong, or a value is no number.
        """
        none = np.full(len(joint_names), np.inf)
        free = cls(tuple(joint_names), -none, none, none, none, none, none)
        return free.updated(limits)

    @classmethod
    def from_robot(cls, robot: Robot) -> MotionLimits:
        """Return the limits of the description: positions, velocities and efforts of the driving joints.

        The limits of a joint that mimics another one are limits of the joint that it mimics.
        """
        return cls(tuple(robot.joint_names), **described_limits(robot))

    @classmethod
    def for_robot(
        cls, robot: Robot, limits: MotionLimits | Mapping[str, Any] | None, where: str = "limits"
    ) -> MotionLimits:
        """Return the limits of the description with those of a mapping in their place, or given limits by their names.

        Raises
        ------
        InputError
            As `of` and `updated` do, or if the limits are of other joints, or nothing of the sort.
        """
        if isinstance(limits, MotionLimits):
            names, given = tuple(robot.joint_names), limits.joint_names
            if sorted(given) != sorted(names):
                raise InputError(
                    f"The limits are of the joints {listed(given)}, but {robot.name} has {listed(names)}; give limits "
                    "of these."
                )
            order = [given.index(name) for name in names]
            return replace(limits, joint_names=names, **{name: getattr(limits, name)[order] for name in JOINT_FIELDS})
        if limits is None:
            return cls.from_robot(robot)
        if not isinstance(limits, Mapping):
            raise InputError(
                f'{where} must be MotionLimits or a mapping such as {{"velocity": 1.0}}, got {shown(limits)}.'
            )
        # Limits of a description that no joint can move within may be replaced, and are not refused before.
        names, own = tuple(robot.joint_names), described_limits(robot)
        changes = _changes(names, own, limits, where)
        if changes.keys().isdisjoint(("lower", "upper")):
            cls.from_robot(robot)  # whose positions are refused as those of the description
        rows: dict[str, Any] = own | changes
        with _said_of(where):
            return cls(names, **rows)

    @classmethod
    def suffice(cls, robot: Robot) -> bool:
        """Return whether a motion can be designed with the limits of the description alone."""
        own = described_limits(robot)
        return bool(np.all(own["lower"] < own["upper"])) and not cls.from_robot(robot).endless

    @classmethod
    def envelope(cls, trajectories: Sequence[Trajectory], joint_names: Sequence[str], rate: float) -> MotionLimits:
        """Return the smallest limits that some trajectories keep: of positions, velocities and accelerations.

        Parameters
        ----------
        trajectories : sequence of Trajectory
        joint_names : sequence of str
        rate : float
            Rate at which the trajectories are sampled, Hz.
        """
        motions = [trajectory.sample(rate)[1:] for trajectory in trajectories]
        if not motions:
            raise InputError("An envelope needs at least one trajectory.")
        q, dq, ddq = (np.vstack([motion[k] for motion in motions]) for k in range(3))
        return cls.of(
            joint_names,
            lower=q.min(axis=0),
            upper=q.max(axis=0),
            velocity=np.abs(dq).max(axis=0),
            acceleration=np.abs(ddq).max(axis=0),
        )

    def updated(self, limits: Mapping[str, Any], where: str = "limits") -> MotionLimits:
        """Return these limits with some of them replaced.

        Parameters
        ----------
        limits : mapping
            As in `of`; joints that a mapping does not name keep their limits.
        where : str
            Origin of the limits, such as the path of a file, for messages.
        """
        own = {name: getattr(self, name) for name in JOINT_FIELDS}
        changes = _changes(self.joint_names, own, limits, where)
        with _said_of(where):
            return replace(self, **changes)

    @property
    def endless(self) -> tuple[str, ...]:
        """The joints whose motion nothing bounds: neither positions nor velocity nor acceleration have a limit."""
        limits = zip(self.joint_names, self.upper - self.lower, self.velocity, self.acceleration, strict=True)
        return tuple(name for name, *own in limits if not np.isfinite(own).any())

    def widening(self, robot: Robot) -> tuple[str, ...]:
        """Return the remark, if any, that these limits are wider than those of the robot's description.

        A number for all joints is wider for some of them than its author may think, as it is for a joint that others
        mimic: the limits of these are limits of the joint that drives them.
        """
        own, wider = described_limits(robot), []
        for name in JOINT_FIELDS:
            given, described = getattr(self, name), own[name]
            beyond = given < described if name == "lower" else given > described
            wider += [
                f"{name} of {self.joint_names[k]} ({given[k]:.4g}, there {described[k]:.4g})"
                for k in np.flatnonzero(beyond)
            ]
        if not wider:
            return ()
        return (f"Some limits are wider than those of the description: {listed(wider, 4)}.",)

    def reduced(self, margin: float) -> MotionLimits:
        """Return limits that are narrower by a fraction: with 0.1, a tenth of each range and magnitude stays free."""
        if not 0.0 <= margin < 1.0:
            raise InputError(f"margin must be a fraction from 0 to below 1, got {margin!r}.")
        span = self.upper - self.lower
        room = 0.5 * margin * np.where(np.isfinite(span), span, 0.0)
        scaled = {name: (1.0 - margin) * getattr(self, name) for name in (*JOINT_FIELDS[2:], "total_power")}
        return replace(self, lower=self.lower + room, upper=self.upper - room, **scaled)

    @property
    def ranges(self) -> tuple[Array, Array]:
        """Positions (N,) between which motions lie: the limits, and for a joint without any 1 rad or m either way of 0.

        A single limit is one end, and the other lies 1 beyond 0, or farther where less than 2 would be left.
        """
        lower = np.where(np.isfinite(self.lower), self.lower, np.minimum(self.upper - 2.0, -1.0))
        return lower, np.where(np.isfinite(self.upper), self.upper, np.maximum(lower + 2.0, 1.0))

    @property
    def needs_torque(self) -> bool:
        """Whether there is a limit of torque or power."""
        return bool(np.isfinite([*self.torque, *self.power, self.total_power]).any())

    def to_dict(self) -> dict[str, Any]:
        """Return the finite limits as plain data, by joint."""
        result: dict[str, Any] = {}
        for name in JOINT_FIELDS:
            row = getattr(self, name)
            finite = {j: float(x) for j, x in zip(self.joint_names, row, strict=True) if np.isfinite(x)}
            if finite:
                result[name] = finite
        return result | ({"total_power": self.total_power} if np.isfinite(self.total_power) else {})

    def __repr__(self) -> str:
        kinds = [f.name for f in fields(self) if f.name != "joint_names" and np.isfinite(getattr(self, f.name)).any()]
        return f"MotionLimits({len(self.joint_names)} joints: {', '.join(kinds) or 'none'})"

    def _repr_html_(self) -> str:
        rows = [
            (joint, *(f"{getattr(self, name)[k]:.4g}" for name in JOINT_FIELDS))
            for k, joint in enumerate(self.joint_names)
        ]
        return html_table("", ("joint", *JOINT_FIELDS), rows)


def described_limits(robot: Robot) -> dict[str, Any]:
    """Return the rows of limits (N,) that the description has, also such within which no joint can move."""
    count = robot.dof
    lower, upper = robot.position_limits
    velocity, torque = np.full(count, np.inf), np.full(count, np.inf)
    for joint in robot.joints:
        k = joint.coordinate
        if joint.multiplier != 0.0:
            velocity[k] = min(velocity[k], joint.velocity_limit / abs(joint.multiplier))
        if joint.mimics is None:
            torque[k] = joint.effort_limit
    none = np.full(count, np.inf)
    return dict(zip(JOINT_FIELDS, (lower, upper, velocity, none, torque, none), strict=True))


def _changes(names: tuple[str, ...], own: Mapping[str, Array], limits: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the fields that a mapping of limits changes; `own` are the rows (N,) before."""
    known = (*JOINT_FIELDS, "total_power")
    changes: dict[str, Any] = {}
    for given, value in limits.items():
        key = "torque" if given == "effort" else given
        if key not in known:
            raise InputError(f"{where}: {shown(given)} is no limit; there are {', '.join(known)}.")
        if key in changes:
            raise InputError(f"{where}: torque and effort are the same limit; keep one of them.")
        if key == "total_power":
            changes[key] = read_number(value, f"{where}: total_power", infinite=True)
        else:
            changes[key] = _row(names, own[key], key, value, where)
    return changes


def _row(names: tuple[str, ...], own: Array, key: str, value: Any, where: str) -> Array:
    if isinstance(value, Mapping):
        row = own.copy()
        for name, number in value.items():
            if name not in names:
                raise InputError(f"{where}: {key} names a joint {shown(name)}; the joints are {listed(names)}.")
            row[names.index(name)] = read_number(number, f"{where}: {key} of {name}", infinite=True)
        return np.asarray(row)
    if not isinstance(value, list | tuple | np.ndarray) or (isinstance(value, np.ndarray) and value.ndim == 0):
        return np.full(len(names), read_number(value, f"{where}: {key}", infinite=True))
    values: list[Any] = list(value)
    if len(values) != len(names):
        raise InputError(
            f"{where}: {key} has {len(values)} values, but there are {len(names)} joints: {listed(names)}."
        )
    return np.array(
        [read_number(v, f"{where}: {key} of {n}", infinite=True) for n, v in zip(names, values, strict=True)]
    )


@contextmanager
def _said_of(where: str) -> Iterator[None]:
    """Say where limits come from that cannot be kept."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


_LIMITS = (*JOINT_FIELDS, "effort", "total_power")


def limits_from_file(path: str | Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read a limits file.

    Parameters
    ----------
    path : str or Path
        A TOML file. At its top level, or in a table ``[limits]``, it has ``lower``, ``upper``, ``velocity``,
        ``acceleration``, ``torque`` (or ``effort``) and ``power``, each a number for all joints, a list with one number
        for each, or a table by joint name; and ``total_power``.

    Returns
    -------
    limits : dict
        The limits, for :meth:`MotionLimits.updated`.
    sections : dict
        The other tables, which describe obstacles.

    Raises
    ------
    InputError
        If the file cannot be read, or has an unknown key.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "limits.toml"
    ...     _ = path.write_text("velocity = 2\\nacceleration = [4, 5]")
    ...     limits_from_file(path)
    ({'velocity': 2, 'acceleration': [4, 5]}, {})
    """
    place = Path(path)
    content = read_toml(place, remedy="give a limits file")
    limits = dict(TomlTable(content.pop("limits", {}), f"{place}, [limits]", _LIMITS, "is no limit"))
    sections = {key: value for key, value in content.items() if key not in _LIMITS and isinstance(value, dict | list)}
    above = {key: value for key, value in content.items() if key not in sections}
    for key, value in TomlTable(above, str(place), _LIMITS, "is no limit").items():
        if key in limits:
            raise InputError(f"{place}: {key} stands both at the top and in [limits]; keep one of them.")
        limits[key] = value
    return limits, sections
