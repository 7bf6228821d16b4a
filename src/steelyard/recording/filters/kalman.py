"""Kalman filter forwards, Rauch-Tung-Striebel smoother backwards: any times, missing samples, and deviations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, factorial, log, pi, sin
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

from .motion_filter import Array, Motion, MotionFilter, Response, above
from .zero_phase import SETTLED

__all__ = ["KalmanSmoother", "SmoothedMotion"]

MODELS = {"acceleration": 3, "jerk": 4}
PRIOR = 1e8
"""Variance of the state before the first row, in units of the noise; so large that it tells nothing."""
STEADY = 1e-13
"""Relative change of the covariance from one row to the next below which the gains stay constant."""


@dataclass(frozen=True, eq=False)
class SmoothedMotion:
    """The motion that `KalmanSmoother.smooth` returns.

    Attributes
    ----------
    q, dq, ddq : ndarray
        (S, N), also where positions were missing.
    q_deviation, dq_deviation, ddq_deviation : ndarray
        (S, N) standard deviations of them.
    noise : ndarray
        (N,) standard deviation of the noise of the positions: as given, or as the data shows it.
    """

    q: Array
    dq: Array
    ddq: Array
    q_deviation: Array
    dq_deviation: Array
    ddq_deviation: Array
    noise: Array


@dataclass(frozen=True)
class KalmanSmoother(MotionFilter):
    """Motion whose jerk (or snap) is white noise, measured with white noise; its mean given the whole log.

    Each joint has the state (q, dq, ddq), driven by white jerk, or with the jerk in the state by white snap. In the
    middle of an evenly sampled log the response is ``1 / (1 + (f / cutoff)^(2 n))``, that of the Butterworth filter
    of order n = 3 (4) forwards and backwards, but for all three signals: derivatives are states and suffer from no
    differences. Rows may stand at any times, and positions may be missing (NaN).

    Parameters
    ----------
    cutoff
        Hz, where the amplitude is halved; None takes that of [processing]. It sets the density of the driving noise
        relative to the noise of the positions.
    model
        "acceleration" (constant but for white jerk, n = 3) or "jerk" (constant but for white snap, n = 4).
    noise
        Standard deviation of the noise of the positions, rad or m, one or one for each joint; None takes it from what
        the smoother leaves over.
    density
        Spectral density of the driving noise, (rad/s³)²/Hz for white jerk, one or one for each joint; takes the place
        of the cutoff, and needs `noise`.

    References
    ----------
    H. E. Rauch, F. Tung and C. T. Striebel, AIAA Journal 3, 1965.

    Examples
    --------
    >>> t = np.arange(2000) / 1000.0
    >>> q = np.sin(2.0 * np.pi * t)[:, None]
    >>> q[500:600] = np.nan
    >>> motion = KalmanSmoother(cutoff=10.0).smooth(t, q)
    >>> bool(np.abs(motion.q[500:600, 0] - np.sin(2.0 * np.pi * t[500:600])).max() < 0.01)
    True
    """

    kind: ClassVar[str] = "kalman"
    takes_uneven_times: ClassVar[bool] = True

    cutoff: float | None = None
    model: str = "acceleration"
    noise: float | tuple[float, ...] | None = None
    density: float | tuple[float, ...] | None = None

    def _clean(self, where: str) -> None:
        def each(name: str, what: str) -> None:
            value: Any = getattr(self, name)
            if value is None:
                return
            if isinstance(value, np.ndarray):
                value = value.tolist()
            label = f"{where}, key {name!r},"
            several = isinstance(value, (list, tuple))
            cleaned = tuple(above(0.0, v, label, what) for v in value) if several else above(0.0, value, label, what)
            object.__setattr__(self, name, cleaned)

        if self.cutoff is not None:
            object.__setattr__(self, "cutoff", above(0.0, self.cutoff, f"{where}, key 'cutoff',", "a frequency in Hz"))
        if self.model not in MODELS:
            raise InputError(f"{where}, key 'model', is {self.model!r}; it must be {' or '.join(map(repr, MODELS))}.")
        each("noise", "a positive standard deviation")
        each("density", "a positive spectral density")
        if self.density is not None and self.noise is None:
            raise InputError(f"{where}: `density` needs `noise`, the standard deviation of the positions, beside it.")

    @property
    def states(self) -> int:
        """Number n of states of a joint."""
        return MODELS[self.model]

    def settled(self, cutoff: float | None, order: int, where: str) -> Self:
        """See `MotionFilter.settled`."""
        if self.density is not None:
            return self
        chosen = cutoff if self.cutoff is None else self.cutoff
        if chosen is None:
            raise InputError(f'{where}: the filter "kalman" needs a `cutoff` in Hz, or `density` and `noise`.')
        return replace(self, cutoff=chosen)

    def bandwidth(self, rate: float, joints: int) -> Array:
        """(N,) cutoff in rad/s of each joint: there the density of the driven motion equals that of the noise."""
        if self.density is None:
            assert self.cutoff is not None
            return np.full(joints, 2.0 * pi * self.cutoff)
        density = _for_each(self.density, joints, "density")
        noise = _for_each(self.noise, joints, "noise")
        return np.asarray((density / (noise**2 / rate)) ** (1.0 / (2 * self.states)))

    def motion(self, t: Array, q: Array, rate: float, source: str) -> Motion:
        """See `MotionFilter.motion`."""
        smoothed = self.smooth(t, q, rate=rate, source=source, deviations=False)
        return Motion(smoothed.q, smoothed.dq, smoothed.ddq)

    def smooth(
        self,
        t: ArrayLike,
        q: ArrayLike,
        *,
        rate: float | None = None,
        source: str = "recording",
        deviations: bool = True,
    ) -> SmoothedMotion:
        """Smooth positions (S, N) at times (S,); NaN where they are missing.

        Parameters
        ----------
        t : array_like
            (S,) s, increasing.
        q : array_like
            (S, N) rad or m.
        rate : float, optional
            Mean rate in Hz that relates `cutoff` to the noise; by default one over the median interval.
        source : str
            For messages.
        deviations : bool
            Whether to compute standard deviations and the noise, too; they are zero otherwise.

        Raises
        ------
        InputError
            Where shapes do not fit, times do not increase, a joint has too few positions, or the cutoff is at or above
            half the rate.
        """
        times, values = np.asarray(t, dtype=np.float64), np.asarray(q, dtype=np.float64)
        if times.ndim != 1 or values.ndim != 2 or len(times) != len(values) or len(times) < 2:
            raise InputError(
                f"{source} has times {times.shape} and positions {values.shape}; expected (S,) and (S, N)."
            )
        steps = np.diff(times)
        if not np.all(steps > 0.0):
            raise InputError(f"{source}: the times must increase from row to row.")
        mean_rate = float(1.0 / np.median(steps)) if rate is None else rate
        joints = values.shape[1]
        band = self.bandwidth(mean_rate, joints)
        if np.any(band >= pi * mean_rate):
            raise InputError(
                f"{source} is sampled at {mean_rate:.6g} Hz, so a cutoff of {band.max() / (2.0 * pi):.6g} Hz is not "
                "below half of it; lower the cutoff."
            )
        seen = np.isfinite(values)
        if np.any(seen.sum(axis=0) <= self.states):
            j = int(np.argmin(seen.sum(axis=0)))
            raise InputError(f"{source}: joint {j + 1} has {seen[:, j].sum()} positions; more are needed to smooth it.")
        outputs, scales = [np.zeros((len(times), joints)) for _ in range(6)], np.zeros(joints)
        keys = [(seen[:, j].tobytes(), float(band[j])) for j in range(joints)]
        for key in dict.fromkeys(keys):
            group = [j for j in range(joints) if keys[j] == key]
            w = key[1]
            run = _Smoother(steps, seen[:, group[0]], w, mean_rate, self.states)
            states = run.states(times, values[:, group])
            spread = run.deviations() if deviations else np.zeros((len(times), 3))
            if deviations:
                own = seen[:, group[0]]
                rest = values[own][:, group] - states[own, 0]
                scales[group] = np.sqrt(np.sum(rest**2, axis=0) / np.sum(1.0 - spread[own, 0] ** 2))
            noise = scales[group] if self.noise is None else _for_each(self.noise, joints, "noise")[group]
            for order in range(3):
                outputs[order][:, group] = states[:, order] * w**order
                outputs[3 + order][:, group] = spread[:, order, None] * w**order * noise
        level = scales if self.noise is None else _for_each(self.noise, joints, "noise")
        q, dq, ddq, *spreads = outputs
        return SmoothedMotion(q, dq, ddq, spreads[0], spreads[1], spreads[2], level)

    def response(self, frequencies: ArrayLike, rate: float) -> Response:
        """See `MotionFilter.response`; that of the motion in continuous time, off by less than (f / rate)²."""
        f = np.asarray(frequencies, dtype=np.float64)
        band = self.bandwidth(rate, 1)[0]
        gain = 1.0 / (1.0 + (2.0 * pi * f / band) ** (2 * self.states))
        return Response(gain, gain, gain)

    def padding(self, rate: float) -> int:
        """See `MotionFilter.padding`: the slowest pole of the response decides."""
        slowest = float(self.bandwidth(rate, 1).min()) * sin(pi / (2 * self.states))
        return ceil(-log(1e-13) / slowest * rate) + 4

    def settling(self, rate: float) -> float:
        """See `MotionFilter.settling`: the smoother knows one side only, and its deviations are larger there."""
        return -log(SETTLED) / float(self.bandwidth(rate, 1).min() * sin(pi / (2 * self.states)))


class _Smoother:
    """Gains for one pattern of missing rows, in states (q, dq / w, ddq / w², ...) and units of the noise."""

    def __init__(self, steps: Array, seen: NDArray[np.bool_], w: float, rate: float, n: int) -> None:
        count = len(seen)
        self.seen, self.n, self.w = seen, n, w
        self.transition, self.filtered, self.predicted, self.back = (np.zeros((count, n, n)) for _ in range(4))
        self.gain = np.zeros((count, n))
        rows, columns = np.indices((n, n))
        flow = np.where(
            columns >= rows, 1.0 / np.array([[factorial(max(j - i, 0)) for j in range(n)] for i in range(n)]), 0.0
        )
        lag, power = np.maximum(columns - rows, 0), 2 * n - 1 - rows - columns
        # Covariance of n-fold integrated white noise of density w / rate after the scaled time tau.
        below = np.array([factorial(n - 1 - i) for i in range(n)], dtype=np.float64)
        driven = w / rate / (np.outer(below, below) * power)
        self._update(0, PRIOR * np.eye(n))
        self.transition[0] = np.eye(n)
        usual = np.concatenate([[False, False], (np.abs(np.diff(steps)) <= 1e-9 * steps[1:]) & seen[2:] & seen[1:-1]])
        breaks = np.append(np.flatnonzero(~usual), count)
        k, known = 1, -1.0
        while k < count:
            if steps[k - 1] != known:
                known = steps[k - 1]
                tau = w * known
                F, noise = flow * tau**lag, driven * tau**power
            self.transition[k] = F
            predicted = F @ self.filtered[k - 1] @ F.T + noise
            before = self.predicted[k - 1]
            if usual[k] and np.abs(predicted - before).max() <= STEADY * np.abs(predicted).max():
                end = int(breaks[np.searchsorted(breaks, k)])
                for array in (self.transition, self.filtered, self.predicted, self.gain):
                    array[k:end] = array[k - 1]
                self.back[k - 1 : end - 1] = self.back[k - 2]
                k = end
                continue
            self.back[k - 1] = np.linalg.solve(predicted, F @ self.filtered[k - 1]).T
            self._update(k, predicted)
            k += 1

    def _update(self, k: int, predicted: Array) -> None:
        self.predicted[k] = predicted
        if not self.seen[k]:
            self.filtered[k] = predicted
            return
        gain = predicted[:, 0] / (predicted[0, 0] + 1.0)
        rest = np.eye(self.n)
        rest[:, 0] -= gain
        self.gain[k], self.filtered[k] = gain, rest @ predicted @ rest.T + np.outer(gain, gain)

    def states(self, t: Array, y: Array) -> Array:
        """Smoothed states (S, n, J) for measurements (S, J)."""
        count, joints = y.shape
        forward, ahead = np.zeros((2, count, self.n, joints))
        y = np.where(self.seen[:, None], y, 0.0)
        x = self._begin(t, y)
        for k in range(count):
            if k:
                x = self.transition[k] @ x
            ahead[k] = x
            if self.seen[k]:
                x = x + self.gain[k][:, None] * (y[k] - x[0])
            forward[k] = x
        for k in range(count - 2, -1, -1):
            x = forward[k] + self.back[k] @ (x - ahead[k + 1])
            forward[k] = x
        return forward

    def deviations(self) -> Array:
        """(S, 3) of position, velocity and acceleration."""
        count = len(self.seen)
        variances = np.zeros((count, 3))
        P = self.filtered[-1]
        variances[-1] = np.diagonal(P)[:3]
        for k in range(count - 2, -1, -1):
            back = self.back[k]
            P = self.filtered[k] + back @ (P - self.predicted[k + 1]) @ back.T
            variances[k] = P[0, 0], P[1, 1], P[2, 2]
        return np.asarray(np.sqrt(np.maximum(variances, 0.0)))

    def _begin(self, t: Array, y: Array) -> Array:
        """Mean of the state before the first row, (n, J): from a parabola through the first rows."""
        rows = np.flatnonzero(self.seen)
        rows = rows[: max(self.n + 1, int(np.searchsorted(t[rows], t[rows[0]] + 2.0 / self.w)))]
        powers = np.vander(self.w * (t[rows] - t[0]), 3, increasing=True)
        x = np.zeros((self.n, y.shape[1]))
        x[:3] = np.linalg.lstsq(powers, y[rows], rcond=None)[0] * np.array([1.0, 1.0, 2.0])[:, None]
        return x


def _for_each(value: Any, joints: int, name: str) -> Array:
    if isinstance(value, tuple) and len(value) != joints:
        raise InputError(f'the filter "kalman" has {len(value)} values in `{name}` for {joints} joints; give one each.')
    return np.full(joints, value, dtype=np.float64) if not isinstance(value, tuple) else np.array(value)
