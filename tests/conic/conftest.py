"""Conic problems from dense matrices, and every solver that is here."""

import numpy as np
import pytest
import scipy.sparse as sparse

from steelyard.conic import ConicProblem, find_solver

SOLVERS = ("clarabel", "scs", "csdp", "dsdp", "sdpa")


@pytest.fixture(params=SOLVERS)
def solver(request) -> str:
    """Each of the five solvers, or a skip where it is not installed."""
    chosen = find_solver(request.param)
    if not chosen.installed():
        pytest.skip(f"{chosen.title} is not installed ({chosen.remedy})")
    return request.param


@pytest.fixture(scope="session")
def conic():
    """A problem from dense P, q, A, b and cones."""

    def build(P, q, A, b, *cones):
        q = np.asarray(q, dtype=float)
        P = np.zeros((len(q), len(q))) if P is None else P
        A = np.asarray(A, dtype=float)
        A = A[:, None] if A.ndim == 1 else A
        return ConicProblem(sparse.csc_array(P), q, sparse.csc_array(A), np.asarray(b, dtype=float), cones)

    return build
