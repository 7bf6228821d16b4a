"""Parquet of many writers is let through; what would end the process is refused."""

import base64
import datetime
import errno
import os

import numpy as np
import polars as pl
import pytest

from steelyard.errors import InputError
from steelyard.files import check_parquet, read_table, write_table
from steelyard.recording import Recording

pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
pq = pytest.importorskip("pyarrow.parquet")

ROWS = 500


@pytest.fixture(scope="module")
def table():
    """Columns of most kinds that Parquet has."""
    random = np.random.default_rng(0)
    lists = [[float(k)] * (k % 4) for k in range(ROWS)]
    return pa.table(
        {
            "t": np.arange(ROWS) / 100.0,
            "q": pa.array(random.normal(size=ROWS), mask=random.uniform(size=ROWS) < 0.1),
            "single": random.normal(size=ROWS).astype(np.float32),
            "word": pa.array([f"joint {k % 7}" for k in range(ROWS)]),
            "list": pa.array(lists),
            "nested": pa.array([{"a": k, "b": [None, "x"] if k % 3 else None} for k in range(ROWS)]),
            "right": pa.array([k % 5 == 0 for k in range(ROWS)]),
            "date": pa.array([datetime.datetime(2026, 1, 1) + datetime.timedelta(seconds=k) for k in range(ROWS)]),
            "none": pa.nulls(ROWS, pa.float64()),
        }
    )


@pytest.mark.parametrize("compression", ["none", "snappy", "gzip", "zstd", "lz4"])
@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("more", [{}, {"row_group_size": 37, "data_page_size": 100, "write_page_index": True}])
def test_what_arrow_writes_is_let_through(table, tmp_path, compression, version, more):
    place = tmp_path / "table.parquet"
    pq.write_table(table, place, compression=compression, data_page_version=version, **more)
    check_parquet(place)
    assert len(read_table(place, "give a table")) == ROWS


def test_encodings_of_columns_are_let_through(table, tmp_path):
    place = tmp_path / "table.parquet"
    kinds = {"t": "BYTE_STREAM_SPLIT", "word": "DELTA_BYTE_ARRAY", "date": "DELTA_BINARY_PACKED"}
    pq.write_table(table, place, use_dictionary=False, column_encoding=kinds, write_page_checksum=True)
    check_parquet(place)
    pq.write_table(table.slice(0, 0), place)
    check_parquet(place)
    assert len(read_table(place, "give a table")) == 0


@pytest.mark.parametrize(
    "options", [{}, {"compression": "uncompressed"}, {"row_group_size": 100, "data_page_size": 64}]
)
def test_what_polars_writes_is_let_through(table, tmp_path, options):
    place = tmp_path / "table.parquet"
    frame = pl.from_arrow(table)
    frame.write_parquet(place, **options)
    check_parquet(place)
    assert read_table(place, "give a table").equals(frame)


@pytest.mark.parametrize("value", [-102, 2**30])
def test_counts_that_no_page_has_are_refused_before_they_end_the_process(tmp_path, value):
    """As the header of a page says it; Polars makes room for as many, and its process ends where there is none."""
    place = tmp_path / "log.parquet"
    frame = pl.DataFrame({"t": np.arange(101) / 100.0, "q1": np.arange(101.0), "tau1": np.arange(101.0)})
    frame.write_parquet(place, statistics=False, compression="uncompressed")
    content = place.read_bytes()
    header = bytes([0x15, 0]) + b"\x15"  # field 1, i32: a page of data; field 2: its size
    assert content[4:7] == header
    count = bytes([0x15, 2 * 101 & 0x7F | 0x80, 2 * 101 >> 7])
    where = content.index(count, 4)
    place.write_bytes(content[:where] + b"\x15" + _varint(2 * value if value >= 0 else -2 * value - 1)
                      + content[where + 3 :])  # fmt: skip
    for read in (check_parquet, Recording.read, lambda path: read_table(path, "give a table")):
        with pytest.raises(InputError, match=r"log\.parquet cannot be read as Parquet: .*; save it again\."):
            read(place)


@pytest.mark.parametrize("plaintext_footer", [True, False])
def test_encrypted_columns_are_not_called_damaged(table, tmp_path, plaintext_footer):
    encryption = pytest.importorskip("pyarrow.parquet.encryption")

    class Keys(encryption.KmsClient):
        """Keys that are wrapped in nothing but letters."""

        def wrap_key(self, key, name):
            return base64.b64encode(key)

    place = tmp_path / "table.parquet"
    keys = encryption.EncryptionConfiguration("key", column_keys={"other": ["q"]}, plaintext_footer=plaintext_footer)
    factory = encryption.CryptoFactory(lambda _: Keys())
    options = factory.file_encryption_properties(encryption.KmsConnectionConfig(), keys)
    pq.write_table(table.select(["t", "q"]), place, encryption_properties=options)
    check_parquet(place)
    with pytest.raises(InputError, match="ncrypt"):
        read_table(place, "Save it.")


def test_damaged_footers_are_refused(table, tmp_path):
    place = tmp_path / "table.parquet"
    pq.write_table(table, place)
    content = place.read_bytes()
    length = int.from_bytes(content[-8:-4], "little")
    random = np.random.default_rng(1)
    refused = 0
    for _ in range(300):
        other = bytearray(content)
        other[int(random.integers(len(content) - 8 - length, len(content) - 8))] = int(random.integers(256))
        place.write_bytes(other)
        try:
            check_parquet(place)
        except InputError:
            refused += 1
    assert 10 < refused < 300
    # A list of a thousand million numbers of eight bytes each, and structs in structs.
    for footer in (b"\x49\xf7" + _varint(10**9) + b"\x00" * 8, b"\x1c" * 100_000):
        place.write_bytes(b"PAR1" + footer + len(footer).to_bytes(4, "little") + b"PAR1")
        with pytest.raises(InputError, match="its metadata is damaged"):
            check_parquet(place)


def _varint(value):
    found = bytearray()
    while value > 0x7F:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*found, value])


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_full_disk_is_told_by_the_system(suffix):
    with open("/dev/full", "wb") as full, pytest.raises(OSError, match="No space left on device") as caught:
        write_table(pl.DataFrame({"q1": np.arange(1e5)}), full, suffix)
    assert caught.value.errno == errno.ENOSPC
