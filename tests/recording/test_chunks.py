"""Chunk by chunk, the samples are those of the whole log."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.recording import Processing, Recording, Samples, process_chunks, read_chunks
from steelyard.recording.survey import LogSurvey

COUNT, RATE = 6000, 500.0

OPTIONS: dict[str, dict[str, Any]] = {
    "no filter": {"cutoff": None},
    "filter": {"cutoff": 10.0},
    "all": {"cutoff": 12.0, "order": 4, "torque_cutoff": 30.0, "trim": (0.313, 0.5), "velocity_threshold": 0.3},
    "one decimation": {"cutoff": 20.0, "decimate": 7, "trim": 0.25},
    "two decimations": {"cutoff": 20.0, "decimate": [4, 5], "trim": (0.1, 0.0)},
    "measured": {"cutoff": 15.0, "velocity": "measured", "decimate": 3},
}


@pytest.fixture(scope="module")
def recording() -> Recording:
    rng = np.random.default_rng(5)
    t = np.arange(COUNT) / RATE
    phases = rng.uniform(0, 6, (3, 2))
    frequencies = np.array([[0.3, 0.4], [0.9, 0.7], [1.7, 1.4]])
    angle = 2 * np.pi * frequencies[None] * t[:, None, None] + phases
    q = np.sin(angle).sum(axis=1) + 1e-4 * rng.normal(size=(COUNT, 2))
    velocity = (2 * np.pi * frequencies * np.cos(angle)).sum(axis=1)
    return Recording(t=t + 1000.0, q=q, velocity=velocity, torque=rng.normal(size=(COUNT, 2)))


SUFFIXES = (".csv", ".npz", ".parquet")


@pytest.fixture(scope="module", params=SUFFIXES)
def path(request: pytest.FixtureRequest, recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recording.save(tmp_path_factory.mktemp("logs") / f"log{request.param}")


@pytest.mark.parametrize(
    ("path", "case"),
    [
        # What is done to the rows does not depend on the file that they come from.
        pytest.param(suffix, case, marks=() if suffix == ".npz" or case == "all" else pytest.mark.slow)
        for suffix in SUFFIXES
        for case in OPTIONS
    ],
    indirect=["path"],
)
def test_chunks_equal_the_whole(case: str, path: Path) -> None:
    processing = Processing.from_dict(OPTIONS[case])
    whole = Recording.read(path).process(processing)
    for rows in (331, 2500, 100_000):
        parts = list(process_chunks(path, processing=processing, rows=rows))
        assert len(parts) > 1 or rows > COUNT
        joined = Samples.joined(parts)
        for name in ("q", "dq", "ddq", "torque"):
            expected = getattr(whole, name)
            np.testing.assert_allclose(getattr(joined, name), expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        assert joined.t is not None
        assert whole.t is not None
        np.testing.assert_allclose(joined.t, whole.t, rtol=0, atol=1e-12)
        assert (joined.cutoff, joined.filtered_torque) == (whole.cutoff, whole.filtered_torque)
        assert (joined.mask is None) == (whole.mask is None)
        if whole.mask is not None:
            np.testing.assert_array_equal(joined.mask, whole.mask)


@pytest.mark.parametrize("options", [{"torque_cutoff": 60.0}, {"torque_cutoff": 90.0, "decimate": 3}], ids=str)
def test_the_regressor_goes_through_the_filters_of_the_torques(
    options: dict[str, Any], recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Torques that are the regressor times parameters stay so: both sides went through the same filters."""
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")]).with_terms(sy.Coulomb())
    model = sy.Model(robot)
    processing = Processing.from_dict({"cutoff": 50.0, "trim": 0.2, "velocity_threshold": None, **options})
    motion = recording.process(Processing(cutoff=50.0, trim=0.0, velocity_threshold=None))
    parameters = np.linspace(0.5, 1.5, model.parameter_count)
    torque = model.inverse_dynamics(motion.q, motion.dq, motion.ddq, parameters)
    exact = replace(recording, torque=torque, velocity=None)
    samples = exact.process(processing, model)
    assert samples.regressor is not None
    columns, base = model.base_columns, model.base_parameters().values(parameters)
    predicted = np.column_stack(
        [own @ base[used] for own, used in zip(columns.by_joint(samples.regressor), columns.joints, strict=True)]
    )
    np.testing.assert_allclose(samples.torque, predicted, rtol=0, atol=1e-9 * np.abs(torque).max())
    plain = model.inverse_dynamics(samples.q, samples.dq, samples.ddq, parameters)
    assert np.abs(samples.torque - plain).max() > 0.5  # N·m, of friction that jumps by 2
    # And so they are piece by piece.
    monkeypatch.setattr("steelyard.recording.chunks.PIECE_ROWS", 300)
    saved = exact.save(tmp_path / "exact.npz")
    joined = Samples.joined(list(process_chunks(saved, processing=processing, rows=500, model=model)))
    assert joined.regressor is not None
    assert joined.regressor_model is model
    scale = np.abs(samples.regressor).max()
    np.testing.assert_allclose(joined.regressor, samples.regressor, rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(joined.torque, samples.torque, rtol=0, atol=1e-9 * np.abs(torque).max())


def test_raw_chunks_tile_the_log(path: Path, recording: Recording) -> None:
    chunks = list(read_chunks(path, rows=1700, padding_seconds=0.1))
    assert [chunk.stop - chunk.start for chunk in chunks] == [1700, 1700, 1700, 900]
    assert [chunk.start for chunk in chunks] == [0, 50, 50, 50]
    assert [chunk.recording.first_row for chunk in chunks] == [0, 1650, 3350, 5050]
    for name in ("q", "torque", "t", "velocity"):
        joined = np.concatenate([getattr(chunk.recording, name)[chunk.start : chunk.stop] for chunk in chunks])
        np.testing.assert_array_equal(joined, getattr(recording, name))
    assert {chunk.recording.rate for chunk in chunks} == {recording.rate}


def test_pauses_are_no_part_of_the_rate(recording: Recording, tmp_path: Path) -> None:
    pauses = 1000.0 * (np.arange(COUNT) // 1500)  # episodes of 3 s
    whole = replace(recording, t=recording.t + pauses)
    chunks = list(read_chunks(whole.save(tmp_path / "log.npz"), rows=1700))
    for rate in (whole.rate, *(chunk.recording.rate for chunk in chunks)):
        assert rate == pytest.approx(RATE, rel=1e-9)
    # Rows that are missing one by one are no pauses.
    thinned = recording.chosen(np.arange(COUNT) % 3 != 0)
    assert thinned.rate == pytest.approx(RATE * 2 / 3, rel=1e-3)


def test_stated_rate_without_stamps(recording: Recording, tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    np.savez(path, q=recording.q, tau=recording.torque)
    processing = Processing(cutoff=10.0, trim=0.0, velocity_threshold=None)
    whole = Recording.read(path, {"rate": RATE}).process(processing)
    joined = Samples.joined(list(process_chunks(path, {"rate": RATE}, processing, rows=1000)))
    np.testing.assert_allclose(joined.ddq, whole.ddq, rtol=0, atol=1e-9 * np.abs(whole.ddq).max())
    np.testing.assert_array_equal(joined.t, whole.t)


def test_what_the_data_decides_is_that_of_the_whole_log(path: Path, recording: Recording) -> None:
    whole = recording.process()
    for rows in (1000, 4000):
        parts = list(process_chunks(path, rows=rows))
        assert parts[0].remarks[:2] == whole.remarks[:2]
        joined = Samples.joined(parts)
        np.testing.assert_array_equal(joined.t, whole.t)
        np.testing.assert_allclose(joined.ddq, whole.ddq, rtol=0, atol=1e-8 * np.abs(whole.ddq).max())


def test_a_chunk_has_rows(path: Path) -> None:
    with pytest.raises(InputError, match="`rows` is 0"):
        list(read_chunks(path, rows=0))


def test_errors_name_the_line_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    lines = ["# made by hand", "t,q1,tau1", *(f"{k / 100},{np.sin(k / 30)},{np.cos(k / 20)}" for k in range(3000))]
    lines[2345] = lines[2345].split(",")[0] + ",nan,1"
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"'q1' in 1 of .* first on line 2346 "):
        list(process_chunks(path, processing=Processing(cutoff=5.0, trim=0.0, velocity_threshold=None), rows=500))


SCRIPT = """
import sys
from steelyard.recording import Processing, process_chunks
rows = sum(part.count for part in process_chunks(sys.argv[1], processing=Processing(cutoff=5.0, trim=0.0), rows=20_000))
# Not ru_maxrss, which a child process inherits from its parent.
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(rows, int(peak.split()[1]) / 1024)
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the peak of memory is read from /proc")
def test_memory_does_not_grow_with_an_uneven_log(tmp_path: Path) -> None:
    """Where stamps are unsteady and rows missing, so that gaps are filled; of other logs test_long_logs.py says so."""
    peaks = []
    for count in (200_000, 800_000):  # what is left open is chosen by the first 200 000 rows
        t = np.arange(count) / 1000
        q = np.sin(np.outer(t, np.linspace(1.0, 2.0, 7)))
        kept = np.ones(count, dtype=bool)
        random = np.random.default_rng(1)
        kept[random.integers(10, count - 10, count // 50)] = False
        t = t + random.uniform(0.0, 3e-4, count)
        path = Recording(t=t[kept], q=q[kept], torque=q[kept]).save(tmp_path / f"log{count}.npz")
        run = subprocess.run([sys.executable, "-c", SCRIPT, str(path)], capture_output=True, text=True, check=True)
        rows, peak = run.stdout.split()
        assert int(rows) == count
        peaks.append(float(peak))
    # The difference, 600 000 rows, would take 72 MB as arrays alone, and several times that in processing.
    assert peaks[1] - peaks[0] < 50.0


def test_write_fixture_is_read_in_chunks(log: dict[str, np.ndarray], write: Callable[..., Path]) -> None:
    motion = write({name: log[name] for name in ("t", "q1", "q2")}, "motion.csv")
    torque = write({name: log[name] for name in ("tau1", "tau2")}, "torque.csv")
    parts = list(
        process_chunks([motion, torque], processing=Processing(cutoff=None, trim=0.0, velocity_threshold=None), rows=70)
    )
    assert [part.count for part in parts] == [70, 70, 70, 70, 20]
    np.testing.assert_array_equal(Samples.joined(parts).torque[:, 1], log["tau2"])


def test_a_jump_is_told_whichever_piece_has_it(recording: Recording) -> None:
    q = recording.q.copy()
    q[4000:, 1] += 0.4
    log = replace(recording, q=q)
    (told,) = LogSurvey.of(log).jump_remarks()
    assert f"joint 2 jumps by {q[4000, 1] - q[3999, 1]:.3g}" in told
    assert "at t = 1008 s" in told
    whole, parts = LogSurvey(), [LogSurvey() for _ in range(3)]
    for part, start in zip(parts, (0, 2000, 4000 - 100), strict=True):
        part.add(log, start, start + 2000)
        whole.join(part.state, log)
    assert told in whole.remarks()
    assert LogSurvey.of(recording).jump_remarks() == ()
