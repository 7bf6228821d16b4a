"""The options of processing: how a recording becomes samples, the `[processing]` section of robot.toml."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import TomlSection, suggestion

from . import filters
from .filters import Butterworth, MotionFilter, whole
from .filters.motion_filter import above
from .measurements import Measurements
from .survey import stuck_torques

__all__ = ["AUTO", "FILTERS", "Processing", "filter_from"]

BUTTERWORTH = Butterworth()
AUTO = "auto"
"""The word for what the data, or the filter, decides."""
FILTERS = {
    "butterworth": "Butterworth",
    "savitzky_golay": "SavitzkyGolay",
    "kalman": "KalmanSmoother",
    "fourier": "FourierFit",
}
"""The filters of the positions: the names of their classes, each of which is imported when it is asked for, by kind."""
NOT_NEGATIVE = -1e-300
"""Numbers above this one are 0 or more."""
NUMBERS: dict[str, tuple[float, bool, tuple[object, ...], str]] = {
    "cutoff": (0.0, False, (AUTO, None), 'a frequency in Hz, "auto" or "none"'),
    "torque_cutoff": (0.0, False, (None,), 'a frequency in Hz or "none"'),
    "longest_gap": (0.0, False, (None,), "a time in s"),
    "trim": (NOT_NEGATIVE, True, (AUTO,), 'seconds, not negative, or "auto"'),
    "velocity_threshold": (NOT_NEGATIVE, True, (AUTO, None), 'a velocity, not negative, "auto" or "none"'),
    "resample": (0.0, False, (True, False), "true, false or a rate in Hz"),
    "delay": (-np.inf, True, ("automatic",), 'seconds, one number or one per joint, or "automatic"'),
    "stiction": (0.0, False, (True, False), "true, false or the shortest rest in s"),
    "saturation": (0.0, True, (True, False), "true, false, or levels in N·m or N"),
}
"""The options that are numbers: what each must be above, whether it may be a list, which other values it may have, and
how a message puts that."""


@dataclass(frozen=True)
class Processing(TomlSection):
    """Options for making samples of a recording (thesis, section 4.3.3): the `[processing]` section of robot.toml.

    The steps, in this order: rows are placed on an even clock where they are not, torques are moved by the delay,
    positions are filtered without phase shift and derived, ends trimmed, everything decimated, rows that are not to be
    used masked.

    Parameters
    ----------
    cutoff
        Cutoff of the position filter in Hz; "auto" lets the data decide: the torques where there is a model (see
        `cutoff_by_torques`), otherwise the spectra of the positions (see `choose_cutoff`). `identify` decides once for
        all logs. None (in TOML: "none") does not filter.
    order
        Order of the Butterworth filter, which is applied forwards and backwards.
    filter
        Of the positions: "butterworth", "savitzky_golay", "kalman", "fourier", or a table with that `kind` and
        options of its own (see the classes `Butterworth`, `SavitzkyGolay`, `KalmanSmoother`, `FourierFit`).
    average
        True averages torques over the periods of the motion, and leaves one period (filter "fourier" alone).
    velocity
        "derive" differentiates the positions twice; "measured" filters the measured velocities like the positions and
        differentiates them once (filter "butterworth" alone).
    torque_cutoff
        Cutoff of the same filter on the torques, and on the regressor of the model where there is one; None leaves
        them as they are.
    trim
        Seconds cut off at both ends, or (start, end). "auto" takes the time over which the filters ring, where they do
        not know what came before or after: until a thousandth is left, but no more than 15 % of the log at either end.
    decimate
        Keep every n-th row, with an anti-alias filter on positions, derivatives, torques and the regressor of the model
        where there is one; a list of factors is applied one after the other (two steps of 10 rather than one of 100).
    velocity_threshold
        Rows of a joint slower than this (rad/s or m/s) are masked; one number or one per joint. "auto" chooses them
        from the noise of the velocities and, with a model, from evidence of stiction in the torques (see
        `velocity_thresholds`); None (in TOML: "none") masks nothing.
    exclude_joints
        Joints, by number from 1 or by name, whose torque is not used at all.
    delay
        Seconds by which torques are logged later than the motion, one number or one per joint; "automatic" estimates it
        (see `estimate_delay`). Torques are moved back by it, by cubic interpolation between rows.
    stiction
        True masks rows of a joint at rest while its torque changes (see `find_stiction`); a number is the shortest
        rest in s.
    saturation
        True masks rows of a joint at a level where its torque is clipped (see `find_saturation`); numbers are the
        levels.
    stuck_torque
        True masks rows of a joint whose torque stands still, or runs along a line, while the robot moves (see
        `find_stuck_torque`).
    repeated
        True masks rows that are copies of the row before (see `find_repeated`).
    resample
        True places the rows on an even clock where they are not: by their stamps or by their numbers, whichever the
        positions follow (see `clock_statistics`). A number is the rate of the even rows in Hz; false refuses uneven
        logs.
    longest_gap
        Longest gap in s that is filled; by default five sample periods or 0.02 s, whichever is longer. Rows that were
        made up are masked. At longer gaps the log is split, and its parts are processed one by one.
    difference
        "central", the only scheme of the Butterworth filter; the others have derivatives of their own.

    Examples
    --------
    >>> Processing.from_dict({"cutoff": 100.0, "order": 4, "decimate": [10, 10]}).decimate
    (10, 10)
    """

    section_name = "[processing]"

    cutoff: float | str | None = AUTO
    order: int = 3
    velocity: str = "derive"
    torque_cutoff: float | None = None
    trim: float | tuple[float, float] | str = AUTO
    decimate: tuple[int, ...] = ()
    velocity_threshold: float | tuple[float, ...] | str | None = AUTO
    exclude_joints: tuple[int | str, ...] = ()
    resample: bool | float = True
    longest_gap: float | None = None
    difference: str = "central"
    filter: MotionFilter = BUTTERWORTH
    average: bool = False
    delay: float | tuple[float, ...] | str = 0.0
    stiction: bool | float = False
    saturation: bool | float | tuple[float, ...] = False
    stuck_torque: bool = False
    repeated: bool = False

    def _clean(self, where: str) -> None:
        def put(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        def key(name: str) -> str:
            return f"{where}, key {name!r},"

        for name in ("cutoff", "torque_cutoff", "velocity_threshold", "longest_gap"):
            if getattr(self, name) == "none":
                put(name, None)
        for name in ("cutoff", "trim", "velocity_threshold"):
            if isinstance(getattr(self, name), str) and getattr(self, name) == "automatic":
                raise InputError(f'{key(name)} is "automatic"; what the data decides is called "auto": write that.')
        for name, (bound, several, others, what) in NUMBERS.items():
            value = getattr(self, name)
            if any(value is other or (isinstance(value, str) and value == other) for other in others):
                continue
            if isinstance(value, np.ndarray):
                value = value.tolist()
            if several and isinstance(value, (list, tuple)):
                put(name, tuple(above(bound, item, key(name), what) for item in value))
            else:
                put(name, above(bound, value, key(name), what))
        if isinstance(self.trim, tuple) and len(self.trim) != 2:
            raise InputError(
                f"{key('trim')} has {len(self.trim)} values; it must be one time in s or two, start and end."
            )
        put("order", whole(self.order, 1, 10, key("order")))
        factors = self.decimate if isinstance(self.decimate, (list, tuple)) else (self.decimate,)
        put("decimate", tuple(n for n in (whole(factor, 1, 1000, key("decimate")) for factor in factors) if n != 1))
        for name, options in (("velocity", ("derive", "measured")), ("difference", ("central",))):
            if getattr(self, name) not in options:
                raise InputError(
                    f"{key(name)} is {getattr(self, name)!r}; it must be {' or '.join(map(repr, options))}."
                )
        for name in ("average", "stuck_torque", "repeated"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{key(name)} is {getattr(self, name)!r}; it must be true or false.")
        excluded: Any = self.exclude_joints
        if isinstance(excluded, str) or not isinstance(excluded, (list, tuple)):
            raise InputError(f"{key('exclude_joints')} is {excluded!r}; it must be a list of joint numbers or names.")
        for joint in excluded:
            if not isinstance(joint, (int, str)) or isinstance(joint, bool):
                raise InputError(
                    f"{key('exclude_joints')} holds {joint!r}; it must hold joint numbers (from 1) or names."
                )
        put("exclude_joints", tuple(excluded))
        put("filter", filter_from(self.filter, key("filter")))
        kind = self.filter.kind
        if self.average and (kind != "fourier" or self.decimate):
            what = "does not go with `decimate`" if kind == "fourier" else 'goes with `filter = "fourier"` alone'
            raise InputError(f"{key('average')} {what}; leave one of them out.")
        if self.velocity == "measured" and kind != "butterworth":
            raise InputError(
                f'{key("velocity")} is "measured", which goes with the filter "butterworth" alone, not with {kind!r}.'
            )

    @property
    def step(self) -> int:
        """Number of rows of the log that make one sample."""
        return prod(self.decimate)

    @property
    def filters_torque(self) -> bool:
        """Whether the torques go through a filter."""
        return self.torque_cutoff is not None or bool(self.decimate)

    @property
    def needs_whole_log(self) -> bool:
        """Whether a log must stand in memory as a whole; otherwise it may come chunk by chunk."""
        return self.average or self.filter.needs_whole_log

    @property
    def needs_even_rows(self) -> bool:
        """Whether any of the options works on evenly sampled rows only."""
        at_any_times = self.filter.takes_uneven_times and self.torque_cutoff is None and not self.decimate
        return not (at_any_times and np.all(np.asarray(self.delay) == 0.0)) or self.resample not in (True, False)

    @property
    def is_open(self) -> bool:
        """Whether the data decides the cutoff or the velocity thresholds."""
        return (self.cutoff == AUTO and self.takes_cutoff) or self.velocity_threshold == AUTO

    @property
    def takes_cutoff(self) -> bool:
        """Whether the filter has no width of its own, so that `cutoff` is its cutoff."""
        own = self.filter
        widths = (getattr(own, name, None) for name in ("cutoff", "window", "density"))
        return own.kind != "fourier" and all(width is None for width in widths)

    def for_joints(self, name: str, recording: Measurements, what: str = "values") -> NDArray[np.float64]:
        """Return an option that is a number, or one per joint, for the joints (N,) of a recording.

        Raises
        ------
        InputError
            Where it is a list of another length, of `what`.
        """
        given = np.asarray(getattr(self, name), dtype=np.float64)
        joints = recording.joint_count
        if given.ndim and given.size != joints:
            raise InputError(
                f"{recording.source} has {joints} joints but `{name}` in [processing] has {given.size} {what}; "
                "give one number or one per joint."
            )
        return np.full(joints, given)

    def excluded(self, recording: Measurements) -> list[int]:
        """Return the indices of the joints that are excluded, or of which no torque was logged."""
        names = recording.joint_names or ()
        layout = recording.layout
        indices = [] if layout is None or layout.has_matrix else list(layout.without_torque)
        for joint in self.exclude_joints:
            if isinstance(joint, int) and 1 <= joint <= recording.joint_count:
                indices.append(joint - 1)
            elif joint in names:
                indices.append(names.index(str(joint)))
            else:
                known = f"numbers from 1 to {recording.joint_count}" + (f" or {', '.join(names)}" if names else "")
                raise InputError(
                    f"`exclude_joints` in [processing] holds {joint!r}; the joints of {recording.source} are {known}."
                )
        return indices

    def check_torques(
        self,
        recording: Measurements,
        lowest: NDArray[np.float64],
        highest: NDArray[np.float64],
        travel: NDArray[np.float64],
    ) -> None:
        """Refuse a torque that never changes on a joint that moves, unless the joint is excluded."""
        excluded = self.excluded(recording)
        stuck = [int(j) for j in stuck_torques(lowest, highest, travel) if j not in excluded]
        if stuck:
            j = stuck[0]
            value = "missing" if recording.lacks_torque(j) else f"{lowest[j]:.6g}"
            raise InputError(
                f"{recording.source}: the torque of {recording.joint_label(j)} is {value} throughout while the "
                f"joint moves; name another column with `torque` in [log], or leave its rows out with "
                f"`exclude_joints = [{j + 1}]` in [processing]."
            )


def filter_from(value: Any, where: str) -> MotionFilter:
    """Return the filter that a name, a table with a `kind`, or a filter itself stands for.

    Raises
    ------
    InputError
        For an unknown kind or key; `where` is named.

    Examples
    --------
    >>> filter_from({"kind": "savitzky_golay", "window": 0.1}, "[processing]")
    SavitzkyGolay(window=0.1, degree=4, cutoff=None)
    """
    if isinstance(value, MotionFilter):
        return value
    table = {"kind": value} if isinstance(value, str) else value
    if not isinstance(table, Mapping) or not isinstance(table.get("kind"), str):
        raise InputError(
            f"{where} is {value!r}; it must be one of {', '.join(FILTERS)}, or a table whose `kind` is one of them."
        )
    kind = table["kind"]
    if kind not in FILTERS:
        raise InputError(f"{where} is {kind!r}; {suggestion(kind, FILTERS)}")
    rest = {key: entry for key, entry in table.items() if key != "kind"}
    chosen: type[MotionFilter] = getattr(filters, FILTERS[kind])
    return chosen.from_dict(rest, where.rstrip(","))
