"""Laws of friction by which a motion is designed that tells them apart and shows their numbers."""

from __future__ import annotations

import numpy as np

from steelyard.dynamics import Coulomb, Model, Offset, PolynomialFriction, Spring, Stribeck, Viscous, ViscousByDirection

from .motion_limits import MotionLimits

__all__ = ["with_friction_laws"]

NEAR_REST = 0.08
"""Stribeck velocity relative to the fastest speed. It stands for the laws that differ near rest."""


def with_friction_laws(model: Model, limits: MotionLimits) -> tuple[Model, list[str]]:
    """Return a model with many laws of friction together, and the names of their parameters.

    A motion that shows them all at once lets an identification choose among them: each is known as well as it can be
    beside all the others, and better where these are not there. Viscous friction by direction, with a square and a
    cube, Stribeck's and a spring are added, with a constant torque. Viscous and Coulomb friction of the model are parts
    of them; other terms stay, and laws that have parameters of these are not added, for they are there: Stribeck's
    friction of the model counts as it is. The limits say how fast each joint may be.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0)).with_terms(sy.Viscous()))
    >>> with_friction_laws(model, MotionLimits.of(model.robot.joint_names, velocity=2.0))[1]
    ['Fvpj1', 'Fvnj1', 'Fv2j1', 'Fv3j1', 'Fcj1', 'Fsj1', 'Ksj1']
    """
    with np.errstate(invalid="ignore"):
        half = 0.5 * (limits.upper - limits.lower)
    half = np.where(np.isfinite(half), half, np.pi)
    fastest = np.minimum(limits.velocity, np.sqrt(limits.acceleration * half))
    fastest = np.where(np.isfinite(fastest), fastest, half)  # of a joint that moves to and fro in some seconds
    kept = [term for term in model.robot.terms if not isinstance(term, (Coulomb, Viscous))]
    held = {parameter.symbol for term in kept for parameter in term.parameters}
    counted = (
        ViscousByDirection(),
        PolynomialFriction([2, 3]),
        Stribeck([float(speed) for speed in NEAR_REST * fastest]),
        Spring(),
    )
    laws = [law for law in counted if held.isdisjoint(parameter.symbol for parameter in law.parameters)]
    constant = [] if held & {parameter.symbol for parameter in Offset().parameters} else [Offset()]
    wider = Model(model.robot.with_terms(*kept, *constant, *laws))
    symbols = [parameter.symbol for law in counted for parameter in law.parameters]
    wanted = {f"{symbol}{k + 1}" for symbol in symbols for k in range(len(model.robot.joints))}
    return wider, [name for name in map(str, wider.parameter_names) if name in wanted]
