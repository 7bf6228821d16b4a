"""What becomes of a run of Clarabel in which its Rust code panics or is interrupted."""

import clarabel
import numpy as np
import pytest
import scipy.sparse as sparse
from polars.exceptions import PanicException

from steelyard.conic import Cone, ConicProblem, Outcome, solve
from steelyard.conic.clarabel_solver import RepeatedProblem
from steelyard.errors import SolverError


def smallest(corner: float = 1.0) -> ConicProblem:
    """The smallest x with [[x, c], [c, x]] positive semidefinite: |c|."""
    A = sparse.csc_array(np.array([[-1.0], [0.0], [-1.0]]))
    b = np.array([0.0, np.sqrt(2) * corner, 0.0])
    return ConicProblem(sparse.csc_array((1, 1)), np.ones(1), A, b, (Cone("semidefinite", 2),))


class Faulty:
    """Clarabel's solver, of which the first runs end in an exception as Rust code raises it in Python."""

    error: BaseException = PanicException("called `Option::unwrap()` on a `None` value")
    faults = 0
    made = 0
    real = clarabel.DefaultSolver

    def __init__(self, *arguments: object) -> None:
        Faulty.made += 1
        self.held = Faulty.real(*arguments)

    def update(self, **changes: object) -> None:
        self.held.update(**changes)

    def solve(self) -> object:
        if Faulty.faults > 0:
            Faulty.faults -= 1
            raise Faulty.error
        return self.held.solve()


@pytest.fixture
def faulty(monkeypatch):
    monkeypatch.setattr(clarabel, "DefaultSolver", Faulty)
    monkeypatch.setattr(Faulty, "made", 0)
    monkeypatch.setattr(Faulty, "faults", 1)
    return Faulty


def test_a_panic_is_no_exception():
    """Else the tests below would hold whatever is caught."""
    assert not issubclass(PanicException, Exception)


def test_after_a_panic_the_next_attempt_is_made(faulty):
    found = solve(smallest())
    assert found.outcome is Outcome.SOLVED
    assert found.primal == pytest.approx([1.0])
    assert faulty.made == 2


def test_panics_of_all_attempts_are_one_sentence(faulty):
    faulty.faults = 1000
    found = solve(smallest())
    assert (found.outcome, found.status) == (Outcome.STOPPED, "Panic")
    with pytest.raises(SolverError, match="Panic"):
        found.require("find the smallest x")


def test_a_panic_of_one_objective_spoils_no_other(faulty):
    faulty.faults = 0
    problem = RepeatedProblem(smallest(), "clarabel", 1e-8)
    assert problem.solve(np.array([2.0])).objective == pytest.approx(2.0)
    assert faulty.made == 1
    faulty.faults = 1
    found = problem.solve(np.array([3.0]))
    assert (found.outcome, found.status) == (Outcome.STOPPED, "Panic")
    assert np.isnan(found.primal).all()
    assert found.dual.shape == (3,)
    # What panicked is not used again.
    found = problem.solve(np.array([3.0]))
    assert found.objective == pytest.approx(3.0)
    assert faulty.made == 2


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ValueError("no panic")], ids=["interrupt", "error"])
def test_other_exceptions_pass(faulty, monkeypatch, error):
    monkeypatch.setattr(faulty, "error", error)
    with pytest.raises(type(error)):
        solve(smallest())
    faulty.faults = 1
    with pytest.raises(type(error)):
        RepeatedProblem(smallest(), "clarabel", 1e-8).solve(np.ones(1))


def test_a_right_side_whose_square_overflows_is_no_crash():
    found = solve(smallest(1e200))
    assert found.outcome is Outcome.SOLVED
    assert found.primal[0] >= 1e200


def farther_than(target: np.ndarray) -> ConicProblem:
    """The smallest u, and x ≥ 0, with [[u, (t - x)ᵀ], [t - x, 1]] positive semidefinite: u is the squared distance."""
    count = len(target)
    order = count + 1
    place = {(i, j): i + j * (j + 1) // 2 for j in range(order) for i in range(j + 1)}
    A, b = np.zeros((count + len(place), order)), np.zeros(count + len(place))
    A[:count, 1:] = -np.eye(count)
    A[count, 0] = -1.0
    for k in range(count):
        A[count + place[0, k + 1], k + 1] = np.sqrt(2)
        b[count + place[0, k + 1]] = np.sqrt(2) * target[k]
        b[count + place[k + 1, k + 1]] = 1.0
    cones = (Cone("nonnegative", count), Cone("semidefinite", order))
    return ConicProblem(sparse.csc_array((order, order)), np.eye(order)[0], sparse.csc_array(A), b, cones)


def matrix(vector: np.ndarray, order: int) -> np.ndarray:
    """The symmetric matrix of a stacked upper triangle."""
    found = np.zeros((order, order))
    found.T[np.tril_indices(order)] = vector
    return (found + found.T) / np.where(np.eye(order) > 0.0, 2.0, np.sqrt(2))


@pytest.mark.parametrize("failing", [0, 1])
@pytest.mark.parametrize("count", [5, 30])
def test_large_arrows_are_decomposed_into_small_cones(monkeypatch, count, failing):
    """The answers are whole matrices in either case; where the decomposition fails, the next attempt does without."""
    decomposed = []

    class Watched(Faulty):
        def __init__(self, *arguments):
            decomposed.append(arguments[-1].chordal_decomposition_enable)
            super().__init__(*arguments)

    monkeypatch.setattr(clarabel, "DefaultSolver", Watched)
    monkeypatch.setattr(Faulty, "faults", failing)
    target = np.random.default_rng(3).normal(size=count)
    problem = farther_than(target)
    found = solve(problem)
    assert decomposed == [count == 30, False][: failing + 1]
    assert found.outcome is Outcome.SOLVED
    assert found.objective == pytest.approx(np.sum(target.clip(max=0.0) ** 2), rel=1e-6)
    np.testing.assert_allclose(found.primal[1:], target.clip(min=0.0), atol=1e-3)
    np.testing.assert_allclose(problem.A @ found.primal + found.slack, problem.b, atol=1e-6)
    np.testing.assert_allclose(problem.A.T @ found.dual, -problem.q, atol=1e-6)
    for vector in (found.slack, found.dual):
        assert vector[:count].min() > -1e-6
        assert np.linalg.eigvalsh(matrix(vector[count:], count + 1))[0] > -1e-6
