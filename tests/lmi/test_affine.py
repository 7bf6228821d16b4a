import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.lmi import AffineBlock, AffineStack, is_positive_definite, symmetric_to_vector, vector_to_symmetric


def random_block(rng, name, size, indices):
    matrices = rng.normal(size=(len(indices) + 1, size, size))
    matrices = matrices + matrices.transpose(0, 2, 1)
    return AffineBlock(name, matrices[0], np.asarray(indices), matrices[1:])


def test_vectorisation_keeps_inner_products():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 5, 5))
    a, b = a + a.T, b + b.T
    assert symmetric_to_vector(a) @ symmetric_to_vector(b) == pytest.approx(np.trace(a @ b))
    np.testing.assert_allclose(vector_to_symmetric(symmetric_to_vector(a)), a, atol=1e-14)


def test_order_of_the_vector_is_upper_triangle_by_columns():
    matrix = np.array([[1.0, 2.0, 4.0], [2.0, 3.0, 5.0], [4.0, 5.0, 6.0]])
    root = np.sqrt(2)
    expected = [1, 2 * root, 3, 4 * root, 5 * root, 6]
    np.testing.assert_allclose(symmetric_to_vector(matrix), expected)


def test_stack_agrees_with_its_blocks():
    rng = np.random.default_rng(2)
    layout = enumerate([(3, [0, 4]), (1, [2]), (2, [1, 2, 3]), (1, [0, 5])])
    blocks = tuple(random_block(rng, f"block {i}", size, indices) for i, (size, indices) in layout)
    stack = AffineStack(blocks, 6)
    delta = rng.normal(size=6)
    matrices = stack.matrices(stack.constant + stack.coefficients @ delta)
    for block, matrix in zip(blocks, matrices, strict=True):
        np.testing.assert_allclose(matrix, block.evaluate(delta), atol=1e-13)
    for block, unit in zip(blocks, stack.matrices(stack.identity), strict=True):
        np.testing.assert_array_equal(unit, np.eye(block.size))


def test_substitution_evaluates_to_the_same():
    rng = np.random.default_rng(3)
    block = random_block(rng, "block", 4, [0, 2, 5])
    matrix, offset, unknowns = rng.normal(size=(6, 4)), rng.normal(size=6), rng.normal(size=4)
    substituted = block.substitute(matrix, offset)
    np.testing.assert_allclose(substituted.evaluate(unknowns), block.evaluate(matrix @ unknowns + offset), atol=1e-12)


def test_substitution_forgets_what_does_not_matter():
    block = AffineBlock("sum", np.zeros((1, 1)), np.array([0, 1]), np.ones((2, 1, 1)))
    assert block.substitute(np.array([[1.0, 0.0], [-1.0, 0.0]])).indices.size == 0


@pytest.mark.parametrize("smallest", [1e-18, 0.0, -1e-18, -1.0])
def test_definiteness_is_not_claimed_where_rounding_hides_it(smallest):
    rotation = np.linalg.qr(np.random.default_rng(4).normal(size=(4, 4)))[0]
    matrix = rotation @ np.diag([1.0, 2.0, 3.0, smallest]) @ rotation.T
    assert not is_positive_definite((matrix + matrix.T) / 2)


def test_definiteness_of_badly_scaled_matrix():
    assert is_positive_definite(np.diag([1e-9, 1.0, 1e3]))
    assert not is_positive_definite(np.full((2, 2), np.nan))


def test_asymmetric_block_is_refused():
    with pytest.raises(InputError, match="'tilted' is not symmetric"):
        AffineBlock("tilted", np.array([[0.0, 1.0], [0.0, 0.0]]), np.zeros(0, dtype=int), np.zeros((0, 2, 2)))


def test_wrong_shapes_are_refused():
    with pytest.raises(InputError, match="for 2 parameters"):
        AffineBlock("short", np.zeros((1, 1)), np.array([0, 1]), np.zeros((1, 1, 1)))
