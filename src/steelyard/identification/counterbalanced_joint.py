"""A counterbalance that a model lacks: a link that comes out far from what is known of it, and near to it with one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Cogging, Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import SolverError
from steelyard.estimators.cross_validation import FEWEST_FOLDS, CrossValidation
from steelyard.estimators.plausible_fit import tried_prior
from steelyard.feasibility import FeasibleSet
from steelyard.recording import Samples
from steelyard.regression import Information, least_squares
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks
from steelyard.robot import Robot

from .mistakes import TOO_MANY_JOINTS
from .result import Identification

__all__ = ["CounterbalancedJoint", "counterbalanced_joint"]

Array = NDArray[np.float64]

FAR = 1.6
"""Times as heavy, or as light, as known beforehand is a link for which a counterbalance is tried; with it the link must
be nearer than that. Of a KR300, whose counterbalance is real, link 2 has 2.2 to 6.4 and 0.64 to 0.91 times the mass of
CAD, on three sets of logs."""

LARGE, FALL = 1.5, 0.15
"""The torque of the counterbalance relative to the root mean square of that of its joint, since it is there to hold
weights; and the part of the squared error of this joint, on stretches left out, that it must take away from fits as
near to what is known. The prior must count as much with it, or more. The KR300 has 2.7 to 3.2, and 0.19 to 0.84. Of 72
simulated logs of six arms without one (30 with a tool of 15 % of the mass, 18 with friction near standstill that is
eight times as large as usual, 24 without CAD) three whose prior counts three times as much have 0.5 to 1.04 and 0.28 to
0.6; of 36 of another arm whose CAD is wrong none has more than 0.82 and 0."""

OWN, OF_ALL = 0.1, 0.1
"""The weight of a link by itself relative to that of all that its joint carries, and that relative to the joint that
carries most, from which it is asked on which side of the axis the link comes out: CAD may be wrong about small ones."""

TRUST, HOLDS, TURNED_FALL = 3.0, 0.5, 0.05
"""Of a link that comes out on the other side of the axis of its joint: how many times more the prior must count with a
counterbalance, its torque relative to the root mean square of the weight that the joint is known to carry, and the part
of the squared error that it takes away. A torsion spring and a cylinder on a simulated arm have 316 and 32 times, 1.2
and 1.0, 0.5 and 0.1, with a link whose weight turns -0.8 and -0.4 of what is known; of 54 links on 43 logs of eight
robots without one, CAD wrong by 20 %, all turn 0.7 to 1.4 of it."""

LEAST_RISE = 2e-3
"""Part by which the least squared error on stretches that are left out may rise with it, where a link turns round: a
linear spring left 1e-4 more than the link that took it on, near which only the weight of the prior tells."""

MOST_TRIED = 2
"""Joints that are tried, those with the largest weight first. Each takes half a second to a second."""

KNOWN = {"spring", "counterbalance", "tendon", "cogging"}
"""Kinds of terms that hold such a torque already."""

_HELD = "_counterbalanced_joint"
"""Under which what was found stands in an identification."""


class CounterbalancedJoint(NamedTuple):
    """A joint at which a counterbalance would make a link what it is known to be.

    Attributes
    ----------
    joint : int
        Number of the coordinate, from 0.
    link : int
        Number of a link that it moves, from 0: that which comes nearest to what is known.
    known, found, with_term : float
        Mass of the link as it is known beforehand, as it comes out, and as it comes out with a counterbalance, kg.
    turned : bool
        Whether its weight comes out on the other side of the axis than it is known to be, whatever it comes to.
    share : float
        Part of the squared error of the joint, on stretches that are left out in turn, that it takes away from fits as
        near to what is known.
    torque : float
        The largest torque of the counterbalance, as far as it goes as the sine of the position, N·m.
    aligned : float
        Position at which it has no torque, and the ends of one that pulls are nearest to each other, rad.
    """

    joint: int
    link: int
    known: float
    found: float
    with_term: float
    share: float
    torque: float
    aligned: float
    turned: bool = False


def counterbalanced_joint(identification: Identification) -> CounterbalancedJoint | None:
    """Look for a joint whose counterbalance the model lacks.

    The torque of a counterbalance goes nearly as the sine of the position, as the weight of a link does, so that least
    squares hardly tell them apart, and a link takes it on: it comes out as a counterweight. But then the data
    contradict what is known of that link, and with a sine and a cosine at the joint beside all links they do not. One
    whose ends come so near to each other that its torque is far from a sine leaves a pattern, and is not found here; a
    second harmonic was tried, and three of four logs of the KR300 tell nothing any more.

    Returns
    -------
    CounterbalancedJoint or None
        None where no link comes out far from what is known, or none would come out near to it with a counterbalance.
    """
    held: dict[str, Any] = vars(identification)  # terminal and report both ask; a property of it would be a circle
    if _HELD not in held:
        held[_HELD] = _found(identification)
    found: CounterbalancedJoint | None = held[_HELD]
    return found


@in_one_thread
def _found(identification: Identification) -> CounterbalancedJoint | None:
    model, plausible, answer = identification.model, identification.plausible, identification.estimate.parameters
    samples = [one.samples for one in identification.predictions if one.role == "identification" and one.samples]
    kinds = {law.kind for term in model.robot.terms for law in term.laws}
    if plausible is None or answer is None or not samples or kinds & KNOWN or model.dof > TOO_MANY_JOINTS:
        return None
    known = np.nan_to_num(plausible.prior.parameters)
    masses = identification.feasible_set.link_columns[:, 9]
    q = np.concatenate([one.q for one in samples])
    weight = np.sqrt(np.mean(np.asarray(model.gravity(q, known)) ** 2, axis=0))
    weight[weight < 1e-9 * weight.max(initial=0.0)] = 0.0
    sides = _Sides(model, q, known, weight)
    # A mass by the kinematics alone is a guess, and no reason to doubt the model.
    told = np.array([source != "kinematics" for source in plausible.prior.sources])
    known[masses[~told]] = 0.0
    far = _away(answer[masses], known[masses]) > np.log(FAR)
    suspects = [
        joint
        for joint, link in enumerate(model.robot.driving_joints)
        if model.robot.joints[link].rotates
        and weight[joint] > 0.0
        and (far[_carried(model.robot, link)].any() or (told[link] and sides.turn(joint, answer) < 0.0))
    ]
    for joint in sorted(suspects, key=lambda one: -weight[one])[:MOST_TRIED]:
        found = _tried(identification.feasible_set, samples, joint, answer, known, sides)
        if found is not None:
            return found
    return None


class _Sides:
    """On which side of the axis of its joint the weight of a link is, by a motion."""

    def __init__(self, model: Model, q: Array, known: Array, weight: Array) -> None:
        self.model, self.q, self.weight = model, q, weight
        each = [self._own(joint, known) for joint in range(len(weight))]
        size = np.array([float(np.sqrt(np.mean(one**2))) for one in each])
        counts = (size > OWN * weight) & (weight > OF_ALL * weight.max(initial=0.0))
        self.known = [one if count else None for one, count in zip(each, counts, strict=True)]

    def turn(self, joint: int, parameters: Array) -> float:
        """The weight of the link by other parameters, relative to what is known: below 0 on the other side.

        1 where its own weight counts for little.
        """
        known = self.known[joint]
        return 1.0 if known is None else float(self._own(joint, parameters) @ known / (known @ known))

    def _own(self, joint: int, parameters: Array) -> Array:
        """Torque against the weight of the link that a joint drives, (S,), without what that carries."""
        columns = self.model.link_columns[self.model.robot.driving_joints[joint]]
        alone = np.zeros(self.model.parameter_count)
        alone[columns] = parameters[columns]
        return np.asarray(self.model.gravity(self.q, alone))[:, joint]


def _away(masses: Array, known: Array) -> Array:
    """How far masses are from those that are known, as logarithms of their ratios; 0 where nothing is known."""
    ratios = np.divide(masses, known, out=np.ones_like(known), where=(known > 0.0) & (masses > 0.0))
    return np.asarray(np.abs(np.log(ratios)))


def _carried(robot: Robot, link: int) -> list[int]:
    """The link and all that it carries."""
    found = [link]
    for index, joint in enumerate(robot.joints):
        if joint.parent in found:
            found.append(index)
    return found


def _tried(
    feasible_set: FeasibleSet, samples: Sequence[Samples], joint: int, answer: Array, known: Array, sides: _Sides
) -> CounterbalancedJoint | None:
    model = feasible_set.model
    assert isinstance(model, Model)
    wider = Model(model.robot.with_terms(*model.robot.terms, Cogging(harmonics=[1], joints=[joint + 1])))
    blocks = TimeBlocks(empty_factors(wider))
    information = Information.from_chunks(wider, samples, blocks=blocks)
    data = [information, *information.stretches(blocks)]
    if len(data) <= FEWEST_FOLDS:
        return None
    wider_set = FeasibleSet(wider, feasible_set.consistency, feasible_set.constraints, feasible_set.margin)
    try:
        after = _validated(wider_set, data)
    except SolverError:  # data that are far from all robots like this one
        return None
    values = after.parameters[after.chosen_index]
    sine, cosine = (float(values[wider.parameter_names.index(f"T{one}1j{joint + 1}")]) for one in "sc")
    torque, measured = float(np.hypot(sine, cosine)), information.measured[joint]
    own, wide = feasible_set.link_columns[:, 9], wider_set.link_columns[:, 9]
    before_it, with_it = (_away(masses, known[own]) for masses in (answer[own], values[wide]))
    driven = model.robot.driving_joints[joint]
    carried = np.array(_carried(model.robot, driven))
    mended = carried[(before_it > np.log(FAR))[carried] & (with_it < np.log(FAR))[carried]]
    of_model = values[[wider.parameter_names.index(name) for name in model.parameter_names]]
    turned = sides.turn(joint, answer) < 0.0 and 1.0 / FAR < sides.turn(joint, of_model) < FAR
    is_large = torque >= LARGE * np.sqrt(measured.norm2 / max(measured.count, 1))
    is_held = turned and torque >= HOLDS * sides.weight[joint]
    if not (len(mended) and is_large) and not is_held:  # whatever the fits without it come to
        return None
    try:
        before = _validated(feasible_set, [one.narrowed(wider, model) for one in data])
    except SolverError:
        return None
    alike = int(np.argmin(np.abs(np.log(before.prior_weights / after.weight))))
    errors = np.array([before.joint_errors[alike, joint], after.joint_errors[after.chosen_index, joint]])
    least = [float(np.sum(one.joint_errors[one.best_index] ** 2)) for one in (before, after)]
    share = 1.0 - float((errors[1] / max(errors[0], 1e-300)) ** 2)
    aligned = float(np.arctan2(-cosine, sine))

    def told_of(link: int, turned: bool) -> CounterbalancedJoint:
        masses = float(known[own[link]]), float(answer[own[link]]), float(values[wide[link]])
        return CounterbalancedJoint(joint, link, *masses, share, torque, aligned, turned)

    trust, rise = after.weight / before.weight, least[1] / max(least[0], 1e-300) - 1.0
    if len(mended) and is_large and share >= FALL and trust >= 0.99 and rise <= 0.0:
        return told_of(int(mended[np.argmax(np.abs(values[wide] - answer[own])[mended])]), turned=False)
    if is_held and share >= TURNED_FALL and trust >= TRUST and rise <= LEAST_RISE:
        return told_of(driven, turned=True)
    return None


def _validated(feasible_set: FeasibleSet, data: Sequence[Information]) -> CrossValidation:
    information, *stretches = data
    tried = tried_prior(information, stretches, feasible_set, least_squares(information))
    assert tried.validation is not None
    return tried.validation
