"""Identification while the robot moves: samples in, physically possible parameters out."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.dynamics.threads import one_thread
from steelyard.errors import InputError, SolverError
from steelyard.estimators import ConstantPullbackPrior
from steelyard.estimators.cross_validation import term_deviations
from steelyard.estimators.estimator import proved_estimate
from steelyard.estimators.fitting_problems import GAP, WarmFit
from steelyard.estimators.physical_prior import PhysicalPrior, physical_prior
from steelyard.estimators.plausible_fit import allowed_share, set_with_habits, untested_weight
from steelyard.estimators.prior import PreparedPrior, Prior, distance_from
from steelyard.estimators.reduced_fit import fit_reduced
from steelyard.estimators.reduced_regression import ReducedRegression
from steelyard.feasibility import FeasibleSet, correct
from steelyard.feasibility.bounds.quantities import standard_errors
from steelyard.files.arguments import read_number, read_whole, real_array
from steelyard.identification.late_logs import MATTERS, in_half_widths
from steelyard.recording import Samples
from steelyard.recording.even import PERIODS_FILLED, TIME_FILLED
from steelyard.recording.formats.log_file import reading_as
from steelyard.regression import Estimate, Factor, Information, ParameterCovariance
from steelyard.regression.factor import Reduced, column_lengths, is_well_conditioned, solve
from steelyard.regression.information import FIRST_DEVIATION, inverse_deviations
from steelyard.regression.parameter_covariance import NORMAL
from steelyard.regression.reduction import rows_of_entries

from .causal_filter import CausalMotionFilter
from .change_detector import Change, ChangeDetector, Prediction, Stretches
from .earlier_robots import MOST_EARLIER, RECALLED, RECALLING, EarlierRobot
from .even_stream import EvenStream, Stretch
from .first_stretch import TOGETHER, EarlierPart, FirstStretch
from .moved_torques import MovedTorques
from .position_jumps import PositionJumps
from .position_noise import noise_bias, noise_of_steps
from .recent_motion import RecentMotion
from .running_information import PARTS, CountedRows, information_of, information_state
from .saved_state import REMEDY, read_state, state_of, take_over, write_state
from .source_project import generate_online
from .stream_faults import out_of_step, said_of_late, wrong_signs

__all__ = ["OnlineEstimate", "OnlineEstimator"]

Array = NDArray[np.float64]

BATCH = 10
"""Samples that are reduced together where they come one by one: 10 ms at 1 kHz. One at a time takes five times as long
in all, and no answer could be had more often than it is solved for."""

GROWTH = 1.05
"""By which the number of rows grows until what changes slowly (the weights of the joints, the usual size of friction)
is computed anew; it costs as much as a solution."""

SCALING = 4.0
"""By which it grows until masses that are not known are scaled anew, which makes a new feasible set and takes 50 ms
(seven joints); only for robots whose description leaves masses open."""

SHARING = 1.3
"""By which it grows until the weight of the prior is chosen anew, which takes some 30 ms (seven joints)."""

FEW = 20.0
"""Rows for each base parameter below which the residual tells little of the noise."""

START = 0.1
"""Terms start at this part of their usual deviation: anywhere inside does."""

DEPTHS = (10.0, 3.0, 1.1)
"""Margins by which a search starts inside the set, where the prior is not inside: the first of them that has room."""

LEAST_DEVIATION = 1e-4
"""The least deviation of the torques, relative to them: no drive tells its torque better. Data of a simulation without
noise would count for a million times more than the prior, and what only the prior tells would drown in rounding."""

MISFIT = 0.2
"""Part of the weighted torques that an answer leaves, from which it is told where least squares leave less than half of
that: what is assumed of the robot beyond what bodies can be then makes most of the error."""

UNEXPLAINED = 0.5
"""Part of the weighted torques that least squares leave, from which it is told that something is wrong: a UR10 and a
Gen3 leave 0.08, and 0.8 and 0.25 where the columns of their torques stand in another order."""

NOISE_DEVIATIONS = 3.0
"""Standard deviations of the noise of a velocity below which its sign, and so that of friction, is not certain."""

DETECTION = 0.05
"""s over which residuals are averaged to notice a change; see `ChangeDetector`."""

DOUBT = 1.0
"""s of the newest samples that are not yet counted as data from before a change, as the change may already be in
them."""

MOST_CHANGES = 100
"""The most changes that are held, the first and the newest: each holds the data before it, 0.6 MB for seven joints with
drives, and a robot that picks and places all day changes some thousand times."""

TOLD_CHANGES = 5
"""The most changes with a sentence of their own."""

LONGEST_DELAY = 1.0
"""s; a delay of the torques beyond it is one in another unit."""

TELLING = 10.0
"""s of samples from which delays and noise of the positions are told. *Measured* on twelve sound streams of a WAM that
were asked each second for 20 s: nothing from then on; in the first 2 s noise in 19 answers, while parameters hardly
show, and at 3 and 4 s delays of 1 and 2 ms in four."""

RELEARNING = 2.0
"""s after the start, and after a change, before the next change is looked for: the estimate must be one by then."""


STATE = (
    "_stream",
    "_positions",
    "_late",
    "_to_skip",
    "_recent",
    "_continues",
    "_at_limit",
    "_counted",
    "_doubtful",
    "_detector",
    "_left",
    "_t",
    "_taken",
    "_moved",
    "_answered",
    "_looked",
    "_share",
    "_shared_rows",
    "_at_rest",
    "_stuck",
    "_possible",
    "_answer_weights",
    "_reference",
    "_scaled_rows",
    "change_count",
    "robot",
    "_met",
)
"""The attributes that samples change, and that a file holds as they are; for the others see `_whole_state`."""


@dataclass(frozen=True, eq=False)
class OnlineEstimate:
    """The estimate of the robot at one moment, with its uncertainty.

    Attributes
    ----------
    t : float
        Time of the newest sample that counts; NaN before there is one. The filter holds samples back by
        `OnlineEstimator.delay`.
    base : ndarray
        (n_b,).
    parameters : ndarray
        (n,), checked to lie within the feasible set.
    converged : bool
        Whether they are those of the least objective, and not only possible ones on the way to it.
    remark : str
        What is to be said of them, in a sentence; empty where they are the optimum.
    rows : int
        On how many rows of joints they rest.
    weights : ndarray
        (N,), of the joints.
    prior : Prior
        What they stay near to, with `prior_weight`: ``steelyard.fit(estimator.information, estimator.feasible_set,
        weights=..., prior=..., prior_weight=...)`` solves the same problem.
    prior_weight : float
    steps : int
        Newton steps.
    seconds : float
        That the solution took.

    Examples
    --------
    >>> import steelyard as sy
    >>> estimator = sy.OnlineEstimator(sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")])))
    >>> answer = estimator.estimate()
    >>> answer.rows, answer.remark
    (0, 'No samples count yet; the parameters are those of the prior.')
    """

    t: float
    base: Array = field(repr=False)
    parameters: Array = field(repr=False)
    converged: bool
    remark: str
    rows: int
    weights: Array = field(repr=False)
    prior: Prior = field(repr=False)
    prior_weight: float
    steps: int
    seconds: float


@dataclass(frozen=True, eq=False)
class _Examined:
    """What least squares of the samples so far are, how sure, and what the newest tell of faults of the stream."""

    center: Array
    covariance: ParameterCovariance
    remarks: tuple[str, ...]


@dataclass(eq=False)
class _Slow:
    """Values that change slowly from one solution to the next."""

    rows: int
    weights: Array
    deviations: Array
    prior: Prior
    prepared: PreparedPrior
    prior_weight: float


class OnlineEstimator:
    """Identifies a robot while it moves.

    Samples go in as they are measured (`update`); physically possible parameters come out whenever they are asked for
    (`estimate`), in a few milliseconds, since each search starts where the last one ended. The answer is that of the
    plausible fit of :func:`steelyard.identify`: least squares within the feasible set, near what is known of the robot.

    Positions go through the filter of :class:`steelyard.Recording`, which is run with a delay instead of backwards; the
    torque waits for them. A joint at rest tells nothing of its friction, and its rows are left out where friction
    jumps. Samples that are late, repeated, missing or no numbers are left out, interpolated or bridged, as are those
    with a position that no joint reaches in one sample; `remarks` tell of them.

    It belongs to one thread at a time: whoever updates it in one and asks in another one takes a lock for both. `save`
    keeps it while the robot is switched off.

    Parameters
    ----------
    model : Model
    feasible_set : FeasibleSet, optional
        With constraints of your own; those of the prior are added.
    rate : float
        Hz, of the samples; only their mean: each sample comes with its time.
    cutoff, order : float, int
        Hz, of the Butterworth filter of the positions; ten times the highest frequency of the motion, or as much as the
        encoders allow. Lower cutoffs make the answer later.
    forget : float, optional
        Time constant in s, by which older samples count less; nothing is forgotten where absent. A joint that is at
        rest forgets nothing.
    window : float, optional
        s of the newest samples that count alone (up to an eighth more), eight samples at least; all where absent.
    detect_changes : bool
        Whether to notice when the robot is no longer the one that was estimated (see `ChangeDetector` for the rule),
        and to begin anew then, near the last estimate. A robot that is again as it was before a change, as where
        something is put down, is known again within a second of motion, and its estimate goes on. `robot` is the number
        of the robot that is there, 0 for the first. `changes` holds what was noticed, of more than a hundred changes
        the first and the newest; `change_count` is their number. What changes in the first 4 s of motion is noticed
        after 8 s, by looking back; `is_of_one_robot` tells whether this was done.
    prior : PhysicalPrior, optional
        What is known of the links; gathered from the robot by default.
    prior_weight : float or "auto"
        By default the largest up to 100 for each ten thousand rows with which it takes no more from the fit than noise
        does.
    weights : "joint", None or array_like
        Of the joints, as in :func:`steelyard.least_squares`.
    longest_gap : float, optional
        s up to which missing samples are interpolated; over longer gaps the filter starts anew. By default 0.02 s, or
        five sample times where these are longer.
    torque_delay : float or (N,), optional
        s, by which the torques are logged later than the positions; negative where they are logged earlier. They are
        moved by it, between samples by cubic interpolation, as by ``delay`` in ``[processing]``. Not to be mistaken for
        `delay`, which is that of the answer.
    least_speed : float
        rad/s or m/s, below which a joint counts as at rest; at least three standard deviations of the noise of its
        velocity, where that is filtered.

    Raises
    ------
    InputError
        For options that make no sense, a robot whose lengths are symbols, or a term that needs a channel beside the
        motion.

    Examples
    --------
    >>> import steelyard as sy
    >>> arm = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")], name="arm")
    >>> model = sy.Model(arm.with_terms(sy.Viscous()))
    >>> body = sy.Inertia.from_com(3.0, [-0.2, 0.0, 0.0], 0.02 * np.eye(3)).parameters
    >>> true = np.concatenate([body, [0.5], body, [0.3]])
    >>> estimator = sy.OnlineEstimator(model)
    >>> for k in range(3000):
    ...     t, pace = k / 1000, np.array([3.0, 4.0])
    ...     q, dq, ddq = np.sin(pace * t), pace * np.cos(pace * t), -(pace**2) * np.sin(pace * t)
    ...     estimator.update(t, q, model.inverse_dynamics(q, dq, ddq, true))
    >>> answer = estimator.estimate()
    >>> bool(estimator.feasible_set.contains(answer.parameters)), answer.converged
    (True, True)
    >>> error = estimator.information.relative_error(answer.base)
    >>> bool(error < 0.02)
    True
    """

    def __init__(
        self,
        model: Model,
        feasible_set: FeasibleSet | None = None,
        *,
        rate: float = 1000.0,
        cutoff: float = 10.0,
        order: int = 3,
        forget: float | None = None,
        window: float | None = None,
        detect_changes: bool = False,
        prior: PhysicalPrior | None = None,
        prior_weight: float | Literal["auto"] = "auto",
        weights: Literal["joint"] | ArrayLike | None = "joint",
        longest_gap: float | None = None,
        torque_delay: float | ArrayLike = 0.0,
        least_speed: float = 1e-3,
    ) -> None:
        model.refuse_channels()
        rate, cutoff = (
            read_number(a, what, "a positive number", above=0) for a, what in ((rate, "rate"), (cutoff, "cutoff"))
        )
        if longest_gap is not None:
            expected = f"a number of s longer than the {1.0 / rate:.4g} s between two samples"
            longest_gap = read_number(longest_gap, "longest_gap", expected, above=1.0 / rate)
        if forget is not None:
            expected = "a positive number of s, or absent where nothing is forgotten"
            forget = read_number(forget, "forget", expected, above=0)
        if window is not None:
            expected = f"a number of s of at least {PARTS} samples, or absent where all count"
            window = read_number(window, "window", expected, least=PARTS / rate)
        order = read_whole(order, "order", 1)
        self._torque_delay = _torque_delays(torque_delay, model.dof)
        if feasible_set is not None and feasible_set.model is not model:
            raise InputError("The feasible set is of another model; make it of the model that is estimated.")
        self.model, self.rate, self.detect_changes = model, rate, bool(detect_changes)
        self._given_set = FeasibleSet(model) if feasible_set is None else feasible_set
        self._known = physical_prior(model, self._given_set.constraints) if prior is None else prior
        self._prior_weight: float | None = None
        if not (isinstance(prior_weight, str) and prior_weight == "auto"):
            self._prior_weight = read_number(prior_weight, "prior_weight", 'a positive number or "auto"', above=0)
        self._weights = weights
        Information.empty(model).joint_weights(weights)  # checks them
        self._least_speed = read_number(least_speed, "least_speed", "a speed, at least 0", least=0)
        self._given = {
            "rate": rate,
            "cutoff": cutoff,
            "order": order,
            "forget": forget,
            "window": window,
            "detect_changes": self.detect_changes,
            "prior_weight": "auto" if self._prior_weight is None else self._prior_weight,
            "weights": weights if weights is None or isinstance(weights, str) else np.asarray(weights, dtype=float),
            "longest_gap": longest_gap,
            "torque_delay": self._torque_delay,
            "least_speed": self._least_speed,
        }
        self._needed = {"feasible_set": feasible_set is not None, "prior": prior is not None}
        self._jumps = _jumping_rows(model)
        self._options = (rate, cutoff, order)
        self._longest_gap = max(PERIODS_FILLED / self.rate, TIME_FILLED) if longest_gap is None else longest_gap
        self._filter: CausalMotionFilter | None = None
        self._measured: int | None = None
        self._rows = np.zeros((BATCH, 0))
        self._waiting = 0
        keep = 1.0 if forget is None else float(np.exp(-1.0 / (forget * rate)))
        samples = None if window is None else round(window * rate)
        self._new_rows: Callable[[], CountedRows] = lambda: CountedRows(model, keep, samples)
        self.changes: list[Change] = []
        self.change_count = 0
        links = np.asarray(self._given_set.link_columns)
        self._of_links = np.isin(np.arange(model.parameter_count), links)
        self._possible: Array | None = None
        self._stuck = False
        self._scale_known(None)
        self.restart()

    def __repr__(self) -> str:
        rows = sum(f.count for f in self.factors())
        return f"OnlineEstimator({self.model.robot.name}, {rows} rows of {self.model.dof} joints, to {self._t:.13g} s)"

    # Samples

    @property
    def delay(self) -> float:
        """s by which the newest sample that counts is older than the newest that came."""
        filtered = 0 if self._filter is None else self._filter.delay
        return (filtered + (0 if self._moved_torques is None else self._moved_torques.ahead)) / self.rate

    def update(
        self,
        t: float | ArrayLike,
        q: ArrayLike,
        torque: ArrayLike,
        dq: ArrayLike | None = None,
        ddq: ArrayLike | None = None,
    ) -> None:
        """Take one sample, or some that follow each other.

        Parameters
        ----------
        t : float or (S,)
            s, by any clock.
        q, torque : (N,) or (S, N)
            Joint positions, and torques; torques that are NaN are missing.
        dq : (N,) or (S, N), optional
            Measured velocities, which are filtered as the positions are; derived from the positions where absent.
        ddq : (N,) or (S, N), optional
            Accelerations. With them, positions, velocities and accelerations are taken as they are, without a filter or
            delay.

        Raises
        ------
        InputError
            If arrays do not fit each other or the robot, or derivatives come with some samples only.
        """
        given = [q] if dq is None else [q, dq] if ddq is None else [q, dq, ddq]
        if ddq is not None and dq is None:
            raise InputError("ddq was given without dq; give both, or neither.")
        if self._measured is None:
            self._rows_of(t, (*given, torque))  # what is refused decides nothing
            self._expect(len(given) - 1)
        if self._measured != len(given) - 1:
            raise InputError(
                f"The first samples came with {self._measured} derivatives of the positions, these with "
                f"{len(given) - 1}; give the same of every sample."
            )
        if np.ndim(t) == 0:
            row, N = self._rows[self._waiting], self.model.dof
            if all(type(x) is np.ndarray and x.dtype == np.float64 and x.shape == (N,) for x in (*given, torque)):
                row[0] = t if type(t) is float else real_array(t, "t")
                for place, values in enumerate((*given, torque)):
                    row[1 + N * place : 1 + N * (place + 1)] = values
            else:
                row[:] = self._rows_of(t, (*given, torque))[0]
            self._waiting += 1
            if self._waiting == BATCH:
                self._take(self._rows.copy())
            return
        whole = self._rows_of(t, (*given, torque))
        if self._waiting:
            whole = np.vstack([self._rows[: self._waiting], whole])
        size = self._detector.length if self.detect_changes else 100 * BATCH
        for start in range(0, len(whole), size):
            self._take(whole[start : start + size])

    def _expect(self, derivatives: int) -> None:
        self._measured = derivatives
        if derivatives < 2:
            self._filter = CausalMotionFilter(*self._options, self.model.dof, derivatives)
        self._rows = np.empty((BATCH, 1 + self.model.dof * (derivatives + 2)))

    def flush(self) -> None:
        """Count the samples that wait for a whole batch of ten; not those that the filter holds back."""
        if self._waiting:
            self._take(self._rows[: self._waiting].copy())

    def restart(self) -> None:
        """Forget all samples, and what was noticed; keep what is known of the robot."""
        self._waiting = 0
        # With a new stream the filter begins anew, too, which holds samples back that would count with those to come.
        self._stream = EvenStream(self.rate, self.model.dof, self._longest_gap)
        rotates = np.array([unit == "rad" for unit in self.model.robot.position_units])
        self._positions = PositionJumps(self.rate, rotates, self._longest_gap)
        self._moved_torques = MovedTorques(self.rate, self._torque_delay) if self._torque_delay.any() else None
        self._at_limit = np.zeros(self.model.dof, dtype=int)
        self._detector = ChangeDetector(self.model.dof, max(1, round(DETECTION * self.rate)))
        self._late = self._nothing_late()
        self._to_skip = 0
        self._answer_weights: Array | None = None
        self._begin()
        self.changes, self.change_count = [], 0
        self.robot, self._met = 0, 1
        self._earlier: list[EarlierRobot] = []

    def _rows_of(self, t: float | ArrayLike, given: tuple[ArrayLike, ...]) -> Array:
        times = np.atleast_1d(real_array(t, "t"))
        if times.ndim > 1:
            raise InputError(f"t has the shape {np.shape(t)}; expected a number, or (S,), one number for each sample.")
        parts = [times[:, None]]
        for name, values in zip((*("q", "dq", "ddq")[: len(given) - 1], "torque"), given, strict=True):
            array = np.atleast_2d(real_array(values, name))
            if array.shape != (len(times), self.model.dof):
                raise InputError(
                    f"{name} has the shape {np.shape(values)}; expected ({len(times)}, {self.model.dof}), one row for "
                    f"each of {len(times)} times and one column for each joint of {self.model.robot.name}."
                )
            parts.append(array)
        return np.hstack(parts)

    def _begin(self) -> None:
        self._counted = self._new_rows()
        self._certain = self._new_rows() if self.detect_changes else None
        self._first = FirstStretch(self.model, self._detector.length) if self.detect_changes else None
        self._doubtful: list[tuple[int, list[Array], NDArray[np.bool_]]] = []
        self._slow: _Slow | None = None
        self._prediction: Prediction | None = None
        self._left = np.zeros(2)  # parts of the weighted torques that the answer leaves, and least squares
        self._t = float("nan")
        # What has passed is counted in samples: clocks jump, and a gap teaches nothing.
        self._taken, self._moved, self._answered, self._looked = 0, 0, 0, 0
        self._share, self._shared_rows = 1.0, 0
        self._at_rest = 0
        self._recent, self._continues = RecentMotion(self.model.dof, self.rate), False
        self._examined: _Examined | None = None

    def _take(self, rows: Array) -> None:
        self._waiting = 0
        with one_thread():
            # Only filters make accelerations of jumps.
            for jumped, part in [(False, rows)] if self._filter is None else self._positions.add(rows):
                if jumped:
                    self._stream.begin_anew()
                for stretch in self._stream.add(part):
                    moved = stretch if self._moved_torques is None else self._moved_torques.add(stretch)
                    if moved is not None:
                        self._filtered(moved)

    def _filtered(self, stretch: Stretch) -> None:
        N = self.model.dof
        if self._filter is None:
            q, dq, ddq = (stretch.values[:, k * N : (k + 1) * N] for k in range(3))
            self._continues &= not stretch.begins
            used = self._without_limits(stretch.torque, stretch.used, len(q))
            self._reduce(stretch.t, q, dq, ddq, stretch.torque, used, np.full_like(q, self._least_speed))
            return
        if stretch.begins:
            self._continues = False
            self._filter.restart()
            self._late = self._nothing_late()
            self._to_skip = self._filter.delay
        late = [
            np.concatenate(pair) for pair in zip(self._late, (stretch.t, stretch.torque, stretch.used), strict=True)
        ]
        skip = min(self._to_skip, len(late[0]))
        self._to_skip -= skip
        motion = self._filter.add(stretch.values)
        end = skip + len(motion)
        t, torque, used = (each[skip:end] for each in late)
        if len(motion):
            used = self._without_limits(late[1][skip:], used, len(motion))
        self._late = (late[0][end:], late[1][end:], late[2][end:])
        if len(motion):
            slowest = np.maximum(self._least_speed, NOISE_DEVIATIONS * self._filter.velocity_noise)
            self._reduce(t, motion[:, 0], motion[:, 1], motion[:, 2], torque, used, slowest)

    def _without_limits(self, torque: Array, used: NDArray[np.bool_], count: int) -> NDArray[np.bool_]:
        """Return which of the first rows (count, N) count where torques at a limit do not, by those after them, too."""
        clipped = self._stream.limits.near(torque, count)
        if clipped is None:
            return used
        self._at_limit += np.sum(used & clipped, axis=0)
        return np.asarray(used & ~clipped)

    def _nothing_late(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Times, torques and which of them count, that wait for the filter: none."""
        N = self.model.dof
        return np.zeros(0), np.zeros((0, N)), np.zeros((0, N), dtype=bool)

    def _reduce(
        self, t: Array, q: Array, dq: Array, ddq: Array, torque: Array, used: NDArray[np.bool_], slowest: Array
    ) -> None:
        known, self._examined = used, None
        if self._jumps.any():
            resting = self._jumps & (np.abs(dq) < slowest)
            if resting.any():
                self._at_rest += int(np.sum(resting & used))
                used = used & ~resting
        self._recent.add(not self._continues, t, (q, dq, ddq, torque), known, used)
        self._continues = True
        rows = rows_of_entries(self.model, self.model.base_columns.entries(q, dq, ddq), torque)
        self._t = float(t[-1])
        self._taken += len(t)
        moves = np.any(np.abs(dq) >= slowest, axis=1)
        self._moved += int(np.count_nonzero(moves))
        if self._certain is not None:
            if self._has_changed(t, rows, used, moves):
                return
            self._doubt(rows, used)
        self._counted.add(rows, used)
        if self._first is not None:
            self._first.add(t, (q, dq, ddq, torque), used, moves)
            if self._first.moving >= self._first.most:
                self._look_back()

    # Changes

    def _has_changed(self, t: Array, rows: list[Array], used: NDArray[np.bool_], moves: NDArray[np.bool_]) -> bool:
        assert self._certain is not None
        self._recall(rows, used)
        if self._taken > RELEARNING * self.rate:
            if self._prediction is None or self._taken - self._answered > DETECTION * self.rate:
                self.estimate()
            if self._prediction is not None:
                residuals = self._prediction.residuals(self.model, rows, used, self._detector.length)
                if self._detector.add(t, residuals, used, moves):
                    self._alarmed(float(t[-1]))
                    return True
        return False

    def _doubt(self, rows: list[Array], used: NDArray[np.bool_]) -> None:
        """Count rows as data from before a change when they are a second old."""
        assert self._certain is not None
        self._doubtful.append((len(used), rows, used))
        waiting = sum(count for count, _, _ in self._doubtful)
        while waiting - self._doubtful[0][0] >= DOUBT * self.rate:
            count, old, mask = self._doubtful.pop(0)
            waiting -= count
            self._certain.add(old, mask)

    def _alarmed(self, t: float) -> None:
        """Begin anew after an alarm, which a change may have raised that came before the robot was known."""
        began, shares, first = self._detector.began, self._detector.shares, self._first
        earlier = self._earlier_part(shares, round(DOUBT * self.rate))
        if first is None or earlier is None:
            self._begin_after(t, began, shares)
        else:
            self._divide(t, first, earlier)
            self._first = first.after(earlier.end)

    def _look_back(self) -> None:
        """See whether the first samples were of another robot; if so, go on with those that are of this one."""
        first, earlier = self._first, self._earlier_part()
        if first is not None and earlier is not None:
            self._divide(self._t, first, earlier)
        elif self._prediction is None:  # without torques nothing is known
            self._first = FirstStretch(self.model, self._detector.length)
            return
        self._first = None

    def _earlier_part(self, alarm: Array | None = None, newest: int = 0) -> EarlierPart | None:
        """Return which of the first samples are of another robot, see `FirstStretch.earlier_part`."""
        if self._first is None:
            return None
        self.estimate()
        slow, search, prediction = self._slow, self._search, self._prediction
        if slow is None or prediction is None:
            return None
        variance = _variance(self._counted.information(batch_means=False).reduced(slow.weights))
        start, multipliers = search.start, search.multipliers

        def answered(problem: Reduced) -> Array:
            search.begin(self._inside(slow.deviations))
            found = search.solve(problem.R, problem.rho, variance, slow.prepared, slow.prior_weight)
            search.start, search.multipliers = start, multipliers
            return np.asarray(self._set.K @ found.parameters)

        # At the very edge matrices are singular to rounding.
        with contextlib.suppress(np.linalg.LinAlgError, SolverError):
            return self._first.earlier_part(slow.weights, prediction.answer, answered, alarm, newest)
        search.start, search.multipliers = start, multipliers
        return None

    def _divide(self, t: float, first: FirstStretch, earlier: EarlierPart) -> None:
        """Begin anew at time t as if a change among the first samples had been noticed when it came."""
        self._begin()
        self._certain = self._counted
        if earlier.is_of_one:
            self._count_again(first, 0, earlier.count)
            self.estimate()
        began = float(first.samples(slice(earlier.count - 1, earlier.count))[0][0])
        self._detector.usual, self._detector.seen = earlier.usual, earlier.seen
        self._begin_after(t, began, earlier.shares)
        if not earlier.is_of_one and self.robot == 1:  # the first of which anything is known
            self.robot, self._met = 0, 1
            self.changes[-1] = replace(self.changes[-1], robots=(0, 0))
        self._count_again(first, earlier.end, first.count)

    def _count_again(self, first: FirstStretch, begin: int, end: int) -> None:
        """Count some of the first samples."""
        start = begin
        while start < end:
            # The newest ones in stretches, as they come: what is in doubt is told apart by these.
            size = first.length * (1 if end - start <= 2 * TOGETHER * first.length else TOGETHER)
            t, rows, used = first.samples(slice(start, min(start + size, end)))
            start += size
            self._counted.add(rows, used)
            if self._certain is not self._counted:
                self._doubt(rows, used)
            self._taken += len(t)
            self._t = float(t[-1])

    def _begin_after(self, t: float, began: float, shares: Array) -> None:
        """Begin anew after a change, near the robot that was estimated before."""
        assert self._certain is not None
        detector, names = self._detector, self.model.robot.joint_names
        order = [int(k) for k in np.argsort(-shares) if shares[k] > 0.1 * shares.max()]
        if len(self.changes) == MOST_CHANGES:
            del self.changes[1]  # the first holds the robot as it was, to which a payload is compared
        left = self._known_by(self._certain)
        before = self._certain.information() if left is None else left.information  # which is kept there
        told, robots = tuple(names[k] for k in order), (self.robot, self._met)
        self.changes.append(Change(began, t, told, before, robots))
        self.change_count += 1
        for one in self._earlier:
            one.begin()
        self._earlier += [] if left is None else [left]
        if len(self._earlier) > MOST_EARLIER:
            self._earlier.remove(next(one for one in self._earlier if one.number))
        self.robot, self._met = self._met, self._met + 1
        detector.rest()
        if self._answer_weights is not None and self._possible is not None:
            self._reference = np.where(self._of_links, self._possible, np.nan)
        self._begin()
        self._t = t

    def _known_by(self, rows: CountedRows) -> EarlierRobot | None:
        """Return what is known of the robot that is there, by these rows of it; None where there are none."""
        information = rows.information(batch_means=False)
        possible, weights, detector = self._possible, self._answer_weights, self._detector
        if not information.count or possible is None or weights is None:
            return None
        return EarlierRobot(
            self.robot,
            rows,
            Prediction.of(information.reduced(weights), self._set.K @ possible, weights),
            detector.usual.copy(),
            detector.seen.copy(),
            self._reference,
            possible,
            weights,
            Stretches(self.model.dof, detector.length),
        )

    def _recall(self, rows: list[Array], used: NDArray[np.bool_]) -> None:
        """Go on with an earlier robot where it has come back."""
        if not self._earlier or self._looked > RECALLING * self.rate:
            return
        assert self._certain is not None
        names = self.model.robot.joint_names
        joints = [names.index(name) for name in self.changes[-1].joint_names]
        self._looked += int(used[:, joints].all(axis=1).sum())  # a robot at rest does not show which one it is
        ended = [one.look(self.model, rows, used) for one in self._earlier]
        if not ended[0]:  # as those of all of them
            return
        shares = [one.share(joints) for one in self._earlier]
        best = int(np.argmin(shares))
        if not np.isfinite(shares[best]):
            return
        # Slow motion hides payloads: where what was learned since the change predicts it as well, nothing is told.
        since_then = self._known_by(self._certain)
        if since_then is not None:
            for _, old, mask in [*self._doubtful, (len(used), rows, used)]:
                since_then.look(self.model, old, mask)
        if since_then is None or not np.isfinite(since_then.share(joints)):
            self._go_on_with(self._earlier.pop(best))

    def _go_on_with(self, robot: EarlierRobot) -> None:
        """Take an earlier robot for the one that is there, with the newest rows, which speak for it."""
        # No rows of the stretch before those, in which it may not have been back.
        after = np.cumsum([count for count, _, _ in self._doubtful[::-1]])
        shown = int(np.sum(after <= (RECALLED - 1) * self._detector.length))
        newest, t = self._doubtful[len(self._doubtful) - shown :], self._t
        self._begin()
        self._t, self._doubtful = t, newest
        self._certain, self._counted, self._first = robot.rows, robot.rows.copy(), None
        for _, old, mask in newest:
            self._counted.add(old, mask)
        self._prediction, self._reference, self._answer_weights = robot.prediction, robot.reference, robot.weights
        if self._search.inside(robot.parameters):
            self._possible = robot.parameters
            self._search.begin(robot.parameters)
        self._detector.rest()
        self._detector.usual, self._detector.seen = robot.usual, robot.seen
        # It is known already, so that changes are looked for at once, and no other robot.
        self._taken = self._looked = int(RECALLING * self.rate) + 1
        last = self.changes[-1]
        self.changes[-1] = replace(last, robots=(last.robots[0], robot.number), known=True)
        self._met, self.robot = self._met - 1, robot.number

    # Answers

    @property
    def time(self) -> float:
        """Time of the newest sample that counts; NaN before there is one."""
        return self._t

    def factors(self) -> tuple[Factor, ...]:
        """The triangular factors of `information`, one for each joint, without sums of neighbouring rows: at once."""
        return self._counted.information(batch_means=False).factors

    @property
    def information(self) -> Information:
        """The Information of the samples that count at present."""
        with one_thread():
            return self._counted.information()

    @property
    def is_of_one_robot(self) -> bool:
        """Whether all samples that count are known to be of one robot: it has moved for 8 s and no change was found.

        False where changes are not looked for.
        """
        return self.detect_changes and self._first is None

    @property
    def first_robot(self) -> Information | None:
        """What was learned of the first robot, while `robot` is another one; None while it is the first."""
        if not self.robot:
            return None
        return next((one.information for one in self._earlier if not one.number), self.changes[0].before)

    @property
    def feasible_set(self) -> FeasibleSet:
        """The set in which answers lie: the conditions that were given, and those of the prior."""
        return self._set

    @property
    def stream_counts(self) -> dict[str, int]:
        """The number of samples that came, and of those that were left out or mended, by reason."""
        return self._stream.counts | self._positions.counts

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the user should know of the samples, in sentences; first after new ones it takes some 0.1 s."""
        found = [*self._stream.remarks(), *self._positions.remarks()]
        if self._at_rest:
            found.append(
                f"{self._at_rest} rows of joints that moved slower than {self._least_speed:g} rad/s (or m/s), or than "
                "their encoders tell, were left out, since friction at rest is not that of motion."
            )
        names = self.model.robot.joint_names
        dead = self._stream.never_changes()
        for joints, what in (
            (
                (self._at_limit > 0) & self._stream.limits.known & ~dead,
                "stands at its largest or least value in {:.2g} of the newest samples",
            ),
            (dead, "never changes"),
        ):
            if joints.any():
                part = what.format(self._stream.at_limit()[joints].max())
                found.append(
                    f"The torque of {', '.join(np.array(names)[joints])} {part} while the joint moves, as where a "
                    f"sensor or a drive is dead or at its limit; {self._at_limit[joints].sum()} rows of joints then, "
                    "and just before and after, were left out."
                )
        if self._left[0] > MISFIT and self._left[1] < 0.5 * self._left[0]:
            found.append(
                f"The last answer leaves {self._left[0]:.2g} of the torques and least squares {self._left[1]:.2g}: "
                "this robot is not what its description or kinematics make credible, or torques or positions have "
                "another unit or sign. State its masses in the description, or give `prior`."
            )
        if self._moved and self._left[1] > UNEXPLAINED:  # at rest noise may be all there is
            found.append(
                f"Least squares leave {self._left[1]:.2g} of the torques: the model does not describe this motion. "
                "See whether positions are in rad and m, and whether positions and torques are of the same joints, of "
                "the same sign and of the same time; `steelyard doctor` examines a log of them."
            )
        if self._answer_weights is not None:
            found += self._examine(self._answer_weights).remarks
        if self._first is not None and self._taken:
            found.append(
                f"Of the robot that is there {self._first.moving / self.rate:.2g} s of motion count so far. A change "
                f"meanwhile is noticed after {self._first.most / self.rate:.2g} s at the latest; until then the "
                "estimate may be of two robots."
            )
        told = self.changes
        if self.change_count > TOLD_CHANGES:
            told = told[-1:]
            found.append(f"The robot changed {self.change_count} times, the first time at {self.changes[0].t:.13g} s.")
        found += map(_said_of, told)
        return tuple(found)

    def _examine(self, weights: Array) -> _Examined:
        """Look for faults of the stream that hardly show in its errors, and let those that move the numbers count."""
        if self._examined is not None:
            return self._examined
        remarks: list[str] = []
        with one_thread():
            info, center, covariance = self._covariance_with(weights)
            stretches = self._recent.stretches()
            if stretches and info.count:
                base = center if self._possible is None else self._set.K @ self._possible
                early = self._recent.seconds < TELLING
                late = None if early else out_of_step(self.model, info, weights, stretches, self._cutoff)
                remarks += wrong_signs(self.model, info, base, stretches)
                if late is not None:
                    remarks.append(said_of_late(late, self._torque_delay, self.model.robot.joint_names))
                noise = self._acceleration_noise(stretches)
                bias = noise_bias(self.model, info, weights, center, stretches, noise)
                remarks += () if early else self._noise_remark(noise, bias, covariance, stretches)
                for change in (bias, *([] if late is None else [late.change])):
                    covariance = covariance.with_error(change)
        self._examined = _Examined(center, covariance, tuple(remarks))
        return self._examined

    @property
    def _cutoff(self) -> float | None:
        """Hz, of the filter of the positions; None where there is none."""
        return None if self._filter is None else self._options[1]

    def _acceleration_noise(self, stretches: Sequence[Samples]) -> Array:
        """Return the standard deviation (N,) of what the noise of the encoders makes of accelerations, per s²."""
        if self._filter is None:
            return np.zeros(self.model.dof)
        noise = self._filter.noise
        if not self._filter.derived:
            speeds = np.sqrt(np.mean(np.vstack([one.dq for one in stretches]) ** 2, axis=0))
            noise = np.maximum(noise, noise_of_steps(self._stream.encoder_steps(), speeds, self.rate))
        return self._filter.acceleration_gain * noise

    def _noise_remark(
        self, noise: Array, bias: Array, covariance: ParameterCovariance, stretches: Sequence[Samples]
    ) -> tuple[str, ...]:
        times = in_half_widths(bias, covariance.standard_error)
        if times < MATTERS:
            return ()
        sizes = np.sqrt(np.mean(np.vstack([one.ddq for one in stretches]) ** 2, axis=0))
        shares = noise / np.maximum(sizes, 1e-300)
        worst = int(np.argmax(shares))
        return (
            f"Noise of the positions makes {shares[worst]:.2g} of the accelerations of "
            f"{self.model.robot.joint_names[worst]}, and inertias become too small: base parameters are off by up to "
            f"{times:.2g} times the half-width of an interval of 95 %, which counts in `intervals`. A lower cutoff, "
            "faster motion or finer encoders mend it.",
        )

    def _scale_known(self, info: Information | None) -> None:
        """Scale masses that are not known by the data, and make the set of what such a robot can be."""
        self._hold(self._known if info is None else self._known.scaled_to(info, self._given_set))
        self._scaled_rows = 0 if info is None else info.count
        if self._possible is not None and self._search.inside(self._possible):
            self._search.begin(self._possible)
        else:
            self._possible = None

    def _hold(self, scaled: PhysicalPrior) -> None:
        """Take bodies for what is known of the links."""
        self._scaled, self._reference = scaled, scaled.parameters
        self._set = set_with_habits(self._given_set, scaled)
        self._search = WarmFit(self._set)

    def estimate(self, *, accuracy: float = 1e-6, seconds: float = np.inf) -> OnlineEstimate:
        """Return what is known of the robot now.

        Parameters
        ----------
        accuracy : float
            Of the objective, half the squared residual over the variance of the noise: 1 is what noise moves it by.
        seconds : float
            After which the search is stopped; what it reached by then is given, which is possible, too. What is done
            whenever rows have grown by a third is not stopped: choosing the weight of the prior, and scaling masses
            that a description does not tell, take up to 50 ms for seven joints.

        Raises
        ------
        InputError
            If the accuracy is not positive, or the time is negative or no number.
        """
        begun = perf_counter()
        read_number(accuracy, "accuracy", "a positive number", above=0)
        read_number(seconds, "seconds", "a number of at least 0", least=0, infinite=True)
        with one_thread():
            return self._estimated(begun, accuracy, seconds)

    def _estimated(self, begun: float, accuracy: float, seconds: float) -> OnlineEstimate:
        info = self._counted.information(batch_means=False)
        rows = info.count
        if not rows or not any(f.norm2 > 0.0 for f in info.factors):
            return self._without_data(begun, rows)
        slow = self._slow
        if slow is None or rows > GROWTH * slow.rows or rows < slow.rows / GROWTH:
            slow = self._slow = self._slowly(info)
        left = max(seconds - (perf_counter() - begun), 0.0) if np.isfinite(seconds) else np.inf
        problem = info.reduced(slow.weights)
        parameters, converged, steps = self._searched(problem, slow, accuracy, left)
        remark = ""
        if not converged:
            remark = f"The search was stopped after {steps} steps; the parameters are possible, not yet the best."
        if not self._set.contains(parameters):
            assert self._possible is not None
            parameters, converged = self._possible, False
            remark = "The search left the feasible set; these are the parameters before it."
        self._possible, self._answered = parameters, self._taken
        if self.detect_changes:
            self._prediction = Prediction.of(problem, self._set.K @ parameters, slow.weights)
        away = problem.R @ (self._set.K @ parameters) - problem.rho
        total = np.array([float(away @ away) + problem.residual2, problem.residual2])
        self._left = np.sqrt(total / problem.norm2)
        self._answer_weights, self._examined = slow.weights, None
        return OnlineEstimate(
            self._t,
            self._set.K @ parameters,
            parameters,
            converged,
            remark,
            rows,
            slow.weights,
            slow.prior,
            slow.prior_weight,
            steps,
            perf_counter() - begun,
        )

    def _searched(self, problem: Reduced, slow: _Slow, accuracy: float, seconds: float) -> tuple[Array, bool, int]:
        """Return the parameters to which a search from the last answer comes, whether they are the best, and its steps.

        A search that ends by itself before its end stands in a corner, where rounding hides the way. Where there is
        time, the problem is then solved as that of a log, which takes ten times as long; else the search begins anew
        when rows have grown.
        """
        assert self._possible is not None
        parameters, steps, variance = self._possible, 0, _variance(problem)
        with contextlib.suppress(np.linalg.LinAlgError):  # at the very edge matrices are singular to rounding
            found = self._search.solve(
                problem.R, problem.rho, variance, slow.prepared, slow.prior_weight, accuracy=accuracy, seconds=seconds
            )
            parameters, steps = found.parameters, found.steps
            if found.converged or found.seconds >= seconds:
                return parameters, found.converged, steps
        self._stuck = True
        if np.isfinite(seconds):
            return parameters, False, steps
        own = ReducedRegression.of(problem, self._set).variance  # by which `fit_reduced` divides
        with contextlib.suppress(SolverError):
            fitted = fit_reduced(problem, self._set, prior=slow.prior, prior_weight=slow.prior_weight * variance / own)
            parameters = fitted.parameters
            if self._search.inside(parameters):
                self._search.begin(parameters)
                self._stuck = False
            return parameters, fitted.optimality_gap <= GAP, steps
        return parameters, False, steps

    def _without_data(self, begun: float, rows: int) -> OnlineEstimate:
        prior = self._prior(np.where(self._of_links, np.inf, 1.0))
        start = self._inside(np.where(self._of_links, np.inf, 1.0))
        why = "All torques so far are zero" if rows else "No samples count yet"
        if not self._taken and self._filter is not None:
            why += f", since the filter gives the first one after {2.0 * self.delay:.4g} s without a gap"
        text = f"{why}; the parameters are those of the prior."
        ones = np.ones(self.model.dof)
        seconds = perf_counter() - begun
        return OnlineEstimate(self._t, self._set.K @ start, start, False, text, rows, ones, prior, 0.0, 0, seconds)

    def _slowly(self, info: Information) -> _Slow:
        rows = info.count
        if self._known.scale_is_free and rows > SCALING * self._scaled_rows and not self.changes:
            self._scale_known(info)
        deviations = term_deviations(info, self._set)
        prior = self._prior(deviations)
        weights, weight = self._joint_weights(info), self._prior_weight
        if self._possible is None or self._stuck:
            self._possible, self._stuck = self._inside(deviations), False
            self._search.begin(self._possible)
        if weight is None:
            if not self._shared_rows / SHARING < rows < self._shared_rows * SHARING:
                self._share, self._shared_rows = self._share_of_prior(info, weights, prior), rows
            weight = self._share * untested_weight(rows)
        return _Slow(rows, weights, deviations, prior, prior.prepare(self._set, weight), weight)

    def _share_of_prior(self, info: Information, weights: Array, prior: Prior) -> float:
        """Return which part of its weight the prior may have, see `allowed_share`."""
        problem, K, whole = info.reduced(weights), self._set.K, untested_weight(info.count)
        if info.count < FEW * len(K):
            return 1.0
        _, center, covariance = self._covariance_with(weights)
        deviations, variance = covariance.in_deviations(), _variance(problem)

        def away(share: float) -> float:
            prepared = prior.prepare(self._set, share * whole)
            found = self._search.solve(problem.R, problem.rho, variance, prepared, share * whole)
            base = K @ found.parameters
            far, left = deviations @ (base - center), problem.R @ base - problem.rho
            return float(min(far @ far, left @ left / variance))

        start, multipliers = self._search.start, self._search.multipliers
        try:
            return allowed_share(away, covariance)
        except np.linalg.LinAlgError:  # at the very edge matrices are singular to rounding
            return self._share
        finally:
            # From answers with smaller weights, which lie near the boundary, a search crawls.
            self._search.start, self._search.multipliers = start, multipliers

    def _joint_weights(self, info: Information) -> Array:
        if not isinstance(self._weights, str):
            return info.joint_weights(self._weights)
        from scipy.linalg import solve_triangular

        plain = info.reduced(None)
        if not np.all(np.diagonal(plain.R)) or not is_well_conditioned(plain.R / column_lengths(plain.R)):
            base = solve(plain)
        else:  # not by singular values, which take as long as the whole answer
            base = solve_triangular(plain.R, plain.rho, check_finite=False)
        return inverse_deviations(info.factors, base, FEW)

    def _prior(self, deviations: Array) -> Prior:
        return distance_from(self._reference, self._set, deviations)

    def _inside(self, deviations: Array) -> Array:
        """Parameters well inside the set: the prior's, or, where conditions forbid these, the set's own."""
        start = np.where(self._of_links, self._reference, START * deviations)
        if self._search.inside(start) and self._set.satisfies_equations(start):
            return np.asarray(start)
        given = self._set
        for depth in DEPTHS:
            deeper = FeasibleSet(self.model, given.consistency, given.constraints, depth * given.margin, given.terms)
            with contextlib.suppress(SolverError):  # links of a few grams have no room so far inside
                found = correct(deeper, parameters=start).parameters
                if self._search.inside(found):
                    return found
        raise SolverError(
            f"no parameters of {self.model.robot.name} are inside all conditions by {DEPTHS[-1]:g} of their margin; "
            "loosen the constraints, or give FeasibleSet a smaller margin."
        )

    def settle(self) -> None:
        """Let the next answer rest on weights and on a prior that are computed anew, not only when rows have grown."""
        self._slow = None

    def covariance(self) -> ParameterCovariance:
        """The covariance of least squares of the samples as of now, corrected for residuals that last.

        Of the base parameters, with the joints weighted as in the last answer. What noise of the encoders, and torques
        that are out of step, make the base parameters be off by counts as one more error each, see `remarks`. The first
        time after new samples it takes some 0.1 s (seven joints).
        """
        return self._examine(self._weights_of_answer()).covariance

    def intervals(self, combinations: ArrayLike | None = None) -> Array:
        """Return intervals that hold the true values with a probability of 95 %, by the data alone.

        They lie about least squares, not about the answer, which the prior moves where the data say little. For what
        they count see `covariance`.

        Parameters
        ----------
        combinations : (k, n_b), optional
            Of the base parameters; each base parameter by itself where absent.

        Returns
        -------
        (k, 2) array
            Infinite for what the data do not determine.
        """
        count = self._set.K.shape[0]
        rows = np.eye(count) if combinations is None else np.atleast_2d(real_array(combinations, "combinations"))
        if rows.ndim != 2 or rows.shape[1] != count or not np.all(np.isfinite(rows)):
            raise InputError(
                f"combinations must be finite numbers, one for each of {count} base parameters: ({count},) or "
                f"(k, {count}); got an array of the shape {rows.shape}."
            )
        found = self._examine(self._weights_of_answer())
        half = NORMAL * standard_errors(self._set, found.covariance, rows @ self._set.K)
        values = rows @ found.center
        return np.column_stack([values - half, values + half])

    def _weights_of_answer(self) -> Array:
        return self.estimate().weights if self._answer_weights is None else self._answer_weights

    def _covariance_with(self, weights: Array) -> tuple[Information, Array, ParameterCovariance]:
        """Return what is known, least squares of it with these weights of the joints, and their covariance."""
        info = self._counted.information()
        center = solve(info.reduced(weights))
        found = ParameterCovariance.of(info, center, weights)
        if self._counted.keep < 1.0:
            found = found.with_forgotten(info, self._counted.squared(), weights)
        return info, center, found

    def generate(self, language: str, directory: str | Path) -> tuple[Path, ...]:
        """Write the estimator for a controller, see :func:`steelyard.online.generate_online`.

        The feasible set is this one's. The prior has the same parameters; its distance is quadratic, that of
        :class:`steelyard.estimators.ConstantPullbackPrior`. The filter stays here: the source takes rows of the
        regressor.

        Parameters
        ----------
        language : str
            ``"c"``.
        directory : str or Path

        Returns
        -------
        tuple of Path
            The files.

        Examples
        --------
        >>> import tempfile
        >>> import steelyard as sy
        >>> estimator = sy.OnlineEstimator(sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], name="arm")))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     len(estimator.generate("c", folder))
        8
        """
        prior = ConstantPullbackPrior(self._reference)
        return generate_online(self.feasible_set, directory, language=language, prior=prior)

    def proved(self) -> Estimate:
        """Return the last answer as an :class:`steelyard.Estimate`, with its proof and its errors, to save or write."""
        answer = self.estimate()
        info = self.information
        remarks = (*self.remarks, *([answer.remark] if answer.remark else []))
        with one_thread():
            return proved_estimate(
                info,
                self._given_set,
                answer.parameters,
                "online plausible fit",
                weights=answer.weights,
                remarks=remarks,
            )

    # Between one day and the next

    def save(self, path: str | Path) -> None:
        """Write what was learned, and all that goes on with it, to go on with `load`; the estimator stays as it is.

        The file is in NumPy's format NPZ, without pickled objects, and appears whole or not at all. Seven joints with
        drives make some 7 MB, written in 0.04 s.

        Parameters
        ----------
        path : str or Path

        Raises
        ------
        InputError
            If the file cannot be written.

        Examples
        --------
        >>> import tempfile
        >>> import steelyard as sy
        >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
        >>> t = np.arange(2000)[:, None] / 1000
        >>> evening = sy.OnlineEstimator(model, forget=60)
        >>> evening.update(t[:, 0], np.sin(2 * t), np.cos(2 * t))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     evening.save(f"{folder}/arm.npz")
        ...     morning = sy.OnlineEstimator.load(f"{folder}/arm.npz", model)
        >>> morning.factors()[0].count == evening.factors()[0].count, morning.time
        (True, 1.779)
        """
        write_state({**self._kind(), "options": self._given, "needed": self._needed, **self._whole_state()}, path)

    @classmethod
    def load(
        cls,
        path: str | Path,
        model: Model,
        feasible_set: FeasibleSet | None = None,
        *,
        prior: PhysicalPrior | None = None,
    ) -> OnlineEstimator:
        """Go on where another estimator was when it was saved: it learns from what comes next as that one would have.

        After a pause the next samples come after a gap, or by a clock that was set back. The filter then starts anew,
        so that nothing is interpolated over the pause, and all that was learned counts on. With ``forget`` time is
        counted in samples, so that a pause forgets nothing; what changed meanwhile, such as a tool, is noticed with
        ``detect_changes``.

        Parameters
        ----------
        path : str or Path
        model : Model
            Of the same robot, with the same terms.
        feasible_set : FeasibleSet, optional
        prior : PhysicalPrior, optional
            These two as they were given to the other estimator. All other options come from the file.

        Raises
        ------
        InputError
            If the file is missing or damaged, is something else, or is of another robot or of a newer version; or if
            the estimator had a feasible set or a prior of its own, and there is none here.
        """
        with reading_as(Path(path), "the state of an OnlineEstimator", REMEDY):
            state = read_state(path)
            found = cls(model, feasible_set, prior=prior, **state["options"])
            own = found._kind()
            if state["expressions"] != own["expressions"] or not np.allclose(state["rows"], own["rows"], rtol=1e-6):
                raise InputError(
                    f"{path}: is of another robot than {model.robot.name}, or of other terms; give the model of the "
                    "estimator that was saved."
                )
            for name, needed in state["needed"].items():
                if needed and not found._needed[name]:
                    raise InputError(f"{path}: is of an estimator with a {name} of its own; give the same to load.")
            found._go_on(state)
            return found

    def _kind(self) -> dict[str, Any]:
        """What tells this robot and its terms from others: its base parameters, and rows of a random motion."""
        base, random = self.model.base_columns, np.random.default_rng(20140101)
        expressions = list(self.model.base_parameters().expressions)
        return {"expressions": expressions, "rows": base.entries(*random.normal(size=(3, 2, self.model.dof)))}

    def _whole_state(self) -> dict[str, Any]:
        """Return all that samples have left here."""
        slow, search, prediction = self._slow, self._search, self._prediction
        changes = [
            [one.t, one.noticed, one.joint_names, one.robots, one.known, information_state(one.before)]
            for one in self.changes
        ]
        return state_of(self, STATE) | {
            "measured": self._measured,
            "filter": None if self._filter is None else self._filter.state(),
            "moved_torques": None if self._moved_torques is None else self._moved_torques.state(),
            "waiting": self._rows[: self._waiting],
            "certain": None if self._certain is None else self._certain.state(),
            "first": None if self._first is None else self._first.state(),
            "bodies": [[link.fixed, link.free] for link in self._scaled.links],
            "search": [search.start, search.multipliers],
            "slow": slow and [slow.rows, slow.weights, slow.deviations, slow.prior_weight],
            "prediction": prediction and prediction.state(),
            "changes": changes,
            "earlier": [one.state() for one in self._earlier],
        }

    def _go_on(self, state: dict[str, Any]) -> None:
        """Take over what samples have left elsewhere."""
        if state["measured"] is not None:
            self._expect(state["measured"])
        if self._filter is not None:
            self._filter.restore(state["filter"])
        if self._moved_torques is not None:
            self._moved_torques.restore(state["moved_torques"])
        self._waiting = len(state["waiting"])
        self._rows[: self._waiting] = state["waiting"]
        bodies = zip(self._scaled.links, state["bodies"], strict=True)
        self._hold(replace(self._scaled, links=tuple(replace(link, fixed=a, free=b) for link, (a, b) in bodies)))
        take_over(self, STATE, state)
        if self._certain is not None:
            self._certain.restore(state["certain"])
        if self._first is not None:
            self._first = None if state["first"] is None else self._first.restore(state["first"])
        self.changes = [
            Change(t, noticed, tuple(names), information_of(self.model, before), tuple(robots), known)
            for t, noticed, names, robots, known, before in state["changes"]
        ]
        length = self._detector.length
        self._earlier = [EarlierRobot.of_state(one, self._new_rows(), length) for one in state["earlier"]]
        if state["prediction"] is not None:
            self._prediction = Prediction.of_state(state["prediction"])
        start, multipliers = state["search"]
        if start is None or not self._search.inside(start):  # the set is another one than it was
            self._possible = self._answer_weights = None
            return
        self._search.start, self._search.multipliers = start, multipliers
        if state["slow"] is not None:
            rows, weights, deviations, prior_weight = state["slow"]
            prior = self._prior(deviations)
            self._slow = _Slow(rows, weights, deviations, prior, prior.prepare(self._set, prior_weight), prior_weight)


def _said_of(change: Change) -> str:
    names, (before, since) = ", ".join(change.joint_names), change.robots
    if since == before and change.before.count:
        return (
            f"From {change.t:.13g} s on the torque of {names} was not as predicted for a while, and is so again; that "
            "while is left out."
        )
    if change.known:
        return (
            f"At {change.t:.13g} s the robot changed, by the torque of {names}, back to what it was "
            f"{'at first' if since == 0 else 'before'}; the estimate goes on from what was known of it."
        )
    return (
        f"At {change.t:.13g} s the robot changed, or began to move as its model does not describe, by the torque of "
        f"{names}; the estimate rests on what came after"
        f"{'.' if change.before.count else ', and nothing is known of the robot before.'}"
    )


def _torque_delays(given: float | ArrayLike, joints: int) -> Array:
    """Return a delay for each joint, (N,) s."""
    values = real_array(given, "torque_delay")
    if values.shape not in ((), (joints,)) or not np.all(np.abs(values) <= LONGEST_DELAY):
        raise InputError(
            f"torque_delay must be a number of s between {-LONGEST_DELAY:g} and {LONGEST_DELAY:g}, or one for each of "
            f"{joints} joints, got {given!r}."
        )
    return np.broadcast_to(values, (joints,)).copy()


def _jumping_rows(model: Model) -> NDArray[np.bool_]:
    """Joints whose friction jumps where they turn around, (N,)."""
    random = np.random.default_rng(20140101)
    q, ddq = random.normal(size=(2, 1, model.dof))
    columns = model.base_columns
    slow = 1e-7 * random.uniform(1.0, 2.0, size=(1, model.dof))
    forth, back = (columns.by_joint(columns.entries(q, sign * slow, ddq)) for sign in (1.0, -1.0))
    return np.array([bool(np.abs(a - b).max(initial=0.0) > 0.1) for a, b in zip(forth, back, strict=True)])


def _variance(problem: Reduced) -> float:
    """Variance of the rows as `steelyard.fit` takes it, but not less than what few rows can tell."""
    width, size = problem.R.shape[1], problem.norm2
    variance: float = max(problem.residual2 / max(problem.count - width, 1), LEAST_DEVIATION**2 * size / problem.count)
    if problem.count < FEW * width:
        variance = max(variance, FIRST_DEVIATION**2 * size / problem.count)
    return variance
