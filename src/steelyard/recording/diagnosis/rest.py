"""Joints at rest: those that do not move throughout a log, and rows too slow to show a velocity or a friction."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from steelyard.display import capital, joint_label
from steelyard.dynamics.threads import one_thread

from ..cutoff.by_torques import FAST, TorqueFit
from ..filters import MotionFilter
from ..measurements import Measurements
from ..samples import Samples
from .detectors import noise_deviation, resolution

if TYPE_CHECKING:
    from steelyard.dynamics import Model

__all__ = ["HeldJoints", "VelocityThresholds", "velocity_noise", "velocity_thresholds"]

Array = NDArray[np.float64]
BLOCK_TIME, BLOCK_ROWS = 0.05, 16
"""Positions are averaged over at least so many s and rows: the means of 16 rows of white noise stay within 2.5 of its
standard deviations, in a log of any length."""
STEPS, DEVIATIONS = 1.5, 4.0
"""A joint is held where those means differ by no more than so many steps of the encoder or deviations of its noise."""
FEW_LEVELS = 3
"""An encoder that shows so few values throughout moves by single counts, too few to tell their size by."""
MOST_TRAVEL = 5e-3
"""rad or m: single positions of a held joint differ by no more, whatever their noise is said to be. Coarsely sampled
motion looks like noise, and goes farther."""
SMALLEST, SLOWEST = 1e-5, 1e-5
"""rad (m), and rad/s (m/s) on the average: a joint that goes no farther is held, however fine its encoder. On a
simulated arm of six joints without encoder noise, a first joint that creeps at 1e-6 rad/s let parameters be told by the
noise of the torques alone, and the error on another log rose from 1.3 to 139 %; at 1e-4 rad/s it stayed."""
CREEP = 5e-3
"""rad/s or m/s on the average of block means: a joint that goes no farther than `MOST_TRAVEL`, and no faster, gives
way within its drive. Six-axis arms in MuJoCo, whose position loops give way by 3 mrad under the load of an elbow that
stands still (0.7 mrad/s), told 150 times its viscous friction and 300 times its rotor inertia, with narrow
intervals."""
SIGN_IS_SURE = 3.0
"""A velocity of so many standard deviations of its noise has the right sign in 999 of 1000 rows."""
LARGEST = 0.1
"""The largest threshold, as a share of a joint's own root mean square velocity. Held-out errors of three real arms
(TX40, UR10, KR300) are least with thresholds of 0.02 to 0.2 of it, and nearly flat between; those of the Kinova Gen3,
whose runs last seconds, rise from 0.1 on."""
AT_REST, RESTS = 0.02, 0.05
"""Share of a joint's own root mean square velocity below which it is at rest, and share of its rows from which it comes
to rest and does not only turn: at rest, what a filter leaves of a motion that has ended has signs, too. Joints that
turn and do not stop have 2 % of such rows, and joints that wait between moves 30 to 90 %."""
CREEPING, JUMPS = 1e-9, 1e-4
"""rad/s or m/s at which a law that is smooth is zero, and the column of a parameter that is not: that of Coulomb
friction jumps from -1 to 1, that of a tendon by its arm in m."""
BINS = 6
"""Bins of low velocities, whose limits grow by `RATIO`."""
RATIO = 1.6
"""The ratio of the limits of neighbouring bins of velocities, of which the last ends at `LARGEST`."""
CHANCE = 1e-3
"""Probability with which a joint without stiction is found to have less friction in its slowest bin."""
CLEAR = 0.05
"""Share of the friction that is missing at the lowest velocities, below which the lack is ignored."""
FEWEST_PASSES = 4
"""Passes through a bin without which its mean residual says nothing."""
MOST_ROWS = 20_000
"""Rows of all logs together, at most, by which friction near rest is judged."""


@dataclass(frozen=True, eq=False)
class HeldJoints:
    """Joints that do not move: their positions differ from a constant by no more than noise, or give way under load.

    Differences of such positions are noise, and so are their signs: as velocities and accelerations they would pass for
    a motion, which shows friction and inertia. Where a joint gives way by some thousandths of a radian, its friction
    sticks, and its position follows the load.

    Attributes
    ----------
    mask : ndarray of bool
        (N,).
    position : ndarray
        (N,) rad or m, where they are held.
    tolerance : ndarray
        (N,) rad or m: the means of positions over some hundredths of a second differ by no more, as noise makes it, or
        change no faster than `CREEP`. Zero for joints that go too far to be held whatever it is.
    travel : ndarray
        (N,) rad or m by which these means differ, where that is more than the tolerance; zero elsewhere.

    Examples
    --------
    >>> from steelyard.recording import Recording
    >>> t = np.arange(4000) / 1000
    >>> noise = 1e-5 * np.random.default_rng(1).normal(size=t.size)
    >>> q = np.column_stack([np.sin(t), 0.7 + noise])
    >>> held = HeldJoints.of(Recording(t=t, q=q, torque=np.column_stack([t, t])))
    >>> held.mask.tolist(), held.position.round(3).tolist()[1]
    ([False, True], 0.7)
    """

    mask: NDArray[np.bool_]
    position: Array
    tolerance: Array
    travel: Array

    @classmethod
    def of(cls, recording: Measurements) -> Self:
        """Find the joints that do not move in a recording, or in the first rows of a log."""
        travel = recording.facts["q"].ranges
        likely = travel <= MOST_TRAVEL
        held = cls(likely, recording.q[0].copy(), *np.zeros((2, len(travel))))
        if not likely.any():
            return held
        q = recording.q[:, likely]
        tolerance = np.maximum(STEPS * resolution(q), DEVIATIONS * noise_deviation(q))
        tolerance = np.maximum(tolerance, max(SMALLEST, SLOWEST * recording.duration))
        few = np.array([len(np.unique(column[:1000])) <= FEW_LEVELS >= len(np.unique(column)) for column in q.T])
        tolerance[few] = np.maximum(tolerance[few], 1.001 * travel[likely][few])  # means round
        held.position[likely], held.tolerance[likely] = np.median(q, axis=0), tolerance
        return held.among([recording])

    def among(self, recordings: Iterable[Measurements]) -> Self:
        """Return only those of these joints that do not move in other rows of the same log either."""
        least = most = lowest = highest = self.position
        path, duration = np.zeros(len(self.position)), 0.0
        for recording in recordings:
            q = recording.q
            size = max(BLOCK_ROWS, round(BLOCK_TIME * recording.rate))
            blocks = len(q) // size
            means = q[: blocks * size].reshape(blocks, size, -1).mean(axis=1) if blocks else q
            least, most = np.minimum(least, means.min(axis=0)), np.maximum(most, means.max(axis=0))
            lowest, highest = np.minimum(lowest, q.min(axis=0)), np.maximum(highest, q.max(axis=0))
            path += np.abs(np.diff(means, axis=0)).sum(axis=0)
            duration += len(q) / recording.rate
        by_noise = most - least <= self.tolerance
        # Means hide a vibration, which is a motion.
        gives_way = (path <= CREEP * duration) & (most - least >= 0.5 * (highest - lowest))
        still = (by_noise | gives_way) & (highest - lowest <= MOST_TRAVEL)
        travel = np.where(by_noise, 0.0, most - least)
        return type(self)(self.mask & still, self.position, self.tolerance, travel)

    def without_motion(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array, Array]:
        """Return the motion (S, N) with these joints at rest."""
        if not self.mask.any():
            return q, dq, ddq
        return tuple(  # type: ignore[return-value]
            np.where(self.mask, rest, values) for rest, values in ((self.position, q), (0.0, dq), (0.0, ddq))
        )

    def remarks(self, recording: Measurements) -> tuple[str, ...]:
        """Return one sentence for each joint that does not move."""
        return tuple(f"{reason}; record a motion of it to know more." for reason in self.reasons(recording))

    def reasons(self, recording: Measurements) -> tuple[str, ...]:
        """Return what does not show for each joint that does not move, without a full stop."""
        return tuple(
            f"{capital(recording.joint_label(j))} does not move ({self._where(j)}): the log shows "
            "nothing of its friction and rotor inertia, and of the links beyond it only what the other joints' motion "
            "and gravity show"
            for j in map(int, np.flatnonzero(self.mask))
        )

    def _where(self, joint: int) -> str:
        if self.travel[joint] == 0.0:
            return f"it stays at {self.position[joint]:.6g}"
        return f"it stays near {self.position[joint]:.4g}, and gives way by {self.travel[joint]:.2g}"


@dataclass(frozen=True, eq=False)
class VelocityThresholds:
    """Velocities below which rows of a joint are left out, as `velocity_thresholds` chooses them.

    Attributes
    ----------
    thresholds : ndarray
        (N,) rad/s or m/s; slower rows are better left out.
    noise : ndarray
        (N,) standard deviation of the noise of the velocities.
    sticking : ndarray
        (N,) whether the torques show less friction near rest than faster motion does.
    resting : ndarray
        (N,) whether the joint comes to rest, and has friction that turns with its velocity.
    share : ndarray
        (N,) share of the rows of each joint that are slower than its threshold.
    by_noise : ndarray
        (N,) rad/s or m/s, from where on the sign of a velocity is certain: the thresholds where no joint sticks.
    joint_names : tuple of str or None
        For sentences; None where the joints have none.
    """

    thresholds: Array
    noise: Array
    sticking: NDArray[np.bool_]
    resting: NDArray[np.bool_]
    share: Array
    by_noise: Array
    joint_names: tuple[str, ...] | None = None

    @property
    def remark(self) -> str:
        """One sentence that says what is left out and why, and how to choose."""
        return f"{self.reason}; set `velocity_threshold` in [processing] to choose."

    @property
    def reason(self) -> str:
        """What is left out and why, without a full stop."""
        values = ", ".join(f"{value:.3g}" for value in self.thresholds)
        resting = self.resting & ~self.sticking
        others = ~(self.resting | self.sticking)
        said: list[str] = []
        if self.sticking.any():
            said.append(f"the torques of {self._listed(self.sticking)} show less friction than faster motion does")
        if resting.any():
            said.append(f"{self._listed(resting)} may be at rest, where friction is any up to that of sliding")
        if not said:
            reason = "below three standard deviations of its noise, the sign of a velocity is not certain"
        else:
            reason = "there " + ", and ".join(said)
            if others.any():
                reason += ", and of the others the sign of the velocity is not certain"
        return (
            f"Rows of a joint slower than {values} (rad/s or m/s, joint by joint) were left out, up to "
            f"{100.0 * self.share.max():.2g} % of its rows: {reason}"
        )

    def _listed(self, joints: NDArray[np.bool_]) -> str:
        return ", ".join(joint_label(int(j), self.joint_names) for j in np.flatnonzero(joints))


def velocity_noise(recording: Measurements, motion_filter: MotionFilter, measured: bool = False) -> Array:
    """Return the standard deviation (N,) of what white noise on the positions leaves on the filtered velocities.

    Parameters
    ----------
    recording : Recording
    motion_filter : MotionFilter
        With everything determined.
    measured : bool
        Whether the velocities are the measured ones, filtered, and not derived from the positions.
    """
    if motion_filter.kind == "fourier":  # passes single frequencies, which hold no power of white noise
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

    Three things make rows near rest useless. Where the velocity is within its noise, the sign of Coulomb friction is
    not certain: the threshold is three standard deviations of the noise. A joint that waits between its moves has
    friction that may be any up to that of sliding, and a velocity that the filter made: its threshold is a fiftieth of
    its root mean square velocity. And a joint that sticks, or whose friction
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
    """
    count = sum(one.count for one in samples)
    usual = np.sqrt(sum((one.dq**2).sum(axis=0) for one in samples) / count)
    thresholds = by_noise = np.minimum(SIGN_IS_SURE * noise, LARGEST * usual)
    sticking = resting = np.zeros(len(usual), dtype=bool)
    if model is not None:
        at_rest = sum((np.abs(one.dq) < AT_REST * usual).sum(axis=0) for one in samples) / count
        resting = (at_rest > RESTS) & _turning_friction(model)
        thresholds = np.where(resting, np.maximum(thresholds, AT_REST * usual), thresholds)
        with one_thread():
            limits = _lacks(samples, usual, model, max(1, -(-count // MOST_ROWS)))
        sticking = limits > 0.0
        thresholds = np.maximum(thresholds, limits)
    share = sum((np.abs(one.dq) < thresholds).sum(axis=0) for one in samples) / count
    names = None if model is None else tuple(model.robot.joint_names)
    return VelocityThresholds(thresholds, noise, sticking, resting, share, by_noise, names)


def _turning_friction(model: Model) -> NDArray[np.bool_]:
    """Tell of which joints the torque jumps where their velocity turns, (N,), as that of Coulomb friction does.

    Friction that has a state does not jump, and is known at rest as well.
    """
    if model.remembers:
        return np.zeros(model.dof, dtype=bool)
    rest, slow = np.zeros((model.dof, model.dof)), CREEPING * np.eye(model.dof)
    columns = model.base_columns
    forward, back = (columns.by_joint(columns.of_motion(rest, sign * slow, rest)) for sign in (1.0, -1.0))
    jumps = [
        np.abs(ahead[k] - behind[k]).max(initial=0.0)
        for k, (ahead, behind) in enumerate(zip(forward, back, strict=True))
    ]
    return np.array(jumps) > JUMPS


def _lacks(samples: Sequence[Samples], usual: Array, model: Model, every: int) -> Array:
    """Return the velocities (N,) up to which the torques show a lack of friction; 0 where they show none."""
    torques = TorqueFit(model)
    rows = [np.arange(0, one.count, every) for one in samples]
    kept = [one.used_rows[own] for one, own in zip(samples, rows, strict=True)]
    for one, own, mask in zip(samples, rows, kept, strict=True):
        torques.add(one, own, mask & (np.abs(one.dq[own]) >= FAST * usual))
    base, relative = torques.fitted()
    edges = LARGEST * RATIO ** np.arange(1.0 - BINS, 1.0)
    passes: list[list[list[Array]]] = [[[] for _ in range(BINS)] for _ in usual]
    told = np.isfinite(relative) & (usual > 0.0)
    for one, own, mask in zip(samples, rows, kept, strict=True):
        slow = mask & told & (np.abs(one.dq[own]) < LARGEST * usual)
        places = np.flatnonzero(slow.any(axis=1))
        left = one.torque[own[places]] - torques.predicted(one, own[places], base)
        for k, of_joint in enumerate(slow.T):
            at = np.flatnonzero(of_joint)
            at = at[np.isfinite(left[np.searchsorted(places, at), k])]
            if not len(at):
                continue
            velocity = one.dq[own[at], k]
            against = np.sign(velocity) * left[np.searchsorted(places, at), k]
            bins = np.searchsorted(edges * usual[k], np.abs(velocity), side="right")
            new = (np.diff(at) > 1) | (np.diff(bins) != 0) | (np.diff(np.sign(velocity)) != 0.0)
            starts = np.concatenate([[0], np.flatnonzero(new) + 1])
            means = np.add.reduceat(against, starts) / np.diff(np.append(starts, len(at)))
            for index in range(BINS):
                passes[k][index].append(means[bins[starts] == index])
    return (
        np.array([_last_lack([np.concatenate(p) if p else np.empty(0) for p in own], edges) for own in passes]) * usual
    )


def _last_lack(passes: list[Array], edges: Array) -> float:
    """Return the upper limit of the fastest bin whose passes show a lack of friction."""
    from scipy.special import stdtrit  # scipy.stats takes as long to import as the whole of an identification

    known = [means for means in passes if len(means) >= FEWEST_PASSES]
    deepest = min((float(means.mean()) for means in known), default=0.0)
    limit = 0.0
    for means, edge in zip(passes, edges, strict=True):
        if len(means) < FEWEST_PASSES:
            continue
        mean, error = float(means.mean()), float(means.std(ddof=1)) / np.sqrt(len(means))
        if mean < error * float(stdtrit(len(means) - 1, CHANCE)) and mean < CLEAR * deepest:
            limit = float(edge)
    return limit
