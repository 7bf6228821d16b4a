"""What returns with each period of a motion widens intervals to those of one period; noise that does not, does not."""

from dataclasses import replace

import numpy as np
import pytest
from two_joint_arm import LINKS, two_joint_model

import steelyard as sy
from steelyard.regression import ParameterCovariance
from steelyard.regression.reduction import residuals
from steelyard.regression.repeated_motion import MotionSums

PERIOD, RATE = 1000, 100.0  # rows, Hz


@pytest.fixture(scope="module")
def model():
    return two_joint_model()


@pytest.fixture(scope="module")
def truth(model):
    values = np.full(model.parameter_count, 0.5)
    for columns, link in zip(model.link_columns, LINKS, strict=True):
        values[columns] = link
    return values


def samples_of(model, truth, periods, returning, seed=1, turns=(1.0, 3.0, 5.0), ramp=False, white=0.1):
    """Periods of a motion with noise of 0.1 N·m, of which a part returns in each period."""
    random = np.random.default_rng(seed)
    t = np.arange(periods * PERIOD) / RATE
    w = 2.0 * np.pi * RATE / PERIOD * np.array(turns)
    a, b = random.normal(size=(2, 2, len(turns)))
    phase = t[:, None, None] * w
    q = np.sum(a * np.sin(phase) + b * np.cos(phase), axis=2)
    dq = np.sum(w * (a * np.cos(phase) - b * np.sin(phase)), axis=2)
    ddq = -np.sum(w**2 * (a * np.sin(phase) + b * np.cos(phase)), axis=2)
    if ramp:  # joints that are elsewhere at first
        q[:100] += 0.5
    noise = white * (1.0 - returning) ** 0.5 * random.normal(size=q.shape)
    noise += white * returning**0.5 * np.tile(random.normal(size=(PERIOD, 2)), (periods, 1))
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=model.inverse_dynamics(q, dq, ddq, truth) + noise, t=t)


def reduced(model, *chunks):
    return sy.Information.from_chunks(model, chunks, motion=MotionSums())


def errors_of(information):
    return ParameterCovariance.of(information).standard_error


@pytest.mark.parametrize("ramp", [False, True])
def test_four_periods_of_the_same_noise_tell_as_much_as_one(model, truth, ramp):
    samples = samples_of(model, truth, 4, 1.0, ramp=ramp)
    info = reduced(model, samples)
    [found] = info.returning
    assert found.period == pytest.approx(PERIOD / RATE)
    assert found.correlation == pytest.approx([1.0, 1.0], abs=0.01)
    assert found.periods == pytest.approx(4.0)
    one = reduced(model, samples.rows(PERIOD, 2 * PERIOD))
    assert one.returning == ()
    # Each long-run variance is estimated from its own batches, and that of fewer is widened for it.
    assert errors_of(info) == pytest.approx(errors_of(one), rel=0.35)
    plain = replace(info, returning=())
    assert np.median(errors_of(plain) / errors_of(one)) < 0.6
    together, alone = ParameterCovariance.of(info), ParameterCovariance.of(plain)
    assert together.degrees_of_freedom == pytest.approx(alone.degrees_of_freedom / 4.0, rel=0.1)


def test_sums_of_days_count_the_periods_of_all_of_them(model, truth, tmp_path):
    """Two days of two periods are four, also where each was reduced by itself; two motions are independent."""
    whole, other = samples_of(model, truth, 4, 1.0), samples_of(model, truth, 4, 1.0, seed=2)
    first, second = (reduced(model, whole.rows(k * PERIOD, (k + 2) * PERIOD)) for k in (0, 2))
    first.save(tmp_path / "first.json")
    both = sy.Information.load(tmp_path / "first.json") + second
    assert both.returns == pytest.approx(reduced(model, whole).returns, rel=0.02)
    assert both.returns == pytest.approx([4.0, 4.0], rel=0.05)
    mixed = both + reduced(model, other)
    assert len(mixed.returning) == 2
    assert mixed.returns == pytest.approx([4.0, 4.0], rel=0.05)  # half of the rows with three more periods, twice


@pytest.mark.parametrize("exact", [None, 8192])
def test_a_long_log_is_summed_up_to_know_its_period(exact, model, truth):
    """At 1 kHz its first minutes are kept as sums, also where neighbouring rows are combined; all periods count."""
    t = np.arange(200_000) / 1000.0
    slow = samples_of(model, truth, 1, 1.0)
    parts = {
        name: np.tile(np.stack([np.interp(t[:10_000], slow.t, column) for column in one.T], axis=1), (20, 1))
        for name, one in (("q", slow.q), ("dq", slow.dq), ("ddq", slow.ddq), ("torque", slow.torque))
    }
    whole = sy.Samples(**parts, t=t)
    chunks = (whole.rows(k, k + 50_000) for k in range(0, 200_000, 50_000))
    info = sy.Information.from_chunks(model, chunks, motion=MotionSums(), exact=exact)
    [found] = info.returning
    assert found.correlation == pytest.approx([1.0, 1.0], abs=0.05)
    assert found.counts.tolist() == [200_000, 200_000]
    assert found.period == pytest.approx(10.0, rel=1e-3)
    assert found.periods == pytest.approx(20.0, rel=1e-3)


def test_combined_rows_tell_what_single_ones_do(model, truth):
    """Of 30 periods of ten seconds at 100 Hz all but eight are known by sums over 0.64 s, so that these eight count."""
    samples = samples_of(model, truth, 30, 0.7)
    one, other = (
        sy.Information.from_chunks(model, [samples], motion=MotionSums(), exact=exact) for exact in (None, 8192)
    )
    assert one.returning[0].correlation == pytest.approx([0.7, 0.7], abs=0.05)
    assert other.returning[0].correlation == pytest.approx([0.7, 0.7], abs=0.05)
    assert other.returning[0].period == pytest.approx(10.0, rel=1e-3)
    assert other.returns == pytest.approx(one.returns, rel=0.1)


def test_a_motion_that_does_not_repeat_tells_no_more_in_four_logs(model, truth):
    one = samples_of(model, truth, 1, 1.0, turns=(0.93, 3.14, 5.37))
    single = reduced(model, one)
    info = sy.Information.total([single] * 4)
    ((_, left),) = residuals(model, one, sy.least_squares(info).base)
    found = info.with_returning([(one, left)] * 4)
    assert found.returning[0].correlation == pytest.approx([1.0, 1.0], abs=0.01)
    assert errors_of(found) == pytest.approx(errors_of(single), rel=0.35)
    other = samples_of(model, truth, 1, 1.0, seed=2, turns=(0.93, 3.14, 5.37))
    assert info.with_returning([(one, left), (other, left)]).returning == ()


@pytest.mark.slow
def test_the_spread_of_many_logs_is_what_is_said(model, truth):
    true = model.base_parameters().values(truth)
    ratios = []
    for seed in range(40):
        info = reduced(model, samples_of(model, truth, 3, 0.6, seed=seed))
        off = sy.least_squares(info).base - true
        ratios.append((off / errors_of(replace(info, returning=())), off / errors_of(info)))
    before, after = np.mean(np.array(ratios) ** 2, axis=(0, 2))
    # Of three periods with a correlation of 0.6 the variance is 2.2 times as large; Student's width takes some of it.
    assert before > 1.6
    assert 0.7 < after < 1.15


@pytest.mark.parametrize(
    ("returning", "turns"),
    [(0.0, (1.0, 3.0, 5.0)), (1.0, (0.93, 3.14, 5.37))],
    ids=["noise that does not return", "a motion that does not"],
)
def test_nothing_is_told_without_repetition(model, truth, returning, turns):
    for seed in range(5):
        assert reduced(model, samples_of(model, truth, 3, returning, seed, turns)).returning == ()


def test_the_answer_says_so(model, truth):
    rows = {}
    for returning in (0.0, 0.9):
        samples = samples_of(model, truth, 3, returning)
        table = sy.identify(model, samples).parameters
        assert any("repeats every 10 s" in sentence for sentence in table.sentences) is bool(returning)
        rows[returning] = table["Fvj2"].upper - table["Fvj2"].lower
    assert rows[0.9] > 1.3 * rows[0.0]


def test_what_is_saved_to_compare_robots_knows_it(model, truth):
    samples = samples_of(model, truth, 4, 1.0)
    four, one = (sy.identify(model, some).estimate for some in (samples, samples.rows(PERIOD, 2 * PERIOD)))
    assert four.standard_error == pytest.approx(one.standard_error, rel=0.35)
    np.testing.assert_allclose(np.sqrt(np.diag(four.covariance)), four.standard_error, rtol=1e-9)
