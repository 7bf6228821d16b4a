"""Texts as spreadsheets, controllers and tools of measurement write them."""

import csv
import gzip
import io
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from steelyard.errors import InputError, MissingExtraError
from steelyard.recording import Processing, Recording, Samples, process_chunks

S = 400
T = np.arange(S) / 100
Q = np.column_stack([np.sin(3.1 * T), np.cos(1.7 * T)])
TORQUE = np.column_stack([4.0 * np.cos(T), -0.001 * np.sin(2.0 * T) - 1.0])
NAMES = ("t", "q1", "q2", "tau1", "tau2")
TABLE = np.column_stack([T, Q, TORQUE])


def rows(separator: str, number=repr) -> list[str]:
    return [separator.join(number(float(value)) for value in row) for row in TABLE]


def comma(value: float) -> str:
    return repr(value).replace(".", ",")


def quoted(delimiter: str, quoting: int, number=repr) -> str:
    text = io.StringIO()
    writer = csv.writer(text, delimiter=delimiter, quoting=quoting)
    writer.writerow(NAMES)
    writer.writerows([number(float(value)) for value in row] for row in TABLE)
    return text.getvalue()


def lines(*parts: str | list[str]) -> str:
    return "\n".join(line for part in parts for line in ([part] if isinstance(part, str) else part)) + "\n"


def aligned() -> str:
    text = io.StringIO()
    np.savetxt(text, TABLE, fmt="%26.18e", header="   ".join(NAMES), comments="")
    return text.getvalue()


DIALECTS = {
    "comma": lines(",".join(NAMES), rows(",")),
    "semicolon": lines(";".join(NAMES), rows(";")),
    "semicolon and decimal comma": lines(";".join(NAMES), rows(";", comma)),
    "tab": lines("\t".join(NAMES), rows("\t")),
    "tab and decimal comma": lines("\t".join(NAMES), rows("\t", comma)),
    "bar": lines("|".join(NAMES), rows("|")),
    "space": lines(" ".join(NAMES), rows(" ")),
    "spaces and decimal comma": lines("  ".join(NAMES), rows("   ", comma)),
    "columns aligned by spaces": aligned(),
    "spaces and tabs": lines("t  q1\tq2 \t tau1 tau2", [row.replace(",", " \t ") + " " for row in rows(",")]),
    "comma and blanks": lines(", ".join(NAMES), rows(" , ")),
    "all quoted": quoted(",", csv.QUOTE_ALL),
    "all quoted, decimal comma": quoted(",", csv.QUOTE_ALL, comma),
    "quoted, semicolon": quoted(";", csv.QUOTE_ALL, comma),
    "quoted where needed": quoted(",", csv.QUOTE_MINIMAL),
    "byte order mark": "\ufeff" + lines(",".join(NAMES), rows(",")),
    "lines of Windows": lines(";".join(NAMES), rows(";", comma)).replace("\n", "\r\n"),
    "comments of Python": lines("# a robot", "", ",".join(NAMES), "# here it begins", rows(",")),
    "comments of MATLAB": lines("% a robot", "\t".join(NAMES), "% here it begins", rows("\t")),
    "comments of C": lines("// a robot; 6 joints", ";".join(NAMES), "// begin", rows(";")),
    "names in a comment": lines("# written by numpy", "# " + " ".join(NAMES), rows(" ")),
    "names in a comment of MATLAB": lines("%" + ",".join(NAMES), rows(",")),
    "separator at the end": lines(";".join(NAMES), [row + ";" for row in rows(";")]),
    "separator at the end of all": lines(";".join(NAMES) + ";", [row + ";" for row in rows(";")]),
    "what was measured, above the names": lines(
        "Recorder 3000", "Date;2024-05-01", "Rate;100", "", ";".join(NAMES), rows(";", comma)
    ),
    "separators in quoted names": lines('t,q1,q2,tau1,tau2,"a; b; c"', [row + ",0" for row in rows(",")]),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_every_dialect_gives_the_same_numbers(dialect: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(DIALECTS[dialect].encode())
    found = Recording.read(path, joints=2)
    np.testing.assert_array_equal(found.t, T)
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_array_equal(found.torque, TORQUE)


@pytest.mark.parametrize("dialect", ["spaces and decimal comma", "comments of MATLAB", "separator at the end"])
@pytest.mark.parametrize("suffix", ["txt", "txt.gz", "txt.zst"])
def test_chunks_and_compressed_files_give_the_same_numbers(dialect: str, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"log.{suffix}"
    data = DIALECTS[dialect].encode()
    if suffix.endswith("gz"):
        data = gzip.compress(data[:5000]) + gzip.compress(data[5000:])  # as `cat a.gz b.gz` makes it
    elif suffix.endswith("zst"):
        zstd = pytest.importorskip("zstandard")
        data = zstd.compress(data[:5000]) + zstd.compress(data[5000:])
    path.write_bytes(data)
    processing = Processing(cutoff=None, trim=0.0, velocity_threshold=None)
    joined = Samples.joined(list(process_chunks(path, None, processing, 90, 2)))
    np.testing.assert_array_equal(joined.q, Q)
    np.testing.assert_array_equal(joined.torque, TORQUE)
    np.testing.assert_array_equal(Recording.read(path).torque, TORQUE)


@pytest.mark.parametrize("separator", [",", ";", "\t", "  "])
def test_names_of_a_text_without_them_are_stated(separator: str, tmp_path: Path) -> None:
    path = tmp_path / "log.dat"
    path.write_text(lines(rows(separator)))
    with pytest.raises(InputError, match=r'no line of column names .*name its 5 columns with `header = \["t", "q1"'):
        Recording.read(path)
    found = Recording.read(path, {"header": ["t", "q1", "q2", "tau1", "tau2"]})
    np.testing.assert_array_equal(found.t, T)
    np.testing.assert_array_equal(found.torque, TORQUE)
    with pytest.raises(InputError, match=r"has 5 columns but `header` in \[log\] names 2"):
        Recording.read(path, {"header": ["t", "q1"]})
    for wrong in ("t", ["t", 1], ["t", "t"], []):
        with pytest.raises(InputError, match=r"key 'header', .* list of the names of all columns"):
            Recording.read(path, {"header": wrong})


def test_stated_names_replace_those_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(lines("a,b,c,d,e", rows(",")))
    found = Recording.read(path, {"header": list(NAMES)})
    np.testing.assert_array_equal(found.q, Q)


def test_a_line_is_named_whatever_stands_above_it(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    data = rows(";", comma)
    data[7] = data[7].replace(",", "x", 1)
    path.write_text(lines("Recorder 3000", "", "t;q1;q2;tau1;tau2", data))
    number = path.read_text().splitlines().index(data[7]) + 1
    with pytest.raises(InputError, match=f"line {number}, holds '0x07' in column 't'"):
        Recording.read(path)


def test_rows_below_the_names_are_not_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(lines("t,q1,q2,tau1,tau2", "0,1", rows(",")))
    with pytest.raises(InputError, match="line 2"):
        Recording.read(path)


@pytest.mark.parametrize("suffix", ["gz", "zst"])
@pytest.mark.parametrize("change", ["cut off", "bit", "no compression", "empty"])
def test_damaged_compressed_file_is_one_sentence(suffix: str, change: str, tmp_path: Path) -> None:
    text = DIALECTS["comma"].encode()
    if suffix == "gz":
        data = gzip.compress(text)
    else:
        data = pytest.importorskip("zstandard").ZstdCompressor(write_checksum=True).compress(text)
    middle = len(data) // 2
    damaged = {
        "cut off": data[:middle],
        "bit": data[:middle] + bytes([data[middle] ^ 16]) + data[middle + 1 :],
        "no compression": text,
        "empty": b"",
    }
    path = tmp_path / f"log.csv.{suffix}"
    path.write_bytes(damaged[change])
    with pytest.raises(InputError, match=r"log\.csv"):
        Recording.read(path)
    with pytest.raises(InputError, match=r"log\.csv"):
        list(process_chunks(path))


def test_an_archive_of_arrays_is_not_read_compressed(tmp_path: Path) -> None:
    path = tmp_path / "log.npz.gz"
    path.write_bytes(gzip.compress(b"PK"))
    with pytest.raises(InputError, match="of compressed files only texts are read; decompress it"):
        Recording.read(path)


def test_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.csv.zst"
    path.write_bytes(b"anything")
    monkeypatch.setitem(sys.modules, "backports.zstd", None)
    monkeypatch.setitem(sys.modules, "compression.zstd", None)
    with pytest.raises(MissingExtraError, match=r"compressed by zstd .* pip install 'backports.zstd>="):
        Recording.read(path)


def test_units_below_the_names(tmp_path: Path) -> None:
    from steelyard.recording.formats.csv_file import CsvFile

    path = tmp_path / "log.csv"
    path.write_text(lines("t;q1;q2;tau1;tau2", "s;rad;[deg];Nm;-", rows(";")))
    assert CsvFile(path).names == ("t [s]", "q1 [rad]", "q2 [deg]", "tau1 [Nm]", "tau2")


def test_polars_reads_the_same(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(DIALECTS["semicolon and decimal comma"])
    frame = pl.read_csv(path, separator=";", decimal_comma=True)
    np.testing.assert_array_equal(Recording.read(path).torque, frame.select("tau1", "tau2").to_numpy())


@pytest.mark.parametrize("end", [False, True])
def test_a_quotation_mark_that_nothing_closes_is_named(tmp_path: Path, end: bool) -> None:
    own = lines("t,q1,q2,tau1,tau2", rows(",")).splitlines()
    own[40] = own[40] + '"' if end else own[40].replace(",", ',"', 1)
    (tmp_path / "log.csv").write_text("\n".join(own))
    with pytest.raises(InputError, match=r"log\.csv, line 41, has a quotation mark that nothing closes"):
        Recording.read(tmp_path / "log.csv")


def test_blank_lines_that_compression_makes_of_nothing_are_refused(tmp_path: Path) -> None:
    """Sixty kilobytes unpack to sixty million lines, for which a reader would take a minute."""
    import gzip

    (tmp_path / "log.csv.gz").write_bytes(gzip.compress(b"\n" * 60_000_000, 1))
    with pytest.raises(InputError, match="begins with more than 10000 blank lines"):
        Recording.read(tmp_path / "log.csv.gz")


def test_ends_of_lines_of_old_machines_are_told(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(b"t,q1,tau1\r0,1,2\r0.1,1,2\r")
    with pytest.raises(InputError, match="lines that end with CR alone"):
        Recording.read(tmp_path / "log.csv")


@pytest.mark.parametrize("heads", ["t,θ1,τ1", "t,theta_1,tau_1", "t,joint(1).q,joint(1).tau"])
def test_names_of_formulas_and_of_structs(heads: str, tmp_path: Path) -> None:
    rows = "".join(f"{k / 100},{np.sin(k / 9)},{np.cos(k / 9)}\n" for k in range(90))
    (tmp_path / "log.csv").write_text(f"{heads}\n{rows}", encoding="utf-8")
    found = Recording.read(tmp_path / "log.csv")
    assert found.layout is not None
    assert [one.quantity for one in found.layout.table] == ["time", "position", "torque"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_a_german_table_has_its_units_read_in_whatever_encoding(tmp_path: Path, encoding: str) -> None:
    names = ("Zeit [ms]", "Winkel 1 [°]", "Winkel 2 [°]", "Drehmoment 1 [Nm]", "Drehmoment 2 [Nm]")
    table = TABLE * [1e3, *[180 / np.pi] * 2, 1, 1]
    text = lines(";".join(names), [";".join(comma(float(value)) for value in row) for row in table])
    path = tmp_path / "messung.csv"
    path.write_bytes(text.encode(encoding))
    recording = Recording.read(path, joints=2)
    np.testing.assert_allclose(recording.t, T, rtol=0, atol=1e-12)
    np.testing.assert_allclose(recording.q, Q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(recording.torque, TORQUE, rtol=0, atol=1e-12)
