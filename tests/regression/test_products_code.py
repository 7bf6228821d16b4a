"""Rows that are divided by a triangle and multiplied by one compiled loop, beside NumPy and SciPy."""

import numpy as np
import pytest
from scipy.linalg import solve_triangular

from steelyard.graph.machine import batch_lanes
from steelyard.regression import products_code
from steelyard.regression.products_code import WIDEST, Division


@pytest.fixture(params=[4, 8])
def lanes(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Registers of this processor, and of others, which are computed in parts here."""
    if request.param != batch_lanes():
        monkeypatch.setattr(products_code, "batch_lanes", lambda: request.param)
        monkeypatch.setattr(products_code, "_compiled", products_code._compiled.__wrapped__)
    return int(request.param)


@pytest.mark.parametrize("width", [1, 2, 15, 16, 17, 45])
@pytest.mark.parametrize("spared", [0, 3, 5])
@pytest.mark.parametrize("widest", [5, WIDEST])
def test_products_of_quotients(width: int, spared: int, widest: int, lanes: int) -> None:
    random = np.random.default_rng(width)
    sizes = 10.0 ** random.uniform(-5.0, 5.0, width)
    triangle = (np.triu(random.normal(size=(width, width))) + 4.0 * np.eye(width)) * sizes
    division = Division(triangle, sizes, widest, 128.0)
    assert division.is_finite
    for count in (0, 1, 2, 31, 100):
        rows = random.normal(size=(count, width)) * sizes
        kept = rows[np.arange(count) % spared > 0] if spared else rows
        quotients = solve_triangular(triangle, kept.T, trans="T").T
        square = np.eye(width)
        division.add_products(square, rows, spared)
        np.testing.assert_allclose(np.triu(square), np.triu(np.eye(width) + quotients.T @ quotients), atol=1e-11)


def test_blocks_of_large_growth_are_narrower(lanes: int) -> None:
    """Of Kahan's matrix the inverse is large, though no column is much longer than its diagonal."""
    width, sine = 16, 0.3
    triangle = np.diag(sine ** np.arange(width)) @ (np.eye(width) - np.triu(np.full((width, width), 0.954), 1))
    rows = np.random.default_rng(1).normal(size=(50, width)) @ triangle
    square = np.zeros((width, width))
    Division(triangle, np.abs(triangle).max(axis=0), WIDEST, 128.0).add_products(square, rows)
    whole = np.triu(square) + np.triu(square, 1).T
    lengths = np.linalg.norm(rows, axis=0)
    errors = (triangle.T @ whole @ triangle - rows.T @ rows) / np.outer(lengths, lengths)
    np.testing.assert_allclose(errors, 0.0, atol=1e-13)


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_a_triangle_that_divides_nothing_is_told(value: float, lanes: int) -> None:
    triangle = np.triu(np.ones((20, 20)))
    triangle[17, 17] = value
    with np.errstate(all="ignore"):
        assert not Division(triangle, np.ones(20), WIDEST, 128.0).is_finite


def test_rows_that_do_not_fit_are_refused(lanes: int) -> None:
    division = Division(np.eye(3), np.ones(3), WIDEST, 128.0)
    with pytest.raises(ValueError, match="C-contiguous"):
        division.add_products(np.zeros((3, 3)), np.zeros((3, 5)).T)
    with pytest.raises(ValueError, match="3 columns"):
        division.add_products(np.zeros((3, 3)), np.zeros((5, 2)))
