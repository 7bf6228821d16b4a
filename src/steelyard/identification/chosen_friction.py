"""Friction that the logs of an identification choose: the laws as terms of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from steelyard.dynamics import (
    ByJoint,
    Cogging,
    Coulomb,
    Model,
    PiecewiseFriction,
    PolynomialFriction,
    SmoothCoulomb,
    Spring,
    Stribeck,
    Viscous,
    ViscousByDirection,
)
from steelyard.estimators.friction_candidates import CANDIDATES
from steelyard.estimators.friction_selection import ChosenFriction, FrictionData, FrictionSelection, select_friction
from steelyard.recording import Recording, Samples
from steelyard.regression import Information
from steelyard.regression.factor import solve
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks
from steelyard.robot import Term

from .correction import toml_value
from .given import GivenLog
from .log_reader import LogReader, Progress

__all__ = ["FrictionChoice", "choose_friction", "is_term", "memory_of", "samples_of", "terms_with"]

MOST_LOGS, MOST_ROWS = 12, 60_000
"""Logs, and rows of each, by which the friction is chosen: they stand in memory."""


@dataclass(frozen=True, eq=False)
class FrictionChoice:
    """Laws of friction that were chosen for a model.

    Attributes
    ----------
    selection : FrictionSelection
    terms : tuple of Term
        Of the model with the laws; those of the model as it was, where none was added.
    error, plain_error : float
        Root mean square over the joints of the relative errors on stretches that are left out, of least squares:
        with the laws, and without.
    remarks : tuple of str
    untried : tuple of str
        What the laws are that were not tried, since other terms have their parameters.
    """

    selection: FrictionSelection
    terms: tuple[Term, ...] = field(repr=False)
    error: float
    plain_error: float
    remarks: tuple[str, ...] = ()
    untried: tuple[str, ...] = ()

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is to be said of the choice."""
        told = (*self.selection.remarks, *self.remarks)
        told = told or ("The logs call for no friction beyond that of the terms.",)
        if not self.untried:
            return told
        return (*told, f"Not tried, since the stated terms have their parameters: {'; '.join(self.untried)}.")

    @property
    def toml(self) -> str:
        """The terms as they stand in robot.toml."""
        tables = [
            "\n".join(["[[terms]]", *(f"{key} = {toml_value(value)}" for key, value in term.to_dict().items())])
            for term in self.terms
        ]
        return "\n\n".join(tables) + "\n"

    def to_dict(self) -> dict[str, Any]:
        """Return the choice as plain data."""
        return {
            **self.selection.to_dict(),
            "terms": [term.to_dict() for term in self.terms],
            "error": self.error,
            "plain_error": self.plain_error,
            "remarks": [*self.selection.remarks, *self.remarks],
        }


def choose_friction(
    reader: LogReader, logs: Sequence[GivenLog], model: Model, wider: Model, say: Progress
) -> FrictionChoice:
    """Choose the friction of a model from its logs.

    Parameters
    ----------
    reader : LogReader
        Whose processing is decided.
    logs : sequence
    model : Model
    wider : Model
        By which the laws are judged: with the inertia of rotors where that is not decided yet.
    say : callable
    """
    places = np.unique(np.linspace(0, len(logs) - 1, min(len(logs), MOST_LOGS)).round().astype(int))
    chosen = [logs[int(place)] for place in places]
    say("which friction do the logs call for?")
    middles = [reader.middle(log, MOST_ROWS) for log in chosen]
    samples = [_processed(reader, one, wider) for one in middles]
    terms = tuple(model.robot.terms)
    data = FrictionData.of(wider, samples, memory_of(reader, samples[0]))
    held = {
        parameter.symbol for term in terms for law in term.laws if not _is_plain(law) for parameter in law.parameters
    }
    terms_of_laws = [one for one in CANDIDATES if is_term(one.kind)]
    candidates = [one for one in terms_of_laws if not _symbols(one.kind) & held]
    untried = tuple(one.words for one in terms_of_laws if one not in candidates)
    selection = select_friction(wider, data, candidates=candidates)
    plain = _held_out(wider, samples)
    if not selection.chosen:
        return FrictionChoice(selection, terms, plain, plain, untried=untried)
    named = terms_with(terms, selection.chosen, data)
    others = tuple(term for term in wider.robot.terms if term not in terms)
    further = Model(model.robot.with_terms(*named, *others))
    error = _held_out(further, [_processed(reader, one, further) for one in middles])
    if error > plain:
        remark = (
            f"Further laws of friction were not added: joint by joint they lower the error on stretches that are left "
            f"out, but in a fit of all joints together it rises from {plain:.2%} to {error:.2%}."
        )
        return FrictionChoice(selection.without_laws(), terms, plain, plain, (remark,), untried)
    words = ", ".join(
        f"{kind} at {', '.join(selection.joint_names[one.joint] for one in selection.chosen if one.kind == kind)}"
        for kind in selection.kinds
    )
    remark = (
        f"The logs call for more than the friction that was stated, and the model has it: {words}. By least squares "
        f"the errors of the joints on stretches that are left out (root mean square of the relative ones) fall from "
        f"{plain:.2%} to {error:.2%}."
    )
    return FrictionChoice(selection, named, error, plain, (remark,), untried)


def samples_of(reader: LogReader, log: GivenLog, model: Model) -> Samples:
    """Samples of the middle of a log; where torques are filtered, with the regressor of the model likewise."""
    return _processed(reader, reader.middle(log, MOST_ROWS), model)


def _processed(reader: LogReader, middle: Recording | Samples, model: Model) -> Samples:
    return middle if isinstance(middle, Samples) else middle.process(reader.processing, model)


def memory_of(reader: LogReader, samples: Samples) -> float:
    """Rows over which errors are alike at least, where torques were filtered."""
    cutoff = reader.processing.torque_cutoff
    if cutoff is None or samples.t is None or len(samples.t) < 2:
        return 1.0
    return max(1.0, 0.5 / (float(cutoff) * float(np.median(np.diff(samples.t)))))


def _held_out(model: Model, samples: Sequence[Samples]) -> float:
    """Relative error of least squares on stretches of the samples that are left out in turn."""
    blocks = TimeBlocks(empty_factors(model))
    information = Information.from_chunks(model, samples, batch_means=False, blocks=blocks)
    stretches = information.stretches(blocks)
    if len(stretches) < 2:
        return float("nan")
    squares = Information.held_out_squares(stretches, lambda others: solve(others.reduced("joint")))
    total = np.sum([[factor.norm2 for factor in one.measured] for one in stretches], axis=0)
    told = total > 0.0
    return float(np.sqrt(np.mean(squares[told] / total[told])))


_TERMS: dict[str, Term] = {
    "viscous_by_direction": ViscousByDirection(),
    "spring": Spring(),
    "coulomb_smooth": SmoothCoulomb(1.0),
    "friction_polynomial": PolynomialFriction([1, 2, 3], speed=1.0),
    "friction_piecewise": PiecewiseFriction([1.0, 2.0]),
    "stribeck": Stribeck(1.0),
    "cogging": Cogging([1.0]),
}
"""The terms of the laws that may be added, with any shape; their parameters do not depend on it."""


def is_term(kind: str) -> bool:
    """Whether a law of this kind is a term of models: one with a state is not, whose torque depends on the past."""
    return kind in _TERMS


def _symbols(kind: str) -> set[str]:
    return {parameter.symbol for parameter in _TERMS[kind].parameters}


def _is_plain(term: Term) -> bool:
    """Whether a term may give way to another law at a joint."""
    return isinstance(term, (Coulomb, Viscous))


def terms_with(terms: Sequence[Term], chosen: Sequence[ChosenFriction], data: FrictionData) -> tuple[Term, ...]:
    """Return the terms of a model with laws of friction at single joints.

    Parameters
    ----------
    terms : sequence of Term
        As they were.
    chosen : sequence of ChosenFriction
    data : FrictionData
        Whose motion says how fast the joints were.
    """
    laws: list[Term] = []
    count = data.model.dof
    fastest = np.abs(data.motion.dq).max(axis=0)

    def of(kind: str) -> tuple[list[ChosenFriction], list[int]]:
        own = [one for one in chosen if one.kind == kind]
        return own, [one.joint + 1 for one in own]

    def by_joint(own: Sequence[ChosenFriction], name: str) -> list[float]:
        middle = _rounded(float(np.exp(np.mean(np.log([one.shape[name] for one in own])))))
        values = {one.joint: _rounded(one.shape[name]) for one in own}
        return [values.get(k, middle) for k in range(count)]

    own, joints = of("stribeck")
    if own:
        laws.append(Stribeck(by_joint(own, "velocity"), by_joint(own, "exponent"), joints=joints))
    own, joints = of("coulomb_smooth")
    if own:
        laws.append(SmoothCoulomb(by_joint(own, "velocity"), joints=joints))
    own, joints = of("friction_polynomial")
    if own:
        speed = _rounded(float(max(fastest[one.joint] for one in own)))
        laws.append(PolynomialFriction([1, 2, 3], speed=speed, joints=joints))
    for one in of("friction_piecewise")[0]:
        nodes = [_rounded(one.shape["speed"]), _rounded(float(fastest[one.joint]))]
        laws.append(PiecewiseFriction(nodes, joints=[one.joint + 1]))
    own, joints = of("viscous_by_direction")
    if own:
        laws.append(ViscousByDirection(joints=joints))
    own, joints = of("spring")
    if own:
        laws.append(Spring(joints=joints))
    laws.extend(Cogging([_rounded(one.shape["harmonic"])], joints=[one.joint + 1]) for one in of("cogging")[0])
    # Laws that differ from joint to joint keep their order: those that stand last give way.
    kept = [term for term in terms if _is_plain(term) or isinstance(term, ByJoint)]
    others = [term for term in terms if term not in kept]
    return (ByJoint([*laws, *(law for term in kept for law in term.laws)]), *others)


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
