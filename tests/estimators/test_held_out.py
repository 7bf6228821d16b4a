"""Stretches that are left out, without what no other data shows, beside least squares of all rows by SciPy."""

import numpy as np
import pytest
import scipy.linalg

import steelyard as sy
from steelyard.estimators.cross_validation import HeldOutRows
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks


@pytest.fixture(scope="module")
def arm() -> sy.Model:
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")])
    return sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))


def parts_of(model: sy.Model, samples: sy.Samples) -> tuple[sy.Information, tuple[sy.Information, ...]]:
    blocks = TimeBlocks(empty_factors(model))
    info = sy.Information.from_chunks(model, [samples], blocks=blocks)
    return info, info.stretches(blocks)


def motion(seed: int, first_alone: bool) -> sy.Samples:
    """Ten seconds of both joints, in the last fifth of which alone the second moves where `first_alone`."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, 10.0, 0.005)
    w = 2.0 * np.pi * np.array([[0.5, 1.1], [0.7, 0.9]])
    phase = random.uniform(0.0, 6.0, (2, 2))
    q, dq, ddq = (
        sum(w[i] ** n / w[i] * np.sin(w[i] * t[:, None] + phase[i] + n * np.pi / 2) for i in range(2)) for n in range(3)
    )
    if first_alone:
        for values, at_rest in ((q, 0.3), (dq, 0.0), (ddq, 0.0)):
            values[t < 8.0, 1] = at_rest
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=random.normal(size=q.shape) + 5.0 * np.sign(dq), t=t)


@pytest.mark.parametrize("first_alone", [False, True])
def test_squares_are_those_of_rows_whose_own_directions_are_free(arm, first_alone):
    samples = motion(1, first_alone)
    info, parts = parts_of(arm, samples)
    weights = np.array([0.7, 3.0])
    told = HeldOutRows.of(info, parts, weights)
    assert [rows.free.shape[1] > 0 for rows in told] == [False] * 4 + [first_alone]
    base = np.random.default_rng(2).normal(size=(2, info.base_count))
    W = arm.regressor(samples.q, samples.dq, samples.ddq) @ arm.base_parameters().Pb
    left = samples.torque[None] - np.einsum("sjb,kb->ksj", W, base)
    starts = np.cumsum([0, *(part.count // 2 for part in parts)])
    for rows, start, stop in zip(told, starts, starts[1:], strict=False):
        weighted = (weights[None, :, None] * W[start:stop]).reshape(-1, info.base_count)
        own = (weights * left[:, start:stop]).reshape(2, -1)
        others = np.concatenate([W[:start], W[stop:]]) * weights[:, None]
        others = others.reshape(-1, info.base_count)
        # What the others show of each direction, as a part of what all rows show of it.
        everything = others.T @ others + weighted.T @ weighted
        shown, directions = scipy.linalg.eigh(others.T @ others, everything)
        hidden = directions[:, shown < 1e-3]
        free = weighted @ hidden
        if free.shape[1]:
            own = own - (free @ np.linalg.lstsq(free, own.T, rcond=None)[0]).T
        expected = np.sum(own**2, axis=1)
        found = rows.squares(base)
        assert found @ weights**2 == pytest.approx(expected, rel=1e-6)
        if not first_alone:
            assert found == pytest.approx(np.sum(left[:, start:stop] ** 2, axis=1), rel=1e-9)


def test_where_all_is_shown_nothing_is_free(arm):
    samples = motion(3, False)
    info, parts = parts_of(arm, samples)
    for rows in HeldOutRows.of(info, parts, np.ones(2)):
        assert rows.free.shape[1] == 0
        single = np.array([[factor.residual2(np.ones(info.base_count)) for factor in rows.factors]])
        assert rows.squares(np.ones((1, info.base_count))) == pytest.approx(single)
