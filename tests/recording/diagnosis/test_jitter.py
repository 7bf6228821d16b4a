"""The rate of a jittery clock: long intervals are no missing rows unless the stamps stay displaced."""

import re

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.recording import Recording, clock_statistics

PERIOD = 1e-3


def jittery(jitter: float, missing: tuple[int, ...] = (), pause: float = 0.0, stamps_only: bool = True) -> Recording:
    """A log of 1 kHz whose stamps are off by up to `jitter` periods; after row 6000 it pauses."""
    rows = np.delete(np.arange(12500), missing)
    even = rows * PERIOD + pause * (rows >= 6000)
    t = even + PERIOD * jitter * np.random.default_rng(5).uniform(-1.0, 1.0, rows.size)
    moved = even if stamps_only else t
    return Recording(t=t, q=np.sin(2 * moved)[:, None], torque=np.cos(3 * moved)[:, None], source="jittery")


JITTERS = [0.2, 0.3, 0.4, 0.45]
MISSING = [(), (4000,), (4000, 7000, 7001), tuple(range(3000, 3037))]


# The fast tests try a clock that misses nothing, and one that trembles much and misses rows in two places.
@pytest.mark.parametrize(
    ("jitter", "missing"),
    [
        pytest.param(jitter, missing, marks=() if k == m in (0, 2) else pytest.mark.slow)
        for k, jitter in enumerate(JITTERS)
        for m, missing in enumerate(MISSING)
    ],
)
def test_rate_and_missing_rows_of_a_jittery_clock(jitter, missing):
    log = jittery(jitter, missing)
    found = clock_statistics(log)
    assert found.period == pytest.approx(PERIOD, rel=2e-5)
    assert found.missing == len(missing)
    assert found.jitter == pytest.approx(jitter * PERIOD / np.sqrt(3.0), rel=0.03)
    sentences = log.diagnose().sentences()
    stated = re.findall(r"even clock of (\S+) Hz", " ".join(sentences))
    assert stated
    assert np.allclose([float(rate) for rate in stated], 1000.0, rtol=2e-5)
    assert any("rows are missing" in one for one in sentences) == bool(missing)


@pytest.mark.parametrize("jitter", [0.0, 0.2, 0.45])
def test_a_pause_is_one_gap(jitter):
    found = clock_statistics(jittery(jitter, pause=0.037))
    assert (found.missing, len(found.gaps)) == (37, 1)
    assert found.gaps[0, 0] == pytest.approx(5.999, abs=1.5 * PERIOD)
    assert found.period == pytest.approx(PERIOD, rel=1e-5)


def test_a_row_written_late_is_no_missing_row():
    t = np.arange(5000) * PERIOD
    t[1000::50] += 0.7 * PERIOD
    found = clock_statistics(Recording(t=t, q=np.sin(t)[:, None], torque=np.cos(t)[:, None]))
    assert found.missing == 0
    assert found.period == pytest.approx(PERIOD, rel=1e-5)


def test_jitter_is_refused_as_jitter_and_a_gap_as_a_gap_where_even_rows_are_asked_for():
    with pytest.raises(InputError, match=r"is sampled unevenly: .* off the period of 0.00[019]* s"):
        jittery(0.4).process(cutoff=None, resample=False)
    with pytest.raises(InputError, match=r"has 1 gaps where rows are missing, the longest of 0.038 s"):
        jittery(0.0, tuple(range(3000, 3037))).process(cutoff=None, resample=False)


def test_resampling_a_jittery_log_keeps_its_rate():
    samples = jittery(0.4, stamps_only=False).process(cutoff=None, resample=True)
    assert np.median(np.diff(samples.t)) == pytest.approx(PERIOD, rel=2e-5)
    np.testing.assert_allclose(samples.q[:, 0], np.sin(2 * samples.t), atol=1e-7)
