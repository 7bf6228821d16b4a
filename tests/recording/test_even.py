"""Rows on an even clock: what a log with jitter, gaps or wrong stamps becomes without a word from the user."""

from pathlib import Path

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.recording import Processing, Recording, Samples, clock_statistics, process_chunks

PERIOD, COUNT, BEGIN = 1e-3, 12_000, 1_700_000_000.0


def motion(t: np.ndarray) -> np.ndarray:
    t = np.asarray(t)[..., None]
    return np.sin(np.array([2.0, 3.1]) * t) + 0.3 * np.cos(np.array([7.0, 5.0]) * t)


def acceleration(t: np.ndarray) -> np.ndarray:
    t = np.asarray(t)[..., None]
    w, v = np.array([2.0, 3.1]), np.array([7.0, 5.0])
    return -(w**2) * np.sin(w * t) - 0.3 * v**2 * np.cos(v * t)


def missing_rows(count: int = 601) -> np.ndarray:
    """So many rows of the log, most of them one by one, the others up to four together."""
    random = np.random.default_rng(4)
    gone: set[int] = set()
    while len(gone) < count:
        row = int(random.integers(20, COUNT - 20))
        gone.update(range(row, row + (1 if random.random() < 0.8 else int(random.integers(2, 5)))))
    return np.array(sorted(gone)[:count])


def late(bursts: int = 40) -> np.ndarray:
    """Seconds by which a computer that is busy stamps rows too late: 50 to 300 us, and some rows several at a time."""
    random = np.random.default_rng(5)
    delay = random.uniform(50e-6, 300e-6, COUNT)
    for row in random.integers(100, COUNT - 100, bursts):
        length = int(random.integers(2, 6))
        delay[row : row + length] = np.maximum(delay[row : row + length], (length - np.arange(length)) * PERIOD)
    even = np.arange(COUNT) * PERIOD
    return np.maximum.accumulate(even + delay - 2e-5 * np.arange(COUNT)) + 2e-5 * np.arange(COUNT) - even


def recording(kind: str) -> Recording:
    """A log of one kind, with encoder noise of 1e-5 rad; its true times are `taken` of `truth`."""
    random = np.random.default_rng(6)
    even = np.arange(COUNT) * PERIOD
    kept = np.setdiff1d(np.arange(COUNT), missing_rows()) if "gaps" in kind else np.arange(COUNT)
    if "late" in kind:
        taken, stamps = even, even + late()
    elif "uneven" in kind:
        taken = stamps = even + random.uniform(-0.3, 0.3, COUNT) * PERIOD
    elif "wandering" in kind:
        taken = stamps = np.cumsum(PERIOD * (1.0 + random.uniform(-0.4, 0.4, COUNT)))
    else:
        taken = stamps = even
    q = motion(taken) + 1e-5 * random.normal(size=(COUNT, 2))
    torque = acceleration(taken)
    return Recording(t=BEGIN + stamps[kept], q=q[kept], torque=torque[kept], source=kind)


KINDS = {
    "gaps": ("even", 0.0),
    "late": ("even clock", 0.0),
    "late, gaps": ("even clock", 0.0),
    "uneven": ("stamps", 1.0),
    "uneven, gaps": ("stamps", 1.0),
    "wandering": ("stamps", 1.0),
    "wandering, gaps": ("stamps", 1.0),
}
# What is read in chunks unasked: each kind of clock, and each of the two ways to new rows.
CHUNKED = {("gaps", 1500.0), ("wandering, gaps", None)}


@pytest.mark.parametrize("kind", KINDS)
def test_the_positions_tell_which_clock_is_right(kind: str) -> None:
    verdict, share = KINDS[kind]
    found = clock_statistics(recording(kind))
    assert found.verdict == verdict
    if verdict != "even":
        assert found.share == pytest.approx(share, abs=0.03)
    # The mean of 12000 intervals that vary by 40 % is known to 0.2 %.
    assert found.period == pytest.approx(PERIOD, rel=5e-3 if "wandering" in kind else 5e-6)
    if "wandering" not in kind:
        assert found.missing == (601 if "gaps" in kind else 0)


@pytest.mark.parametrize("kind", [pytest.param(k, marks=() if "gaps" in k else pytest.mark.slow) for k in KINDS])
def test_samples_are_those_of_a_perfect_log(kind: str) -> None:
    """The torques are the true accelerations, so that samples in step show none but the filter's difference."""
    perfect = recording("perfect").process(cutoff=15.0, trim=0.5)
    error = np.quantile(np.abs(perfect.ddq - perfect.torque), 0.98)
    samples = recording(kind).process(cutoff=15.0, trim=0.5)
    mask = np.ones(samples.q.shape, bool) if samples.mask is None else samples.mask
    differences = np.abs(samples.ddq - samples.torque)[mask]
    # All of it is encoder noise, of which the rows beside a missing one carry more; rows in wrong places show a hundred
    # times as much.
    assert np.quantile(differences, 0.98) < 1.25 * error
    assert np.sqrt(np.mean(differences**2)) < 0.03 * np.std(samples.torque)
    assert samples.count == pytest.approx(COUNT - 1000, rel=6e-3)
    assert samples.t is not None
    np.testing.assert_allclose(np.diff(samples.t), PERIOD, rtol=6e-3)
    if kind in ("gaps", "late, gaps"):
        inside = (missing_rows() >= 500) & (missing_rows() < COUNT - 500)
        # Some that are there are left out, too: nothing tells their places.
        left_out = samples.count - samples.used[0] - inside.sum()
        assert 0 <= left_out < (100 if "late" in kind else 1)


@pytest.mark.parametrize(
    ("kind", "resample"),
    [
        pytest.param(kind, resample, marks=() if (kind, resample) in CHUNKED else pytest.mark.slow)
        for kind in KINDS
        for resample in (None, 1500.0)
    ],
)
def test_chunks_equal_the_whole(kind: str, resample: float | None, tmp_path: Path) -> None:
    log = recording(kind)
    # A pause in the middle, where the log is split.
    t = log.t + 0.5 * (np.arange(log.count) > 5000)
    log = Recording(t=t, q=log.q, torque=log.torque, source="log.npz")
    path = log.save(tmp_path / "log.npz")
    options = {} if resample is None else {"resample": resample}
    processing = Processing.from_dict({"cutoff": 15.0, "trim": 0.1, **options})
    whole = Recording.read(path).process(processing)
    for rows in (1700, 100_000):
        joined = Samples.joined(list(process_chunks(path, processing=processing, rows=rows)))
        for name in ("q", "dq", "ddq", "torque"):
            expected = getattr(whole, name)
            np.testing.assert_allclose(getattr(joined, name), expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        np.testing.assert_array_equal(joined.t, whole.t)
        np.testing.assert_array_equal(joined.mask, whole.mask)
        assert joined.remarks[: len(whole.remarks)] == whole.remarks


def test_parts_between_long_gaps_are_processed_one_by_one() -> None:
    log = recording("perfect")
    log = Recording(t=np.arange(COUNT) * PERIOD, q=log.q, torque=log.torque)
    parts = [slice(0, 4000), slice(4700, 9000), slice(9100, 9130), slice(9400, COUNT)]
    rows = np.concatenate([np.arange(COUNT)[part] for part in parts])
    split = Recording(t=log.t[rows], q=log.q[rows], torque=log.torque[rows]).process(cutoff=5.0, trim=0.3)
    # The third part is too short for a filter at 5 Hz.
    alone = [log.rows(*span).process(cutoff=5.0, trim=0.3) for span in ((0, 4000), (4700, 9000), (9400, COUNT))]
    expected = Samples.joined(alone)
    assert split.count == expected.count
    np.testing.assert_allclose(split.q, expected.q, atol=1e-12)
    np.testing.assert_allclose(split.ddq, expected.ddq, atol=1e-7)
    np.testing.assert_allclose(split.t, expected.t, atol=1e-6)
    assert any("At 3 gaps of more than 0.02 s the log was split" in remark for remark in split.remarks)
    with pytest.raises(InputError, match=r"3 gaps where rows are missing.*`resample` in \[processing\]"):
        Recording(t=log.t[rows], q=log.q[rows], torque=log.torque[rows]).process(resample=False)


def test_a_row_alone_between_two_gaps_changes_nothing(tmp_path: Path) -> None:
    t = np.arange(6000) * PERIOD
    rows = (t < 2.0) | (t >= 3.0)
    options = Processing(cutoff=30.0)
    without, with_it = (
        Recording(t=t[kept], q=motion(t[kept]), torque=motion(t[kept]))
        for kept in (rows, rows | (np.arange(6000) == 2500))
    )
    expected, found = without.process(options), with_it.process(options)
    for name in ("t", "q", "dq", "ddq", "torque"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=0, atol=1e-9)
    chunks = Samples.joined(list(process_chunks(with_it.save(tmp_path / "log.npz"), processing=options)))
    np.testing.assert_allclose(chunks.q, expected.q, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_a_stated_rate_keeps_gaps_where_they_are(tmp_path: Path) -> None:
    log = recording("late, gaps")
    path = log.save(tmp_path / "log.npz")
    columns = {"time": "t", "rate": 1000.0}
    stated = Recording.read(path, columns)
    kept = np.setdiff1d(np.arange(COUNT), missing_rows())
    assert np.mean(np.abs(stated.t - stated.t[0] - (kept - kept[0]) * PERIOD) < 1e-6) > 0.995
    assert stated.t[-1] - stated.t[0] == pytest.approx((kept[-1] - kept[0]) * PERIOD, abs=1e-6)
    whole = stated.process(Processing(cutoff=15.0, trim=0.1))
    joined = Samples.joined(list(process_chunks(path, columns, Processing(cutoff=15.0, trim=0.1), rows=1700)))
    np.testing.assert_allclose(joined.ddq, whole.ddq, rtol=0, atol=1e-6 * np.abs(whole.ddq).max())
    np.testing.assert_array_equal(joined.mask, whole.mask)


def test_rows_that_are_written_several_at_a_time_are_even_rows() -> None:
    """Stamps of a network that delivers four rows at once: the median interval is not the period."""
    rows = np.arange(8000)
    stamps = (rows // 4) * 4 * PERIOD + (rows % 4) * 1e-5
    log = Recording(t=stamps, q=motion(rows * PERIOD), torque=motion(rows * PERIOD))
    found = clock_statistics(log)
    assert (found.verdict, found.missing) == ("even clock", 0)
    assert found.period == pytest.approx(PERIOD, rel=1e-5)


def test_noise_that_hides_the_difference_is_said() -> None:
    log = recording("uneven")
    noisy = Recording(t=log.t, q=log.q + 0.03 * np.random.default_rng(1).normal(size=log.q.shape), torque=log.torque)
    assert clock_statistics(noisy).verdict == "unclear"
    (remark,) = [one for one in noisy.process(cutoff=5.0).remarks if "no visible difference" in one]
    assert "1000 Hz" in remark
