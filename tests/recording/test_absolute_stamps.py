"""Stamps since 1970 count in s from the first row, and lose none of their ns on the way, whoever reads which part."""

import gzip
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from log_writers import BAGS, State
from scipy.io import savemat

import steelyard as sy
from steelyard.errors import InputError
from steelyard.recording import Recording, chunks, read_chunks
from steelyard.recording.clock import clock_statistics
from steelyard.recording.formats import LogFiles
from steelyard.recording.log_sample import Stretch

BEGIN = 1_732_284_307_250_123_457
"""ns since 1970; as s, a float64 is 238 ns from the next one."""
S = 900
# Off an even clock by whole ns, up to 0.5 % of the period.
STEPS = 4_000_000 + np.random.default_rng(7).integers(-20_000, 20_000, S - 1)
NS = BEGIN + np.concatenate([[0], np.cumsum(STEPS)])
T = np.array([(int(ns) - BEGIN) / 10**9 for ns in NS])  # in integers up to the division, which rounds once
Q, TORQUE = np.sin(2 * T), np.cos(3 * T) + 0.1 * T
SECONDS, REST = NS // 10**9, NS % 10**9
ISO = [f"{np.datetime64(int(ns), 'ns')}Z" for ns in NS]
DECIMAL = [f"{seconds}.{rest:09d}" for seconds, rest in zip(SECONDS, REST, strict=True)]
US, MS = NS // 1000, NS // 10**6


def table(**times: Any) -> pl.DataFrame:
    return pl.DataFrame({**times, "q1": Q, "tau1": TORQUE})


def hdf5(path: Path, t: Any) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, values in {"stamp": t, "q": Q, "tau": TORQUE}.items():
            file.create_dataset(f"log/{name}", data=values, compression="gzip" if name == "q" else None)


WRITERS: dict[str, Callable[[Path], Any]] = {
    "ns.csv": lambda path: table(stamp=NS).write_csv(path),
    "quoted.csv": lambda path: table(stamp=NS).write_csv(path, quote_style="always"),
    "blanks.csv": lambda path: path.write_text(table(stamp=NS).write_csv().replace(",", " , ")),
    "ns.csv.gz": lambda path: path.write_bytes(gzip.compress(table(stamp=NS).write_csv().encode())),
    "iso.csv": lambda path: table(stamp=ISO).write_csv(path),
    "decimal.csv": lambda path: table(stamp=DECIMAL).write_csv(path),
    "comma.csv": lambda path: path.write_text(table(stamp=DECIMAL).write_csv(separator=";").replace(".", ",")),
    "pair.csv": lambda path: table(sec=SECONDS, nanosec=REST).write_csv(path),
    "ns.parquet": lambda path: table(stamp=NS).write_parquet(path, row_group_size=250),
    "unsigned.parquet": lambda path: table(stamp=NS.astype(np.uint64)).write_parquet(path),
    "dates.parquet": lambda path: table(stamp=NS.astype("datetime64[ns]")).write_parquet(path, row_group_size=250),
    "iso.parquet": lambda path: table(stamp=ISO).write_parquet(path),
    "pair.parquet": lambda path: table(sec=SECONDS, nanosec=REST).write_parquet(path),
    "ns.arrow": lambda path: table(stamp=NS).write_ipc(path),
    "ns.npz": lambda path: np.savez(path, stamp=NS, q=Q, tau=TORQUE),
    "big_endian.npz": lambda path: np.savez_compressed(path, stamp=NS.astype(">i8"), q=Q, tau=TORQUE),
    "dates.npz": lambda path: np.savez(path, stamp=NS.astype("datetime64[ns]"), q=Q, tau=TORQUE),
    "iso.npz": lambda path: np.savez(path, stamp=np.array(ISO), q=Q, tau=TORQUE),
    "pair.npz": lambda path: np.savez(path, sec=SECONDS, nanosec=REST, q=Q, tau=TORQUE),
    "ns.mat": lambda path: savemat(path, {"stamp": NS[:, None], "q": Q, "tau": TORQUE}),
    "iso.mat": lambda path: savemat(path, {"stamp": np.array(ISO), "q": Q, "tau": TORQUE}),
    "ns.h5": lambda path: hdf5(path, NS),
    "iso.h5": lambda path: hdf5(path, ISO),
}


def expect(found: Any, rows: slice = slice(None)) -> None:
    np.testing.assert_array_equal(found.t, T[rows])
    assert found.clock_origin + round(1e9 * found.t[0]) == NS[rows][0]


@pytest.mark.usefixtures("mat_in_this_process")
@pytest.mark.parametrize("name", WRITERS)
def test_no_ns_is_lost(name: str, tmp_path: Path) -> None:
    WRITERS[name](tmp_path / name)
    expect(Recording.read(tmp_path / name))
    for chunk in read_chunks(tmp_path / name, rows=333):
        recording = chunk.recording
        expect(recording, slice(recording.first_row, recording.first_row + recording.count))


@pytest.mark.parametrize("suffix", ["csv", "npz", "parquet"])
def test_no_ns_of_what_is_saved_is_lost(suffix: str, tmp_path: Path) -> None:
    WRITERS["ns.csv"](tmp_path / "log.csv")
    saved = Recording.read(tmp_path / "log.csv").save(tmp_path / f"saved.{suffix}")
    expect(Recording.read(saved))
    assert LogFiles(saved).names == ("t_ns", "q1", "tau1")


@pytest.mark.parametrize("kind", ["ros1.bag", "json.mcap"])
def test_no_ns_of_a_bag_is_lost(kind: str, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    rows = zip(NS.tolist(), Q[:, None], TORQUE[:, None], strict=True)
    messages = [State(ns, ("elbow",), q, np.empty(0), torque) for ns, q, torque in rows]
    BAGS[kind](tmp_path / kind, {"/joint_states": messages})
    expect(Recording.read(tmp_path / kind))


@pytest.mark.slow
def test_no_ns_of_what_is_in_memory_is_lost() -> None:
    pandas = pytest.importorskip("pandas")
    frames = [table(stamp=NS), table(stamp=NS.astype("datetime64[ns]")), table(stamp=ISO)]
    frames += [pandas.DataFrame({"stamp": NS, "q1": Q, "tau1": TORQUE})]
    for data in (
        *frames,
        {"stamp": NS, "q": Q, "tau": TORQUE},
        {"sec": SECONDS, "nanosec": REST, "q": Q, "tau": TORQUE},
    ):
        found = Recording.read(data)
        expect(found)
        again = Recording.read(found)
        np.testing.assert_array_equal(again.t, T)
        assert again.clock_origin == BEGIN


@pytest.mark.parametrize(("unit", "values", "parts"), [("us", US, 10**6), ("ms", MS // 4 * 4, 10**3)])
@pytest.mark.parametrize("kind", [np.int64, np.float64])
def test_units_above_ns_lose_nothing_either(unit: str, values: Any, parts: int, kind: Any, tmp_path: Path) -> None:
    """A float64 holds them as they are written, but not in s."""
    values = values[0] + np.maximum.accumulate(values - values[0] + np.arange(S) * (unit == "ms"))
    exact = [(int(one) - int(values[0])) / parts for one in values]
    frame = table(**{f"stamp_{unit}": values.astype(kind)})
    frame.write_csv(tmp_path / "run.csv")
    frame.write_parquet(tmp_path / "run.parquet")
    for data in (frame, tmp_path / "run.csv", tmp_path / "run.parquet"):
        found = Recording.read(data)
        np.testing.assert_array_equal(found.t, exact)
        assert found.clock_origin == int(values[0]) * 10**9 // parts


def test_times_that_a_float_holds_are_as_they_are_written(tmp_path: Path) -> None:
    """Users look for them in their logs; s with fewer digits than a float64 has gain nothing."""
    for times in ({"t": 12.5 + T}, {"t_ns": NS - BEGIN + 12_500_000_000}, {"t": 1_732_284_307.25 + T}):
        for path in (tmp_path / "run.csv", tmp_path / "run.parquet"):
            frame = table(**times)
            frame.write_csv(path) if path.suffix == ".csv" else frame.write_parquet(path)
            found = Recording.read(path)
            (values,) = times.values()
            np.testing.assert_allclose(found.t, values / (1e9 if values.dtype == np.int64 else 1.0), rtol=1e-15)
            assert found.clock_origin == 0


@pytest.mark.parametrize(
    "name", ["ns.csv", "iso.csv", "decimal.csv", "pair.csv", "ns.parquet", "dates.parquet", "pair.npz"]
)
def test_another_process_counts_from_the_same_row(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from steelyard.recording.formats import csv_file, decoded

    monkeypatch.setattr(csv_file, "READ", (2000, 2000))
    WRITERS[name](tmp_path / name)
    stream = chunks.LogStream(str(tmp_path / name), None, 1)
    told = pickle.dumps(stream) if stream.files.places() is not None else None
    if told is None:  # dates are told by the first rows, so that one process reads them all
        assert name in ("iso.csv", "pair.npz")
        return
    decoded._DECODED.clear()
    expect(next(pickle.loads(told).spans([(500, 700)])), slice(500, 700))


def test_what_goes_on_in_another_form_is_read_line_by_line(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    for change in (
        lambda text: f"{text}.0",
        lambda text: f"+{text}",
        lambda text: f" {text} ",
        lambda text: f'"{text}"',
    ):
        stamps = [change(str(ns)) if row >= 500 else str(ns) for row, ns in enumerate(NS)]
        rows = [f"{stamp},{q!r},{tau!r}" for stamp, q, tau in zip(stamps, Q.tolist(), TORQUE.tolist(), strict=True)]
        path.write_text("stamp,q1,tau1\n" + "\n".join(rows))
        expect(Recording.read(path))


@pytest.mark.parametrize("bad", ["", "nan", "later", "99999999999999999999"])
def test_a_stamp_that_is_none_is_refused_with_its_line(bad: str, tmp_path: Path) -> None:
    stamps = [str(ns) if row != 500 else bad for row, ns in enumerate(NS)]
    table(stamp=stamps).write_csv(tmp_path / "run.csv")
    with pytest.raises(InputError, match=r"line 502|line 503, goes back|column 'stamp'"):
        Recording.read(tmp_path / "run.csv")


def test_large_whole_numbers_that_are_no_times_stay_as_they_are(tmp_path: Path) -> None:
    """An encoder may begin its counts anywhere."""
    counts = 2**60 + (1e15 * Q).astype(np.int64)
    frame = pl.DataFrame({"stamp": NS, "q1": counts, "tau1": TORQUE})
    frame.write_csv(tmp_path / "run.csv")
    frame.write_parquet(tmp_path / "run.parquet")
    for path in (tmp_path / "run.csv", tmp_path / "run.parquet"):
        files = LogFiles(path)
        files.layout(1)
        np.testing.assert_array_equal(files.read(["q1"])["q1"], counts.astype(np.float64))


def test_files_side_by_side_have_the_same_stamps(tmp_path: Path) -> None:
    pl.DataFrame({"stamp": NS, "q1": Q}).write_csv(tmp_path / "a.csv")
    for shift in (0, 1):  # ns
        pl.DataFrame({"stamp": NS + shift, "tau1": TORQUE}).write_csv(tmp_path / "b.csv")
        both = f"{tmp_path / 'a.csv'}+{tmp_path / 'b.csv'}"
        if shift:
            with pytest.raises(InputError, match="different values"):
                Recording.read(both)
        else:
            expect(Recording.read(both))


def test_rows_that_are_kept_of_a_long_log_count_from_its_first(tmp_path: Path) -> None:
    table(stamp=NS).write_csv(tmp_path / "run.csv")
    files = LogFiles(tmp_path / "run.csv")
    layout = files.layout(1)
    block = next(files.blocks_from(300, layout.names, 400))
    expect(Recording.read(Stretch(files, block, (), 300)), slice(300, 700))


@pytest.mark.parametrize("name", ["run.csv", "run.parquet", "run.npz"])
def test_gaps_and_jitter_are_those_of_the_ns(name: str, tmp_path: Path) -> None:
    """A clock of 250 kHz: a float64 of s since 1970 has steps of 6 % of its period."""
    kept = np.delete(np.arange(S), [400, 401, 402])
    ns, q, torque = BEGIN + 4000 * kept, Q[kept], TORQUE[kept]
    if name == "run.npz":
        np.savez(tmp_path / name, sec=ns // 10**9, nanosec=ns % 10**9, q=q, tau=torque)
    elif name == "run.csv":
        pl.DataFrame({"stamp": ns, "q1": q, "tau1": torque}).write_csv(tmp_path / name)
    else:
        pl.DataFrame({"stamp": ns.astype("datetime64[ns]"), "q1": q, "tau1": torque}).write_parquet(tmp_path / name)
    clock = clock_statistics(Recording.read(tmp_path / name))
    assert (clock.missing, clock.verdict, clock.gap_rows.tolist()) == (3, "even", [399])
    assert clock.largest < 1e-6
    np.testing.assert_allclose(clock.gaps[0], [399 * 4e-6, 403 * 4e-6], rtol=1e-12)
    assert clock.period == pytest.approx(4e-6, rel=1e-9)


@pytest.mark.slow
def test_overlaps_are_found_on_the_clock_of_the_logs(tmp_path: Path) -> None:
    """Each part counts from its own first row."""
    robot = sy.Robot.from_dh([(0, 0.3, 0, "q")], gravity=(0, -9.81, 0), name="pendulum")
    t = np.arange(2000) * 4_000_000 / 1e9
    q = 0.8 * np.sin(3 * t) + np.sin(1.1 * t)
    torque = 0.6 * (-7.2 * np.sin(3 * t) - 1.21 * np.sin(1.1 * t)) + 5.0 * np.cos(q)
    torque += np.random.default_rng(0).normal(0.0, 0.05, len(t))
    ns = BEGIN + 4_000_000 * np.arange(2000)
    whole = pl.DataFrame({"stamp": ns, "q1": q, "tau1": torque})
    first, second = tmp_path / "first.csv", tmp_path / "second.parquet"
    whole[:1200].write_csv(first)
    whole[800:].with_columns(pl.col("stamp").cast(pl.Datetime("ns"))).write_parquet(second)

    def told(*logs: Path) -> list[str]:
        result = sy.identify(robot, list(map(str, logs)), processing={"cutoff": "none"})
        return [remark for remark in result.remarks if "are rows of" in remark]

    (remark,) = told(first, second)
    found = re.search(
        r"second\.parquet: rows from t = (\S+) to (\S+) s are rows of \S+first\.csv, too, and count", remark
    )
    assert found is not None
    assert 0.0 <= float(found[1]) < 0.1  # of its own clock; a joint that is slow for a moment tells nothing
    assert 1.5 < float(found[2]) < 1.6
    # The same numbers a day later are another recording, whose times count from 0 as well.
    whole[:1200].with_columns(stamp=pl.col("stamp") + 86_400 * 10**9).write_csv(tmp_path / "later.csv")
    assert told(first, tmp_path / "later.csv") == []
