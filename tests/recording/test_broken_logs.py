"""Every kind of broken log gives one sentence that says what, where and what to do."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.recording import Processing, Recording, process_chunks

Columns = dict[str, np.ndarray]


def replaced(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Columns], Columns]:
    return lambda log: {**log, name: change(log[name].copy())}


def put(row: int, value: Any) -> Callable[[np.ndarray], np.ndarray]:
    def change(values: np.ndarray) -> np.ndarray:
        values = values.astype(object)
        values[row] = value
        return values

    return change


def without(*names: str) -> Callable[[Columns], Columns]:
    return lambda log: {name: values for name, values in log.items() if name not in names}


def rows(*keep: slice) -> Callable[[Columns], Columns]:
    return lambda log: {name: np.concatenate([values[part] for part in keep]) for name, values in log.items()}


def uneven(log: Columns) -> Columns:
    t = log["t"].copy()
    t[100:200] += 0.004
    return {**log, "t": t}


def same(log: Columns) -> Columns:
    return log


# What is done to a good log of two joints at 100 Hz, the [log] and [processing] sections, what the message must say.
BROKEN: dict[str, tuple[Callable[[Columns], Columns], dict[str, Any], dict[str, Any], list[str]]] = {
    "no time column": (without("t"), {}, {}, ["no column of time", "`rate`"]),
    "no torques": (without("tau1", "tau2"), {}, {}, ["look like torques", "q1, q2", "`torque ="]),
    "missing column": (same, {"torque": ["tau1", "tauu2"]}, {}, ["no column 'tauu2'", 'did you mean "tau2"']),
    "pattern beyond the header": (same, {"position": "axis{}"}, {}, ["no column 'axis1'", "position"]),
    "column named twice": (same, {"torque": ["tau1", "tau1"]}, {}, ["names a column twice"]),
    "wrong joint count": (without("q2", "dq2", "tau2"), {}, {}, ["positions of 1 joints (q1)", "the robot has 2"]),
    "torques of fewer joints": (
        without("tau2"),
        {},
        {},
        ["1 columns of torque (tau1) for 2 joints", '"" for a joint of which none was logged'],
    ),
    "velocities of fewer joints": (without("dq2"), {}, {}, ["1 columns of velocity (dq1)", '`velocity = "none"`']),
    "two groups of torques": (
        lambda log: {**log, "effort1": log["tau1"], "effort2": log["tau2"]},
        {},
        {},
        ["several groups of columns for torque", "tau1 … tau2", "effort1 … effort2"],
    ),
    "NaN": (replaced("q2", put(6, "nan")), {}, {}, ["'q2'", "in 1 of 300 rows", "line 8", "remove those rows"]),
    "missing value": (replaced("tau1", put(9, "")), {}, {}, ["'tau1'", "line 11", "missing"]),
    "infinity": (replaced("tau1", put(4, "inf")), {}, {}, ["'tau1'", "line 6", "infinite"]),
    "text among numbers": (replaced("q1", put(20, "oops")), {}, {}, ["line 22", "'oops'", "'q1'", "expected a number"]),
    "repeated stamps": (
        replaced("t", lambda t: np.floor(t * 50) / 50),
        {},
        {},
        ["line 3", "repeats the time 0 s", "150 rows", "`rate`"],
    ),
    "time goes back": (rows(slice(100, 300), slice(100)), {}, {}, ["line 202", "goes back in time from 2.99 s to 0 s"]),
    "gap": (
        rows(slice(100), slice(150, 300)),
        {},
        {"resample": False},
        ["1 gaps", "0.51 s from t = 0.99 s", "row 100", "`resample`"],
    ),
    "parts too short to filter": (
        lambda log: {
            name: np.concatenate([values[k : k + 10] for k in range(0, 300, 60)]) for name, values in log.items()
        },
        {},
        {"cutoff": 5.0},
        ["in 5 parts between gaps", "0.1 s, too short", "`longest_gap`"],
    ),
    "jitter": (uneven, {}, {"resample": False}, ["sampled unevenly", "40 %", "`resample` in [processing]"]),
    "time in milliseconds": (
        replaced("t", lambda t: t * 1000),
        {},
        {},
        ["sample period of 10 s", '`time_unit = "ms"` would fit'],
    ),
    "rate against stamps": (same, {"time": "t", "rate": 500.0}, {}, ["300 rows in 2.99 s", "says 500 Hz"]),
    "positions in degrees": (
        lambda log: {**log, "q1": np.degrees(log["q1"]), "q2": np.degrees(log["q2"])},
        {},
        {},
        ["joint 1", "57.", 'state `position_unit = "deg"`'],
    ),
    "velocities in degrees": (replaced("dq2", np.degrees), {}, {}, ["joint 2", 'state `velocity_unit = "deg/s"`']),
    "velocity of the wrong sign": (replaced("dq1", np.negative), {}, {}, ["joint 1", "opposite signs"]),
    "velocity of the wrong scale": (replaced("dq1", lambda v: v * 10), {}, {}, ["joint 1", "0.1", "`time_unit`"]),
    "velocity stuck": (replaced("dq1", np.zeros_like), {}, {}, ["velocity of joint 1 stands still"]),
    "swapped joints": (
        lambda log: {**log, "dq1": log["dq2"], "dq2": log["dq1"]},
        {},
        {},
        ["position of joint 1", "velocity of joint 2", "swapped"],
    ),
    "no motion": (
        lambda log: {**without("dq1", "dq2")(log), "q1": np.ones(300), "q2": np.ones(300)},
        {},
        {},
        ["no joint moves"],
    ),
    "torque stuck": (
        replaced("tau2", np.ones_like),
        {},
        {},
        ["torque of joint 2 is 1 throughout", "`exclude_joints = [2]`"],
    ),
    "too short for the filter": (rows(slice(10)), {}, {"cutoff": 5.0}, ["10 rows", "needs 13", "longer log"]),
    "too short to derive": (rows(slice(2)), {}, {"cutoff": None}, ["2 rows", "need three"]),
    "cutoff above half the rate": (same, {}, {"cutoff": 60.0}, ["100 Hz", "cutoff of 60 Hz", "lower"]),
    "nothing left by trimming": (same, {}, {"trim": 2.0}, ["trimming by 2 and 2 s", "nothing"]),
    "too short to decimate": (
        rows(slice(200)),
        {},
        {"decimate": [10, 10], "trim": 0.0, "velocity_threshold": "none"},
        ["20 rows", "decimation by 10 needs 28"],
    ),
    "no measured velocities": (without("dq1", "dq2"), {}, {"velocity": "measured"}, ["no measured velocities"]),
    "thresholds for other joints": (same, {}, {"velocity_threshold": [1, 2, 3]}, ["2 joints", "3 values"]),
    "excluded joint unknown": (same, {}, {"exclude_joints": [3]}, ["holds 3", "numbers from 1 to 2"]),
    "gains for other joints": (same, {"gain": [1.0, 2.0, 3.0]}, {}, ["needs 2 values in `gain`", "there are 3"]),
    "unknown key in [log]": (same, {"positon": "q{}"}, {}, ["'positon' is not known here", 'did you mean "position"']),
    "unknown unit": (same, {"position_unit": "degree"}, {}, ["'degree'", "rad, deg"]),
    "current without gain": (same, {"torque_unit": "A"}, {}, ["amperes", "`gain`"]),
    "matrix not a matrix": (same, {"torque_matrix": [[1, 2], [3]]}, {}, ["rows of lengths [2, 1]"]),
    "number misspelt": (same, {"position_offset": ["pi/x", 0]}, {}, ["'pi/x'", "finite number"]),
    "unknown option": (same, {}, {"cut_off": 3.0}, ["'cut_off' is not known here", 'did you mean "cutoff"']),
    "order out of range": (same, {}, {"order": 0}, ["'order'", "from 1 to 10"]),
    "negative cutoff": (same, {}, {"cutoff": -1.0}, ["'cutoff'", "frequency in Hz"]),
}


def test_the_log_is_good_before_it_is_broken(log: Columns, write: Callable[..., Path]) -> None:
    recording = Recording.read(write(log), joints=2)
    assert recording.remarks == ()
    assert recording.process(cutoff=10.0, trim=0.0).count == 300


@pytest.mark.parametrize("case", BROKEN)
def test_broken_log(case: str, log: Columns, write: Callable[..., Path]) -> None:
    change, section, options, phrases = BROKEN[case]
    path = write(change(log))
    with pytest.raises(InputError) as caught:
        Recording.read(path, columns=section, joints=2).process(**options)
    message = str(caught.value)
    for phrase in phrases:
        assert phrase in message
    assert "\n" not in message
    assert message.endswith((".", ")", "?"))


FILES: dict[str, tuple[str, bytes, list[str]]] = {
    "empty": ("log.csv", b"", ["is empty"]),
    "header only": ("log.csv", b"t,q1,tau1\n", ["holds no rows"]),
    "comments only": ("log.csv", b"# nothing\n", ["holds no rows"]),
    "no header": ("log.csv", b"0.0,1.0,2.0\n0.1,1.1,2.1\n", ["no line of column names", "t,q1,q2"]),
    "UTF-16": ("log.csv", "t,q1,tau1\n0,1,2\n".encode("utf-16"), ["UTF-16", "save it as UTF-8"]),
    "a line with too many fields": (
        "log.csv",
        b"t,q1,tau1\n0.00,1,2\n0.01,1,2,3\n0.02,1,2\n",
        ["line 3", "4 fields", "3 column names"],
    ),
    "a line cut off": ("log.csv", b"t,q1,tau1\n0.00,1,2\n0.01,1.1,2\n0.02,1.2", ["'tau1'", "line 4", "missing"]),
    "the same name twice": ("log.csv", b"t,q1,q1,tau1\n0.00,1,1,2\n0.01,1,1,2\n", ["several columns named 'q1'"]),
    "binary": ("log.csv", b"PK\x03\x04\x00\x00\x00", ["not a text file"]),
    "not Parquet": ("log.parquet", b"t,q1,tau1\n", ["cannot be read as Parquet"]),
    "not NPZ": ("log.npz", b"t,q1,tau1\n", ["cannot be read as NPZ"]),
    "another kind of file": ("log.xlsx", b"PK", ["'.xlsx'", ".csv", ".parquet", ".npz"]),
}


@pytest.mark.parametrize("case", FILES)
def test_broken_file(case: str, tmp_path: Path) -> None:
    name, content, phrases = FILES[case]
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        Recording.read(path)
    for phrase in (name, *phrases):
        assert phrase in str(caught.value)


def test_missing_file_names_its_neighbour(log: Columns, write: Callable[..., Path], tmp_path: Path) -> None:
    write(log, "motion.csv")
    with pytest.raises(InputError, match=r"does not exist.*did you mean \"motion.csv\""):
        Recording.read(tmp_path / "motoin.csv")
    with pytest.raises(InputError, match="is a folder"):
        Recording.read(tmp_path)


def test_files_side_by_side_must_agree(log: Columns, write: Callable[..., Path]) -> None:
    motion = write({name: log[name] for name in ("t", "q1", "q2")}, "motion.csv")
    short = write({name: log[name][:200] for name in ("tau1", "tau2")}, "short.csv")
    with pytest.raises(InputError, match=r"motion.csv \+ short.csv have 300, 200 rows"):
        Recording.read([motion, short])
    with pytest.raises(InputError, match="300, 200 rows"):
        list(process_chunks([motion, short], processing=Processing(cutoff=5.0), rows=100))
    late = write({"t": log["t"] + 1.0, "tau1": log["tau1"], "tau2": log["tau2"]}, "late.csv")
    with pytest.raises(InputError, match="column 't' is in several of the files"):
        Recording.read([motion, late])


def test_pickled_arrays_are_not_read(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    np.savez(path, t=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="holds no arrays of numbers"):
        Recording.read(path)


@pytest.mark.parametrize(
    ("case", "phrase"),
    [
        ("NaN", "line 8"),
        ("text among numbers", "line 22"),
        ("time goes back", "goes back in time|must increase"),
        ("repeated stamps", "line 3"),
        ("gap", r"row 100\b"),
        ("jitter", "sampled unevenly"),
        ("time in milliseconds", "would fit"),
        ("swapped joints", "swapped"),
        ("torque stuck", "exclude_joints"),
        ("no motion", "no joint moves"),
        ("positions in degrees", "deg"),
    ],
)
def test_chunked_reading_says_the_same(case: str, phrase: str, log: Columns, write: Callable[..., Path]) -> None:
    change, section, options, _ = BROKEN[case]
    path = write(change(log))
    rows = 60 if case not in ("swapped joints", "positions in degrees") else 200
    with pytest.raises(InputError, match=phrase):
        list(process_chunks(path, section, Processing(**{"cutoff": 8.0, **options}), rows=rows, joints=2))


def test_a_log_of_which_nothing_is_left_is_refused_in_chunks_too(log: Columns, write: Callable[..., Path]) -> None:
    path, options = write(log), Processing(cutoff=8.0, velocity_threshold=1e3)
    with pytest.raises(InputError, match=r"300 rows in 2\.99 s, of which .* leaves none to use") as whole:
        Recording.read(path, joints=2).process(options)
    with pytest.raises(InputError) as chunks:
        list(process_chunks(path, processing=options, rows=60, joints=2))
    assert str(chunks.value) == str(whole.value)


@pytest.mark.parametrize("missing", ["refuse", "fill"])
def test_a_time_that_is_missing_is_not_said_to_be_filled(
    log: Columns, write: Callable[..., Path], missing: str
) -> None:
    path = write({**log, "t": np.where(np.arange(300) == 100, np.nan, log["t"])})
    columns, said = {"missing": missing}, r"line 102 \(missing or NaN\); .*times are not filled"
    with pytest.raises(InputError, match=said):
        Recording.read(path, columns)
    with pytest.raises(InputError, match=said):
        list(process_chunks(path, columns, joints=2))
