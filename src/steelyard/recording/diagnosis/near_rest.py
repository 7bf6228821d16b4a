"""Rows near rest: how slow a joint may be before its velocity, or its friction, is not what a model takes it for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics.threads import one_thread

from ..cutoff.torques import FAST, Torques
from ..filters import FourierFit, MotionFilter
from .resolution import noise_deviation

if TYPE_CHECKING:
    from steelyard.dynamics import Model

    from ..recording import Recording
    from ..samples import Samples

__all__ = ["VelocityThresholds", "velocity_noise", "velocity_thresholds"]

Array = NDArray[np.float64]
SIGN_IS_SURE = 3.0
"""A velocity of so many standard deviations of its noise has the right sign in 999 of 1000 rows."""
LARGEST = 0.1
"""Of a joint's own root mean square velocity: no slower row is left out. Held-out errors of three real arms (TX40,
UR10, KR300) are least with thresholds of 0.02 to 0.2 of it, and nearly flat between; those of the Kinova Gen3, whose
runs last seconds, rise from 0.1 on."""
BINS = 6
RATIO = 1.6
"""Of the limits of neighbouring bins of velocities, of which the last ends at `LARGEST`."""
CHANCE = 1e-3
"""With which a joint without stiction shows less friction in its slowest bin."""
CLEAR = 0.05
"""Share of the friction that lacks at the lowest velocities, below which a lack of friction is let be."""
FEWEST_PASSES = 4
MOST_ROWS = 20_000


@dataclass(frozen=True, eq=False)
class VelocityThresholds:
    """What `velocity_thresholds` returns.

    Attributes
    ----------
    thresholds : ndarray
        (N,) rad/s or m/s; slower rows are better left out.
    noise : ndarray
        (N,) standard deviation of the noise of the velocities.
    sticking : ndarray
        (N,) whether the torques show less friction near rest than faster motion does.
    share : ndarray
        (N,) share of the rows of each joint that are slower than its threshold.
    """

    thresholds: Array
    noise: Array
    sticking: NDArray[np.bool_]
    share: Array

    def remark(self) -> str:
        """One sentence that says what is left out, and why."""
        values = ", ".join(f"{value:.3g}" for value in self.thresholds)
        reason = "below three standard deviations of its noise, the sign of a velocity is not certain"
        if self.sticking.any():
            joints = ", ".join(str(j + 1) for j in np.flatnonzero(self.sticking))
            plural = "s" if np.count_nonzero(self.sticking) > 1 else ""
            reason = f"there the torques of joint{plural} {joints} show less friction than faster motion does"
            if not self.sticking.all():
                reason += ", and of the others the sign of the velocity is not certain"
        return (
            f"Rows of a joint slower than {values} (rad/s or m/s, joint by joint) were left out, up to "
            f"{100.0 * self.share.max():.2g} % of its rows: {reason}; set "
            "`velocity_threshold` in [processing] to choose."
        )


def velocity_noise(recording: Recording, motion_filter: MotionFilter, measured: bool = False) -> Array:
    """Standard deviation (N,) of what white noise on the positions leaves on the filtered velocities.

    Parameters
    ----------
    recording : Recording
    motion_filter : MotionFilter
        With everything determined.
    measured : bool
        Whether the velocities are the measured ones, filtered, and not derived from the positions.
    """
    if isinstance(motion_filter, FourierFit):
        return np.zeros(recording.joint_count)
    rate = recording.rate
    # Bins of a logarithmic grid: filters act over decades below the rate.
    f = np.geomspace(1e-5 * rate, 0.5 * rate, 2000)
    response = motion_filter.response(f, rate)
    if measured and recording.velocity is not None:
        gain, deviation = response.position, noise_deviation(recording.velocity)
    else:
        gain, deviation = 2.0 * np.pi * f * response.velocity, noise_deviation(recording.q)
    return np.asarray(deviation * np.sqrt(2.0 / rate * np.trapezoid(gain**2, f)))


def velocity_thresholds(samples: Sequence[Samples], noise: Array, model: Model | None) -> VelocityThresholds:
    """Choose for each joint the velocity from which its rows are used.

    Two things make rows near rest useless. Where the velocity is within its noise, the sign of Coulomb friction is
    anyone's guess: the threshold is three standard deviations of the noise. And a joint that sticks, or whose friction
    turns its sign smoothly, has less friction near rest than Coulomb's law says. That shows in the torques: they are
    regressed on the motion by rows faster than 0.3 of a joint's usual velocity, and the residual against the direction
    of motion is averaged over each pass through a bin of low velocities. Where the passes through the slowest bin show
    a lack of friction that chance hardly explains (Student's t), the threshold is the upper limit of the last of the
    bins above that show it as well. No threshold exceeds a tenth of the joint's root mean square velocity, so that a
    joint that is always slow keeps its rows.

    Parameters
    ----------
    samples : sequence of Samples
        Slow rows included.
    noise : ndarray
        (N,) standard deviation of the noise of the velocities.
    model : Model or None
        Without it, the noise alone decides.

    Returns
    -------
    VelocityThresholds
    """
    count = sum(one.count for one in samples)
    usual = np.sqrt(sum((one.dq**2).sum(axis=0) for one in samples) / count)
    thresholds = np.minimum(SIGN_IS_SURE * noise, LARGEST * usual)
    sticking = np.zeros(len(usual), dtype=bool)
    if model is not None:
        with one_thread():
            limits = _lacks(samples, usual, model, max(1, -(-count // MOST_ROWS)))
        sticking = limits > 0.0
        thresholds = np.maximum(thresholds, limits)
    share = sum((np.abs(one.dq) < thresholds).sum(axis=0) for one in samples) / count
    return VelocityThresholds(thresholds, noise, sticking, share)


def _lacks(samples: Sequence[Samples], usual: Array, model: Model, every: int) -> Array:
    """Velocities (N,) up to which the torques show a lack of friction; 0 where they show none."""
    torques = Torques(model)
    rows = [np.arange(0, one.count, every) for one in samples]
    kept = [
        np.ones((len(r), len(usual)), bool) if s.mask is None else s.mask[r] for s, r in zip(samples, rows, strict=True)
    ]
    for one, own, mask in zip(samples, rows, kept, strict=True):
        torques.add(one, own, mask & (np.abs(one.dq[own]) >= FAST * usual))
    base, relative = torques.fitted()
    edges = LARGEST * RATIO ** np.arange(1.0 - BINS, 1.0)
    passes: list[list[list[Array]]] = [[[] for _ in range(BINS)] for _ in usual]
    for one, own, mask in zip(samples, rows, kept, strict=True):
        for k, columns in enumerate(torques.parts(one, own)):
            if not np.isfinite(relative[k]) or usual[k] == 0.0:
                continue
            slow = np.flatnonzero(mask[:, k] & (np.abs(one.dq[own, k]) < LARGEST * usual[k]))
            if not len(slow):
                continue
            velocity, torque = one.dq[own[slow], k], one.torque[own[slow], k]
            against = np.sign(velocity) * (torque - columns[slow] @ base[torques.columns.joints[k]])
            bins = np.searchsorted(edges * usual[k], np.abs(velocity), side="right")
            new = (np.diff(slow) > 1) | (np.diff(bins) != 0) | (np.diff(np.sign(velocity)) != 0.0)
            starts = np.concatenate([[0], np.flatnonzero(new) + 1])
            means = np.add.reduceat(against, starts) / np.diff(np.append(starts, len(slow)))
            for index in range(BINS):
                passes[k][index].append(means[bins[starts] == index])
    return (
        np.array([_last_lack([np.concatenate(p) if p else np.empty(0) for p in own], edges) for own in passes]) * usual
    )


def _last_lack(passes: list[Array], edges: Array) -> float:
    """The upper limit of the fastest bin whose passes show a lack of friction."""
    from scipy.stats import t as student

    known = [means for means in passes if len(means) >= FEWEST_PASSES]
    deepest = min((float(means.mean()) for means in known), default=0.0)
    limit = 0.0
    for means, edge in zip(passes, edges, strict=True):
        if len(means) < FEWEST_PASSES:
            continue
        mean, error = float(means.mean()), float(means.std(ddof=1)) / np.sqrt(len(means))
        if mean < -error * float(student.isf(CHANCE, len(means) - 1)) and mean < CLEAR * deepest:
            limit = float(edge)
    return limit
