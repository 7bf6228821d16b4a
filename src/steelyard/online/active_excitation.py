"""Excitation on the fly: a controller that learns a robot while it moves it on to the motion that teaches most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.collision.surroundings import Surroundings
from steelyard.control import FilteredDifference
from steelyard.display import text_table
from steelyard.dynamics import Model
from steelyard.errors import InputError, SteelyardError
from steelyard.estimators.estimator import proved_estimate
from steelyard.excitation import MotionConstraint, MotionLimits
from steelyard.excitation.criterion import Criterion, Subset
from steelyard.excitation.motion_constraints import TorqueLimit
from steelyard.excitation.vjp import CompiledVjp, RegressorInformation
from steelyard.files.arguments import is_real, positive, read_whole, real_array
from steelyard.once import cached_property
from steelyard.recording import Recording
from steelyard.regression import Estimate, Information
from steelyard.regression.factor import eigenvectors
from steelyard.simulation import Measurement

from .feedback_share import FeedbackShare
from .robot_knowledge import SHORTEST, Learner, RobotKnowledge
from .segments import SegmentPlanner, State

__all__ = ["ActiveExcitation", "ExcitationStep"]

Array = NDArray[np.float64]

HOLD = 0.8
"""s for which the robot is held where it stands, until the feedback carries the weight that the prior does not know."""
STAGES = ((0.5, 3.0, 2.0),)
"""Share of the limits of velocity and acceleration, duration and played part of the first motion, s. The first estimate
comes after it, so that no fast motion is made by assumed masses. A second one, of 3 s at 0.7 of the limits, leaves a
WAM after 9 s with 1.3 times the error."""
DURATION, PLAYED = 8.0, 4.0
"""s of every later plan, to rest, and of its part that is played before the next one takes over. Of a simulated WAM the
expected torque error after 16 s was 0.25 of its noise with plans of 6 s of which 4 s are played, 0.19 with 8 s and 6 s,
and 0.18 with 10 s and 8 s, which uses the new data less often. With 8 s and 4 s the torques of trajectory B are known
as well as by trajectory A 1.6 s sooner than with 8 s and 6 s."""
STILL = 0.2  # s before `longest` at which the last motion ends at the latest
SPACING = 0.8
"""s between control points. With 0.4 s, whose motions are smaller, the error after 16 s is a fifth larger."""
RETRY = 0.2  # s after which another plan is asked for
LEAD = 0.8  # s before a plan ends its played part, at which the next one is asked for; more where one came too late
BANDWIDTH = 50.0
"""rad/s of the feedback where the inertia is known; below it, as large a part of it as of the inertia is sure. At 1 kHz
the loop with a filtered velocity bears an inertia that is guessed several times too large."""
GROWTH = 2.0
"""By which factor stiffness grows at most from one motion to the next. A first estimate took the friction of a last
joint for a rotor of 40 times its inertia; the loop that it asked for was unstable. A stable loop with a gain margin of
two bears one such step, and the next estimate comes from the motion with it."""
DAMPING = 0.8
INTEGRAL = 0.15
"""Of the bandwidth, the rate at which the integral takes over an unknown weight. An inertia that was guessed too small
makes the loop unstable from a factor of 2 `DAMPING` / `INTEGRAL` on, here 11. With 6 rad/s at any bandwidth it was 2.5
to 5: the wrists of a UR5, of which the kinematics tell a tenth of the inertia, swung at up to 1.7 times their limit."""
LEAST_SHARE = 0.35
"""Of the bandwidth, with which the robot is held first, for the mean inertia and one standard deviation. With 0.4 and
two deviations the loop was unstable at 1 kHz on 5 of 16 random UR5 and Pandas; with 0.4 and the larger of mean and one
deviation a wrist of the Panda fell at 2.9 times its limit of velocity."""
REACH = 0.1
"""rad or m: feedback of the position is that of this error at most, for which the torque bound has room, so that
damping is never crowded out. Without it, and with an integral that went on at the bound, a wrist of the UR5 that was
stopped swung at its bound, at up to 1.7 times its limit of velocity; with both it keeps to 0.72 of it."""
SURE = 2.0  # standard deviations of the lower bound of inertias
TORQUE_BAND = 4.0  # standard deviations by which a torque may differ from what the plan needs
JUMP = 10.0  # limits of velocity, by which beside `TRACKING` a position may change from one measurement to the next
FASTEST_STOP = 2.0  # limits of velocity from which a stop is planned at most, whatever speed is measured
TRACKING = 0.35  # rad or m from the reference, beyond which the motion is broken off
FIRST_ROOM = 0.25  # rad or m kept free for tracking errors before any was measured
LEAST_ROOM = 0.01
SLACK = 0.1
"""Of what is left to a limit, by which a plan may come nearer to it than the one before where both are within the room.
With 0.01 rad each plan came nearer by as much: four of 40 simulated WAM came to where they could not stop, and three
passed a limit of position by up to 1.2 % of half its range."""
FORGETTING = 0.6  # of the room, that stays from one motion to the next where tracking is better
BLEND = 0.2  # s in which the torque passes from one model to the next
SMOOTHNESS = 0.02  # width of the smooth sign of friction in the search, relative to the velocity limits
SIGN_WIDTH = 0.01  # rad/s or m/s, in the torques that are fed forward
FREE = 0.15
"""Of the limit of velocity, left free for tracking at least. It costs little: with 0.03 in place of 0.12 a WAM that is
followed perfectly would be known no sooner."""
OVERSPEED = 0.6
"""Of the room between the largest velocity of a plan and the limit, beyond which the motion is broken off: a slow plan
is stopped at a lower velocity than a fast one."""


@dataclass(frozen=True, eq=False)
class ExcitationStep:
    """The state of the knowledge when a part of the motion began.

    Attributes
    ----------
    time : float
        s since the start.
    stage : str
        "hold", "cautious", "exciting", "stopping" or "done".
    expected_error : float
        Expected error of predicted torques over all motions within the limits, relative to these torques.
    joint_errors : ndarray
        (N,) the same of each joint.
    stiffness : ndarray
        (N,) of the feedback, N·m/rad or N/m.
    bandwidth : ndarray
        (N,) rad/s of this feedback at the inertia of the estimate: it rises as the lower bound comes near it.
    torque_bound : ndarray
        (N,) N·m or N, beyond which no torque is commanded.
    tracking_error : ndarray
        (N,) largest of the part before, rad or m.

    Examples
    --------
    >>> one = np.ones(2)
    >>> step = ExcitationStep(5.8, "exciting", 0.19, 0.2 * one, 400 * one, 20 * one, 60 * one, 0.01 * one)
    >>> step.stage, step.expected_error
    ('exciting', 0.19)
    """

    time: float
    stage: str
    expected_error: float
    joint_errors: Array
    stiffness: Array
    bandwidth: Array
    torque_bound: Array
    tracking_error: Array


@dataclass(eq=False)
class _Reference:
    """The reference and the torques that are fed forward, sampled."""

    start: float
    sample_time: float
    q: Array
    dq: Array
    ddq: Array
    torque: Array

    def index(self, t: float) -> int:
        return min(max(round((t - self.start) / self.sample_time), 0), len(self.q) - 1)

    def state(self, t: float) -> State:
        k = self.index(t)
        return self.q[k], self.dq[k], self.ddq[k]

    @property
    def end(self) -> float:
        return self.start + self.sample_time * (len(self.q) - 1)


@dataclass(eq=False)
class _Plan:
    """A motion that may take over at a time, and what it is played with."""

    time: float
    knowledge: RobotKnowledge
    played: float
    reference: _Reference | None = None
    inertia: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))
    """(S, N, N) at every row of the reference."""
    stiffness: Array = field(default_factory=lambda: np.zeros(0))
    bandwidth: Array = field(default_factory=lambda: np.zeros(0))
    bound: Array = field(default_factory=lambda: np.zeros(0))
    fastest: Array = field(default_factory=lambda: np.zeros(0))
    """Velocities beyond which the motion is broken off."""


class ActiveExcitation:
    """Moves a robot of which only the kinematics are known so that its parameters become known soonest.

    It is a :class:`steelyard.simulation.Controller`; on a robot, call `command` once each sample time. The robot is
    first held where it stands, then moved little and slowly, then on to the motion after which the torques of all
    motions within the limits are predicted best (thesis section 8.1, last paragraph). Every motion is planned to end at
    rest and is replaced while it is played, so that position, velocity and acceleration of the reference have no jump,
    and a plan that comes late, or that cannot be found, leaves a motion that stops.

    Gains are those that suit the lower bound of the inertia, and torques stay within four standard deviations of what
    the plan needs by the present estimate: as the parameters become known the gains rise and the band narrows.

    Parameters
    ----------
    model : Model
        Masses of its description are a weak prior where they are believable, and need not be there.
    limits : MotionLimits or mapping, optional
        Of positions, velocities, accelerations and torques, as for :func:`steelyard.design_excitation`. Positions,
        velocities and torques hold for the robot, and for the reference with room for tracking errors; accelerations
        hold for the reference.
    accuracy : float
        The motion ends when the expected error of predicted torques, relative to these torques, is at most this.
    longest : float
        s after which the robot is at rest at the latest; the last motion is made as short as that needs. Only a motion
        that must be broken off near the end may take longer to stop.
    criterion : {"prediction", "d", "a"}
        What the next motion is to make small: the expected error of predicted torques over motions within the limits,
        the volume of the confidence ellipsoid, or the sum of the variances of the base parameters.
    cutoff : float
        Of the filter of positions, Hz.
    constraints : sequence of MotionConstraint
        Further ones, such as distances from a table.
    self_collision : bool
        Whether links are kept apart where the description has collision geometry.
    sample_time : float
        s.
    background : bool
        Whether plans are made in a thread while the robot moves, for a real-time loop. Without it a call that plans
        takes some seconds, and the same measurements give the same torques.
    starts, seed : int
        Random starts of the search for each plan, and seed.

    Attributes
    ----------
    steps : list of ExcitationStep
        What was known when.
    interruptions : list of (float, str)
        Times at which the motion was broken off, and why.
    taken_back : list of (float, str)
        Times at which a joint began to swing, since it has less inertia than its feedback was for, and its name: the
        feedback was taken back there.
    exceeded : list of (float, str)
        Times at which a joint was first measured to turn faster than its limit of velocity, or beyond a limit of
        position, and why.
    changes : list of (float, str)
        Times at which what was measured last contradicted what was measured before, and at which joints: the robot has
        changed, and what was measured before is forgotten.
    played : list of ndarray
        (N,) position of the reference at every call.

    Examples
    --------
    >>> import steelyard as sy
    >>> robot = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], gravity=(0, -9.81, 0))
    >>> limits = {"lower": -1.5, "upper": 1.5, "velocity": 2.0, "acceleration": 6.0, "torque": 60.0}
    >>> excitation = ActiveExcitation(sy.Model(robot), limits, sample_time=0.002)
    >>> torque = excitation.command(0.0, [0.0, 0.0])
    >>> bool(np.all(abs(torque) <= 60.0)), excitation.finished
    (True, False)
    """

    _integral: Array
    _jump: Array
    _joins: bool
    _largest: Array
    _largest_speed: Array
    _room: Array
    _speed_room: Array
    _command: Array
    _damping: Array
    _fast: NDArray[np.bool_]
    _outside: NDArray[np.bool_]

    def __init__(
        self,
        model: Model,
        limits: MotionLimits | Mapping[str, Any] | None = None,
        *,
        accuracy: float = 0.02,
        longest: float = 60.0,
        criterion: Literal["prediction", "d", "a"] = "prediction",
        cutoff: float = 4.8,
        constraints: Sequence[MotionConstraint] = (),
        self_collision: bool = True,
        sample_time: float = 0.001,
        background: bool = False,
        starts: int = 1,
        seed: int = 0,
    ) -> None:
        self.model = model
        self.limits = MotionLimits.for_robot(model.robot, limits)
        for k, name in enumerate(model.robot.joint_names):
            if not np.isfinite([self.limits.velocity[k], self.limits.acceleration[k]]).all():
                raise InputError(
                    f"{name} has no limit of velocity or acceleration, without which a robot of unknown masses is not "
                    'moved; give both: limits={"velocity": 1.0, "acceleration": 2.0}, or these names in a limits file.'
                )
        if criterion not in ("prediction", "d", "a"):
            raise InputError(f"criterion must be prediction, d or a, got {criterion!r}.")
        self.accuracy = positive(accuracy, "accuracy", "1")
        self.longest = positive(longest, "longest", "s")
        self.cutoff = positive(cutoff, "cutoff", "Hz")
        self.sample_time = positive(sample_time, "sample_time", "s")
        if not self.cutoff < 0.5 / self.sample_time:
            raise InputError(
                f"cutoff must be below {0.5 / self.sample_time:g} Hz, half the rate of one sample each "
                f"{self.sample_time:g} s, got {self.cutoff:g} Hz."
            )
        around = Surroundings.of(model.robot, constraints, {}, self_collision)
        self.unchecked = around.unchecked
        self._constraints = (*constraints, *(() if around.own is None else (around.own,)))
        self._criterion_name = criterion
        self._learner = Learner(model, self.limits, self.cutoff, self.sample_time)
        self._starts, self._seed = read_whole(starts, "starts", 1), read_whole(seed, "seed")
        self._background = background
        self._pool: ThreadPoolExecutor | None = None
        self._velocity = FilteredDifference(cutoff=60.0)
        self.steps: list[ExcitationStep] = []
        self.interruptions: list[tuple[float, str]] = []
        self.exceeded: list[tuple[float, str]] = []
        self.changes: list[tuple[float, str]] = []
        self.played: list[Array] = []
        self._begin()

    # The two ways in

    def start(self, measurement: Measurement) -> None:
        """Forget everything, and hold the robot where it stands at this measurement."""
        self._begin()
        self._velocity.start(measurement)
        t, q = measurement.t, measurement.q.copy()
        outside = (q < self.limits.lower) | (q > self.limits.upper)
        if outside.any():
            k = int(np.flatnonzero(outside)[0])
            raise InputError(
                f"{self.model.robot.joint_names[k]} stands at {q[k]:.4g}, outside its limits "
                f"{self.limits.lower[k]:.4g} to {self.limits.upper[k]:.4g} by "
                f"{max(self.limits.lower[k] - q[k], q[k] - self.limits.upper[k]):.2g} "
                f"{self.model.robot.position_units[k]}; bring it inside first."
            )
        self._started = t
        self._last_time = t
        still = np.zeros_like(q)
        plan = _Plan(t, self._knowledge, HOLD)
        self._prepare(plan, (np.array([q, q]), np.array([still, still]), np.array([still, still])))
        self._take(plan, t, "hold")

    def torque(self, measurement: Measurement) -> Array:
        """Return the torques (N,) to command until the next measurement, N·m or N.

        `measurement.torque` is recorded where it is measured, and otherwise the torques that were commanded.
        """
        if self._reference is None:
            self.start(measurement)
        t, q = measurement.t, measurement.q
        difference = self._velocity.velocity(measurement)
        dq = difference if measurement.dq is None else measurement.dq
        self._record(t, q, measurement.torque)
        self._move_on(t)
        reference = self._reference
        assert reference is not None
        k = reference.index(t)
        error, speed_error = reference.q[k] - q, reference.dq[k] - dq
        self.played.append(reference.q[k])
        plan = self._plan
        assert plan is not None
        full = np.abs(self._command) >= self.limits.torque
        # A joint that its own stiffness drives back does not run away, however fast it becomes.
        may_rise = ~full & (self._stage != "exciting") & (error * speed_error >= 0.0)
        share = self._share.follow(t, q, reference.dq[k], dq, self._damping, may_rise)
        # Neither steps nor noise of an encoder are a motion.
        speeds = self._share.speeds
        reason = self._trouble(t, q, speeds, error)
        if reason:
            self._break_off(t, q, speeds, reason)
            plan, reference, k = self._plan, self._reference, 0
            assert plan is not None
            assert reference is not None
            error, speed_error = reference.q[0] - q, reference.dq[0] - dq
        self._largest = np.maximum(self._largest, np.abs(error))
        self._largest_speed = np.maximum(self._largest_speed, np.abs(speed_error))
        dt = min(max(t - self._last_time, 0.0), 5.0 * self.sample_time)
        self._last_time = t
        self._tell_excess(t, q, speeds, full)
        # A joint that needs more feedback than was thought is heavier than was thought.
        room, width = np.minimum(np.maximum(share, 1.0) * plan.bound, self.limits.torque), plan.bandwidth
        part = np.sqrt(share)
        inertia = part[:, None] * plan.inertia[k] * part
        push = width * (inertia @ (width * np.clip(error, -REACH, REACH)))
        root = np.sqrt(width)
        damping = 2.0 * DAMPING * root * (inertia @ (root * speed_error))
        self._damping = 2.0 * DAMPING * width * np.diagonal(inertia) * speed_error
        # A link of which nothing is known but that it swings like a light one is not to be driven as a heavy one.
        forward = reference.torque[k] * (1.0 if plan.knowledge.is_measured else self._share.forward)
        command = forward + self._integral + push + damping
        if self._joins:  # other gains and another model: the torque passes over without a jump
            self._jump, self._joins = self._command - command, False
            if self._stage == "stopping":  # what drove the robot too far is not to drive it on
                self._jump = np.zeros_like(command)
        command = command + self._jump * np.exp(-(t - self._switched) / BLEND)
        self._command = np.clip(command, -room, room)
        # What the bound cuts off is not gathered up: it would drive the robot on when it has come back.
        free = (np.abs(command) < room) | (push * command < 0.0)
        self._integral = np.clip(self._integral + free * dt * INTEGRAL * width * push, -room, room)
        return self._command.copy()

    def command(self, t: float, q: ArrayLike, dq: ArrayLike | None = None, torque: ArrayLike | None = None) -> Array:
        """Return the torques to command now, in your own control loop; the first call holds the robot where it is.

        Parameters
        ----------
        t : float
            s.
        q : array_like
            (N,) measured positions, rad or m.
        dq : array_like, optional
            (N,) measured velocities; differences of the positions where not given.
        torque : array_like, optional
            (N,) measured torques, N·m or N; those that were commanded where not given.

        Returns
        -------
        ndarray
            (N,) N·m or N.

        Raises
        ------
        InputError
            If the time, or what was measured, is no finite number for each joint, as of a dead encoder, or a position
            jumps further than its joint can move. Nothing is commanded then: stop the drives.
        """
        if not (is_real(t) and np.isfinite(t)):
            raise InputError(f"t must be a finite number of seconds, got {t!r}.")
        place, speed, measured = (self._measured(x, name) for x, name in ((q, "q"), (dq, "dq"), (torque, "torque")))
        if place is None:
            raise InputError(f"q must be {self.model.dof} finite numbers, one for each joint, got None.")
        self._refuse_jumps(float(t), place)
        return self.torque(Measurement(float(t), place, speed, measured))

    def _refuse_jumps(self, t: float, q: Array) -> None:
        """Refuse a position that no motion leads to since the last one: the robot would be driven after it."""
        if not self._count:
            return
        last = self._log[self._count - 1]
        step, passed = np.abs(q - last[1 : 1 + self.model.dof]), max(t - last[0], self.sample_time)
        far = step > TRACKING + JUMP * self.limits.velocity * passed
        if far.any():
            k = int(np.flatnonzero(far)[0])
            raise InputError(
                f"The position of {self.model.robot.joint_names[k]} jumped by {step[k]:.4g} (rad or m) within "
                f"{passed:.4g} s, which no motion does; mend its encoder, or the turns or the unit that are counted."
            )

    def _measured(self, values: ArrayLike | None, name: str) -> Array | None:
        if values is None:
            return None
        expected = f"{self.model.dof} finite numbers, one for each joint"
        found = real_array(values, name, expected).copy()
        if found.shape != (self.model.dof,) or not np.isfinite(found).all():
            raise InputError(f"{name} must be {expected}, got {values!r}.")
        return found

    # What was learnt

    @property
    def taken_back(self) -> list[tuple[float, str]]:  # noqa: D102  (among the attributes of the class)
        names = self.model.robot.joint_names
        return [(t - self._started, names[joint]) for t, joint in self._share.taken_back]

    @property
    def end(self) -> float:
        """Time at which the robot is at rest after the last motion, s; infinite while it is not known."""
        if self._stage != "done" or self._reference is None:
            return np.inf
        return max(self._reference.end, self._started + self.steps[-1].time)  # a stop may have ended long before

    @property
    def finished(self) -> bool:
        """Whether the robot is at rest after the last motion."""
        return self._last_time >= self.end

    @property
    def expected_error(self) -> float:
        """Expected error of predicted torques over motions within the limits, relative to these torques."""
        return self._knowledge.expected_error

    @property
    def estimate(self) -> Estimate | None:
        """The present estimate, proved feasible; None before the first motion was processed."""
        known = self._knowledge
        if not known.is_measured:
            return None
        return proved_estimate(
            known.information,
            self._learner.feasible_set,
            known.parameters,
            "online plausible fit",
            weights=1.0 / known.noise,
        )

    @property
    def information(self) -> Information:
        """The Information of all that was processed so far."""
        return self._knowledge.information

    @property
    def recording(self) -> Recording:
        """Everything that was measured so far."""
        count = self._count
        return Recording(
            t=self._log[:count, 0] - self._log[0, 0],
            q=self._log[:count, 1 : 1 + self.model.dof],
            torque=self._log[:count, 1 + self.model.dof :],
            source="excitation on the fly",
        )

    def reference(self, t: float) -> State:
        """Return q, dq and ddq of the reference at a time, (N,) each."""
        if self._reference is None:
            raise InputError("There is no reference before the first measurement; call torque with one first.")
        return self._reference.state(t)

    def table(self) -> str:
        """Return what was known at which time, as a text."""
        rows = [
            (
                f"{step.time:.1f}",
                step.stage,
                f"{step.expected_error:.2%}",
                f"{np.mean(step.bandwidth):.3g}",
                f"{np.max(step.tracking_error):.3f}",
            )
            for step in self.steps
        ]
        heads = ("t in s", "stage", "expected error", "bandwidth in rad/s", "tracking")
        return text_table(heads, rows, numbers=(0, 2, 3, 4))

    def __repr__(self) -> str:
        return (
            f"ActiveExcitation({self.model.robot.name}: {self._stage} at {self._last_time - self._started:.1f} s, "
            f"expected torque error {self.expected_error:.2%})"
        )

    # Planning

    def _begin(self) -> None:
        size = self.model.dof
        self._reference: _Reference | None = None
        self._plan: _Plan | None = None
        self._waiting: Future[_Plan] | None = None
        self._asked, self._lead = np.inf, LEAD
        self._knowledge = self._learner.assumed()
        self._log = np.zeros((4096, 1 + 2 * size))
        self._count = 0
        self._used = 0.0
        self._started = self._last_time = self._switched = 0.0
        self._stage, self._motions, self._pace = "hold", 0, 1.0
        self._integral = np.zeros(size)
        self._jump = np.zeros(size)
        self._largest = np.zeros(size)
        self._largest_speed = np.zeros(size)
        self._room = np.full(size, FIRST_ROOM)
        self._speed_room = 0.2 * self.limits.velocity
        self._command = np.zeros(size)
        self._joins = False
        self._share = FeedbackShare(self.limits.velocity)
        self._damping = np.zeros(size)
        self._fast, self._outside = np.zeros((2, size), dtype=bool)
        self.steps.clear()
        self.interruptions.clear()
        self.exceeded.clear()
        self.changes.clear()
        self.played.clear()

    @cached_property
    def _feedforward(self) -> Any:
        return self.model.kernel("inverse_dynamics", sign="smooth")

    def _predicted(self, motion: State, parameters: Array) -> Array:
        width = np.array([SIGN_WIDTH])
        known = {"q": motion[0], "dq": motion[1], "ddq": motion[2], "parameters": parameters, "sign_width": width}
        out = self._feedforward(*[known[argument.name] for argument in self._feedforward.arguments])
        return np.asarray(out).reshape(motion[0].shape)

    @cached_property
    def _torque_vjp(self) -> tuple[CompiledVjp, Array]:
        held = self._learner.credible.parameters.copy()
        return CompiledVjp(self.model.function("inverse_dynamics"), {"parameters": held}), held

    def _record(self, t: float, q: Array, torque: Array | None) -> None:
        # A torque that is measured at an instant is the one that was commanded before it.
        if self._count == len(self._log):
            self._log = np.concatenate([self._log, np.zeros_like(self._log)])
        size = self.model.dof
        row = self._log[self._count]
        row[0], row[1 : 1 + size] = t, q
        row[1 + size :] = self._command if torque is None else torque
        self._count += 1

    def _next(self, log: Array, time: float, state: State) -> _Plan:
        """Learn from what was recorded, and plan the motion that begins at a time in a state of the reference."""
        knowledge, self._used = self._learner.learnt(log, self._used, self._knowledge)
        done = knowledge.expected_error <= self.accuracy and knowledge.is_measured and not knowledge.contradicted
        left = self._started + self.longest - STILL - time
        if done or left < SHORTEST:
            return _Plan(time, knowledge, np.inf)
        share, whole, played = STAGES[self._motions] if self._motions < len(STAGES) else (1.0, DURATION, PLAYED)
        duration = min(whole, left)
        if left - played < SHORTEST:  # none follows: it is played to its end
            played = duration
        limits = self._planning_limits(time, state, share * self._pace, knowledge)
        planner = SegmentPlanner(
            self._regressor.weighted(1.0 / knowledge.noise),
            self._criterion(knowledge.noise),
            limits,
            self._torque_constraints(state, limits, knowledge) + self._constraints,
            duration=duration,
            spacing=SPACING if whole >= DURATION else 0.5,
            rate=1.0 / (self.sample_time * self._learner.correlation),
            starts=self._starts,
            seed=self._seed + 1000 * len(self.steps),
        )
        found = planner.plan(state, knowledge.root)
        plan = _Plan(time, knowledge, played)
        if found is not None:
            times = np.arange(0.0, found.duration + self.sample_time, self.sample_time)
            self._prepare(plan, found.motion(times))
        return plan

    @cached_property
    def _regressor(self) -> RegressorInformation:
        width = SMOOTHNESS * float(np.min(self.limits.velocity))
        return RegressorInformation(self.model, width, np.ones(self.model.dof))

    def _criterion(self, noise: Array) -> Criterion:
        base = self.model.base_parameters()
        if self._criterion_name != "prediction":
            return Criterion(self._criterion_name, Subset(base.expressions, np.eye(base.count), True))
        whole = sum(matrix / s**2 for matrix, s in zip(self._learner.mean_squares, noise, strict=True))
        values, vectors = eigenvectors(whole)
        directions = vectors * np.sqrt(np.maximum(values, 0.0))
        return Criterion("a", Subset(base.expressions, directions, False))

    def _planning_limits(self, time: float, state: State, share: float, knowledge: RobotKnowledge) -> MotionLimits:
        """Limits of the reference: room for tracking errors, and a part of the velocities where little is known."""
        limits = self.limits
        assert self._reference is not None
        lower, upper = limits.lower + self._room, limits.upper - self._room
        middle = 0.5 * np.add(*limits.ranges)
        lower, upper = np.fmin(lower, middle - 1e-3), np.fmax(upper, middle + 1e-3)
        # Where the room has grown since, the way to rest that is left of the reference may lie beyond. The search needs
        # a little more to find a way like it, but no more: the next plan may add as much again.
        left = self._reference.q[self._reference.index(time) :]
        least, most = left.min(axis=0), left.max(axis=0)
        lower = np.minimum(lower, least - np.clip(SLACK * (least - limits.lower), 1e-4, 1e-3))
        upper = np.maximum(upper, most + np.clip(SLACK * (limits.upper - most), 1e-4, 1e-3))
        # What is not known of the torques makes overshoots that no earlier, slower motion has shown.
        unknown = 0.5 * np.minimum(knowledge.joint_errors, 0.6) * limits.velocity
        velocity = share * np.maximum(limits.velocity - self._speed_room - unknown, 0.3 * limits.velocity)
        velocity = np.maximum(velocity, 1.02 * np.abs(state[1]) + 1e-3)
        now = np.abs(state[2])  # room about what the state has, which must not grow from plan to plan beyond the limit
        ease = np.maximum(np.minimum(1.02 * now + 1e-3, limits.acceleration), now + 1e-3)
        acceleration = np.maximum(0.97 * share * limits.acceleration, ease)
        none = np.full(self.model.dof, np.inf)
        return replace(
            limits, lower=lower, upper=upper, velocity=velocity, acceleration=acceleration, torque=none, power=none
        )

    def _torque_constraints(
        self, state: State, limits: MotionLimits, knowledge: RobotKnowledge
    ) -> tuple[MotionConstraint, ...]:
        """Torques by the present estimate, less three standard deviations of what is not known of them.

        Where this leaves too little, half of the limit; and always what the present state needs and some more, so that
        assumed masses that are too large do not forbid every motion. Commands stay within the limits in any case.
        """
        bound = self.limits.torque
        if not np.isfinite(bound).any():
            return ()
        now = np.abs(self._predicted((state[0][None], state[1][None], state[2][None]), knowledge.parameters)[0])
        vjp, held = self._torque_vjp
        held[:] = knowledge.parameters
        most = np.maximum.reduce([bound - 3.0 * knowledge.deviations, 0.5 * bound, 1.5 * now])
        return (TorqueLimit(vjp, limits.joint_names, most),)

    def _prepare(self, plan: _Plan, motion: State) -> None:
        """Compute what a plan is played with: torques, gains, and the bound of the torques."""
        knowledge = plan.knowledge
        torque = self._predicted(motion, knowledge.parameters)
        plan.reference = _Reference(plan.time, self.sample_time, *motion, torque)
        some = np.unique(np.linspace(0, len(motion[0]) - 1, 40).astype(int))
        q, dq, ddq = (part[some] for part in motion)
        size = self.model.dof
        inertia = np.asarray(self.model.kernel("total_inertia_matrix")(motion[0], knowledge.parameters))
        plan.inertia = inertia.reshape(len(motion[0]), size, size).copy()
        values, spreads = self._learner.inertias(q, knowledge)
        # What is assumed of a joint may be ten thousand times too little, where the shape of its link is a mark of a
        # centimetre and its rotor is not: feedback for that alone holds nothing. A loop bears too large an inertia much
        # better than one that is too small, so that one standard deviation is added.
        # Before anything is known it is added as of a heavier robot of the same shape: where its neighbours are free to
        # move, a joint has a small part of the inertia that it has alone, and what is added to the diagonal would be
        # added to that part.
        joints, added = np.arange(size), spreads.mean(axis=0)
        if knowledge.is_measured:
            plan.inertia[:, joints, joints] += added
        else:
            alone = np.maximum(np.diagonal(plan.inertia, axis1=1, axis2=2), 1e-12)
            plan.inertia[:, joints, joints] = alone
            heavier = np.sqrt(1.0 + added / alone.mean(axis=0))
            plan.inertia *= heavier[:, None] * heavier
        own = np.diagonal(plan.inertia, axis1=1, axis2=2).mean(axis=0)
        plan.bandwidth = BANDWIDTH * np.clip((1.0 - SURE * spreads / values).min(axis=0), LEAST_SHARE, 1.0)
        before = self._plan
        if before is not None and before.stiffness.any():
            plan.bandwidth = np.minimum(
                plan.bandwidth, np.sqrt(GROWTH * before.stiffness * np.maximum(self._share.values, 1.0) / own)
            )
        plan.stiffness = plan.bandwidth**2 * own
        spread = self._learner.torque_deviations(q, dq, ddq, knowledge).max(axis=0)
        reserve = REACH * plan.stiffness + 3.0 * knowledge.noise
        plan.bound = np.minimum(self.limits.torque, np.abs(torque).max(axis=0) + TORQUE_BAND * spread + reserve)
        speeds = np.minimum(np.abs(motion[1]).max(axis=0), 0.9 * self.limits.velocity)
        plan.fastest = speeds + OVERSPEED * (self.limits.velocity - speeds)

    # Playing

    def _move_on(self, t: float) -> None:
        """Ask for the next plan when it is time, and take it over when it is there."""
        plan = self._plan
        assert plan is not None
        assert self._reference is not None
        if self._stage == "done":
            return
        if self._waiting is None and t >= self._asked:
            time = max(self._asked + self._lead, t + (self._lead if self._background else self.sample_time))
            q, dq, ddq = self._reference.state(time)
            state = (q.copy(), dq.copy(), ddq.copy())
            log = self._log[: self._count].copy()
            if self._background:
                if self._pool is None:
                    self._pool = ThreadPoolExecutor(1, thread_name_prefix="excitation")
                self._waiting = self._pool.submit(self._next, log, time, state)
            else:
                self._waiting = Future()
                try:
                    self._waiting.set_result(self._next(log, time, state))
                except (SteelyardError, np.linalg.LinAlgError) as failure:
                    self._waiting.set_exception(failure)
        if self._waiting is not None and self._waiting.done():
            fault = self._waiting.exception()
            if fault is not None:  # a control loop must go on: the motion that is played ends at rest
                self.interruptions.append((t - self._started, f"no further motion could be planned: {fault}"))
                self._waiting = None
                self._finish(t)
                return
            following = self._waiting.result()
            if t < following.time - 0.5 * self.sample_time:
                return
            self._waiting = None
            if following.knowledge is not self._knowledge and following.knowledge.contradicted:
                joints = ", ".join(following.knowledge.contradicted)
                self.changes.append(
                    (
                        t - self._started,
                        f"the torques of {joints} are no longer those of before: the robot carries something else, or "
                        "its friction or a torque sensor has changed; it is learnt anew",
                    )
                )
            self._knowledge = following.knowledge
            if following.played == np.inf:
                self._finish(t)
            elif following.reference is None or t > following.time + 2.0 * self.sample_time:
                self._asked = t + RETRY  # too late, or none was found: the motion goes on to rest meanwhile
                if following.reference is not None:
                    self._lead = 1.5 * (self._lead + t - following.time)
                else:
                    self._pace = max(0.8 * self._pace, 0.1)
            else:
                self._motions += 1
                self._take(following, t, "cautious" if self._motions <= len(STAGES) else "exciting")

    def _take(self, plan: _Plan, t: float, stage: str) -> None:
        """Pass over to a plan, without a jump of the torque."""
        assert plan.reference is not None
        before = self._reference
        self._note(plan, t, stage)
        if before is not None:
            self._joins = True
            if plan.knowledge.is_measured:  # the model carries the weight that the integral carried so far
                self._integral = np.zeros_like(self._integral)
                self._share.release()
        self._plan, self._reference, self._switched, self._stage = plan, plan.reference, t, stage
        self._asked = plan.time + max(plan.played - self._lead, 0.0)
        if before is not None and stage != "stopping":
            kept = np.maximum(1.5 * self._largest + LEAST_ROOM, FORGETTING * self._room)
            self._room = np.clip(kept, LEAST_ROOM, TRACKING)
            kept = np.maximum(1.5 * self._largest_speed, FORGETTING * self._speed_room)
            self._speed_room = np.clip(kept, FREE * self.limits.velocity, 0.4 * self.limits.velocity)
            self._pace = min(1.0, 1.5 * self._pace)
        self._largest, self._largest_speed = np.zeros(self.model.dof), np.zeros(self.model.dof)

    def _finish(self, t: float) -> None:
        self._stage = "done"
        assert self._plan is not None
        self._note(replace(self._plan, knowledge=self._knowledge), t, "done")

    def _note(self, plan: _Plan, t: float, stage: str) -> None:
        known = plan.knowledge
        self.steps.append(
            ExcitationStep(
                t - self._started,
                stage,
                known.expected_error,
                known.joint_errors,
                plan.stiffness,
                plan.bandwidth,
                plan.bound,
                self._largest.copy(),
            )
        )

    def _trouble(self, t: float, q: Array, dq: Array, error: Array) -> str:
        """Return why the motion must be broken off, or nothing."""
        names = self.model.robot.joint_names
        assert self._plan is not None
        assert self._reference is not None
        # The reference stands still already, or is on its way to.
        if self._stage in ("hold", "stopping") or t >= self._reference.end:
            return ""
        way = 0.5 * dq**2 / self.limits.acceleration
        for bad, what in (
            (np.abs(error) > TRACKING, "is far from its reference"),
            (np.abs(dq) > self._plan.fastest, "is nearly at its limit of velocity"),
            ((dq < 0.0) & (q - self.limits.lower < way), "could not stop before its lower limit"),
            ((dq > 0.0) & (self.limits.upper - q < way), "could not stop before its upper limit"),
        ):
            if bad.any():
                return f"{names[int(np.flatnonzero(bad)[0])]} {what}"
        return ""

    def _tell_excess(self, t: float, q: Array, dq: Array, full: NDArray[np.bool_]) -> None:
        """Keep when a joint first passed its limit of velocity or one of position, and why."""
        coarse = self._share.reading
        outside = (q < self.limits.lower - coarse) | (q > self.limits.upper + coarse)
        for passed, told, what in (
            (np.abs(dq) > self.limits.velocity, self._fast, "turned faster than its limit of velocity"),
            (outside, self._outside, "passed a limit of position"),
        ):
            for k in np.flatnonzero(passed & ~told):
                told[k] = True
                swings = any(joint == k for _, joint in self._share.taken_back)
                why = "it has more inertia than its feedback was for, or was pushed"
                if told is self._outside and self._stage == "hold":
                    why = "it sank while its weight was not known; begin further from its limits"
                if swings:
                    why = "it swings, since its inertia is far from what its feedback was for"
                if full[k]:
                    why = "its drive is at its limit of torque"
                self.exceeded.append((t - self._started, f"{self.model.robot.joint_names[k]} {what}: {why}"))

    def _break_off(self, t: float, q: Array, dq: Array, reason: str) -> None:
        """Come to rest from the measured state, and plan anew, more slowly."""
        self.interruptions.append((t - self._started, reason))
        self._pace = max(0.5 * self._pace, 0.1)
        self._waiting = None
        fastest = FASTEST_STOP * self.limits.velocity
        dq = np.clip(dq, -fastest, fastest)
        # The curve that stops has 1.5 times the mean deceleration, and here twice the limit of the reference at most.
        speed = np.maximum(np.abs(dq), 1e-9)
        shortest = 0.75 * speed / self.limits.acceleration
        duration = max(0.2, float(np.max(shortest, initial=0.0)))
        room = np.minimum(LEAST_ROOM, 0.25 * (self.limits.upper - self.limits.lower))
        ahead = np.where(dq < 0.0, q - self.limits.lower, self.limits.upper - q) - room
        lasts = np.clip(2.0 * ahead / speed, shortest, duration)  # sooner where a limit is near
        times = np.arange(0.0, duration + self.sample_time, self.sample_time)
        part = np.minimum(times[:, None] / lasts, 1.0)
        motion = (
            q + dq * lasts * part * (1.0 - part**2 * (1.0 - 0.5 * part)),
            dq * (1.0 - part**2 * (3.0 - 2.0 * part)),
            -6.0 * dq / lasts * part * (1.0 - part),
        )
        plan = _Plan(t, self._knowledge, duration + 0.5)
        self._prepare(plan, motion)
        assert plan.reference is not None
        # Friction helps to stop; that of an estimate that is wrong, fed forward, would drive the joint on.
        still = np.zeros_like(motion[1])
        plan.reference.torque = self._predicted((motion[0], still, motion[2]), self._knowledge.parameters)
        self._take(plan, t, "stopping")
