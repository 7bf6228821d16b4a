"""Search for the probable cause of a poor prediction: mistakes in a log or its robot file, each of which is tried."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.display import percent
from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.estimators.marginal_likelihood import (
    LEAST_ERROR,
    BodyPrior,
    LikeliestRobot,
    Moments,
    believable_bodies,
    body_priors,
    gains_of_factors,
    likeliest_factors,
    likeliest_robot,
    moments,
)
from steelyard.estimators.physical_prior import nonnegative_terms
from steelyard.files import tell
from steelyard.recording import Samples
from steelyard.recording.correction import Correction, Settings, toml_inline, toml_text
from steelyard.recording.diagnosis.detectors import clipped_rows, saturation_levels

__all__ = ["Hypothesis", "find_mistakes", "sentence", "wrong_torque_signs"]

Array = NDArray[np.float64]
Order = tuple[int, ...]

ROWS = 500
"""Samples that are used, evenly spread. Twice as many take twice as long and rank the same."""
POOR, POOR_JOINT = 0.05, 0.2
"""Relative errors of all the torques, and of one joint's, that leave something to be explained."""
DOUBTFUL, DOUBTFUL_JOINT = 0.025, 0.08
"""Relative errors, of all the torques and of one joint's, from which hypotheses are tried: rotors that are missing,
coupled wrists and zeros of a weak motion leave no more. About half of the sound logs of six arms are above, and none of
them is accused of anything."""
GAIN = 10.0
"""Least gain (logarithm of the odds) of a hypothesis that is told: the best of hundreds on a sound log gains 6."""
GAINS = {"payload": 30.0, "coupled motors": 30.0}
"""Least gains of some kinds in its place: much that a model lacks looks like another mass at the end of a chain, or
like friction of another kind. On a real Kinova Gen3 a payload gained 13, where the description leaves out a gripper,
and a coupled motor that it does not have 12; 130 and more where arms have one."""
END_BODIES = (0.3, 0.1, 0.03)
"""Masses, as parts of that of all links, by which the body at the end of a chain may be another than the description's,
with what it carries. A tool or a payload is no mistake of a log, so that others must explain the log better than it:
of 30 simulated arms with payloads of 0.3 to 2.5 kg, one was accused of torques that are 1.5 times too large."""
MASS_DOUBT = 0.25
"""Part of the mass of a link with its payload that counts as a standard deviation beside that of the fit, since bodies
of other links are wrong by more than their prior says: on nine simulated arms that carry something the mass was wrong
by 28 %, and by 2.6 times the standard deviation of the fit (root mean squares)."""
FALLEN = 0.75
"""Share of the error, of all torques or of one joint, that is left at most."""
STILL_WRONG = 0.2
"""Relative error of all the torques, above which a model is wrong, see `prediction_verdict`: a mended log with as much
may have another mistake, or be of another robot, to which one mistake after the other fits a little better."""
HEAVIER = 4.0
"""Factor of all torques from which it is told where the error does not fall: motors and cables explain two."""
EQUAL = 4.0
"""Hypotheses that gain so much less than the best are as likely for all that one log can tell."""
HOPELESS = 100.0
"""A hypothesis so much worse than the best is not refined."""
MANY_JOINTS, TOO_MANY_JOINTS = 10, 20
"""Beyond the first number pairs are only those of neighbours; beyond the second nothing is tried: a search takes a
minute and a half for a humanoid of 32 joints."""
FEWEST = 50
"""Samples of each joint below which a log tells too little."""
THOUSAND, DEGREE, TURN = 1e3, np.pi / 180.0, 2.0 * np.pi
SIZES = (10.0, 100.0, THOUSAND, 1e4)
"""How many times too large all torques may be for a robot whose masses nobody knows. Logarithms of the likelihood of
one and of the next differ by 0.7 to 10 near the best of torques that are 100 times too large on simulated arms."""
MOTION_UNITS = ("position unit", "gear ratio", "time unit")
TERMS = {
    "rotor_inertia": "The model lacks the inertia of the rotors",
    "offset": "The model lacks constant offsets of the torques",
    "viscous": "The model lacks viscous friction",
    "coulomb": "The model lacks Coulomb friction",
}
FRICTION = ("viscous", "coulomb")
WIDTH = 5
"""Orders of joints from which exchanges are tried once more."""
DELAYS = (-0.1, -0.05, -0.02, -0.01, 0.005, 0.01, 0.02, 0.035, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3)
"""s that are tried first."""
NEARBY_DELAYS = (0.002, 0.01)
"""s. Where the torques are explained to within `POOR`, a delay is small beside what the motion does, and the
likelihoods of the log with such a delay, earlier and later, tell by a parabola what any delay would gain. Where that is
next to nothing by both, the others are not tried, which take most of the time of a look at a sound log. One step does
not do: with the second alone a gain of 13 at 2 ms was passed by."""
TILT, TILTS = 0.3, 1e3
"""rad by which the search for the direction of gravity steps aside first, and how many directions count as told apart:
logs tell them to within some three degrees, and a sphere has so many patches of that size."""
LEAST_TILT = 3.0
"""Degrees by which a base must be tilted to be told so: smaller tilts explain a part of many errors of a model. On the
real log of a Gen3, which nobody tilted, one of 1 degree halves the error of the joint about the vertical axis."""
RATIOS = np.geomspace(1.5, 1000.0, 105)
"""The ratios of gears that are tried: positions that are 6 % off over two radians are 0.12 rad off, from which the best
can be found."""
ABSURD_SPAN, ABSURD_SLIDE, ABSURD_SPEED = 2.2 * np.pi, 3.0, 8.0
"""rad, m, and rad/s or m/s that joints of robots exceed seldom, and motors in front of gears nearly always."""
LOG_ABSURD = 0.7
"""Standard deviation of the logarithm of what is beyond."""
BEYOND, MOST_BEYOND = 0.2, 8.0
"""rad or m beyond a limit that is one standard deviation, and the most that a joint's limits count: some descriptions
have none, and some have wrong ones."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A mistake that would explain why a model predicts a log poorly.

    Attributes
    ----------
    kind : str
        ``"torque sign"``, ``"joint order"``, ``"gravity"`` and so on.
    statement : str
        What looks wrong, without a full stop.
    correction : Correction
        What would mend it.
    gain : float
        Logarithm of the odds against the log being as it should, from the marginal likelihoods of both; how many other
        hypotheses of this kind there are has been taken off.
    error_before, error_after : float
        Relative error of the torques of which the evidence speaks, each stretch of the log predicted by the others.
    joint : str or None
        The joint whose torques these are; None for all of them.
    evidence : str
        What speaks for it, as the second half of a sentence: how far the error falls, or where it does not, what else
        becomes likely (masses, a motion within the limits).
    settings : dict
        What robot.toml would have to say, see `correction_settings`; empty where no robot file is known.
    """

    kind: str
    statement: str
    correction: Correction
    gain: float
    error_before: float
    error_after: float
    joint: str | None
    evidence: str
    settings: Settings = field(default_factory=dict)

    @property
    def toml(self) -> str:
        """`settings` as TOML."""
        return toml_text(self.settings)

    def __repr__(self) -> str:
        return f"Hypothesis({self.kind}: {self.statement}; mended, {self.evidence})"


def sentence(hypotheses: Sequence[Hypothesis]) -> str:
    """Say what is probably wrong with a log, and what would mend it.

    Parameters
    ----------
    hypotheses : sequence of Hypothesis
        With settings.
    """
    told = [f"{one.statement}: with {toml_inline(one.settings)} {one.evidence}" for one in hypotheses]
    first, *others = told
    if not others:
        return f"{first}."
    return f"{first}. This log cannot distinguish it from another mistake: {'; or: '.join(others)}."


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A fit and what it was made of, so that it can be repeated on parts of the data."""

    fit: LikeliestRobot
    given: Moments
    prior: BodyPrior
    nonnegative: NDArray[np.bool_]
    torques: Array | None

    @property
    def cost(self) -> float:
        return self.fit.cost

    @property
    def held_out(self) -> LikeliestRobot:
        return likeliest_robot(self.given, self.prior, self.nonnegative, self.torques, held_out=True)


@dataclass(frozen=True, eq=False)
class _Candidate:
    kind: str
    statement: str
    correction: Correction
    cost: float
    fitted: _Fitted
    usual: _Fitted | None = None
    """The fit without it, where that is of other rows than the base's."""


@in_one_thread
def find_mistakes(
    model: Model,
    samples: Samples,
    *,
    dense: Callable[[], Samples | None] | None = None,
    known: Sequence[Hypothesis] = (),
    begin: Callable[[bool], bool] | None = None,
    priors: tuple[BodyPrior, ...] | None = None,
) -> tuple[Hypothesis, ...]:
    """Try what may be wrong with a log, and return what would explain its torques far better.

    The hypotheses: signs and order of the columns of positions, of torques and of both; units, gear ratios and torque
    constants; coupled joints and motors; zeros of the joints; the direction of gravity; delay; terms that are missing;
    payload. Each is judged by the marginal likelihood of the torques among robots like this one (see
    `marginal_likelihood`), so that one with more parameters, or one of many, does not win by chance.

    Parameters
    ----------
    model : Model
    samples : Samples
        Of one log, thinned out evenly if at all; some hundreds are used.
    dense : callable, optional
        Returns samples of a shorter stretch, close enough in time to tell a delay, where `samples` are not.
    known : sequence of Hypothesis
        Found in other logs of the robot; tried first, and nothing else where one of them explains this log.
    begin : callable, optional
        Called before everything is tried, with whether the factor of a joint's torques seems wrong, which errors hardly
        show; nothing is tried where it returns False.
    priors : tuple of BodyPrior, optional
        What `body_priors` returned of the model, for several logs.

    Returns
    -------
    tuple of Hypothesis
        The likeliest first, and others that are as likely. Empty where the log is explained well, where nothing that
        was tried explains it much better, and for robots of more than 20 joints, for which nothing is tried.

    Examples
    --------
    >>> import steelyard as sy
    >>> robot = sy.Robot.from_dh([("pi/2", 0.0, 0.3, "q"), (0, 0.4, 0, "q")]).with_terms(sy.Viscous(), sy.Coulomb())
    >>> model = sy.Model(robot)
    >>> t = np.arange(0.0, 20.0, 0.04)[:, None]
    >>> speed = np.array([0.9, 1.3])
    >>> q, dq, ddq = np.sin(speed * t), speed * np.cos(speed * t), -(speed**2) * np.sin(speed * t)
    >>> parameters = np.zeros(model.parameter_count)
    >>> parameters[model.link_columns[1][[0, 3, 5, 6, 9]]] = 0.01, 0.2, 0.2, -0.4, 2.0
    >>> parameters[[10, 11, 22, 23]] = 0.3, 0.5, 0.2, 0.4
    >>> torque = model.inverse_dynamics(q, dq, ddq, parameters)
    >>> find_mistakes(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    ()
    >>> wrong = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque * [1, -1])
    >>> [(found.kind, found.statement) for found in find_mistakes(model, wrong)]
    [('torque sign', 'The sign of the torque of joint2 looks wrong')]
    """
    samples = _without_clipped(samples)
    memory = _Memory.of(model, samples)
    model = model.without_channels  # a mistake is larger than what a temperature changes
    if memory is not None:
        samples = memory.taken_off(samples)
        dense = memory.taken_off_all(dense)
    if not _are_enough(model, samples):
        return ()
    search = _Search(model, samples, dense, body_priors(model) if priors is None else priors)
    if not search.is_poor():
        return ()
    search.try_known(known)
    found = search.hypotheses()
    if not (found and search.explained()) and (begin is None or begin(search.strained)):
        search.try_everything()
        found = search.hypotheses()
    return found


def wrong_torque_signs(model: Model, samples: Samples) -> tuple[Hypothesis, ...]:
    """Return which torques look to have the wrong sign, by the rules of `find_mistakes`, which tries everything else.

    It takes a hundredth of the time, 0.3 s for seven joints. Where another mistake explains the torques as well, this
    one is told.

    Parameters
    ----------
    model : Model
    samples : Samples

    Examples
    --------
    >>> import steelyard as sy
    >>> robot = sy.Robot.from_dh([("pi/2", 0.0, 0.3, "q"), (0, 0.4, 0, "q")]).with_terms(sy.Viscous(), sy.Coulomb())
    >>> model, t, speed = sy.Model(robot), np.arange(0.0, 20.0, 0.04)[:, None], np.array([0.9, 1.3])
    >>> q, dq, ddq = np.sin(speed * t), speed * np.cos(speed * t), -(speed**2) * np.sin(speed * t)
    >>> parameters = np.zeros(model.parameter_count)
    >>> parameters[model.link_columns[1][[0, 3, 5, 6, 9]]] = 0.01, 0.2, 0.2, -0.4, 2.0
    >>> parameters[[10, 11, 22, 23]] = 0.3, 0.5, 0.2, 0.4
    >>> torque = model.inverse_dynamics(q, dq, ddq, parameters) * [1, -1]
    >>> [found.statement for found in wrong_torque_signs(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))]
    ['The sign of the torque of joint2 looks wrong']
    """
    if not _are_enough(model, samples):
        return ()
    search = _Search(model, samples, None, body_priors(model))
    search.try_torque_signs()
    return search.hypotheses()


def _are_enough(model: Model, samples: Samples) -> bool:
    """Return whether hypotheses are tried on samples: enough of them, of a robot that moves and has not many joints."""
    enough = samples.count >= FEWEST and samples.used.min() >= FEWEST and np.any(samples.torque != 0.0, axis=0).all()
    return bool(model.dof <= TOO_MANY_JOINTS and enough and samples.dq.any())


class _Memory(NamedTuple):
    """What friction that remembers the motion changes of torques, beside the same friction in steady sliding.

    Corrections of a motion have no state: it follows from every row before, of which few are looked at. The state of
    the log as it is stands in for it, with the friction that least squares gives.
    """

    model: Model
    parameters: Array

    @classmethod
    def of(cls, model: Model, samples: Samples) -> _Memory | None:
        """Return it by the samples of a log; None where no term of the model remembers, or they have no states."""
        model = model.without_logged_channels
        if not model.remembers or model.bristles.channel not in (samples.channels or {}):
            return None
        rows = np.arange(0, samples.count, -(-samples.count // ROWS))
        logged = {name: values[rows] for name, values in (samples.channels or {}).items()}
        used = samples.used_rows[rows]
        columns = model.regressor(samples.q[rows], samples.dq[rows], samples.ddq[rows], channels=logged)[used]
        sizes = np.sqrt(np.sum(columns**2, axis=0))
        sizes[sizes == 0.0] = 1.0
        return cls(model, np.linalg.lstsq(columns / sizes, samples.torque[rows][used], rcond=1e-9)[0] / sizes)

    def taken_off(self, samples: Samples) -> Samples:
        """Return samples with torques as if friction slid steadily at all times."""
        if self.model.bristles.channel not in (samples.channels or {}):
            return samples
        motion = samples.q, samples.dq, samples.ddq
        bent = self.model.inverse_dynamics(*motion, self.parameters, channels=samples.channels)
        sliding = self.model.without_channels.inverse_dynamics(*motion, self.parameters)
        return replace(samples, torque=samples.torque - bent + sliding)

    def taken_off_all(self, dense: Callable[[], Samples | None] | None) -> Callable[[], Samples | None] | None:
        """Return what returns the same of other samples."""
        if dense is None:
            return None

        def found() -> Samples | None:
            samples = dense()
            return None if samples is None else self.taken_off(samples)

        return found


def _without_clipped(samples: Samples) -> Samples:
    """Mask rows of clipped torques: what no model explains looks like friction of a motor that moves two joints."""
    _, clipped = clipped_rows(samples.torque, saturation_levels(samples.torque))
    if not clipped.any():
        return samples
    return replace(samples, mask=samples.used_rows & ~clipped)


def _some(samples: Samples, among: NDArray[np.bool_] | None = None) -> Samples:
    """ROWS samples at most, evenly spread."""
    rows = np.arange(samples.count) if among is None else np.flatnonzero(among)
    rows = rows[:: -(-len(rows) // ROWS)]
    return Samples(
        q=samples.q[rows],
        dq=samples.dq[rows],
        ddq=samples.ddq[rows],
        torque=samples.torque[rows],
        mask=None if samples.mask is None else samples.mask[rows],
        t=None if samples.t is None else samples.t[rows],
    )


class _Search:
    """The hypotheses that were tried on one log, with what came of each."""

    def __init__(
        self, model: Model, samples: Samples, dense: Callable[[], Samples | None] | None, priors: tuple[BodyPrior, ...]
    ) -> None:
        self.model, self.source, self.dense = model, samples, dense
        self.samples = samples = _some(samples)
        self.count = model.dof
        self.names = model.robot.joint_names
        joints = [model.robot.joints[i] for i in model.robot.driving_joints]
        self.turning = np.array([joint.rotates for joint in joints])
        self.limits = np.array([joint.lower for joint in joints]), np.array([joint.upper for joint in joints])
        self.strangeness = self._strangeness(samples)
        self.priors = priors
        self.scale = len(self.priors) // 2
        self.nonnegative = nonnegative_terms(model)
        self.found: list[_Candidate] = []
        self.tried: set[str] = set()
        self.whole = 0.0  # logarithm of the likeliest factor of all torques, as far as it was looked for
        self.given = moments(model, samples)
        self.best = np.inf
        self.base = self._fit(self.given)
        self.scale = self.priors.index(self.base.prior)
        self.best = self.innocent = self.base.cost
        self.strained = bool(gains_of_factors(self.given, self.base.prior, self.base.fit).max() > GAIN)

    # Fits

    def _fit(
        self,
        given: Moments,
        torques: Array | None = None,
        *,
        refine: bool = True,
        further: NDArray[np.bool_] | None = None,
    ) -> _Fitted:
        """The likeliest robot; where the description has no masses, also over those that robots have.

        The cost is smooth in the scale of the masses; the search goes downhill from that of the log as it is, unless
        the hypothesis is far behind there. `further` says which columns beyond those of the model cannot be negative.
        """
        known: dict[int, _Fitted] = {}
        nonnegative = self.nonnegative if further is None else np.concatenate([self.nonnegative, further])

        def cost(k: int) -> float:
            if not 0 <= k < len(self.priors):
                return np.inf
            if k not in known:
                fit = likeliest_robot(given, self.priors[k], nonnegative, torques)
                known[k] = _Fitted(fit, given, self.priors[k], nonnegative, torques)
            return known[k].cost

        k = self.scale
        if cost(k) > self.best + HOPELESS and not refine:
            return known[k]
        while True:
            nearby = min((k, k + 1, k - 1), key=cost)
            if nearby == k:
                return known[k]
            k = nearby

    def _moments(self, correction: Correction) -> Moments:
        return moments(self.model, replace(correction, torques=None).apply(self.samples), gravity=correction.gravity)

    def _try(
        self,
        kind: str,
        statement: str,
        correction: Correction,
        choices: float,
        given: Moments | None = None,
        *,
        anywhere: bool = False,
        further: NDArray[np.bool_] | None = None,
    ) -> float:
        """Keep a hypothesis of which there are so many like it, and return its cost."""
        if given is None:
            given = self._moments(correction)
        fitted = self._fit(given, correction.torques, refine=anywhere, further=further)
        cost = fitted.cost + float(np.log(choices))
        if correction.positions is not None or correction.offset is not None or correction.time != 1.0:
            cost += self._strangeness(correction.apply(self.samples)) - self.strangeness
        return self._keep(kind, statement, correction, cost, fitted)

    def _keep(
        self,
        kind: str,
        statement: str,
        correction: Correction,
        cost: float,
        fitted: _Fitted,
        usual: _Fitted | None = None,
    ) -> float:
        self.found.append(_Candidate(kind, statement, correction, cost, fitted, usual))
        tell("trying what may be wrong", len(self.found), None, "mistakes")
        if cost < self.best:
            self.best = cost
            if fitted.prior in self.priors and fitted.torques is None:
                self.scale = self.priors.index(fitted.prior)  # others start where the best so far is
        return cost

    def _may_be_told(self, cost: float, choices: float) -> bool:
        """Return whether a hypothesis, of which there are so many like it, is among the likeliest so far."""
        cost += float(np.log(choices))
        return cost < self.base.cost - GAIN and cost < self.best + EQUAL

    def _strangeness(self, samples: Samples) -> float:
        """Return what speaks against a motion, as a logarithm of odds: beyond the limits, of many turns, too fast."""
        q, n = samples.q, self.count
        low, high = self.limits
        beyond = np.maximum(np.maximum(low - q.min(axis=0), q.max(axis=0) - high), 0.0) / BEYOND
        cost = float(np.minimum(0.5 * beyond**2, MOST_BEYOND).sum())
        span, speed = np.ptp(q, axis=0), np.abs(samples.dq).max(axis=0)
        usual = np.where(self.turning, ABSURD_SPAN, ABSURD_SLIDE), np.full(n, ABSURD_SPEED)
        for values, most in zip((span, speed), usual, strict=True):
            cost += 0.5 * float(np.sum((np.log(np.maximum(values / most, 1.0)) / LOG_ABSURD) ** 2))
        return cost

    # Whether anything is wrong

    def is_poor(self) -> bool:
        """Return whether the log as it is leaves something to be explained; what costs little is tried in any case."""
        base = self.base.fit
        poor = self.strained or base.error > DOUBTFUL or bool(np.any(base.errors > DOUBTFUL_JOINT))
        poor = poor or self.strangeness > 0.5 * GAIN or base.torque_surprise.max() > 0.5 * GAIN
        for attempt in (self._whole_scales, self._payloads, *([self._delays] if poor else [])):
            self._once(attempt)
        gaining = [candidate.kind for candidate in self.found if self.base.cost - candidate.cost > GAIN]
        if "torque unit" in gaining:  # any smaller factor makes torques fit that are too large, too
            self._once(self._whole_factor)
        found = bool(gaining)
        if found:  # rotors behind gears make torques as large as a wrong unit or a payload would, and units make rotors
            self._once(self._missing_terms)
            self._once(self._units)
        return poor or found

    def _once(self, attempt: Callable[[], None]) -> None:
        if attempt.__name__ not in self.tried:
            self.tried.add(attempt.__name__)
            attempt()

    # Hypotheses

    def try_known(self, known: Iterable[Hypothesis]) -> None:
        """Try what was found in another log, where it is a change of the log or of gravity."""
        for one in known:
            correction = one.correction
            of_model = correction.terms or correction.coupling is not None or correction.payload is not None
            if not of_model and not correction.delay:
                self._try(one.kind, one.statement, one.correction, 1.0, anywhere=True)

    def explained(self) -> bool:
        """Return whether the best hypothesis leaves nothing to be explained."""
        fit = min(self.found, key=lambda candidate: candidate.cost).fitted.fit
        return not (fit.error > POOR or np.any(fit.errors > POOR_JOINT))

    def try_everything(self) -> None:
        """Try all kinds of mistakes."""
        attempts = [self._whole_scales, self._payloads, self._delays, self._torque_signs, self._torque_orders]
        attempts += [self._torque_scales, self._missing_terms, self._units, self._gravities]
        attempts += [self._position_signs, self._orders, self._couplings, self._coupled_motors]
        attempts += [self._zeros, self._gear_ratios]
        for attempt in attempts:
            self._once(attempt)

    def try_torque_signs(self) -> None:
        """Try the signs of torques alone."""
        self._once(self._torque_signs)

    def _pairs(self) -> list[tuple[int, int]]:
        near = self.count if self.count <= MANY_JOINTS else 2
        return [(i, j) for i, j in combinations(range(self.count), 2) if j - i < near]

    def _flipped(self) -> Iterator[tuple[str, Array, float]]:
        """Joints in words, the matrix that changes their signs, and how many such choices there are."""
        n = self.count
        for k in range(n):
            yield f"of {self.names[k]} looks", _signs(n, (k,)), n
        pairs = self._pairs() if n > 2 else []
        for i, j in pairs:
            # Two wrong signs are rarer than one.
            yield f"of {self.names[i]} and of {self.names[j]} look", _signs(n, (i, j)), 3.0 * len(pairs)
        if n > 1:
            yield "of all joints look", -np.eye(n), 2.0

    def _torque_signs(self) -> None:
        for of_joints, matrix, choices in self._flipped():
            what = "sign of the torque" if of_joints.endswith("looks") else "signs of the torques"
            self._try("torque sign", f"The {what} {of_joints} wrong", Correction(torques=matrix), choices, self.given)

    def _position_signs(self) -> None:
        for of_joints, matrix, choices in self._flipped():
            given = self._moments(Correction(positions=matrix))
            # Positions are drawn by every tool, so that their signs are wrong less often than those of torques.
            one = of_joints.endswith("looks")
            what = "sign of the position" if one else "signs of the positions"
            statement = f"The {what} {of_joints} wrong"
            self._try("position sign", statement, Correction(positions=matrix), 2.0 * choices, given)
            what = "axis" if one else "axes"
            statement = f"The {what} {of_joints} reversed: positions and torques have the other sign"
            self._try("axis direction", statement, Correction(matrix, None, matrix), 2.0 * choices, given)

    def _torque_orders(self) -> None:
        n = self.count
        orders = {tuple(_exchanged(range(n), i, j)) for i, j in self._pairs()}
        orders |= {*_rotations(n), self._assignment()}
        for order in sorted(orders - {tuple(range(n))}):
            matrix = np.eye(n)[list(order)]
            self._try(
                "torque order",
                self._order_statement("torque columns", order),
                Correction(torques=matrix),
                self._orders_like(order),
                self.given,
            )

    def _assignment(self) -> Order:
        """Give every joint the torque that its own dynamics explain best, all together (an assignment problem)."""
        n, width, total = self.count, self.given.columns, self.given.total
        left = np.zeros((n, n))
        for k in range(n):
            used = np.diag(total[k, :width, :width]) > 0.0
            gram, cross = total[k, :width, :width][np.ix_(used, used)], total[k, :width, width:][used]
            sizes = np.sqrt(np.diag(gram))
            scaled = gram / np.outer(sizes, sizes) + 1e-6 * np.eye(len(gram))
            cross = cross / sizes[:, None]
            explained = np.einsum("ij,ij->j", cross, np.linalg.solve(scaled, cross))
            power = np.maximum(np.diag(total[k, width:, width:]), 1e-300)
            left[k] = np.log(np.maximum(1.0 - explained / power, LEAST_ERROR**2))
        return _assignment(left)

    def _orders(self) -> None:
        """Positions in another order, or both positions and torques: downhill by exchanges from likely orders."""
        n = self.count
        start = tuple(range(n))
        by_name = np.argsort(np.argsort(self.names))
        likely = {start, start[::-1], tuple(int(k) for k in by_name), tuple(int(k) for k in np.argsort(by_name))}
        paired = self._pairing()
        made: dict[Order, Moments] = {start: self.given}
        for kind, first in (
            ("position order", likely | {paired, tuple(np.argsort(paired).tolist())}),
            ("joint order", likely),
        ):
            costs: dict[Order, float] = {start: self.base.cost}

            def cost(order: Order, kind: str = kind, costs: dict[Order, float] = costs) -> float:
                if order not in costs:
                    matrix = np.eye(n)[list(order)]
                    if order not in made:
                        made[order] = self._moments(Correction(positions=matrix))
                    both = kind == "joint order"
                    statement = self._order_statement("columns" if both else "position columns", order)
                    correction = Correction(matrix, None, matrix if both else None)
                    costs[order] = self._try(kind, statement, correction, self._orders_like(order), made[order])
                return costs[order]

            for order in {min(sorted(first), key=cost), start}:
                here = order
                while True:
                    best = min([here, *(tuple(_exchanged(here, i, j)) for i, j in self._pairs())], key=cost)
                    if best == here:
                        break
                    here = best
            if kind == "joint order" and self.count <= MANY_JOINTS:
                # Exchanges get stuck where three joints must turn; each of the best is left in its turn.
                for order in sorted(costs, key=lambda order: costs[order])[:WIDTH]:
                    for i, j in self._pairs():
                        cost(tuple(_exchanged(order, i, j)))

    def _orders_like(self, order: Order) -> float:
        """Return how many orders count as much as this one: two columns that are swapped are likelier than more."""
        moved = sum(k != column for k, column in enumerate(order))
        return float(self.count) ** (2 if moved <= 2 else 3)

    def _pairing(self) -> Order:
        """Which velocity each torque follows as friction does, beyond what smooth functions of the motion explain."""
        s, n = self.samples, self.count
        smooth = np.concatenate([np.sin(s.q), np.cos(s.q), s.ddq, np.ones((s.count, 1))], axis=1)
        residual = s.torque - smooth @ np.linalg.lstsq(smooth, s.torque, rcond=None)[0]
        power = np.maximum((residual**2).sum(axis=0), 1e-300)
        left = np.zeros((n, n))
        for k in range(n):
            own = np.stack([np.sign(s.dq[:, k]), s.dq[:, k]], axis=1)
            own = own - smooth @ np.linalg.lstsq(smooth, own, rcond=None)[0]
            friction = np.linalg.lstsq(own, residual, rcond=None)[0]
            share = ((residual - own @ friction) ** 2).sum(axis=0) / power
            left[:, k] = np.where(friction[0] > 0.0, np.log(np.maximum(share, 1e-6)), 0.0)
        return _assignment(left)

    def _order_statement(self, what: str, order: Sequence[int]) -> str:
        moved = [k for k, column in enumerate(order) if k != column]
        if len(moved) == 2:
            return f"The {what} of {self.names[moved[0]]} and {self.names[moved[1]]} look swapped"
        names = ", ".join(self.names[list(order).index(k)] for k in range(self.count))
        return f"The {what} look to be in another order, namely that of {names}"

    def _whole_scales(self) -> None:
        for factor, how in ((1.0 / THOUSAND, "large, as if in mN·m"), (THOUSAND, "small")):
            correction = Correction(torques=factor * np.eye(self.count))
            statement = f"The torques look a thousand times too {how}"
            if factor < 1.0:
                statement = self._of_unknown_size() or statement
            self._try("torque unit", statement, correction, 2.0, self.given, anywhere=True)

    def _of_unknown_size(self) -> str:
        """Say between which factors torques look too large where no described mass tells which; else return nothing."""
        if len(self.priors) == 1:
            return ""
        costs = np.array([self._fit(self.given, np.eye(self.count) / size).cost for size in SIZES])
        sizes = [size for size, cost in zip(SIZES, costs, strict=True) if cost < costs.min() + GAIN]
        if len(sizes) < 2 or THOUSAND not in sizes:
            return ""
        units = " or ".join(unit for unit, size in (("N·cm", 100.0), ("mN·m", THOUSAND)) if size in sizes)
        return (
            f"The torques look {sizes[0]:.0f} to {sizes[-1]:.0f} times too large, as if in {units} (the description "
            "has no masses that tell by how much)"
        )

    def _whole_factor(self) -> None:
        """One factor of all the torques."""
        if len(self.priors) > 1:
            return  # the mass is not known, and no such factor either
        ones = np.ones(self.count)
        starts = np.arange(-8.0, 9.0, 2.0)
        self.whole = whole = _least(
            lambda log: self._fit(self.given, _scales(log * ones), refine=False).cost, starts, 8
        )
        # Close to a thousand it is the unit: masses of descriptions are wrong by tens of per cent, and more.
        if abs(abs(whole) - np.log(THOUSAND)) > np.log(HEAVIER):
            statement = f"All torques look {_times(whole)} too {_small(whole)}"
            correction = Correction(torques=_scales(whole * ones))
            self._try("torque scale", statement, correction, 1e4, self.given, anywhere=True)

    def _torque_scales(self) -> None:
        n = self.count

        def attempt(kind: str, statement: str, logs: Array, choices: float) -> None:
            self._try(kind, statement, Correction(torques=_scales(logs)), choices, self.given, anywhere=True)

        def cost(logs: Array) -> float:
            return self._fit(self.given, _scales(logs), refine=False).cost

        self._once(self._whole_factor)
        for k, own in enumerate(np.eye(n)):
            name = self.names[k]
            for log in (-np.log(THOUSAND), np.log(THOUSAND)):
                how = "large, as if in mN·m" if log < 0 else "small"
                # Nobody logs kN·m.
                choices = 4.0 * n if log < 0 else 1e3 * n
                attempt("torque unit", f"The torque of {name} looks a thousand times too {how}", log * own, choices)
            start = self._predicted_scale(k) + np.array([-1.0, -0.3, 0.0, 0.3, 1.0])

            def of_one(log: float, own: Array = own) -> float:
                return cost(log * own)

            log = _least(of_one, start, 5)
            found = cost(log * own)
            if self._may_be_told(found, 1e3 * n):
                from .mistake_sizes import exact_scale  # few logs have such a mistake

                exact = exact_scale(self.model, self.source, k, log)
                if exact is not None and cost(exact * own) < found + EQUAL:
                    log = exact
            attempt("torque scale", f"The torque of {name} looks {_times(log)} too {_small(log)}", log * own, 1e3 * n)
        logs = min(self._likely_scales(self.whole), key=cost)
        for own in np.eye(n):

            def of_one_more(log: float, others: Array = logs, own: Array = own) -> float:
                return cost(others + log * own)

            logs = logs + own * _least(of_one_more, np.array([-0.5, 0.0, 0.5]), 3)
        statement = "The torques look to be currents, or torques of the motors: each joint has a factor of its own"
        if len(self.priors) > 1:
            statement += " (one factor of all of them is a guess, for the description has no masses)"
        attempt("torque constants", statement, logs, 100.0**n)

    def _likely_scales(self, whole: float) -> list[Array]:
        """Logarithms of factors for all joints, from those with which the torques have the size that bodies need."""
        n, width = self.count, self.given.columns
        counts = np.maximum(self.given.counts.sum(axis=0), 1)
        sizes = np.sqrt([self.given.total[k, width + k, width + k] / counts[k] for k in range(n)])
        found = []
        for prior in self.priors:
            expected = prior.expected_torques(self.given.total[:, :width, :width], counts)
            found.append(np.log(likeliest_factors(self.given, prior, expected / sizes)))
        found.append(np.log(likeliest_factors(self.given, self.priors[self.scale], np.full(n, np.exp(whole)))))
        return found

    def _predicted_scale(self, k: int) -> float:
        """Logarithm of the factor of the torque of joint k that a fit to the other joints asks for."""
        others, width = self.given.total.copy(), self.given.columns
        others[k] = 0.0
        parameters, sums = self._fit(Moments(others, self.given.counts)).fit.parameters, self.given.total[k]
        modelled = parameters @ sums[:width, :width] @ parameters
        return float(0.5 * np.log(max(modelled, 1e-12) / max(sums[width + k, width + k], 1e-12)))

    def _missing_terms(self) -> None:
        kinds = {law.kind for term in self.model.robot.terms for law in term.laws}
        if "motor_side" in kinds:
            return
        s, n = self.samples, self.count
        columns = {"rotor_inertia": s.ddq, "offset": np.ones_like(s.q), "viscous": s.dq, "coulomb": np.sign(s.dq)}
        for kind, statement in TERMS.items():
            if kind in kinds:
                continue
            given = moments(self.model, s, extra=columns[kind][:, :, None] * np.eye(n))
            further = np.full(n, kind != "offset")
            self._try("missing term", statement, Correction(terms=(kind,)), float(len(TERMS)), given, further=further)

    def _payloads(self) -> None:
        """A body at the end of a chain that the description does not know."""
        bodies = believable_bodies(self.model)
        if bodies is None:
            return
        prior, ends = self.priors[0], self.model.robot.end_links
        for k in ends:
            columns = self.model.link_columns[k]
            fits = []
            for part in END_BODIES:
                wider = prior.with_payload(columns, part * float(bodies[:, 9].sum()))
                fits.append((likeliest_robot(self.given, wider, self.nonnegative), wider))
            fit, wider = fits[0]
            choices = float(np.log(len(ends) * len(END_BODIES)))
            self.innocent = min(self.innocent, *(other.cost + choices for other, _ in fits))
            mass, name = float(fit.parameters[columns[9]]), self.model.robot.link_names[k]
            more = mass - bodies[k, 9]
            if more < 0.5 * bodies[k, 9]:
                continue
            # Where the motion shows first moments alone, the mass is that of the prior.
            deviation = float(np.hypot(fit.standard_deviation(int(columns[9])), MASS_DOUBT * mass))
            statement = (
                f"{name} looks to carry a payload of {more:.2g} ± {deviation:.2g} kg that the description does not know"
            )
            correction = Correction(payload=(name, mass, deviation))
            fitted = _Fitted(fit, self.given, wider, self.nonnegative, None)
            self._keep("payload", statement, correction, fit.cost, fitted)

    def _units(self) -> None:
        n, turning = self.count, self.turning
        changes: list[tuple[str, str, NDArray[np.bool_], float]] = []
        for factor, said in ((DEGREE, "in degrees"), (1.0 / DEGREE, "57.3 times too small, radians taken for degrees")):
            changes.append(("The positions", said, turning, factor))
        # Drives that count revolutions do so at all joints.
        changes.append(("The positions", "in revolutions", turning, TURN))
        changes.append(("The positions", "in milliradians", turning, 1.0 / THOUSAND))
        for factor, said in ((1.0 / THOUSAND, "in mm"), (THOUSAND, "a thousand times too small, m taken for mm")):
            changes.append(("The positions of the sliding joints", said, ~turning, factor))
        if turning.any() and not turning.all():  # a controller that shows degrees shows mm, too
            both = np.diag(np.where(turning, DEGREE, 1.0 / THOUSAND))
            statement = "The positions look to be in degrees, and those of the sliding joints in mm"
            self._try("position unit", statement, Correction(positions=both), 4.0, anywhere=True)
        for what, said, which, factor in changes:
            if not which.any():
                continue
            matrix = np.diag(np.where(which, factor, 1.0))
            self._try("position unit", f"{what} look to be {said}", Correction(positions=matrix), 2.0, anywhere=True)
            if which.sum() == 1 or said in ("in revolutions", "in milliradians"):
                continue
            for k in np.flatnonzero(which):
                matrix = np.diag(np.where(np.arange(n) == k, factor, 1.0))
                statement = f"The position of {self.names[k]} looks to be {said}"
                self._try("position unit", statement, Correction(positions=matrix), 4.0 * n)
        for factor, said in ((1.0 / THOUSAND, "in ms"), (THOUSAND, "a thousand times too short, s taken for ms")):
            self._try("time unit", f"The times look to be {said}", Correction(time=factor), 2.0, anywhere=True)

    def _gear_ratios(self) -> None:
        n, s = self.count, self.samples
        absurd = (np.ptp(s.q, axis=0) > ABSURD_SPAN) | (np.abs(s.dq).max(axis=0) > ABSURD_SPEED)
        suspects = [int(k) for k in np.flatnonzero(absurd & self.turning)]
        for group in [[k] for k in suspects] + ([suspects] if len(suspects) > 1 else []):

            def divided(ratio: float, group: list[int] = group) -> Array:
                return np.diag([1.0 / ratio if k in group else 1.0 for k in range(n)])

            def cost(log: float, divided: Callable[[float], Array] = divided) -> float:
                return self._fit(self._moments(Correction(positions=divided(np.exp(log)))), refine=False).cost

            ratio = float(np.exp(_least(cost, np.log(RATIOS))))
            if ratio > 0.97 * RATIOS[-1]:
                continue
            ratio = round(ratio) if abs(ratio / max(round(ratio), 1) - 1.0) < 5e-3 else ratio
            matrix, names = divided(ratio), " and ".join(self.names[k] for k in group)
            names = "all turning joints" if len(group) == self.turning.sum() > 1 else names
            given = self._moments(Correction(positions=matrix))
            statement = f"The positions of {names} look to be those of the motors, in front of gears of 1:{ratio:.4g}"
            self._try("gear ratio", statement, Correction(positions=matrix), 1e2 * n, given, anywhere=True)
            statement = (
                f"Positions and torques of {names} look to be those of the motors, in front of gears of 1:{ratio:.4g}"
            )
            both = Correction(positions=matrix, torques=np.diag(1.0 / np.diag(matrix)))
            self._try("gear ratio", statement, both, 1e2 * n, given, anywhere=True)

    def _zeros(self) -> None:
        n = self.count
        angles = [angle for angle in range(-150, 181, 30) if angle]
        for k in np.flatnonzero(self.turning):

            def attempt(angle: float, k: int = int(k)) -> float:
                correction = Correction(offset=np.where(np.arange(n) == k, np.radians(angle), 0.0))
                statement = (
                    f"The zero of {self.names[k]} looks to be {abs(angle):.3g} degrees away from the description's"
                )
                # Quarter turns between two conventions are the rule, other angles the exception.
                return self._try("position offset", statement, correction, (6.0 if angle % 90 == 0 else 60.0) * n)

            costs = [attempt(angle) for angle in angles]
            k_best = int(np.argmin(costs))
            if costs[k_best] < min(self.base.cost - GAIN, self.best + HOPELESS):
                _least(attempt, angles[k_best] + np.array([-15.0, 0.0, 15.0]), 3)

    def _couplings(self) -> None:
        n = self.count
        for j, k in _neighbors(n):
            for factor in (-1.0, 1.0):
                matrix = np.eye(n)
                matrix[j, k] = factor
                given = self._moments(Correction(positions=matrix))
                moves = f"{self.names[j]} looks to be coupled with {self.names[k]}: "
                sign, names = ("less", "plus")[factor > 0], (self.names[j], self.names[k])
                position = f"its position is that of its column {sign} that of {names[1]}"
                both = 2.0 * np.eye(n) - matrix.T  # the inverse, transposed
                self._try(
                    "coupled joints",
                    f"{moves}{position}, and torques likewise",
                    Correction(matrix, None, both),
                    8.0 * n,
                    given,
                )
                self._try("coupled joints", f"{moves}{position}", Correction(matrix), 8.0 * n, given)
                torque = f"its torque is that of its column {sign} that of {names[1]}"
                self._try("coupled joints", f"{moves}{torque}", Correction(torques=matrix), 8.0 * n, self.given)

    def _coupled_motors(self) -> None:
        """A motor that turns when two neighbouring joints move, as in many wrists, so that it drags on both."""
        s, n, kinds = self.samples, self.count, {term.kind for term in self.model.robot.terms}
        if not set(FRICTION) <= kinds <= set(TERMS):
            return
        drags = ("damping", "friction", "rotor_inertia")
        own = np.reshape([k for k, kind in enumerate(self.model.described_as) if kind in drags], (n, -1))
        for other, k in _neighbors(n):
            if self.turning[k] != self.turning[other]:
                continue
            for sign in (-1.0, 1.0):
                coupling = np.eye(n)
                coupling[other, k] = sign
                motor = coupling[:, k]
                dq, ddq = s.dq @ motor, s.ddq @ motor
                extra = np.stack([dq, np.sign(dq), ddq], axis=1)[:, None, :] * motor[:, None]
                further = np.ones(extra.shape[2], bool)
                turns = f"turn with {self.names[k]} {('less', 'plus')[sign > 0]} {self.names[other]}"
                statement = (
                    f"The motor of {self.names[k]} looks to {turns}, so that its friction and its rotor act on both"
                )
                given = moments(self.model, s, extra=extra, without=own[k], coupling=coupling)
                correction = Correction(coupling=coupling)
                self._try("coupled motors", statement, correction, 4.0 * n, given, further=further)
                if k < other:
                    continue  # where all rub, nothing tells which of them the motor drives; it is mostly the outer one
                statement = f"A motor looks to {turns}, and its friction and its rotor to act on both beside their own"
                given = moments(self.model, s, extra=extra, coupling=coupling)
                correction = replace(correction, terms=FRICTION)
                self._try("coupled motors", statement, correction, 4.0 * n, given, further=further)

    def _gravities(self) -> None:
        own = np.asarray(self.model.robot.gravity, dtype=float)
        size = float(np.linalg.norm(own)) or 9.81
        directions = {
            f"{'+-'[sign < 0]}{axis}": sign * np.eye(3)[k] for k, axis in enumerate("xyz") for sign in (1, -1)
        }
        costs = [self.base.cost]
        for name, direction in directions.items():
            if not np.allclose(size * direction, own):
                statement = f"Gravity looks to act along {name} of the base frame: the robot is mounted otherwise"
                costs.append(self._try("gravity", statement, Correction(gravity=size * direction), 6.0))
            else:
                costs.append(self.base.cost)
        if own.any():
            costs[0] += float(np.log(6.0))  # so that all the starts count alike
            starts = np.array([own / size, *directions.values()])
            self._tilt(own, starts[int(np.argmin(costs))])
        if own.any():
            statement = (
                "The torques look to be without those of gravity (compensated, or a robot that moves in a plane)"
            )
            self._try("gravity", statement, Correction(gravity=np.zeros(3)), 6.0)

    def _tilt(self, own: Array, start: Array) -> None:
        """A base that is not level: gravity along any direction, downhill from the best of those that were tried."""
        from scipy.optimize import minimize

        size = float(np.linalg.norm(own))
        across = np.asarray(np.linalg.svd(start[None, :])[2], dtype=np.float64)[1:]

        def gravity(tilt: Array) -> Array:
            angle = float(np.linalg.norm(tilt))
            aside = tilt @ across / angle if angle > 0.0 else np.zeros(3)
            return np.asarray(size * (np.cos(angle) * start + np.sin(angle) * aside), dtype=np.float64)

        def cost(tilt: Array) -> float:
            return self._fit(self._moments(Correction(gravity=gravity(tilt)))).cost

        corners = TILT * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        options: Any = {"initial_simplex": corners, "xatol": 2e-3, "fatol": 0.1, "maxfev": 80}
        found = minimize(cost, np.zeros(2), method="Nelder-Mead", options=options)
        tilted = gravity(np.asarray(found.x, dtype=np.float64))
        if self._may_be_told(found.fun, TILTS):
            from .mistake_sizes import exact_tilt  # likewise

            exact = exact_tilt(self.model, self.source, tilted)
            if exact is not None and self._fit(self._moments(Correction(gravity=exact))).cost < found.fun + EQUAL:
                tilted = exact
        tilted = np.round(tilted, 3)
        angle = np.degrees(np.arccos(np.clip(tilted @ own / (size * np.linalg.norm(tilted)), -1.0, 1.0)))
        if angle < LEAST_TILT:
            return
        statement = f"Gravity looks to act at {angle:.2g} degrees to the description's: the base is tilted or turned"
        self._try("gravity", statement, Correction(gravity=tilted), TILTS)

    def _delays(self) -> None:
        samples: Samples | None = self.source
        if not _is_dense(self.source):
            samples = None if self.dense is None else self.dense()
        if samples is None or not _is_dense(samples):
            return
        t = samples.t
        assert t is not None
        inside = (t >= t[0] + DELAYS[-1]) & (t <= t[-1] + DELAYS[0])
        if np.count_nonzero(inside) < 2 * len(self.nonnegative) // self.count + 50:
            return

        tried: dict[float, _Fitted] = {}

        def fitted(delay: float, without: NDArray[np.bool_] | None = None) -> _Fitted:
            shifted = Correction(delay=delay).apply(samples) if delay else samples
            if without is not None:
                shifted = replace(shifted, mask=shifted.used_rows & ~without)
            return self._fit(moments(self.model, _some(shifted, inside)))

        def cost(delay: float) -> float:
            if delay not in tried:
                tried[delay] = fitted(delay)
            # Errors below a few per cent are all alike for a hypothesis, and yet tell which delay is the best.
            return tried[delay].cost + float(np.log(max(tried[delay].fit.error, 1e-6)))

        cost(0.0)
        if tried[0.0].fit.error <= POOR and all(_depth(cost, step) < 0.5 * GAIN for step in NEARBY_DELAYS):
            return
        first = min(DELAYS, key=cost)
        best = round(_least(cost, first + np.array([-0.3, 0.0, 0.3]) * abs(first), 5), 4)
        cost(best)
        cost(0.0)
        usual, mended = tried[0.0], tried[best]
        if abs(best) < float(np.diff(t).mean()):
            # Just where a joint turns back nobody knows the sign of its friction, and one row of the wrong sign can
            # have half the error of its joint: a delay that does no more than move such signs is none.
            turning = _turning_back(samples) | _turning_back(Correction(delay=best).apply(samples))
            usual, mended = fitted(0.0, turning), fitted(best, turning)
        later = "later" if best > 0 else "earlier"
        statement = f"The torques look to be logged {1e3 * abs(best):.2g} ms {later} than the motion"
        # Told against the same rows without the delay, which are others than those of the rest.
        relative = self.base.cost + mended.cost - usual.cost + float(np.log(20.0))
        self._keep("delay", statement, Correction(delay=best), relative, mended, usual)

    # What came of it

    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """The likeliest, and those of other kinds that are as likely."""
        told: list[Hypothesis] = []
        likeliest = np.inf
        for candidate in sorted(self.found, key=lambda candidate: candidate.cost):
            gain = (self.base.cost if candidate.kind == "payload" else self.innocent) - candidate.cost
            if candidate.cost > likeliest + EQUAL:
                break
            if gain < GAINS.get(candidate.kind, GAIN):
                continue
            if any(_same(hypothesis, candidate) for hypothesis in told):
                continue
            hypothesis = self._judged(candidate, gain)
            if hypothesis is not None:
                told.append(hypothesis)
                likeliest = min(likeliest, candidate.cost)
        return tuple(told)

    def _judged(self, candidate: _Candidate, gain: float) -> Hypothesis | None:
        """The evidence for a candidate, or None where it is too weak."""
        before, after = (candidate.usual or self.base).held_out, candidate.fitted.held_out
        errors, joint = (before.held_out_error, after.held_out_error), None
        if errors[1] > FALLEN * errors[0] or errors[0] < POOR:
            k = int(np.argmax(before.held_out - after.held_out))
            of_joint = float(before.held_out[k]), float(after.held_out[k])
            if of_joint[1] < FALLEN * of_joint[0]:
                errors, joint = of_joint, self.names[k]
        if errors[1] < FALLEN * errors[0]:
            where = "" if joint is None else f" of {joint}"
            evidence = f"the error{where} falls from {percent(errors[0], 2)} to {percent(errors[1], 2)}"
        else:
            other = self._mass_evidence(candidate, before, after) or self._motion_evidence(candidate)
            if other is None:
                return None
            evidence = other
        if after.held_out_error > STILL_WRONG:
            evidence += "; what is left is that of a wrong model: more may be mistaken, or the log be of another robot"
        return Hypothesis(candidate.kind, candidate.statement, candidate.correction, gain, *errors, joint, evidence)

    def _mass_evidence(self, candidate: _Candidate, before: LikeliestRobot, after: LikeliestRobot) -> str | None:
        if any(other.kind == "missing term" and other.cost < candidate.cost for other in self.found):
            return None  # what a term of the drives explains better says nothing of masses
        if candidate.correction.payload is not None:
            link, mass, _ = candidate.correction.payload
            described = self.base.prior.mean[self.model.link_columns[self.model.robot.link_names.index(link)][9]]
            return f"{link} weighs {mass:.3g} kg and not {described:.3g} kg"
        if _family(candidate.kind) != "torque factor":
            return None
        least = int(np.argmax(before.torque_surprise - after.torque_surprise))
        torques = candidate.correction.torques
        of_one = torques is not None and np.count_nonzero(np.diag(torques) != 1.0) == 1
        if of_one and before.torque_surprise[least] - after.torque_surprise[least] > 0.5 * GAIN:
            sizes = np.sqrt([before.power[least], after.power[least]])
            return f"the torques of {self.names[least]} are some {sizes[1]:.2g} and not {sizes[0]:.2g} N·m"
        masses = [float(fit.parameters[self.base.prior.masses].sum()) for fit in (before, after)]
        if 1.0 / HEAVIER < masses[0] / masses[1] < HEAVIER:
            return None
        return f"the links weigh {masses[1]:.3g} kg together and not {masses[0]:.3g} kg"

    def _motion_evidence(self, candidate: _Candidate) -> str | None:
        mended = replace(candidate.correction, torques=None).apply(self.samples)
        if self.strangeness - self._strangeness(mended) < 0.5 * GAIN:
            return None
        spans = np.ptp(self.samples.q, axis=0), np.ptp(mended.q, axis=0)
        k = int(np.argmax(np.abs(np.log(np.maximum(spans[0], 1e-9) / np.maximum(spans[1], 1e-9)))))
        if abs(np.log(spans[0][k] / spans[1][k])) < np.log(2.0):
            return "all joints move within their limits"
        unit = "rad" if self.turning[k] else "m"
        return f"{self.names[k]} moves through {spans[1][k]:.3g} {unit} and not {spans[0][k]:.3g} {unit}"


def _neighbors(count: int) -> Iterator[tuple[int, int]]:
    """Yield each two neighbouring joints, in both orders."""
    for k in range(count - 1):
        yield k, k + 1
        yield k + 1, k


def _family(kind: str) -> str:
    return "torque factor" if kind in ("torque unit", "torque scale", "torque constants") else kind


def _same(told: Hypothesis, candidate: _Candidate) -> bool:
    """Return whether a candidate is another size of what is told; factors of two joints are two mistakes."""
    if _family(told.kind) != _family(candidate.kind):
        return False
    joints = (_scaled_joint(told.correction), _scaled_joint(candidate.correction))
    return None in joints or joints[0] == joints[1]


def _scaled_joint(correction: Correction) -> int | None:
    """Return the joint whose torques alone have another factor; None where there is no such one."""
    if correction.torques is None:
        return None
    scaled = np.flatnonzero(np.diag(correction.torques) != 1.0)
    return int(scaled[0]) if len(scaled) == 1 else None


def _is_dense(samples: Samples) -> bool:
    """Return whether accelerations half-way between rows are foretold by the rows to a tenth."""
    if samples.t is None or samples.count < 50:
        return False
    rows = slice(0, samples.count - 1 + samples.count % 2, 2)
    every_other = Samples(**{name: getattr(samples, name)[rows] for name in ("q", "dq", "ddq", "torque", "t")})
    steps = np.diff(samples.t)
    if np.ptp(steps) > 0.01 * steps.mean():
        return False
    foretold = Correction(delay=-float(steps.mean())).apply(every_other)
    count = foretold.count - 1
    wrong = foretold.ddq[:count] - samples.ddq[1::2][:count]
    return bool(np.linalg.norm(wrong) < 0.1 * np.linalg.norm(samples.ddq))


def _assignment(costs: Array) -> tuple[int, ...]:
    """Return the column of each row of an assignment whose costs (n, n) are least together."""
    from scipy.optimize import linear_sum_assignment  # only a model that predicts badly needs it

    return tuple(int(k) for k in linear_sum_assignment(costs)[1])


def _signs(n: int, flipped: Iterable[int]) -> Array:
    values = np.ones(n)
    values[list(flipped)] = -1.0
    return np.diag(values)


def _exchanged(order: Sequence[int], i: int, j: int) -> list[int]:
    found = list(order)
    found[i], found[j] = found[j], found[i]
    return found


def _rotations(n: int) -> Iterator[Order]:
    for k in range(1, n):
        yield tuple(int(i) for i in np.roll(np.arange(n), k))
    yield tuple(range(n))[::-1]


def _scales(logs: Array) -> Array:
    return np.diag(np.exp(logs))


def _times(log: float) -> str:
    return f"{np.exp(abs(log)):.3g} times"


def _small(log: float) -> str:
    return "small" if log > 0.0 else "large"


def _turning_back(samples: Samples) -> NDArray[np.bool_]:
    """(S, N) rows within a step of which a joint's velocity changes its sign; of even samples."""
    assert samples.t is not None
    step = float(np.diff(samples.t).mean())
    return np.asarray(np.abs(samples.dq) < step * np.abs(samples.ddq))


def _depth(function: Callable[[float], float], step: float) -> float:
    """How far a function falls from zero to its least, by a parabola through three points; infinite if it has none."""
    below, here, above = (function(x) for x in (-step, 0.0, step))
    slope, bend = 0.5 * (above - below) / step, (below - 2.0 * here + above) / step**2
    return 0.5 * slope**2 / bend if bend > 0.0 else np.inf


def _least(function: Callable[[float], float], grid: Array, halvings: int = 6) -> float:
    """Return the place where a function is least: the best of a grid, refined between its neighbours by halves."""
    values = [function(float(x)) for x in grid]
    k = int(np.argmin(values))
    x, best = float(grid[k]), values[k]
    step = 0.25 * float(grid[min(k + 1, len(grid) - 1)] - grid[max(k - 1, 0)])
    for _ in range(halvings):
        for y in (x - step, x + step):
            value = function(y)
            if value < best:
                x, best = y, value
        step *= 0.5
    return x
