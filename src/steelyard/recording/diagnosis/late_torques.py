"""Whether torques are late, by rows of a log that a model predicts: cheap enough to be asked of every log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics.threads import one_thread

if TYPE_CHECKING:
    from steelyard.dynamics import Model

    from ..samples import Samples

__all__ = ["EARLIER", "LATER", "SURE", "LateTorques", "is_certain", "late_torques"]

Array = NDArray[np.float64]
ROWS = 4000
"""Rows at most by which it is told, evenly spread: a motion and a torque that are as smooth show no more."""
LONGEST, LONGEST_ALONE, LAG = 0.04, 0.12, 0.002
"""s up to which delays are looked for in either direction, of all joints alike and of one joint by itself, and between
those that are tried; between these lies a straight line. The search for mistakes finds longer ones of all joints."""
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
"""s that one joint may differ from the others to be told by products alone: by 34 ms did a wrist whose rotor the model
lacked."""
EXPLAINED = 0.5
"""Part of the squares that the columns of a joint leave of its torques, that may be left of them where these are moved
by its delay, for the delay to be sure however long it is: both with the columns of the model and with those of drives
(`_drives`), so that nothing that a model lacks of a drive is taken for a delay. 0.30 to 0.50 of it is left where one
joint of eleven simulated arms or of a real UR10 is late by 60 ms and its torque is not mostly friction, and 0.67 at
least on sound logs of them and on real ones. Where noise makes most of the squares, they must fall surely, and at no
other lag: those of the first joint of a KR300 are a third less at 49.6 ± 0.9 ms, but less at -3 ms, too."""
FALLEN = 0.12
"""Part by which squares must fall where noise makes most of them, and they at a single lag: the best of all lags takes
up to 0.08 from wrists of sound logs, by 2 to 6 standard deviations, and the right one 0.17 from a WAM's shoulder."""
VAGUE_PART = 0.2
"""Part of such a delay that its standard deviation may be, in the place of `VAGUE`."""
KNEES = (0.1, 0.5)
"""Parts of the root mean square velocity within which friction is another one near rest."""
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
    explained : ndarray of bool
        (N,) whether it is told of a joint by itself, most of whose error is left without it (see `EXPLAINED`).
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
    explained: NDArray[np.bool_]
    changes: tuple[Array, ...]

    def __repr__(self) -> str:
        return f"LateTorques({1e3 * self.delay:.3g} ± {1e3 * self.standard_deviation:.2g} ms behind the motion)"


def late_torques(
    model: Model, stretches: Sequence[tuple[Samples, Array]], least: tuple[float, float] = (LATER, EARLIER)
) -> LateTorques | None:
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
    least : (float, float)
        s that torques must surely be later, and earlier, to be told.

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
        return None if rows is None else _told(rows, least)


@dataclass(frozen=True, eq=False)
class _Rows:
    """The rows that are looked at, of all stretches.

    Attributes
    ----------
    regressors : list of (n, c)
        Base regressor of each joint, at all rows.
    drives : (n, c, N)
        What the drive of each joint might add to it, see `_drives`.
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
    ahead : (n,)
        How many rows of `torques` are before and behind each in any case.
    step : float
        s between rows of `torques`.
    """

    regressors: list[Array]
    drives: Array
    used: NDArray[np.bool_]
    rates: Array
    torques: Array
    places: NDArray[np.intp]
    batches: NDArray[np.intp]
    ahead: NDArray[np.intp]
    step: float

    @classmethod
    def of(cls, model: Model, stretches: Sequence[tuple[Samples, Array]], step: float) -> _Rows | None:
        total = sum(samples.count for samples, _ in stretches)
        every = max(-(-total // ROWS), 1)
        half, around = max(round(0.5 * SMOOTHED / step), every // 2), max(round(AROUND / step), 1)
        end, size = int(_lags(LONGEST, step)[-1]) + half + 1, max(total // BATCHES, round(SHORTEST / step), 1)
        entries, drives, used, rates, torques, at, batches, ahead = [], [], [], [], [], [], [], []
        first = begin = 0
        for samples, predicted in stretches:
            places = np.arange(end, samples.count - end, every)
            if len(places) < 2:
                continue
            entries.append(samples.entries_for(model, places))
            drives.append(_drives(samples.dq[places], samples.ddq[places], predicted[places]))
            rate = (predicted[places + 1] - predicted[places - 1]) / (2.0 * step)
            turns = np.cumsum(np.diff(samples.dq > 0.0, axis=0, prepend=samples.dq[:1] > 0.0), axis=0)
            near = np.maximum(places - around, 0), np.minimum(places + around, samples.count - 1)
            used.append((turns[near[0]] == turns[near[1]]) & np.isfinite(rate))
            rates.append(np.nan_to_num(rate))
            sums = np.cumsum(np.pad(samples.torque, ((half + 1, half), (0, 0)), mode="edge"), axis=0)
            torques.append((sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1))
            at.append(begin + places)
            batches.append(first + places // size)
            ahead.append(np.minimum(places, samples.count - 1 - places) - half - 1)
            begin, first = begin + samples.count, first + -(-samples.count // size)
        if not entries:
            return None
        return cls(
            model.base_columns.by_joint(np.concatenate(entries)),
            np.concatenate(drives),
            np.concatenate(used),
            np.concatenate(rates),
            np.concatenate(torques),
            np.concatenate(at),
            np.concatenate(batches),
            np.concatenate(ahead),
            step,
        )


def _drives(dq: Array, ddq: Array, load: Array) -> Array:
    """Columns (n, c, N) of an offset, a rotor, and friction of several kinds, whether a model has them or not."""
    sign, speed = np.sign(dq), np.abs(dq) / np.maximum(np.sqrt(np.mean(dq**2, axis=0)), 1e-300)
    friction = [dq, sign, sign * dq**2, *(sign * np.exp(-speed / knee) for knee in KNEES), sign * np.abs(load)]
    return np.asarray(np.nan_to_num(np.stack([np.ones_like(dq), ddq, *friction], axis=1)))


def _lags(longest: float, step: float) -> NDArray[np.intp]:
    """Rows by which torques are moved where delays up to this one are looked for."""
    between = max(round(LAG / step), 1)
    most = max(round(longest / step / between), 2)
    return between * np.arange(-most, most + 1)


class _Found(NamedTuple):
    """A delay and its standard deviation, s, and by how much each batch takes part in its error, (B,)."""

    delay: float
    deviation: float
    parts: Array


class _Curves:
    """For each joint that tells something, what passes through zero where torques are moved by their delay.

    Parameters
    ----------
    rows : _Rows
    longest : float
        s. Only rows that have others this far before and behind them are used.
    """

    def __init__(self, rows: _Rows, longest: float) -> None:
        lags = _lags(longest, rows.step)
        self.rows, self.used = rows, rows.used & (rows.ahead >= lags[-1])[:, None]
        self.shown, self.changes, self.left = np.zeros_like(rows.rates), [], []
        for k in range(len(rows.regressors)):
            used = self.used[:, k]
            regressor, rate = rows.regressors[k][used], rows.rates[used, k]
            self.changes.append(regressor.T @ rate / max(len(rate), 1))
            self.left.append(_Rest(regressor))
            if len(rate) < LEAST_ROWS * regressor.shape[1] or len(np.unique(rows.batches[used])) < FEWEST_BATCHES:
                continue
            unexplained = self.left[k](self.left[k](rate))
            if unexplained @ unexplained > LEAST_SHARE * (rate @ rate):
                self.shown[used, k] = unexplained
        self.told = np.flatnonzero(self.shown.any(axis=0)).tolist()
        reach = np.where((rows.ahead >= lags[-1])[:, None], rows.places[:, None] + lags, 0)
        self.lags = np.asarray(rows.step * lags, dtype=np.float64)
        self.values = np.array([np.einsum("nk,nk->k", self.shown, rows.torques[places]) for places in reach.T])

    def torque(self, k: int, lag: float) -> Array:
        """Torques of a joint at a lag behind the rows that are used."""
        whole = int(np.floor(lag / self.rows.step))
        part, places = lag / self.rows.step - whole, self.rows.places[self.used[:, k]] + whole
        return np.asarray((1.0 - part) * self.rows.torques[places, k] + part * self.rows.torques[places + 1, k])

    def scores(self, k: int, lag: float) -> Array:
        """Sums over batches of what the curve of a joint is at a lag, (B,); of noise alone where it is zero."""
        used, count = self.used[:, k], int(self.rows.batches[-1]) + 1
        products = self.shown[used, k] * self.left[k](self.torque(k, lag))
        return np.asarray(np.bincount(self.rows.batches[used], weights=products, minlength=count), dtype=np.float64)

    def found(self, k: int, lag: float, slope: float) -> _Found:
        """What a joint tells by itself, of one of the lags at which its curve passes through zero."""
        part = self.scores(k, lag) / slope
        return _Found(lag, max(float(np.sqrt(_variance(part))), EXACT), part)

    def explained(self, k: int, common: float) -> _Found | None:
        """What a joint tells that is far off the others, where its error surely falls by it (see `EXPLAINED`)."""
        used, now = self.used[:, k], self.torque(k, 0.0)
        falls = [(self._fallen(k, self.left[k], now, lag), lag, slope) for lag, slope in self.crossings(k)]
        (fallen, sure), lag, slope = max(falls, key=lambda one: one[0][0], default=((0.0, 0.0), common, 0.0))
        if abs(lag - common) <= ODD:
            return None
        found, only = self.found(k, lag, slope), sum(one[0][0] > 0.0 for one in falls) == 1
        drive = _Rest(np.column_stack([self.rows.regressors[k][used], self.rows.drives[used, :, k]]))
        of_drive = self._fallen(k, drive, now, lag)
        mostly = min(fallen, of_drive[0]) > 1.0 - EXPLAINED and found.deviation <= VAGUE_PART * abs(lag)
        surely = only and min(fallen, of_drive[0]) > FALLEN and min(sure, of_drive[1]) > SURE
        surely = surely and found.deviation <= VAGUE
        return found if mostly or surely else None

    def crossings(self, k: int) -> list[tuple[float, float]]:
        """At which lags the curve of a joint rises through zero, and its slopes there."""
        return _crossings(self.lags, self.values[:, k])

    def _fallen(self, k: int, left: _Rest, now: Array, lag: float) -> tuple[float, float]:
        """By what part squares fall that are left of torques which are moved by a lag, and by how many deviations."""
        before = left(now) ** 2
        falls = before - left(self.torque(k, lag)) ** 2
        sums: Array = np.bincount(self.rows.batches[self.used[:, k]], weights=falls).astype(np.float64)
        return float(sums.sum() / before.sum()), float(sums.sum() / np.sqrt(max(_variance(sums), ROUNDING)))


def _told(rows: _Rows, least: tuple[float, float]) -> LateTorques | None:
    curves = _Curves(rows, LONGEST)
    told = curves.told
    if not told:
        return None
    own = np.einsum("nk,nk->k", curves.shown, curves.shown)[told]
    variances = np.array([_variance(curves.scores(k, 0.0)) for k in told])
    weights = own / np.maximum(variances, ROUNDING * own**2)
    common = min((lag for lag, _ in _crossings(curves.lags, curves.values[:, told] @ weights)), key=abs, default=None)
    if common is None:
        return None
    count = len(curves.changes)
    delays, deviations, parts = np.full(count, np.nan), np.full(count, np.nan), {}
    explained, farther = np.zeros(count, dtype=bool), _Curves(rows, LONGEST_ALONE)
    for k in told:
        found = farther.explained(k, common) if k in farther.told else None
        explained[k] = found is not None
        if found is None:
            near = min(curves.crossings(k), key=lambda one: abs(one[0] - common), default=None)
            if near is None:
                continue
            found = curves.found(k, *near)
        delays[k], deviations[k], parts[k] = found
    return None if not parts else _decided(delays, deviations, parts, explained, tuple(curves.changes), least)


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


def _decided(
    delays: Array,
    deviations: Array,
    parts: Mapping[int, Array],
    explained: NDArray[np.bool_],
    changes: tuple[Array, ...],
    least: tuple[float, float],
) -> LateTorques:
    """Join what the joints tell, and decide what of it is certain and large enough to be told."""

    def joined(joints: Sequence[int]) -> tuple[float, float, float]:
        return _joined(joints, delays, deviations, parts)

    def off(k: int, others: tuple[float, float, float]) -> float:
        return float(abs(delays[k] - others[0]) / np.hypot(deviations[k], others[1]))

    rest = [k for k in parts if not explained[k]]
    among = joined(rest) if rest else None
    alone = [k for k in parts if explained[k] and among is not None and off(k, among) > SURE]
    rest = [k for k in parts if k not in alone]
    delay, deviation, apart = joined(rest)
    told, of_told = np.full(len(delays), delay), np.full(len(delays), deviation)
    if apart > SURE and len(rest) > 2:
        # One joint that is late by itself: without it the others agree, and it is off them.
        without = {k: joined([j for j in rest if j != k]) for k in rest}
        odd = min(without, key=lambda k: without[k][2])
        if without[odd][2] <= SURE and off(odd, without[odd]) > SURE:
            told[:], of_told[:] = without[odd][:2]
            if abs(delays[odd] - without[odd][0]) <= ODD:
                told[odd], of_told[odd] = delays[odd], deviations[odd]
    certain = is_certain(told, of_told, least)
    told[alone], of_told[alone] = delays[alone], deviations[alone]
    certain[alone] = True
    told, of_told = np.where(certain, told, 0.0), np.where(certain, of_told, 0.0)
    own = certain & np.isin(np.arange(len(delays)), alone)
    return LateTorques(delay, deviation, delays, deviations, told, of_told, own, changes)


def is_certain(delays: Array, deviations: Array, least: tuple[float, float] = (LATER, EARLIER)) -> NDArray[np.bool_]:
    """Tell which delays are certain, and surely at least so much later, or earlier, as to be told (see `LATER`)."""
    sizes, enough = np.abs(delays), np.where(delays > 0.0, *least)
    certain = (sizes >= SURE * deviations) & (sizes - 2.0 * deviations >= enough)
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


def _crossings(lags: Array, curve: Array) -> list[tuple[float, float]]:
    """Return at which lags a curve rises through zero, and its slopes there."""
    places = np.flatnonzero((curve[:-1] < 0.0) & (curve[1:] >= 0.0))
    slopes = (curve[places + 1] - curve[places]) / (lags[places + 1] - lags[places])
    return list(zip((lags[places] - curve[places] / slopes).tolist(), slopes.tolist(), strict=True))
