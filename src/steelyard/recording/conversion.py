"""From the columns of a log to joint positions in rad or m and torques in N·m or N."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from steelyard.errors import InputError

from .columns import POSITION_UNITS, TIME_UNITS, TORQUE_UNITS, VELOCITY_UNITS, LogColumns
from .header import Layout

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Columns = dict[str, NDArray[np.float64]]

__all__ = ["Signals", "convert", "require_numbers"]

PER_SECOND = {"rad": "rad/s", "deg": "deg/s", "m": "m/s", "mm": "mm/s"}


@dataclass(frozen=True, eq=False)
class Signals:
    """Rows of a log in SI units and in the order of the joints; t is None for a log without time column."""

    t: NDArray[np.float64] | None
    q: NDArray[np.float64]
    torque: NDArray[np.float64]
    velocity: NDArray[np.float64] | None
    acceleration: NDArray[np.float64] | None

    def joined(self, other: Signals) -> Signals:
        """Put the rows of `other` below these."""

        def stack(a: NDArray[np.float64] | None, b: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
            return None if a is None or b is None else np.concatenate([a, b])

        return Signals(
            stack(self.t, other.t),
            np.concatenate([self.q, other.q]),
            np.concatenate([self.torque, other.torque]),
            stack(self.velocity, other.velocity),
            stack(self.acceleration, other.acceleration),
        )

    def rows(self, start: int, stop: int) -> Signals:
        """Return the rows start:stop, as copies, so that the rest can be released."""

        def cut(a: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
            return None if a is None else a[start:stop].copy()

        q, torque = self.q[start:stop].copy(), self.torque[start:stop].copy()
        return Signals(cut(self.t), q, torque, cut(self.velocity), cut(self.acceleration))


def convert(raw: Columns, layout: Layout, columns: LogColumns, where: Callable[[int], str], source: str) -> Signals:
    """Apply units, gains, matrices, offsets and signs to the columns of a log.

    Raises
    ------
    InputError
        For values that are missing, NaN or infinite, and where a list in [log] has the wrong length.
    """
    needed: Sequence[str] = layout.names
    if columns.missing == "fill":
        needed = [name for name in layout.names if name == layout.time]
        raw = {
            name: values if name in needed else np.where(np.isfinite(values), values, np.nan)
            for name, values in raw.items()
        }
    require_numbers(raw, needed, where, source)
    velocity_unit = columns.velocity_unit
    if velocity_unit is None:
        unit = columns.position_unit
        velocity_unit = PER_SECOND[unit] if isinstance(unit, str) else tuple(PER_SECOND[item] for item in unit)
    q = _motion(raw, layout.position, POSITION_UNITS, columns.position_unit, "position_unit", columns, source)
    if columns.position_offset is not None:
        q += _list_of(columns.position_offset, q.shape[1], "position_offset", source)
    velocity = acceleration = None
    if layout.velocity is not None:
        velocity = _motion(raw, layout.velocity, VELOCITY_UNITS, velocity_unit, "velocity_unit", columns, source)
    if layout.acceleration is not None:
        acceleration = _motion(
            raw, layout.acceleration, VELOCITY_UNITS, velocity_unit, "velocity_unit", columns, source
        )
    torque = _stacked(raw, layout.torque)
    torque *= _scales(TORQUE_UNITS, columns.torque_unit, len(layout.torque), "torque_unit", source)
    if columns.gain is not None:
        torque *= _list_of(columns.gain, torque.shape[1], "gain", source)
    if columns.torque_matrix is not None:
        torque = torque @ np.array(columns.torque_matrix).T
    if columns.torque_sign is not None:
        sign = columns.torque_sign
        torque *= sign if isinstance(sign, float) else _list_of(sign, torque.shape[1], "torque_sign", source)
    t = None if layout.time is None else raw[layout.time] * TIME_UNITS[layout.time_unit]
    return Signals(t, q, torque, velocity, acceleration)


def require_numbers(raw: Columns, names: Sequence[str], where: Callable[[int], str], source: str) -> None:
    """Refuse values of the columns `names` that are missing, NaN or infinite."""
    bad = {name: ~np.isfinite(raw[name]) for name in names if not np.isfinite(raw[name]).all()}
    if not bad:
        return
    rows = np.logical_or.reduce(list(bad.values()))
    first = int(np.argmax(rows))
    name = next(name for name, flags in bad.items() if flags[first])
    others = f" and {len(bad) - 1} other columns" if len(bad) > 1 else ""
    raise InputError(
        f"{source} has no finite number in column {name!r}{others} in {np.count_nonzero(rows)} of {rows.size} rows, "
        f"first on {where(first)} ({_spell(raw[name][first])}); remove those rows, split the log there, or state "
        '`missing = "fill"` in [log].'
    )


def _spell(value: float) -> str:
    return "missing or NaN" if np.isnan(value) else "infinite"


def _stacked(raw: Columns, names: Sequence[str]) -> NDArray[np.float64]:
    array = np.empty((raw[names[0]].shape[0], len(names)))
    for index, name in enumerate(names):
        array[:, index] = raw[name]
    return array


def _motion(
    raw: Columns,
    names: Sequence[str],
    units: dict[str, float],
    unit: str | tuple[str, ...],
    key: str,
    columns: LogColumns,
    source: str,
) -> NDArray[np.float64]:
    array = _stacked(raw, names)
    array *= _scales(units, unit, len(names), key, source)
    return array if columns.position_matrix is None else array @ np.array(columns.position_matrix).T


def _scales(
    units: dict[str, float], unit: str | tuple[str, ...], count: int, key: str, source: str
) -> float | NDArray[np.float64]:
    if isinstance(unit, str):
        return units[unit]
    return _list_of(tuple(units[item] for item in unit), count, key, source)


def _list_of(values: tuple[float, ...], count: int, key: str, source: str) -> NDArray[np.float64]:
    if len(values) != count:
        raise InputError(
            f"{source} needs {count} values in `{key}` of [log] but there are {len(values)}; give one for each."
        )
    return np.array(values)
