"""From a solver's dual point, whose equations hold to its accuracy, to a bound that holds whatever the solver did."""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from .analytic_center import Middle

__all__ = ["DualBound"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

REACH = 1e2
"""The bounds hold for robots up to this many times as large as the one in the middle was allowed to be."""

MENDING_STEPS = 4

DAMPINGS = (1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4)
"""Parts of the largest singular value below which mending leaves things as they are; the best one is taken."""

LEAST_PULL = 1e-6
"""What a mending step may change in the pull at u where there is none."""

EPSILON = float(np.finfo(float).eps)


class DualBound:
    """Lower bounds of combinations c·δ over a section, from dual matrices.

    In the coordinates v of the middle, c·v ≥ -Σ tr Z_b + g·v with g_j = c_j - Σ <B_j, Z_b>, for any Z ⪰ 0. Within the
    region g·v has a least value; along the free directions g vanishes to rounding, and what is left of it counts with
    the reach.

    Parameters
    ----------
    middle : Middle
    """

    def __init__(self, middle: Middle) -> None:
        self.middle = middle
        count = len(middle.centre)
        second = middle.ball[1]
        # Directions of v that leave u where it is.
        still = np.linalg.svd(second)[2][np.linalg.matrix_rank(second) :] if len(second) else np.eye(count)
        self._still = still.T
        self._to_pull = np.linalg.pinv(second.T)
        order = sum(group.size * len(group.indices) for group in middle.groups)
        self._radius = 4.0 * REACH * (order + 2.0)

    @property
    def reach(self) -> float:
        """The bounds hold where the traces of all blocks (kg, kg m², ...) add to less than this."""
        return REACH * self.middle.size

    def of(self, row: Vector, duals: tuple[Matrix, ...], pull: Vector) -> float:
        """The lower bound of row · δ, rounded down; -inf where the matrices are no numbers.

        Parameters
        ----------
        row : (n,)
        duals : tuple of (b, d, d)
            Z of each group, in the units of the middle, for the objective scaled to length 1.
        pull : (k,)
            The dual of the region: Σ <B_j, Z_b> plus what it gives along v_j is c_j, to the solver's accuracy.
        """
        objective = self.middle.directions.T @ row
        length = float(np.linalg.norm(objective))
        if length == 0.0:
            return float(row @ self.middle.parameters)
        if not all(np.all(np.isfinite(Z)) for Z in (*duals, pull)):
            return -np.inf
        target = objective / length
        matrices = tuple(_positive(Z) for Z in duals)
        best = self._value(target, matrices)
        for _ in range(MENDING_STEPS):
            mended = max(
                ((self._value(target, Z), Z, p) for Z, p in self._mended(target, matrices, pull)),
                key=lambda found: found[0],
                default=None,
            )
            if mended is None or mended[0] <= best:
                break
            gain, (best, matrices, pull) = mended[0] - best, mended
            if gain < 1e-9:
                break
        size = float(np.abs(row) @ np.abs(self.middle.parameters))
        return float(row @ self.middle.parameters) + length * best - 4 * EPSILON * size

    def _value(self, target: Vector, matrices: tuple[Matrix, ...]) -> float:
        """The bound that matrices prove, as it is."""
        value = -sum(float(np.einsum("bii->", Z)) for Z in matrices)
        rest = target - self._products(matrices)
        first = self.middle.ball[0]
        if len(first):
            # rest · v = pull · (u - first), which is least at the edge of the region.
            pull = self._to_pull @ rest
            value -= float(np.linalg.norm(pull) + pull @ first)
        left = float(np.linalg.norm(self._still.T @ rest))
        return value - left * self._radius - 16 * EPSILON * abs(value)

    def _products(self, matrices: tuple[Matrix, ...]) -> Vector:
        """Σ <B_j, Z_b> for every j."""
        total = np.zeros(len(self.middle.centre))
        for group, Z in zip(self.middle.groups, matrices, strict=True):
            total += np.einsum("bqij,bij->q", group.coefficients, Z)
        return total

    def _mended(
        self, target: Vector, matrices: tuple[Matrix, ...], pull: Vector
    ) -> Iterator[tuple[tuple[Matrix, ...], Vector]]:
        """Matrices near the given ones whose equations hold better, and the pull that goes with them.

        Z^½ (1 + X) Z^½ with X as small as can be: what is zero stays zero, and what is not stays positive.
        """
        second = self.middle.ball[1]
        missing = target - self._products(matrices) - second.T @ pull
        weight = float(np.linalg.norm(pull)) + LEAST_PULL
        roots = [_root(Z) for Z in matrices]
        rows = [
            np.einsum("bij,bqjk,bkl->qbil", root, group.coefficients, root, optimize=True).reshape(len(missing), -1)
            for group, root in zip(self.middle.groups, roots, strict=True)
        ]
        left, values, right = np.linalg.svd(np.hstack([*rows, weight * second.T]), full_matrices=False)
        along = left.T @ missing
        for damping in DAMPINGS:
            X = right.T @ (along * values / (values**2 + (damping * max(1.0, float(values.max(initial=0.0)))) ** 2))
            if float(np.abs(X).max(initial=0.0)) > 0.5:
                continue
            found, start = [], 0
            for Z, root in zip(matrices, roots, strict=True):
                change = X[start : start + root.size].reshape(root.shape)
                start += root.size
                found.append(_positive(Z + root @ (0.5 * (change + change.transpose(0, 2, 1))) @ root))
            yield tuple(found), pull + weight * X[start:]


def _positive(matrices: Matrix) -> Matrix:
    """The nearest semidefinite matrices."""
    values, vectors = np.linalg.eigh(matrices)
    return np.asarray(np.einsum("bij,bj,bkj->bik", vectors, np.maximum(values, 0.0), vectors))


def _root(matrices: Matrix) -> Matrix:
    """Square roots of semidefinite matrices."""
    values, vectors = np.linalg.eigh(matrices)
    return np.asarray(np.einsum("bij,bj,bkj->bik", vectors, np.sqrt(np.maximum(values, 0.0)), vectors))
