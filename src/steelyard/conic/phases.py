"""Two problems about a problem: is there a point at all, and does the objective have a least value?"""

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from .problem import Cone, ConicProblem

__all__ = ["infeasibility_problem", "interior_element", "recession_problem"]

Vector = npt.NDArray[np.float64]


def interior_element(cones: tuple[Cone, ...]) -> Vector:
    """A vector inside every cone but the zero ones, where it is zero: ones, first unit vectors, unit matrices."""
    parts = [np.zeros(0)]
    for cone in cones:
        part = np.zeros(cone.rows)
        if cone.kind == "nonnegative":
            part[:] = 1.0
        elif cone.kind == "second-order":
            part[:1] = 1.0
        elif cone.kind == "semidefinite":
            part[np.cumsum(np.arange(1, cone.size + 1)) - 1] = 1.0
        parts.append(part)
    return np.concatenate(parts)


def infeasibility_problem(problem: ConicProblem) -> ConicProblem:
    """Minimise t subject to A x + s = b + t e, s in K, t ≥ -1, with e inside K.

    It always has points. Where its least value is positive, its dual point proves that the problem has none.
    """
    count = problem.A.shape[1]
    inside = interior_element(problem.cones)
    last = sparse.csc_array(np.concatenate([-inside, [-1.0]])[:, None])
    above = sparse.vstack([problem.A, sparse.csc_array((1, count))])
    return ConicProblem(
        P=sparse.csc_array((count + 1, count + 1)),
        q=np.concatenate([np.zeros(count), [1.0]]),
        A=sparse.csc_array(sparse.hstack([above, last])),
        b=np.concatenate([problem.b, [1.0]]),
        cones=(*problem.cones, Cone("nonnegative", 1)),
    )


def recession_problem(problem: ConicProblem) -> ConicProblem:
    """Minimise qᵀd subject to -A d in K, P d = 0, qᵀd ≥ -1.

    Zero is a point of it. Where its least value is -1, the problem's objective falls without end along d.
    """
    rows, count = problem.A.shape
    curved = sparse.csc_array(problem.P)
    A = sparse.vstack([problem.A, curved, sparse.csc_array(-problem.q[None])])
    return ConicProblem(
        P=sparse.csc_array((count, count)),
        q=problem.q,
        A=sparse.csc_array(A),
        b=np.concatenate([np.zeros(rows + count), [1.0]]),
        cones=(*problem.cones, Cone("zero", count), Cone("nonnegative", 1)),
    )
