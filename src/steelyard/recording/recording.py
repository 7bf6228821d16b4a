"""Recording: the measurements of one log, in SI units, with reading, processing and writing."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from steelyard.errors import InputError
from steelyard.files import shown

from .. import recording as room  # its names are imported when they are used
from . import diagnosis  # as are these
from .automatic import decide, settle
from .clock import CLOCK_ROWS, FEWEST_ROWS
from .columns import LogColumns
from .conversion import checked_columns, clock_at, convert, log_columns, signals_fields, times
from .cutoff import CutoffChoice
from .diagnosis import find_missing
from .even import evened
from .formats import LogFiles, Source, write_log
from .measurements import Measurements, check_period
from .options import Processing
from .recognition import Joints, names_of
from .samples import Samples
from .survey import LogSurvey, turn_remarks

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from steelyard.dynamics import Model

    from .diagnosis import Diagnosis, Intervals
    from .periodic import PeriodicAverage

__all__ = ["Recording"]


@dataclass(frozen=True, eq=False, repr=False)
class Recording(Measurements):
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
    layout
        Which columns of the log these are, where they were read from one: `print(recording.layout)`.
    clock_origin
        Where on the clock of the log `t` is 0, in ns: dates, and whole numbers of ms, µs or ns since 1970, count from
        the first row. 0 where `t` holds the times of the log itself.

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

    @classmethod
    def read(cls, source: Source, columns: LogColumns | dict[str, Any] | None = None, joints: Joints = None) -> Self:
        """Read a log: CSV, Parquet or NPZ, several files recorded side by side, or what is in memory.

        Parameters
        ----------
        source
            A path; a sequence of paths, or a string "a.csv+b.csv", for files with as many rows each. Or named columns
            in memory: a data frame, a structured array, or a mapping of arrays, of which those (S, N) stand for N
            columns.
        columns
            Which columns are what (`LogColumns` or its dictionary); None goes by the header.
        joints
            The number of joints that the log must have, their names, or the robot that was logged; None accepts any.

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
        files = LogFiles(source, log_columns(columns))
        columns = files.columns
        layout = files.layout(joints)
        read = checked_columns(files.read(layout.names), layout, columns, files.where, files.name)
        signals = convert([read], layout, columns, files.name)
        stamps, clock = signals.t, None
        if columns.rate is not None and stamps is not None and len(stamps) >= FEWEST_ROWS:
            blocks = (stamps[start : start + CLOCK_ROWS] for start in range(0, len(stamps), CLOCK_ROWS))
            clock = clock_at(columns.rate, blocks)
        t, rate = times(signals, columns, files, clock=clock)
        fields = signals_fields(signals, t, layout, files.name)
        recording = cls(
            **fields,
            remarks=(*layout.guesses, *turn_remarks(signals.q, names_of(joints))),
            source=files.name,
            joint_names=names_of(joints),
            stated_rate=rate,
            layout=layout,
            clock_origin=files.clock_origin(layout),
        )
        return recording.checked()

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
        self, lower: ArrayLike, upper: ArrayLike, velocity_limit: ArrayLike, joint_names: Sequence[str] | None = None
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

    def process(self, processing: Processing | None = None, model: Model | None = None, **options: Any) -> Samples:
        """Filter, derive, trim, decimate and mask.

        Parameters
        ----------
        processing
            What to do.
        model
            By which the cutoff, the velocity thresholds and `delay = "automatic"` are chosen where they are left open;
            without it the motion alone decides. Its regressor goes through the filters of the torques
            (`torque_cutoff`, `decimate`), without which estimates are biased.
        options
            The fields of `Processing`, in place of `processing`.

        Raises
        ------
        InputError
            For an unknown option or one that does not fit the recording; where the recording is too short for the
            filters, trimming leaves nothing, a torque is stuck on a joint that moves, or the sampling is uneven and
            `resample` is false.
        """
        if processing is None:
            processing = Processing.from_dict(options, "process()")
        elif not isinstance(processing, Processing):
            raise InputError(
                f"process() was given {shown(processing)}; give a Processing, or its options by name: cutoff=4.8."
            )
        elif options:
            raise InputError(
                f"process() was given a Processing and {', '.join(options)} beside it; give one or the other."
            )
        travel = np.ptp(self.q, axis=0)
        processing.check_torques(self, self.torque.min(axis=0), self.torque.max(axis=0), travel)
        parts, remarks = evened(self, processing.resample, processing.longest_gap, processing.needs_even_rows)
        longest = max(parts, key=lambda part: part.count)
        plan = settle(decide(processing, [longest], model), longest, model)
        return plan.whole(parts, (*self.remarks, *remarks))

    @property
    def missing(self) -> Intervals | None:
        """Rows and joints (S, N) without a position or a torque in the log; None where all are there."""
        return find_missing(self)

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
        return diagnosis.diagnose(self)

    def choose_cutoff(self, order: int = 3) -> CutoffChoice:
        """Choose the cutoff of the position filter from the data; see :func:`steelyard.recording.choose_cutoff`."""
        return room.choose_cutoff(self, order)

    def average_periods(
        self, period: float | None = None, harmonics: int | None = None, trim: float | tuple[float, float] = 0.0
    ) -> PeriodicAverage:
        """Average a periodic recording over its periods; see :func:`steelyard.recording.average_periods`."""
        return room.average_periods(self, period, harmonics, trim)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write to .npz, .csv or .parquet with the columns t, q1, …, dq1, …, ddq1, …, tau1, …; `read` takes it back.

        Times of a log whose clock does not begin with it (`clock_origin`) are written on that clock, as whole
        nanoseconds in the column t_ns.

        Raises
        ------
        InputError
            For another suffix.
        """
        arrays: dict[str, NDArray[Any]] = dict(self.arrays())
        if self.clock_origin:
            arrays = {"t_ns": self.clock_origin + np.rint(1e9 * arrays.pop("t")).astype(np.int64), **arrays}
        return write_log(Path(path), arrays)
