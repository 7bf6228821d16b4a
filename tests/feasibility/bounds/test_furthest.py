"""Ends of regions in many directions at once, against closed forms."""

import numpy as np
import pytest

from steelyard.feasibility.bounds import furthest_code
from steelyard.feasibility.bounds.furthest import Region, furthest

SHAPES = [(2, 3), pytest.param(3, 6, marks=pytest.mark.slow), (4, 10), (7, 28)]


def corner(size: int) -> np.ndarray:
    """Coefficients of the elements of a symmetric matrix, (k, size, size)."""
    found = []
    for row in range(size):
        for column in range(row, size):
            one = np.zeros((size, size))
            one[row, column] = one[column, row] = 1.0
            found.append(one)
    return np.array(found)


@pytest.mark.parametrize(("size", "count"), SHAPES)
def test_ends_of_a_spectrahedron_are_eigenvalues(size: int, count: int) -> None:
    """Of X positive semidefinite with trace at most one, the largest ⟨C, X⟩ is the largest eigenvalue of C, or zero."""
    coefficients = corner(size)
    at = np.eye(size) / (size + 1.0)
    trace = -np.einsum("kii->k", coefficients)[None]
    groups = [(np.arange(count)[None], coefficients[None], at[None])]
    region = Region(trace, 1.0 - np.trace(at)[None], groups, np.eye(count), np.zeros(count), 100.0)
    random = np.random.default_rng(size)
    chosen = random.normal(size=(100, size, size))
    chosen = chosen + chosen.swapaxes(1, 2)
    rows = np.einsum("pij,kij->pk", chosen, coefficients)
    reached = np.einsum("pk,pk->p", rows, furthest(region, rows)) + np.einsum("pij,ij->p", chosen, at)
    expected = np.maximum(np.linalg.eigvalsh(chosen)[:, -1], 0.0)
    way = expected - np.einsum("pij,ij->p", chosen, at)
    assert np.all(np.abs(reached - expected) <= 0.02 * way + 1e-12)


def test_ends_of_a_ball_and_a_side_of_no_width() -> None:
    """The third coordinate is held between two lines a millionth apart, the fourth by nothing that a row asks for."""
    lines = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 0.0]])
    middle = np.array([0.5, 0.0, 0.0, 0.0])
    region = Region(lines, np.full(2, 5e-7), [], np.eye(4), middle, 2.0)
    rows = np.array([[1.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 3.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    reached = np.einsum("pk,pk->p", rows, furthest(region, np.vstack([rows, np.zeros(4)])[:4]))
    np.testing.assert_allclose(reached, [1.5, 2.5, 6.0, 5e-7], rtol=0.02)


@pytest.mark.slow
def test_code_that_the_cache_has_is_not_written_anew(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("STEELYARD_CACHE_DIR", str(tmp_path))
    write = furthest_code._Method.write
    written = []

    def counted(method: furthest_code._Method) -> None:
        written.append(method.sizes)
        write(method)

    monkeypatch.setattr(furthest_code._Method, "write", counted)
    compiled = furthest_code.compiled.__wrapped__
    compiled(())
    compiled(())
    assert written == [()]
    (kept,) = tmp_path.iterdir()
    kept.write_bytes(kept.read_bytes()[:-1])  # damaged
    compiled(())
    assert written == [(), ()]
    monkeypatch.setattr(furthest_code, "source_digest", lambda *_: "other sources")
    compiled(())
    assert written == [(), (), ()]
