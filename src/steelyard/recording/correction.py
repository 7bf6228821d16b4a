"""Corrections of a log or of its robot file, applied to samples and written as lines of robot.toml."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.robot import RobotFile

from .columns import POSITION_UNITS, TIME_UNITS, TORQUE_UNITS, LogColumns
from .recognition import Layout
from .samples import Samples

__all__ = ["Correction", "Settings", "correction_settings", "toml_inline", "toml_text", "toml_value"]

Array = NDArray[np.float64]
BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")  # of TOML, that needs no quotes
ALIKE, OF_TORQUES = (("rad", "deg", "rev", "mrad", "mdeg"), ("m", "mm"), ("A", "mA")), ("N·m", "mN·m")
"""Units of one kind; torques have further spellings, for which these stand."""
Settings = dict[str, Any]
"""Sections of a robot file by name, each a table; `terms` is a list of tables."""


@dataclass(frozen=True, eq=False)
class Correction:
    """A change of a log, of the robot's mounting, or of the terms of its model.

    Attributes
    ----------
    positions : ndarray or None
        (N, N): positions, velocities and accelerations are this times those of the log.
    offset : ndarray or None
        (N,) rad or m, added to the positions.
    torques : ndarray or None
        (N, N): torques are this times those of the log.
    time : float
        Times are this times those of the log.
    delay : float
        s by which torques are logged later than the motion.
    gravity : ndarray or None
        (3,) m/s², in place of the robot's own.
    terms : tuple of str
        Kinds of terms that the model lacks.
    coupling : ndarray or None
        (N, N), by which torques of motors become those of joints: all terms are then those of the motors, and `terms`.
    payload : (str, float, float) or None
        A link and what it weighs with all that it carries, kg, with the standard deviation.

    Examples
    --------
    >>> samples = Samples(q=[[1.0, 2.0]], dq=[[0.0, 0.0]], ddq=[[0.0, 0.0]], torque=[[3.0, 4.0]])
    >>> Correction(torques=np.diag([1.0, -1.0])).apply(samples).torque.tolist()
    [[3.0, -4.0]]
    """

    positions: Array | None = None
    offset: Array | None = None
    torques: Array | None = None
    time: float = 1.0
    delay: float = 0.0
    gravity: Array | None = None
    terms: tuple[str, ...] = ()
    coupling: Array | None = None
    payload: tuple[str, float, float] | None = None

    def apply(self, samples: Samples) -> Samples:
        """Return the samples as they would be; gravity, terms, coupling and payload change the model and not them."""
        q, dq, ddq, torque, mask = samples.q, samples.dq, samples.ddq, samples.torque, samples.mask
        if self.delay:
            q, dq, ddq = _earlier(samples, self.delay)
        if self.positions is not None:
            q, dq, ddq = (array @ self.positions.T for array in (q, dq, ddq))
            if mask is not None:  # which rows are used goes by how fast the joint is
                mask = ~((~mask) @ (self.positions.T != 0.0))
        if self.offset is not None:
            q = q + self.offset
        if self.time != 1.0:
            dq, ddq = dq / self.time, ddq / self.time**2
        if self.torques is not None:
            torque = torque @ self.torques.T
        return replace(samples, q=q, dq=dq, ddq=ddq, torque=torque, mask=mask, regressor=None, regressor_model=None)


def _earlier(samples: Samples, delay: float) -> tuple[Array, Array, Array]:
    """Return positions, velocities and accelerations as they were by the delay before.

    Between rows they follow the polynomials of fifth degree that have the values of all three at both ends.
    """
    t = samples.t
    assert t is not None
    at = np.clip(t - delay, t[0], t[-1])
    left = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    h = (t[left + 1] - t[left])[:, None]
    u = (at - t[left])[:, None] / h
    q, slope, bend = samples.q, samples.dq, 0.5 * samples.ddq
    a, b, c = q[left], slope[left] * h, bend[left] * h * h
    rise, steepening, bending = q[left + 1] - a - b - c, slope[left + 1] * h - b - 2 * c, bend[left + 1] * h * h - c
    d = 10 * rise - 4 * steepening + bending
    e = -15 * rise + 7 * steepening - 2 * bending
    f = 6 * rise - 3 * steepening + bending
    return (
        a + u * (b + u * (c + u * (d + u * (e + u * f)))),
        (b + u * (2 * c + u * (3 * d + u * (4 * e + u * 5 * f)))) / h,
        (2 * c + u * (6 * d + u * (12 * e + u * 20 * f))) / h**2,
    )


def correction_settings(
    correction: Correction, file: RobotFile, joint_names: Sequence[str], layout: Layout | None = None
) -> Settings:
    """Return what robot.toml must say for the correction to be made, with what it says already taken into account.

    Parameters
    ----------
    joint_names : sequence of str
        Of the N joints that move.
    layout : Layout, optional
        The columns of the log; with it, columns are put in order by their names.

    Returns
    -------
    dict
        Keys to add or to replace, by section; none where no key says it, as of times in thousands of s. Tables under
        `constraints` are further ones of their kind, and `terms` are all the terms.
    """
    columns = LogColumns.from_dict(file.section("log"), "[log]")
    log: Settings = {}
    count = len(joint_names)
    if correction.positions is not None or correction.offset is not None:
        log.update(_position_settings(correction, columns, layout, count))
    if correction.torques is not None:
        log.update(_torque_settings(correction.torques, columns, layout, count))
    if correction.time != 1.0:
        log.update(_time_settings(correction.time, columns, layout))
    settings: Settings = {"log": log} if log else {}
    if correction.delay:
        stated = file.section("processing").get("delay", 0.0)
        before = np.asarray(0.0 if isinstance(stated, str) else stated, dtype=float)
        settings["processing"] = {"delay": _rounded((before + correction.delay).tolist(), 3)}
    if correction.gravity is not None:
        settings["description"] = {"gravity": _rounded((correction.gravity + 0.0).tolist(), 8)}
    if correction.coupling is not None:
        # Data do not tell the drag of a motor that turns with one joint from that of the joint.
        motors = {"kind": "motor_side", "coupling": correction.coupling.astype(int).tolist()}
        settings["terms"] = [motors, *({"kind": kind} for kind in correction.terms)]
    elif correction.terms:
        settings["terms"] = [*file.terms, *({"kind": kind} for kind in correction.terms)]
    if correction.payload is not None:
        link, mass, deviation = correction.payload
        weighed = {"links": [link], "value": _rounded(mass, 3), "standard_deviation": _rounded(deviation, 3)}
        settings["constraints"] = {"measured_mass": [weighed]}
    return settings


def _position_settings(correction: Correction, columns: LogColumns, layout: Layout | None, count: int) -> Settings:
    found: Settings = {}
    matrix, offset = correction.positions, columns.position_offset
    if matrix is not None:
        order, factors = _order(matrix), _diagonal(matrix)
        plain = columns.position_matrix is None
        units = _units(columns.position_unit or "rad", count) if layout is None else layout.units["position"]
        if order is not None and plain and offset is None and layout is not None and len(set(units)) == 1:
            for kind in ("position", "velocity", "acceleration"):
                names = getattr(layout, kind)
                if names is not None:
                    found[kind] = [names[k] for k in order]
        elif factors is not None and plain and (changed := _changed_units(units, factors, POSITION_UNITS)) is not None:
            found["position_unit"] = changed
        else:
            before = np.eye(count) if plain else np.array(columns.position_matrix)
            found["position_matrix"] = _rounded((matrix @ before).tolist(), 8)
            if offset is not None:
                found["position_offset"] = _angles(matrix @ np.array(offset))
    if correction.offset is not None:
        found["position_offset"] = _angles(correction.offset + (0.0 if offset is None else np.array(offset)))
    return found


def _torque_settings(matrix: Array, columns: LogColumns, layout: Layout | None, count: int) -> Settings:
    order, factors = _order(matrix), _diagonal(matrix)
    plain = columns.torque_matrix is None
    sign = np.ones(count) * (1.0 if columns.torque_sign is None else np.array(columns.torque_sign))
    if factors is not None and np.all(np.abs(factors) == 1.0):
        signs = (sign * factors).astype(int).tolist()
        return {"torque_sign": signs[0] if len(set(signs)) == 1 else signs}
    units = _units(columns.torque_unit or "N·m", count) if layout is None else layout.units["torque"]
    if order is not None and plain and layout is not None:
        of_columns = len(set(units)) == 1 and columns.gain is None and len(set(sign.tolist())) == 1
        if of_columns:
            return {"torque": [layout.torque[k] for k in order]}
    if factors is not None and plain:
        changed = _changed_units(units, factors, TORQUE_UNITS)
        if changed is not None:
            return {"torque_unit": changed}
        gain = np.ones(count) if columns.gain is None else np.array(columns.gain)
        return {"gain": _rounded((gain * factors).tolist(), 4)}
    before = np.eye(count) if plain else np.array(columns.torque_matrix)
    return {"torque_matrix": _rounded((np.diag(sign) @ matrix @ np.diag(sign) @ before).tolist(), 8)}


def _time_settings(factor: float, columns: LogColumns, layout: Layout | None) -> Settings:
    if columns.rate is not None:
        return {"rate": _rounded(columns.rate / factor, 9)}
    unit = columns.time_unit or ("s" if layout is None else layout.time_unit)
    wanted = TIME_UNITS[unit] * factor
    units = [name for name, scale in TIME_UNITS.items() if abs(scale / wanted - 1.0) < 0.01]
    return {"time_unit": units[0]} if units else {}


def _order(matrix: Array) -> list[int] | None:
    """Return which column comes at each place, of a matrix that changes the order and nothing else."""
    is_order = np.all((matrix == 0.0) | (matrix == 1.0)) and np.all(matrix.sum(axis=0) == 1.0)
    return [int(k) for k in np.argmax(matrix, axis=1)] if is_order and np.all(matrix.sum(axis=1) == 1.0) else None


def _diagonal(matrix: Array) -> Array | None:
    own: Array = np.diag(matrix)
    return own if np.array_equal(matrix, np.diag(own)) else None


def _units(unit: str | tuple[str, ...], count: int) -> tuple[str, ...]:
    return (unit,) * count if isinstance(unit, str) else unit


def _changed_units(units: Sequence[str], factors: Array, scales: Mapping[str, float]) -> str | list[str] | None:
    """The units that are these factors larger, or None where one of them has no name."""
    if len(units) != len(factors):
        return None
    found = []
    for unit, factor in zip(units, factors, strict=True):
        family = next((names for names in ALIKE if unit in names), OF_TORQUES)
        names = (unit,) if factor == 1.0 else family
        match = [name for name in names if abs(scales[name] / (scales[unit] * factor) - 1.0) < 1e-6]
        if not match:
            return None
        found.append(match[0])
    return found[0] if len(set(found)) == 1 else found


def _angles(values: Array) -> list[float | str]:
    """Numbers, with the multiples of 30 degrees that are no round numbers in words."""
    return [_angle(float(value)) for value in values]


def _angle(value: float) -> float | str:
    names = {0.5: "pi/2", 1.0: "pi", 1 / 3: "pi/3", 2 / 3: "2*pi/3", 1 / 6: "pi/6", 5 / 6: "5*pi/6"}
    for part, name in names.items():
        if abs(abs(value) - part * pi) < 1e-9:
            return name if value > 0 else f"-{name}"
    return float(_rounded(value, 5))


def _rounded(value: Any, digits: int) -> Any:
    """Round to so many significant digits; whole numbers are written without a point."""
    if isinstance(value, list):
        return [_rounded(item, digits) for item in value]
    rounded = float(f"{value:.{digits}g}")
    return int(rounded) if rounded.is_integer() and abs(rounded) < 1e9 else rounded


def toml_text(settings: Settings) -> str:
    """Write settings as TOML, section by section.

    Examples
    --------
    >>> print(toml_text({"log": {"torque_sign": [1, -1]}, "terms": [{"kind": "viscous"}]}))
    [log]
    torque_sign = [1, -1]
    <BLANKLINE>
    [[terms]]
    kind = "viscous"
    """
    parts: list[str] = []
    for section, content in settings.items():
        if section == "terms":
            parts.extend("[[terms]]\n" + _keys(table) for table in content)
        elif section == "constraints":
            for kind, tables in content.items():
                parts.extend(f"[[constraints.{kind}]]\n" + _keys(table) for table in tables)
        else:
            parts.append(f"[{section}]\n" + _keys(content))
    return "\n\n".join(parts)


def toml_inline(settings: Settings) -> str:
    """Name settings in a sentence.

    Examples
    --------
    >>> toml_inline({"log": {"torque_sign": [1, -1]}})
    '`torque_sign = [1, -1]` in [log]'
    >>> toml_inline({"terms": [{"kind": "viscous"}, {"kind": "rotor_inertia"}]})
    '[[terms]] with `kind = "viscous"`, `kind = "rotor_inertia"`'
    """
    parts: list[str] = []
    for section, content in settings.items():
        if section == "terms":
            parts.append("[[terms]] with " + ", ".join(f"`{_inline(table)}`" for table in content))
        elif section == "constraints":
            for kind, tables in content.items():
                parts.extend(f"`{_inline(table)}` in [[constraints.{kind}]]" for table in tables)
        else:
            parts.append(f"`{_inline(content)}` in [{section}]")
    return " and ".join(parts)


def _keys(table: Mapping[str, Any]) -> str:
    return "\n".join(f"{key} = {toml_value(value)}" for key, value in table.items())


def _inline(table: Mapping[str, Any]) -> str:
    return "; ".join(f"{key} = {toml_value(value)}" for key, value in table.items())


def toml_value(value: Any) -> str:
    r"""Write a value as TOML.

    Examples
    --------
    >>> print(toml_value(["a\tb", 1.5, True]))
    ["a\tb", 1.5, true]
    """
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        pairs = (
            f"{key if BARE_KEY.fullmatch(key) else toml_value(key)} = {toml_value(item)}" for key, item in value.items()
        )
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    return f"{value!r}"
