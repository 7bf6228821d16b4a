"""Faults that only the numbers of a log show: units, signs, swapped joints, joints at rest, limits."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from steelyard.display import capital, joint_label
from steelyard.errors import InputError
from steelyard.files import listed
from steelyard.files.arguments import LARGEST
from steelyard.graph.column_passes import ColumnFacts, column_facts

from .columns import LENGTHS
from .measurements import Measurements

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import ArrayLike


__all__ = [
    "LogSurvey",
    "position_jumps",
    "require_no_degrees",
    "stuck_torques",
    "turn_remarks",
    "turned_on",
    "without_dropouts",
    "without_wild",
]

Array = NDArray[np.float64]
DEGREE = pi / 180.0
BLOCK = 0.02
"""Positions and measured velocities are compared over blocks this long (s), where encoder noise no longer counts."""
FAR = 0.05
"""Travel (rad or m) of a joint that surely moves."""
SLOWEST_RATE, FASTEST_RATE = 10.5, 5e4
"""Hz. Accelerations from ten rows a second are those of no robot; current loops, the fastest, run at some 40 kHz."""
MANY_TURNS = 8.0 * pi
"""rad, or m, beyond which a position is remarked on: 26 degrees taken for radians are more, and few joints turn four
times."""
LEISURELY = 8.0
"""Positions a second up to which many turns are those of a table that turns without end: in degrees it would turn at no
more than 1.3 revolutions a minute, and behind gears of 1:100 at no more than 0.8."""
FULL_TURN = 2.2 * pi
"""rad up to which positions in degrees reach once they are converted; those of motors reach any number of turns."""
FURTHER_TURNS = 2
"""Whole turns that a position may be away from the limits of its joint: encoders count from 0 to a turn where a
description has half a turn to either side, and no torque of links depends on it."""
MOSTLY = 0.9
"""Share of the rows, in parts of a log that reach beyond a turn in degrees, whose positions are whole numbers in a log
of counts: in some they may be filled in."""
MOST_NAMED = 3
FASTEST_JOINT = 40.0
"""rad/s, or m/s: legs reach 30, arms 3 to 10; motors run at 100 to 600, and arms at 40 to 200 degrees per s."""
FASTEST_MOTOR = 3e3
"""rad/s, some 30 000 rpm: motors in front of gears stay below, and a joint of 1 rad/s in millidegrees has 57 300."""
FASTEST_SLIDE = 3e4
"""m/s, which no slide reaches in millimetres either."""
FASTEST_WHEEL = 100.0
"""rad/s, or m/s, below which positions far beyond the limits of a description may be those of a wheel."""
SWIFT = 0.05
"""Share of the blocks in which a joint outruns all wheels or all motors, from which these are no wild readings."""
BEYOND_GEARS = {"rad": 1e3, "m": 3e3}
"""Travel over the range of a description that is more than that of a motor in front of any gear, or of millimetres."""
NARROW = 0.1
"""rad or m: a range that is narrower may stand for none."""
MOVING = 5e-3
"""Root mean square velocity (rad/s or m/s) from which a joint counts as moving."""


TURN = 2.0 * np.pi
STEADY = 0.5
"""rad that a joint moves between two rows at most, at a jump and in the steps on either side of it: 25 rad/s at 50 Hz.
Motors in front of gears turn faster, and what jumps there stays as it is."""

SUDDEN = 20.0
"""rad/s or m/s by which no joint changes its velocity from one row to the next. Knees of legged robots turn at this
speed, wrists of arms at a third of it; a link of an arm that meets a wall loses less."""

LEAST_JUMP = 0.05
"""rad or m; a smaller jump may be one count of a coarse encoder. Five of twice the size in 20 s of an arm that moves at
1 rad/s move estimates by as much as noise does."""

SLIPPED, PUSHED, UNUSUAL = 0.03, 1000.0, 20.0
"""The least jump (rad or m) that is told of a joint whose position jumps and stays, the acceleration (rad/s² or m/s²)
that no joint has from one row to the next, and how many times further than in 99 of 100 rows it is then from where its
motion leads. At 200 Hz an encoder that slips by 0.05 rad is told so, not only one that slips by 0.1. In 20 real logs no
joint was 14 times further."""

FEW = 0.01
"""Part of the rows of a joint up to which single positions count as wild: more are no readings that went wrong."""
DROPOUT = 5
"""Rows for which a torque is zero at most, where messages of a drive are lost; 5 steps of it and 4 times what those
around differ by is what it falls by at least."""
MOST_DROPOUTS = 0.1
"""Part of the rows of a joint up to which zeros are lost messages, and not how it is driven."""
JUMPED = "further than a joint moves from one row to the next"
"""What a remark on positions that jump says, and no other."""
STILL = 0.05
"""s from which it is told that a position stood still before it jumped."""


_SUMS = ("count", "_far", "_whole", "_filled", "_steps", "_swift", "_blocks", "_products", "_derived", "_averaged")
"""The attributes of a survey that are added where another one of the rows that follow joins it."""


class LogSurvey:
    """Extremes, speeds and measured velocities beside positions, gathered in one pass over a log or its pieces.

    Examples
    --------
    >>> from steelyard.recording import Recording
    >>> t = np.arange(1000) / 100
    >>> held = Recording(t=t, q=np.column_stack([np.sin(t), 0 * t]), torque=np.column_stack([np.cos(t), t]))
    >>> LogSurvey.of(held).remarks()
    ('The position of joint 2 is 0 throughout: it is held, or its sensor is stuck.',)
    """

    def __init__(self) -> None:
        self.count = 0
        self.q = self.torque = np.empty((2, 0))
        self.speed = np.empty(0)
        self._log: Measurements | None = None
        self._rate = float("nan")
        self._filled = np.zeros(2, dtype=int)
        self._far, self._whole = 0, np.empty(0, dtype=int)
        self._steps, self._swift = 0, np.empty((2, 0), dtype=int)  # blocks, and those faster than wheels and motors
        self._blocks = 0
        self._products = self._derived = self._averaged = np.empty(0)
        self._jumps = np.empty((0, 4))  # since when the position stood still, s; when it jumped, s; joint; by how much

    @classmethod
    def of(cls, recording: Measurements) -> Self:
        """Survey a log that is there as a whole."""
        survey = cls()
        survey.add(recording)
        return survey

    def add(self, recording: Measurements, start: int = 0, stop: int | None = None) -> None:
        """Take in the rows start:stop of a recording."""
        stop = recording.count if stop is None else stop
        rows = slice(start, stop)
        if self._log is None:
            width = recording.joint_count
            self._log = recording.chosen(np.arange(recording.count) == start)  # a copy, that the rest can be released
            self._rate = recording.rate
            self.q = self.torque = np.array([[np.inf], [-np.inf]]) * np.ones(width)
            self.speed = self._derived = self._averaged = np.zeros(width)
            self._whole, self._swift = np.zeros(width, dtype=int), np.zeros((2, width), dtype=int)
            self._products = np.zeros((width, width))
        self.count += stop - start
        q = recording.q[rows]
        whole = stop - start == recording.count
        facts = recording.facts["q"] if whole else column_facts(q)
        extremes = facts.low, facts.high
        self._widen("q", *extremes)
        of_torque = recording.facts["torque"] if whole else column_facts(recording.torque[rows])
        self._widen("torque", of_torque.low, of_torque.high)
        # Where positions reach no further than a turn in degrees, none is told as a count, and rounding them is spared.
        if np.abs(extremes).max(initial=0.0) * DEGREE > FULL_TURN:
            self._far += stop - start
            self._whole = self._whole + np.count_nonzero(q == np.rint(q), axis=0)
        for index, flags in enumerate((recording.position_missing, recording.torque_missing)):
            self._filled[index] += 0 if flags is None else int(flags[rows].sum())
        if stop - start > 2:
            self._see_jumps(recording.t[rows], q, facts)
            self._see_speeds(recording.t[rows], q, recording.rate)
            if recording.velocity is not None:
                self._compare(recording.t[rows], q, recording.velocity[rows], recording.rate)

    @property
    def state(self) -> dict[str, NDArray[Any]]:
        """What was gathered of rows of a log, as plain arrays for `join`, perhaps in another process."""
        return {name: np.asarray(getattr(self, name)) for name in ("q", "torque", "speed", "_jumps", *_SUMS)}

    def join(self, state: Mapping[str, NDArray[Any]], first: Measurements) -> None:
        """Take in what was gathered of the rows that follow, of a log whose first row is the first of `first`."""
        if self._log is None:
            self._log, self._rate = first.chosen(np.arange(first.count) == 0), first.rate
            self.q, self.torque, self.speed, self._jumps = (state[key] for key in ("q", "torque", "speed", "_jumps"))
            for name in _SUMS:
                setattr(self, name, state[name])
            return
        for name in ("q", "torque"):
            self._widen(name, *state[name])
        self.speed = np.maximum(self.speed, state["speed"])
        self._jumps = np.concatenate([self._jumps, state["_jumps"]])
        for name in _SUMS:
            setattr(self, name, getattr(self, name) + state[name])

    def _widen(self, name: str, lowest: Array, highest: Array) -> None:
        low, high = getattr(self, name)
        setattr(self, name, np.stack([np.minimum(low, lowest), np.maximum(high, highest)]))

    def _see_jumps(self, t: Array, q: Array, facts: ColumnFacts) -> None:
        found = []
        for j, rows in enumerate(position_jumps(t, q, facts)):
            for row in map(int, rows):
                moving = np.flatnonzero(q[: row - 1, j] != q[row - 1, j])
                since = t[moving[-1] + 1] if len(moving) else t[0]
                found.append((since, t[row], j, q[row, j] - q[row - 1, j]))
        self._jumps = np.concatenate([self._jumps, np.reshape(found, (-1, 4))])

    def _see_speeds(self, t: Array, q: Array, rate: float) -> None:
        size = max(1, round(BLOCK * rate))
        coarse, stamps = q[::size], t[::size]
        if stamps.size > 1:
            speed = np.abs(np.diff(coarse, axis=0) / np.diff(stamps)[:, None])
            for _, at, joint, _ in self._jumps:  # no joint moves as fast as it jumps
                speed[(stamps[:-1] < at) & (at <= stamps[1:]), int(joint)] = 0.0
            self.speed = np.maximum(self.speed, speed.max(axis=0))
            self._steps += len(speed)
            swift = [np.count_nonzero(speed > fastest, axis=0) for fastest in (FASTEST_WHEEL, FASTEST_MOTOR)]
            self._swift = self._swift + np.stack(swift)

    def _compare(self, t: Array, q: Array, measured: Array, rate: float) -> None:
        """Sum positions' derivatives and measured velocities block by block."""
        size = max(1, round(BLOCK * rate))
        blocks = (len(t) - 1) // size
        if blocks < 1:
            return
        ends = np.arange(blocks + 1) * size
        derived = np.diff(q[ends], axis=0) / np.diff(t[ends])[:, None]
        # Half of either end, so that both averages are centred on the same instant.
        sums = np.add.reduceat(measured[: ends[-1]], ends[:-1], axis=0)
        averaged = (sums + 0.5 * (measured[ends[1:]] - measured[ends[:-1]])) / size
        # A gap would lie in one of them and not in the other.
        whole = np.diff(t[ends]) < 1.5 * size / rate
        derived, averaged = derived[whole], averaged[whole]
        self._blocks += len(derived)
        self._products = self._products + derived.T @ averaged
        self._derived = self._derived + (derived**2).sum(axis=0)
        self._averaged = self._averaged + (averaged**2).sum(axis=0)

    @property
    def travel(self) -> Array:
        """(N,) from the lowest position to the highest, rad or m."""
        return np.asarray(self.q[1] - self.q[0])

    @property
    def first_row(self) -> Measurements:
        """The first row of the log, with the names of all for messages."""
        assert self._log is not None
        return self._log

    @property
    def source(self) -> str:
        """The log's name, for messages."""
        return self.first_row.source

    def label(self, joint: int) -> str:
        """Name a joint (from 0) for messages."""
        return self.first_row.joint_label(joint)

    def remarks(self) -> tuple[str, ...]:
        """Return all remarks that need nothing but the log.

        Raises
        ------
        InputError
            As in `velocity_remarks`, and where no joint moves.
        """
        return (
            *self.velocity_remarks(),
            *self._standstill_remarks(),
            *self.jump_remarks(),
            *self.unit_remarks(),
            *self._filled_remarks(),
        )

    def velocity_remarks(self) -> tuple[str, ...]:
        """Compare the measured velocities with the derivative of the positions, block by block.

        Faults that are certain raise InputError: positions that are counts of encoders or those of no robot; a ratio of
        57.3 (degrees), -1 (sign) or another far from 1 at near perfect correlation, a velocity that stands still while
        the joint moves, and a joint whose velocity is that of another. Lesser disagreement is a remark.
        """
        blocks = self._blocks
        if blocks < 20:
            return ()
        size_derived, size_measured = np.sqrt(self._derived / blocks), np.sqrt(self._averaged / blocks)
        with np.errstate(divide="ignore", invalid="ignore"):
            cosine = np.nan_to_num((self._products / blocks) / np.outer(size_derived, size_measured))
        source = self.source
        remarks = []
        # With a wrong unit of time a joint seems to creep, but comes far.
        moves = (size_derived > MOVING) | ((self.travel > FAR) & (size_measured > MOVING))
        for i in map(int, np.flatnonzero(moves)):
            label = self.label(i)
            ratio = size_derived[i] / max(size_measured[i], 1e-300)
            is_unit = ratio * DEGREE < 2.0 or abs(ratio / 1e3 - 1.0) < 0.05  # degrees, millimetres
            if not is_unit and (strange := self._no_positions()):
                raise InputError(f"{source}: {strange}")
            if size_measured[i] < 1e-3 * size_derived[i]:
                raise InputError(
                    f"{source}: the measured velocity of {label} stands still while its position moves; "
                    'name the right columns with `velocity` in [log], or leave them out with `velocity = "none"`.'
                )
            if abs(cosine[i, i]) > 0.97:
                remarks += _judge_ratio(source, label, float(np.copysign(ratio, cosine[i, i])))
                continue
            j = int(np.argmax(cosine[i]))
            if (
                j != i
                and cosine[i, j] > 0.99
                and cosine[i, i] < 0.8
                and abs(size_derived[i] / size_measured[j] - 1.0) < 0.1
            ):
                raise InputError(
                    f"{source}: the position of {label} moves as the measured velocity of "
                    f"{self.label(j)}; their columns are swapped: "
                    "put `position` and `velocity` in [log] in the same order of joints."
                )
            if cosine[i, i] < 0.8:
                remarks.append(
                    f"The measured velocity of {label} follows the derivative of its position poorly "
                    f"(correlation {cosine[i, i]:.2f})."
                )
        return tuple(remarks)

    def _no_positions(self, ranges: Array | None = None, units: Sequence[str] | None = None) -> str:
        """Say which columns hold no positions of joints, in whatever unit is known; empty where all do.

        `ranges` are what the limits of the description leave a joint, inf where there are none; `units` are "m" where a
        joint slides, "rad" where not, if that is known.
        """
        usual = units or ["rad"] * len(self.travel)
        return self._counts(usual) or self._no_angles(ranges, usual)

    def _counts(self, units: Sequence[str]) -> str:
        """Say which joints go through many turns in whole numbers, as no angle does; empty where none does.

        One that slides may be in whole millimetres.
        """
        turning = np.array([unit != "m" for unit in units])
        whole = turning & (self._whole >= MOSTLY * self._far) & (self.travel > 0.0)
        reach = np.where(whole, np.abs(self.q).max(axis=0), 0.0)
        j = int(np.argmax(reach))
        if reach[j] * DEGREE <= FULL_TURN:
            return ""
        names = listed([self.label(i) for i in map(int, np.flatnonzero(whole))], MOST_NAMED)
        return (
            f"the positions of {names} are whole numbers throughout, {self.label(j)} from {self.q[0, j]:.9g} to "
            f"{self.q[1, j]:.9g}, as counts of encoders are, and no radians. State `position_matrix` in [log] with "
            '"2*pi/COUNTS" on its diagonal, where COUNTS are those of a turn of the joint ("2*pi/COUNTS/RATIO" of a '
            "motor before a gear), and as `position_offset` what -2*pi*ZERO/COUNTS comes to, where ZERO is counted at "
            "the zero of the description."
        )

    def _no_angles(self, ranges: Array | None, units: Sequence[str]) -> str:
        """Say which positions can be in no unit that is known: no joint goes so far or so fast, nor a motor before it.

        A joint without limits may turn as often as it likes, but not faster than any motor.
        """
        far = np.zeros(len(units), dtype=bool)
        outruns_wheels, outruns_motors = self._swift > 2 + SWIFT * self._steps  # a wild reading makes two
        if ranges is not None:
            beyond = np.array([BEYOND_GEARS[unit] for unit in units])
            far = (ranges > NARROW) & (self.travel / beyond > ranges) & outruns_wheels
        outrun = self.speed > np.array([FASTEST_MOTOR if unit == "rad" else FASTEST_SLIDE for unit in units])
        found = far | (outrun & outruns_motors & (self.travel > MANY_TURNS))
        if not found.any():
            return ""
        names = listed([self.label(i) for i in map(int, np.flatnonzero(found))], MOST_NAMED)
        j = int(np.argmax(np.where(found, self.travel, 0.0)))
        unit, travel = units[j], float(self.travel[j])
        turns = f"{travel / (2.0 * pi):,.0f} revolutions".replace(",", " ") if unit == "rad" else f"{travel:.4g} m"
        why = "faster than any motor"
        if ranges is not None and far[j]:
            why = f"where its limits leave it {ranges[j]:.4g} {unit}"
        own = "1e-6 for µm"
        if unit == "rad":
            own = '"pi/180000" for millidegrees, "1/1000" for milliradians, "2*pi/1000000" for micro-revolutions'
        return (
            f"the positions of {names}, taken in {unit}, are those of no robot: {self.label(j)} goes through {turns} "
            f"(from {self.q[0, j]:.6g} to {self.q[1, j]:.6g}) at up to {self.speed[j]:.4g} {unit}/s, {why}. Where they "
            "are in a unit of their own, state `position_matrix` in [log] with what one of it is on the diagonal "
            f"({own}); where the times are too short, `time_unit` or `rate`."
        )

    def _standstill_remarks(self) -> tuple[str, ...]:
        """Remark on joints that do not move, and on constant torques."""
        remarks = []
        if self.count > 1 and not self.travel.any():
            raise InputError(f"{self.source}: no joint moves; check `position` in [log], or record a motion.")
        for j, (low, high) in enumerate(self.q.T):
            label = self.label(j)
            if low == high:
                remarks.append(
                    f"The position of {label} is {low + 0.0:.6g} throughout: it is held, or its sensor is stuck."
                )
            if self.count > 1 and self.torque[0, j] == self.torque[1, j] and self.first_row.lacks_torque(j):
                remarks.append(f"The torque of {label} is missing throughout: its drive reports none.")
            elif self.count > 1 and self.torque[0, j] == self.torque[1, j]:
                remarks.append(
                    f"The torque of {label} is {self.torque[0, j] + 0.0:.6g} throughout: its sensor is stuck or not "
                    "connected."
                )
        return tuple(remarks)

    def jump_remarks(self) -> tuple[str, ...]:
        """Remark, for all joints together, on positions that jump and stay there."""
        if not len(self._jumps):
            return ()
        since, at, joint, size = min(self._jumps.tolist(), key=lambda jump: jump[1])
        still = f", after it stood still for {at - since:.2g} s" if at - since > STILL else ""
        names = listed([self.label(j) for j in sorted({int(j) for j in self._jumps[:, 2]})], MOST_NAMED)
        more = f" ({len(self._jumps)} such jumps, of {names})" if len(self._jumps) > 1 else ""
        return (
            f"The position of {self.label(int(joint))} jumps by {size:.3g} at t = {at:.9g} s{still}, and goes on from "
            f"there{more}, {JUMPED}: an encoder slipped, was set to another zero or stood still, or two runs follow "
            "each other.",
        )

    def unit_remarks(self) -> tuple[str, ...]:
        """Remark, for all joints together, on rates, positions and speeds that no robot has, and on units to blame."""
        remarks = []
        rate = self._rate
        if rate <= SLOWEST_RATE:
            faster = " or ".join(
                f'{factor * rate:.6g} Hz with `time_unit = "{unit}"`'
                for unit, factor in (("ms", 1e3), ("us", 1e6))
                if factor * rate <= FASTEST_RATE
            )
            remarks.append(
                f"The rate is {rate:.6g} Hz, too slow for the accelerations of a robot; if the unit of time in [log] "
                f"is wrong, it is {faster}."
            )
        elif rate > FASTEST_RATE:
            remarks.append(
                f"The rate is {rate:.6g} Hz, faster than robots are controlled; check `time_unit` and `rate` in [log]."
            )
        reach = np.abs(self.q).max(axis=0)
        far, slides = reach > MANY_TURNS, self._slides
        turns = far & ~slides & (self.speed > LEISURELY)
        fast = ~far & (self.speed > FASTEST_JOINT)
        strange = self._no_positions()
        if strange:
            remarks.append(capital(strange))
        elif turns.any() or np.any(far & slides):
            remarks.append(self._far_away(reach, turns, far & slides))
        if fast.any():
            j = int(np.argmax(np.where(fast, self.speed, 0.0)))
            names = ", ".join(self.label(i) for i in map(int, np.flatnonzero(fast)))
            remarks.append(
                f"Joints move faster than those of robots ({names}; {self.label(j)} at up to {self.speed[j]:.4g} per "
                "s); check `time_unit`, `rate` and `position_unit` in [log], and that the positions are not those of "
                "motors in front of gears."
            )
        return tuple(remarks)

    @property
    def _slides(self) -> NDArray[np.bool_]:
        """(N,) which joints slide, as far as the units of the columns tell."""
        layout, slides = self.first_row.layout, np.zeros(len(self.speed), dtype=bool)
        if layout is not None and len(layout.units["position"]) == len(slides):
            slides[:] = [unit in LENGTHS for unit in layout.units["position"]]
        return slides

    def _far_away(self, reach: Array, turns: NDArray[np.bool_], slides: NDArray[np.bool_]) -> str:
        """Say which joints turn many times, or slide farther than slides are long, and what unit that suggests."""

        def farthest_of(which: NDArray[np.bool_]) -> str:
            j = int(np.argmax(np.where(which, reach, 0.0)))
            names = ", ".join(self.label(i) for i in map(int, np.flatnonzero(which)))
            return f"({names}; the farthest from {self.q[0, j]:.5g} to {self.q[1, j]:.5g})"

        said, units, others = [], {}, ["in a unit of their own"]
        if turns.any():
            said.append(f"go through many turns of a joint {farthest_of(turns)}")
            others.insert(0, "those of the motors, in front of gears")
            if reach[turns].max() * DEGREE <= FULL_TURN:
                units["deg"] = "degrees"
        if slides.any():
            said.append(f"go farther than joints slide {farthest_of(slides)}")
            units["mm"] = "millimetres"
        each = [f'"{"mm" if slide else "deg"}"' for slide in self._slides]
        line = f"[{', '.join(each)}]" if len(units) > 1 else "".join(f'"{unit}"' for unit in units)
        if units:
            others.insert(0, f"in {' and '.join(units.values())} (`position_unit = {line}` in [log])")
        made = "radians of either" if turns.any() else "metres of them"
        return (
            f"Positions {', and '.join(said)}; it may be that they are {', or '.join(others)} (`position_matrix` in "
            f"[log] makes {made})."
        )

    def _filled_remarks(self) -> tuple[str, ...]:
        counts = zip(self._filled, ("positions", "torques"), strict=True)
        words = " and ".join(f"{count} {name}" for count, name in counts if count)
        # Reading makes wild positions missing, and does not tell them from those that the log lacks; nor zeros.
        wild = ", or too far from those before and after for a joint to move there and back" if self._filled[0] else ""
        wild += ", or zero for a moment among torques that are not" if self._filled[1] else ""
        if not words:
            return ()
        return (f"{words[0].upper()}{words[1:]} are missing{wild}; they were filled in, and are not used.",)

    def limit_remarks(
        self, lower: ArrayLike, upper: ArrayLike, velocity_limit: ArrayLike, units: Sequence[str] | None = None
    ) -> tuple[str, ...]:
        """Compare with limits; see `Recording.check_against`. `units` are "m" where a joint slides, "rad" where not."""
        given = (np.asarray(values, dtype=np.float64) for values in (lower, upper, velocity_limit))
        # Limits such as 1e308 stand for none.
        low, high, fastest = (np.where(np.abs(one) > LARGEST, np.copysign(np.inf, one), one) for one in given)
        for values in (low, high, fastest):
            if values.shape != (len(self.speed),):
                raise InputError(
                    f"{self.source} has {len(self.speed)} joints but there are limits for {values.size}; "
                    "use the robot that was logged, or name the columns with `position` in [log]."
                )
        reach_low, reach_high = self.q
        ranges = high - low
        tolerance = 0.02 + 0.01 * np.where(np.isfinite(ranges), ranges, 0.0)

        usual = ("rad",) * len(self.speed) if units is None else tuple(units)

        def ends(j: int, k: int, scale: float = 1.0) -> tuple[float, float]:
            """Return the ends of the positions of column k as those of joint j, perhaps moved by whole turns."""
            found = scale * reach_low[k], scale * reach_high[k]
            if usual[j] != "rad" or not np.isfinite(ranges[j]):
                return found
            turns = round((low[j] + high[j] - sum(found)) / (2.0 * TURN))
            return (found[0] + turns * TURN, found[1] + turns * TURN) if abs(turns) <= FURTHER_TURNS else found

        def fits(j: int, k: int, scale: float = 1.0) -> bool:
            """Say whether the positions of column k would fit joint j."""
            lowest, highest = ends(j, k, scale)
            return bool(lowest >= low[j] - tolerance[j] and highest <= high[j] + tolerance[j])

        joints = range(len(self.speed))
        outside = [j for j in joints if not fits(j, j)]
        # Three times beyond is no calibration error: with all joints fitting after the change of unit, it is certain.
        # As millimetres nearly everything fits, so that slides must be beyond by more, about the root of a thousand.
        beyond = {"rad": (3.0, 0.5), "m": (30.0, 0.1)}
        far = [
            j
            for j, (times, least) in enumerate(beyond[one] for one in usual)
            if j in outside and max(-ends(j, j)[0], ends(j, j)[1]) > times * max(abs(low[j]), abs(high[j]), least)
        ]
        layout = self.first_row.layout
        read = () if layout is None else layout.units["position"]
        smaller = {"rad": ("deg", DEGREE), "m": ("mm", 1e-3)}
        # Joints of one kind have one unit as a rule. What was read as degrees or millimetres is not so once more.
        wrong = {usual[j] for j in far if len(read) != len(usual) or read[j] in smaller}
        told, scales = zip(*(smaller[one] if one in wrong else (one, 1.0) for one in usual), strict=True)
        if far and all(fits(j, j, scales[j]) for j in joints):
            j = far[0]
            alike = [k for k in joints if usual[k] == usual[j]]
            as_usual = "radians" if usual[j] == "rad" else "metres"
            others = f", or a list with a unit for each joint, for the others fit as {as_usual}, too" * any(
                fits(k, k) for k in alike
            )
            words = {"deg": "degrees", "mm": "millimetres"}
            how = " and ".join(words[one] for one in dict.fromkeys(told[k] for k in far))
            quoted = [f'"{one}"' for one in told]
            line = quoted[j] if set(told) == {"deg"} else f"[{', '.join(quoted)}]"
            raise InputError(
                f"{self.source}: the position of {self.label(j)} goes from {reach_low[j]:.5g} to "
                f"{reach_high[j]:.5g} {usual[j]}, far beyond its limits of {low[j]:.4g} and {high[j]:.4g} {usual[j]}, "
                f"and all joints fit theirs as {how}; "
                f"state `position_unit = {line}` in [log]{others}."
            )
        if strange := self._no_positions(ranges, usual):
            raise InputError(f"{self.source}: {strange}")
        remarks = []
        for j in outside:
            partners = [k for k in joints if k != j and fits(j, k) and fits(k, j)]
            swapped = f"; with {self.label(partners[0])} in its place both would fit" if len(partners) == 1 else ""
            remarks.append(
                f"The position of {self.label(j)} goes from {reach_low[j]:.4g} to {reach_high[j]:.4g}, "
                f"beyond its limits of {low[j]:.4g} and {high[j]:.4g}{swapped}."
            )
        for j in map(int, np.flatnonzero(self.speed > 1.5 * fastest)):
            remarks.append(
                f"{capital(self.label(j))} moves at {self.speed[j]:.4g} per s, beyond its velocity "
                f"limit of {fastest[j]:.4g}; check the units of time and position."
            )
        return tuple(remarks)


def _judge_ratio(source: str, label: str, ratio: float) -> list[str]:
    """Judge the ratio of derivative to measured velocity, where the two have the same course."""
    head = f"{source}: the position of {label} changes {ratio:.4g} times as fast as its measured velocity says"
    if abs(ratio * DEGREE - 1.0) < 0.05:
        raise InputError(f'{head}; the positions are in degrees: state `position_unit = "deg"` in [log].')
    if abs(ratio / DEGREE - 1.0) < 0.05:
        raise InputError(f'{head}; the velocities are in degrees per s: state `velocity_unit = "deg/s"` in [log].')
    for unit, scale in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if abs(ratio / scale - 1.0) < 0.05:
            raise InputError(f'{head}; the times are in {unit}: state `time_unit = "{unit}"` in [log].')
    if abs(ratio + 1.0) < 0.2:
        raise InputError(
            f'{head}; the two have opposite signs: correct the log, or leave out velocities with `velocity = "none"`.'
        )
    if not 0.5 < ratio < 2.0:
        raise InputError(
            f"{head}; expected 1: correct `time_unit`, `rate`, `position_unit` or `velocity_unit` in [log], "
            'or leave out velocities with `velocity = "none"`.'
        )
    if abs(ratio - 1.0) > 0.05:
        return [f"The position of {label} changes {ratio:.3g} times as fast as its measured velocity says."]
    return []


def stuck_torques(
    lowest: NDArray[np.float64], highest: NDArray[np.float64], travel: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return the joints that move while their torque is one number, by extremes of torque and travel (rad or m)."""
    return np.flatnonzero((lowest == highest) & (travel > 1e-3))


def turned_on(q: NDArray[np.float64], facts: ColumnFacts | None = None) -> tuple[NDArray[np.float64], tuple[int, ...]]:
    """Take jumps by a whole turn out of positions, as encoders of joints that turn on and on make them.

    A jump counts where the joint moves on after it as before: what is left of the step without the turn is small, and
    so are the steps before and after. No joint that slides jumps by 6.283 m.

    Parameters
    ----------
    q : ndarray
        (S, N), rad or m; NaN where values are missing.
    facts : ColumnFacts, optional
        Of `q`, where they are known.

    Returns
    -------
    ndarray
        (S, N), with the first row as it was; `q` itself where nothing jumps.
    tuple of int
        How many jumps each joint had.

    Examples
    --------
    >>> import numpy as np
    >>> angle = np.linspace(0.0, 15.0, 200)
    >>> found, jumps = turned_on(np.mod(angle, 2 * np.pi)[:, None])
    >>> bool(np.allclose(found[:, 0], angle)), jumps
    (True, (2,))
    """
    jumps = np.zeros(q.shape[1], dtype=int)
    result = q
    for j, there, steps, of_turns in _whole_turns(q, column_facts(q) if facts is None else facts, TURN, STEADY):
        jumps[j] = len(of_turns)
        change = np.zeros(len(there))
        change[of_turns + 1] = -np.sign(steps[of_turns]) * TURN
        turns = np.cumsum(change)
        result = result.copy() if result is q else result
        result[there, j] += turns
    return result, tuple(jumps.tolist())


def _whole_turns(
    q: NDArray[np.float64], facts: ColumnFacts, turn: float, steady: float
) -> Iterator[tuple[int, NDArray[np.intp], NDArray[np.float64], NDArray[np.intp]]]:
    """Find jumps by a whole turn: of each joint with such the rows that are there, their steps, and which these are."""
    with np.errstate(over="ignore", invalid="ignore"):  # the step between two huge numbers is infinite, and no turn
        far = ~(facts.high - facts.low <= turn - steady)  # true also where values are missing
    for j in map(int, np.flatnonzero(far)):  # no step of the others is as long
        there = np.flatnonzero(np.isfinite(q[:, j]))
        with np.errstate(over="ignore", invalid="ignore"):
            steps = np.diff(q[there, j])
            of_turns = np.flatnonzero(np.abs(np.abs(steps) - turn) < steady)
        if not len(of_turns) or np.median(np.abs(steps)) >= steady:
            continue
        # Noise makes several jumps in a row, to and fro; the steps before and after them are small.
        others = np.delete(np.arange(-1, len(steps) + 1), of_turns + 1)
        small = np.concatenate([[True], np.abs(steps) < steady, [True]])[others + 1]
        after = np.searchsorted(others, of_turns)
        of_turns = of_turns[small[after - 1] & small[after]]
        if len(of_turns):
            yield j, there, steps, of_turns


def require_no_degrees(
    q: NDArray[np.float64], columns: Sequence[str], source: str, facts: ColumnFacts | None = None
) -> None:
    """Refuse positions that jump by 360 and go on as before: degrees that are logged modulo a turn, read in radians.

    Their jumps were told as those of an encoder that slips, and the rows that they left as too few.

    Parameters
    ----------
    q : ndarray
        (S, N), rad or m; NaN where values are missing.
    columns : sequence of str
        What they are called in the log.
    source : str
        For the message.
    facts : ColumnFacts, optional
        Of `q`, where they are known.

    Raises
    ------
    InputError
        Where there are such.

    Examples
    --------
    >>> degrees = np.linspace(0.0, 800.0, 2000)
    >>> require_no_degrees(np.radians(degrees)[:, None], ["q1"], "log.csv")
    >>> require_no_degrees(np.mod(degrees, 360.0)[:, None], ["q1"], "log.csv")
    Traceback (most recent call last):
    steelyard.errors.InputError: log.csv: the position 'q1' jumps by 360 2 times and goes on as before, as ...
    """
    facts = column_facts(q) if facts is None else facts
    for j, _, _, of_turns in _whole_turns(q, facts, TURN / DEGREE, STEADY / DEGREE):
        often = f" {len(of_turns)} times" if len(of_turns) > 1 else ""
        raise InputError(
            f"{source}: the position {columns[j]!r} jumps by 360{often} and goes on as before, as degrees do that are "
            'logged modulo a turn; state `position_unit = "deg"` in [log].'
        )


@np.errstate(over="ignore", invalid="ignore")
def without_wild(
    t: NDArray[np.float64], q: NDArray[np.float64], facts: ColumnFacts | None = None
) -> NDArray[np.float64]:
    """Make single positions missing that are far from both their neighbours, which are near each other.

    A filter makes an acceleration of a wild reading over its whole response, which the model takes for true: *measured*
    on an arm of three joints, five readings that were 1 rad off, of 20 000, moved estimates by up to 10 standard
    errors, and the prediction was good.

    Parameters
    ----------
    t : ndarray
        (S,) s.
    q : ndarray
        (S, N), rad or m; NaN where values are missing.
    facts : ColumnFacts, optional
        Of `q`, where they are known.

    Returns
    -------
    ndarray
        (S, N), `q` itself where nothing is wild.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(200) / 100
    >>> angle = np.sin(t)[:, None]
    >>> angle[70] += 1.0
    >>> np.flatnonzero(np.isnan(without_wild(t, angle))).tolist()
    [70]
    """
    result = q
    for j in _joints_that_step(q, facts, LEAST_JUMP):
        steps = np.diff(q[:, j])
        far = np.flatnonzero(np.abs(steps) > LEAST_JUMP)
        rows = np.intersect1d(far + 1, far, assume_unique=True)  # with a long step before and one after
        if not len(rows) or rows.size > FEW * len(q):
            continue
        most = farthest(t[rows + 1] - t[rows - 1])
        before, after = steps[rows - 1], steps[rows]
        off = (np.minimum(np.abs(before), np.abs(after)) > most) & (np.abs(before + after) <= most)
        off &= np.abs(q[rows, j]) <= LARGEST  # beyond it is damage, for which a log is refused
        if off.any():
            result = result.copy() if result is q else result
            result[rows[off], j] = np.nan
    return result


@np.errstate(over="ignore", invalid="ignore")
def without_dropouts(torque: NDArray[np.float64]) -> NDArray[np.float64]:
    """Make torques missing that are exactly zero for a moment, among torques that are alike and are not.

    Loggers write a zero where the message of a drive was lost. *Measured* on an arm of six joints, 5 % of such rows
    make torques 5 % smaller, and the prediction of a log with as many was good.

    Parameters
    ----------
    torque : ndarray
        (S, N), N·m or N; NaN where values are missing.

    Returns
    -------
    ndarray
        (S, N), `torque` itself where there is none.

    Examples
    --------
    >>> import numpy as np
    >>> torque = 5.0 + np.sin(np.arange(200) / 30.0)[:, None]
    >>> torque[[70, 120, 121]] = 0.0
    >>> np.flatnonzero(np.isnan(without_dropouts(torque))).tolist()
    [70, 120, 121]
    """
    result = torque
    for j in map(int, np.flatnonzero(column_facts(torque).zeros)):
        values = torque[:, j]
        rows = np.flatnonzero(values == 0.0)
        if not 0 < len(rows) <= MOST_DROPOUTS * len(torque):
            continue
        starts, stops = rows[np.diff(rows, prepend=-2) > 1], rows[np.diff(rows, append=len(values) + 1) > 1] + 1
        short = (stops - starts <= DROPOUT) & (starts >= 2) & (stops <= len(values) - 2)
        starts, stops = starts[short], stops[short]
        around = values[np.stack([starts - 2, starts - 1, stops, stops + 1])]
        low, high = around.min(axis=0), around.max(axis=0)
        least = np.minimum(np.abs(low), np.abs(high))
        lost = (low * high > 0.0) & (least > 4.0 * (high - low))
        if lost.any():  # few logs need the step of the values, which takes the longest
            lost &= least > 5.0 * np.diff(np.unique(values[np.isfinite(values)])).min(initial=np.inf)
            result = result.copy() if result is torque else result
            for start, stop in zip(starts[lost], stops[lost], strict=True):
                result[start:stop, j] = np.nan
    return result


@np.errstate(over="ignore", invalid="ignore")
def position_jumps(
    t: NDArray[np.float64], q: NDArray[np.float64], facts: ColumnFacts | None = None
) -> tuple[NDArray[np.intp], ...]:
    """Find rows whose position is further from the row before than a joint moves, and which the next rows follow.

    An encoder does so that slips, is set to another zero, or goes on after it stood still; and two runs without a pause
    between their stamps. A filter makes a push of it that no torque explains.

    Parameters
    ----------
    t : ndarray
        (S,) s.
    q : ndarray
        (S, N), rad or m, without wild readings.
    facts : ColumnFacts, optional
        Of `q`, where they are known.

    Returns
    -------
    tuple of ndarray
        The rows of each joint; none where they are so many that the position is noise, or another quantity.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(200) / 100
    >>> angle = np.sin(t)[:, None]
    >>> angle[70:] += 1.0
    >>> [rows.tolist() for rows in position_jumps(t, angle)]
    [[70]]
    """
    found = [np.empty(0, np.intp) for _ in range(q.shape[1])]
    for j in _joints_that_step(q, facts, 0.5 * SLIPPED):  # two steps differ by no more than twice the longest
        steps, times = np.diff(q[:, j]), np.diff(t)[1:-1]
        here = steps[1:-1]
        off = np.minimum(np.abs(here - steps[:-2]), np.abs(here - steps[2:]))
        if not np.any(off > SLIPPED):
            continue
        usual = np.nanquantile(off, 1.0 - FEW) if len(off) > 1.0 / FEW else np.inf
        pushed = np.maximum(PUSHED * times**2, max(UNUSUAL * usual, SLIPPED))
        # What is in a unit in which the joint outruns all others, as a slide in millimetres, is bounded by no speed.
        outruns = np.count_nonzero(np.abs(here) > FASTEST_JOINT * times) > SWIFT * len(here)
        rows = np.flatnonzero(off > (pushed if outruns else np.minimum(farthest(times), pushed))) + 2
        found[j] = rows if rows.size <= FEW * len(q) else rows[:0]
    return tuple(found)


def farthest(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far a joint is, at most, from where its motion so far leads it in such times (s), rad or m."""
    return np.asarray(np.maximum(SUDDEN * times, LEAST_JUMP))


def _joints_that_step(q: NDArray[np.float64], facts: ColumnFacts | None, longest: float) -> list[int]:
    """Return the joints, from 0, whose position has a longer step from row to row, or is missing somewhere."""
    if len(q) < 3:
        return []
    facts = column_facts(q) if facts is None else facts
    return [int(j) for j in np.flatnonzero(~((facts.least_step >= -longest) & (facts.greatest_step <= longest)))]


def turn_remarks(q: NDArray[np.float64], joint_names: Sequence[str] | None = None) -> tuple[str, ...]:
    """Say of which joints positions (S, N) jump by whole turns, which reading takes out."""
    return tuple(
        f"The position of {joint_label(j, joint_names)} jumps by a turn {count} "
        f"time{'s' * (count > 1)}: it was logged modulo a turn, and was put together."
        for j, count in enumerate(turned_on(q)[1])
        if count
    )
