"""Conversion of the columns of a log to measurements in SI units: units, gains, matrices, and the times of the rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.graph.column_passes import column_facts, side_by_side

from .clock import ClockStatistics, clock_of
from .columns import ACCELERATION_UNITS, POSITION_UNITS, TORQUE_UNITS, VELOCITY_UNITS, LogColumns
from .even import filled
from .formats import Columns, LogFiles
from .measurements import check_order
from .recognition import Layout
from .samples import is_finite
from .survey import require_no_degrees, turned_on, without_dropouts, without_wild

__all__ = [
    "Signals",
    "checked_columns",
    "clock_at",
    "convert",
    "log_columns",
    "require_numbers",
    "signals_fields",
    "times",
]


@dataclass(frozen=True, eq=False)
class Signals:
    """Rows of a log in SI units and in the order of the joints; t is None for a log without time column."""

    t: NDArray[np.float64] | None
    q: NDArray[np.float64]
    torque: NDArray[np.float64]
    velocity: NDArray[np.float64] | None
    acceleration: NDArray[np.float64] | None
    channels: Mapping[str, NDArray[np.float64]] | None = None


def checked_columns(
    raw: Columns, layout: Layout, columns: LogColumns, where: Callable[[int], str], source: str
) -> Columns:
    """Return columns of a log in which a number is there or, where `columns` allows it, NaN.

    Raises
    ------
    InputError
        For values that are missing, NaN or infinite where they may not be.
    """
    needed: Sequence[str] = layout.names
    if columns.missing == "fill":
        needed = [name for name in layout.names if name in layout.stamps]
        raw = {
            name: values if name in needed else np.where(np.isfinite(values), values, np.nan)
            for name, values in raw.items()
        }
    spare = {"velocity": layout.velocity, "acceleration": layout.acceleration}
    require_numbers(raw, needed, where, source, layout.stamps, spare, layout.torque)
    return raw


def convert(raw: Sequence[Columns], layout: Layout, columns: LogColumns, source: str) -> Signals:
    """Apply units, gains, matrices, offsets and signs to the columns of a log, in parts that follow one another.

    Raises
    ------
    InputError
        Where a list in [log] has the wrong length.
    """
    q = _motion(raw, layout.position, POSITION_UNITS, layout.units["position"], columns)
    if columns.position_offset is not None:
        q += _list_of(columns.position_offset, q.shape[1], "position_offset", source)
    velocity = acceleration = None
    if layout.velocity is not None:
        velocity = _motion(raw, layout.velocity, VELOCITY_UNITS, layout.units["velocity"], columns)
    if layout.acceleration is not None:
        acceleration = _motion(raw, layout.acceleration, ACCELERATION_UNITS, layout.units["acceleration"], columns)
    torque = _scaled(_stacked(raw, layout.torque), [TORQUE_UNITS[unit] for unit in layout.units["torque"]])
    if columns.gain is not None and not isinstance(columns.gain, str):
        known = tuple(1.0 if isinstance(one, str) else one for one in columns.gain)
        torque *= _list_of(known, torque.shape[1], "gain", source)
    if columns.torque_matrix is not None:
        torque = torque @ np.array(columns.torque_matrix).T
    if columns.torque_sign is not None:
        sign = columns.torque_sign
        torque *= sign if isinstance(sign, float) else _list_of(sign, torque.shape[1], "torque_sign", source)
    t = None if layout.time is None else np.concatenate([layout.seconds(part) for part in raw])
    channels = {name: _stacked(raw, own) for name, own in layout.channels} or None
    return Signals(t, q, torque, velocity, acceleration, channels)


def require_numbers(
    raw: Columns,
    names: Sequence[str],
    where: Callable[[int], str],
    source: str,
    stamps: Sequence[str],
    spare: Mapping[str, Sequence[str] | None] | None = None,
    torque: Sequence[str] = (),
) -> None:
    """Refuse values of the columns `names` that are missing, NaN or infinite.

    Those of `stamps` cannot be filled, those of `spare` can be left out, and joints of which no torque is there, of the
    columns `torque`, be excluded.
    """
    doubtful = [name for name in names if not is_finite(raw[name])]
    bad = {name: flags for name, flags in ((name, ~np.isfinite(raw[name])) for name in doubtful) if flags.any()}
    if not bad:
        return
    rows = np.logical_or.reduce(list(bad.values()))
    first = int(np.argmax(rows))
    name = next(name for name, flags in bad.items() if flags[first])
    others = f" and {len(bad) - 1} other column{'s' * (len(bad) > 2)}" if len(bad) > 1 else ""
    remedy = 'remove those rows, split the log there, or state `missing = "fill"` in [log].'
    if not bad.keys().isdisjoint(stamps):
        remedy = "remove those rows, or split the log there: times are not filled."
    kind = next((kind for kind, own in (spare or {}).items() if bad.keys() <= set(own or ())), None)
    empty = [column for column in torque if column in bad and bad[column].all()]
    if empty and len(empty) == len(bad) < len(torque):  # drivers that report no torque of a joint
        joints = [k + 1 for k, column in enumerate(torque) if column in empty]
        remedy = (
            f"no torque of {'this joint was' if len(joints) == 1 else 'these joints was'} logged: state "
            f'`missing = "fill"` in [log] and `exclude_joints = {joints}` in [processing], which use the rest.'
        )
    if kind is not None:  # drivers that measure no velocities write NaN
        remedy = f'leave out what was measured of this kind with `{kind} = "none"` in [log], or remove those rows.'
    raise InputError(
        f"{source} has no finite number in column {name!r}{others} in {np.count_nonzero(rows)} of {rows.size} rows, "
        f"first on {where(first)} ({_spell(raw[name][first])}); {remedy}"
    )


def _spell(value: float) -> str:
    return "missing or NaN" if np.isnan(value) else "infinite"


def _stacked(raw: Sequence[Columns], names: Sequence[str]) -> NDArray[np.float64]:
    """The columns side by side, with NaN where a joint has none."""
    return side_by_side(
        [[part[name] if name else np.full(len(next(iter(part.values()))), np.nan) for name in names] for part in raw]
    )


def _scaled(array: NDArray[np.float64], scales: Sequence[float]) -> NDArray[np.float64]:
    if any(scale != 1.0 for scale in scales):
        array *= scales
    return array


def _motion(
    raw: Sequence[Columns], names: Sequence[str], scales: Mapping[str, float], units: Sequence[str], columns: LogColumns
) -> NDArray[np.float64]:
    array = _scaled(_stacked(raw, names), [scales[unit] for unit in units])
    return array if columns.position_matrix is None else array @ np.array(columns.position_matrix).T


def _list_of(values: tuple[float, ...], count: int, key: str, source: str) -> NDArray[np.float64]:
    if len(values) != count:
        raise InputError(
            f"{source} needs {count} values in `{key}` of [log] but there are {len(values)}; give one for each."
        )
    return np.array(values)


def log_columns(columns: LogColumns | dict[str, Any] | None) -> LogColumns:
    """Return `columns` as LogColumns."""
    if columns is None:
        return LogColumns()
    return columns if isinstance(columns, LogColumns) else LogColumns.from_dict(columns)


def signals_fields(signals: Signals, t: NDArray[np.float64], layout: Layout, source: str) -> dict[str, Any]:
    """Return the arrays of a Recording by the names of its fields, with values filled and turns put together.

    Raises
    ------
    InputError
        Where positions are degrees modulo a turn that were read in radians, or a column has too few numbers.
    """
    fields: dict[str, Any] = {"t": t, "position_missing": None, "torque_missing": None}
    facts = column_facts(signals.q)
    if not layout.has_matrix:
        require_no_degrees(signals.q, layout.position, source, facts)
    q, _ = turned_on(signals.q, facts)
    q = without_wild(t, q, facts if q is signals.q else None)
    signals = replace(signals, q=q, torque=without_dropouts(signals.torque))
    for name in ("q", "torque", "velocity", "acceleration"):
        values, missing = filled(t, getattr(signals, name), "position" if name == "q" else name, source)
        fields[name] = values
        if missing is not None:
            kind = "torque_missing" if name == "torque" else "position_missing"
            fields[kind] = missing if fields[kind] is None else fields[kind] | missing
    if signals.channels is not None:
        fields["channels"] = {name: filled(t, one, name, source)[0] for name, one in signals.channels.items()}
    return fields


def times(
    signals: Signals,
    columns: LogColumns,
    files: LogFiles,
    first_row: int = 0,
    origin: float | None = None,
    clock: ClockStatistics | None = None,
) -> tuple[NDArray[np.float64], float | None]:
    """Return the times of the rows and the stated rate.

    A stated rate replaces the stamps, which must then agree with it on the whole to 1 %; rows that are missing between
    them by `clock` (see `clock_at`) stay missing. `first_row` is the place of the first row in the log and `origin` the
    time of the log's first row, where these are rows from its middle.
    """
    rate, stamps = columns.rate, signals.t
    if rate is None:
        assert stamps is not None
        check_order(stamps, lambda row: files.where(first_row + row), files.name)
        return stamps, None
    count = signals.q.shape[0]
    numbers = first_row + np.arange(count) if clock is None else clock.numbers(first_row, first_row + count)
    if stamps is None:
        return numbers / rate, rate
    span = float(stamps[-1] - stamps[0])
    if count > 100 and abs(span * rate / (numbers[-1] - numbers[0]) - 1.0) > 0.01:
        raise InputError(
            f"{files.name} has {count} rows in {span:.6g} s by its stamps, "
            f"a period of {span / (count - 1):.6g} s, but `rate` in [log] says {rate:.6g} Hz; "
            "leave out `rate`, or `time`, or correct `time_unit`."
        )
    begin = float(stamps[0]) if origin is None else origin
    return begin + numbers / rate, rate


def clock_at(rate: float, stamps: Iterable[NDArray[np.float64]]) -> ClockStatistics | None:
    """Return the clock of stamps that come in blocks, where rows are missing in it and it agrees with the rate.

    None where no rows are missing between the stamps, or they are too coarse to tell.
    """
    last = -np.inf

    def increasing() -> Iterator[NDArray[np.float64]]:
        nonlocal last
        for block in stamps:
            if not (np.diff(block) > 0.0).all() or not block[0] > last:
                raise _CoarseStampsError
            last = block[-1]
            yield block

    try:
        clock = clock_of(increasing())
    except _CoarseStampsError:
        return None
    return clock if len(clock.gaps) and abs(clock.period * rate - 1.0) < 0.01 else None


class _CoarseStampsError(ValueError):
    """Stamps repeat, so that they cannot number the rows."""
