"""The terms of a robot of which nobody states any: whether its rotors have an inertia is for the logs to say."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from steelyard.dynamics import Model, RotorInertia, term_from_dict
from steelyard.errors import SolverError
from steelyard.estimators.cross_validation import FEWEST_FOLDS, HeldOutRows
from steelyard.estimators.plausible_fit import TriedPrior, tried_prior
from steelyard.feasibility import FeasibleSet
from steelyard.regression import Estimate, Information, least_squares
from steelyard.regression.factor import solve
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks
from steelyard.robot import RobotFile

from .given import GivenLog, wider_model
from .log_reader import LogReader, LogTask

__all__ = ["RotorDecision", "decide_rotors", "model_of_estimate", "model_with", "rotors_of_log"]

SURE_ROTOR = 4.0
"""Standard errors by which a rotor inertia must stand above zero, and farther than any other stands below it: what a
model lacks moves them, too. Simulated arms that moved well come to 2.4 to 57 with rotors of some 3 % of the torques; 72
experiments without rotors to 2.4, and a real UR10 goes down to -5."""
SURE_GAIN = 3.4
"""Standard errors by which stretches that are left out must be predicted better with rotors, where the links stay as
near to what the description says. Many rotors cannot be told from links by the data alone: three simulated arms of
which the data alone showed none come to 3.5 to 7.2; the least of them to 3.45 or 3.56, as its log is simulated by one
processor or another. Of 36 experiments without rotors 35 come to 1.9 at most, and one, a weak motion, to 3.3: taken in
there, the rotors would spoil the prediction of faster motions."""
LEAST_DESCRIBED = 0.5
"""Share of the mass that the description must tell for that. Where shapes or the kinematics stand in for it, links are
so far from what is assumed that rotors help though there are none (4.1 standard errors)."""
ROTORS_HARM = 0.01
"""Part by which the error on stretches that are left out may rise with rotor inertias."""
_NOT_SURE = "the log shows no inertia of rotors for sure"
_SYMBOL = RotorInertia.parameters[0].symbol
_ROTOR = re.compile(rf"\b{_SYMBOL}\d+\b")


@dataclass(frozen=True, eq=False)
class RotorDecision:
    """The decision whether a model has the inertia of rotors, with its reason.

    Attributes
    ----------
    reason : str
        What the logs show, as a clause.
    feasible_set : FeasibleSet
        Of the model that was chosen.
    information : Information
        Of all the data, for that model.
    stretches : tuple of Information
        Its contiguous parts.
    unconstrained : Estimate or None
        Least squares, where they were needed.
    tried : TriedPrior or None
        Likewise, what came of the prior.
    """

    taken: bool
    reason: str
    feasible_set: FeasibleSet
    information: Information = field(repr=False)
    stretches: tuple[Information, ...] = field(repr=False)
    unconstrained: Estimate | None = field(default=None, repr=False)
    tried: TriedPrior | None = field(default=None, repr=False)

    def sentence(self, source: str) -> str:
        """Say that rotors were taken in, though the source of the robot states none."""
        return (
            f"The model has the inertia of a rotor at every joint, of which {source} says nothing: {self.reason}. "
            "Without it, links would get inertia that belongs to rotors; state [[terms]] in a robot.toml to choose."
        )


def model_with(names: Iterable[str], file: RobotFile, model: Model | None = None) -> Model:
    """Return the model of an estimate by the names of its parameters, or by the expressions of its base parameters.

    That of the robot file, or where this states no terms and the estimate has rotor inertias, the wider one.
    """
    model = Model.from_file(file) if model is None else model
    if not any(_ROTOR.search(name) for name in names):
        return model
    return wider_model(file, model) or model


def model_of_estimate(estimate: Estimate | str | Path | None, file: RobotFile, model: Model | None = None) -> Model:
    """Return the model of an estimate, perhaps a saved one; that of the robot file where there is none."""
    if model is None and not file.terms_are_default:
        model = Model.from_file(file)  # whose faults are told before those of the estimate
    if estimate is None:
        return Model.from_file(file) if model is None else model
    loaded = estimate if isinstance(estimate, Estimate) else Estimate.load(estimate, certified=False)
    chosen = loaded.description.get("terms")
    if isinstance(chosen, list):  # with friction that the logs chose
        terms = [term_from_dict(one, "the terms of the estimate") for one in chosen]
        return Model(file.robot.with_terms(*terms))
    if model is not None and not file.terms_are_default:
        return model
    return model_with((*loaded.parameter_names, *loaded.base_expressions), file, model)


def decide_rotors(
    feasible_set: FeasibleSet,
    wider: Model,
    information: Information,
    stretches: Sequence[Information],
    weights: Literal["joint"] | None = "joint",
    *,
    by_description: bool = True,
) -> RotorDecision:
    """Take rotor inertias in where the data shows one, and stretches that are left out are predicted as well.

    It shows one where least squares do, or where links that stay near the description predict stretches that are left
    out better with rotors than without.

    Parameters
    ----------
    feasible_set : FeasibleSet
        Of the model without rotor inertias.
    wider : Model
        With them.
    information : Information
        Of the wider model, with its batch means.
    stretches : sequence of Information
        Contiguous parts of it.
    weights : {"joint", None}
    by_description : bool
        Whether links that stay near the description may show one, too. What least squares do not tell from links does
        no harm where only least squares are asked, and the fits take seconds.
    """
    model = feasible_set.model
    assert isinstance(model, Model)
    without = RotorDecision(
        False,
        "the log is too short to tell",
        feasible_set,
        information.narrowed(wider, model),
        tuple(one.narrowed(wider, model) for one in stretches),
    )
    if len(stretches) < FEWEST_FOLDS or information.count <= information.base_count:
        return without
    wider_set = FeasibleSet(wider, feasible_set.consistency, feasible_set.constraints, feasible_set.margin)
    estimate = least_squares(information, weights)
    taken = RotorDecision(True, "", wider_set, information, tuple(stretches), estimate)
    shown = _shown(model, estimate)
    if shown:
        rise = _held_out(taken, weights) / _held_out(without, weights) - 1.0
        if rise < ROTORS_HARM:
            change = f"{'falls' if rise <= 0.0 else 'rises'} by {100.0 * abs(rise):.2g} %"
            return replace(taken, reason=f"{shown}; the error on stretches of the log that were left out {change}")
    if not by_description:
        return replace(without, reason=_NOT_SURE)
    return _near_the_description(without, taken, weights)


def rotors_of_log(reader: LogReader, log: GivenLog, wider: Model, samples: int) -> RotorDecision:
    """Decide by one log, read as `reader` decided, whether its model lacks the inertia of rotors.

    Parameters
    ----------
    reader : LogReader
    log : path, Recording or samples
    wider : Model
        That of the reader with rotor inertias.
    samples : int
        How many are kept of the log.
    """
    reduced = reader.reduced(LogTask(log, samples, samples, 1, True), wider)
    stretches = reduced.information.stretches(TimeBlocks.of_held(empty_factors(wider), reduced.blocks))
    return decide_rotors(FeasibleSet(reader.model), wider, reduced.information, stretches)


def _shown(model: Model, estimate: Estimate) -> str:
    """Say which rotor inertia stands out of its error; empty where none does, or others are as surely negative."""
    found = [
        (value / error, name, value, error)
        for name, value, error in zip(estimate.base_expressions, estimate.base, estimate.standard_error, strict=True)
        if _ROTOR.fullmatch(name) and error > 0.0
    ]
    if not found:
        return ""
    (clearest, name, value, error), (lowest, *_) = max(found), min(found)
    if clearest < SURE_ROTOR or -lowest >= clearest:
        return ""
    robot = model.robot
    number = int(name.removeprefix(_SYMBOL))
    unit = "kg·m²" if robot.joints[robot.driving_joints[number - 1]].rotates else "kg"
    return f"the log shows {name} = {value:.3g} ± {error:.1g} {unit} (standard error) behind gears"


def _held_out(decision: RotorDecision, weights: Literal["joint"] | None) -> float:
    """The error of least squares on stretches that are left out in turn, the geometric mean over the joints."""
    info, stretches = decision.information, decision.stretches
    others = Information.without_each(stretches)
    told = HeldOutRows.of(info, stretches, info.joint_weights(weights))
    squares = sum(
        (own.squares(solve(rest.reduced(weights))[None])[0] for own, rest in zip(told, others, strict=True)),
        start=np.zeros(len(info.factors)),
    )
    seen = squares > 0.0
    return float(np.exp(0.5 * np.mean(np.log(squares[seen])))) if seen.any() else 1.0


def _near_the_description(
    without: RotorDecision, taken: RotorDecision, weights: Literal["joint"] | None
) -> RotorDecision:
    """Decide by fits that stay near what the description says of the links."""
    model = taken.feasible_set.model
    assert isinstance(model, Model)
    assert taken.unconstrained is not None
    without = replace(
        without,
        reason=_NOT_SURE,
        unconstrained=least_squares(without.information, weights),
    )
    assert without.unconstrained is not None
    try:
        before = tried_prior(without.information, without.stretches, without.feasible_set, without.unconstrained)
        without = replace(without, tried=before)
        if sum(link.fixed[9] for link in before.known.links) < LEAST_DESCRIBED * before.known.masses.sum():
            return without
        known = replace(before.known, model=model)
        after = tried_prior(taken.information, taken.stretches, taken.feasible_set, taken.unconstrained, prior=known)
    except SolverError:  # constraints that no robot like this one meets
        return without
    assert before.validation is not None
    assert after.validation is not None
    # Either loss is in units of the noise that its own least squares leave, which is no less without rotors. Logarithms
    # are compared, since a stretch with a calm motion gains as surely as one with a fast motion, but less.
    k = after.validation.chosen_index
    losses = after.validation.losses[:, k]
    # Stretches of which no row is used lose nothing.
    gain = np.log(np.maximum(before.validation.losses[:, k], 1e-300) / np.maximum(losses, 1e-300))
    error = max(float(gain.std(ddof=1)) / np.sqrt(len(gain)), 1e-12)
    least = before.validation.losses[:, before.validation.chosen_index].sum()
    sure = bool((gain > 0.0).all()) and float(gain.mean()) > SURE_GAIN * error
    if not sure or losses.sum() >= (1.0 + ROTORS_HARM) ** 2 * least:
        return without
    falls = 1.0 - float(np.exp(-0.5 * gain.mean()))
    reason = (
        f"with it, links as near to the description predict stretches of the log that were left out with "
        f"{100.0 * falls:.2g} % less error ({gain.mean() / error:.2g} standard errors)"
    )
    return replace(taken, reason=reason, tried=after)
