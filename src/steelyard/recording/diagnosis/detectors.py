"""Detectors of faulty rows: torques that are clipped or stand still, rows that are copies, joints that stick."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import capital, html_sentences, joint_label
from steelyard.errors import InputError
from steelyard.graph.column_passes import column_facts

from ..measurements import Measurements

__all__ = [
    "DETECTORS",
    "Interval",
    "Intervals",
    "clipped_rows",
    "fault",
    "faulty_rows",
    "find_missing",
    "find_repeated",
    "find_saturation",
    "find_stiction",
    "find_stuck_torque",
    "noise_deviation",
    "remedy_of",
    "resolution",
    "runs",
    "saturation_levels",
    "stiction_duration",
    "stuck_torque_duration",
    "stuck_while_others_move",
    "with_remedy",
]

Array = NDArray[np.float64]
NORMAL = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""
FEWEST = 5
"""Rows at an extreme without which a torque does not count as clipped."""
LONGEST_LEAST = 3
"""Rows in a row among them; noise alone hardly stands at one value for so long."""
CROWDED = 4.0
"""Rows at the level over rows just below it, in a band as wide: a smooth maximum has fewer than two and a half."""
SMALL = 0.1  # of the largest torque: what a drive cannot exceed is more
AT_REST = "at rest while the torque changes"
STUCK = "of a torque that stands still, or runs along a straight line, while the robot moves"
LEAST_TIME = 0.02
"""s, the shortest rest."""
TURN = 3.0
"""A rest is longer than this many times the time that a joint takes to turn around within the tolerance."""
PARTS = 6
"""Parts of a rest, whose mean torques are compared with the scatter about them."""
TOGETHER = 0.7
"""Share of a joint's rest in which all joints are at rest, from which it is a rest of the robot."""
STUCK_TIME, STUCK_ROWS = 0.1, 5
"""s and rows, the shortest stretch over which a torque counts as stuck."""
LONGER = 5.0
"""Times by which it lasts longer than every usual stretch of one torque. Where a smooth torque in steps turns around,
it stands up to 4.8 times as long as on the next step; torques of real arms stand for 3 rows, single ones for 6."""
MOSTLY_STUCK = 0.3
"""Share of a joint's rows above which stretches of one torque are how it is logged, or how the robot was driven."""
FINE = 0.05
"""Step of a torque over its standard deviation, up to which it is not expected to stand still."""
SWERVE = 0.02
"""Change of the velocity over such a stretch, over the largest: at a steady velocity a torque may be steady."""
SELDOM = 0.1
"""Share of the rows in which a joint moves, below which it counts as held."""
NOISE_SEEN = 1e-4
"""Noise of a torque over its standard deviation, from which it is not steady at a steady velocity either."""
FEWEST_BENDS, PARTED = 6, 8
"""Rows of a block in which noise alone surely bends, and every which block tells how much noise there is."""
STRAIGHT = 0.1
"""Second differences of a torque over its noise, up to which rows are along a straight line that a logger filled in;
those of a line whose torques were rounded are two steps. One in thirty of noise is within, and five in a row are one in
ten million."""


class Interval(NamedTuple):
    """Rows start:stop of a joint (from 0), and their times in s."""

    joint: int
    start: int
    stop: int
    begin: float
    end: float


@dataclass(frozen=True, eq=False)
class Intervals:
    """Rows of single joints that a detector found.

    Attributes
    ----------
    kind : str
        What was found, in words: "at rest while the torque changes".
    flags : ndarray of bool
        (S, N), true where it was found.
    t : ndarray
        (S,) s.
    level : ndarray or None
        (N,) what was compared with: the level of saturation, the tolerance of a rest.
    joint_names : tuple of str or None
        For sentences; None where the joints have none.
    """

    kind: str
    flags: NDArray[np.bool_]
    t: NDArray[np.float64]
    level: NDArray[np.float64] | None = None
    joint_names: tuple[str, ...] | None = None

    @property
    def count(self) -> NDArray[np.intp]:
        """(N,) number of such rows of each joint."""
        return np.asarray(self.flags.sum(axis=0))

    def __iter__(self) -> Iterator[Interval]:
        for joint in range(self.flags.shape[1]):
            for start, stop in runs(self.flags[:, joint]):
                yield Interval(joint, start, stop, float(self.t[start]), float(self.t[stop - 1]))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __bool__(self) -> bool:
        return bool(self.flags.any())

    def sentences(self) -> tuple[str, ...]:
        """Return one sentence for each joint with such rows, or one for all joints where these are the same rows."""
        found = []
        alike = self.flags.shape[1] > 1 and bool(np.all(self.flags == self.flags[:, :1]))
        for joint, rows in enumerate(self.count[:1] if alike else self.count):
            if rows:
                pieces = runs(self.flags[:, joint])
                longest = max(stop - start for start, stop in pieces)
                whose = "All joints" if alike else capital(joint_label(joint, self.joint_names))
                found.append(
                    f"{whose}: {rows} rows in {len(pieces)} intervals are "
                    f"{self.kind}, the longest of {longest} "
                    f"rows, the first at t = {self.t[pieces[0][0]]:.6g} s."
                )
        return tuple(found)

    def __repr__(self) -> str:
        return f"Intervals({self.kind}: {int(self.flags.sum())} joint rows in {len(self)} intervals)"

    def _repr_html_(self) -> str:
        return html_sentences(repr(self), self.sentences())


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the begin and the end (excluded) of each run of true values in (S,)."""
    starts, stops = _ends_of_runs(flags)
    return list(zip(starts.tolist(), stops.tolist(), strict=True))


def _ends_of_runs(flags: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False))
    return edges[::2], edges[1::2]


def resolution(values: ArrayLike) -> Array:
    """Return the step (N,) of columns (S, N) that are whole multiples of one, such as encoder counts; 0 where none is
    seen.

    Examples
    --------
    >>> t = np.arange(1000) / 1000
    >>> resolution((np.round(np.sin(t) / 1e-3) * 1e-3)[:, None]).round(9).tolist()
    [0.001]
    >>> resolution(np.sin(t)[:, None]).tolist()
    [0.0]
    """
    columns = np.asarray(values, dtype=np.float64)
    steps = np.zeros(columns.shape[1])
    for j, column in enumerate(np.ascontiguousarray(columns.T)):
        size = float(np.abs(column).max(initial=0.0))
        jumps = np.abs(np.diff(column))
        jumps = jumps[jumps > 1e-12 * size]
        if len(jumps) < 8:
            continue
        least = float(np.quantile(jumps, 0.01))
        own = jumps[jumps < 1.5 * least]
        step = float(np.median(own))
        multiple = jumps / step
        small = multiple < 50.0
        off = np.abs(multiple - np.round(multiple))[small]
        if small.sum() >= 8 and np.mean(off < 0.02) > 0.95:
            steps[j] = step
    return steps


def noise_deviation(values: ArrayLike) -> Array:
    """Return the standard deviation (N,) of white noise on smooth columns (S, N), from their fourth differences.

    Motion hardly shows in them; the median absolute value is not moved by single spikes.

    Examples
    --------
    >>> t = np.arange(5000) / 1000
    >>> noise = 0.01 * np.random.default_rng(1).normal(size=t.size)
    >>> noise_deviation((np.sin(t) + noise)[:, None]).round(3).tolist()
    [0.01]
    """
    columns = np.asarray(values, dtype=np.float64)
    if len(columns) < 8:
        return np.zeros(columns.shape[1])
    # Column by column, each of which the cache holds, takes half of the time.
    medians = [np.median(np.abs(np.diff(column, n=4))) for column in np.ascontiguousarray(columns.T)]
    return _white(np.array(medians))


def _white(medians: Array) -> Array:
    """Return the standard deviation of white noise by medians of the sizes of its fourth differences."""
    # 1, 4, 6, 4, 1 squared and added.
    return np.asarray(NORMAL * medians / np.sqrt(70.0))


def saturation_levels(torque: ArrayLike) -> Array:
    """Return the levels (N, 2), lowest and highest, at which torques (S, N) are clipped; infinite where none is seen.

    A clipped signal stands at its extreme many times, several rows running, while values just below are rare.

    Examples
    --------
    >>> t = np.arange(2000) / 1000
    >>> saturation_levels(np.clip(9 * np.sin(6 * t), -np.inf, 7.0)[:, None]).tolist()
    [[-inf, 7.0]]
    """
    columns = np.asarray(torque, dtype=np.float64)
    levels = np.tile([-np.inf, np.inf], (columns.shape[1], 1))
    for j, column in enumerate(columns.T):
        for side, sign in enumerate((-1.0, 1.0)):
            level = _clipped_at(sign * column)
            if level is not None:
                levels[j, side] = sign * level
    return levels


def _clipped_at(values: Array) -> float | None:
    """Return the level at which values are clipped from above; None where they are not."""
    top = float(values.max())
    spread = float(top - values.min())
    if spread <= 0.0:
        return None
    width = max(1e-6 * spread, 1e-9 * abs(top))
    # Those within half a step of a quantised signal are within this width, too.
    if np.count_nonzero(values >= top - width) < FEWEST:
        return None
    unequal = np.unique(values)
    gaps = np.diff(unequal[-200:])
    # One step of a quantised signal, or else next to nothing.
    if len(gaps) and len(unequal) < len(values) // 4:
        width = max(width, 0.5 * float(gaps.min()))
    at = values >= top - width
    longest = max((stop - start for start, stop in runs(at)), default=0)
    step = max(2.0 * width, 1e-3 * spread)
    below = np.count_nonzero((values < top - width) & (values >= top - width - step))
    count = np.count_nonzero(at)
    if count < FEWEST or longest < LONGEST_LEAST or count <= CROWDED * below:
        return None
    each = _usual_stay(values[(values < top - width) & (values > values.min() + width)])
    return top if count >= FEWEST * each and longest >= LONGEST_LEAST * each else None


def _usual_stay(values: Array) -> float:
    """Return for how many rows a value (S,) usually stays; torques may come less often than positions."""
    changes = np.flatnonzero(np.diff(values, prepend=np.nan, append=np.nan) != 0.0)
    return float(np.median(np.diff(changes))) if len(changes) > 1 else 1.0


def find_saturation(recording: Measurements, levels: ArrayLike | None = None) -> Intervals:
    """Find where the torque of a joint is clipped; the row before and after count, too.

    Parameters
    ----------
    recording : Recording
    levels : array_like, optional
        (N,) N·m or N, on either side of 0, or (N, 2) lowest and highest; by default those of `saturation_levels`.

    Returns
    -------
    Intervals
        Its `level` is the smaller level of each joint, infinite where it has none.

    Raises
    ------
    InputError
        Where the levels do not fit the joints.
    """
    bounds = saturation_levels(recording.torque) if levels is None else np.asarray(levels, dtype=np.float64)
    joints = recording.joint_count
    if bounds.ndim == 0:
        bounds = np.full(joints, float(bounds))
    if bounds.shape == (joints,):
        bounds = np.column_stack([-np.abs(bounds), np.abs(bounds)])
    if bounds.shape != (joints, 2):
        raise InputError(f"{recording.source} has {joints} joints; give one level of saturation, or one for each.")
    at, flags = clipped_rows(recording.torque, bounds)
    if levels is None:
        flags[:, _resting_throughout(recording, at)] = False
    names = recording.joint_names
    return Intervals("at a level where the torque is clipped", flags, recording.t, np.abs(bounds).min(axis=1), names)


def clipped_rows(torque: Array, levels: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Tell which torques (S, N) are at levels (N, 2), and which of them are or have a neighbour that is."""
    slack = 1e-6 * column_facts(torque).ranges
    at = (torque <= levels[:, 0] + slack) | (torque >= levels[:, 1] - slack)
    near = at.copy()
    near[1:] |= at[:-1]
    near[:-1] |= at[1:]
    return at, near


def _resting_throughout(recording: Measurements, at: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Say which joints (N,) rest in most of the rows (S, N) where their torque is at an extreme.

    While the position does not change by a single step, a controller that answers to nothing else asks for the very
    same torque: it is constant, and need not be clipped. Nor is a small torque of a joint at rest, whatever its encoder
    flickers.
    """
    found = np.zeros(at.shape[1], dtype=bool)
    if not at.any():
        return found
    tolerance, _ = stiction_duration(recording)
    for joint, column in enumerate(at.T):
        pieces = runs(column)
        small = SMALL * np.abs(recording.torque[:, joint]).max()
        still = 0
        for start, stop in pieces:
            travel = np.ptp(recording.q[start:stop, joint])
            is_small = np.abs(recording.torque[start:stop, joint]).max() < small
            still += stop - start if travel == 0.0 or (is_small and travel <= tolerance[joint]) else 0
        found[joint] = still > 0.5 * sum(stop - start for start, stop in pieces)
    return found


def find_missing(recording: Measurements) -> Intervals | None:
    """Return where the log had no position or no torque; None where all are there."""
    parts = [part for part in (recording.position_missing, recording.torque_missing) if part is not None]
    if not parts:
        return None
    flags = np.logical_or.reduce(parts)
    return Intervals("missing in the log", flags, recording.t, joint_names=recording.joint_names)


def find_repeated(recording: Measurements) -> Intervals:
    """Find rows whose positions and torques, all of them, are those of the row before while a joint moves.

    A joint counts as moving where it changes, over the rows around, by more than two steps of its encoder a row; slow
    motion that the encoder does not resolve from row to row is no fault. All joints of such a row are flagged: its
    motion is wrong.

    Returns
    -------
    Intervals

    Examples
    --------
    >>> from steelyard.recording import Recording
    >>> t = np.arange(1000)[:, None] / 1000
    >>> q, torque = np.sin(3 * t), np.cos(2 * t)
    >>> q[500:504], torque[500:504] = q[499], torque[499]
    >>> [(one.start, one.stop) for one in find_repeated(Recording(t=t[:, 0], q=q, torque=torque))]
    [(500, 504)]
    """
    q, torque = recording.q, recording.torque
    same = np.zeros(len(q), dtype=bool)
    same[1:] = np.all(q[1:] == q[:-1], axis=1) & np.all(torque[1:] == torque[:-1], axis=1)
    if same.any():
        reach = 10
        ahead = np.minimum(np.arange(len(q)) + reach, len(q) - 1)
        behind = np.maximum(np.arange(len(q)) - reach, 0)
        speed = np.abs(q[ahead] - q[behind]) / (ahead - behind)[:, None]
        same &= np.any(speed > np.maximum(2.0 * resolution(q), 1e-12), axis=1)
    flags = np.repeat(same[:, None], recording.joint_count, axis=1)
    return Intervals("copies of the row before", flags, recording.t, joint_names=recording.joint_names)


def stiction_duration(recording: Measurements) -> tuple[Array, Array]:
    """Return for each joint (N,) the tolerance within which it counts as at rest, and how long it has to, in s.

    The tolerance is one and a half steps of the encoder or four times the noise of the positions. A moving joint that
    turns around stays within it for ``2 sqrt(2 tolerance / |ddq|)``; three times that, for the usual acceleration, is
    no turn any more.
    """
    q, rate = recording.q, recording.rate
    tolerance = np.maximum(1.5 * resolution(q), 4.0 * noise_deviation(q))
    tolerance = np.maximum(tolerance, 1e-9)
    size = max(1, round(0.05 * rate))
    coarse = q[::size]
    longest = np.full(len(tolerance), LEAST_TIME)
    if len(coarse) >= 5:
        acceleration = np.sqrt(np.mean(np.diff(coarse, n=2, axis=0) ** 2, axis=0)) * (rate / size) ** 2
        with np.errstate(divide="ignore"):
            turn = 2.0 * np.sqrt(2.0 * tolerance / acceleration)
        longest = np.maximum(longest, TURN * turn)
    return tolerance, longest


def find_stiction(
    recording: Measurements, duration: Array | float | None = None, tolerance: Array | None = None
) -> Intervals:
    """Find where a joint stands still while its torque changes.

    Static friction then takes up whatever the rest of the joint's torque is; no model of sliding friction says what.

    Parameters
    ----------
    recording : Recording
    duration : float or ndarray, optional
        s, shortest rest; by default what `stiction_duration` says.
    tolerance : ndarray, optional
        (N,) rad or m, travel within a rest; by default what `stiction_duration` says.

    Returns
    -------
    Intervals
        Its `level` is the tolerance.

    Examples
    --------
    >>> from steelyard.recording import Recording
    >>> t = np.arange(4000) / 1000
    >>> q = np.where(t < 1, np.sin(np.pi / 2 * t), np.where(t < 2, 1.0, 1.0 + np.sin(t - 2)))
    >>> found = find_stiction(Recording(t=t, q=q[:, None], torque=np.sin(5 * t)[:, None]))
    >>> [(round(one.begin, 1), round(one.end, 1)) for one in found]
    [(1.0, 2.0)]
    """
    if tolerance is None or duration is None:
        own_tolerance, own_duration = stiction_duration(recording)
        tolerance = own_tolerance if tolerance is None else tolerance
        duration = own_duration if duration is None else duration
    tolerance = np.asarray(tolerance, dtype=np.float64)
    lengths = np.broadcast_to(np.asarray(duration, float), (recording.joint_count,))
    return _sticking(recording, _resting(recording, tolerance, lengths), tolerance)


def _sticking(recording: Measurements, resting: NDArray[np.bool_], tolerance: Array) -> Intervals:
    """Return the rests (S, N) in which the torque changes."""
    flags = resting.copy()
    for j in range(recording.joint_count):
        for start, stop in runs(flags[:, j]):
            flags[start:stop, j] = _changes(recording.torque[start:stop, j])
    return Intervals(AT_REST, flags, recording.t, tolerance, recording.joint_names)


def stuck_torque_duration(recording: Measurements) -> tuple[Array, Array]:
    """Return for each joint (N,) the travel with which it moves, and how long its torque does not stand still then, s.

    A torque stands still by nature where it comes less often than the positions, in coarse steps, or clipped; how long
    it does so is seen in the recording. Infinite where it stands still often. The travel is negative of a joint that
    is held, and whose torque flickers: it counts as moving where another one does.
    """
    return _stuck_durations(recording, _TorqueSteps.of(recording))


def _stuck_durations(recording: Measurements, seen: _TorqueSteps) -> tuple[Array, Array]:
    tolerance, _ = stiction_duration(recording)
    least = max(STUCK_TIME * recording.rate, STUCK_ROWS)
    clipped, _ = clipped_rows(recording.torque, saturation_levels(recording.torque))
    steps, spread = seen.steps, recording.torque.std(axis=0)
    flickers = seen.noise > np.maximum(steps, NOISE_SEEN * spread)
    fine = steps <= FINE * spread
    held = (seen.moving(tolerance).mean(axis=0) < SELDOM) & flickers
    tolerance = np.where(held, -1.0, tolerance)
    longest = np.full(recording.joint_count, np.inf)
    for j, moving in enumerate(seen.moving(tolerance).T):
        starts, stops = _ends_of_runs(seen.unchanged[j] & moving)
        lengths = stops - starts + 1  # with the row that the others are equal to
        usual, natural, stuck = lengths[lengths < least].max(initial=1), 0, 0
        long = np.flatnonzero(lengths >= least)
        for start, stop, rows in np.column_stack([starts, stops, lengths])[long[np.argsort(lengths[long])]].tolist():
            if rows < LONGER * usual:
                usual = rows
            elif (
                not clipped[start:stop, j].any()
                and _jumps(recording.torque[:, j], start - 1, stop, steps[j])
                and (flickers[j] or _swerves(recording.q[:, j], start - 1, stop))
            ):
                stuck += rows
            else:
                natural = rows
        if fine[j] and stuck <= MOSTLY_STUCK * np.count_nonzero(moving):
            longest[j] = max(least, LONGER * usual, 2.0 * natural) / recording.rate
    return tolerance, longest


def _jumps(torque: Array, start: int, stop: int, step: float) -> bool:
    """Say whether a torque (S,) comes to rows start:stop, goes on from them or changes there, by more than a step."""
    edges = [row for row in (start, stop) if 0 < row < len(torque)]
    within = abs(torque[stop - 1] - torque[start]) > 1.5 * step  # along a line, which joins what was there
    return within or any(abs(torque[row] - torque[row - 1]) > 1.5 * step for row in edges)


def _swerves(q: Array, start: int, stop: int) -> bool:
    """Say whether the velocity of a joint at q (S,) changes within rows start:stop."""
    ends = np.unique(np.linspace(start, stop - 1, PARTS + 1).astype(int))
    size = max(1, (stop - start) // PARTS)
    fastest = np.abs(q[size:] - q[:-size]).max() / size
    return bool(np.ptp(np.diff(q[ends]) / np.diff(ends)) > SWERVE * fastest)


class _TorqueSteps(NamedTuple):
    """What the search for torques that stand still looks at: once of a recording, since it takes the longest.

    Attributes
    ----------
    unchanged : list of ndarray
        For each joint which rows (S,) have the torque of the row before, or go on along a line where noise makes others
        flicker. Interpolation to even rows changes the last digits.
    travel : ndarray
        (S, N) rad or m that each joint moves within the shortest time of a stuck torque.
    steps, noise : ndarray
        (N,) of the torques.
    """

    unchanged: list[NDArray[np.bool_]]
    travel: Array
    steps: Array
    noise: Array

    @classmethod
    def of(cls, recording: Measurements) -> _TorqueSteps:
        steps, noise = resolution(recording.torque), noise_deviation(recording.torque)
        reach = max(1, round(0.5 * STUCK_TIME * recording.rate))
        rows = np.arange(recording.count)
        ahead, behind = np.minimum(rows + reach, recording.count - 1), np.maximum(rows - reach, 0)
        unchanged = []
        for j, torque in enumerate(np.ascontiguousarray(recording.torque.T)):
            same = np.zeros(len(torque), dtype=bool)
            same[1:] = np.abs(torque[1:] - torque[:-1]) <= 1e-9 * np.abs(torque[:-1])
            if STRAIGHT * noise[j] > max(2.0 * steps[j], STRAIGHT * NOISE_SEEN * torque.std()):
                same[2:] |= np.abs(np.diff(torque, n=2)) < STRAIGHT * noise[j]
            if recording.torque_missing is not None:
                same &= ~recording.torque_missing[:, j]
            unchanged.append(same)
        return cls(unchanged, np.abs(recording.q[ahead] - recording.q[behind]), steps, noise)

    def moving(self, tolerance: Array) -> NDArray[np.bool_]:
        """Say in which rows (S, N) a joint moves by more than its tolerance.

        One with a negative tolerance moves where any of the others does.
        """
        moving = self.travel > tolerance
        moving[:, tolerance < 0.0] = moving[:, tolerance >= 0.0].any(axis=1, keepdims=True)
        return np.asarray(moving)


def find_stuck_torque(
    recording: Measurements, duration: ArrayLike | None = None, tolerance: Array | None = None
) -> Intervals:
    """Find where the robot moves while a torque stands still, as that of a sensor does that is not read for a while.

    A torque with noise that runs along a straight line for as long is found as well: so do loggers fill gaps.
    A joint that rests for a while is not looked at then: its rows are left out in any case.

    Parameters
    ----------
    recording : Recording
    duration : array_like, optional
        (N,) s, over which a torque that stands still is a fault; by default what is longer than it does so otherwise:
        torques may come less often than the positions, in coarse steps, or clipped.
    tolerance : ndarray, optional
        (N,) rad or m, within which a joint counts as at rest; by default what `stiction_duration` says. One that is
        negative stands for a joint that is held, and is looked at where others move.

    Returns
    -------
    Intervals

    Examples
    --------
    >>> from steelyard.recording import Recording
    >>> t = np.arange(4000) / 1000
    >>> torque = np.cos(5 * t)
    >>> torque[1000:1500] = torque[1000]
    >>> found = find_stuck_torque(Recording(t=t, q=np.sin(3 * t)[:, None], torque=torque[:, None]))
    >>> [(one.start, one.stop) for one in found]
    [(1000, 1500)]
    """
    if tolerance is None and duration is None and not _may_stand_still(recording):
        return Intervals(STUCK, np.zeros(recording.q.shape, dtype=bool), recording.t, joint_names=recording.joint_names)
    seen = _TorqueSteps.of(recording)
    if tolerance is None or duration is None:
        own_tolerance, own_duration = _stuck_durations(recording, seen)
        tolerance = own_tolerance if tolerance is None else tolerance
        duration = own_duration if duration is None else duration
    lengths = np.broadcast_to(np.asarray(duration, dtype=np.float64), (recording.joint_count,)) * recording.rate
    flags = np.zeros(recording.q.shape, dtype=bool)
    moving = seen.moving(tolerance)
    for j in np.flatnonzero(lengths < recording.count):
        starts, stops = _ends_of_runs(seen.unchanged[j] & moving[:, j])
        long = stops - starts + 1 >= lengths[j]
        for start, stop in zip(starts[long], stops[long], strict=True):
            flags[start - 1 : stop, j] = True
    return Intervals(STUCK, flags, recording.t, joint_names=recording.joint_names)


def _may_stand_still(recording: Measurements) -> bool:
    """Say whether a torque hardly bends within one of its blocks: every stretch that counts as stuck holds some.

    To ask so first takes a seventh of the time of the search, which few logs need.
    """
    block = int(max(STUCK_TIME * recording.rate, STUCK_ROWS)) // 4
    if block < FEWEST_BENDS or recording.count < PARTED * block:
        return True
    bends = np.diff(recording.torque, n=2, axis=0)
    blocks = bends[: len(bends) // block * block].reshape(-1, block, bends.shape[1])
    # Fourth differences, see `noise_deviation`, of a part of the blocks: twice that is more than the noise of all.
    fourth = np.abs(np.diff(blocks[::PARTED], n=2, axis=1)).reshape(-1, bends.shape[1])
    least = np.maximum(2.0 * STRAIGHT * _white(np.median(fourth, axis=0)), 4e-9 * np.abs(recording.torque).max(axis=0))
    return bool(np.any(np.all(np.abs(blocks) <= least, axis=1)))


def stuck_while_others_move(recording: Measurements) -> Intervals:
    """Return what `find_stiction` finds, without the rests that every sound log has.

    Those are the rests at its begin and end, and those of all joints together, where nothing was commanded to move.
    """
    tolerance, lengths = stiction_duration(recording)
    resting = _resting(recording, tolerance, lengths)
    found = _sticking(recording, resting, tolerance)
    if not found:
        return found
    together = np.all(resting, axis=1) & (recording.joint_count > 1)
    flags = found.flags.copy()
    for one in found:
        rows = slice(one.start, one.stop)
        # Joints do not come to rest in the very same row.
        if one.start == 0 or one.stop == recording.count or np.mean(together[rows]) > TOGETHER:
            flags[rows, one.joint] = False
    return Intervals(AT_REST, flags, recording.t, tolerance, recording.joint_names)


def _resting(recording: Measurements, tolerance: Array, lengths: Array) -> NDArray[np.bool_]:
    """Find the rows (S, N) where a joint stays within its tolerance for at least the shortest time of a rest."""
    flags = np.zeros(recording.q.shape, dtype=bool)
    for j, q in enumerate(np.ascontiguousarray(recording.q.T)):
        if not np.isfinite(lengths[j]) or np.ptp(q) <= tolerance[j]:
            continue
        size = max(3, round(float(lengths[j]) * recording.rate) | 1)
        if size >= recording.count:
            continue
        half = size // 2
        if not _may_rest(q, half, tolerance[j]):
            continue
        travel = _largest_around(q, size) + _largest_around(-q, size)
        centre = travel <= tolerance[j]
        centre[:half] = centre[recording.count - half :] = False
        flags[:, j] = _largest_around(centre, size)  # its ends are false, as what lies beyond them
    return flags


def _may_rest(q: Array, block: int, tolerance: float) -> bool:
    """Say whether q (S,) stays within a tolerance in one of its blocks: every rest of twice that length holds one."""
    count = len(q) // block * block
    near = np.abs(q[block - 1 : count : block] - q[:count:block]) <= tolerance
    blocks = q[:count].reshape(-1, block)[near]
    return bool((blocks.max(axis=1) - blocks.min(axis=1) <= tolerance).any())


def _largest_around(values: NDArray[Any], size: int) -> NDArray[Any]:
    """Return the largest of so many neighbours, an odd number, of which each is the middle; the ends go on as they are.

    This is `scipy.ndimage.maximum_filter1d` with ``mode="nearest"``; to import it takes a twelfth of the whole first
    identification. Extremes of both sides of each border between pieces of `size` make those of all windows (M. van
    Herk, A fast algorithm for local minimum and maximum filters, Pattern Recognition Letters 13, 1992).
    """
    count, half = len(values), size // 2
    padded = np.pad(values, (half, half + -(count + 2 * half) % size), mode="edge").reshape(-1, size)
    before = np.maximum.accumulate(padded, axis=1).ravel()
    after = np.maximum.accumulate(padded[:, ::-1], axis=1)[:, ::-1].ravel()
    return np.maximum(after[:count], before[size - 1 : size - 1 + count])


def _changes(torque: Array) -> bool:
    """Say whether the torque changes by more than its scatter about the means of a few parts of the interval."""
    parts = np.array_split(torque, min(PARTS, len(torque)))
    means = np.array([part.mean() for part in parts])
    scatter = float(
        np.sqrt(np.mean(np.concatenate([part - mean for part, mean in zip(parts, means, strict=True)]) ** 2))
    )
    return float(np.ptp(means)) > max(scatter, 1e-9 * float(np.abs(torque).max()))


DETECTORS = {
    "stiction": stuck_while_others_move,
    "saturation": find_saturation,
    "stuck_torque": find_stuck_torque,
    "repeated": find_repeated,
}
"""By the option of [processing] that leaves out what they find."""
FEW = {"stiction": 0.1, "saturation": 1e-3, "stuck_torque": 0.0, "repeated": 1e-3}
"""Shares of a joint's rows below which they are not remarked on: every robot stands a while where it turns around."""


def faulty_rows(
    recording: Measurements, handled: Collection[str] = (), slowest: NDArray[np.float64] | None = None
) -> tuple[str, ...]:
    """Return the sentences on rows that would harm a regression, and on none of the `handled` options of [processing].

    Parameters
    ----------
    recording : Measurements
    handled : collection of str
    slowest : ndarray, optional
        (N,) rad/s or m/s: slower rows of a joint are left out in any case, and with them those in which it rests.

    Examples
    --------
    >>> from steelyard.recording import Recording
    >>> t = np.arange(3000) / 1000
    >>> torque = np.clip(8 * np.sin(5 * t), -6.0, 6.0)
    >>> log = Recording(t=t, q=np.sin(2 * t)[:, None], torque=torque[:, None])
    >>> len(faulty_rows(log)), len(faulty_rows(log, ["saturation"]))
    (1, 0)
    """
    searched = {option: detector for option, detector in DETECTORS.items() if option not in handled}
    return tuple(text for option, detector in searched.items() for text in fault(detector(recording), option, slowest))


def fault(rows: Intervals, option: str, slowest: NDArray[np.float64] | None = None) -> tuple[str, ...]:
    """Return the sentences on what a detector found, where it is enough to harm a regression; see `faulty_rows`."""
    if not rows:
        return ()
    flags = rows.flags & (rows.flags.mean(axis=0) >= FEW[option])
    if option == "stiction" and slowest is not None:
        flags &= ~(slowest > 0.0)
    return tuple(with_remedy(replace(rows, flags=flags), option))


def with_remedy(found: Intervals, option: str) -> list[str]:
    """Return the sentences on rows with the option of [processing] that leaves them out."""
    return [f"{sentence[:-1]}{_remedy(option)}" for sentence in found.sentences()]


def remedy_of(sentence: str) -> str | None:
    """Return the option of [processing] that a sentence of `with_remedy` names, wherever it is quoted; else None."""
    return next((option for option in DETECTORS if _remedy(option) in sentence), None)


def _remedy(option: str) -> str:
    return f" (`{option} = true` leaves them out)."
