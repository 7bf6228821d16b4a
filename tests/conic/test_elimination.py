import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sparse

from steelyard.conic.rewriting import Contradiction, Elimination, eliminate, square_root, squares_of


def random_equations(seed):
    """Sparse, of very different sizes, some of them dependent."""
    rng = np.random.default_rng(seed)
    count, rows = rng.integers(1, 12), rng.integers(0, 13)
    E = rng.normal(size=(rows, count)) * (rng.random((rows, count)) < 0.4)
    E *= 10.0 ** rng.integers(-3, 4, size=(rows, 1))
    if rows > 2 and seed % 3 == 0:
        E[-1] = 2 * E[0] - E[1]
    return E, rng


@pytest.mark.parametrize("seed", range(40))
def test_all_solutions_are_found(seed):
    E, rng = random_equations(seed)
    f = E @ rng.normal(size=E.shape[1])
    found = eliminate(sparse.csr_array(E), f)
    assert isinstance(found, Elimination)
    scale = 1 + np.abs(E).max(initial=0)
    np.testing.assert_allclose(E @ found.offset, f, atol=1e-10 * scale * (1 + np.abs(f).max(initial=0)))
    directions = found.directions.toarray()
    np.testing.assert_allclose(E @ directions, 0, atol=1e-10 * scale)
    # As many as the null space has, and independent.
    assert directions.shape[1] == scipy.linalg.null_space(E).shape[1] if len(E) else E.shape[1]
    assert np.linalg.matrix_rank(directions) == directions.shape[1] if directions.size else True


@pytest.mark.parametrize("seed", range(40))
def test_multipliers_balance_the_gradient(seed):
    E, rng = random_equations(seed)
    found = eliminate(sparse.csr_array(E), E @ np.ones(E.shape[1]))
    gradient = -E.T @ rng.normal(size=len(E))
    np.testing.assert_allclose(
        E.T @ found.multipliers(gradient), -gradient, atol=1e-9 * (1 + np.abs(gradient).max(initial=0))
    )


def test_contradictions_come_with_multipliers():
    for seed in range(0, 60, 3):
        E, rng = random_equations(seed)
        f = E @ rng.normal(size=E.shape[1])
        if len(f) < 3:
            continue
        f[-1] += 1.0 + np.abs(f).max()
        found = eliminate(sparse.csr_array(E), f)
        rank = np.linalg.matrix_rank(E)
        assert isinstance(found, Contradiction) == (np.linalg.matrix_rank(np.column_stack([E, f])) > rank)
        if isinstance(found, Contradiction):
            np.testing.assert_allclose(E.T @ found.multipliers, 0, atol=1e-9)
            assert f @ found.multipliers == pytest.approx(-1.0)


def test_a_chain_stays_sparse():
    """y = R x, as fits are written: the y are solved for, and the x remain as they are."""
    R = np.triu(np.random.default_rng(1).normal(size=(6, 6)))
    found = eliminate(sparse.csr_array(np.hstack([-np.eye(6), R])), np.zeros(6))
    np.testing.assert_allclose(found.directions.toarray(), np.vstack([R, np.eye(6)]), atol=1e-15)


@pytest.mark.parametrize("seed", range(6))
def test_square_root(seed):
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(4, 6)) * (rng.random((4, 6)) < 0.4) * 10.0 ** rng.integers(-6, 6, size=6)
    P = sparse.csc_array(factor.T @ factor)
    root = square_root(P)
    assert root.shape[0] <= np.linalg.matrix_rank(factor / np.maximum(np.linalg.norm(factor, axis=0), 1e-300)) + 1e-9
    units = np.sqrt(np.maximum(P.diagonal(), 1e-300))
    np.testing.assert_allclose(
        (root.T @ root).toarray() / np.outer(units, units), P.toarray() / np.outer(units, units), atol=1e-13
    )


def test_squares_are_the_quadratic_up_to_a_constant():
    rng = np.random.default_rng(2)
    M = rng.normal(size=(9, 7))
    P, offset = sparse.csc_array(M.T @ M), rng.normal(size=7)
    directions = sparse.csc_array(rng.normal(size=(7, 3)))
    squares = squares_of(P, offset, directions)
    assert squares.matrix.shape == (3, 3)
    points = rng.normal(size=(3, 5))
    quadratic = [0.5 * (offset + directions @ w) @ (P @ (offset + directions @ w)) for w in points.T]
    sums = [0.5 * np.sum((squares.matrix @ w + squares.constant) ** 2) for w in points.T]
    np.testing.assert_allclose(np.subtract(quadratic, sums), quadratic[0] - sums[0], rtol=1e-10)
    assert squares_of(sparse.csc_array((7, 7)), offset, directions) is None
