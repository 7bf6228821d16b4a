"""The matrices U of thesis (3.39), (3.43), (3.52) and (3.57)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steelyard.errors import InputError
from steelyard.lmi import distance_inequality, residual_inequality, to_standard

seeds = st.integers(0, 2**32 - 1)


@given(seed=seeds, count=st.integers(1, 6), off=st.sampled_from([-1e-2, -1e-6, 1e-6, 1e-2]))
def test_distance_is_the_schur_complement(seed, count, off):
    rng = np.random.default_rng(seed)
    target, x = rng.normal(size=(2, count))
    names = [f"beta{i + 1}" for i in range(count)]
    squared = float(np.sum((target - x) ** 2))
    inequality = distance_inequality(target, names)
    values = dict(zip(names, x, strict=True)) | {"u": squared * (1 + off) + off}
    assert inequality.is_positive_definite(values) == (off > 0)


@given(seed=seeds, rows=st.integers(1, 9), count=st.integers(1, 4), off=st.sampled_from([-1e-2, -1e-6, 1e-6, 1e-2]))
def test_residual_is_the_schur_complement(seed, rows, count, off):
    rng = np.random.default_rng(seed)
    W, omega, beta = rng.normal(size=(rows, count)), rng.normal(size=rows), rng.normal(size=count)
    squared = float(np.sum((omega - W @ beta) ** 2))
    inequality = residual_inequality(W, omega, [f"beta{i + 1}" for i in range(count)])
    assert inequality.is_positive_definite([squared * (1 + off) + off, *beta]) == (off > 0)


@given(seed=seeds, off=st.sampled_from([-1e-3, 1e-3]))
def test_reduced_form_says_the_same_as_the_data(seed, off):
    """(3.52) against (3.43), with Q R of W by NumPy."""
    rng = np.random.default_rng(seed)
    W, omega, beta = rng.normal(size=(20, 3)), rng.normal(size=20), rng.normal(size=3)
    Q, R1 = np.linalg.qr(W)
    rho1 = Q.T @ omega
    rho2_squared = float(omega @ omega - rho1 @ rho1)
    names = ["beta1", "beta2", "beta3"]
    whole = residual_inequality(W, omega, names)
    reduced = residual_inequality(R1, rho1, names, constant=rho2_squared)
    values = [float(np.sum((omega - W @ beta) ** 2)) + off, *beta]
    assert whole.size == 21
    assert reduced.size == 4
    assert whole.is_positive_definite(values) == reduced.is_positive_definite(values) == (off > 0)


def test_in_standard_parameters(two_links):
    """(3.58): U(u, K δ)."""
    rng = np.random.default_rng(3)
    R1, rho1, delta = rng.normal(size=(6, 6)), rng.normal(size=6), rng.normal(size=22)
    inequality = to_standard(residual_inequality(R1, rho1, [f"beta{i + 1}" for i in range(6)]), two_links)
    squared = float(np.sum((rho1 - R1 @ two_links.base_parameters().K @ delta) ** 2))
    assert inequality.names == (*two_links.parameter_names, "u")
    assert inequality.is_positive_definite([*delta, squared + 1e-6])
    assert not inequality.is_positive_definite([*delta, squared - 1e-6])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: distance_inequality([1.0, 2.0], ["a"]), r"a matrix of shape \(2, 1\), got \(2, 2\)"),
        (lambda: distance_inequality([1.0], ["u"]), "'u' is named twice"),
        (lambda: distance_inequality([np.nan], ["a"]), "target holds a value that is not finite"),
        (lambda: distance_inequality([["a"]], ["a"]), "target must be numbers"),
        (lambda: residual_inequality(np.ones((2, 2)), np.ones(3), ["a", "b"]), r"shape \(3, 2\), got \(2, 2\)"),
        (lambda: residual_inequality(np.ones(2), np.ones(2), ["a"]), "matrix must have 2 dimensions"),
        (lambda: residual_inequality([[1.0]], [1.0], ["a"], constant=-1.0), "constant must be a number of at least 0"),
        (lambda: residual_inequality(np.ones((20000, 1)), np.ones(20000), ["a"]), "of order 20001, which is too large"),
    ],
)
def test_wrong_numbers_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
