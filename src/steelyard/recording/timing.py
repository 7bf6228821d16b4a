"""Time stamps: order, rate, jitter, gaps, and an even grid where the log has none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from steelyard.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from steelyard.recording.recording import Recording

__all__ = ["JITTER_ACCEPTED", "check_even", "check_order", "check_period", "resampled"]

JITTER_ACCEPTED = 0.1
"""Largest deviation of an interval from the period, as a fraction of it, that is taken for even sampling."""
JITTER_SILENT = 0.01
GAP = 1.5
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-6, 0.5
GAP_FILLED = 5.0
BRIDGED = 2.5
"""Intervals from which interpolated rows count as made up: two rows at least are missing."""


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


def check_period(t: NDArray[np.float64], source: str) -> None:
    """Refuse a sample period that no robot log has: the unit of time is wrong then."""
    period = float(np.median(np.diff(t)))
    if SHORTEST_PERIOD <= period < LONGEST_PERIOD:
        return
    units = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    fitting = [unit for unit, scale in units.items() if 1e-4 <= period * scale < LONGEST_PERIOD]
    remedy = f'`time_unit = "{fitting[0]}"` would fit' if fitting else "check `time`, `time_unit` and `rate`"
    raise InputError(
        f"{source} has a sample period of {period:.6g} s; expected between {SHORTEST_PERIOD:g} and "
        f"{LONGEST_PERIOD:g} s: {remedy} in [log]."
    )


def usual_period(steps: NDArray[np.float64]) -> float:
    """Mean interval, gaps left out."""
    return float(steps[steps <= GAP * np.median(steps)].mean())


def check_even(recording: Recording) -> tuple[str, ...]:
    """Return remarks on small jitter; refuse gaps and larger jitter."""
    if recording.count < 2:
        return ()
    steps = np.diff(recording.t)
    period = usual_period(steps) if recording.stated_rate is None else 1.0 / recording.stated_rate
    ratio = steps / period
    gaps = ratio > GAP
    if gaps.any():
        row = int(np.argmax(ratio))
        raise InputError(
            f"{recording.source} has {np.count_nonzero(gaps)} gaps longer than {GAP} sample periods, the longest of "
            f"{steps[row]:.6g} s from t = {recording.t[row]:.6g} s ({recording.where(row)}); "
            "split the log there, or set `resample = true` in [processing]."
        )
    deviation = np.abs(ratio - 1.0)
    row = int(np.argmax(deviation))
    jitter = float(deviation[row])
    if jitter > JITTER_ACCEPTED:
        raise InputError(
            f"{recording.source} is sampled unevenly: an interval at t = {recording.t[row]:.6g} s "
            f"({recording.where(row)}) is off the period of {period:.6g} s by {100 * jitter:.3g} % "
            f"(accepted: {100 * JITTER_ACCEPTED:g} %); set `resample = true` in [processing], "
            "or state `rate` in [log] if the stamps are only rounded."
        )
    if jitter > JITTER_SILENT:
        return (
            f"The intervals between samples are off the period of {period:.6g} s by up to {100 * jitter:.2g} %; "
            "even sampling was assumed.",
        )
    return ()


def resampled(
    recording: Recording, rate: float | None, longest_gap: float | None
) -> tuple[Recording, NDArray[np.float64]]:
    """Interpolate onto an even grid; also return the gaps of two rows and more, (G, 2) begin and end in s.

    Positions and measured velocities and accelerations by cubic splines, torques linearly. The grid begins at the first
    stamp; its rate is `rate` (Hz) or that of the mean interval between gaps.

    Raises
    ------
    InputError
        For a gap longer than `longest_gap` (s; by default five sample periods), or a rate below that of the log.
    """
    from scipy.interpolate import CubicSpline

    t = recording.t
    steps = np.diff(t)
    period = usual_period(steps)
    limit = GAP_FILLED * period if longest_gap is None else longest_gap
    longest = int(np.argmax(steps))
    if steps[longest] > max(limit, GAP * period):
        raise InputError(
            f"{recording.source} has a gap of {steps[longest]:.6g} s from t = {t[longest]:.6g} s "
            f"({recording.where(longest)}), longer than the {limit:.6g} s that may be bridged; split the log there "
            "(or raise `longest_gap` in [processing])."
        )
    if rate is not None and rate * period < 0.9:
        raise InputError(
            f"{recording.source} has a rate of {1.0 / period:.6g} Hz and `resample` asks for {rate:.6g} Hz; "
            "resample to at least the rate of the log and lower it with `decimate`."
        )
    new_period = period if rate is None else 1.0 / rate
    count = int(np.floor((t[-1] - t[0]) / new_period * (1.0 + 1e-12))) + 1
    grid = t[0] + np.arange(count) * new_period
    grid[-1] = min(grid[-1], t[-1])
    torque = np.column_stack([np.interp(grid, t, column) for column in recording.torque.T])

    def smooth(values: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
        return None if values is None else np.asarray(CubicSpline(t, values, axis=0)(grid))

    q = smooth(recording.q)
    assert q is not None

    def flagged(flags: NDArray[np.bool_] | None) -> NDArray[np.bool_] | None:
        """Rows of the grid that lie beside a flagged one of the log."""
        if flags is None:
            return None
        after = np.clip(np.searchsorted(t, grid), 1, t.size - 1)
        return np.asarray(flags[after] | flags[after - 1])

    wide = steps > BRIDGED * period
    gaps = np.column_stack([t[:-1][wide], t[1:][wide]])
    remark = f"Resampled at {1.0 / new_period:.6g} Hz"
    remark += f", bridging {len(gaps)} gaps of up to {steps.max():.4g} s." if len(gaps) else "."
    even = replace(
        recording,
        t=grid,
        q=q,
        torque=torque,
        velocity=smooth(recording.velocity),
        acceleration=smooth(recording.acceleration),
        position_missing=flagged(recording.position_missing),
        torque_missing=flagged(recording.torque_missing),
        stated_rate=1.0 / new_period,
        remarks=(*recording.remarks, remark),
    )
    return even, gaps
