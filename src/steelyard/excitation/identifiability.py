"""Whether a motion shows what it is asked to show, in spite of noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .criterion import Spectrum, Subset

__all__ = ["TORQUE_NOISE", "Identifiability", "identifiability"]

TORQUE_NOISE = 0.01
"""Of the torques, white. Torques from motor currents are seldom better; ten times less would shift the verdict by a
factor of ten in the condition number, while motions that show nothing miss it by factors of hundreds."""


@dataclass(frozen=True)
class Identifiability:
    """What torque noise of one percent leaves of the parameters that a motion is to show.

    Attributes
    ----------
    uncertainty : float
        Standard deviation of the least certain combination of the base parameters that count, in units of the size
        (2-norm) of all base parameters. Above 1 the motion cannot identify it: the noise alone weighs more than the
        robot.
    unshown : tuple of str
        In that case the parameters that are at fault, the least certain first.
    """

    uncertainty: float
    unshown: tuple[str, ...]


def identifiability(spectrum: Spectrum, subset: Subset, rows: float) -> Identifiability:
    """Predict how certain the parameters of a subset will be.

    Parameters beta of size 1 cause torques of at most the largest singular value of the regressor, over all its rows;
    one percent of their root mean square is the noise, and the inverse information makes deviations of it.

    Parameters
    ----------
    spectrum : Spectrum
        Of the information.
    subset : Subset
    rows : float
        How many rows the regressor has, samples times joints.

    Returns
    -------
    Identifiability

    Examples
    --------
    One parameter is shown a million times worse than the other one:

    >>> subset = Subset(("m1", "m2"), np.eye(2), True)
    >>> found = identifiability(Spectrum.of(np.diag([1e6, 1e-6])), subset, rows=100)
    >>> round(found.uncertainty), found.unshown
    (1000, ('m2',))
    """
    noise = TORQUE_NOISE * np.sqrt(spectrum.values[-1] / rows)
    root = spectrum.inverse_root(subset.directions)
    if subset.others_known:
        # The covariance of what remains is the inverse of a part, not a part of the inverse.
        own = spectrum.root(subset.directions)
        _, sizes, vectors = np.linalg.svd(own, full_matrices=False)
        root = vectors / np.maximum(sizes, np.finfo(float).tiny)[:, None]
    _, sizes, vectors = np.linalg.svd(root, full_matrices=False)
    uncertainty = float(noise * sizes[0])
    if uncertainty <= 1.0:
        return Identifiability(uncertainty, ())
    deviations = noise * np.linalg.norm(root, axis=0)
    order = np.argsort(-deviations, kind="stable")
    # Where no parameter passes alone, but several do together, the worst direction has a largest part.
    limit = min(1.0, float(deviations[order[0]]))
    return Identifiability(uncertainty, tuple(subset.names[k] for k in order if deviations[k] >= limit))
