"""Identified effects for which a description has no place, and the error of a simulation without them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from steelyard.dynamics import Model
from steelyard.recording import Samples
from steelyard.regression import Estimate
from steelyard.robot import Robot
from steelyard.robot.description import URDF, description_format
from steelyard.robot.robot import PRESLIDING

__all__ = ["missed_terms", "undescribed_kinds"]

NAMES = {
    "damping": "damping",
    "friction": "friction",
    "rotor_inertia": "rotor inertia",
    "offset": "torque offsets",
    "stiffness": "springs",
    "quadratic_damping": "quadratic friction",
    "cubic_damping": "cubic friction",
}
NEGLIGIBLE = 5e-4  # of the torques; less is printed as 0.0 %


def missed_terms(model: Model, estimate: Estimate, samples: Iterable[Samples]) -> tuple[str, ...]:
    """Say what the description cannot hold in its own elements.

    Parameters
    ----------
    model : Model
    estimate : Estimate
    samples : iterable of Samples
        Motions with which to compare torques.

    Returns
    -------
    tuple of str
        A sentence, with the root mean square of the torques of the terms that are missed, relative to that of the
        measured ones, over all joints and of the joint where it is largest; none where nothing is missed.
    """
    source = model.robot.source
    if source is None or estimate.parameters is None:
        return ()
    kind = description_format(source) or URDF
    refused = kind.refusal(model.robot)
    if refused:
        return (refused,)
    held = kind.holds if kind.is_written else ()
    described = np.array(model.described_as)
    missed = np.array([kind not in held for kind in model.described_as])
    missed[np.ravel(model.link_columns)] = False
    remembers = model.remembers
    if not kind.is_written or not (missed.any() or remembers):
        return ()
    parts, whole = np.zeros(model.robot.dof), np.zeros(model.robot.dof)
    parameters = np.where(missed, estimate.parameters, 0.0)
    coulomb = np.where((described == "friction") & ~missed, estimate.parameters, 0.0)
    for one in samples:
        rows = np.ones_like(one.torque, dtype=bool) if one.mask is None else one.mask
        torque = model.inverse_dynamics(one.q, one.dq, one.ddq, parameters, channels=one.channels)
        if remembers:  # of which descriptions hold Coulomb friction
            slides = {**(one.channels or {}), PRESLIDING: np.sign(one.dq)}
            torque = torque + model.inverse_dynamics(one.q, one.dq, one.ddq, coulomb, channels=one.channels)
            torque = torque - model.inverse_dynamics(one.q, one.dq, one.ddq, coulomb, channels=slides)
        parts += np.sum(np.where(rows, torque, 0.0) ** 2, axis=0)
        whole += np.sum(np.where(rows, one.torque, 0.0) ** 2, axis=0)
    if not whole.sum() > 0.0:
        return ()
    share = float(np.sqrt(parts.sum() / whole.sum()))
    each = np.sqrt(np.divide(parts, whole, out=np.zeros_like(parts), where=whole > 0.0))
    if max(share, float(each.max())) < NEGLIGIBLE:
        return ()
    worst = int(np.argmax(each))
    known = [NAMES[name] for name in NAMES if name not in held and name in described]
    what = " and ".join([*known, *undescribed_kinds(model.robot)])
    beside = f", and {' and '.join(known)} in an extension of ours, which simulators pass over" if known else ""
    return (
        f"The format of {source.name} has no place for {what}: their values stand in estimate.json{beside}. A "
        f"simulation without it misses {share:.1%} of the torques of these logs, and {each[worst]:.1%} at joint "
        f"{model.robot.joint_names[worst]}.",
    )


def undescribed_kinds(robot: Robot) -> list[str]:
    """Return the kinds of the terms, or of their laws, that have parameters of which no description knows."""
    laws = [law for term in robot.terms for law in term.laws]
    undescribed = (
        law.kind
        for law in laws
        if PRESLIDING in law.channels or any(one.described_as is None for one in law.parameters)
    )
    return list(dict.fromkeys(undescribed))
