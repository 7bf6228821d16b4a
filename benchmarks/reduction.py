"""The reduction of 262500 rows of 76 columns to the triangular factor: time beside the Gram matrix, errors beside QR.

Times are processor times of one thread, and elapsed times with all threads; errors are against the factor in extended
precision. ``python benchmarks/reduction.py``
"""

import time
from dataclasses import replace
from functools import partial

import numpy as np
from threadpoolctl import threadpool_info, threadpool_limits

from steelyard.identification.wam import simulated_log, wam_model
from steelyard.regression.batch_means import BatchSums
from steelyard.regression.factor import extended, triangular
from steelyard.regression.reduction import JointReduction, empty_factors, joint_rows

ROWS, COLUMNS = 262500, 76
ROUNDS = 7


def gram_matrix(rows):
    return rows.T @ rows


def in_blocks(rows, size=2048):
    """Householder's QR of a running factor and of each block of rows: what stood here before."""
    factor = np.zeros((0, rows.shape[1]))
    for start in range(0, len(rows), size):
        factor = np.linalg.qr(np.vstack([factor, rows[start : start + size]]), mode="r")
    return factor


def streamed(rows, size=8192):
    """The running factor extended by blocks of rows, as where a log is read in chunks."""
    factor = triangular(rows[:size])
    for start in range(size, len(rows), size):
        factor = extended(factor, rows[start : start + size])
    return factor


def matrix(condition, columns=COLUMNS, seed=1):
    """Rows with singular values down to 1 / condition, the last column a combination of the others and noise."""
    random = np.random.default_rng(seed)
    left = np.linalg.qr(random.normal(size=(ROWS, columns)))[0]
    right = np.linalg.qr(random.normal(size=(columns, columns)))[0]
    rows = (left * np.logspace(0.0, -np.log10(condition), columns)) @ right.T
    rows[:, -1] = rows[:, :-1] @ random.normal(size=columns - 1) + 1e-4 * random.normal(size=ROWS) / np.sqrt(ROWS)
    return rows


def least(first, second, clock):
    """The least times of two functions that are called in turn."""
    times = np.full(2, np.inf)
    for _ in range(ROUNDS):
        for place, function in enumerate((first, second)):
            start = clock()
            function()
            times[place] = min(times[place], clock() - start)
    return times


def exact(rows):
    """The factor in extended precision: two passes of Cholesky QR, the first by LAPACK."""
    first = in_blocks(rows).astype(np.longdouble)
    width = len(first)
    inverse = np.zeros_like(first)
    for k in range(width):  # back substitution
        inverse[k, k] = 1 / first[k, k]
        inverse[:k, k] = -inverse[:k, :k] @ first[:k, k] * inverse[k, k]
    square = np.zeros_like(first)
    for start in range(0, len(rows), 4096):
        some = rows[start : start + 4096].astype(np.longdouble) @ inverse
        square += some.T @ some
    root = np.zeros_like(square)
    for k in range(width):
        root[k, k] = np.sqrt(square[k, k] - root[:k, k] @ root[:k, k])
        root[k, k + 1 :] = (square[k, k + 1 :] - root[:k, k] @ root[:k, k + 1 :]) / root[k, k]
    result = root @ first
    return result * np.sign(np.diagonal(result))[:, None]


def solution(factor):
    """The least-squares solution for the last column, by back substitution."""
    count = len(factor) - 1
    found = factor[:count, count].astype(np.longdouble)
    for k in range(count - 1, -1, -1):
        found[k] = (found[k] - factor[k, k + 1 : count].astype(np.longdouble) @ found[k + 1 :]) / factor[k, k]
    return found


def errors(factor, truth):
    """Of the Gram matrix, relative to lengths of columns, and of the least-squares solution, relative."""
    lengths = np.sqrt(np.sum(truth**2, axis=0))
    wide = factor.astype(np.longdouble)
    gram = np.max(np.abs(wide.T @ wide - truth.T @ truth) / np.outer(lengths, lengths))
    right = solution(truth)
    return float(gram), float(
        np.linalg.norm((solution(factor) - right).astype(float)) / np.linalg.norm(right.astype(float))
    )


def dense():
    threads = max(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")
    print(f"{ROWS} x {COLUMNS}; time over that of A.T @ A, one thread (processor time)")
    print("condition   triangular  extended  QR in blocks |  errors of R'R (solution): triangular, extended, QR")
    for condition in (1e0, 1e3, 1e7, 1e12):
        rows = matrix(condition)
        with threadpool_limits(1):
            ratios = []
            for function in (triangular, streamed):
                gram, own = least(partial(gram_matrix, rows), partial(function, rows), time.process_time)
                ratios.append(own / gram)
            start = time.process_time()
            in_blocks(rows)
            ratios.append((time.process_time() - start) / gram)
        rows = rows[:: ROWS // 40000]  # extended precision is slow
        truth = exact(rows)
        found = [errors(one, truth) for one in (triangular(rows), streamed(rows), np.linalg.qr(rows, mode="r"))]
        print(
            f"{condition:9.0e} {ratios[0]:10.2f} {ratios[1]:10.2f} {ratios[2]:10.2f}    |                            "
            + "   ".join(f"{gram:.1e} ({answer:.1e})" for gram, answer in found)
        )
    rows = matrix(1e3)
    gram, own = least(lambda: rows.T @ rows, lambda: triangular(rows), time.perf_counter)
    print(f"{threads} threads, elapsed: A.T @ A {gram:.3f} s, triangular {own:.3f} s, ratio {own / gram:.2f}")


def of_a_robot():
    """The rows of the WAM's 37500 samples joint by joint, without their zeros, as an identification reduces them."""
    model = wam_model()
    samples = simulated_log(model, "A", seed=1).process(cutoff=4.8)
    entries = model.base_columns.entries(samples.q, samples.dq, samples.ddq)
    samples = replace(samples, regressor=entries, regressor_model=model)
    rows = np.zeros((model.dof * samples.count, model.base_parameters().count + 1))
    for part, of_joints in joint_rows(model, samples):
        for k, (own, columns) in enumerate(zip(of_joints, model.base_columns.joints, strict=True)):
            rows[k * samples.count + part.start : k * samples.count + part.stop, [*columns, -1]] = own

    def reduce(sums=None):
        reduction = JointReduction(model, sums)
        reduction.add(samples)
        return reduction.factors()

    print(f"\nthe WAM: {rows.shape[0]} x {rows.shape[1]}; time over that of A.T @ A")
    with threadpool_limits(1):
        gram, own = least(lambda: rows.T @ rows, reduce, time.process_time)
        _, full = least(lambda: None, lambda: reduce(BatchSums(empty_factors(model))), time.process_time)
    print(f"joint by joint {own / gram:.2f}, with the sums over batches {full / gram:.2f} (one thread, processor time)")
    gram, own = least(lambda: rows.T @ rows, lambda: reduce(BatchSums(empty_factors(model))), time.perf_counter)
    print(f"with the sums over batches {own / gram:.2f} (all threads, elapsed: {own:.3f} s)")


if __name__ == "__main__":
    dense()
    of_a_robot()
