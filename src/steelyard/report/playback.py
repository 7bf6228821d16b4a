"""Motions that are played on a drawn robot: a log or a trajectory, with torques as measured and as predicted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.collision.self_collision import SelfCollision
from steelyard.collision.surroundings import Surroundings
from steelyard.errors import InputError
from steelyard.excitation import load_trajectory
from steelyard.identification.log_reader import LogReader

from .viewed_robot import ViewedRobot

__all__ = ["NearPair", "Nearness", "Playback", "play_log", "play_trajectory", "watch_collisions"]

Array = NDArray[np.float64]

# Instants of a motion that are kept: those of a log of a minute at 60 Hz, more than is drawn in a second.
POINTS = 3600
# At most so many instants are asked for distances beforehand; a humanoid needs 10 ms for one.
MOST_INSTANTS = 400
NEAR = 0.05
"""Distance below which two links are shown as near, m; several times the margin, so that one sees it coming."""


@dataclass(frozen=True, eq=False)
class Playback:
    """A motion, and the torques in it.

    Attributes
    ----------
    t : ndarray
        (S,) s, from 0.
    q : ndarray
        (S, N).
    torques : mapping from str to ndarray
        (S, N) each, N·m or N: ``"measured"``, ``"identified"`` and ``"CAD"``, those that there are.
    """

    name: str
    t: Array
    q: Array
    torques: Mapping[str, Array]
    remarks: tuple[str, ...] = field(default=(), repr=False)

    @property
    def duration(self) -> float:
        """Time from the first to the last instant, s."""
        return float(self.t[-1])

    def index(self, time: float) -> int:
        """Return the last instant that is not after a time."""
        return int(np.clip(np.searchsorted(self.t, time + 1e-9, side="right") - 1, 0, len(self.t) - 1))

    def configuration(self, time: float) -> Array:
        """Return q (N,) at a time, interpolated."""
        return np.array([np.interp(time, self.t, column) for column in self.q.T])


def _predicted(
    viewed: ViewedRobot, q: Array, dq: Array, ddq: Array, channels: Mapping[str, Array] | None = None
) -> dict[str, Array]:
    """Return the torques (S, N) that the parameters predict which are known; friction that CAD does not give is 0.

    Without channels, terms that need some are taken as without them: friction with a state as in steady sliding.
    """
    model, known = viewed.model, {}
    if viewed.identified is not None:
        known["identified"] = viewed.identified
    elif viewed.result is not None:
        known["identified"] = model.base_parameters().Pb @ viewed.result.estimate.base
    links = np.concatenate([np.asarray(columns, dtype=np.intp) for columns in model.link_columns])
    if np.isfinite(viewed.described[links]).all():
        known["CAD"] = np.nan_to_num(viewed.described)
    if channels is None:
        known = {name: model.parameters_without_channels(one) for name, one in known.items()}
        model = model.without_channels
    return {name: model.inverse_dynamics(q, dq, ddq, one, channels=channels) for name, one in known.items()}


def play_log(viewed: ViewedRobot, log: str | Path, progress: Callable[[str], None] | None = None) -> Playback:
    """Read a log to be played, processed as those of the identification were, or as the robot file says.

    Parameters
    ----------
    log : str or Path
        Files that were recorded side by side are joined by ``+``.
    progress : callable, optional
        Called with a few words before each step.

    Raises
    ------
    InputError
        If the log cannot be used.
    """
    say = progress or (lambda _: None)
    reader = LogReader(viewed.file, viewed.model)
    used = None if viewed.result is None else viewed.result.processing
    if used is not None:
        reader.stated = reader.processing = used
    name = str(log)
    reader.decide([name], say)
    say(f"reading {name}")
    thinned = reader.thinned(name, POINTS // 2)
    if not thinned.seen:
        raise InputError(f"{name}: no rows are left after processing, so that there is nothing to play; trim less.")
    samples = thinned.samples
    t = samples.t
    if t is None or t[-1] <= t[0]:
        raise InputError(f"{name}: has no times, or one instant alone; give a log in time.")
    torque = np.where(samples.mask, samples.torque, np.nan) if samples.mask is not None else samples.torque
    torques = {"measured": torque, **_predicted(viewed, samples.q, samples.dq, samples.ddq, samples.channels)}
    return Playback(name, t - t[0], samples.q, torques, tuple(reader.remarks))


def play_trajectory(viewed: ViewedRobot, path: str | Path) -> Playback:
    """Read a trajectory to be played, such as ``steelyard excite`` writes, with the torques that it will take.

    Parameters
    ----------
    path : str or Path
        A trajectory, or the folder that ``steelyard excite`` wrote.

    Raises
    ------
    InputError
        If it cannot be read, or is of a robot with other joints.
    """
    place = Path(path)
    trajectory = load_trajectory(place / "trajectory.json" if place.is_dir() else place, viewed.model.robot)
    rate = (POINTS - 1) / trajectory.duration
    t = np.arange(POINTS) / rate
    q, dq, ddq = trajectory.motion(t)
    return Playback(str(path), t, q, _predicted(viewed, q, dq, ddq))


@dataclass(frozen=True, eq=False)
class NearPair:
    """Two links that are near each other.

    Attributes
    ----------
    distance : float
        m; negative where they overlap.
    too_near : bool
        Whether it is below the margin.
    bodies : frozenset of int
        The moving links that carry them; -1 for the base.
    points : ndarray
        (2, 3) their nearest points, base frame, m; (0, 3) where they are not known.
    """

    label: str
    distance: float
    too_near: bool
    bodies: frozenset[int]
    points: Array


@dataclass(frozen=True, eq=False)
class Nearness:
    """The distances between pairs of links.

    Attributes
    ----------
    constraint : SelfCollision
        The pairs, and the margin of each.
    t : ndarray
        (K,) instants at which distances are known, s.
    distances : ndarray
        (K, m) of each pair, m; those beyond the horizon count as the horizon.
    """

    constraint: SelfCollision
    t: Array
    distances: Array

    def words(self) -> str:
        """Say which pair comes nearest, and when."""
        if not len(self.t):
            return ""
        row, column = np.unravel_index(int(np.argmin(self.distances)), self.distances.shape)
        least = float(self.distances[row, column])
        if least >= self.constraint.horizon:
            return f"No two links come nearer than {self.constraint.horizon:.3g} m."
        where = f"{self.constraint.labels[column]} at {self.t[row]:.2f} s"
        return f"Nearest: {where}, " + (f"{least:.3f} m apart." if least > 0.0 else f"{-least:.3f} m into each other.")

    def near(self, q: Array) -> tuple[NearPair, ...]:
        """Return the pairs that are nearer than `NEAR` or than their margin in a configuration (N,), nearest first."""
        constraint = self.constraint
        clearance = constraint.clearance(q[None])[0]
        distances = clearance + constraint.margins
        columns = np.flatnonzero((distances < NEAR) | (clearance < 0.0))
        if not len(columns):
            return ()
        wanted = np.zeros((1, len(clearance)), dtype=np.bool_)
        wanted[0, columns] = True
        nearest = constraint.nearest(q[None], wanted)
        found = []
        for column in columns.tolist():
            carriers = {constraint.robot.frame(link)[0] for pair in constraint.watched[column] for link in pair}
            ends = nearest[column]
            points = np.array([ends.first[0], ends.second[0]]) if len(ends.rows) else np.zeros((0, 3))
            label, distance = constraint.labels[column], float(distances[column])
            found.append(NearPair(label, distance, bool(clearance[column] < 0.0), frozenset(carriers), points))
        return tuple(sorted(found, key=lambda pair: pair.distance))


def watch_collisions(viewed: ViewedRobot, motion: Playback | None) -> tuple[Nearness | None, tuple[str, ...]]:
    """Measure the distances of links in a motion; return them, and sentences on what was not checked.

    Without a motion, distances are measured in configurations alone.
    """
    around = Surroundings.of(viewed.model.robot, (), {}, self_collision=True)
    if around.own is None:
        return None, (*around.unchecked, *around.remarks)
    if motion is None:
        return Nearness(around.own, np.zeros(0), np.zeros((0, len(around.own.labels)))), around.unchecked
    rows = np.unique(np.linspace(0, len(motion.t) - 1, min(MOST_INSTANTS, len(motion.t))).astype(int))
    distances = around.own.clearance(motion.q[rows]) + around.own.margins
    return Nearness(around.own, motion.t[rows], distances), around.unchecked
