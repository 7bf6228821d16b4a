"""Compliance of elastic joints where only the motors' positions are logged.

The links' motion is that of the motors less the deflections, and the deflections are the compliances times the
torques of the links: ``q = theta - c tau(q)``. The torques are not linear in c. They are linearised, all the base
parameters and all the compliances are regressed together, and that is repeated from the compliances found
(Gauss-Newton).

Columns of compliances hold four derivatives of a position, and their noise goes with that of the accelerations, which
is an error of the torque: together they draw compliances down, by many standard errors. So the rows are filtered,
regressor and torque alike, which leaves the equations true, below most of that noise, and lower until what is left of
it no longer matters.

What shows a compliance is the acceleration of the deflection. A motion of frequency f changes torques by the square of
f over the resonance of the joint: by 1 % at a tenth of it. Slow motions show nothing, and the answer is a bound.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.recording import Samples
from steelyard.recording.filters.zero_phase import low_pass, motion_frequency
from steelyard.regression import Information, ParameterCovariance
from steelyard.regression.batch_means import BatchSums
from steelyard.regression.factor import Factor, solve, triangular
from steelyard.regression.reduction import BLOCK, joint_rows

from .joint_stiffness import Motion, motion_behind

if TYPE_CHECKING:
    from steelyard.dynamics import Model

__all__ = ["Compliances", "estimate_compliances"]

Array = NDArray[np.float64]
Torques = Callable[[Array, Array, Array], Array]
_ROUNDS, _SETTLED = 8, 1e-3
_ORDER = 2
"""Of the filter of the rows, which is applied forwards and backwards."""
_ABOVE = 4.0
"""By which the first cutoff lies above the motion's frequency at least: torques turn with products of its harmonics."""
_SPANS = 20.0
"""Periods of the lowest cutoff that a log holds at least: fewer leave no residuals to tell an interval from."""
_FALL = 15.0
"""By how much less half the cutoff draws a compliance than what it changed: noise of the third derivative has a power
of the cutoff's seventh, 128, of which an eighth is relied on, since noise need not be white."""
_SMALL = 0.5
"""Of a standard error, which that may still be; it is added to the error then."""


@dataclass(frozen=True, eq=False)
class Compliances:
    """Compliances of some joints.

    Attributes
    ----------
    values, standard_error : ndarray
        (J,) rad/(N·m) or m/N; the errors hold the correlation of the residuals in time, and what the noise of the
        positions may still draw.
    """

    values: Array
    standard_error: Array


def deflected(samples: Samples, links: Torques, places: Sequence[int], compliances: Array) -> Motion:
    """Return the motion of the links (S, N) behind springs, from that of the motors.

    Parameters
    ----------
    samples : Samples
        The motion of the motors, with times.
    links : callable
        From a motion (S, N) to the torques of the links.
    places : sequence of int
        The J elastic joints.
    compliances : ndarray
        (J,).
    """
    assert samples.t is not None
    motor = samples.q, samples.dq, samples.ddq
    found = motor
    for _ in range(2):  # the second time with the accelerations of the links
        torque = links(*found)[:, list(places)]
        found = motion_behind(motor, samples.t, places, compliances * torque)
    return found


def estimate_compliances(
    model: Model, logs: Sequence[Samples], links: Torques, drives: Torques, places: Sequence[int]
) -> Compliances:
    """Estimate the compliances of joints from the motion and the torques of their motors.

    Parameters
    ----------
    logs : sequence of Samples
        Of the motors, with times.
    links, drives : callable
        From a motion (S, N) to the torques of the links, and to those of what the motors carry themselves.
    places : sequence of int
        The J elastic joints.
    """
    regression = _Regression(model, logs, links, drives, places)
    lowest = _SPANS / max(log.count * _period(log) for log in logs)
    cutoff = min(max(lowest, *(_below_noise(log) for log in logs)), *(0.125 / _period(log) for log in logs))
    values, _ = regression.settled(None)
    while True:
        before, (values, errors) = values, regression.settled(cutoff)
        drawn = np.where(np.isfinite(errors), np.abs(values - before) / _FALL, 0.0)
        if np.all(drawn <= _SMALL * errors) or cutoff < 2.0 * lowest:
            return Compliances(np.maximum(values, 0.0), np.hypot(errors, drawn))
        cutoff /= 2.0


def _below_noise(log: Samples) -> float:
    """A frequency in Hz below most of the noise of the positions' fourth derivative, but not below the motion's.

    Where noise is most of that derivative, half of its power lies near the end of the band that a filter left it.
    """
    rate = 1.0 / _period(log)
    middle = motion_frequency(np.diff(log.ddq, 2, axis=0), rate, share=0.5)
    return max(0.5 * middle, _ABOVE * motion_frequency(log.q, rate))


def _period(log: Samples) -> float:
    assert log.t is not None
    return float(np.median(np.diff(log.t)))


@dataclass(frozen=True, eq=False)
class _Regression:
    """What the base parameters and the compliances are regressed on; see `estimate_compliances`."""

    model: Model
    logs: Sequence[Samples]
    links: Torques
    drives: Torques
    places: Sequence[int]

    def settled(self, cutoff: float | None) -> tuple[Array, Array]:
        """Compliances, below zero where the last step leads there, and their standard errors, by rows with a cutoff."""
        now = np.zeros(len(self.places))
        for _ in range(_ROUNDS):
            step, errors = self._step(now, cutoff)
            found = now + step
            before, now = now, np.maximum(found, 0.0)
            if np.all(np.abs(now - before) <= _SETTLED * errors):
                break
        return found, errors

    def _step(self, now: Array, cutoff: float | None) -> tuple[Array, Array]:
        """One step of Gauss-Newton for the compliances, and their standard errors."""
        model, places = self.model, self.places
        base, columns = model.base_parameters(), model.base_columns
        width = base.count + len(places)
        own = [np.concatenate([c, np.arange(base.count, width)]) for c in columns.joints]
        empty = tuple(Factor(k, c, np.zeros((len(c) + 1, len(c) + 1)), 0) for k, c in enumerate(own))
        sums, gathered = BatchSums(empty), [list[Array]() for _ in own]
        scales: Array | None = None
        for log in self.logs:
            motor = log.q, log.dq, log.ddq
            motion = deflected(log, self.links, places, now)
            beside = self.drives(*motor) - self.drives(*motion)
            slopes = _slopes(log, self.links, places, motion)
            if scales is None:
                size = np.sqrt(np.mean(slopes**2, axis=(0, 1)))
                scales = np.where(size > 0.0, size, 1.0)
            samples = Samples(*motion, torque=log.torque - beside)
            mask = log.used_rows
            parts: list[list[Array]] = [[] for _ in own]
            for part, rows in joint_rows(model, samples, BLOCK):
                for k, (held, one) in enumerate(zip(parts, rows, strict=True)):
                    whole = np.column_stack([one[:, :-1], slopes[part, k] / scales, one[:, -1]])
                    held.append(whole * mask[part, k, None])
            # What the mask leaves out is zero on both sides before the filter, so that no row takes of it.
            joined = [_filtered(np.concatenate(held), log, cutoff) * mask[:, k, None] for k, held in enumerate(parts)]
            sums.add(joined)
            for k, (held, one) in enumerate(zip(gathered, joined, strict=True)):
                held.append(one[mask[:, k]])
            sums.end()
        assert scales is not None
        factors = tuple(
            Factor(k, c, triangular(np.concatenate(held)), sum(map(len, held)))
            for k, (c, held) in enumerate(zip(own, gathered, strict=True))
        )
        names = tuple(f"compliance {k + 1}" for k in places)
        information = Information(
            (*base.names, *names),
            (*base.expressions, *names),
            tuple(model.robot.joint_names),
            factors,
            batch_means=sums.factors(),
        )
        weights = information.joint_weights("joint")
        found = solve(information.reduced(weights))
        covariance = ParameterCovariance.of(information, found, weights)
        errors = np.where(covariance.unknown, np.inf, covariance.standard_error)[base.count :]
        return found[base.count :] / scales, errors / scales


def _filtered(rows: Array, log: Samples, cutoff: float | None) -> Array:
    """Rows behind a filter, the whole equations alike; as they are where a log is too short for it."""
    if cutoff is None or len(rows) <= 3 * (_ORDER + 1):
        return rows
    return low_pass(rows, 1.0 / _period(log), cutoff, _ORDER, "the log")


def _slopes(log: Samples, links: Torques, places: Sequence[int], motion: Motion) -> Array:
    """(S, N, J) how the torques of the links change with each compliance."""
    assert log.t is not None
    torque, carried = links(*motion), links(log.q, log.dq, log.ddq)
    found = np.zeros((*torque.shape, len(places)))
    for j, place in enumerate(places):
        # A deflection of a microradian more: far below what changes gravity, far above rounding. It is that of the
        # motors' motion: what a deflection changes of deflections holds six derivatives of a position, and their noise.
        step = 1e-6 / max(float(np.sqrt(np.mean(carried[:, place] ** 2))), 1e-12)
        further = motion_behind(motion, log.t, [place], step * carried[:, [place]])
        found[:, :, j] = (links(*further) - torque) / step
    return found
