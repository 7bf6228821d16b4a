"""Trajectory matching by multiple shooting: parameters of drives from commands and positions.

A log is cut into short stretches, each of which is simulated from a state of its own; that the end of one is the start
of the next is a condition, which the steps of Gauss and Newton meet in the limit. All stretches are simulated as one
batch, and the states between them are eliminated (Bock and Plitt 1984, "A multiple shooting algorithm for direct
solution of optimal control problems"): what is left has the size of the parameters and of one state a log. Joints that
move independently of each other are problems of their own, which only a common delay joins.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import lsq_linear

from steelyard.errors import InputError
from steelyard.once import cached_property
from steelyard.regression.coloured_noise import correlation_sum
from steelyard.regression.factor import eigenvectors
from steelyard.simulation.driven_joints import (
    COULOMB,
    DRIVE_PARAMETERS,
    Branch,
    Directions,
    DrivenMotion,
    FrictionLaw,
    drive,
)

__all__ = ["PassingLog", "PositionLog", "Shooting", "ShootingResult", "Unknown"]

Array = NDArray[np.float64]

ROWS = 60
"""Rows of a stretch at most: as many steps follow one another, while all stretches go side by side. With 20, 60 and 120
the sweeps of a leg robot take 5.2, 3.9 and 3.7 s of the processor, and lead to the same error."""

COARSEST_STEP = 5e-3
"""s, of the simulations far from the answer."""

FINEST_STEP = 7.8e-5
"""s, of the simulations of logs that are so long, or so precise, that longer steps show: three times half of 0.625
ms."""

SHOWN = 0.1
"""Standard errors by which half the step of the simulation may move a value. A log of 20 s of four joints with 20 µrad
of noise, in steps of 0.625 ms: rotor inertias, viscous friction and the delay were off by four to five."""

STEPS = 40
"""The most steps of Gauss and Newton; six to twelve are usual."""

SETTLED = 1e-6
"""Relative change of the squared error with which they have converged. Friction that begins to slip at one step or at
the next makes the error rough on a scale of 1e-7."""

STEEP = 1e2
"""Damping, relative to the squared sensitivities, with which even the smallest steps find nothing better."""

GENTLE, ROUGH, SHARP_ROUGH = 1e-2, 1e-5, 2e-3
"""Damping up to which a step shows what is to be gained, and by how much, relative to the squared error, such a step
may fail where that is rough: smaller ones gain nothing then. Friction in parts of the travel makes it as rough as the
first, friction by the velocity itself as the second: a leg robot's search went on for 40 steps and ended where it was
after 3."""

LEFT_OUT = 1e-8
"""Damping of the step to the values without a stretch: of what nothing else shows, nothing changes."""

COARSE = 1e-4
"""The same, where steps of the simulation are still as long as the rows, or weights of the joints not yet found."""

UNSEEN = 1e-12
"""Eigenvalue of the squared sensitivities, each unknown scaled to one, below which rounding is all that is left."""

JOININGS, JOINED = 12, 1e-9
"""How often all stretches are simulated at most until each begins where the one before ends, and with which gaps, rad
and rad/s, they do. Two to four times are usual; a simulation of 13 s row by row takes as long as 14 of them."""

CLOSED = 1e-4
"""rad, of the gaps between stretches then. The states between are then taken from one simulation of the whole."""


@dataclass(frozen=True, eq=False)
class PositionLog:
    """Commands and positions of a log, in stretches without gaps in time.

    Attributes
    ----------
    t : ndarray
        (S,) s.
    q, command : ndarray
        (S, N). Each command holds until the next.
    begin : float
        s, from the start of what was recorded to this stretch of it.
    """

    t: Array
    q: Array
    command: Array
    name: str = "log"
    begin: float = 0.0

    @cached_property
    def command_sums(self) -> Array:
        """(S, N) integrals of the commands from the first time on."""
        steps = np.diff(self.t)[:, np.newaxis]
        return np.concatenate([np.zeros((1, self.q.shape[1])), np.cumsum(self.command[:-1] * steps, axis=0)])

    def held(self, joint: int, times: Array) -> Array:
        """The command that holds at these times; the first one before the log."""
        places = np.searchsorted(self.t, times, side="right") - 1
        return np.asarray(self.command[np.clip(places, 0, len(self.t) - 1), joint])

    def summed(self, joint: int, times: Array) -> Array:
        """The integral of the command from the first time of the log to these."""
        before, after = np.minimum(times - self.t[0], 0.0), np.maximum(times - self.t[-1], 0.0)
        inside = np.interp(times, self.t, self.command_sums[:, joint])
        return np.asarray(inside + before * self.command[0, joint] + after * self.command[-1, joint])


class PassingLog(PositionLog):
    """A log whose commands pass from row to row in straight lines, instead of holding until the next row.

    That is nearer to what a drive was told, where the log holds only some of its commands.
    """

    @cached_property
    def command_sums(self) -> Array:
        """(S, N) integrals of the commands from the first time on."""
        middles = 0.5 * (self.command[1:] + self.command[:-1]) * np.diff(self.t)[:, np.newaxis]
        return np.concatenate([np.zeros((1, self.q.shape[1])), np.cumsum(middles, axis=0)])

    def held(self, joint: int, times: Array) -> Array:
        """The command at these times."""
        return np.asarray(np.interp(times, self.t, self.command[:, joint]))

    def summed(self, joint: int, times: Array) -> Array:
        """The integral of the command from the first time of the log to these."""
        t, command = self.t, self.command[:, joint]
        inside = np.clip(times, t[0], t[-1])
        row = np.clip(np.searchsorted(t, inside, side="right") - 1, 0, len(t) - 2)
        passed = 0.5 * (command[row] + np.interp(inside, t, command)) * (inside - t[row])
        outside = np.minimum(times - t[0], 0.0) * command[0] + np.maximum(times - t[-1], 0.0) * command[-1]
        return np.asarray(self.command_sums[row, joint] + passed + outside)


@dataclass(frozen=True)
class Unknown:
    """A number that is looked for, and where it acts.

    Attributes
    ----------
    kind : str
        One of `DRIVE_PARAMETERS`, ``"coulomb"`` for friction alike over the travel, ``"encoder"``, or ``"inertial"``.
    joints : tuple of int
        The coordinates at which it acts; several for a common delay. For an inertial parameter its branch's first.
    start, lower, upper : float
    place : int
        Of an inertial parameter among those of its branch.
    prior : float
        Standard deviation about the start; infinite where nothing is known.
    """

    kind: str
    joints: tuple[int, ...]
    start: float
    lower: float = -np.inf
    upper: float = np.inf
    place: int = 0
    prior: float = np.inf

    @property
    def drive_rows(self) -> list[int]:
        """Where it stands among the parameters of a drive."""
        kinds = COULOMB if self.kind == "coulomb" else (self.kind,)
        return [DRIVE_PARAMETERS.index(kind) for kind in kinds if kind in DRIVE_PARAMETERS]


@dataclass(frozen=True, eq=False)
class ShootingResult:
    """The result of the search by shooting.

    Attributes
    ----------
    values : ndarray
        (m,) of the unknowns.
    covariance : ndarray
        (m, m), with regard to residuals that depend on each other in time; infinite variances where nothing depends on
        an unknown.
    residuals : list of ndarray
        (S, N) of each log: measured less simulated from its commands alone.
    """

    values: Array
    covariance: Array
    residuals: list[Array]
    steps: int
    settled: bool


@dataclass(frozen=True, eq=False)
class _Piece:
    """A stretch of a log: rows first to last, of which the last is the first of the next where that is the same log."""

    log: int
    first: int
    last: int


@dataclass(eq=False)
class _Grown:
    """The stretches of a branch, condensed to the starts of the logs and its own m unknowns.

    Attributes
    ----------
    alphas, betas : ndarray
        (K, 2 n) and (K, 2 n, 2 n + m): how the states of all stretches follow the start of their log and the unknowns.
    residuals, jacobians : list of ndarray
        Of each log (S, n), and (S, n, 2 n + m) the derivatives of its positions by its start and the unknowns.
    gaps : float
        rad, the largest between two stretches.
    """

    alphas: Array
    betas: Array
    residuals: list[Array] = field(default_factory=list)
    jacobians: list[Array] = field(default_factory=list)
    gaps: float = 0.0


@dataclass(eq=False)
class Shooting:
    """A problem of trajectory matching.

    Parameters
    ----------
    inertials : callable
        From the index of a branch and its freed inertial values to the parameters of its links (10 n,) and their
        derivatives (10 n, f).
    fixed : ndarray
        (13, N) drive parameters, with the values of those that are not unknown.
    travel : ndarray
        (2, N) ends of each joint's travel, over which Coulomb friction may vary.
    longest_step : float
        s, of a step of the simulation.
    rows : int
        Of a stretch at most.
    period : float
        s, for which drives hold each torque that they compute; 0 where their law acts all the time.
    """

    branches: Sequence[Branch]
    inertials: Callable[[int, Array], tuple[Array, Array]]
    fixed: Array
    travel: Array
    unknowns: Sequence[Unknown]
    logs: Sequence[PositionLog]
    law: FrictionLaw
    longest_step: float
    rows: int = ROWS
    period: float = 0.0

    def __post_init__(self) -> None:
        self.pieces = [
            _Piece(number, first, min(first + self.rows, len(log.t) - 1))
            for number, log in enumerate(self.logs)
            for first in range(0, len(log.t) - 1, self.rows)
        ]
        longest = max(np.diff(log.t).max() for log in self.logs)
        self.substeps = max(1, int(np.ceil(longest / self.longest_step - 1e-6)))
        self._coarse = min(self.substeps, max(1, int(np.ceil(longest / COARSEST_STEP - 1e-6))))

    # What the unknowns mean

    def drives(self, values: Array) -> tuple[Array, Array]:
        """Return the (13, N) drive parameters and the (N,) encoder offsets."""
        drives, encoder = self.fixed.copy(), np.zeros(self.fixed.shape[1])
        for unknown, value in zip(self.unknowns, values, strict=True):
            joints = list(unknown.joints)
            drives[np.ix_(unknown.drive_rows, joints)] = value
            if unknown.kind == "encoder":
                encoder[joints] = value
        return drives, encoder

    def freed(self, number: int, values: Array) -> Array:
        """Return the freed inertial values of a branch."""
        of = set(self.branches[number].coordinates)
        found = [
            (u.place, value)
            for u, value in zip(self.unknowns, values, strict=True)
            if u.kind == "inertial" and u.joints[0] in of
        ]
        return np.array([value for _, value in sorted(found)])

    @cached_property
    def bounds(self) -> Array:
        """(2, m) lower and upper bounds of the unknowns."""
        return np.array([[unknown.lower, unknown.upper] for unknown in self.unknowns]).T.reshape(2, -1)

    @cached_property
    def own_unknowns(self) -> list[NDArray[np.intp]]:
        """Which unknowns act on each branch."""
        return [
            np.array([k for k, u in enumerate(self.unknowns) if set(u.joints) & set(branch.coordinates)], dtype=int)
            for branch in self.branches
        ]

    def _directions(self, number: int, inertials: Array, count: int) -> Directions:
        """By the unknowns of a branch, and up to a count by nothing."""
        branch = self.branches[number]
        place = {joint: k for k, joint in enumerate(branch.coordinates)}
        drives, encoder = np.zeros((len(DRIVE_PARAMETERS), branch.count, count)), np.zeros((branch.count, count))
        links = np.zeros((len(inertials), count))
        for column, index in enumerate(self.own_unknowns[number][:count]):
            unknown = self.unknowns[index]
            joints = [place[joint] for joint in unknown.joints if joint in place]
            if unknown.kind == "inertial":
                links[:, column] = inertials[:, unknown.place]
            elif unknown.kind == "encoder":
                encoder[joints, column] = 1.0
            else:
                drives[np.ix_(unknown.drive_rows, joints, [column])] = 1.0
        return Directions(drives, encoder, links)

    # Simulation

    def _batch(self, pieces: Sequence[_Piece], branch: Branch, delay: Array) -> tuple[Array, Array, Array]:
        """Return the lengths of the intervals of stretches, and the commands of their steps with derivatives by delay.

        Stretches that are shorter than the longest go on for intervals of the same length, which nobody looks at.
        """
        length = max(piece.last - piece.first for piece in pieces)
        steps = np.empty((length, len(pieces)))
        count = length * self.substeps
        command, by_delay = np.empty((2, count, len(pieces), branch.count))
        for k, piece in enumerate(pieces):
            own = np.diff(self.logs[piece.log].t[piece.first : piece.last + 1])
            steps[:, k] = own[-1]
            steps[: len(own), k] = own
        each = np.repeat(steps / self.substeps, self.substeps, axis=0)
        first = [self.logs[piece.log].t[piece.first] for piece in pieces]
        edges = first + np.concatenate([np.zeros((1, len(pieces))), np.cumsum(each, axis=0)])
        of = np.array([piece.log for piece in pieces])
        for number, log in enumerate(self.logs):
            its = np.flatnonzero(of == number)
            for j, joint in enumerate(branch.coordinates):
                at = edges[:, its] - delay[j]
                command[:, its, j] = np.diff(log.summed(joint, at), axis=0) / each[:, its]
                by_delay[:, its, j] = -np.diff(log.held(joint, at), axis=0) / each[:, its]
        return steps, command, by_delay

    def simulate(self, values: Array, states: Sequence[Array]) -> tuple[list[Array], list[Array]]:
        """Simulate each log from its first state and its commands alone.

        All stretches go side by side, over and over: Newton's method moves the states between them until each begins
        where the one before ends. Where that does not come about, rows follow one another.

        Parameters
        ----------
        values : ndarray
            (m,) of the unknowns.
        states : sequence of ndarray
            (K, 2 n) of all stretches, for each branch: the first of each log, and guesses of the others.

        Returns
        -------
        positions : list of ndarray
            (S, N) of each log.
        states : list of ndarray
            (K, 2 n) of all stretches along it, for each branch.
        """
        found = [np.empty_like(log.q) for log in self.logs]
        passed = [np.empty_like(own) for own in states]
        for group in self._groups():
            own = np.stack([states[index] for index in group])
            parts = self._side_by_side(group, values, own) or self._row_by_row(group, values, own)
            for k, index in enumerate(group):
                passed[index] = own[k]
                for number, q in enumerate(parts):
                    found[number][:, list(self.branches[index].coordinates)] = q[:, k]
        return found, passed

    def _side_by_side(self, group: Sequence[int], values: Array, states: Array) -> list[Array] | None:
        """Return positions (S, B, n) of each log, and set the states (B, K, 2 n) between; None where these diverge."""
        moved = states.copy()
        for _ in range(JOININGS):
            motion = self._drive(group, values, moved, self.pieces, unknowns=False)
            assert motion.end_by_start is not None
            change = np.zeros_like(moved)
            with np.errstate(over="ignore", invalid="ignore"):
                for k, piece in enumerate(self.pieces):
                    if piece.first > 0:
                        carried = (motion.end_by_start[:, k - 1] @ change[:, k - 1, :, np.newaxis])[..., 0]
                        change[:, k] = motion.end[:, k - 1] - moved[:, k] + carried
            if not np.isfinite(change).all():
                return None
            if np.max(np.abs(change)) < JOINED:
                states[...] = moved
                rows: list[list[Array]] = [[] for _ in self.logs]
                for k, piece in enumerate(self.pieces):
                    stop = piece.last - piece.first + int(piece.last == len(self.logs[piece.log].t) - 1)
                    rows[piece.log].append(motion.q[:stop, :, k])
                return [np.concatenate(parts) for parts in rows]
            moved = moved + change
        return None

    def _row_by_row(self, group: Sequence[int], values: Array, states: Array) -> list[Array]:
        """Return positions (S, B, n) of each log, and set the states (B, K, 2 n) between."""
        whole = [_Piece(number, 0, len(log.t) - 1) for number, log in enumerate(self.logs)]
        first = [k for k, piece in enumerate(self.pieces) if piece.first == 0]
        motion = self._drive(group, values, states[:, first], whole, sensitivities=False)
        for k, piece in enumerate(self.pieces):
            at = piece.first, slice(None), piece.log
            states[:, k] = np.concatenate([motion.q[at], motion.dq[at]], axis=-1)
        return [motion.q[: len(log.t), :, number] for number, log in enumerate(self.logs)]

    def _groups(self) -> list[list[int]]:
        """Branches of as many joints, which go side by side."""
        sizes: dict[int, list[int]] = {}
        for index, branch in enumerate(self.branches):
            sizes.setdefault(branch.count, []).append(index)
        return list(sizes.values())

    def _drive(
        self,
        group: Sequence[int],
        values: Array,
        states: Array,
        pieces: Sequence[_Piece],
        sensitivities: bool = True,
        unknowns: bool = True,
    ) -> DrivenMotion:
        """Simulate stretches of the branches of a group from states (B, K, 2 n)."""
        drives, encoder = self.drives(values)
        branches = [self.branches[index] for index in group]
        own = [list(branch.coordinates) for branch in branches]
        batches = [self._batch(pieces, branch, drives[-1, place]) for branch, place in zip(branches, own, strict=True)]
        bodies = [self.inertials(index, self.freed(index, values)) for index in group]
        directions = None
        if sensitivities:
            most = max(len(self.own_unknowns[index]) for index in group) if unknowns else 0
            directions = [
                self._directions(index, changes, most) for index, (_, changes) in zip(group, bodies, strict=True)
            ]
        with np.errstate(over="ignore", invalid="ignore"):  # a step that is too long may run away: it is not taken
            return drive(
                branches,
                [parameters for parameters, _ in bodies],
                np.stack([drives[:, place] for place in own]),
                np.stack([encoder[place] for place in own]),
                np.stack([self.travel[:, place] for place in own]),
                states,
                batches[0][0],
                np.stack([command for _, command, _ in batches], axis=1),
                np.stack([by_delay for _, _, by_delay in batches], axis=1),
                self.law,
                substeps=self.substeps,
                period=self.period,
                directions=directions,
            )

    def predict(self, values: Array, logs: Sequence[PositionLog]) -> list[Array]:
        """Return the positions (S, N) of logs that were not fitted: from their first measured state and commands."""
        other = replace(self, logs=logs)
        return other.simulate(values, other.start_states())[0]

    def _grow_all(self, values: Array, states: Sequence[Array]) -> list[_Grown]:
        """Simulate all stretches of all branches; see `_grow`."""
        found: dict[int, _Grown] = {}
        for group in self._groups():
            motion = self._drive(group, values, np.stack([states[index] for index in group]), self.pieces)
            for k, index in enumerate(group):
                found[index] = self._grow(index, motion, k, states[index])
        return [found[index] for index in range(len(self.branches))]

    def _grow(self, number: int, motion: DrivenMotion, k_branch: int, states: Array) -> _Grown:
        """Condense the stretches of a branch: its residuals, and how the states between follow starts and unknowns."""
        branch = self.branches[number]
        n, own = branch.count, list(branch.coordinates)
        assert motion.by_start is not None
        assert motion.by_parameters is not None
        assert motion.end_by_start is not None
        assert motion.end_by_parameters is not None
        m = len(self.own_unknowns[number])
        positions, ends, by_states = motion.q[:, k_branch], motion.end[k_branch], motion.by_start[:, k_branch]
        by_unknowns, end_by_unknowns = (
            motion.by_parameters[:, k_branch, ..., :m],
            motion.end_by_parameters[k_branch, ..., :m],
        )
        count = len(self.pieces)
        grown = _Grown(np.zeros((count, 2 * n)), np.zeros((count, 2 * n, 2 * n + m)))
        alpha, beta = np.zeros(2 * n), np.zeros((2 * n, 2 * n + m))
        rows: list[tuple[Array, Array]] = []
        for k, piece in enumerate(self.pieces):
            if piece.first == 0:
                alpha = np.zeros(2 * n)
                beta = np.zeros((2 * n, 2 * n + m))
                beta[:, : 2 * n] = np.eye(2 * n)
                rows = []
            grown.alphas[k], grown.betas[k] = alpha, beta
            log = self.logs[piece.log]
            last = piece.last == len(log.t) - 1
            stop = piece.last - piece.first + int(last)
            measured = log.q[piece.first : piece.first + stop][:, own]
            by_start = by_states[:stop, k]
            jacobian = by_start @ beta
            jacobian[..., 2 * n :] += by_unknowns[:stop, k]
            rows.append((measured - positions[:stop, k] - by_start @ alpha, jacobian))
            if last:
                grown.residuals.append(np.concatenate([a for a, _ in rows]))
                grown.jacobians.append(np.concatenate([b for _, b in rows]))
            else:
                follow = motion.end_by_start[k_branch, k]
                end = ends[k] - states[k + 1]
                grown.gaps = max(grown.gaps, float(np.abs(end[:n]).max()))
                alpha = follow @ alpha + end
                beta = follow @ beta
                beta[:, 2 * n :] += end_by_unknowns[k]
        return grown

    # The fit

    def start_states(self) -> list[Array]:
        """Return (K, 2 n) states at the beginnings of the stretches for each branch, from the measured positions."""
        found = []
        for branch in self.branches:
            own = list(branch.coordinates)
            states = np.empty((len(self.pieces), 2 * branch.count))
            for k, piece in enumerate(self.pieces):
                log = self.logs[piece.log]
                low = max(0, min(piece.first - 4, len(log.t) - 9))
                window = slice(low, min(low + 9, len(log.t)))
                t = log.t[window] - log.t[piece.first]
                degree = min(2, len(t) - 1)
                lines = np.polynomial.polynomial.polyfit(t, log.q[window][:, own], degree)
                states[k] = np.concatenate([lines[0], lines[1]])
            found.append(states)
        return found

    def solve(self, weights: str = "joint", tell: Callable[[str], None] | None = None) -> ShootingResult:
        """Match the trajectories.

        Parameters
        ----------
        weights : {"joint", "equal"}
            ``"joint"`` divides each joint's residuals by their rms, which is found on the way.
        tell : callable, optional
            Is told of each step.
        """
        system, states, steps, settled = self._search(weights, tell, SETTLED)
        if settled:
            system, states = self._refined(system, states)
        simulated, _ = self.simulate(system.values, states)
        residuals = [log.q - q for log, q in zip(self.logs, simulated, strict=True)]
        return ShootingResult(system.values, self._covariance(system), residuals, steps, settled)

    def left_out(self, stretches: Sequence[tuple[int, int, int]], weights: str, settled_at: float) -> Array:
        """Return how well each stretch is predicted if its rows do not count in the fit.

        The values without a stretch are one step of Gauss and Newton away from those of all rows: nothing is
        simulated anew. Each log is simulated from its start throughout, whose state stays that of all rows: rows that
        are left out at the beginning of a log would leave nothing that tells it.

        Parameters
        ----------
        stretches : sequence of tuple of int
            Index of a log, and its rows from one to before another.
        weights : {"joint", "equal"}
            As in `solve`.
        settled_at : float
            Relative change of the squared error with which the search ends.

        Returns
        -------
        ndarray
            (F, N) sums of the squared errors of each joint in each stretch.
        """
        system = self._search(weights, None, settled_at)[0]
        m, found = len(self.unknowns), np.zeros((len(stretches), self.fixed.shape[1]))
        for number, (log, begin, end) in enumerate(stretches):
            hessian, gradient = system.hessian[-m:, -m:].copy(), system.gradient[-m:].copy()
            parts = []
            for branch, unknowns, one in zip(self.branches, self.own_unknowns, system.grown, strict=True):
                own = list(branch.coordinates)
                residual, jacobian = one.residuals[log][begin:end], one.jacobians[log][begin:end, :, 2 * branch.count :]
                flat = (jacobian / system.sigma[own][:, np.newaxis]).reshape(-1, len(unknowns))
                hessian[np.ix_(unknowns, unknowns)] -= flat.T @ flat
                gradient[unknowns] -= flat.T @ (residual / system.sigma[own]).ravel()
                parts.append((own, unknowns, residual, jacobian))
            step = self._step(hessian, gradient, system.scale[-m:], system.values, LEFT_OUT)
            for own, unknowns, residual, jacobian in parts:
                found[number, own] = np.sum((residual - jacobian @ step[unknowns]) ** 2, axis=0)
        return found

    def _search(
        self, weights: str, tell: Callable[[str], None] | None, settled_at: float
    ) -> tuple[_System, list[Array], int, bool]:
        """Return the linear problem about the best point, the states of all stretches there, steps, and convergence."""
        count = self.fixed.shape[1]
        values = np.array([unknown.start for unknown in self.unknowns])
        states = self.start_states()
        sigma = np.ones(count)
        damping = 1e-4
        fine, self.substeps = self.substeps, self._coarse
        system = self._system(values, states, sigma)
        if not np.isfinite(system.hessian).all():
            raise InputError(
                "The motion cannot be simulated from its commands: it runs away with the values that least squares "
                "find. Check units of positions, commands and times, and the gains."
            )
        number, settled, weighted = 0, False, weights == "equal"
        while number < STEPS:
            number += 1
            step = self._step(system.hessian, system.gradient, system.scale, values, damping)
            hopeless = damping <= GENTLE and system.expected(step) < settled_at * system.merit
            tried = self._stepped(system, step, values, states)
            following = self._system(*tried, sigma)
            if tell is not None:
                tell(f"step {number}: error {following.rms:.6g} rad, gaps {following.gaps:.2g} rad")
            change = (system.merit - following.merit) / max(system.merit, 1e-300)
            if not change >= 0.0 and max(following.gaps, system.gaps) > CLOSED:
                # Gaps are carried along as if all were linear. Where that misleads, one simulation of the whole tells.
                closed = self.simulate(*tried)[1]
                if all(np.isfinite(one).all() for one in closed):
                    tried, following = (tried[0], closed), self._system(tried[0], closed, sigma)
                    change = (system.merit - following.merit) / max(system.merit, 1e-300)
            rough = damping <= GENTLE and -(ROUGH if self.law.ahead else SHARP_ROUGH) < change < 0.0
            if not change >= 0.0:
                damping = max(damping, 1e-6) * 8.0
                if system.gaps > CLOSED:
                    closed = self.simulate(values, states)[1]
                    if all(np.isfinite(one).all() for one in closed):
                        states = closed
                        system = self._system(values, states, sigma)
            else:
                damping = max(damping * 0.2, 1e-9)
                (values, states), system = tried, following
            coarse = self.substeps < fine
            enough = max(COARSE, settled_at) if coarse or not weighted else settled_at
            small = abs(change) < enough or damping > STEEP or hopeless or rough
            if small and system.gaps < CLOSED:
                if weighted and not coarse:
                    settled = True
                    break
                if not weighted:
                    sigma, weighted = np.maximum(system.rms_by_joint, 1e-9), True
                self.substeps, damping = fine, 1e-6
                system = self._system(values, states, sigma)
        if self.substeps < fine:
            self.substeps = fine
            system = self._system(values, states, sigma)
        return system, states, number, settled

    def _refined(self, system: _System, states: list[Array]) -> tuple[_System, list[Array]]:
        """Halve the simulation's steps until that moves no value; return the linear problem and the states there.

        The values are so near that one step of Gauss and Newton is enough each time.
        """
        longest = max(np.diff(log.t).max() for log in self.logs)
        least = SHOWN**2 * np.diag(self._covariance(system))
        values, moves = system.values, True
        while moves and longest >= 2.0 * FINEST_STEP * self.substeps:
            self.substeps *= 2
            system = self._system(values, states, system.sigma)
            step = self._step(system.hessian, system.gradient, system.scale, values, LEFT_OUT)
            moves = bool(np.any(step[-len(values) :] ** 2 > least))
            if moves:
                values, states = self._stepped(system, step, values, states)
        return (self._system(values, states, system.sigma) if moves else system), states

    def _system(self, values: Array, states: list[Array], sigma: Array) -> _System:
        with np.errstate(over="ignore", invalid="ignore"):
            return _System(self, self._grow_all(values, states), sigma, values)

    def _step(self, hessian: Array, gradient: Array, scale: Array, values: Array, damping: float) -> Array:
        """Return the step of starts and unknowns that the linear problem within the bounds gives."""
        scaled = hessian / np.outer(scale, scale)
        scaled[np.diag_indices_from(scaled)] += damping + 1e-12
        right = gradient / scale
        m = len(self.unknowns)
        factor = np.linalg.cholesky(scaled).T
        goal = np.linalg.solve(factor.T, right)
        free = np.linalg.solve(factor, goal) / scale
        lower, upper = self.bounds - values
        if (free[-m:] >= lower).all() and (free[-m:] <= upper).all():
            return np.asarray(free)
        low, high = np.full(len(free), -np.inf), np.full(len(free), np.inf)
        low[-m:], high[-m:] = lower, upper
        high = np.maximum(high, low + 1e-12)
        found = lsq_linear(factor, goal, (low * scale, high * scale), method="bvls", max_iter=200)
        return np.asarray(found.x / scale)

    def _stepped(self, system: _System, step: Array, values: Array, states: list[Array]) -> tuple[Array, list[Array]]:
        of_unknowns = step[-len(self.unknowns) :]
        moved = []
        for index, (own, grown) in enumerate(zip(states, system.grown, strict=True)):
            change = np.empty_like(own)
            for k, piece in enumerate(self.pieces):
                z = np.concatenate([step[system.place(index, piece.log)], of_unknowns[self.own_unknowns[index]]])
                change[k] = grown.alphas[k] + grown.betas[k] @ z
            moved.append(own + change)
        return np.clip(values + of_unknowns, *self.bounds), moved

    def _covariance(self, system: _System) -> Array:
        """Covariance of the unknowns: of scores that depend on each other as long as the residuals do.

        Newey and West 1987 with a window of four integrated correlation times, which is none for white residuals. An
        unknown at its bound counts as held there, with the variance that it would have if it were not.
        """
        m = len(self.unknowns)
        hessian = system.hessian
        size = len(hessian)
        scores, time, rows = system.scores()
        middle = np.zeros((size, size))
        for one in scores:
            middle += one.T @ one
            for lag in range(1, min(time, len(one) - 1) + 1):
                part = one[lag:].T @ one[:-lag]
                middle += (1.0 - lag / (time + 1.0)) * (part + part.T)
        lower, upper = self.bounds
        held = np.zeros(size, dtype=bool)
        held[size - m :] = ~((lower < system.values) & (system.values < upper))
        inside = np.ix_(~held, ~held)
        covariance = np.zeros((size, size))
        covariance[inside] = _sandwich(hessian[inside], middle[inside], rows)
        if held.any():
            covariance[held, held] = np.diag(_sandwich(hessian, middle, rows))[held]
        return np.asarray(covariance[-m:, -m:])


class _System:
    """The linear problem about a point: starts of logs, branch by branch, and the unknowns."""

    def __init__(self, problem: Shooting, grown: list[_Grown], sigma: Array, values: Array) -> None:
        self.problem, self.grown, self.sigma, self.values = problem, grown, sigma, values
        self.logs = len(problem.logs)
        self.offsets = np.concatenate([[0], np.cumsum([2 * b.count * self.logs for b in problem.branches])])
        m = len(problem.unknowns)
        size = int(self.offsets[-1]) + m
        self.hessian, self.gradient = np.zeros((size, size)), np.zeros(size)
        total, rows, squares = 0.0, 0, np.zeros(problem.fixed.shape[1])
        self.gaps = max(one.gaps for one in grown)
        for number, (branch, one) in enumerate(zip(problem.branches, grown, strict=True)):
            own = list(branch.coordinates)
            for log in range(self.logs):
                weight = 1.0 / sigma[own]
                residual = one.residuals[log] * weight
                jacobian = one.jacobians[log] * weight[:, np.newaxis]
                flat = jacobian.reshape(-1, jacobian.shape[-1])
                places = self.places(number, log)
                self.hessian[np.ix_(places, places)] += flat.T @ flat
                self.gradient[places] += flat.T @ residual.ravel()
                total += float(np.sum(residual**2))
                rows += residual.size
                squares[own] += np.sum(one.residuals[log] ** 2, axis=0)
        counted = sum(len(log.t) for log in problem.logs)
        for k, (unknown, value) in enumerate(zip(problem.unknowns, values, strict=True)):
            if np.isfinite(unknown.prior):
                place = size - m + k
                noise = total / max(rows, 1)
                self.hessian[place, place] += noise / unknown.prior**2
                self.gradient[place] += noise * (unknown.start - value) / unknown.prior**2
                total += noise * ((unknown.start - value) / unknown.prior) ** 2
        sizes = np.diag(self.hessian)
        self.scale = np.sqrt(np.maximum(sizes, 1e-12 * sizes.max()))
        self.rms_by_joint = np.sqrt(squares / counted)
        self.rms = float(np.sqrt(np.sum(squares) / (counted * len(squares))))
        # `residuals` are those of the condensed problem, in which the gaps are carried along.
        self.merit = total

    def expected(self, step: Array) -> float:
        """Return how much smaller a step makes the squared error, as far as that is quadratic."""
        return float(2.0 * self.gradient @ step - step @ self.hessian @ step)

    def place(self, branch: int, log: int) -> slice:
        """Return where the start of a log stands for a branch."""
        width = 2 * self.problem.branches[branch].count
        begin = int(self.offsets[branch]) + log * width
        return slice(begin, begin + width)

    def places(self, branch: int, log: int) -> NDArray[np.intp]:
        """Return where the start of a log and the unknowns of a branch stand."""
        own = self.place(branch, log)
        return np.concatenate([np.arange(own.start, own.stop), self.offsets[-1] + self.problem.own_unknowns[branch]])

    def scores(self) -> tuple[list[Array], int, int]:
        """Return for each log (S, size) scores, a window in rows, and the number of residuals of a joint."""
        found, longest = [], 0.0
        for log in range(self.logs):
            rows = len(self.problem.logs[log].t)
            scores = np.zeros((rows, len(self.gradient)))
            for number, (branch, one) in enumerate(zip(self.problem.branches, self.grown, strict=True)):
                weight = 1.0 / self.sigma[list(branch.coordinates)]
                jacobian = one.jacobians[log] * weight[:, np.newaxis]
                residual = one.residuals[log] * weight
                scores[:, self.places(number, log)] += np.einsum("sj,sjz->sz", residual, jacobian)
                for column in residual.T:
                    longest = max(longest, correlation_sum(column, rows // 4 + 1))
            found.append(scores)
        total = sum(len(log.t) for log in self.problem.logs)
        return found, int(np.ceil(4.0 * longest)), total


def _sandwich(hessian: Array, middle: Array, rows: int) -> Array:
    """Return the covariance that scores with this sum of products leave; infinite variances of what nothing shows."""
    scale = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    scaled = hessian / np.outer(scale, scale)
    factor = cho_factor(scaled + 1e-13 * np.eye(len(hessian)))
    half = cho_solve(factor, middle / np.outer(scale, scale))
    found = cho_solve(factor, half.T) / np.outer(scale, scale)
    found *= rows / max(rows - len(hessian), 1.0)
    # What no residual depends on has scores of zero, too, and would come out as known exactly.
    sizes, directions = eigenvectors(scaled)
    unseen = np.linalg.norm(directions[:, sizes < UNSEEN], axis=1) > 0.1
    found[unseen], found[:, unseen] = 0.0, 0.0
    found[unseen, unseen] = np.inf
    return np.asarray(found)
