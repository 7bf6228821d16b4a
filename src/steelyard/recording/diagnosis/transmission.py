"""Gear ratio and backlash of a transmission, from the positions on both sides of it and the torque of its motor.

It looks for steps and for a ratio where no robot is identified yet: what the transmission carries is guessed from the
motor's torque, rows at rest and within the gap are left out, and nothing is bounded. The stiffness, with the torque of
identified links and with bounds, is estimated in `steelyard.estimators.joint_stiffness`, whose rows are others.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan, pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..filters.zero_phase import low_pass

__all__ = ["Transmission", "diagnose_transmission", "position_ratio"]

Array = NDArray[np.float64]
CUTOFF = 25.0
"""Hz, of positions and torque: a gap is crossed within tens of ms, and inertia moves the link little above."""
ROWS = 6000
BLOCKS = 24
LONGEST_DELAY = 0.05  # s
STILL = 0.05
"""The share of the RMS velocity below which rows are left out: there a joint is near rest, where friction may be
anything."""
UNLOADED = 0.2
"""The share of the RMS torque below which rows are left out, since the link may be anywhere in the gap."""
SURE = 5.0
"""Standard errors from which a ratio or a backlash is told."""
LEAST_GAIN = 0.25
"""Part of the squared deflection left unexplained that a gap must take out: elasticity that is not quite linear, and
friction that is not quite Coulomb's, take out less."""
RATIO = 2e-3
"""By which a ratio must be off: an eccentric encoder is off by up to 1e-3, two ratios of gears by 2e-3 at 500:1."""
GROSS = 0.05
"""From which a ratio is another unit, another sign or another gear, and not a tooth more."""
ALIKE = 0.9
"""Correlation of the positions of both sides, below which they are not those of one joint."""
CROSSING = 0.05
"""s about a change of the torque's sign, in which the link crosses the gap and bounces."""
AS_GOOD = 1.3
"""Squared deflection left unexplained over the least, up to which a share of friction and inertia is as good."""
IMPACTS = 0.01
"""The share of the width that impacts and the filter make uncertain. On simulated joints blocks of time alone tell half
of the error."""
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
TELLING = 0.1
"""Part of a column that the other columns must leave for it to be told from them."""


@dataclass(frozen=True)
class Transmission:
    """The kinematics of a transmission, as positions on both of its sides show them.

    Attributes
    ----------
    correlation : float
        Of both positions; below 0.9 they are hardly those of one joint, and nothing else is told.
    ratio : float
        Motor position, as logged, over link position, without delay and elasticity; 1 where the stated ratio is right.
    ratio_error : float
        Its standard error.
    backlash : float
        Width of the gap on the link's side, rad or m; NaN where the log does not tell it, negative where the difference
        of the positions steps against the torque.
    backlash_error : float
        Its standard error.
    bound : float
        Where no backlash is told: what it is at most; infinite where the log does not tell.
    delay : float
        By which the second encoder lags, with what damping adds to it, s.
    compliance : float
        rad per N·m or m per N, of the elastic part.
    gain : float
        Part of the squared deflection left unexplained by elasticity, delay and friction that the gap takes out.
    has_backlash : bool
        Whether a backlash is told.
    """

    correlation: float
    ratio: float
    ratio_error: float
    backlash: float = nan
    backlash_error: float = inf
    bound: float = inf
    delay: float = 0.0
    compliance: float = 0.0
    gain: float = 0.0
    has_backlash: bool = False

    @property
    def ratio_is_wrong(self) -> bool:
        """Whether the ratio differs from 1 by more than its error and than errors of encoders."""
        return abs(self.ratio - 1.0) > max(SURE * self.ratio_error, RATIO)

    @property
    def cause(self) -> tuple[str, float]:
        """What a wrong ratio may come from, and the ratio that it would have then; no words where nothing common fits.

        Examples
        --------
        >>> Transmission(1.0, -1.0003, 1e-4).cause, Transmission(1.0, 1.01, 1e-5).cause
        (('a wrong sign', -1.0), ('such as 101:1 where 100:1 was divided by', 1.01))
        """
        if not self.ratio_is_wrong:
            return "", 1.0
        size, sign = abs(self.ratio), 1.0 if self.ratio > 0.0 else -1.0
        and_sign = "" if sign > 0.0 else " and a wrong sign"
        near = max(SURE * self.ratio_error, RATIO * size)
        if abs(size - 1.0) <= near:
            return "a wrong sign", sign
        for factor, words in ((180.0 / pi, "degrees on the motor's side"), (pi / 180.0, "degrees on the link's side")):
            if abs(size - factor) <= max(near, 0.01 * factor):
                return words + and_sign, sign * factor
        if abs(size - 1.0) < GROSS:
            teeth = round(1.0 / abs(size - 1.0))
            more = teeth + 1 if size > 1.0 else teeth - 1
            if abs(size - more / teeth) <= SURE * max(self.ratio_error, 1e-6):
                return f"such as {more}:1 where {teeth}:1 was divided by{and_sign}", sign * more / teeth
        whole = round(max(size, 1.0 / size))
        if whole >= 2 and abs(max(size, 1.0 / size) - whole) <= max(near / min(size, 1.0) ** 2, 0.005 * whole):
            if size > 1.0:
                return f"a gear of {whole}:1 that was not divided by{and_sign}", sign * whole
            return f"a gear of {whole}:1 that was divided by twice, or the wrong way round{and_sign}", sign / whole
        return "", self.ratio


def position_ratio(first: Array, second: Array) -> float:
    """Return how many times as far one position of a joint goes as the other; NaN where they do not go together.

    Examples
    --------
    >>> print(f"{position_ratio(np.arange(9.0), 7.0 - 2.0 * np.arange(9.0)):.3f}")
    -2.000
    """
    sizes = float(np.std(first)), float(np.std(second))
    if min(sizes) <= 0.0:
        return nan
    correlation = float(np.mean((first - first.mean()) * (second - second.mean()))) / (sizes[0] * sizes[1])
    return float(np.copysign(sizes[1] / sizes[0], correlation)) if abs(correlation) >= ALIKE else nan


def diagnose_transmission(motor: ArrayLike, link: ArrayLike, torque: ArrayLike, rate: float) -> Transmission:
    r"""Find the ratio and the backlash of one transmission.

    The difference of both positions is a regression, :math:`\theta - q = z + (r - 1) q + d \dot q + m \ddot q + c T
    + h \operatorname{sign} \dot q + \tfrac b2 \operatorname{sign} T`, beside one period of an eccentric encoder and a
    stiffness that changes with the torque: a delay goes with the velocity, elasticity with the torque T that the
    transmission carries and through zero without a step, and a gap b steps where T changes its sign. T is the torque of
    the motor less its own friction and inertia, whose shares of those of the joint are searched. Rows near standstill
    and near no torque are left out, as are those that cross the gap. Standard errors are by leaving out blocks of time.

    Parameters
    ----------
    motor, link : array_like
        (S,) positions of both sides on the joint's side, rad or m, without gaps.
    torque : array_like
        (S,) of the motor on the joint's side, N·m or N.
    rate : float
        Hz.

    Examples
    --------
    >>> t = np.arange(8000) / 200
    >>> q = np.sin(t) + 0.3 * np.sin(2.3 * t)
    >>> torque = 30 * np.cos(q + 1.5) + 4 * np.sign(np.gradient(q))
    >>> found = diagnose_transmission(q + torque / 1e5 + 5e-4 * np.sign(torque), q, torque, 200.0)
    >>> found.has_backlash, found.ratio_is_wrong
    (True, False)
    """
    theta, q, tau = (np.asarray(one, dtype=np.float64) for one in (motor, link, torque))
    edge = max(2, round(3.0 * rate / CUTOFF))
    if min(np.ptp(theta), np.ptp(q)) <= 0.0 or len(q) - 2 * edge < 10 * BLOCKS:
        return Transmission(nan, 1.0, inf)
    correlation = float(np.corrcoef(theta, q)[0, 1])
    if not abs(correlation) >= ALIKE:
        return Transmission(correlation, 1.0, inf)
    theta, q, tau = (_smoothed(one, rate) for one in (theta, q, tau))
    late = _delay(theta, q, rate)
    if abs(late) <= LONGEST_DELAY:  # what remains is small enough to go with the velocity
        q = _earlier(q, late * rate)
    else:
        late = 0.0
    dq = np.gradient(theta, 1.0 / rate)
    ddq = np.gradient(dq, 1.0 / rate)
    edge = min(edge + round(abs(late) * rate), (len(q) - 5 * BLOCKS) // 2)
    step = max(1, (len(q) - 2 * edge) // ROWS)
    theta, q, tau, dq, ddq = (one[edge:-edge:step] for one in (theta, q, tau, dq, ddq))
    centre = q - q.mean()
    moving = np.abs(dq) > STILL * np.sqrt(np.mean(dq**2))
    sign = np.sign(dq)
    blocks = np.arange(len(q)) * BLOCKS // len(q)

    plain = np.column_stack([centre, np.ones_like(q), dq, ddq, tau, sign])
    fit = _Fit.of(plain[moving], theta[moving], blocks[moving])
    ratio, error = float(fit.values[0]), float(fit.errors[0])
    if abs(ratio - 1.0) > GROSS:
        return Transmission(correlation, ratio, error, delay=late + float(fit.values[2] / ratio))

    # The motor's own friction and inertia are not carried by the transmission.
    causes = np.column_stack([sign, dq, ddq, np.ones_like(q), np.sin(q), np.cos(q)])
    of_drive = np.linalg.lstsq(causes[moving], tau[moving], rcond=None)[0]
    friction, inertia = causes[:, :2] @ of_drive[:2], causes[:, 2] * of_drive[2]
    deflection = theta - q
    candidates: list[tuple[float, float, float]] = []
    best: tuple[_Fit, Array, NDArray[np.bool_], Array] | None = None
    for share in SHARES:
        for part in SHARES if np.std(inertia) > STILL * np.std(tau) else (0.0,):
            carried = tau - share * friction - part * inertia
            size = float(np.sqrt(np.mean(carried**2)))
            if size <= 0.0:
                continue
            near = moving & (np.abs(carried) > UNLOADED * size)
            kept = near & ~_behind_changes(np.sign(carried), round(CROSSING * rate / step))
            others = np.column_stack(
                [plain[:, :4], np.sin(q), np.cos(q), sign, carried / size, (carried / size) ** 3, np.sign(carried)]
            )
            with_gap = _Fit.of(others[kept], deflection[kept], blocks[kept])
            left = np.abs(with_gap.residual)
            within = np.zeros_like(kept)
            within[np.flatnonzero(kept)[left <= 4.0 * 1.4826 * np.median(left)]] = True
            if np.count_nonzero(within) < 0.5 * np.count_nonzero(kept):
                continue
            with_gap = _Fit.of(others[within], deflection[within], blocks[within])
            candidates.append((with_gap.mean_square, float(with_gap.values[-1]), float(with_gap.errors[-1])))
            if best is None or with_gap.mean_square < best[0].mean_square:
                best = (with_gap, others, within, carried)
    if best is None or best[0].told_apart(-1) < TELLING:
        return Transmission(correlation, ratio, error, delay=late + float(fit.values[2] / ratio))
    with_gap, others, within, carried = best
    without = _Fit.of(others[within, :-1], deflection[within], blocks[within])
    width, width_error = 2.0 * float(with_gap.values[-1]), 2.0 * float(with_gap.errors[-1])
    # How friction and inertia are shared is told only as well as the deflection is explained.
    alike = [
        2.0 * half
        for square, half, its_error in candidates
        if square <= AS_GOOD * with_gap.mean_square and its_error <= width_error  # which is twice that of the best half
    ]
    width_error = float(np.linalg.norm([width_error, 0.5 * (np.ptp([width, *alike])), IMPACTS * width]))
    gain = 1.0 - with_gap.mean_square / without.mean_square if without.mean_square > 0.0 else 0.0
    found = width > SURE * width_error and gain > LEAST_GAIN
    if found:  # a gap goes with the position, as gravity does
        beside = np.column_stack([plain[within], carried[within], np.sign(carried[within])])
        fit = _Fit.of(beside, theta[within], blocks[within])
        ratio, error = float(fit.values[0]), float(fit.errors[0])
    return Transmission(
        correlation,
        ratio,
        error,
        backlash=width,
        backlash_error=width_error,
        # A step against the torque is no gap: the torque, or the side of an encoder, is wrong.
        bound=inf if found or width < -SURE * width_error else max(width, 0.0) + 2.0 * width_error,
        delay=late + float(with_gap.values[2]),
        compliance=float(fit.values[4]),
        gain=gain,
        has_backlash=found,
    )


@dataclass(frozen=True, eq=False)
class _Fit:
    """Least squares, with standard errors by leaving out blocks of time in turn."""

    values: Array
    errors: Array
    residual: Array
    columns: Array

    @classmethod
    def of(cls, columns: Array, wanted: Array, blocks: NDArray[np.intp]) -> _Fit:
        scale = np.sqrt(np.mean(columns**2, axis=0))
        scale[scale == 0.0] = 1.0
        scaled = columns / scale
        parts = [blocks == one for one in np.unique(blocks)]
        squares = np.array([scaled[part].T @ scaled[part] for part in parts])
        sides = np.array([scaled[part].T @ wanted[part] for part in parts])
        square, side = squares.sum(axis=0), sides.sum(axis=0)
        values = _solved(square, side)
        others = _solved(square - squares, side - sides)
        count = len(parts)
        errors = np.sqrt((count - 1) / count * np.sum((others - others.mean(axis=0)) ** 2, axis=0))
        return cls(values / scale, errors / scale, wanted - scaled @ values, scaled)

    @property
    def mean_square(self) -> float:
        return float(np.mean(self.residual**2))

    def told_apart(self, column: int) -> float:
        """The part of a column's size that the other columns do not make."""
        own = self.columns[:, column]
        others = np.delete(self.columns, column % self.columns.shape[1], axis=1)
        left = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
        return float(np.sqrt(np.mean(left**2) / np.mean(own**2)))


def _delay(theta: Array, q: Array, rate: float) -> float:
    """Return by how much q lags, s, by the velocity in the difference of both."""
    speed = np.gradient(theta, 1.0 / rate)
    columns = np.column_stack([q - q.mean(), np.ones_like(q), speed, np.gradient(speed, 1.0 / rate)])
    ratio, _, late, _ = np.linalg.lstsq(columns, theta, rcond=None)[0]
    return float(late / ratio) if ratio else 0.0


def _behind_changes(signs: Array, rows: int) -> NDArray[np.bool_]:
    """Return which rows are at most so many before or behind a change of sign: where the gap is crossed."""
    from scipy.ndimage import binary_dilation

    changes = np.zeros(len(signs), dtype=bool)
    changes[1:] = signs[1:] != signs[:-1]
    return np.asarray(binary_dilation(changes, iterations=max(rows, 1)))


def _earlier(values: Array, rows: float) -> Array:
    """The values that stand so many rows later, which need not be whole."""
    from scipy.interpolate import CubicSpline

    places = np.arange(len(values), dtype=np.float64)
    return np.asarray(CubicSpline(places, values)(np.clip(places + rows, 0.0, places[-1])))


def _solved(square: Array, side: Array) -> Array:
    return np.asarray((np.linalg.pinv(square, rcond=1e-12, hermitian=True) @ side[..., None])[..., 0])


def _smoothed(values: Array, rate: float) -> Array:
    return values if rate <= 2.5 * CUTOFF else low_pass(values[:, None], rate, CUTOFF, 2, "the log")[:, 0]
