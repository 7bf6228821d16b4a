"""Processing: from a recording to samples, the `[processing]` section of robot.toml."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil, prod
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from steelyard.errors import InputError
from steelyard.recording.checks import stuck_torques
from steelyard.recording.columns import number
from steelyard.recording.filtering import automatic_cutoff, decimate, first_derivative, low_pass
from steelyard.recording.samples import Samples
from steelyard.recording.section import Section
from steelyard.recording.timing import check_even, resampled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from steelyard.recording.recording import Recording

__all__ = ["Processing"]


@dataclass(frozen=True)
class Processing(Section):
    """How a recording becomes samples (thesis, section 4.3.3): the `[processing]` section of robot.toml.

    The steps, in this order: even sampling is checked (or made), positions are filtered without phase shift, velocities
    and accelerations derived by central differences, ends trimmed, everything decimated, rows of slow joints masked.

    Parameters
    ----------
    cutoff
        Cutoff of the position filter in Hz; "auto" takes ten times the motion's dynamic frequency (see
        `motion_frequency`), None (in TOML: "none") does not filter.
    order
        Order of the Butterworth filter, which is applied forwards and backwards.
    velocity
        "derive" differentiates the positions twice; "measured" filters the measured velocities like the positions and
        differentiates them once.
    torque_cutoff
        Cutoff of the same filter on the torques; None leaves them as they are.
    trim
        Seconds cut off at both ends, or (start, end).
    decimate
        Keep every n-th row, with an anti-alias filter on positions, derivatives and torques; a list of factors is
        applied one after the other (two steps of 10 rather than one of 100).
    velocity_threshold
        Rows of a joint slower than this (rad/s or m/s) are masked; one number or one per joint.
    exclude_joints
        Joints, by number from 1 or by name, whose torque is not used at all.
    resample
        True interpolates onto an even grid where the log is not even; a number is the rate of the grid in Hz.
    longest_gap
        Longest gap in s that resampling bridges; five sample periods by default. Rows inside are masked where two or
        more are missing.
    difference
        "central", the only scheme so far.

    Examples
    --------
    >>> Processing.from_dict({"cutoff": 100.0, "order": 4, "decimate": [10, 10]}).decimate
    (10, 10)
    """

    section_name = "[processing]"

    cutoff: float | str | None = "auto"
    order: int = 3
    velocity: str = "derive"
    torque_cutoff: float | None = None
    trim: float | tuple[float, float] = 0.0
    decimate: tuple[int, ...] = ()
    velocity_threshold: float | tuple[float, ...] | None = None
    exclude_joints: tuple[int | str, ...] = ()
    resample: bool | float = False
    longest_gap: float | None = None
    difference: str = "central"

    def _clean(self, where: str) -> None:
        def put(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        def key(name: str) -> str:
            return f"{where}, key {name!r},"

        for name in ("cutoff", "torque_cutoff", "velocity_threshold", "longest_gap"):
            if getattr(self, name) == "none":
                put(name, None)
        if self.cutoff is not None and self.cutoff != "auto":
            put("cutoff", _above(0.0, self.cutoff, key("cutoff"), 'a frequency in Hz, "auto" or "none"'))
        if self.torque_cutoff is not None:
            put("torque_cutoff", _above(0.0, self.torque_cutoff, key("torque_cutoff"), 'a frequency in Hz or "none"'))
        if self.longest_gap is not None:
            put("longest_gap", _above(0.0, self.longest_gap, key("longest_gap"), "a time in s"))
        put("order", _whole(self.order, 1, 10, key("order")))
        for name, options in (("velocity", ("derive", "measured")), ("difference", ("central",))):
            if getattr(self, name) not in options:
                raise InputError(
                    f"{key(name)} is {getattr(self, name)!r}; it must be {' or '.join(map(repr, options))}."
                )
        trim = _each(self.trim, key("trim"), lambda value: _above(-1e-300, value, key("trim"), "seconds, not negative"))
        if isinstance(trim, tuple) and len(trim) != 2:
            raise InputError(f"{key('trim')} has {len(trim)} values; it must be one time in s or two, start and end.")
        put("trim", trim)
        factors = self.decimate if isinstance(self.decimate, (list, tuple)) else (self.decimate,)
        put("decimate", tuple(n for n in (_whole(factor, 1, 1000, key("decimate")) for factor in factors) if n != 1))
        if self.velocity_threshold is not None:
            what = "a velocity, not negative"
            name = "velocity_threshold"
            put(name, _each(self.velocity_threshold, key(name), lambda value: _above(-1e-300, value, key(name), what)))
        excluded: Any = self.exclude_joints
        if isinstance(excluded, str) or not isinstance(excluded, (list, tuple)):
            raise InputError(f"{key('exclude_joints')} is {excluded!r}; it must be a list of joint numbers or names.")
        for joint in excluded:
            if not isinstance(joint, (int, str)) or isinstance(joint, bool):
                raise InputError(
                    f"{key('exclude_joints')} holds {joint!r}; it must hold joint numbers (from 1) or names."
                )
        put("exclude_joints", tuple(excluded))
        if not isinstance(self.resample, bool):
            put("resample", _above(0.0, self.resample, key("resample"), "true, false or a rate in Hz"))

    @property
    def step(self) -> int:
        """How many rows of the log make one sample."""
        return prod(self.decimate)

    def apply(self, recording: Recording) -> Samples:
        """Turn a recording into samples.

        Raises
        ------
        InputError
            Where the sampling is uneven or has gaps, the recording is too short for the filters, trimming leaves
            nothing, an option does not fit the number of joints, or a torque sensor is stuck on a joint that moves.
        """
        self.check_torques(
            recording, recording.torque.min(axis=0), recording.torque.max(axis=0), np.ptp(recording.q, axis=0)
        )
        gaps = np.empty((0, 2))
        if self.resample is not False:
            rate = None if isinstance(self.resample, bool) else self.resample
            recording, gaps = resampled(recording, rate, self.longest_gap)
        fixed, remarks = self.fixed_cutoff(recording)
        notes = (*recording.remarks, *check_even(recording), *remarks)
        start, stop = self.kept_rows(recording.count, recording.rate, recording.source)
        return fixed.rows(recording, start, stop, gaps=gaps, remarks=notes)

    def fixed_cutoff(self, recording: Recording) -> tuple[Self, tuple[str, ...]]:
        """Replace "auto" by the cutoff that `recording` asks for, and say so."""
        if self.cutoff != "auto":
            return self, ()
        cutoff, remark = automatic_cutoff(recording)
        return replace(self, cutoff=cutoff), (remark,)

    def kept_rows(self, count: int, rate: float, source: str) -> tuple[int, int]:
        """The rows start:stop that trimming leaves of `count`."""
        begin, end = self.trim if isinstance(self.trim, tuple) else (self.trim, self.trim)
        start, stop = ceil(begin * rate - 1e-6), count - ceil(end * rate - 1e-6)
        if stop - start < 1:
            raise InputError(
                f"{source} lasts {(count - 1) / rate:.6g} s, of which trimming by {begin:g} and {end:g} s leaves "
                "nothing; shorten `trim` in [processing]."
            )
        return start, stop

    def rows(
        self,
        recording: Recording,
        start: int,
        stop: int,
        gaps: NDArray[np.float64] | None = None,
        remarks: tuple[str, ...] = (),
    ) -> Samples:
        """Process a recording whose sampling is known to be even; keep rows start:stop before decimation.

        `self.cutoff` must not be "auto" here. Rows outside start:stop only feed the filters.
        """
        rate, source = recording.rate, recording.source
        if recording.count < 3:
            raise InputError(f"{source} has {recording.count} rows; derivatives need three at least.")
        if self.velocity == "measured" and recording.velocity is None:
            raise InputError(
                f'{source} has no measured velocities; name them with `velocity` in [log] or use `velocity = "derive"`.'
            )

        def filtered(values: NDArray[np.float64], cutoff: float | str | None) -> NDArray[np.float64]:
            if cutoff is None:
                return values
            assert not isinstance(cutoff, str)
            return low_pass(values, rate, cutoff, self.order, source)

        q = filtered(recording.q, self.cutoff)
        if self.velocity == "measured":
            assert recording.velocity is not None
            dq = filtered(recording.velocity, self.cutoff)
        else:
            dq = first_derivative(q, rate)
        ddq = first_derivative(dq, rate)
        torque = filtered(recording.torque, self.torque_cutoff)
        width = recording.joint_count
        stacked = np.hstack([array[start:stop] for array in (q, dq, ddq, torque)])
        stacked = decimate(stacked, self.decimate, source)
        q, dq, ddq, torque = (stacked[:, k * width : (k + 1) * width] for k in range(4))
        t = recording.t[start : stop : self.step]
        mask = self.mask(recording, t, dq, gaps)
        return Samples(q=q, dq=dq, ddq=ddq, torque=torque, mask=mask, t=t, remarks=remarks)

    def mask(
        self,
        recording: Recording,
        t: NDArray[np.float64],
        dq: NDArray[np.float64],
        gaps: NDArray[np.float64] | None = None,
    ) -> NDArray[np.bool_] | None:
        """(S, N) which rows of which joints are used; None where all are."""
        width = recording.joint_count
        mask = np.ones(dq.shape, dtype=bool)
        if self.velocity_threshold is not None:
            threshold = np.asarray(self.velocity_threshold)
            if threshold.ndim == 1 and threshold.size != width:
                raise InputError(
                    f"{recording.source} has {width} joints but `velocity_threshold` in [processing] has "
                    f"{threshold.size} values; give one number or one per joint."
                )
            mask &= np.abs(dq) >= threshold
        mask[:, self.excluded(recording)] = False
        for begin, end in () if gaps is None else gaps:
            mask[(t > begin) & (t < end)] = False
        return None if mask.all() else mask

    def excluded(self, recording: Recording) -> list[int]:
        """Indices of the excluded joints."""
        names = recording.joint_names or ()
        indices = []
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
        recording: Recording,
        lowest: NDArray[np.float64],
        highest: NDArray[np.float64],
        travel: NDArray[np.float64],
    ) -> None:
        """Refuse a torque that never changes on a joint that moves, unless the joint is excluded."""
        excluded = self.excluded(recording)
        stuck = [int(j) for j in stuck_torques(lowest, highest, travel) if j not in excluded]
        if stuck:
            j = stuck[0]
            raise InputError(
                f"{recording.source}: the torque of {recording.joint_label(j)} is {lowest[j]:.6g} throughout while the "
                f"joint moves; name another column with `torque` in [log], or leave its rows out with "
                f"`exclude_joints = [{j + 1}]` in [processing]."
            )


def _above(lowest: float, value: Any, where: str, what: str) -> float:
    if isinstance(value, str) or not number(value, where) > lowest:
        raise InputError(f"{where} is {value!r}; it must be {what}.")
    return float(value)


def _whole(value: Any, lowest: int, highest: int, where: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not lowest <= value <= highest:
        raise InputError(f"{where} is {value!r}; it must be a whole number from {lowest} to {highest}.")
    return value


def _each(value: Any, where: str, parse: Callable[[Any], float]) -> float | tuple[float, ...]:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    return tuple(parse(item) for item in value) if isinstance(value, (list, tuple)) else parse(value)
