"""Recording: what one log says, in SI units, before any signal processing."""

from __future__ import annotations

import html
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from steelyard.errors import InputError

from .checks import LogSurvey
from .columns import LogColumns
from .conversion import Signals, convert
from .diagnosis.clock import CLOCK_ROWS, FEWEST_ROWS, ClockStatistics, clock_of
from .filling import filled
from .formats.log_file import LogFiles
from .header import resolve
from .samples import Samples, read_only_matrix, read_only_vector, require_finite
from .timing import check_order, check_period

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from .cutoff import CutoffChoice
    from .diagnosis import Diagnosis, Intervals
    from .periodic import PeriodicAverage

__all__ = ["Recording", "Source"]

LARGEST = 1e15  # in SI units
Source = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """A motion log in SI units: S instants of N joints.

    Parameters
    ----------
    t
        (S,) times in s, increasing.
    q, torque
        (S, N) joint positions (rad or m) and torques (N·m or N).
    velocity, acceleration
        (S, N) as measured, or None.
    source
        Where it comes from, for messages.
    joint_names
        N names, or None.
    remarks
        What was noticed about the log, one sentence each.
    stated_rate
        Sample rate in Hz where it is known better than from the stamps.
    first_row
        Number of rows of the log that come before the first row here, for messages.
    position_missing, torque_missing
        (S, N) booleans, true where the log had no value and one was filled in; such rows are left out of samples. None
        where all are there.

    Raises
    ------
    InputError
        Where shapes do not fit, a value is not finite, or the times do not increase.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(1000) / 1000
    >>> Recording(t=t, q=np.sin(t)[:, None], torque=np.cos(t)[:, None], source="sine")
    Recording('sine', 1000 rows x 1 joints, 0.999 s at 1000 Hz)
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

    def __post_init__(self) -> None:
        t = read_only_vector(self.t, f"`t` of {self.source}")
        require_finite(t, f"`t` of {self.source}")
        object.__setattr__(self, "t", t)
        shape: tuple[int, ...] | None = None
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
            require_finite(array, f"`{name}` of {self.source}")
            if np.max(np.abs(array), initial=0.0) > LARGEST:
                row = int(np.argmax(np.abs(array).max(axis=1) > LARGEST))
                raise InputError(
                    f"`{name}` of {self.source} holds a number beyond {LARGEST:g} in {self.where(row)}, which no robot "
                    "reaches; remove that row, or record again."
                )
            object.__setattr__(self, name, array)
        for name in ("position_missing", "torque_missing"):
            flags = getattr(self, name)
            if flags is not None and (np.asarray(flags).dtype != np.bool_ or np.shape(flags) != shape):
                raise InputError(f"`{name}` of {self.source} must be boolean of shape {shape}.")
        check_order(t, self.where, self.source)
        if self.joint_names is not None:
            names = tuple(self.joint_names)
            if len(names) != self.joint_count:
                raise InputError(
                    f"{self.source} has {self.joint_count} joints but {len(names)} joint names; give one each."
                )
            object.__setattr__(self, "joint_names", names)

    @classmethod
    def read(
        cls,
        source: Source,
        columns: LogColumns | dict[str, Any] | None = None,
        joints: int | Sequence[str] | None = None,
    ) -> Self:
        """Read a log: CSV, Parquet or NPZ, or several files recorded side by side.

        Parameters
        ----------
        source
            A path; a sequence of paths, or a string "a.csv+b.csv", for files with as many rows each.
        columns
            Which columns are what (`LogColumns` or its dictionary); None goes by the header.
        joints
            The number of joints, or their names, that the log must have; None accepts any.

        Raises
        ------
        InputError
            For a file that cannot be read and for every fault that is found in it: missing columns, a wrong number of
            joints, values that are missing or no numbers, times that repeat or go back, an impossible sample period,
            measured velocities that are not the derivative of the positions (degrees, sign, swapped joints).

        Examples
        --------
        >>> import numpy as np, tempfile, pathlib
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "log.csv"
        >>> rows = [f"{k / 100},{np.sin(k / 100)},{np.cos(k / 100)}" for k in range(300)]
        >>> _ = path.write_text("t,q1,tau1\\n" + "\\n".join(rows))
        >>> Recording.read(path, joints=1)
        Recording('log.csv', 300 rows x 1 joints, 2.99 s at 100 Hz)
        """
        columns = log_columns(columns)
        files = LogFiles(source)
        layout = resolve(files.names, columns, joints, files.name, files.joint_labels())
        signals = convert(files.read(layout.names), layout, columns, files.where, files.name)
        stamps, clock = signals.t, None
        if columns.rate is not None and stamps is not None and len(stamps) >= FEWEST_ROWS:
            blocks = (stamps[start : start + CLOCK_ROWS] for start in range(0, len(stamps), CLOCK_ROWS))
            clock = clock_at(columns.rate, blocks)
        t, rate = times(signals, columns, files, clock=clock)
        fields = signals_fields(signals, t, files.name)
        recording = cls(**fields, source=files.name, joint_names=names_of(joints), stated_rate=rate)
        return recording.checked()

    @property
    def count(self) -> int:
        """Number of rows, S."""
        return int(self.t.size)

    @property
    def joint_count(self) -> int:
        """Number of joints, N."""
        return int(self.q.shape[1])

    @property
    def rate(self) -> float:
        """Mean sample rate in Hz, or the stated one."""
        if self.stated_rate is not None:
            return self.stated_rate
        if self.count < 2:
            raise InputError(f"{self.source} has a single row; a sample rate needs two at least.")
        return float((self.count - 1) / (self.t[-1] - self.t[0]))

    @property
    def duration(self) -> float:
        """Time from the first row to the last, in s."""
        return float(self.t[-1] - self.t[0])

    def joint_label(self, index: int) -> str:
        """Name joint `index` (from 0) for messages."""
        return f"joint {index + 1}" if self.joint_names is None else f"joint {index + 1} ({self.joint_names[index]})"

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
        return replace(self, **fields)

    def checked(self) -> Self:
        """Check the sample period and the measured velocities, and add remarks on joints at rest and on large angles.

        Raises
        ------
        InputError
            As in `read`.
        """
        if self.count > 1:
            check_period(float(np.median(np.diff(self.t))), self.source)
        found = LogSurvey.of(self).remarks()
        return replace(self, remarks=(*self.remarks, *found)) if found else self

    def check_against(
        self,
        lower: ArrayLike,
        upper: ArrayLike,
        velocity_limit: ArrayLike,
        joint_names: Sequence[str] | None = None,
    ) -> tuple[str, ...]:
        """Compare the motion with the limits of the robot's joints; return remarks.

        Parameters
        ----------
        lower, upper, velocity_limit
            (N,) in rad (m) and rad/s (m/s); infinite where there is none.
        joint_names
            N names, for messages.

        Raises
        ------
        InputError
            Where the number of joints differs, or where the positions can only be degrees.
        """
        names = self.joint_names if joint_names is None else tuple(joint_names)
        recording = self if names == self.joint_names else replace(self, joint_names=names)
        return LogSurvey.of(recording).limit_remarks(lower, upper, velocity_limit)

    def process(self, **options: Any) -> Samples:
        """Filter, derive, trim, decimate and mask; `options` are the fields of `Processing`.

        Raises
        ------
        InputError
            For an unknown option or one that does not fit the recording.
        """
        from .processing import Processing

        return Processing.from_dict(options, "process()").apply(self)

    @property
    def missing(self) -> Intervals | None:
        """Where the log had no position or no torque; None where all are there."""
        from .diagnosis import Intervals

        parts = [part for part in (self.position_missing, self.torque_missing) if part is not None]
        return Intervals("missing in the log", np.logical_or.reduce(parts), self.t) if parts else None

    def diagnose(self) -> Diagnosis:
        """Look for everything that the numbers say about the log's quality, and change nothing.

        Clock (jitter, gaps), resolution and noise of each channel, joints that stick, clipped torques, repeated rows,
        missing values. The delay between channels is a matter of :func:`steelyard.recording.estimate_delay`.

        Examples
        --------
        >>> t = np.arange(3000) / 1000
        >>> torque = np.clip(8 * np.sin(5 * t), -6.0, 6.0)
        >>> print(Recording(t=t, q=np.sin(2 * t)[:, None], torque=torque[:, None], source="sine").diagnose())
        Diagnosis('sine': 1 findings)
        Joint 1: ... rows in ... intervals are at a level where the torque is clipped, ...
        """
        from .diagnosis import diagnose

        return diagnose(self)

    def choose_cutoff(self, order: int = 3) -> CutoffChoice:
        """Choose the cutoff of the position filter from the data; see :func:`steelyard.recording.choose_cutoff`."""
        from .cutoff import choose_cutoff

        return choose_cutoff(self, order)

    def average_periods(
        self,
        period: float | None = None,
        harmonics: int | None = None,
        trim: float | tuple[float, float] = 0.0,
    ) -> PeriodicAverage:
        """Average a periodic recording over its periods; see :func:`steelyard.recording.average_periods`."""
        from .periodic import average_periods

        return average_periods(self, period, harmonics, trim)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write to .npz, .csv or .parquet with the columns t, q1, …, dq1, …, ddq1, …, tau1, …; `read` takes it back.

        Raises
        ------
        InputError
            For another suffix.
        """
        from .saving import save_recording

        return save_recording(self, Path(path))

    def __repr__(self) -> str:
        extra = "" if self.velocity is None else ", with measured velocities"
        size = f"{self.count} rows x {self.joint_count} joints"
        timing = f", {self.duration:.6g} s at {self.rate:.6g} Hz" if self.count > 1 else ""
        return f"Recording({self.source!r}, {size}{timing}{extra})"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{html.escape(self.joint_label(j))}</td>"
            f"<td>{self.q[:, j].min():.4g} … {self.q[:, j].max():.4g}</td>"
            f"<td>{self.torque[:, j].min():.4g} … {self.torque[:, j].max():.4g}</td></tr>"
            for j in range(self.joint_count)
        )
        notes = "".join(f"<li>{html.escape(remark)}</li>" for remark in self.remarks)
        head = "<tr><th>joint</th><th>position</th><th>torque</th></tr>"
        table = f"<table><caption>{html.escape(repr(self))}</caption>{head}{rows}</table>"
        return table + (f"<ul>{notes}</ul>" if notes else "")


def log_columns(columns: LogColumns | dict[str, Any] | None) -> LogColumns:
    """Return `columns` as LogColumns."""
    if columns is None:
        return LogColumns()
    return columns if isinstance(columns, LogColumns) else LogColumns.from_dict(columns)


def names_of(joints: int | Sequence[str] | None) -> tuple[str, ...] | None:
    """Return the joints' names where `joints` gives them."""
    return None if joints is None or isinstance(joints, int) else tuple(joints)


def signals_fields(signals: Signals, t: NDArray[np.float64], source: str) -> dict[str, Any]:
    """Return the arrays of a Recording by field name, missing values filled."""
    fields: dict[str, Any] = {"t": t, "position_missing": None, "torque_missing": None}
    for name in ("q", "torque", "velocity", "acceleration"):
        values, missing = filled(t, getattr(signals, name), "position" if name == "q" else name, source)
        fields[name] = values
        if missing is not None:
            kind = "torque_missing" if name == "torque" else "position_missing"
            fields[kind] = missing if fields[kind] is None else fields[kind] | missing
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
    """Return the clock of stamps, which come in blocks, where it agrees with the rate and leaves rows out.

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
    return clock if clock.missing and abs(clock.period * rate - 1.0) < 0.01 else None


class _CoarseStampsError(ValueError):
    """Stamps repeat, so that they cannot number the rows."""
