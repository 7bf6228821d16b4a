"""Compiled projections of blocks of rows, beside NumPy."""

import numpy as np
import pytest

from steelyard.graph.block_projection import project_blocks, transform_blocks


@pytest.mark.parametrize("width", [1, 15, 16, 17, 40, 233])
def test_projections_are_those_of_numpy(width: int) -> None:
    random = np.random.default_rng(width)
    rows, vectors = random.standard_normal((3, 64, width)), np.linalg.qr(random.standard_normal((64, 4)))[0].T.copy()
    projected, left = np.full((3, 4, width), np.nan), np.full((3, width), np.nan)
    project_blocks(vectors, rows, projected, left)
    np.testing.assert_allclose(projected, vectors @ rows, atol=1e-13)
    rest = rows - vectors.T @ (vectors @ rows)
    np.testing.assert_allclose(left, np.sum(rest**2, axis=1), atol=1e-12)


@pytest.mark.parametrize("width", [1, 16, 40, 233])
def test_products_and_their_squares_are_those_of_numpy(width: int) -> None:
    random = np.random.default_rng(width)
    rows, matrix = random.standard_normal((3, 8, width)), random.standard_normal((6, 8))
    products, squares = np.full((3, 6, width), np.nan), np.full((3, 2, width), np.nan)
    transform_blocks(matrix, rows, products, squares, (2, 5))
    np.testing.assert_allclose(products, matrix @ rows, atol=1e-13)
    np.testing.assert_allclose(squares[:, 0], np.sum((matrix @ rows)[:, 2:] ** 2, axis=1), atol=1e-12)
    np.testing.assert_allclose(squares[:, 1], np.sum((matrix @ rows)[:, 5:] ** 2, axis=1), atol=1e-12)


def test_arrays_that_are_not_contiguous_are_refused() -> None:
    rows = np.zeros((2, 64, 64))[:, :, ::2]
    with pytest.raises(ValueError, match="C-contiguous"):
        project_blocks(np.zeros((4, 64)), rows, np.zeros((2, 4, 32)), np.zeros((2, 32)))
