"""Exact arithmetic against SymPy and against floating point far from the boundary."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steelyard.feasibility.certificates.rational import (
    exact_number,
    is_definite,
    parse_number,
    written,
    zero_combination_basis,
)

# Drawn from two integers, which takes half the time of `st.fractions`.
fractions = st.builds(Fraction, st.integers(-50_000, 50_000), st.integers(1, 1000))


@given(
    st.integers(1, 5).flatmap(lambda n: st.lists(st.lists(fractions, min_size=n, max_size=n), min_size=n, max_size=n))
)
def test_definiteness_of_gram_matrices(rows):
    """A Aᵀ is semidefinite; less a little on the diagonal it is not, where A is singular."""
    gram = [[sum((a * b for a, b in zip(x, y, strict=True)), Fraction(0)) for y in rows] for x in rows]
    assert is_definite(gram, strict=False)
    larger = [[v + (i == j) for j, v in enumerate(row)] for i, row in enumerate(gram)]
    assert is_definite(larger, strict=True)
    singular = [*rows[:-1], rows[0]]
    gram = [[sum((a * b for a, b in zip(x, y, strict=True)), Fraction(0)) for y in singular] for x in singular]
    if len(rows) > 1:
        assert not is_definite(gram, strict=True)
        smaller = [[v - Fraction(i == j, 10**30) for j, v in enumerate(row)] for i, row in enumerate(gram)]
        assert not is_definite(smaller, strict=False)


@given(
    st.integers(1, 4).flatmap(
        lambda n: st.lists(st.integers(-3, 3), min_size=n * (n + 1) // 2, max_size=n * (n + 1) // 2)
    )
)
def test_definiteness_agrees_with_sympy(upper):
    sympy = pytest.importorskip("sympy", reason="the oracle is SymPy")
    size = round((np.sqrt(8 * len(upper) + 1) - 1) / 2)
    matrix = np.zeros((size, size), dtype=int)
    matrix[np.triu_indices(size)] = upper
    matrix = matrix + np.triu(matrix, 1).T
    exact = [[Fraction(int(value)) for value in row] for row in matrix]
    oracle = sympy.Matrix(matrix.tolist())
    assert is_definite(exact, strict=True) == bool(oracle.is_positive_definite)
    assert is_definite(exact, strict=False) == bool(oracle.is_positive_semidefinite)


def test_asymmetric_matrices_are_not_definite():
    assert not is_definite([[Fraction(1), Fraction(0)], [Fraction(1), Fraction(5)]], strict=False)


@given(fractions)
def test_numbers_survive_being_written(value):
    assert parse_number(written(value)) == value


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_floats_stand_for_what_they_print(value):
    assert float(exact_number(value)) == value
    assert exact_number(value) == parse_number(repr(value).lower())


@pytest.mark.parametrize(
    "text", ["", "nan", "inf", "1e999999", "1/0", "0x10", "1_000", " 1", "1.5.2", "--1", "1/-2", None, 1, 1.5, "٣"]
)
def test_what_is_no_number_is_refused(text):
    with pytest.raises(ValueError, match=r"is not a rational number|divides by zero"):
        parse_number(text)


@given(
    st.lists(st.lists(st.integers(-2, 2), min_size=6, max_size=6), min_size=1, max_size=5),
    st.lists(fractions, min_size=6, max_size=6),
)
def test_null_space_is_exact_and_whole(rows, values):
    sparse = [{j: Fraction(v) for j, v in enumerate(row) if v} for row in rows]
    pivots = zero_combination_basis(sparse, [0, 1, 0, 2, 0, 1])
    assert len(pivots) == np.linalg.matrix_rank(np.array(rows))
    solution = list(values)
    for pivot, row in pivots.items():
        solution[pivot] = sum((c * values[k] for k, c in row.items()), Fraction(0))
        assert not set(row) & set(pivots)
    assert all(sum((c * solution[j] for j, c in enumerate(row)), Fraction(0)) == 0 for row in rows)
