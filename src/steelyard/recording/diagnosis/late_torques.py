"""Whether torques are late, by rows of a log that a model predicts: cheap enough to be asked of every log."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics.threads import one_thread

if TYPE_CHECKING:
    from steelyard.dynamics import Model

    from ..samples import Samples

__all__ = ["SURE", "LateTorques", "is_certain", "late_torques"]

Array = NDArray[np.float64]
ROWS = 4000
"""Rows at most by which it is told, evenly spread: a motion and a torque that are as smooth show no more."""
LONGEST, LAG = 0.04, 0.002
"""s up to which delays are looked for in either direction, and between those that are tried; between these lies a
straight line. The search for mistakes finds longer ones."""
SMOOTHED = 0.01
"""s over which torques are averaged, which takes what chatters faster than the rows that are looked at."""
AROUND = 0.05
"""s before and after a reversal of a joint whose rows are left out: there a filter of the positions rounds the jump of
friction, and a joint sticks."""
BATCHES, FEWEST_BATCHES, SHORTEST = 24, 10, 0.25
"""Stretches of time from which the standard deviation comes, how many of them a joint needs to tell something, and how
long each is at least, s: what lasts for less than one of them counts once."""
LEAST_SHARE = 1e-3
"""Part of the square of the change of the torques that the parameters must not explain."""
LEAST_ROWS = 3
"""Rows for each parameter of a joint, at least."""
SURE = 3.0
"""Standard deviations from zero, or of a joint from the others, at which a delay counts as certain."""
VAGUE = 0.0025
"""s of standard deviation from which on nothing is told, for what the model lacks decides then: a leg of three joints
whose friction grew with the load seemed to be late by 18.7 ± 3.4 ms."""
ODD = 0.02
"""s that one joint may differ from the others to be told: by 34 ms did a wrist whose rotor the model lacked."""
LATER, EARLIER = 0.002, 0.005
"""s that torques must surely be later, or earlier, to be told, by two standard deviations. A controller that answers
the noise of the encoders, which a filter leaves in the motion, makes torques seem earlier than they are: by up to 2.8
ms on simulated logs of eleven arms at 125 and 250 Hz, and by 2.9 to 5.2 ms at 1 kHz; a real Stäubli TX40 shows 2.1 ±
0.5 ms."""
UNEVEN = 0.2
"""Of the time between rows, by which it may differ from row to row."""
EXACT, ROUNDING = 1e-6, 1e-12
"""s below which no standard deviation counts, and parts of squares that are rounding."""


@dataclass(frozen=True, eq=False)
class LateTorques:
    """By how much torques are logged later than the motion, as `late_torques` tells it.

    Attributes
    ----------
    delay, standard_deviation : float
        s, of all joints together; negative where torques are logged earlier. Where the joints disagree by more than
        their own deviations, that of all is wider by as much.
    joint_delays, joint_deviations : ndarray
        (N,) s, of each joint by itself; NaN where it does not tell.
    told : ndarray
        (N,) s, what is certain and large enough to be told of each joint: the delay of all, or of one joint that
        differs from the others; zero otherwise.
    told_deviations : ndarray
        (N,) s, their standard deviations.
    changes : tuple of ndarray
        For each joint the mean over its rows of those of its base regressor times the change of the predicted torque,
        per s of delay: what a delay does to the sums of a regression, in the units of these.
    """

    delay: float
    standard_deviation: float
    joint_delays: Array
    joint_deviations: Array
    told: Array
    told_deviations: Array
    changes: tuple[Array, ...]

    def __repr__(self) -> str:
        return f"LateTorques({1e3 * self.delay:.3g} ± {1e3 * self.standard_deviation:.2g} ms behind the motion)"


def late_torques(model: Model, stretches: Sequence[tuple[Samples, Array]]) -> LateTorques | None:
    """Tell by how much torques are logged later than the motion.

    To first order a delay adds the change of the predicted torque with time to what a regression leaves. Of this
    change, that part is taken which the columns of the base regressor do not explain, however wrong the parameters are
    to which the delay led. Torques of rows that are later by the true delay are made of those columns and of noise
    alone, and their product with that part is zero, of whatever size the delay is: the delay is where it passes
    through zero.

    Rows near the reversals of a joint are left out (see `AROUND`).

    Parameters
    ----------
    model : Model
    stretches : sequence of (Samples, ndarray)
        Neighbouring rows at even times, and the torques (S, N) that a model predicts of them; NaN where these are not
        to be used.

    Returns
    -------
    LateTorques or None
        None where the rows are too few, or no joint tells.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> t = np.arange(8000)[:, None] / 1000
    >>> motion = lambda t: (np.sin(3 * t) + np.sin(7 * t), 3 * np.cos(3 * t) + 7 * np.cos(7 * t),
    ...                     -9 * np.sin(3 * t) - 49 * np.sin(7 * t))
    >>> late = model.inverse_dynamics(*motion(t - 0.0037), np.ones(10))
    >>> q, dq, ddq = motion(t)
    >>> samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=late, t=t[:, 0])
    >>> predicted = model.inverse_dynamics(q, dq, ddq, np.ones(10))
    >>> round(late_torques(model, [(samples, predicted)]).delay, 4)
    0.0037
    """
    gaps = [np.diff(samples.t) if samples.t is not None else np.zeros(0) for samples, _ in stretches]
    step = float(np.median(np.concatenate([*gaps, [np.nan]])[:-1])) if any(map(len, gaps)) else 0.0
    even = [one for one, steps in zip(stretches, gaps, strict=True) if len(steps) and np.ptp(steps) <= UNEVEN * step]
    if not even or not step > 0.0:
        return None
    with one_thread():
        rows = _Rows.of(model, even, step)
        return None if rows is None else _told(rows)


@dataclass(frozen=True, eq=False)
class _Rows:
    """The rows that are looked at, of all stretches.

    Attributes
    ----------
    regressors : list of (n, c)
        Base regressor of each joint, at all rows.
    used : (n, N)
        Which of them are used.
    rates : (n, N)
        Change of the predicted torque, per s; zero where it is not known.
    torques : (S, N)
        Measured, smoothed, of all the rows between them as well.
    places : (n,)
        Where the rows are in `torques`.
    batches : (n,)
        In which batch each row is.
    lags : (L,)
        Rows.
    step : float
        s between rows of `torques`.
    """

    regressors: list[Array]
    used: NDArray[np.bool_]
    rates: Array
    torques: Array
    places: NDArray[np.intp]
    batches: NDArray[np.intp]
    lags: NDArray[np.intp]
    step: float

    @classmethod
    def of(cls, model: Model, stretches: Sequence[tuple[Samples, Array]], step: float) -> _Rows | None:
        total = sum(samples.count for samples, _ in stretches)
        every = max(-(-total // ROWS), 1)
        between = max(round(LAG / step), 1)
        most = max(round(LONGEST / step / between), 2)
        lags = between * np.arange(-most, most + 1)
        half, around = max(round(0.5 * SMOOTHED / step), every // 2), max(round(AROUND / step), 1)
        end, size = int(lags[-1]) + half + 1, max(total // BATCHES, round(SHORTEST / step), 1)
        entries, used, rates, torques, at, batches = [], [], [], [], [], []
        first = begin = 0
        for samples, predicted in stretches:
            places = np.arange(end, samples.count - end, every)
            if len(places) < 2:
                continue
            entries.append(samples.entries_for(model, places))
            rate = (predicted[places + 1] - predicted[places - 1]) / (2.0 * step)
            turns = np.cumsum(np.diff(samples.dq > 0.0, axis=0, prepend=samples.dq[:1] > 0.0), axis=0)
            near = np.maximum(places - around, 0), np.minimum(places + around, samples.count - 1)
            used.append((turns[near[0]] == turns[near[1]]) & np.isfinite(rate))
            rates.append(np.nan_to_num(rate))
            sums = np.cumsum(np.pad(samples.torque, ((half + 1, half), (0, 0)), mode="edge"), axis=0)
            torques.append((sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1))
            at.append(begin + places)
            batches.append(first + places // size)
            begin, first = begin + samples.count, first + -(-samples.count // size)
        if not entries:
            return None
        return cls(
            model.base_columns.by_joint(np.concatenate(entries)),
            np.concatenate(used),
            np.concatenate(rates),
            np.concatenate(torques),
            np.concatenate(at),
            np.concatenate(batches),
            lags,
            step,
        )


def _told(rows: _Rows) -> LateTorques | None:
    joints = range(len(rows.regressors))
    count = int(rows.batches[-1]) + 1
    shown, changes = np.zeros_like(rows.rates), []
    left: list[Callable[[Array], Array]] = []
    for k in joints:
        used = rows.used[:, k]
        regressor, rate = rows.regressors[k][used], rows.rates[used, k]
        changes.append(regressor.T @ rate / max(len(rate), 1))
        left.append(_Rest(regressor))
        if len(rate) < LEAST_ROWS * regressor.shape[1] or len(np.unique(rows.batches[used])) < FEWEST_BATCHES:
            continue
        unexplained = left[k](left[k](rate))
        if unexplained @ unexplained > LEAST_SHARE * (rate @ rate):
            shown[used, k] = unexplained
    curves = np.array([np.einsum("nk,nk->k", shown, rows.torques[rows.places + lag]) for lag in rows.lags])
    lags = np.asarray(rows.step * rows.lags, dtype=np.float64)

    def scores(k: int, lag: float) -> Array:
        """Sums over batches of what the curve of a joint is at a lag, (B,); of noise alone where it is zero."""
        used = rows.used[:, k]
        whole = int(np.floor(lag / rows.step))
        part, places = lag / rows.step - whole, rows.places[used] + whole
        torque = (1.0 - part) * rows.torques[places, k] + part * rows.torques[places + 1, k]
        products = shown[used, k] * left[k](torque)
        return np.asarray(np.bincount(rows.batches[used], weights=products, minlength=count), dtype=np.float64)

    told = [k for k in joints if shown[:, k].any()]
    if not told:
        return None
    powers = np.einsum("nk,nk->k", shown, shown)
    own, variances = powers[told], np.array([_variance(scores(k, 0.0)) for k in told])
    common = _crossing(lags, curves[:, told] @ (own / np.maximum(variances, ROUNDING * own**2)), 0.0)
    if common is None:
        return None
    delays, deviations, parts = np.full(len(changes), np.nan), np.full(len(changes), np.nan), {}
    for k in told:
        found = _crossing(lags, curves[:, k], common[0])
        if found is not None:
            parts[k] = scores(k, found[0]) / found[1]
            delays[k], deviations[k] = found[0], max(np.sqrt(_variance(parts[k])), EXACT)
    return None if not parts else _decided(delays, deviations, parts, tuple(changes))


class _Rest:
    """Takes off what the columns of a regressor (n, c) explain, by their sums of products."""

    def __init__(self, regressor: Array) -> None:
        lengths = np.sqrt(np.einsum("sc,sc->c", regressor, regressor))
        lengths[lengths == 0.0] = 1.0
        values, vectors = np.linalg.eigh(regressor.T @ regressor / np.outer(lengths, lengths))
        kept = values > 1e-11 * values[-1]
        self.regressor, self.root = regressor, vectors[:, kept] / np.sqrt(values[kept]) / lengths[:, None]

    def __call__(self, values: Array) -> Array:
        """Return what is left of values (n,)."""
        return np.asarray(values - self.regressor @ (self.root @ (self.root.T @ (self.regressor.T @ values))))


def _decided(delays: Array, deviations: Array, parts: Mapping[int, Array], changes: tuple[Array, ...]) -> LateTorques:
    """Join what the joints tell, and decide what of it is certain and large enough to be told."""
    sure = list(parts)
    delay, deviation, apart = _joined(sure, delays, deviations, parts)
    told, of_told = np.zeros(len(delays)), np.zeros(len(delays))
    if apart > SURE and len(sure) > 2:
        # One joint that is late by itself: without it the others agree, and it is off them.
        without = {k: _joined([j for j in sure if j != k], delays, deviations, parts) for k in sure}
        odd = min(without, key=lambda k: without[k][2])
        others, of_others, still = without[odd]
        if still <= SURE and abs(delays[odd] - others) > SURE * np.hypot(deviations[odd], of_others):
            told[:], of_told[:] = others, of_others
            if abs(delays[odd] - others) <= ODD:
                told[odd], of_told[odd] = delays[odd], deviations[odd]
    if not of_told.any():
        told[:], of_told[:] = delay, deviation
    certain = is_certain(told, of_told)
    told, of_told = np.where(certain, told, 0.0), np.where(certain, of_told, 0.0)
    return LateTorques(delay, deviation, delays, deviations, told, of_told, changes)


def is_certain(delays: Array, deviations: Array) -> NDArray[np.bool_]:
    """Tell which delays are certain, and surely large enough to be told (see `LATER`)."""
    sizes, least = np.abs(delays), np.where(delays > 0.0, LATER, EARLIER)
    certain = (sizes >= SURE * deviations) & (sizes - 2.0 * deviations >= least)
    return np.asarray(certain & (deviations <= VAGUE))


def _joined(
    joints: Sequence[int], delays: Array, deviations: Array, parts: Mapping[int, Array]
) -> tuple[float, float, float]:
    """Return the delay of some joints together, its standard deviation, and by how many of theirs they are apart."""
    own, sizes = delays[list(joints)], deviations[list(joints)]
    share = sizes**-2.0 / np.sum(sizes**-2.0)
    delay = float(share @ own)
    errors = np.sum([part * parts[k] for part, k in zip(share, joints, strict=True)], axis=0)
    apart = float(np.sqrt(np.sum(((own - delay) / sizes) ** 2) / max(len(own) - 1, 1)))
    return delay, max(float(np.sqrt(_variance(errors))), EXACT) * max(1.0, apart), apart


def _variance(sums: Array) -> float:
    """Return the variance of the total of sums over batches, by how far these are apart."""
    held = sums[sums != 0.0]
    return float(len(held) / max(len(held) - 1, 1) * np.sum((held - held.mean()) ** 2)) if len(held) else 0.0


def _crossing(lags: Array, curve: Array, near: float) -> tuple[float, float] | None:
    """Return where a curve rises through zero, nearest to a lag, and its slope there; None where it does not."""
    places = np.flatnonzero((curve[:-1] < 0.0) & (curve[1:] >= 0.0))
    if not len(places):
        return None
    slopes = (curve[places + 1] - curve[places]) / (lags[places + 1] - lags[places])
    found = lags[places] - curve[places] / slopes
    best = int(np.argmin(np.abs(found - near)))
    return float(found[best]), float(slopes[best])
