"""Measurements of a robot's joints in SI units: the content of a log, before any signal processing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import html_table, joint_label
from steelyard.errors import InputError
from steelyard.files.arguments import LARGEST
from steelyard.graph.column_passes import ColumnFacts, column_facts
from steelyard.once import cached_property

from .samples import checked_channels, cut_channels, read_only_matrix, read_only_vector, require_finite

if TYPE_CHECKING:
    from .recognition import Layout

__all__ = ["Measurements", "check_order", "check_period", "rate_between_pauses"]

SHORTEST_PERIOD, LONGEST_PERIOD = 1e-6, 0.5  # s
PAUSE = 10.0
"""Periods between two rows from which nothing was recorded: runs and episodes that follow each other in one file may be
minutes apart, or days, which say nothing of the rate."""


@dataclass(frozen=True, eq=False, repr=False)
class Measurements:
    """Measured positions and torques of N joints at S instants, in SI units: the data of a `Recording`.

    Everything that looks at a log works on this class; `Recording` adds reading, processing and writing to it.

    The parameters are those of `Recording`, which explains them.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(1000) / 1000
    >>> Measurements(t=t, q=np.sin(t)[:, None], torque=np.cos(t)[:, None], source="sine")
    Measurements('sine', 1000 rows x 1 joints, 0.999 s at 1000 Hz)
    """

    t: NDArray[np.float64]
    q: NDArray[np.float64]
    torque: NDArray[np.float64]
    velocity: NDArray[np.float64] | None = None
    acceleration: NDArray[np.float64] | None = None
    source: str = "recording"
    joint_names: tuple[str, ...] | None = None
    remarks: tuple[str, ...] = ()
    stated_rate: float | None = None
    first_row: int = 0
    position_missing: NDArray[np.bool_] | None = None
    torque_missing: NDArray[np.bool_] | None = None
    layout: Layout | None = None
    channels: Mapping[str, NDArray[np.float64]] | None = None
    clock_origin: int = 0
    facts: Mapping[str, ColumnFacts] = field(init=False, repr=False)
    """What each column of q, torque, velocity and acceleration holds, as far as these are there."""

    def __post_init__(self) -> None:
        t = read_only_vector(self.t, f"`t` of {self.source}")
        require_finite(t, f"`t` of {self.source}")
        if np.max(np.abs(t), initial=0.0) > LARGEST:
            raise InputError(
                f"`t` of {self.source} holds a time beyond {LARGEST:g} s in "
                f"{self.where(int(np.argmax(np.abs(t) > LARGEST)))}, which no clock shows; remove that row, or state "
                "`time_unit` in [log]."
            )
        object.__setattr__(self, "t", t)
        shape: tuple[int, ...] | None = None
        facts: dict[str, ColumnFacts] = {}
        for name in ("q", "torque", "velocity", "acceleration"):
            values: ArrayLike | None = getattr(self, name)
            if values is None and name in ("velocity", "acceleration"):
                continue
            array = read_only_matrix(values, f"`{name}` of {self.source}")  # type: ignore[arg-type]
            shape = (t.size, array.shape[1]) if shape is None else shape
            if array.shape != shape:
                raise InputError(
                    f"`{name}` of {self.source} has shape {array.shape}; expected {shape}, "
                    "one row per time and one column per joint."
                )
            facts[name] = column_facts(array)
            if not (facts[name].low.min() >= -LARGEST and facts[name].high.max() <= LARGEST):
                require_finite(array, f"`{name}` of {self.source}")
                row = int(np.argmax(np.abs(array).max(axis=1) > LARGEST))
                raise InputError(
                    f"`{name}` of {self.source} holds a number beyond {LARGEST:g} in {self.where(row)}, which no robot "
                    "reaches; remove that row, or record again."
                )
            object.__setattr__(self, name, array)
        object.__setattr__(self, "facts", facts)
        for name in ("position_missing", "torque_missing"):
            flags = getattr(self, name)
            if flags is not None and (np.asarray(flags).dtype != np.bool_ or np.shape(flags) != shape):
                raise InputError(f"`{name}` of {self.source} must be boolean of shape {shape}.")
        if self.channels is not None:
            object.__setattr__(
                self, "channels", checked_channels(self.channels, (t.size, self.joint_count), self.source)
            )
        check_order(t, self.where, self.source)
        if self.joint_names is not None:
            names = tuple(self.joint_names)
            if len(names) != self.joint_count:
                raise InputError(
                    f"{self.source} has {self.joint_count} joints but {len(names)} joint names; give one each."
                )
            object.__setattr__(self, "joint_names", names)

    @property
    def count(self) -> int:
        """Number of rows, S."""
        return int(self.t.size)

    @property
    def joint_count(self) -> int:
        """Number of joints, N."""
        return int(self.q.shape[1])

    @cached_property
    def rate(self) -> float:
        """Mean sample rate in Hz between pauses, or the stated one."""
        if self.stated_rate is not None:
            return self.stated_rate
        if self.count < 2:
            raise InputError(f"{self.source} has a single row; a sample rate needs two at least.")
        steps = np.diff(self.t)
        if steps.max() <= PAUSE * self.duration / len(steps):
            return len(steps) / self.duration
        return rate_between_pauses(self.count, self.duration, steps, float(np.median(steps)))

    @property
    def duration(self) -> float:
        """Time from the first row to the last, in s."""
        return float(self.t[-1] - self.t[0])

    def joint_label(self, index: int) -> str:
        """Name joint `index` (from 0) for messages."""
        return joint_label(index, self.joint_names)

    def lacks_torque(self, index: int) -> bool:
        """Return whether no row has a torque of joint `index` (from 0)."""
        return self.torque_missing is not None and bool(self.torque_missing[:, index].all())

    @property
    def column_labels(self) -> tuple[str, ...]:
        """The joints' names, or "joint 1", "joint 2" and so on, for tables and pictures."""
        return self.joint_names or tuple(f"joint {j + 1}" for j in range(self.joint_count))

    def where(self, row: int) -> str:
        """Say where row `row` (from 0) of this recording stands in the log."""
        return f"row {self.first_row + row + 1}"

    def rows(self, start: int, stop: int) -> Self:
        """Return the rows start:stop, without the remarks on the whole."""
        return replace(self.chosen(slice(start, stop)), first_row=self.first_row + start, remarks=())

    def chosen(self, rows: NDArray[np.bool_] | slice) -> Self:
        """Return some of the rows."""
        names = ("t", "q", "torque", "velocity", "acceleration", "position_missing", "torque_missing")
        values = {name: getattr(self, name) for name in names}
        fields: dict[str, Any] = {name: part if part is None else part[rows] for name, part in values.items()}
        return replace(self, **fields, channels=cut_channels(self.channels, rows))

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return what was measured as a log holds it: t (S,), and q, dq, ddq and tau (S, N) as far as they are there.

        What was filled in is no measurement, and is NaN again.
        """
        found = {"t": self.t, "q": self.q, "dq": self.velocity, "ddq": self.acceleration, "tau": self.torque}
        gone = {"tau": self.torque_missing, **dict.fromkeys(("q", "dq", "ddq"), self.position_missing)}
        measured = {}
        for key, values in found.items():
            if values is not None:
                flags = gone.get(key)
                measured[key] = values if flags is None else np.where(flags, np.nan, values)
        return measured

    def __repr__(self) -> str:
        extra = "" if self.velocity is None else ", with measured velocities"
        size = f"{self.count} rows x {self.joint_count} joints"
        timing = f", {self.duration:.6g} s at {self.rate:.6g} Hz" if self.count > 1 else ""
        return f"{type(self).__name__}({self.source!r}, {size}{timing}{extra})"

    def _repr_html_(self) -> str:
        rows = [
            (self.joint_label(j), *(f"{a[:, j].min():.4g} … {a[:, j].max():.4g}" for a in (self.q, self.torque)))
            for j in range(self.joint_count)
        ]
        return html_table(repr(self), ("joint", "position", "torque"), rows, self.remarks)


def rate_between_pauses(count: int, duration: float, gaps: NDArray[np.float64], period: float) -> float:
    """Return the mean rate in Hz of so many rows over a duration, those gaps left out that are pauses."""
    pauses = gaps[gaps > PAUSE * period]
    return (count - 1 - len(pauses)) / (duration - float(pauses.sum()))


def check_order(t: NDArray[np.float64], where: Callable[[int], str], source: str) -> None:
    """Refuse stamps that repeat or go back; `where` says where a row stands."""
    steps = np.diff(t)
    bad = steps <= 0.0
    if not bad.any():
        return
    row = int(np.argmax(bad)) + 1
    count = np.count_nonzero(bad)
    if steps[row - 1] == 0.0:
        raise InputError(
            f"{source}, {where(row)}, repeats the time {t[row]:.9g} s of the row before ({count} rows do so); "
            "remove the repeated rows, or state `rate` in [log] if the stamps are only rounded."
        )
    raise InputError(
        f"{source}, {where(row)}, goes back in time from {t[row - 1]:.9g} s to {t[row]:.9g} s ({count} rows do so); "
        "sort the rows, or split the log where a new run begins."
    )


def check_period(period: float, source: str) -> None:
    """Refuse a sample period in s that no robot log has: the unit of time is wrong then."""
    if SHORTEST_PERIOD <= period < LONGEST_PERIOD:
        return
    units = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    fitting = [unit for unit, scale in units.items() if 1e-4 <= period * scale < LONGEST_PERIOD]
    remedy = f'`time_unit = "{fitting[0]}"` would fit' if fitting else "check `time`, `time_unit` and `rate`"
    raise InputError(
        f"{source} has a sample period of {period:.6g} s; expected between {SHORTEST_PERIOD:g} and "
        f"{LONGEST_PERIOD:g} s: {remedy} in [log]."
    )
