"""Thesis (3.40) and (3.53) as semidefinite programs and SDPA files."""

import numpy as np
import pytest

from steelyard.conic import SemidefiniteProgram
from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet, correct
from steelyard.lmi import (
    LinearMatrixInequality,
    base_variable_names,
    distance_inequality,
    inequality_of_program,
    residual_inequality,
    to_base_dependent,
)


def nearest(feasible, base):
    """(3.40)."""
    model = feasible.model
    inequality = to_base_dependent(feasible.inequality.with_margin(feasible.margin), model)
    return distance_inequality(base, base_variable_names(model)) & inequality


def test_program_has_the_signs_of_the_format():
    program = LinearMatrixInequality.from_matrices([["x - 3", "2*y"], ["2*y", 5]]).program("4*y - x + 7")
    assert program.cost.tolist() == [-1.0, 4.0]
    dense = np.zeros((3, 2, 2))
    dense[program.matrix, program.row, program.column] = program.value
    assert dense.tolist() == [[[3, 0], [0, -5]], [[1, 0], [0, 0]], [[0, 2], [0, 0]]]


def test_nearest_point_through_a_file(two_links, tmp_path):
    feasible = FeasibleSet(two_links, margin=1e-4)
    base = np.array([-0.6, 0.3, 0.2, 0.4, -0.1, -0.05])
    inequality = nearest(feasible, base)
    path = inequality.program("u").write(tmp_path / "nearest.dat-s")
    program = SemidefiniteProgram.read(path)
    assert inequality_of_program(program) == inequality
    solution = program.solve()
    found = dict(zip(program.variable_names, solution.primal, strict=True))
    beta = np.array([found[name] for name in base_variable_names(two_links)])
    assert found["u"] == pytest.approx(np.sum((beta - base) ** 2), abs=1e-6)
    assert found["u"] == pytest.approx(correct(feasible, base=base).squared_distance, rel=1e-4)


def test_regression_through_a_file(two_links, tmp_path):
    """(3.53), where plain least squares is feasible: the answer is that of NumPy."""
    rng = np.random.default_rng(1)
    W, beta = rng.normal(size=(40, 6)), np.array([1.5, 0.3, 0.6, 0.2, 0.1, 0.05])
    omega = W @ beta + 0.01 * rng.normal(size=40)
    Q, R1 = np.linalg.qr(W)
    rho1 = Q.T @ omega
    best = np.linalg.lstsq(W, omega)[0]
    squared = float(np.sum((omega - W @ best) ** 2))
    names = base_variable_names(two_links)
    feasible = FeasibleSet(two_links, "inertia")
    inequality = residual_inequality(R1, rho1, names, constant=float(omega @ omega - rho1 @ rho1))
    inequality = inequality & to_base_dependent(feasible.inequality.with_margin(1e-6), two_links)
    program = SemidefiniteProgram.read(inequality.program({"u": 1.0}).write(tmp_path / "regression.dat-s"))
    assert inequality_of_program(program) == inequality
    solution = program.solve()
    found = dict(zip(program.variable_names, solution.primal, strict=True))
    assert solution.objective == pytest.approx(squared, abs=1e-6)
    np.testing.assert_allclose([found[name] for name in names], best, atol=1e-3)


def test_diagonal_blocks_become_single_elements():
    program = SemidefiniteProgram.from_matrices([1.0, 1.0], [[[1.0, -2.0]], [[1.0, 0.0]], [[0.0, 3.0]]])
    inequality = inequality_of_program(program)
    assert inequality.names == ("x1", "x2")
    assert [str(matrix[0, 0]) for matrix in inequality.expressions] == ["x1 - 1", "3*x2 + 2"]
    assert inequality_of_program(program, ["a", "b"]).names == ("a", "b")


def test_wrong_programs_are_refused():
    inequality = LinearMatrixInequality.from_matrices("x")
    with pytest.raises(InputError, match=r"objective 'y': 'y' is not among the names; known are [^.]*\.$"):
        inequality.program("y")
    with pytest.raises(InputError, match="each of 1 variables"):
        inequality.program([1.0, 2.0])
    with pytest.raises(InputError, match="1 variables, got 2 names"):
        inequality_of_program(inequality.program("x"), ["a", "b"])
    with pytest.raises(InputError, match="nothing to minimise"):
        LinearMatrixInequality.from_matrices("3").program({})


@pytest.mark.slow
@pytest.mark.data
def test_distance_of_the_wam_through_a_file(thesis_wam, table_4_9, tmp_path):
    """Thesis 4.5.2: u' = 0.0077."""
    inequality = nearest(FeasibleSet(thesis_wam, "inertia"), table_4_9["WLS"])
    program = SemidefiniteProgram.read(inequality.program("u").write(tmp_path / "wam.dat-s"))
    assert inequality_of_program(program) == inequality
    assert program.solve().objective == pytest.approx(0.00774, abs=2e-5)
