"""Possible causes of a difference between robots (friction of a joint, mass of a link, gain of a torque) and how data
shows them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model, MotorSide

__all__ = ["Cause", "gains_in_own_motion", "possible_causes", "variations"]

Array = NDArray[np.float64]
Kind = Literal["term", "friction", "mass", "link", "gain", "scale"]

FACTORS = ("friction", "mass", "gain", "scale")  # kinds with one amplitude, by which all of something is multiplied
FRICTION = ("damping", "friction")  # as a description calls viscous and Coulomb friction
TURNABLE = ("gain", "scale")  # which may have the other sign
ALL_LINKS = 1e-6
"""Part of a column of base parameters that counts as one: what is less is rounding of their rules."""

USUAL_CHANGES = {"gain": 0.1, "scale": 0.1, "mass": 0.2, "friction": 0.5, "term": 0.5}
"""Half of all changes of a kind are taken to be within a factor of e to the power of this. Scales of sensors and
constants of motors are off by a few percent, friction by half; the distribution of Cauchy has tails, so that none is
excluded. At the last joint of an arm, whose torque is mostly friction, one looks like the other: a worn gearbox was
told as a gain of 1.34."""

LIGHTEST = 0.05
"""Part of what siblings have below which no link weighs, and to which other ratios are bounded as a change."""

IMPOSSIBLE = -1e6
"""Logarithm of the likelihood of what cannot be: below all others, and in the same order among themselves."""

ANY_LINK = -2.0
"""Logarithm of how likely a link that is another one is, beside a part that has a number and explains as much: the
inertia of the first link about a vertical axis cannot be told from that of its rotor."""

TURNED = -3.0
"""Logarithm of how likely a torque of the other sign is beside one of the same."""


@dataclass(frozen=True, eq=False)
class Cause:
    """A way in which a robot may differ from its siblings, or from what it was.

    Attributes
    ----------
    name : str
        ``"Fcj3"``, ``"friction of elbow"``, ``"mass of forearm"``, ``"forearm"``, ``"torque gain of elbow"``,
        ``"torque gain of all joints"``.
    kind : {"term", "friction", "mass", "link", "gain", "scale"}
        One parameter of a drive; all friction of a drive, by one factor; all of a link, by one factor; a link whose
        mass, centre of mass and inertia may be any; the torques that are measured at a joint, all by one factor; those
        of all joints, by one factor, as where they are in another unit.
    part : str
        The joint or the link, or ``"all joints"``.
    what : str
        Such as ``"Coulomb friction"``, ``"mass"``.
    unit : str
        Of `nominal`, empty where there is no number.
    nominal : float
        Of the siblings; an amplitude of one changes by as much as this. NaN where a change has no single number.
    directions : ndarray
        (n_b, k): how base parameters change with each of its amplitudes; with a gain, in the motions of most siblings.
    """

    name: str
    kind: Kind
    part: str
    what: str
    unit: str
    nominal: float
    directions: Array = field(repr=False)

    @property
    def has_ratio(self) -> bool:
        """Whether it is told as a multiple of what siblings have."""
        return self.kind in FACTORS or (self.nominal > 0.0 and self.what != "torque offset")

    def can_be(self, ratio: float) -> bool:
        """Whether a part may have this many times what siblings have: no friction and no mass is less than nothing.

        Examples
        --------
        >>> mass = Cause("mass of forearm", "mass", "forearm", "mass", "kg", 6.0, np.ones((1, 1)))
        >>> mass.can_be(0.5), mass.can_be(0.02), mass.can_be(-1.0)
        (True, False, False)
        """
        if not self.has_ratio or self.kind in TURNABLE:
            return True
        return ratio >= (LIGHTEST if self.kind == "mass" else 0.0)

    def log_prior(self, ratio: float, highest: float) -> float:
        """Logarithm of how likely a change is before any data is seen, up to a constant.

        Parameters
        ----------
        ratio : float
            To what siblings have.
        highest : float
            The end of its interval.
        """
        if self.kind == "link":
            return ANY_LINK
        if not self.has_ratio:
            return 0.0
        if not self.can_be(highest):
            return IMPOSSIBLE
        size = abs(ratio) if self.kind in TURNABLE else ratio
        change = np.log(np.clip(size, LIGHTEST, 1.0 / LIGHTEST)) / USUAL_CHANGES[self.kind]
        return float(-np.log1p(change**2)) + (TURNED if ratio < 0.0 and self.kind in TURNABLE else 0.0)


def possible_causes(
    model: Model, parameters: ArrayLike, base: ArrayLike | None = None, gains: ArrayLike | None = None
) -> tuple[Cause, ...]:
    """List what may be different about a robot.

    Parameters
    ----------
    model : Model
    parameters : (n,)
        What siblings have; of the links, the answer that stays near what is known of the robot.
    base : (n_b,), optional
        Base parameters of the siblings by the data alone, from which the sizes of friction are taken where they are
        base parameters themselves; those of `parameters` by default.
    gains : (n_b, N), optional
        How base parameters change with the gain of the torque of each joint, see `steelyard.regression.torque_gains`,
        in the motions of most siblings. Without it, gains are no causes.

    Returns
    -------
    tuple of Cause
        Only those that some base parameter shows.

    Examples
    --------
    >>> import numpy as np, steelyard as sy
    >>> robot = sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)).with_terms(sy.Viscous(), sy.Coulomb())
    >>> model = sy.Model(robot)
    >>> values = dict(zip(model.parameter_names, [0, 0, 0, 0, 0, 0.3, 0.5, 0, 0, 1, 0.1, 2], strict=True))
    >>> [cause.name for cause in possible_causes(model, list(values.values()))]
    ['Fvj1', 'Fcj1', 'friction of joint1', 'mass of link1', 'link1']
    """
    values = np.asarray(parameters, dtype=float)
    rules, robot = model.base_parameters(), model.robot
    K = rules.K
    told = dict(zip(rules.expressions, np.asarray(K @ values if base is None else base, dtype=float), strict=True))
    names = [str(name) for name in model.parameter_names]
    values = np.array([told.get(name, value) for name, value in zip(names, values, strict=True)])
    described = np.asarray(robot.parameters, dtype=float)
    found: list[Cause] = []
    width = sum(len(term.parameters) for term in robot.terms)
    for number, joint in enumerate(robot.joints):
        if joint.mimics is not None or width == 0:
            continue
        column = int(model.link_columns[number][-1]) + 1
        friction: dict[str, list[int]] = {}
        for term in robot.terms:
            of = f"motor {number + 1}" if isinstance(term, MotorSide) else joint.name
            for parameter in term.parameters:
                unit = parameter.unit if joint.rotates else parameter.unit_prismatic
                what = parameter.description.removesuffix(" of the motor")
                if parameter.described_as == "offset":
                    what = "torque offset"
                size = float(values[column])
                scale = size if parameter.nonnegative and size > 0.0 else 1.0
                found.append(Cause(names[column], "term", of, what, unit, scale, scale * K[:, [column]]))
                if parameter.described_as in FRICTION and size > 0.0:
                    friction.setdefault(of, []).append(column)
                column += 1
        for of, places in friction.items():
            if len(places) > 1:
                direction = K[:, places] @ values[places]
                found.append(Cause(f"friction of {of}", "friction", of, "friction", "", 1.0, direction[:, None]))
    for link, columns in zip(robot.links, model.link_columns, strict=True):
        own = values[columns]
        if own[9] > 0.0:
            direction = K[:, columns] @ own
            # No torque shows how much of what it shows of a link is mass: kg are those of the description.
            unit, size = ("kg", float(own[9])) if np.isfinite(described[columns[9]]) else ("", 1.0)
            found.append(Cause(f"mass of {link.name}", "mass", link.name, "mass", unit, size, direction[:, None]))
        shown = K[:, columns]
        left, sizes, _ = np.linalg.svd(shown / np.maximum(np.abs(shown).max(initial=0.0), 1e-300))
        rank = int(np.sum(sizes > ALL_LINKS * sizes.max(initial=0.0)))
        found.append(Cause(link.name, "link", link.name, "mass, centre of mass or inertia", "", np.nan, left[:, :rank]))
    if gains is not None:
        for number, direction in zip(robot.driving_joints, np.transpose(gains)[:, :, None], strict=True):
            joint = robot.joints[number]
            what = "torque gain" if joint.rotates else "force gain"
            found.append(Cause(f"{what} of {joint.name}", "gain", joint.name, what, "", 1.0, direction))
        if len(robot.driving_joints) > 1:
            # They add up to the base parameters, in whatever motion.
            every = np.sum(gains, axis=1)[:, None]
            found.append(Cause("torque gain of all joints", "scale", "all joints", "torque gain", "", 1.0, every))
    largest = np.abs(K).max(initial=0.0)
    return tuple(c for c in found if np.abs(c.directions).max(initial=0.0) > ALL_LINKS * largest * _least(c))


def _least(cause: Cause) -> float:
    return abs(cause.nominal) if np.isfinite(cause.nominal) else 1.0


def variations(model: Model, causes: tuple[Cause, ...]) -> Array:
    """Return the directions in which siblings are taken to vary, each by an amount of its own, (n_b, c).

    Single parameters of links and drives, all friction of a drive together, all of a link together, gains of torques:
    what assembly, temperature, castings and calibration change.
    """
    K = model.base_parameters().K
    together = [cause.directions for cause in causes if cause.kind in FACTORS]
    found = np.column_stack([K, *together])
    sizes = np.abs(found).max(axis=0)
    return np.asarray(found[:, sizes > ALL_LINKS * sizes.max(initial=0.0)])


def gains_in_own_motion(model: Model, causes: tuple[Cause, ...], gains: ArrayLike) -> dict[int, Array]:
    """Return how base parameters change with gains in each robot's own motion: (R, n_b) by the number of the cause.

    A torque that reads too much is spread over the links by the other joints' torques, and how depends on the motion:
    between the motions of simulated arms the change differed by as much as its own size.

    Parameters
    ----------
    model : Model
    causes : tuple of Cause
    gains : (R, n_b, N)
        Of each robot, see `steelyard.regression.torque_gains`; NaN, here and in what is returned, where its data does
        not tell them.

    Examples
    --------
    Two pendulums, each with one base parameter, which is in proportion to the torque of the joint:

    >>> import numpy as np
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 0.3, 0, "q")], name="pendulum"))
    >>> gains = np.array([[[0.4]], [[0.5]]])
    >>> causes = possible_causes(model, model.robot.parameters, gains=gains.mean(axis=0))
    >>> [(causes[k].name, own.tolist()) for k, own in gains_in_own_motion(model, causes, gains).items()]
    [('torque gain of joint1', [[0.4], [0.5]])]
    """
    given = np.asarray(gains, dtype=float)
    names = model.robot.joint_names
    found = {k: given[:, :, names.index(cause.part)] for k, cause in enumerate(causes) if cause.kind == "gain"}
    # A joint without rows tells nothing of its own; there what most siblings show takes its place.
    return {k: np.where(np.any(own, axis=1, keepdims=True), own, np.nan) for k, own in found.items()}
