"""The barrier and its derivatives against their definition, and Newton's method against closed forms."""

import numpy as np
import pytest
from simulated_arm import simulated_arm

from steelyard.feasibility import CenterOfMassBox, FeasibleSet, TotalMass
from steelyard.feasibility.barrier import Barrier, add_log_determinants, log_determinants, minimise

ARM = simulated_arm(2)
SETS = [
    FeasibleSet(ARM.model),
    FeasibleSet(ARM.model, "inertia"),
    FeasibleSet(ARM.model, constraints=[TotalMass(maximum=30.0), CenterOfMassBox("link2", [-0.5] * 3, [0.5] * 3)]),
]


@pytest.mark.parametrize("feasible_set", SETS)
def test_value_is_that_of_the_blocks(feasible_set: FeasibleSet) -> None:
    points = ARM.truth * np.array([[1.0], [1.3], [-1.0]])
    found = Barrier(feasible_set).value(points)
    for point, value in zip(points[:2], found[:2], strict=True):
        direct = -sum(np.linalg.slogdet(block.evaluate(point))[1] for block in feasible_set.blocks)
        assert value == pytest.approx(direct, rel=1e-12)
    assert found[2] == np.inf


@pytest.mark.parametrize("feasible_set", SETS)
def test_derivatives_are_those_of_differences(feasible_set: FeasibleSet) -> None:
    barrier = Barrier(feasible_set)
    size = len(ARM.truth)
    gradients, hessians = np.zeros((1, size)), np.zeros((1, size, size))
    barrier.add_derivatives(ARM.truth[None], np.array([2.0]), gradients, hessians)
    sizes = np.sqrt(np.diagonal(hessians[0])) + 1e-6  # offsets have no condition
    steps = 1e-4 / sizes
    for index, step in enumerate(steps):
        sides = np.array([ARM.truth, ARM.truth])
        sides[0, index] -= step
        sides[1, index] += step
        low, high = barrier.value(sides)
        assert gradients[0, index] == pytest.approx(2 * (high - low) / (2 * step), rel=1e-4, abs=1e-4 * sizes[index])
        slopes = np.zeros((2, size))
        barrier.add_derivatives(sides, np.array([2.0, 2.0]), slopes, np.zeros((2, size, size)))
        difference = (slopes[1] - slopes[0]) / (2 * step)
        scale = sizes[index] * sizes
        np.testing.assert_allclose(hessians[0, index] / scale, difference / scale, atol=1e-5)


class WithTrace:
    """t (trace of the pseudo-inertias) + barrier of the links: least where each of them is 1 / t."""

    def __init__(self, barrier: Barrier, row: np.ndarray, pulls: np.ndarray) -> None:
        self.barrier, self.row, self.pulls = barrier, row, pulls

    def value(self, points, problems):
        return self.pulls[problems] * (points @ self.row) + self.barrier.value(points)

    def derivatives(self, points, problems):
        gradients, hessians = self.pulls[problems, None] * self.row, np.zeros((len(points), *2 * (len(self.row),)))
        self.barrier.add_derivatives(points, np.ones(len(points)), gradients, hessians)
        return gradients, hessians


def test_minimum_is_the_closed_form() -> None:
    feasible_set = FeasibleSet(ARM.model, terms=False)
    row = np.zeros(len(ARM.truth))
    for block in feasible_set.blocks:
        np.add.at(row, block.indices, np.trace(block.coefficients, axis1=1, axis2=2))
    pulls = np.array([0.1, 1.0, 250.0])
    links = feasible_set.link_columns.ravel()
    basis = np.eye(len(ARM.truth))[:, links]
    start = np.tile(ARM.truth, (3, 1))
    found = minimise(WithTrace(Barrier(feasible_set), row, pulls), start, basis, 1e-12)
    for point, pull in zip(found, pulls, strict=True):
        for columns in feasible_set.link_columns:
            # The pseudo-inertia is 1 / t: second moments 1 / t along each axis, so that L_xx = L_yy = L_zz = 2 / t.
            np.testing.assert_allclose(
                point[columns], np.array([2, 0, 0, 2, 0, 2, 0, 0, 0, 1]) / pull, atol=1e-6 / pull
            )
    terms = np.setdiff1d(np.arange(len(ARM.truth)), links)
    np.testing.assert_array_equal(found[:, terms], start[:, terms])


def test_what_is_not_finite_is_outside() -> None:
    matrices = np.stack([np.diag([2.0, 3.0]), np.full((2, 2), np.nan), np.diag([np.inf, 1.0]), np.diag([1.0, -1.0])])
    found = log_determinants(matrices)
    assert found[0] == pytest.approx(np.log(6.0))
    assert np.all(found[1:] == -np.inf)


def test_derivatives_of_log_determinants_are_traces() -> None:
    """tr(P⁻¹A) and -tr(P⁻¹A P⁻¹B) of matrices that share unknowns; none where a matrix is not positive definite."""
    random = np.random.default_rng(0)
    roots, coefficients = random.normal(size=(2, 3, 5, 5)), random.normal(size=(3, 4, 5, 5))
    matrices, coefficients = roots @ roots.swapaxes(-1, -2), coefficients + coefficients.swapaxes(-1, -2)
    indices, factors = np.array([[0, 1, 2, 3], [5, 4, 3, 2], [0, 2, 4, 6]]), np.array([2.0, -0.5])
    gradients, hessians = np.ones((2, 7)), np.ones((2, 7, 7))
    add_log_determinants(matrices, coefficients, indices, factors, gradients, hessians)
    slopes, curvatures = np.ones((2, 7)), np.ones((2, 7, 7))
    for point, factor in enumerate(factors):
        for matrix, own, columns in zip(matrices[point], coefficients, indices, strict=True):
            products = np.linalg.inv(matrix) @ own
            slopes[point, columns] += factor * np.trace(products, axis1=1, axis2=2)
            curvatures[point][np.ix_(columns, columns)] -= factor * np.einsum("cij,dji->cd", products, products)
    np.testing.assert_allclose(gradients, slopes, rtol=1e-9)
    np.testing.assert_allclose(hessians, curvatures, rtol=1e-9, atol=1e-9 * np.abs(curvatures).max())
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        add_log_determinants(-matrices, coefficients, indices, factors, gradients, hessians)
