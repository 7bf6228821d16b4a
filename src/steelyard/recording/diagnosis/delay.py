"""Estimating the delay between the channels of position and torque, and taking it out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import html_table
from steelyard.dynamics.threads import one_thread
from steelyard.errors import InputError

from ..filters.zero_phase import low_pass

if TYPE_CHECKING:
    from steelyard.dynamics import Model

    from ..samples import Samples

__all__ = ["DelayEstimate", "advanced", "cubic_weights", "estimate_delay"]

Array = NDArray[np.float64]
MOST_ROWS = 20_000
"""Rows at most by which torques are regressed on the motion, evenly spread over the log."""
SEGMENTS = 10
"""Segments of the log, left out one at a time for the standard deviation."""
UNRESOLVED = 0.1
"""This share of the time between rows is not resolved: where in it a jump of Coulomb friction falls is not seen."""
SURE = 3.0
"""Standard deviations from zero at which a delay is certain enough to be taken out."""
SPREAD = float(np.log(5.0) / (np.log(1.0 + np.sqrt(2.0)) / 6.0))
"""A second pass of the same filter lowers its cutoff (order 3) by a factor of (1 + √2)^(1/6); the delay's change is
carried on to a factor of 5, for what a filter does to a motion with friction is seen in full over such a range."""
MOST_JOINTS, FEW_JOINTS = 8, 3
"""Joints up to which products of three (four) factors are tried where there is no model; their number grows fast."""


@dataclass(frozen=True, eq=False)
class DelayEstimate:
    """A delay of the torques behind the motion, as `estimate_delay` finds it.

    Attributes
    ----------
    delay : float
        s, by which torques are logged later than the motion that they belong to, all joints together; negative where
        they are logged earlier.
    standard_deviation : float
        s, from how much the delay changes as tenths of the log are left out, from how far the joints disagree, and
        from how far it moves with the cutoff of the positions; a tenth of a row at least.
    joint_delays, joint_deviations : ndarray
        (N,) the same for each joint by itself, the cutoff left out; NaN where it does not tell.
    lags : ndarray
        (L,) s that were tried.
    residuals : ndarray
        (L, N) N·m or N, root mean square residual of the regression of each joint after each lag.
    """

    delay: float
    standard_deviation: float
    joint_delays: Array
    joint_deviations: Array
    lags: Array
    residuals: Array

    @property
    def is_sure(self) -> bool:
        """Whether the delay differs from zero by three standard deviations or more."""
        return abs(self.delay) >= SURE * self.standard_deviation

    def __repr__(self) -> str:
        return (
            f"DelayEstimate(torque {1e3 * self.delay:.3g} ± {1e3 * self.standard_deviation:.2g} ms behind the motion)"
        )

    def _repr_html_(self) -> str:
        pairs = zip(self.joint_delays, self.joint_deviations, strict=True)
        rows = [(j, f"{1e3 * d:.3g}", f"{1e3 * s:.2g}") for j, (d, s) in enumerate(pairs, start=1)]
        return html_table(repr(self), ("joint", "delay, ms", "±"), rows)


def estimate_delay(samples: Samples, model: Model | None = None, longest: float = 0.05) -> DelayEstimate:
    """Estimate by how much the torques are logged later than the motion.

    For each lag, the torques of that much later rows are regressed on the motion; the delay is where the residual is
    least. Torques are moved by whole rows, never interpolated, so that their noise stays as it is; between the rows,
    the curve ``a + b (lag - delay)² + c |lag - delay|`` through the residuals around the least one decides (the last
    part is what the jumps of Coulomb friction make).

    A filter rounds the reversals of a motion with friction, and moves the least residual by milliseconds; noise that
    it leaves, and a controller answers, does so, too. Where the samples tell their cutoff, their motion is filtered
    once more, and by how far the delay moves then is part of the standard deviation: it is wide where the cutoff
    decides the delay.

    Parameters
    ----------
    samples : Samples
        Evenly sampled and not decimated, with positions filtered without phase shift, no higher than `choose_cutoff`
        says: a controller answers the noise of the encoders, and that answer has a delay of its own. With times.
    model : Model, optional
        Whose base regressor explains the torques. Without it, sums of products of positions, velocities,
        accelerations, their signs, sines and cosines do; what they miss pulls the delay, by milliseconds at worst,
        which the disagreement of the joints shows in part.
    longest : float
        s, the longest delay to look for, in either direction.

    Raises
    ------
    InputError
        Where the samples have no even times, are too few, or the least residual is at the end of the lags.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> t = np.arange(8000)[:, None] / 1000
    >>> motion = lambda t: (np.sin(3 * t), 3 * np.cos(3 * t), -9 * np.sin(3 * t))
    >>> late = model.inverse_dynamics(*motion(t - 0.0037), np.ones(10))
    >>> q, dq, ddq = motion(t)
    >>> samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=late, t=t[:, 0])
    >>> round(estimate_delay(samples, model).delay, 5)
    0.0037
    """
    if samples.t is None or samples.count < 200:
        raise InputError(
            "a delay is estimated from samples with times, 200 at least; process the recording without trimming so "
            "much."
        )
    steps = np.diff(samples.t)
    step = float(np.median(steps))
    if np.abs(steps - step).max() > 0.2 * step:
        raise InputError("a delay is estimated from evenly sampled rows; set `resample = true` in [processing] first.")
    reach = max(3, int(np.ceil(longest / step)))
    if samples.count < 6 * reach:
        raise InputError(
            f"{samples.count} samples are too few for delays of up to {longest:g} s; lower `longest` or give a "
            "longer log."
        )
    rows = np.arange(reach, samples.count - reach, max(1, -(-(samples.count - 2 * reach) // MOST_ROWS)))
    shifts = np.arange(-reach, reach + 1)
    lags = np.asarray(shifts * step, dtype=np.float64)

    def found(of: Samples) -> DelayEstimate:
        if model is not None:
            of = of.with_states(model)
        with one_thread():
            squares = np.stack([_squares(*problem, shifts) for problem in _problems(of, model, rows)], axis=-1)
        return _from_squares(squares, len(rows), lags, step)

    estimate = found(samples)
    cutoff = samples.cutoff
    if cutoff is None or 2.0 * cutoff * step >= 1.0:
        return estimate
    q, dq, ddq = (low_pass(a, 1.0 / step, cutoff, 3, "the samples") for a in (samples.q, samples.dq, samples.ddq))
    try:
        moved = SPREAD * (found(replace(samples, q=q, dq=dq, ddq=ddq)).delay - estimate.delay)
    except InputError:  # the least residual is at the end of the lags then
        moved = longest
    return replace(estimate, standard_deviation=float(np.hypot(estimate.standard_deviation, moved)))


def _problems(
    samples: Samples, model: Model | None, rows: NDArray[np.intp]
) -> Iterator[tuple[Array, NDArray[np.intp], Array]]:
    """Yield for each joint an orthonormal basis of what explains its torque (M, c), rows (M,) and the torque (S,)."""
    joints = samples.joint_count
    used = samples.used_rows[rows]
    q, dq, ddq = (np.ascontiguousarray(a[rows]) for a in (samples.q, samples.dq, samples.ddq))
    if model is not None:
        columns = model.base_columns
        entries = columns.of_motion(q, dq, ddq, samples.channels_for(model, rows))
        for k, part in enumerate(columns.by_joint(entries)):
            yield _basis(part[used[:, k]]), rows[used[:, k]], samples.torque[:, k]
        return
    features = _features(q, dq, ddq)
    shared = _basis(features) if used.all() else None
    for k in range(joints):
        keep, sign = used[:, k], np.sign(dq[:, k : k + 1])
        if shared is None:
            basis = _basis(np.hstack([features, sign])[keep])
        else:
            rest = sign - shared @ (shared.T @ sign)
            rest -= shared @ (shared.T @ rest)
            size = float(np.linalg.norm(rest))
            basis = np.hstack([shared, rest / size]) if size > 1e-6 * np.sqrt(len(rows)) else shared
        yield basis, rows[keep], samples.torque[:, k]


def _basis(columns: Array) -> Array:
    """Return an orthonormal basis of the span of columns, without directions that are in it by rounding alone."""
    lengths = np.sqrt(np.sum(columns**2, axis=0))
    vectors, values, _ = np.linalg.svd(columns / np.where(lengths > 0.0, lengths, 1.0), full_matrices=False)
    return np.asarray(vectors[:, values > 1e-9 * values.max(initial=0.0)])


def _features(q: Array, dq: Array, ddq: Array) -> Array:
    """Return what explains torques of any robot roughly (M, c): the motion, its sines and cosines, and products."""
    turns = np.hstack([np.sin(q), np.cos(q)])
    columns = [np.ones((len(q), 1)), q, dq, ddq, turns]
    pairs = [(i, j) for i in range(q.shape[1]) for j in range(i, q.shape[1])]
    columns.append(np.column_stack([dq[:, i] * dq[:, j] for i, j in pairs]))
    if q.shape[1] <= MOST_JOINTS:
        both = [(i, j) for i in range(turns.shape[1]) for j in range(i, turns.shape[1])]
        columns.append(np.column_stack([turns[:, i] * turns[:, j] for i, j in both]))
        columns += [ddq[:, j : j + 1] * turns for j in range(q.shape[1])]
        if q.shape[1] <= FEW_JOINTS:
            columns += [dq[:, i : i + 1] * dq[:, j : j + 1] * turns for i, j in pairs]
    return np.hstack(columns)


def _squares(basis: Array, rows: NDArray[np.intp], torque: Array, shifts: NDArray[np.intp]) -> Array:
    """Return the squared residuals after each shift by segments of the log, (L, G)."""
    result = np.zeros((len(shifts), SEGMENTS))
    if len(rows) <= 2 * basis.shape[1]:
        return result
    edges = np.linspace(0, len(rows), SEGMENTS + 1).astype(int)
    for index, shift in enumerate(shifts):
        target = torque[rows + shift]
        rest = target - basis @ (basis.T @ target)
        result[index] = np.add.reduceat(rest**2, edges[:-1])
    return result


def _from_squares(squares: Array, count: int, lags: Array, step: float) -> DelayEstimate:
    total = squares.sum(axis=1)
    least = total.min(axis=0)
    told = least > 0.0
    if not told.any():
        told = total.max(axis=0) > 0.0
    scale = np.where(told, np.maximum(least, 1e-12 * total.max(axis=0)), np.inf)
    delay, deviation = _minimum(squares[:, :, told] / scale[told], lags, step)
    at_end = abs(delay) > lags[-1] - 2.0 * step
    if at_end:
        raise InputError(
            f"the residual still falls at a delay of {1e3 * delay:.3g} ms, the longest that was tried; raise "
            "`longest`, or check "
            "that positions and torques are of the same run."
        )
    own = [
        _minimum(squares[:, :, k : k + 1] / scale[k], lags, step) if told[k] else (np.nan, np.nan)
        for k in range(len(told))
    ]
    own = [(d, s) if abs(d) <= lags[-1] - 2.0 * step else (np.nan, np.nan) for d, s in own]
    joint_delays, joint_deviations = np.array([d for d, _ in own]), np.array([s for _, s in own])
    sure = joint_deviations > 0.0
    if np.count_nonzero(sure) > 1:
        # Joints that disagree beyond their own deviations (Birge's ratio): something else than noise is at work.
        apart = ((joint_delays[sure] - delay) / joint_deviations[sure]) ** 2
        deviation *= max(1.0, float(np.sqrt(apart.sum() / (len(apart) - 1))))
    return DelayEstimate(
        delay,
        deviation,
        joint_delays,
        joint_deviations,
        lags,
        np.sqrt(total / max(count, 1)),
    )


def _minimum(squares: Array, lags: Array, step: float) -> tuple[float, float]:
    """Return where the residual (L, G, N) is least, and its standard deviation by leaving out each segment."""
    whole = squares.sum(axis=(1, 2))
    best = _vertex(whole, lags, step)
    without = np.array([_vertex(whole - squares[:, g].sum(axis=1), lags, step) for g in range(squares.shape[1])])
    groups, least = len(without), UNRESOLVED * step
    spread = np.sqrt((groups - 1) / groups * np.sum((without - without.mean()) ** 2))
    return best, float(np.hypot(spread, least))


def _vertex(curve: Array, lags: Array, step: float) -> float:
    """Return the place of the least value of ``a + b x² + c |x|``, fitted to the values around their least one."""
    from scipy.optimize import minimize_scalar

    lowest = int(np.argmin(curve))
    width = max(4, round(0.006 / step))
    near = slice(max(0, lowest - width), min(len(lags), lowest + width + 1))
    x, y = lags[near] / step, curve[near] / max(float(curve[lowest]), 1e-300)

    def misfits(places: Array) -> Array:
        away = x - places[:, None]
        q, r = np.linalg.qr(np.stack([np.ones_like(away), away**2, np.abs(away)], axis=-1))
        shares = np.swapaxes(q, 1, 2) @ y
        # `c` is the last share over the last of the diagonal: a kink that points upwards is left out.
        shares[shares[:, 2] * r[:, 2, 2] < 0.0, 2] = 0.0
        return np.asarray(np.sum((y - (q @ shares[:, :, None])[:, :, 0]) ** 2, axis=1))

    grid = np.linspace(lags[lowest] / step - 1.5, lags[lowest] / step + 1.5, 31)
    middle = grid[int(np.argmin(misfits(grid)))]
    found = minimize_scalar(
        lambda place: float(misfits(np.array([place]))[0]),
        bounds=(middle - 0.1, middle + 0.1),
        method="bounded",
        options={"xatol": 1e-5},
    )
    return float(found.x) * step


def advanced(values: ArrayLike, rows: float) -> tuple[Array, NDArray[np.bool_]]:
    """Return columns (S, ...) as they are `rows` later, between rows by cubic interpolation, and where that is known
    (S,).

    Examples
    --------
    >>> later, known = advanced(np.arange(6.0), 1.25)
    >>> later[known].tolist()
    [1.25, 2.25, 3.25]
    """
    array = np.asarray(values, dtype=np.float64)
    count, place = len(array), np.arange(len(array))
    offsets, weights = cubic_weights(rows)
    known = (place + offsets[0] >= 0) & (place + offsets[-1] < count)
    result = np.zeros_like(array)
    for offset, weight in zip(offsets, weights, strict=True):
        result += weight * array[np.clip(place + offset, 0, count - 1)]
    return result, known


def cubic_weights(rows: float) -> tuple[list[int], list[float]]:
    """Return which rows, counted from each, a cubic polynomial passes through that tells a value `rows` later, and
    their weights; one of them where that is a whole number.

    Examples
    --------
    >>> cubic_weights(-2.0)
    ([-2], [1.0])
    >>> cubic_weights(1.5)
    ([0, 1, 2, 3], [-0.0625, 0.5625, 0.5625, -0.0625])
    """
    whole = int(np.floor(rows + 1e-9))
    part = max(rows - whole, 0.0)
    if part < 1e-9:
        return [whole], [1.0]
    return [whole - 1, whole, whole + 1, whole + 2], [
        -part * (part - 1.0) * (part - 2.0) / 6.0,
        (part + 1.0) * (part - 1.0) * (part - 2.0) / 2.0,
        -(part + 1.0) * part * (part - 2.0) / 2.0,
        (part + 1.0) * part * (part - 1.0) / 6.0,
    ]
