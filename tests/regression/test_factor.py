"""Factors by products are those of Householder's QR, against extended precision, whatever the rows are."""

import itertools

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from simulated_arm import simulated_arm
from threadpoolctl import threadpool_limits

from steelyard.recording import Samples
from steelyard.regression import Information, factor, time_blocks, triangular
from steelyard.regression.factor import eigenvectors, extended
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks

EPS = np.finfo(float).eps
extended_precision = pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="long double is double here")


@pytest.fixture(scope="module", autouse=True)
def _products_of_few_rows():
    """Thresholds so small that matrices of tests take all ways."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {"FEW_NUMBERS": 60, "PIECE": 300, "STEP": 5}.items():
            patch.setattr(factor, name, value)
        patch.setattr(time_blocks, "HELD", 200)
        patch.setattr(factor, "FEWEST_HELD", 100)
        yield


def exact(rows):
    """The factor by modified Gram-Schmidt in extended precision, whose factor is as exact as Householder's."""
    left = rows.astype(np.longdouble)
    result = np.zeros((left.shape[1],) * 2, dtype=np.longdouble)
    for j in range(len(result)):
        result[j, j] = np.sqrt(left[:, j] @ left[:, j])
        left[:, j] /= result[j, j]
        result[j, j + 1 :] = left[:, j] @ left[:, j + 1 :]
        left[:, j + 1 :] -= np.outer(left[:, j], result[j, j + 1 :])
    return result


def gram_error(triangle, rows):
    """The largest error of ``R'R``, relative to the lengths of the columns."""
    wide, whole = triangle.astype(np.longdouble), rows.astype(np.longdouble)
    lengths = np.sqrt(np.sum(whole**2, axis=0))
    lengths[lengths == 0.0] = 1.0
    return float(np.max(np.abs(wide.T @ wide - whole.T @ whole) / np.outer(lengths, lengths), initial=0.0))


def both(rows, cut):
    """The factor of rows at once, and that of some rows extended by the others in two pieces."""
    middle = cut + (len(rows) - cut) // 3
    return triangular(rows), extended(triangular(rows[:cut]), rows[cut:middle], rows[middle:])


@extended_precision
@settings(max_examples=40)
@example(0, 68, 9, 0.0, "z", 1)
@given(
    st.integers(0, 2**16),
    st.integers(1, 1000),
    st.integers(1, 9),
    st.floats(0.0, 12.0),
    st.sampled_from("snz"),
    st.integers(0, 1000),
)
def test_errors_are_those_of_rounding(seed, count, width, decades, kind, cut):
    random = np.random.default_rng(seed)
    rows = random.normal(size=(count, width))
    if kind == "s" and count >= width:  # singular values
        rows = (
            np.linalg.qr(rows)[0]
            * np.logspace(0.0, -decades, width)
            @ np.linalg.qr(random.normal(size=(width,) * 2))[0]
        )
    elif kind == "n":  # neighbours that are nearly alike
        rows[:, 1::2] = rows[:, : rows[:, 1::2].shape[1] * 2 : 2] + 10.0**-decades * rows[:, 1::2]
    elif kind == "z":  # columns without motion, and first rows at rest
        rows[:, random.random(width) < 0.3] = 0.0
        rows[: count // 3] *= 10.0**-decades
    for found in both(rows, min(cut, count)):
        assert np.array_equal(found, np.triu(found))
        assert np.all(np.diagonal(found) >= 0.0)
        assert gram_error(found, rows) < 100 * EPS
        if kind == "s" and count >= width:
            truth = exact(rows)
            lengths = np.sqrt(np.sum(truth**2, axis=0))
            # A factor by the normal equations has errors of the square of the condition number.
            assert np.max(np.abs(found - truth) / lengths) < 100 * EPS * 10.0**decades


@pytest.mark.parametrize("seed", range(3))
def test_scales_of_columns_do_not_matter(seed):
    random = np.random.default_rng(seed)
    rows = random.normal(size=(700, 6))
    scales = 2.0 ** random.integers(-300, 300, size=6)
    for scaled, plain in zip(both(rows * scales, 200), both(rows, 200), strict=True):
        np.testing.assert_array_equal(scaled, plain * scales)


def test_columns_without_motion_stay_zero_and_dependent_ones_are_seen():
    random = np.random.default_rng(1)
    rows = random.normal(size=(900, 6))
    rows[:, 2] = 0.0
    rows[:, 4] = rows[:, 1] - 3.0 * rows[:, 3]
    for found in both(rows, 300):
        assert not found[:, 2].any()
        assert factor.unidentifiable_columns(found).tolist() == [False, True, True, True, True, False]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("row", [0, 5, 350, 699])
def test_what_is_no_number_stays_visible(bad, row):
    rows = np.random.default_rng(2).normal(size=(700, 5))
    rows[row, 3] = bad
    for found in both(rows, 400):
        assert not np.all(np.isfinite(found))


def test_a_joint_that_starts_to_move_late():
    random = np.random.default_rng(3)
    rows = random.normal(size=(800, 7))
    rows[:500, 3:] *= 1e-9
    rows[:500, 5] = 0.0
    for found in both(rows, 450):
        assert gram_error(found, rows) < 30 * EPS


def test_subnormal_and_huge_columns():
    rows = np.random.default_rng(4).normal(size=(400, 4)) * [1e-310, 1e-200, 1.0, 1e150]
    for found in both(rows, 100):
        np.testing.assert_allclose(
            np.abs(found[0, 0]), np.sqrt(np.sum((rows[:, 0] * 2.0**1000) ** 2)) / 2.0**1000, rtol=1e-6
        )
        assert np.all(np.isfinite(found))


def cut(samples, edges):
    ends = [0, *edges, samples.count]
    return [samples.rows(a, b) for a, b in itertools.pairwise(ends)]


def test_threads_and_chunks_do_not_matter():
    rows = np.random.default_rng(5).normal(size=(2500, 8))
    arm = simulated_arm(1, seconds=13.0)
    mask = np.random.default_rng(6).random(arm.samples.q.shape) < 0.8
    samples = Samples(**{k: getattr(arm.samples, k) for k in ("q", "dq", "ddq", "torque")}, mask=mask)
    found = []
    for threads, edges in ((1, []), (2, [1, 100, 1047, 1290]), (3, range(70, samples.count, 70))):
        with threadpool_limits(threads):
            blocks = TimeBlocks(empty_factors(arm.model))
            information = Information.from_chunks(arm.model, cut(samples, edges), blocks=blocks)
            triangles = [f.triangle for level in (information.factors, *information.batch_means) for f in level]
            found.append([triangular(rows), *triangles, *(f.triangle for fold in blocks.folds() for f in fold)])
    for other in found[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(found[0], other, strict=True))


def test_eigenvectors_are_found_where_the_first_method_of_lapack_fails(monkeypatch):
    """It failed on one of 34 000 covariances, finite and well-conditioned; SciPy's other methods did not."""
    truth, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(58, 58)))
    clusters = np.repeat([1.0, 1.3, 1.31, 2.0, 2.0 + 1e-9], [10, 20, 8, 10, 10])
    matrix = (truth * clusters) @ truth.T

    def fails(_):
        raise np.linalg.LinAlgError("Eigenvalues did not converge")

    monkeypatch.setattr(np.linalg, "eigh", fails)
    values, vectors = eigenvectors(matrix)
    np.testing.assert_allclose(values, clusters, rtol=1e-12)
    np.testing.assert_allclose((vectors * values) @ vectors.T, matrix, atol=1e-12)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(58), atol=1e-12)
    matrix[3, 3] = np.nan
    with pytest.raises(np.linalg.LinAlgError):
        eigenvectors(matrix)
