"""Torques, or times, of another size than the robot's weight and inertia need: one factor for all joints.

Such a mistake leaves no error. Every mass becomes as much too small, or every inertia, and the answer predicts what the
log says.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import few_digits
from steelyard.dynamics import Model
from steelyard.estimators.kinematic_bodies import reach_of
from steelyard.recording import Samples
from steelyard.recording.correction import Correction, Settings, correction_settings, toml_text
from steelyard.recording.recognition import Layout
from steelyard.regression import Estimate
from steelyard.robot import RobotFile

if TYPE_CHECKING:
    from .mistakes import Hypothesis

__all__ = ["LinkTorques", "WrongScale", "link_torques", "masses", "scale_by_description", "wrong_scale"]

Array = NDArray[np.float64]

FACTOR = 2.0
"""Ratio of measured to described gravity from which it is told, at every joint that has to carry something. Of
simulated robots with CAD wrong by 15 % the joints have 0.78 to 1.12, and 1.3 to 1.9 on a real Gen3 that carries a
gripper of which its description knows nothing."""
INERTIAL = 2.5
"""Ratio of the same for inertia, relative to that of gravity, from which times are told to be wrong, which count
squared. The same robots have 0.69 to 1.14, the Gen3 1.0 to 2.7."""
LOADED = 0.1
"""Part of the torque of the most loaded joint from which a joint counts: what wrists carry is small, and a bracket that
CAD leaves out doubles it."""
CERTAIN = 0.1
"""Largest standard error of a ratio relative to it with which a joint tells it; where it is negative, gravity has
another direction or a sign is wrong."""
WHOLE = 0.15
"""Relative distance of a factor of the times from a whole number, or its inverse, within which it is taken for that."""
UNCHANGED = 1e-12
"""Standard deviation of a torque relative to its largest value up to which it is a constant, for rounding."""
FEWEST, ROWS = 50, 2400
"""Rows of a joint that tell something, and rows that are looked at: as many as are kept of one log."""

_OF_DESCRIPTION = 8.0
"""Largest ratio of the masses of the answer and of the description that CAD without drives or cables explains."""
_LIGHTEST, _HEAVIEST = 1.0, 1500.0
"""kg per m³ of the longest reach, cubed. Robots have 20 to 100 (a servo with a horn, a dog's leg, arms of 0.8 to 3 m);
the lightest possible answer may have a few times less, where the motion does not show all the masses."""
_GRAVITY_SEEN = 0.05
"""Share of the torques that gravity must have before a small mass is called implausible: without gravity (a vertical
axis, a balanced arm) torques hardly show masses, and the lightest answer is light."""
_SHORTEST = 0.05
"""m of reach below which the description does not show the robot's size."""


@dataclass(frozen=True)
class WrongScale:
    """That torques or times have another size than the weight or the inertia of the robot needs.

    Attributes
    ----------
    of : {"torques", "times"}
    sentence : str
        What was found, and what to check.
    factor : float
        How many times too large they would be by the description; NaN where masses are judged by the size of the robot
        alone.
    settings : dict
        What robot.toml must say if the description is right; empty where that is not known, or no line says it.
    alike : bool
        Whether one factor explains all joints that tell something, as far as CAD goes.
    """

    of: Literal["torques", "times"]
    sentence: str
    factor: float = np.nan
    settings: Settings = field(default_factory=dict)
    alike: bool = False

    def outweighs(self, mistake: Hypothesis) -> bool:
        """Tell whether it stands against a mistake that a fit to the torques suggests.

        Torques that are 30 times too large fit far better in mN·m, and so they do where one joint alone is mended. Of
        times that are too short, coupled motors and other terms explain a part.
        """
        if self.of == "times":
            return mistake.kind != "time unit"
        torques = mistake.correction.torques
        if not self.alike or torques is None or mistake.kind not in ("torque unit", "torque scale", "torque constants"):
            return False
        factors = np.diag(torques) * self.factor
        return mistake.kind != "torque unit" or bool(np.any(np.abs(np.log(factors)) > np.log(FACTOR)))

    @property
    def toml(self) -> str:
        """Lines of robot.toml that mend it; words in capitals are to be filled in."""
        if self.settings:
            return toml_text(self.settings).strip()
        # A rate does not replace the stamps of a log.
        times = f"# divide the times in the log by {few_digits(self.factor)}"
        return "[log]\ngain = GAIN" if self.of == "torques" else times

    def to_dict(self) -> dict[str, object]:
        """Return it as plain data."""
        factor = None if np.isnan(self.factor) else self.factor
        return {"of": self.of, "statement": self.sentence, "factor": factor, "toml": self.toml}


def wrong_scale(
    model: Model,
    free: Callable[[], Estimate | None],
    samples: Sequence[Samples],
    file: RobotFile,
    layout: Layout | None,
) -> WrongScale | None:
    """Compare the links, as the torques show them, with the description, or else their mass with robots of their reach.

    Parameters
    ----------
    model : Model
    free : callable
        Returns an estimate with parameters of every link, which no mass of the description holds, or None where there
        is none to judge; asked for where these masses are not known, or not shown.
    samples : sequence of Samples
        Of the motions that it comes from.
    file : RobotFile
    layout : Layout, optional
        Of the columns of the first log.

    Returns
    -------
    WrongScale or None
        None where links are what is expected, or nothing shows them.
    """
    found = link_torques(model, samples)
    if found.gravity is None and found.inertia is None:
        return _by_mass(model, free(), samples[0])
    return _by_description(model, found, file, layout)


def scale_by_description(
    model: Model, samples: Sequence[Samples], file: RobotFile, layout: Layout | None
) -> WrongScale | None:
    """Compare the links, as the torques show them, with the description alone; see `wrong_scale`."""
    return _by_description(model, link_torques(model, samples), file, layout)


def _by_description(model: Model, found: LinkTorques, file: RobotFile, layout: Layout | None) -> WrongScale | None:
    known = not np.isnan(masses(model, model.robot.parameters)).any()
    gravity, inertia = found.gravity, found.inertia
    if gravity is None:
        if inertia is None or not _is_off(inertia, INERTIAL, known):
            return None
        others = f"the times, which would be {_long(float(np.sqrt(inertia[0])))} instead, and these masses"
        return _of_torques(model, "The inertia of the links", inertia, others, file, layout)
    # A factor of the torques is one of both; springs and counterweights, and centres that CAD has wrong, are not.
    both = inertia is None or bool(1.0 / INERTIAL < inertia[0] / gravity[0] < INERTIAL)
    if both and _is_off(gravity, FACTOR, known and found.left_by_scale < found.left_by_tool):
        others = "what the robot carries" if gravity[0] > 1.0 else "springs or counterweights that carry the links"
        return _of_torques(model, "Gravity", gravity, f"these masses and {others}", file, layout)
    usual = bool(1.0 / FACTOR < gravity[0] < FACTOR)
    if layout is not None and layout.velocity is not None:
        return None  # these tell of the stamps by themselves: such inertia is that of rotors, or of wrong CAD
    if inertia is not None and usual and _is_off(inertia / gravity[0], INERTIAL, known):
        return _of_times(model, gravity, inertia, file, layout)
    return None


def _is_off(ratios: Array, factor: float, may_be_large: bool) -> bool:
    """Tell whether all ratios are beyond a factor, to the same side."""
    return bool(ratios.max() < 1.0 / factor or (may_be_large and ratios.min() > factor))


def _of_torques(
    model: Model, what: str, ratios: Array, others: str, file: RobotFile, layout: Layout | None
) -> WrongScale:
    factor = float(ratios[0])
    correction = Correction(torques=np.eye(model.dof) / factor)
    return WrongScale(
        "torques",
        f"{what} takes {few_digits(factor, 2)} times the torques that it takes with the masses of the description"
        f"{_each(ratios)}. Check `torque_unit`, `gain` and gear ratios in [log], and if they are right, {others}.",
        factor,
        correction_settings(correction, file, list(model.robot.joint_names), layout),
        bool(ratios.max() < FACTOR * ratios.min()),
    )


def _of_times(model: Model, gravity: Array, inertia: Array, file: RobotFile, layout: Layout | None) -> WrongScale:
    factor = float(np.sqrt(inertia[0] / gravity[0]))
    whole = round(max(factor, 1.0 / factor))
    nearest = float(whole) if factor > 1.0 else 1.0 / whole
    factor = nearest if abs(factor / nearest - 1.0) < WHOLE else factor
    return WrongScale(
        "times",
        f"The inertia of the links takes {few_digits(float(inertia[0]), 2)} times the torques that it takes with the "
        f"description{_each(inertia)}, gravity {few_digits(float(gravity[0]), 2)} times: the times look "
        f"{_long(factor)}. Check the sample rate and the time column, and if they are right, the inertias of the "
        "description.",
        factor,
        correction_settings(Correction(time=1.0 / factor), file, list(model.robot.joint_names), layout),
        True,
    )


def _long(factor: float) -> str:
    return f"{few_digits(max(factor, 1.0 / factor), 2)} times too {'long' if factor > 1.0 else 'short'}"


def _each(ratios: Array) -> str:
    ends = few_digits(float(ratios.min()), 2), few_digits(float(ratios.max()), 2)
    return f" ({ends[0]} to {ends[1]}, joint by joint)" if ends[0] != ends[1] else ""


class LinkTorques(NamedTuple):
    """Torques that the links need as they are measured, beside those of the description.

    Attributes
    ----------
    gravity, inertia : (k,) ndarray or None
        How many times as large the measured torques against gravity are, and those of accelerations and speeds, at the
        joints that tell it, the most loaded one first; None where no joint does.
        Inertia tells something where gravity does, too, or the description needs no torques against it.
    left_by_scale, left_by_tool : float
        What one factor leaves of the measured torques, and what a body at the ends of the chains leaves.
    """

    gravity: Array | None = None
    inertia: Array | None = None
    left_by_scale: float = np.nan
    left_by_tool: float = np.nan


def link_torques(model: Model, samples: Sequence[Samples]) -> LinkTorques:
    """Compare the torques that links need as they are measured with those of the description.

    At each joint the measured torque is a factor of what the described links need against gravity, another one of what
    their accelerations and speeds need, a constant, and what its terms give (friction, a rotor). No base parameters
    take part: a wrong scale of the times distorts them, since the same centre of mass counts in gravity and in inertia.

    Parameters
    ----------
    samples : sequence of Samples
        Of motions; some rows are used.

    Returns
    -------
    LinkTorques
        Of nothing where the description does not say what links weigh.
    """
    model = model.without_channels
    of_links = np.zeros(model.parameter_count, dtype=bool)
    of_links[np.concatenate(model.link_columns)] = True
    # A link of which nothing is said weighs nothing here.
    described = np.where(of_links, np.nan_to_num(np.asarray(model.robot.parameters, dtype=np.float64)), 0.0)
    if not described.any():
        return LinkTorques()
    every = max(1, -(-sum(one.count for one in samples) // ROWS))
    named = ("q", "dq", "ddq", "torque")
    q, dq, ddq, torque = (np.concatenate([getattr(one, name)[::every] for one in samples]) for name in named)
    used = np.concatenate([one.used_rows[::every] for one in samples])
    rows = model.regressor(q, dq, ddq)
    held = model.inverse_dynamics(q, np.zeros_like(q), np.zeros_like(q), described)
    ends = np.concatenate([model.link_columns[k] for k in model.robot.end_links])
    joints = [
        _Joint.of(
            torque[used[:, k], k],
            held[used[:, k], k],
            (own := rows[used[:, k], k]) @ described,
            own[:, ends],
            own[:, ~of_links],
        )
        for k in range(model.dof)
        if used[:, k].sum() > FEWEST
    ]
    gravity, inertia = (_ratios([one.told[kind] for one in joints]) for kind in range(2))
    if gravity is None:
        heaviest, fastest = (max((one.told[kind].size for one in joints), default=0.0) for kind in range(2))
        return LinkTorques(inertia=inertia if heaviest < 1e-6 * fastest else None)
    ours, theirs, tools = (np.concatenate([getattr(one, name) for one in joints]) for name in ("own", "all", "tools"))
    scaled = ours - theirs * (theirs @ ours) / (theirs @ theirs)
    tool = ours - theirs - tools @ np.linalg.lstsq(tools, ours - theirs, rcond=None)[0]
    return LinkTorques(gravity, inertia, float(np.linalg.norm(scaled)), float(np.linalg.norm(tool)))


class _Told(NamedTuple):
    """A factor at a joint, its standard error, and the size of the described torque in N·m or N."""

    factor: float
    error: float
    size: float


class _Joint(NamedTuple):
    """What a joint tells; its torques in parts of their size, without what a constant and its terms explain."""

    told: tuple[_Told, _Told]
    own: Array
    all: Array
    tools: Array

    @classmethod
    def of(cls, torque: Array, held: Array, needed: Array, tools: Array, terms: Array) -> _Joint:
        others = np.column_stack([np.ones(len(torque)), terms[:, terms.any(axis=0)]])
        others = others / np.linalg.norm(others, axis=0)
        given = np.column_stack([torque, held, needed - held, needed, tools])
        given = given - others @ np.linalg.lstsq(others, given, rcond=1e-9)[0]
        own, parts = given[:, 0], given[:, 1:3]
        scale = np.maximum(np.linalg.norm(parts, axis=0), 1e-300)
        factors, _, _, _ = np.linalg.lstsq(parts / scale, own, rcond=1e-9)
        left = own - parts / scale @ factors
        errors = np.sqrt(np.diag(np.linalg.pinv((parts / scale).T @ (parts / scale))) * (left @ left) / len(left))
        sizes = np.std(np.column_stack([held, needed - held]), axis=0)
        told = [_Told(*map(float, one)) for one in zip(factors / scale, errors / scale, sizes, strict=True)]
        # A torque that never changes, as of a gripper that reports none, has rounding for its size, and says nothing.
        size = float(np.std(torque))
        unit = 1.0 / size if size > UNCHANGED * float(np.abs(torque).max()) else 0.0
        return cls((told[0], told[1]), unit * own, unit * given[:, 3], unit * given[:, 4:])


def _ratios(told: Sequence[_Told]) -> Array | None:
    """Factors of the joints that tell one; None where none does."""
    largest = max((one.size for one in told), default=0.0)
    clear = [one for one in told if one.size > LOADED * largest and one.error < CERTAIN * one.factor]
    return np.array([one.factor for one in sorted(clear, key=lambda one: -one.size)]) if clear else None


def _by_mass(model: Model, estimate: Estimate | None, samples: Samples) -> WrongScale | None:
    """Compare the total mass of an estimate with the description's, or else with what a robot of its reach has."""
    parameters = None if estimate is None else estimate.parameters
    if parameters is None:
        return None
    mass = float(masses(model, parameters).sum())
    described = masses(model, model.robot.parameters)
    if np.all(described > 0.0):
        expected = float(described.sum())
        low, high = expected / _OF_DESCRIPTION, expected * _OF_DESCRIPTION
        what = f"the description's {expected:.4g} kg"
    else:
        reach = reach_of(model.robot)
        if reach < _SHORTEST:
            return None
        low, high = _LIGHTEST * reach**3, _HEAVIEST * reach**3
        what = f"the {low:.2g} to {high:.2g} kg of robots that reach {reach:.3g} m"
    if low <= mass <= high:
        return None
    if mass < low:
        gravity = model.gravity(samples.q, parameters)
        if np.linalg.norm(gravity) < _GRAVITY_SEEN * np.linalg.norm(samples.torque):
            return None
    return WrongScale(
        "torques",
        f"The links weigh {mass:.4g} kg together by these torques, far from {what}: check `torque_unit`, `gain` and "
        "gear ratios in [log].",
    )


def masses(model: Model, parameters: ArrayLike) -> Array:
    """Return the masses of the links in kg among all parameters; NaN where they are not known."""
    return np.asarray(parameters, dtype=np.float64)[[int(link[9]) for link in model.link_columns]]
