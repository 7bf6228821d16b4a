"""Friction that the logs of an identification choose: the laws as terms of the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import (
    ByJoint,
    ChannelFriction,
    Cogging,
    Coulomb,
    Dahl,
    LoadFriction,
    LuGre,
    Model,
    PiecewiseFriction,
    PolynomialFriction,
    SmoothCoulomb,
    Spring,
    Stribeck,
    Viscous,
    ViscousByDirection,
)
from steelyard.estimators.friction_candidates import BY_GRAVITY, CANDIDATES, FrictionCandidate, by_channel
from steelyard.estimators.friction_selection import (
    ChosenFriction,
    FrictionData,
    FrictionSelection,
    falls_surely,
    select_friction,
)
from steelyard.recording import Recording, Samples
from steelyard.recording.correction import toml_value
from steelyard.regression import Information
from steelyard.regression.factor import solve
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks
from steelyard.robot import Term

from .given import GivenLog
from .log_reader import LogReader, Progress

__all__ = [
    "FrictionChoice",
    "choose_friction",
    "confirmed_terms",
    "is_term",
    "laws_for",
    "memory_of",
    "samples_of",
    "terms_with",
]

MOST_LOGS, MOST_ROWS = 12, 60_000
"""Logs, and rows of each, by which the friction is chosen: they stand in memory."""
STRETCHES = 8
"""The number of stretches that are left out in turn of the fit of all joints together."""
UNCERTAIN = 0.05
"""Relative standard error of a number of a law from which on it is told that the logs leave it open."""
WIDER = 0.2
"""Part of what a channel went through by which its range is taken wider, so that other logs are not refused."""


@dataclass(frozen=True, eq=False)
class FrictionChoice:
    """Laws of friction that were chosen for a model.

    Attributes
    ----------
    terms : tuple of Term
        Of the model with the laws; those of the model as it was, where none was added.
    error, plain_error : float
        Root mean square over the joints of the relative errors on stretches that are left out, of least squares:
        with the laws, and without.
    untried : tuple of str
        What the laws are that were not tried, since other terms have their parameters.
    presliding : tuple of ChosenFriction
        Laws with a state that the logs call for, Dahl's or LuGre's, where they are told and not added, as beside
        elastic joints.
    """

    selection: FrictionSelection
    terms: tuple[Term, ...] = field(repr=False)
    error: float
    plain_error: float
    remarks: tuple[str, ...] = ()
    untried: tuple[str, ...] = ()
    presliding: tuple[ChosenFriction, ...] = ()

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is to be said of the choice."""
        told = (*self.selection.remarks, *self.remarks)
        if not self.selection.chosen and not any("were not added" in one for one in self.remarks):
            kept = (
                "None of the laws of friction that were tried makes the model significantly better; the friction of "
                "the terms stays."
            )
            told = (*told, kept)
        told = (*told, *self._open)
        if not self.untried:
            return told
        return (*told, f"Not tried, since the stated terms have their parameters: {'; '.join(self.untried)}.")

    @property
    def _open(self) -> tuple[str, ...]:
        """What numbers the logs leave open, and what would tell them."""
        names = self.selection.joint_names
        laws = {
            f"{_name(one.kind)} at {names[one.joint]} ({one.uncertainty:.0%})": None
            for one in (*self.selection.chosen, *self.presliding)
            if UNCERTAIN < one.uncertainty < float("inf")
        }
        if not laws:
            return ()
        return (
            "Some numbers of the friction are open (with the largest relative standard error of each law): "
            f"{', '.join(laws)}. The table of the laws has the intervals. A motion that shows friction determines them "
            "better: steelyard excite --criterion friction.",
        )

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
            "presliding": [
                {
                    "joint": self.selection.joint_names[one.joint],
                    "kind": one.kind,
                    "shape": one.shape,
                    "coefficients": list(one.coefficients),
                    **one.errors_to_dict(),
                    "gain": one.gain,
                }
                for one in self.presliding
            ],
        }


def choose_friction(
    reader: LogReader,
    logs: Sequence[GivenLog],
    model: Model,
    wider: Model,
    say: Progress,
    *,
    adds_presliding: bool = True,
) -> FrictionChoice:
    """Choose the friction of a model from its logs.

    Parameters
    ----------
    reader : LogReader
        Whose processing is decided.
    logs : sequence
    wider : Model
        By which the laws are judged: with the inertia of rotors where that is not decided yet.
    say : callable
    adds_presliding : bool
        Whether laws with a state may be terms; otherwise they are told alone.

    Raises
    ------
    UnusableLogsError
        If logs cannot be used; not all of them are read here.
    """
    places = np.unique(np.linspace(0, len(logs) - 1, min(len(logs), MOST_LOGS)).round().astype(int))
    chosen = [logs[int(place)] for place in places]
    say("which friction do the logs call for?")
    middles = []
    for log in chosen:
        with reader.unusable.noting(log, len(logs), say):
            middles.append(reader.middle(log, MOST_ROWS))
    reader.unusable.refuse(logs)
    samples = [samples_of(reader, one, wider) for one in middles]
    terms = tuple(model.robot.terms)
    near_rest = [samples_of(reader, one, wider, near_rest=True) for one in middles]
    data = FrictionData.of(wider, samples, memory_of(reader, samples[0]), near_rest)
    held = {
        parameter.symbol for term in terms for law in term.laws if not _is_plain(law) for parameter in law.parameters
    }
    laws = laws_for(data)
    candidates = [one for one in laws if not _symbols(one.kind) & held]
    untried = tuple(one.words for one in laws if one not in candidates)
    selection = select_friction(wider, data, candidates=candidates)
    with_state = [] if adds_presliding else [one.kind for one in candidates if one.has_state]
    remarks, presliding = [], tuple(one for one in selection.chosen if one.kind in with_state)
    if presliding:
        selection = select_friction(wider, data, candidates=[one for one in candidates if not one.has_state])
        remarks.append(_told(presliding, selection))
    if not selection.chosen:
        plain = _relative(_held_out(wider, samples))
        return FrictionChoice(selection, terms, plain, plain, tuple(remarks), untried, presliding)
    others = tuple(term for term in wider.robot.terms if term not in terms)
    before, errors, kept, named = confirmed_terms(
        lambda terms: Model(model.robot.with_terms(*terms, *others)),
        terms,
        selection.chosen,
        data,
        wider,
        samples,
        lambda further: [samples_of(reader, one, further) for one in middles],
    )
    plain, error = _relative(before), _relative(errors)
    dropped = [one for one in selection.chosen if one not in kept]
    if dropped:
        told = dict.fromkeys(f"{_name(one.kind)} at {selection.joint_names[one.joint]}" for one in dropped)
        remarks.append(
            f"Laws that were not added: {', '.join(told)}. For each joint by itself they lower the error on "
            "stretches that are left out, but in a fit of all joints together not significantly."
        )
        selection = selection.with_laws(kept)
    if not kept:
        remarks[-1] = remarks[-1].replace("Laws that were", "Further laws of friction were", 1)
        return FrictionChoice(selection, terms, plain, plain, tuple(remarks), untried, presliding)
    names = selection.joint_names
    words = ", ".join(
        f"{_name(kind)} at {', '.join(names[one.joint] for one in kept if one.kind == kind)}"
        for kind in selection.kinds
    )
    remarks.insert(
        0,
        f"The logs show more friction than was stated, and the model now has it: {words}. By least squares "
        f"the errors of the joints on stretches that are left out (root mean square of the relative ones) fall from "
        f"{plain:.2%} to {error:.2%}.",
    )
    return FrictionChoice(selection, named, error, plain, tuple(remarks), untried, presliding)


def laws_for(data: FrictionData) -> list[FrictionCandidate]:
    """Return the laws that can be terms of the model of some logs: also by gravity, and by what was logged beside."""
    laws = [one for one in CANDIDATES if is_term(one.kind)]
    if float(np.linalg.norm(data.model.robot.gravity)) > 0.0:
        laws.insert(1, BY_GRAVITY)
    return laws + [by_channel(name) for name in data.motion.channels or {}]


def confirmed_terms(
    model_with: Callable[[Sequence[Term]], Model],
    terms: Sequence[Term],
    chosen: Sequence[ChosenFriction],
    data: FrictionData,
    plain: Model,
    samples: Sequence[Samples],
    samples_for: Callable[[Model], Sequence[Samples]],
) -> tuple[Errors, Errors, tuple[ChosenFriction, ...], tuple[Term, ...]]:
    """Keep the laws of those joints whose error falls for sure in a fit of all joints together.

    Each joint is judged by stretches that are left out of least squares in turn. The laws of a joint whose error does
    not fall for sure go. Where others lose as much as those with laws gain, so that the product of the errors of all
    joints (their likelihood, each with noise of its own) does not fall for sure, those of the joint that gains least
    go.

    Parameters
    ----------
    model_with : callable
        Model by its terms.
    terms : sequence of Term
        As they were.
    plain : Model
        Without the laws.
    samples_for : callable
        The same logs for another model.

    Returns
    -------
    plain, errors : pair of ndarray
        Squared errors (stretches, N), and what the torques are; without the laws and with those that were kept.
    kept : tuple of ChosenFriction
    terms : tuple of Term
        With the laws that were kept.
    """
    before = after = whole = _held_out(plain, samples)
    kept, named = tuple(chosen), tuple(terms)
    while kept:
        named = terms_with(terms, kept, data)
        further = model_with(named)
        others = [one.with_presliding(further) for one in samples_for(further)]
        after = _held_out(further, others)
        before = whole
        if further.remembers:  # both are judged by the rows at which the state of each law is known
            before = _held_out(plain, [replace(one, mask=two.mask) for one, two in zip(samples, others, strict=True)])
        if len(before[0]) < 2:
            break
        joints = sorted({one.joint for one in kept})
        bad = {k for k in joints if not falls_surely(before[0][:, k], after[0][:, k])}
        if not bad and not falls_surely(_of_all_joints(before[0]), _of_all_joints(after[0])):
            left = after[0].sum(axis=0) / np.maximum(before[0].sum(axis=0), 1e-300)
            bad = {max(joints, key=lambda k: float(left[k]))}
        if not bad:
            break
        kept = tuple(one for one in kept if one.joint not in bad)
    return (before, after, kept, named) if kept else (whole, whole, (), tuple(terms))


def _told(presliding: Sequence[ChosenFriction], selection: FrictionSelection) -> str:
    """Say that friction remembers where a joint was."""
    laws = ", ".join(
        f"{_name(one.kind)} at {selection.joint_names[one.joint]} (over {one.shape['displacement']:.3g} rad or m, "
        f"{one.gain:.0%} less error)"
        for one in presliding
    )
    return (
        f"Friction depends on how joints moved before they slid (presliding): {laws}. Beside elastic joints no term "
        "has such a state, so the model does without it; the report has its numbers, for a simulation or a "
        "controller that can use them."
    )


def _name(kind: str) -> str:
    return {"dahl": "Dahl's", "lugre": "LuGre's"}.get(kind, kind)


def samples_of(reader: LogReader, middle: Recording | Samples, model: Model, *, near_rest: bool = False) -> Samples:
    """Samples of the middle of a log; where torques are filtered, with the regressor of the model likewise.

    Rows near rest are those at which a plain model has more friction than the torques show; laws that remember the
    motion explain them.
    """
    if isinstance(middle, Samples):
        return middle
    return middle.process(reader.near_rest if near_rest else reader.processing, model)


def memory_of(reader: LogReader, samples: Samples) -> float:
    """Rows over which errors are alike at least, where torques were filtered."""
    cutoff = reader.processing.torque_cutoff
    if cutoff is None or samples.t is None or len(samples.t) < 2:
        return 1.0
    return max(1.0, 0.5 / (float(cutoff) * float(np.median(np.diff(samples.t)))))


Errors = tuple[NDArray[np.float64], NDArray[np.float64]]


def _held_out(model: Model, samples: Sequence[Samples]) -> Errors:
    """Squared errors of least squares on stretches of the samples that are left out in turn, and squared torques.

    Both are (stretches, N); of no stretches where the logs are too short.
    """
    blocks = TimeBlocks(empty_factors(model))
    information = Information.from_chunks(model, samples, batch_means=False, blocks=blocks)
    stretches = information.stretches(blocks, STRETCHES)
    if len(stretches) < 2:
        return np.zeros((0, model.dof)), np.zeros((0, model.dof))
    squares = []
    for left_out, others in zip(stretches, Information.without_each(stretches), strict=True):
        base = solve(others.reduced("joint"))
        squares.append([factor.residual2(base) for factor in left_out.measured])
    return np.array(squares), np.array([[factor.norm2 for factor in one.measured] for one in stretches])


def _of_all_joints(squares: NDArray[np.float64]) -> NDArray[np.float64]:
    """The geometric mean over the joints of squared errors on stretches, (stretches,)."""
    return np.asarray(np.exp(np.log(np.maximum(squares, 1e-300)).mean(axis=1)))


def _relative(errors: Errors) -> float:
    """Root mean square over the joints of their relative errors."""
    squares, total = (one.sum(axis=0) for one in errors)
    told = total > 0.0
    return float(np.sqrt(np.mean(squares[told] / total[told]))) if told.any() else float("nan")


_TERMS: dict[str, Term] = {
    "viscous_by_direction": ViscousByDirection(),
    "spring": Spring(),
    "coulomb_smooth": SmoothCoulomb(1.0),
    "friction_polynomial": PolynomialFriction([1, 2, 3], speed=1.0),
    "friction_piecewise": PiecewiseFriction([1.0, 2.0]),
    "stribeck": Stribeck(1.0),
    "cogging": Cogging([1.0]),
    "friction_by_load": LoadFriction(),
    "friction_by_channel": ChannelFriction("signal", range=[0.0, 1.0]),
    "dahl": Dahl(1.0),
    "lugre": LuGre(1.0, 1.0, 1.0),
}
"""The terms of the laws that may be added, with any shape; their parameters do not depend on it."""


def is_term(kind: str) -> bool:
    """Whether a law of this kind is a term of models."""
    return kind.split()[0] in _TERMS


def _symbols(kind: str) -> set[str]:
    return {parameter.symbol for parameter in _TERMS[kind.split()[0]].parameters}


def _is_plain(term: Term) -> bool:
    """Return whether a term may give way to another law at a joint."""
    return isinstance(term, (Coulomb, Viscous))


def terms_with(terms: Sequence[Term], chosen: Sequence[ChosenFriction], data: FrictionData) -> tuple[Term, ...]:
    """Return the terms of a model with laws of friction at single joints.

    Parameters
    ----------
    terms : sequence of Term
        As they were.
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
    own, joints = of("dahl")
    if own:
        laws.append(Dahl(by_joint(own, "displacement"), joints=joints))
    own, joints = of("lugre")
    if own:
        displacement, ratio, velocity = (by_joint(own, name) for name in ("displacement", "ratio", "velocity"))
        laws.append(LuGre(displacement, ratio, velocity, joints=joints))
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
    own, joints = of("friction_by_load")
    if own:
        laws.append(LoadFriction(moments=_moments(data), joints=joints))
    for kind in dict.fromkeys(one.kind for one in chosen if one.kind.startswith("friction_by_channel ")):
        joints = of(kind)[1]
        signal = (data.motion.channels or {})[kind.split()[1]][:, [k - 1 for k in joints]]
        low, high = float(signal.min()), float(signal.max())
        room = WIDER * (high - low)
        ends = [_rounded(low - room), _rounded(high + room)]
        laws.append(
            ChannelFriction(kind.split()[1], range=ends, reference=_rounded(float(signal.mean())), joints=joints)
        )
    laws.extend(Cogging([_rounded(one.shape["harmonic"])], joints=[one.joint + 1]) for one in of("cogging")[0])
    # Laws that differ from joint to joint keep their order: those that stand last give way.
    kept = [term for term in terms if _is_plain(term) or isinstance(term, ByJoint)]
    others = [term for term in terms if term not in kept]
    return (ByJoint([*laws, *(law for term in kept for law in term.laws)]), *others)


def _moments(data: FrictionData) -> list[float]:
    """First moments and masses of the links by which the loads of friction are computed, as the logs tell them."""
    values = dict(zip(map(str, data.model.parameter_names), data.parameters, strict=True))
    links = range(1, len(data.model.robot.links) + 1)
    return [float(f"{values[f'{name}{link}']:.6g}") for link in links for name in ("lx", "ly", "lz", "m")]


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
