"""Bounding boxes of links, points in them, and the inertial parameters that masses there make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError
from steelyard.feasibility import CenterOfMassBox, DensityInBox

from .method import Problem

__all__ = ["Corners", "boxes_of_links", "inertia_of_points", "masses_near", "points_in_box"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Corners = tuple[Sequence[float], Sequence[float]]
"""Lower and upper corner of a box, (3,) each, in metres, in the link frame."""

KINDS = ("centre", "faces", "edges", "vertices")
"""Kinds of points by the number of coordinates that are on the surface of the box."""

DEFAULT_LENGTHS = 2.0
"""Half the side of the cube of a link of which nothing is known, in typical lengths."""

EVENNESS = 1e-6
"""Weight with which the masses of a prior are spread evenly."""


def points_in_box(
    kinds: Sequence[str] = KINDS, subdivisions: int = 2, points: Sequence[Sequence[float]] | None = None
) -> Matrix:
    """Return places within the box from -1 to 1 along each axis, (count, 3).

    Parameters
    ----------
    kinds : sequence of str
        Of ``"vertices"``, ``"edges"``, ``"faces"``, ``"centre"``: points of a grid by where they are.
    subdivisions : int
        Parts of each side.
    points : sequence of (3,), optional
        Returned instead, after a check.

    Raises
    ------
    InputError
        For an unknown kind, or places from which not every set of ten inertial parameters can be combined.

    Examples
    --------
    >>> len(points_in_box()), len(points_in_box(("vertices", "centre", "faces")))
    (27, 15)
    """
    if points is not None:
        found = np.asarray(points, dtype=np.float64)
        if found.ndim != 2 or found.shape[1] != 3 or not np.all(np.abs(found) <= 1.0):
            raise InputError("points must be rows of three numbers between -1 and 1: places within the box of a link.")
    else:
        unknown = [kind for kind in kinds if kind not in KINDS]
        if unknown or isinstance(kinds, str):
            raise InputError(f"kinds must be some of {', '.join(KINDS)}, got {kinds!r}.")
        if not isinstance(subdivisions, int) or subdivisions < 1:
            raise InputError(f"subdivisions must be a positive integer, got {subdivisions!r}.")
        places = np.linspace(-1.0, 1.0, subdivisions + 1)
        grid = np.stack(np.meshgrid(places, places, places, indexing="ij"), axis=-1).reshape(-1, 3)
        outside = np.sum(np.abs(grid) == 1.0, axis=1)
        found = grid[np.isin(outside, [KINDS.index(kind) for kind in kinds])]
    rank = int(np.linalg.matrix_rank(_columns(found))) if len(found) else 0
    if rank < 10:
        raise InputError(
            f"{len(found)} points can combine only {rank} of the ten inertial parameters of a link; take more of "
            "the kinds (vertices, edges, faces, centre), or more subdivisions."
        )
    return found


def _columns(points: Matrix) -> Matrix:
    """Inertial parameters of a unit mass at each point, (..., 3) to (..., 10)."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    one = np.ones_like(x)
    columns = [y**2 + z**2, -x * y, -x * z, x**2 + z**2, -y * z, x**2 + y**2, x, y, z, one]
    return np.stack(columns, axis=-1)


def inertia_of_points(boxes: Matrix, places: Matrix) -> Matrix:
    """Return the blocks of R: inertial parameters of a unit mass at each point (thesis 2.74).

    Parameters
    ----------
    boxes : (links, 2, 3)
        Lower and upper corners.
    places : (count, 3)
        Within the box from -1 to 1.

    Returns
    -------
    (links, 10, count)

    Examples
    --------
    >>> box = np.array([[[0.0, 0.0, 0.0], [2.0, 2.0, 2.0]]])
    >>> inertia_of_points(box, np.array([[1.0, -1.0, -1.0]]))[0, :, 0].tolist()
    [0.0, -0.0, -0.0, 4.0, -0.0, 4.0, 2.0, 0.0, 0.0, 1.0]
    """
    middle, half = boxes.mean(axis=1), 0.5 * (boxes[:, 1] - boxes[:, 0])
    points = middle[:, None, :] + places[None, :, :] * half[:, None, :]
    return np.asarray(np.swapaxes(_columns(points), 1, 2))


def masses_near(R: Matrix, inertial: Matrix, scale: Matrix, typical: Vector) -> Matrix:
    """Return the masses, none negative, whose inertial parameters are nearest to given ones, (links, count).

    Parameters
    ----------
    R : (links, 10, count)
    inertial : (links, 10)
    scale : (links, 10)
        Units in which the distance is measured.
    typical : (links,)
        Typical mass of a point: among the many answers the evenest one is taken.
    """
    from scipy.optimize import nnls

    found = np.zeros((R.shape[0], R.shape[2]))
    count = R.shape[2]
    for k in range(len(R)):
        mean = max(inertial[k, 9], 0.0) / count
        even = np.sqrt(EVENNESS) / typical[k]
        rows = np.vstack([R[k] / scale[k][:, None], even * np.eye(count)])
        found[k] = nnls(rows, np.concatenate([inertial[k] / scale[k], np.full(count, even * mean)]))[0]
    return found


def boxes_of_links(
    problem: Problem, given: Mapping[str, Corners], default: float | None, prior: Vector | None
) -> tuple[Matrix, list[str]]:
    """Return the corners of a box for each link, (links, 2, 3), and remarks.

    Parameters
    ----------
    problem : Problem
    given : mapping from link to corners
    default : float or None
        Half the side of the cube of other links, about the centre of mass of the prior where that is known.
    prior : (n,) or None

    Raises
    ------
    InputError
        If a link does not exist, or a given box has no thickness.
    """
    feasible_set = problem.feasible_set
    names = [str(name) for name in feasible_set.model.robot.link_names]
    known: dict[str, Corners] = {}
    for kind in (CenterOfMassBox, DensityInBox):
        known |= {c.link: (c.lower, c.upper) for c in feasible_set.constraints if isinstance(c, kind)}
    for link, corners in given.items():
        if link not in names:
            raise InputError(f"boxes names the link {link!r}, which the robot does not have (links: {names}).")
        box = np.asarray(corners, dtype=np.float64)
        if box.shape != (2, 3) or not np.all(np.isfinite(box)) or np.any(box[0] >= box[1]):
            raise InputError(f"the box of link {link!r} needs two corners of three numbers, lower below upper.")
        known[link] = corners
    half = DEFAULT_LENGTHS * problem.units.lengths if default is None else np.full(len(names), default)
    center = np.zeros((len(names), 3))
    if prior is not None:
        inertial = prior[problem.links]
        there = np.all(np.isfinite(inertial[:, 6:]), axis=1) & (inertial[:, 9] > 0.0)
        center[there] = inertial[there, 6:9] / inertial[there, 9:]
    boxes = np.stack([center - half[:, None], center + half[:, None]], axis=1)
    guessed = []
    for k, name in enumerate(names):
        if name not in known:
            guessed.append(name)
            continue
        lower, upper = np.asarray(known[name], dtype=np.float64)
        # A side that is open, or known exactly, is as wide as the default; equations keep what is known exactly.
        low = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2 * half[k], boxes[k, 0]))
        high = np.where(np.isfinite(upper), upper, np.where(np.isfinite(lower), lower + 2 * half[k], boxes[k, 1]))
        flat = low == high
        boxes[k] = np.where(flat, low - half[k], low), np.where(flat, high + half[k], high)
    remarks = []
    if guessed:
        sizes = sorted({f"{2 * half[names.index(name)]:.3g}" for name in guessed})
        which = f"{len(guessed)} links" if len(guessed) > 3 else ", ".join(guessed)
        remarks.append(
            f"No box is known of {which}, so a cube with sides of {' to '.join([sizes[0], *sizes[1:][-1:]])} m "
            "was taken; give boxes, or CenterOfMassBox constraints."
        )
    return boxes, remarks
