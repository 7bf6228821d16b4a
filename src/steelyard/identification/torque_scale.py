"""Torques of another size than the robot's weight needs: a gain, a unit or gear ratios that fit all the joints alike.

Such a mistake leaves no error. Every mass becomes as much too small, and the answer predicts what the log says.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import few_digits
from steelyard.dynamics import Model
from steelyard.estimators.kinematic_bodies import reach_of
from steelyard.recording import Samples
from steelyard.recording.correction import Correction, Settings, correction_settings, toml_text
from steelyard.recording.recognition import Layout
from steelyard.regression import Estimate, Information
from steelyard.regression.parameter_covariance import ParameterCovariance
from steelyard.robot import RobotFile

from .mistakes import Hypothesis

__all__ = ["Gravity", "TorqueScale", "gravity_scale", "masses", "measured_gravity", "torque_scale"]

Array = NDArray[np.float64]

FACTOR = 2.0
"""Ratio of measured to described gravity from which it is told, at every joint that has to carry something. Of 22
simulated robots with CAD wrong by 15 % the joints have 0.58 to 1.25, and 1.5 to 1.8 on a real Gen3 that carries a
gripper of which its description knows nothing."""
LOADED = 0.1
"""Part of the gravity torque of the most loaded joint from which a joint counts: what wrists carry is small, and a
bracket that CAD leaves out doubles it."""
LIKE, CERTAIN = 0.9, 0.1
"""Least correlation of both gravity torques, and largest standard error of their ratio relative to it: gravity in
another direction, or a motion that does not show it, is no scale."""
ROWS = 200

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
class TorqueScale:
    """That the torques of all joints have another size than the weight of the robot needs.

    Attributes
    ----------
    sentence : str
        What was found, and what to check.
    ratio : float
        Of the measured gravity torques to those of the masses of the description; NaN where masses are judged by the
        size of the robot alone.
    settings : dict
        What robot.toml must say if the masses of the description are right; empty where these are not known.
    alike : bool
        Whether one factor explains all joints that carry something, as far as CAD goes.
    """

    sentence: str
    ratio: float = np.nan
    settings: Settings = field(default_factory=dict)
    alike: bool = False

    def outweighs(self, mistake: Hypothesis) -> bool:
        """Tell whether it stands against a mistake in the size of torques, which a fit to the torques suggests.

        Torques that are 30 times too large fit far better in mN·m, and so they do where one joint alone is mended.
        """
        torques = mistake.correction.torques
        if not self.alike or torques is None or mistake.kind not in ("torque unit", "torque scale", "torque constants"):
            return False
        factors = np.diag(torques) * self.ratio
        return mistake.kind != "torque unit" or bool(np.any(np.abs(np.log(factors)) > np.log(FACTOR)))

    @property
    def toml(self) -> str:
        """Lines of robot.toml that mend it; words in capitals are to be filled in."""
        return toml_text(self.settings).strip() or "[log]\ngain = GAIN"

    def to_dict(self) -> dict[str, object]:
        """Return it as plain data."""
        ratio = None if np.isnan(self.ratio) else self.ratio
        return {"statement": self.sentence, "ratio": ratio, "toml": self.toml}


def torque_scale(
    model: Model,
    information: Information,
    unconstrained: Estimate,
    free: Callable[[], Estimate | None],
    samples: Sequence[Samples],
    file: RobotFile,
    layout: Layout | None,
) -> TorqueScale | None:
    """Compare what the links weigh by the torques with the description, or else with robots of their reach.

    Parameters
    ----------
    model : Model
    information : Information
    unconstrained : Estimate
        Least squares of it.
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
    TorqueScale or None
        None where masses are what is expected, or nothing shows them.
    """
    found = _gravity_of(model, information, unconstrained, samples)
    return _by_mass(model, free(), samples[0]) if found is None else _by_gravity(model, found, file, layout)


def gravity_scale(
    model: Model,
    information: Information,
    unconstrained: Estimate,
    samples: Sequence[Samples],
    file: RobotFile,
    layout: Layout | None,
) -> TorqueScale | None:
    """Compare what the links weigh by the torques with the description alone; see `torque_scale`."""
    found = _gravity_of(model, information, unconstrained, samples)
    return None if found is None else _by_gravity(model, found, file, layout)


def _gravity_of(
    model: Model, information: Information, unconstrained: Estimate, samples: Sequence[Samples]
) -> Gravity | None:
    q = np.concatenate([one.q for one in samples])
    return measured_gravity(model, information, unconstrained, q[:: max(1, len(q) // ROWS)])


def _by_gravity(model: Model, found: Gravity, file: RobotFile, layout: Layout | None) -> TorqueScale | None:
    ratios = found.ratios
    low, high = float(ratios.min()), float(ratios.max())
    known = not np.isnan(masses(model, model.robot.parameters)).any()
    if low > FACTOR and known and found.left_by_scale < found.left_by_tool:
        others = "what the robot carries"
    elif high < 1.0 / FACTOR:
        others = "springs or counterweights that carry the links"
    else:
        return None
    ratio, names = float(ratios[0]), list(model.robot.joint_names)
    ends = few_digits(low, 2), few_digits(high, 2)
    each = f" ({ends[0]} to {ends[1]}, joint by joint)" if ends[0] != ends[1] else ""
    return TorqueScale(
        f"Gravity takes {few_digits(ratio, 2)} times the torques that it takes with the masses of the description"
        f"{each}. Check `torque_unit`, `gain` and gear ratios in [log], and if they are right, these masses and "
        f"{others}.",
        ratio,
        correction_settings(Correction(torques=np.eye(model.dof) / ratio), file, names, layout),
        high < FACTOR * low,
    )


class Gravity(NamedTuple):
    """Measured gravity torques beside those of the masses of the description.

    Attributes
    ----------
    ratios : (k,) ndarray
        Of the joints that carry something, the most loaded one first.
    left_by_scale, left_by_tool : float
        What one factor leaves of the measured ones, and what a body at the ends of the chains leaves.
    """

    ratios: Array
    left_by_scale: float
    left_by_tool: float


def measured_gravity(model: Model, information: Information, unconstrained: Estimate, q: ArrayLike) -> Gravity | None:
    """Compare gravity torques as they are measured with those of the masses of the description.

    Constant torques are left out of both, since an offset cannot be told from them. So are joints at which gravity
    cannot be told from a term, or is hardly there.

    Parameters
    ----------
    model : Model
    information : Information
    unconstrained : Estimate
        Least squares of it.
    q : (S, N) array_like
        Positions, rad or m.

    Returns
    -------
    Gravity or None
        None where the description does not say what links weigh, or the motion does not show it.
    """
    base, q = model.base_parameters(), np.asarray(q, dtype=np.float64)
    of_links = np.zeros(model.parameter_count, dtype=bool)
    of_links[np.concatenate(model.link_columns)] = True
    # A link of which nothing is said weighs nothing here.
    described = np.where(of_links, np.nan_to_num(np.asarray(model.robot.parameters, dtype=np.float64)), 0.0)
    if not described.any():
        return None
    used = base.K != 0.0
    felt, foreign = used[:, of_links].any(axis=1), used[:, ~of_links].any(axis=1)
    rest = np.zeros_like(q)
    channels = dict.fromkeys(model.robot.channels, rest) or None
    rows = model.regressor(q, rest, rest, channels=channels)[..., base.independent]
    rows = np.moveaxis(rows - rows.mean(axis=0), 1, 0)  # (N, S, n_b)
    largest = np.abs(rows).max(initial=0.0)
    expected, measured = (rows[..., felt] @ values[felt] for values in (base.values(described), unconstrained.base))
    sizes = np.linalg.norm(expected, axis=1)
    covariance = ParameterCovariance.of(information).matrix
    joints, ratios = [], []
    for k in np.argsort(-sizes, kind="stable"):
        if sizes[k] <= LOADED * sizes.max() or np.abs(rows[k][:, felt & foreign]).max(initial=0.0) > 1e-9 * largest:
            continue
        weights = np.where(felt, expected[k] @ rows[k], 0.0) / sizes[k] ** 2
        seen = weights != 0.0
        ratio = float(weights @ unconstrained.base)
        error = float(np.sqrt(weights[seen] @ covariance[np.ix_(seen, seen)] @ weights[seen]))
        like = float(measured[k] @ expected[k]) / max(float(np.linalg.norm(measured[k]) * sizes[k]), 1e-300)
        if not (like > LIKE and error < CERTAIN * ratio):  # nor where it is not a number
            return None
        joints.append(k)
        ratios.append(ratio)
    if not joints:
        return None
    ours, theirs = measured[joints].ravel(), expected[joints].ravel()
    carrying = {joint.parent for joint in model.robot.joints}
    ends = [np.asarray(link)[6:] for k, link in enumerate(model.link_columns) if k not in carrying]
    tools = (rows[joints] @ base.K[:, np.concatenate(ends)]).reshape(len(ours), -1)
    tool = tools @ np.linalg.lstsq(tools, ours - theirs, rcond=None)[0]
    size = float(np.linalg.norm(ours))
    left = (ours - theirs * (theirs @ ours) / (theirs @ theirs), ours - theirs - tool)
    return Gravity(np.array(ratios), *(float(np.linalg.norm(one)) / size for one in left))


def _by_mass(model: Model, estimate: Estimate | None, samples: Samples) -> TorqueScale | None:
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
    return TorqueScale(
        f"The links weigh {mass:.4g} kg together by these torques, far from {what}: check `torque_unit`, `gain` and "
        "gear ratios in [log]."
    )


def masses(model: Model, parameters: ArrayLike) -> Array:
    """Return the masses of the links in kg among all parameters; NaN where they are not known."""
    return np.asarray(parameters, dtype=np.float64)[[int(link[9]) for link in model.link_columns]]
