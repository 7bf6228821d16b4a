"""A base that is not level: a tilt that hardly shows in the errors, and yet moves the numbers of an answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.display import few_digits
from steelyard.dynamics import Model
from steelyard.recording import Samples
from steelyard.recording.correction import Correction, correction_settings
from steelyard.regression import Estimate, Information
from steelyard.regression.factor import eigenvectors
from steelyard.regression.parameter_covariance import inverse_root_of

from .late_logs import MATTERS, in_half_widths
from .log_reader import LogReader
from .mistake_sizes import exact_tilt
from .mistakes import LEAST_TILT, Hypothesis

__all__ = ["TiltedBase", "tilted_base"]

Array = NDArray[np.float64]
SURE = 25.0
"""Square of the tilt over its variance, by two, from which it is sure. Sums of products over stretches tell the
variance, so that what a model lacks counts, too. Sound simulated logs come to 8 at most, with friction of Stribeck in
half of them, and seven of four real robots to 10; tilts of 5 degrees to 90 and more as a rule."""
STRETCHES = 40
"""Stretches whose sums are taken for independent."""
FEWEST = 400
"""Rows from which there are so many stretches of so many."""
MOST_ROWS = 6000
"""Rows that are looked at, evenly spread over all logs; one by itself has 1200. The 24 000 of twenty logs took 2.1 s of
the processor, and these take 0.5."""


@dataclass(frozen=True, eq=False)
class TiltedBase:
    """A tilt of the base that is sure, and matters to the numbers of an answer.

    Attributes
    ----------
    gravity : ndarray
        (3,) m/s², in the base frame, in place of that of the description.
    angle, deviation : float
        Degrees between the two, and the standard deviation.
    change : ndarray
        (n_b,) by how much the base parameters are off because of it.
    largest : float
        The largest of it, in half-widths of the interval of 95 % of the parameter.
    errors : (float, float)
        Relative error of the torques, and what is left of it.
    gain : float
        Logarithm of how much likelier the torques are with it.
    """

    gravity: Array
    angle: float
    deviation: float
    change: Array
    largest: float
    errors: tuple[float, float]
    gain: float

    def hypothesis(self, reader: LogReader, log: str) -> Hypothesis:
        """Say it as a mistake in a log, with the line of robot.toml that mends it."""
        correction = Correction(gravity=np.round(self.gravity, 3))
        names = list(reader.model.robot.joint_names)
        return Hypothesis(
            "gravity",
            f"Gravity looks to act at {self.angle:.1f} ± {2.0 * self.deviation:.1f} degrees to the description's: the "
            "base is tilted",
            correction,
            self.gain,
            *self.errors,
            None,
            f"numbers of the answer move by up to {few_digits(self.largest, 2)} times the half-width that noise alone "
            "gives their intervals of 95 %",
            correction_settings(correction, reader.file, names, reader.layouts.get(log)),
        )


def tilted_base(
    model: Model, information: Information, samples: Sequence[Samples], parameters: Array, unconstrained: Estimate
) -> TiltedBase | None:
    """Tell whether gravity acts aside of where the description has it, so much that the numbers say something else.

    A tilt changes torques in proportion to itself, by what gravity across the described one makes of the answer's
    links. This is regressed on beside the base parameters, which explain most of it: of a leg that is tilted by three
    degrees 2.05 % of the torques are left in place of 2 %, and 7 of its 17 measured numbers are wrong.

    Parameters
    ----------
    model : Model
    information : Information
        Of all logs of the fit.
    samples : sequence of Samples
        Rows of these, evenly spread.
    parameters : (n,)
        Of the answer.
    unconstrained : Estimate
        Least squares of the same logs.

    Returns
    -------
    TiltedBase or None
        None where no tilt of at least `LEAST_TILT` degrees is sure, or it hardly matters.
    """
    own = np.asarray(model.robot.gravity, dtype=float)
    size = float(np.linalg.norm(own))
    kept = [one for one in samples if one.regressor is None]
    if size == 0.0 or model.robot.channels or not kept or sum(one.count for one in kept) < FEWEST:
        return None
    weights = information.joint_weights(unconstrained.weights)
    across = size * np.asarray(np.linalg.svd(own[None, :])[2], dtype=np.float64)[1:]
    inverse, _, unknown = inverse_root_of(information, weights)
    found = _rows(model, kept, across, parameters, weights, inverse)
    rows, aside, torques = (np.concatenate(parts) for parts in zip(*found, strict=True))
    flat, counts = rows.reshape(-1, rows.shape[2]), (len(rows), rows.shape[1])
    # All data show each of these directions alike, so that products of the rows lose no digits.
    values, vectors = eigenvectors(flat.T @ flat)
    root = (vectors / np.sqrt(np.maximum(values, 1e-300)))[:, values > 1e-12 * values[-1]]

    def explained(columns: Array) -> Array:
        """Return what the directions make of columns over the rows, by least squares."""
        return np.asarray(root @ (root.T @ (flat.T @ columns)))

    columns = aside.reshape(-1, 2)
    columns = columns - flat @ explained(columns)
    left = torques.ravel() - flat @ explained(torques.ravel())
    if np.linalg.norm(columns, axis=0).min() <= 1e-9 * np.linalg.norm(aside):
        return None  # as on an arm whose axes are all vertical and carry nothing aside
    normal = columns.T @ columns
    tilt = np.linalg.solve(normal, columns.T @ left)
    rest = left - columns @ tilt
    products = np.einsum("sja,sj->sa", columns.reshape(*counts, 2), rest.reshape(counts))
    sums = np.array([part.sum(axis=0) for part in np.array_split(products, STRETCHES)])
    spread = sums.T @ sums * STRETCHES / (STRETCHES - 1.0)
    covariance = np.linalg.solve(normal, np.linalg.solve(normal, spread).T)
    sure = 0.5 * float(tilt @ np.linalg.solve(covariance, tilt))
    radians = float(np.linalg.norm(tilt))
    deviation = float(np.sqrt(np.trace(covariance)))
    if sure < SURE or np.degrees(radians - 2.0 * deviation) < LEAST_TILT:
        return None
    # What the base parameters make up for.
    change = np.where(unknown, 0.0, inverse @ explained(aside.reshape(-1, 2) @ tilt))
    largest = in_half_widths(change, unconstrained.standard_error)
    if largest < MATTERS:
        return None
    gravity = own + tilt @ across
    gravity *= size / float(np.linalg.norm(gravity))
    if len(kept) == 1:
        exact = exact_tilt(model, kept[0], gravity)
        gravity = gravity if exact is None else exact
    angle = float(np.degrees(np.arccos(np.clip(gravity @ own / size**2, -1.0, 1.0))))
    before = information.relative_error(unconstrained.base)
    after = before * float(np.linalg.norm(rest)) / max(float(np.linalg.norm(left)), 1e-300)
    return TiltedBase(gravity, angle, np.degrees(deviation), change, largest, (before, after), sure)


def _rows(
    model: Model, samples: Sequence[Samples], across: Array, parameters: Array, weights: Array, inverse: Array
) -> list[tuple[Array, Array, Array]]:
    """Weighted rows of the base regressor times `inverse` (S, N, n_b), of what a tilt changes (S, N, 2), and torques.

    Torques are (S, N).
    """
    found, columns = [], model.base_columns
    part = slice(None, None, -(-sum(one.count for one in samples) // MOST_ROWS))
    for one in samples:
        used, q = one.used_rows[part], one.q[part]
        rest = np.zeros_like(q)
        level = model.inverse_dynamics(q, rest, rest, parameters, gravity=np.zeros(3))
        aside = [model.inverse_dynamics(q, rest, rest, parameters, gravity=way) - level for way in across]
        entries = columns.by_joint(columns.entries(q, one.dq[part], one.ddq[part]))
        rows = np.stack([own @ inverse[c] for own, c in zip(entries, columns.joints, strict=True)], axis=1)
        weighted = np.where(used, weights, 0.0)
        found.append(
            (weighted[:, :, None] * rows, weighted[:, :, None] * np.stack(aside, axis=2), weighted * one.torque[part])
        )
    return found
