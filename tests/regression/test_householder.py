"""The triangular factor by LAPACK beside that of NumPy and SciPy."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import scipy.linalg

from steelyard.regression.householder import householder


@pytest.mark.parametrize("shape", [(1, 1), (2, 5), (7, 7), (40, 3), (2048, 45)])
def test_it_is_the_factor_of_numpy_with_a_positive_diagonal(shape):
    rows = np.random.default_rng(1).normal(size=shape) * 10.0 ** np.arange(shape[1])
    expected = np.zeros((shape[1], shape[1]))
    factor = np.linalg.qr(rows, mode="r")
    expected[: len(factor)] = factor * np.where(np.diagonal(factor) < 0.0, -1.0, 1.0)[:, None]
    found = householder(rows)
    np.testing.assert_allclose(found / 10.0 ** np.arange(shape[1]), expected / 10.0 ** np.arange(shape[1]), atol=1e-11)
    assert np.all(np.tril(found, -1) == 0.0)
    assert np.all(np.diagonal(found) >= 0.0)


def test_pieces_count_together_in_any_layout():
    rows = np.random.default_rng(2).normal(size=(300, 9))
    whole = scipy.linalg.qr(rows, mode="r")[0][:9]
    found = householder(rows[:1], np.asfortranarray(rows[1:200]), rows[200:200], rows[::-1][99::-1])
    np.testing.assert_allclose(found, np.sign(np.diagonal(whole))[:, None] * whole, rtol=0.0, atol=1e-12)
    assert not householder(np.zeros((0, 4))).any()


def test_threads_have_memory_of_their_own():
    sets = [np.random.default_rng(k).normal(size=(500 + k, 20)) for k in range(16)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(householder, sets))
    for own, rows in zip(found, sets, strict=True):
        assert np.array_equal(own, householder(rows))
