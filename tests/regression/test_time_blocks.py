"""Stretches of data are contiguous, of about equal length, and together the whole, however the data was cut."""

import itertools

import numpy as np
import pytest
from simulated_arm import simulated_arm

from steelyard.recording import Samples
from steelyard.regression import Information
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks

ARM = simulated_arm(1, seconds=30.0)


def cut(samples: Samples, at: list[int]) -> list[Samples]:
    edges = [0, *at, samples.count]
    keys = ("q", "dq", "ddq", "torque", "mask")
    arrays = {key: getattr(samples, key) for key in keys if getattr(samples, key) is not None}
    return [Samples(**{key: v[a:b] for key, v in arrays.items()}) for a, b in itertools.pairwise(edges)]


@pytest.mark.parametrize("count", [1, 63, 64, 65, 320, 1279, 1281, 3000])
def test_stretches_are_the_whole(count: int) -> None:
    part = cut(ARM.samples, [count])[0] if count < ARM.samples.count else ARM.samples
    blocks = TimeBlocks(empty_factors(ARM.model))
    information = Information.from_chunks(ARM.model, [part], blocks=blocks)
    stretches = information.stretches(blocks)
    assert sum(s.count for s in stretches) == information.count == 3 * count
    assert len(stretches) == min(5, -(-count // 64))
    if count >= 320:
        sizes = [s.count for s in stretches]
        assert max(sizes) <= 2 * min(sizes)
    alone = Information.from_samples(ARM.model, part)
    total = stretches[0]
    for stretch in stretches[1:]:
        total = total + stretch
    for ours, theirs in zip(total.factors, alone.factors, strict=True):
        size = np.abs(theirs.triangle).max()
        np.testing.assert_allclose(
            ours.triangle.T @ ours.triangle, theirs.triangle.T @ theirs.triangle, atol=1e-12 * size**2
        )


def test_stretches_are_contiguous() -> None:
    # The sum of the squared torques of the rows of each stretch, from the samples themselves.
    blocks = TimeBlocks(empty_factors(ARM.model))
    information = Information.from_chunks(ARM.model, [ARM.samples], blocks=blocks)
    start = 0
    for stretch in information.stretches(blocks, 3):
        length = stretch.count // 3
        own = ARM.samples.torque[start : start + length]
        np.testing.assert_allclose([f.norm2 for f in stretch.factors], np.sum(own**2, axis=0), rtol=1e-12)
        start += length
    assert start == ARM.samples.count


def test_cuts_and_masks_do_not_matter() -> None:
    random = np.random.default_rng(3)
    mask = random.random(ARM.samples.q.shape) < 0.6
    samples = Samples(q=ARM.samples.q, dq=ARM.samples.dq, ddq=ARM.samples.ddq, torque=ARM.samples.torque, mask=mask)
    found = []
    for at in ([], [1, 100, 101, 2047, 2900], list(range(50, 3000, 50))):
        blocks = TimeBlocks(empty_factors(ARM.model))
        information = Information.from_chunks(ARM.model, cut(samples, at), blocks=blocks)
        found.append([f.triangle for s in information.stretches(blocks) for f in s.factors])
        assert [f.count for f in information.factors] == list(mask.sum(axis=0))
    for other in found[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(found[0], other, strict=True))


@pytest.mark.slow
def test_many_logs_stay_few_blocks() -> None:
    total = TimeBlocks(empty_factors(ARM.model))
    for part in cut(ARM.samples, list(range(30, 3000, 30))):
        own = TimeBlocks(empty_factors(ARM.model), 1)
        Information.from_chunks(ARM.model, [part], blocks=own)
        total.append(own)
    assert len(total._blocks) <= 40
    folds = total.folds()
    assert sum(f.count for fold in folds for f in fold) == 9000
    np.testing.assert_allclose([f.norm2 for f in total.factors()], np.sum(ARM.samples.torque**2, axis=0), rtol=1e-12)


@pytest.mark.parametrize(
    "count", [41, pytest.param(162, marks=pytest.mark.slow), pytest.param(500, marks=pytest.mark.slow)]
)
def test_folds_of_many_short_logs_are_of_about_equal_length(count: int) -> None:
    total = TimeBlocks(empty_factors(ARM.model))
    for first in range(count):
        own = TimeBlocks(empty_factors(ARM.model), 1)
        Information.from_chunks(ARM.model, [ARM.samples.rows(first, first + 5)], blocks=own)
        total.append(own)
    assert 20 <= len(total._blocks) <= 40
    sizes = [sum(factor.count for factor in fold) for fold in total.folds()]
    assert len(sizes) == 5
    assert sum(sizes) == 15 * count
    assert max(sizes) <= 1.5 * min(sizes)
