"""Times that are written as dates, in each kind of file and in memory."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.io import savemat

from steelyard.errors import InputError
from steelyard.recording import Recording
from steelyard.recording.formats.dates import seconds_of_texts

S = 1200
"""More rows than texts are looked at for the names of joints."""
MS = 4 * np.arange(S)
T = MS / 1000
Q, TORQUE = np.sin(2 * T), np.cos(3 * T) + 0.1 * T
BEGIN = datetime(2026, 2, 28, 23, 59, 58, tzinfo=UTC)
WHEN = [BEGIN + timedelta(milliseconds=int(ms)) for ms in MS]
STAMPS = np.datetime64("2026-02-28T23:59:58") + MS.astype("timedelta64[ms]")
ISO = [when.isoformat(timespec="milliseconds") for when in WHEN]
FORMS = {
    "ISO": ISO,
    "ISO, whole seconds without a fraction": [when.isoformat() for when in WHEN],
    "ISO, Z": [text.replace("+00:00", "Z") for text in ISO],
    "ISO, another zone": [text.replace("+00:00", "+01:00") for text in ISO],
    "a blank, comma": [text[:23].replace("T", " ").replace(".", ",") for text in ISO],
    "slashes": [text[:23].replace("-", "/") for text in ISO],
    "dots": [f"{when:%d.%m.%Y %H:%M:%S}.{when.microsecond:06d}" for when in WHEN],
    "MATLAB": [f"{when:%d-%b-%Y %H:%M:%S}.{when.microsecond // 1000:03d}" for when in WHEN],
    "no separators": [f"{when:%Y%m%dT%H%M%S}.{when.microsecond:06d}" for when in WHEN],
}


def expect(found: Recording) -> None:
    np.testing.assert_allclose(found.t - found.t[0], T, rtol=0, atol=1e-6)  # since 1970 a float64 has steps of 0.24 µs
    np.testing.assert_allclose(found.q[:, 0], Q, rtol=1e-12)
    np.testing.assert_allclose(found.torque[:, 0], TORQUE, rtol=1e-12)


@pytest.mark.parametrize("form", FORMS)
def test_forms_of_dates(form: str, tmp_path: Path) -> None:
    frame = pl.DataFrame({"time": FORMS[form], "q1": Q, "tau1": TORQUE})
    frame.write_csv(tmp_path / "run.csv", separator=";")
    for data in (tmp_path / "run.csv", frame, {"time": np.array(FORMS[form]), "q": Q, "tau": TORQUE}):
        expect(Recording.read(data))


def test_times_of_a_day_are_times() -> None:
    day = [f"{BEGIN - timedelta(hours=9) + timedelta(milliseconds=int(ms)):%H:%M:%S.%f}" for ms in MS]
    expect(Recording.read({"time": day, "q": Q, "tau": TORQUE}))


def npz(path: Path, t: Any) -> None:
    np.savez(path, t=t, q=Q, tau=TORQUE)


def hdf5(path: Path, t: Any) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["run/q"], file["run/tau"] = Q, TORQUE
        file.create_dataset("run/t", data=t)


TEXTS: dict[str, Callable[[Path], Any]] = {
    "run.parquet": lambda path: pl.DataFrame({"t": ISO, "q1": Q, "tau1": TORQUE}).write_parquet(path),
    "category.parquet": lambda path: pl.DataFrame(
        {"t": pl.Series(ISO, dtype=pl.Categorical), "q1": Q, "tau1": TORQUE}
    ).write_parquet(path),
    "zone.parquet": lambda path: pl.DataFrame(
        {"t": pl.Series(STAMPS).dt.replace_time_zone("Europe/Berlin"), "q1": Q, "tau1": TORQUE}
    ).write_parquet(path),
    "index.parquet": lambda path: pl.DataFrame({"q1": Q, "tau1": TORQUE, "__index_level_0__": STAMPS}).write_parquet(
        path
    ),
    "run.arrow": lambda path: pl.DataFrame({"t": ISO, "q1": Q, "tau1": TORQUE}).write_ipc(path),
    "run.npz": lambda path: npz(path, np.array(ISO)),
    "bytes.npz": lambda path: npz(path, np.array(ISO, dtype="S")),
    "stamps.npz": lambda path: npz(path, STAMPS),
    "run.mat": lambda path: savemat(path, {"t": np.array(ISO), "q": Q, "tau": TORQUE}),
    "cell.mat": lambda path: savemat(path, {"run": {"t": np.array(ISO, dtype=object), "q": Q, "tau": TORQUE}}),
    "run.h5": lambda path: hdf5(path, ISO),
    "bytes.h5": lambda path: hdf5(path, np.array(ISO, dtype="S")),
}


@pytest.mark.usefixtures("mat_in_this_process")
@pytest.mark.parametrize("name", TEXTS)
def test_dates_in_files(name: str, tmp_path: Path) -> None:
    TEXTS[name](tmp_path / name)
    expect(Recording.read(tmp_path / name))


def test_dates_of_an_hdf5_file_are_parsed_once_until_it_is_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A log is opened several times."""
    from steelyard.recording.formats import hdf5_file

    parsed = []
    stored = hdf5_file.dates_stored

    def counted(path: tuple[str, ...], texts: Any) -> Any:
        parsed.append(len(texts))
        return stored(path, texts)

    monkeypatch.setattr(hdf5_file, "dates_stored", counted)
    path = tmp_path / "run.h5"
    hdf5(path, ISO)
    for _ in range(2):
        expect(Recording.read(path))
    assert parsed.count(S) == 1
    path.unlink()
    hdf5(path, [text.replace("2026", "2027") for text in ISO])
    expect(Recording.read(path))
    assert parsed.count(S) == 2


@pytest.mark.usefixtures("mat_in_this_process")
def test_short_logs_have_dates_too(tmp_path: Path) -> None:
    """As many texts as there may be joints are read in another way."""
    savemat(tmp_path / "run.mat", {"t": np.array(ISO[:80]), "q": Q[:80], "tau": TORQUE[:80]})
    np.testing.assert_allclose(np.diff(Recording.read(tmp_path / "run.mat").t), 0.004, atol=1e-6)


@pytest.mark.parametrize("first", ["03/04/2026 10:00:00", "noon", "2026-13-01 10:00:00", "1e5", ""])
def test_what_may_be_another_day_is_not_guessed(first: str, tmp_path: Path) -> None:
    texts = [first.replace(":00", f":{k:02d}") for k in range(50)]
    pl.DataFrame({"t": texts, "q1": Q[:50], "tau1": TORQUE[:50]}).write_parquet(tmp_path / "run.parquet")
    with pytest.raises(InputError, match=r"no column of time|expected numbers"):
        Recording.read(tmp_path / "run.parquet")


def test_missing_dates_are_missing() -> None:
    found = seconds_of_texts(np.array([None, "2026-01-01 00:00:00", "NaT"], dtype=object))
    assert found is not None
    assert np.isnan(found).tolist() == [True, False, True]
    assert seconds_of_texts(np.array(["2026-01-01 00:00:00", "later"])) is None
