"""Combinations of neighbouring rows in long data, beside all rows in plain NumPy."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.dynamics import ByJoint, Stribeck
from steelyard.graph.machine import batch_lanes
from steelyard.identification.prediction_verdict import white_noise
from steelyard.regression import neighbor_code, neighbors, reduction
from steelyard.regression.batch_means import BATCH_LENGTHS

RATE, ROWS, EXACT = 1000.0, 45_000, 8192


@pytest.fixture(autouse=True)
def combined_early(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reduction, "EXACT", EXACT)


@pytest.fixture(scope="module")
def model() -> sy.Model:
    robot = sy.Robot.from_dh([("pi/2", 0.0, 0.2, "q"), (0, 0.5, 0, "q")], gravity=(0, 0, -9.81))
    return sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb()))


def motion(model: sy.Model, noise: float, masks: bool, cutoff: float | None = 5.0) -> sy.Samples:
    """Return reversals of both joints, with a jump of friction at each, and a gap in time."""
    random = np.random.default_rng(4)
    t = np.arange(ROWS)[:, None] / RATE
    t[30_017:] += 0.777
    rates = np.array([[1.1, 1.7], [2.3, 3.1], [0.5, 5.3]])
    sizes = np.array([[0.8, 0.5], [0.4, 0.3], [0.5, 0.1]])
    waves = [sizes * rates**k * np.sin(rates * t[:, None] + k * np.pi / 2) for k in range(3)]
    q, dq, ddq = (wave.sum(axis=1) for wave in waves)
    torque = model.inverse_dynamics(q, dq, ddq, truth(model)) + noise * random.standard_normal(q.shape)
    mask = None
    if masks:
        mask = np.abs(dq) > 0.2
        mask[20_000:20_100, 1] = random.random(100) < 0.5
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, mask=mask, cutoff=cutoff)


def truth(model: sy.Model) -> np.ndarray:
    return np.random.default_rng(7).uniform(0.5, 2.0, model.parameter_count)


def all_rows(model: sy.Model, samples: sy.Samples, joint: int) -> np.ndarray:
    base = model.base_parameters()
    W = model.regressor(samples.q, samples.dq, samples.ddq)[:, joint][:, base.independent]
    rows = np.column_stack([W, samples.torque[:, joint]])
    return rows if samples.mask is None else rows[samples.mask[:, joint]]


@pytest.mark.parametrize("masks", [pytest.param(False, marks=pytest.mark.slow), True])
def test_little_is_lost_and_nothing_biased(model: sy.Model, masks: bool) -> None:
    samples, base = motion(model, 0.0, masks), model.base_parameters()
    exact = base.values(truth(model))
    information = sy.Information.from_samples(model, samples)
    # Without noise the parameters come out although friction jumps within the neighbours.
    np.testing.assert_allclose(sy.least_squares(information).base, exact, rtol=1e-9, atol=1e-9)
    noisy = motion(model, 0.5, masks)
    information = sy.Information.from_samples(model, noisy)
    for joint, factor in enumerate(information.factors):
        rows = all_rows(model, noisy, joint)
        assert factor.count == len(rows)
        whole, own = rows[:, [*factor.columns, -1]], factor.triangle
        np.testing.assert_allclose(factor.norm2, rows[:, -1] @ rows[:, -1], rtol=1e-12)
        # Of the information in any direction hardly anything is lost, and none is made up.
        _, values, directions = np.linalg.svd(whole[:, :-1], full_matrices=False)
        shown = values > 1e-9 * values[0]
        shares = np.linalg.svd(own[:, :-1] @ (directions[shown].T / values[shown]), compute_uv=False)
        assert 0.995 < shares.min() <= shares.max() < 1.0 + 1e-12
        beta = np.linalg.lstsq(whole[:, :-1], whole[:, -1])[0]
        full = np.zeros(base.count)
        full[factor.columns] = beta
        assert factor.residual2(full) == pytest.approx(np.sum((whole[:, -1] - whole[:, :-1] @ beta) ** 2), rel=1e-3)


def test_few_rows_are_kept(model: sy.Model) -> None:
    samples = motion(model, 0.5, True)
    widths = [len(columns) for columns in model.base_columns.joints]
    entries = model.base_columns.entries(samples.q, samples.dq, samples.ddq)
    from steelyard.regression.neighbors import NeighborCombinations, RegressorSource

    combinations = NeighborCombinations(widths, np.mean(entries**2, axis=0))
    part = slice(0, 40_960)
    found = combinations.combined(RegressorSource(lambda rows: entries[rows]), samples.torque[part], samples.mask[part])
    for joint, one in enumerate(found):
        assert one.count == samples.mask[part, joint].sum()
        assert len(one.rows) < 0.15 * one.count
        used = samples.mask[part, joint, None] * samples.torque[part, joint, None]
        np.testing.assert_allclose(one.sums[:, -1], used.reshape(-1, 64).sum(axis=1), atol=1e-9)


@pytest.mark.parametrize("cutoff", [None, 20.0])
@pytest.mark.parametrize("noise", [0.02, pytest.param(0.5, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("speed", "terms"),
    [
        (1.0, [sy.Viscous()]),
        pytest.param(2.3, [sy.Viscous()], marks=pytest.mark.slow),
        (2.3, [sy.Viscous(), sy.Coulomb()]),
    ],
)
def test_what_is_lost_of_a_fast_motion_is_no_noise(
    speed: float, terms: list[sy.Viscous | sy.Coulomb], noise: float, cutoff: float | None
) -> None:
    """At 3.6 Hz four polynomials leave a thousandth of some columns, beside which little noise is less.

    At 8.3 Hz they leave of the torques what is no noise either, and friction jumps in most of the neighbours.
    """
    robot = sy.Robot.from_dh([("pi/2", 0.0, 0.2, "q"), (0, 0.5, 0, "q")], gravity=(0, 0, -9.81))
    model = sy.Model(robot.with_terms(*terms))
    t, rates = np.arange(ROWS)[:, None] / RATE, speed * 2.0 * np.pi * np.array([[2.9, 3.6], [0.31, 0.23]])
    waves = [[0.3, 0.8] @ (rates**k * np.sin(rates * t[:, None] + k * np.pi / 2)) for k in range(3)]
    torque = model.inverse_dynamics(*waves, truth(model)) + noise * np.random.default_rng(3).standard_normal((ROWS, 2))
    samples = sy.Samples(*waves, torque, cutoff=cutoff)
    for joint, factor in enumerate(sy.Information.from_samples(model, samples).factors):
        rows = all_rows(model, samples, joint)[:, [*factor.columns, -1]]
        best, squares = np.linalg.lstsq(rows[:, :-1], rows[:, -1])[:2]
        beta = np.zeros(model.base_parameters().count)
        beta[factor.columns] = best
        left = squares[0] if len(squares) else np.sum((rows[:, -1] - rows[:, :-1] @ best) ** 2)
        assert factor.residual2(beta) == pytest.approx(left, rel=0.02)


def test_columns_that_may_jump_are_known() -> None:
    robot = sy.Robot.from_dh([("pi/2", 0.0, 0.2, "q"), (0, 0.5, 0, "q")], gravity=(0, 0, -9.81))
    model = sy.Model(robot.with_terms(sy.Viscous(), ByJoint([Stribeck(velocity=0.1, joints=[1]), sy.Coulomb()])))
    columns, base = model.base_columns, model.base_parameters()
    names = np.concatenate([np.array(base.names)[own] for own in columns.joints])
    assert sorted(names[columns.uneven]) == ["Fcj1", "Fcj2", "Fsj1"]
    q, dq, ddq = np.random.default_rng(2).standard_normal((3, 50, 2))
    uneven = columns.uneven_kernel(q, dq, ddq)
    np.testing.assert_array_equal(uneven, columns.entries(q, dq, ddq)[:, columns.uneven])
    still = sy.Model(robot).base_columns
    assert still.uneven.size == 0
    assert still.uneven_kernel(q, dq, ddq).shape == (50, 0)


@pytest.mark.parametrize("masks", [False, True])
def test_few_places_tell_all_rows(model: sy.Model, masks: bool) -> None:
    filtered, as_given = (motion(model, 0.5, masks, cutoff) for cutoff in (5.0, None))
    found, expected = (sy.Information.from_samples(model, one) for one in (filtered, as_given))
    for a, b in zip((found.factors, *found.batch_means), (expected.factors, *expected.batch_means), strict=True):
        for x, y in zip(a, b, strict=True):
            assert x.count == y.count
            lengths = np.linalg.norm(y.triangle, axis=0)
            lengths = np.maximum(lengths, 1e-9 * lengths.max())  # rounding errors are no column
            errors = x.triangle.T @ x.triangle - y.triangle.T @ y.triangle
            np.testing.assert_allclose(errors / np.outer(lengths, lengths), 0.0, atol=1e-9)


@pytest.mark.parametrize("cutoff", [None, 5.0])
def test_rough_rows_are_all_kept(model: sy.Model, cutoff: float | None) -> None:
    q, dq, ddq, torque = np.random.default_rng(1).standard_normal((4, 20_000, 2))
    samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, cutoff=cutoff)
    for joint, factor in enumerate(sy.Information.from_samples(model, samples).factors):
        rows = all_rows(model, samples, joint)[:, [*factor.columns, -1]]
        found, square = factor.triangle, rows.T @ rows
        np.testing.assert_allclose(found.T @ found, square, atol=1e-11 * np.abs(square).max())


def test_batches_that_are_long_enough_are_those_of_all_rows(model: sy.Model) -> None:
    samples = motion(model, 0.5, True)
    information = sy.Information.from_samples(model, samples)
    for joint, factor in enumerate(information.factors):
        W = model.regressor(samples.q, samples.dq, samples.ddq)[:, joint][:, model.base_parameters().independent]
        rows = np.column_stack([W, samples.torque[:, joint]])[:, [*factor.columns, -1]] * samples.mask[:, joint, None]
        for length, level in zip(BATCH_LENGTHS, information.batch_means, strict=True):
            if length >= 64:
                sums = np.add.reduceat(rows, np.arange(0, ROWS, length), axis=0)
                found = level[joint].triangle
                assert found[:, -1] @ found[:, -1] == pytest.approx(sums[:, -1] @ sums[:, -1], rel=1e-9)
                np.testing.assert_allclose(found.T @ found, sums.T @ sums, atol=1e-9 * np.abs(sums.T @ sums).max())


@pytest.mark.parametrize("cutoff", [pytest.param(None, marks=pytest.mark.slow), 5.0])
def test_registers_of_other_processors(model: sy.Model, monkeypatch: pytest.MonkeyPatch, cutoff: float | None) -> None:
    samples = motion(model, 0.5, True, cutoff)
    expected = sy.Information.from_samples(model, samples)
    lanes = 12 - batch_lanes()  # 8 or 4, in parts where they are wider than this processor's
    for module in (neighbors, neighbor_code):
        monkeypatch.setattr(module, "batch_lanes", lambda: lanes)
    monkeypatch.setattr(neighbors, "compiled", neighbor_code.compiled.__wrapped__)
    found = sy.Information.from_samples(model, samples)
    for x, y in zip(found.factors, expected.factors, strict=True):
        assert x.count == y.count
        np.testing.assert_allclose(x.triangle, y.triangle, atol=1e-11 * np.abs(y.triangle).max())


def test_chunks_change_no_bit(model: sy.Model) -> None:
    samples = motion(model, 0.5, True)
    whole = sy.Information.from_samples(model, samples)
    cut = sy.Information.from_chunks(model, (samples.rows(k, k + 4999) for k in range(0, ROWS, 4999)))
    for a, b in zip((whole.factors, *whole.batch_means), (cut.factors, *cut.batch_means), strict=True):
        assert all(x.count == y.count and np.array_equal(x.triangle, y.triangle) for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize("masks", [False, True])
def test_white_noise_is_told_from_errors_that_last(model: sy.Model, masks: bool) -> None:
    samples, size = motion(model, 0.5, masks), 0.4
    lasting = size * np.sqrt(2.0) * np.sin(0.01 * np.arange(ROWS))[:, None]
    base = model.base_parameters().values(truth(model))
    for error in (0.0, lasting):
        given = sy.Samples(samples.q, samples.dq, samples.ddq, samples.torque + error, samples.mask)
        floor, white = white_noise(sy.Information.from_samples(model, given), base)
        np.testing.assert_allclose(floor, 0.5, rtol=0.04)
        np.testing.assert_allclose(white, 1.0 if np.isscalar(error) else 0.5**2 / (0.5**2 + size**2), atol=0.04)
