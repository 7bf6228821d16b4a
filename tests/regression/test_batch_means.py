"""Sums of neighbouring rows, over data sets that are reduced one after the other."""

import numpy as np

import steelyard as sy
from steelyard.recording import Samples
from steelyard.regression.batch_means import BATCH_LENGTHS, BatchSums
from steelyard.regression.reduction import JointReduction, empty_factors


def test_factors_are_those_of_sums_in_plain_numpy():
    rng = np.random.default_rng(5)
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")])
    empty = empty_factors(sy.Model(robot.with_terms(sy.Viscous(), sy.Offset())))
    sums, parts = BatchSums(empty), []
    for count in (4096, 1024, 1500):
        mask = rng.random((count, 2)) > 0.3
        mask[200:900, 1] = False  # some batches of the second joint are empty
        drift = np.linspace(0.0, 1.0, count)[:, None]  # neighbouring sums differ little
        rows = [drift + 1e-3 * rng.standard_normal((count, len(one.columns) + 1)) for one in empty]
        for own in rows:
            own[:, 0] = 1.0
        sums.add(rows, mask)
        parts.append([own * mask[:, k, None] for k, own in enumerate(rows)])
    for length, level in zip(BATCH_LENGTHS, sums.factors(), strict=True):
        for k, factor in enumerate(level):
            own = np.concatenate([part[k] for part in parts])
            direct = np.add.reduceat(own, np.arange(0, len(own), length), axis=0)
            assert factor.count == np.count_nonzero(direct.any(axis=1))
            square = direct.T @ direct
            np.testing.assert_allclose(factor.triangle.T @ factor.triangle, square, atol=1e-12 * square.max())


def test_block_sums_of_many_logs_are_those_of_each():
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")])
    model = sy.Model(robot)
    rng = np.random.default_rng(3)
    logs = []
    for count in (700, 5000, 3, 2048, 1, 1500):
        q, dq, ddq, torque = (rng.normal(size=(count, 2)) for _ in range(4))
        logs.append(Samples(q=q, dq=dq, ddq=ddq, torque=torque, mask=rng.random((count, 2)) > 0.1))
    apart = [sy.Information.from_samples(model, samples) for samples in logs]
    expected = apart[0]
    for one in apart[1:]:
        expected = expected + one
    sums = BatchSums(empty_factors(model))
    for samples in logs:
        JointReduction(model, sums).add(samples)
        sums.end()
    found = sums.factors()
    assert len(found) == len(BATCH_LENGTHS)
    for level, other in zip(found, expected.batch_means, strict=True):
        for a, b in zip(level, other, strict=True):
            assert a.count == b.count
            np.testing.assert_allclose(a.triangle.T @ a.triangle, b.triangle.T @ b.triangle, rtol=1e-9, atol=1e-9)
