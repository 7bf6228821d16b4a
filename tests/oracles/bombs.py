"""Bags of a few kB that ask for gigabytes or hours, made byte by byte."""

from __future__ import annotations

import bz2
import contextlib
import sqlite3
import struct
from collections.abc import Callable, Sequence
from pathlib import Path

JOINT_STATE = "float64[] position\nstring[] name\n"
IDL = (
    'module x {{ module msg {{ const long a = {}; @verbatim (language="comment", text="(not (this))") // or ((this))\n'
    "struct JointState {{ sequence<double> position; sequence<string> name; }}; }}; }};"
)
STATES = "sensor_msgs/msg/JointState"
EMPTY = struct.pack("<II", 0, 0)
"""A message of this definition that names no joint, as ROS 1 writes it; it is passed over."""
STATE = struct.pack("<IdI", 1, 0.5, 1) + struct.pack("<I", 1) + b"a"
STATE2 = b"\0\1\0\0" + struct.pack("<IIIxxxxII2sxxIdII", 5, 0, 1, 1, 2, b"a", 1, 0.5, 0, 0)
"""A message of `STATES` as ROS 2 writes it."""
LARGE, MILLIONS = 6 * 10**8, 2 * 10**8
"""Bytes of nothing, and of messages of 31 bytes or more, from each of which a library makes objects of some hundred."""


def lz4(data: bytes) -> bytes:
    import lz4.frame

    return bytes(lz4.frame.compress(data))


def zstd(data: bytes) -> bytes:
    from backports import zstd

    return bytes(zstd.compress(data))


PACK: dict[str, Callable[[bytes], bytes]] = {"lz4": lz4, "zstd": zstd, "bz2": bz2.compress, "": bytes, "none": bytes}


# MCAP

MAGIC = b"\x89MCAP0\r\n"


def record(kind: int, *parts: bytes) -> bytes:
    content = b"".join(parts)
    return struct.pack("<BQ", kind, len(content)) + content


def text(content: str | bytes) -> bytes:
    data = content.encode() if isinstance(content, str) else content
    return struct.pack("<I", len(data)) + data


HEAD = MAGIC + record(1, text("ros2"), text(""))


def schema(definition: str = JOINT_STATE, language: str = "ros1msg") -> bytes:
    return record(3, struct.pack("<H", 1), text("x/msg/JointState"), text(language), text(definition))


def channel(number: int = 1, topic: str = "/joint_states", encoding: str = "ros1") -> bytes:
    return record(4, struct.pack("<HH", number, 1), text(topic), text(encoding), text(b""))


def message(data: bytes = STATE, time: int = 5) -> bytes:
    return record(5, struct.pack("<HIQQ", 1, 0, time, time), data)


def chunk(packing: str, data: bytes, size: int | None = None) -> bytes:
    packed = PACK[packing](data)
    head = struct.pack("<QQQI", 5, 5, len(data) if size is None else size, 0) + text(packing)
    return record(6, head, struct.pack("<Q", len(packed)), packed)


def index(start: int, length: int, packing: str) -> bytes:
    head = struct.pack("<QQQQI", 5, 5, start, length, 0)
    return record(8, head, struct.pack("<Q", 0), text(packing), struct.pack("<QQ", 0, 0))


def statistics(count: int, channels: int = 1) -> bytes:
    counts = b"".join(struct.pack("<HQ", 1 + k, count) for k in range(channels))
    return record(11, struct.pack("<QHIIIIQQ", count, 1, channels, 0, 0, 1, 5, 5), text(counts))


def mcap(
    chunks: Sequence[bytes],
    packing: str,
    *,
    indexed: bool = True,
    times: int = 1,
    channels: Sequence[bytes] = (),
    definition: str = JOINT_STATE,
    language: str = "ros1msg",
    summary: int = 0,
) -> bytes:
    """Return a file of chunks, each of which stands in the index so many times."""
    known = schema(definition, language) + b"".join(channels or [channel()])
    content = HEAD + known
    indexes = b""
    for one in chunks:
        indexes += index(len(content), len(one), packing) * times
        content += one
    content += record(15, bytes(4))
    start = summary or len(content)
    if indexed:
        content += known + statistics(10**6, max(len(channels), 1)) + indexes
    return content + record(2, struct.pack("<QQI", start if indexed or summary else 0, 0, 0)) + MAGIC


# ROS 1


def fields(**values: bytes) -> bytes:
    return text(b"".join(text(name.encode() + b"=" + value) for name, value in values.items()))


def int32(value: int) -> bytes:
    return struct.pack("<I", value)


def message1(data: bytes = STATE, time: int = 0) -> bytes:
    return fields(op=b"\2", conn=int32(0), time=struct.pack("<II", 0, time)) + text(data)


def chunk1(packing: str, data: bytes) -> bytes:
    return fields(op=b"\5", compression=packing.encode(), size=int32(len(data))) + text(PACK[packing](data))


def ros1(
    chunks: Sequence[bytes], entries: Sequence[Sequence[tuple[int, int]]], *, times: int = 1, definition: str = ""
) -> bytes:
    """Return a bag of chunks, in which messages are found at times in ns and places; listed so many times."""
    content = b"#ROSBAG V2.0\n" + fields(op=b"\3", index_pos=bytes(8), conn_count=bytes(4), chunk_count=bytes(4))
    begin = len(content)
    content += text(b" " * 100)
    infos = b""
    for one, places in zip(chunks, entries, strict=True):
        infos += times * (
            fields(
                op=b"\6",
                ver=int32(1),
                chunk_pos=struct.pack("<Q", len(content)),
                start_time=bytes(8),
                end_time=bytes(8),
                count=int32(1),
            )
            + text(struct.pack("<II", 0, len(places)))
        )
        listed = b"".join(struct.pack("<III", 0, time, place) for time, place in places)
        content += one + fields(op=b"\4", ver=int32(1), conn=int32(0), count=int32(len(places))) + text(listed)
    connection = fields(op=b"\7", conn=int32(0), topic=b"/joint_states") + fields(
        topic=b"/joint_states",
        type=b"x/JointState",
        md5sum=b"*",
        message_definition=(definition or JOINT_STATE).encode(),
    )
    head = fields(
        op=b"\3",
        index_pos=struct.pack("<Q", len(content)),
        conn_count=int32(1),
        chunk_count=int32(len(chunks) * times),
    )
    return b"#ROSBAG V2.0\n" + head + content[begin:] + connection + infos


# ROS 2


def sqlite(path: Path, messages: Sequence[bytes] = (), tables: str = "") -> Path:
    database = sqlite3.connect(path)
    database.executescript(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, "
        "offered_qos_profiles TEXT);"
        + (tables or "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);")
    )
    database.execute("INSERT INTO topics VALUES(1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr', '')")
    if not tables:
        database.executemany("INSERT INTO messages VALUES(NULL, 1, 5, ?)", [(data,) for data in messages])
    database.commit()
    database.close()
    return path


def searched(path: Path) -> Path:
    """Write a database in which each of many messages is found only by looking at all of them."""
    tables = "CREATE TABLE messages(id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB);"
    sqlite(path, tables=tables)
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.executemany("INSERT INTO messages VALUES(?, 1, 5, ?)", [(k, STATE2) for k in range(9000)])
        database.commit()
    return path


def shared_pages(path: Path) -> Path:
    """Write a database whose table of messages has five levels, each of one page that names the next 580 times.

    See https://www.sqlite.org/fileformat.html, 1.6.
    """
    sqlite(path, [STATE])
    with contextlib.closing(sqlite3.connect(path)) as database:
        [(number,)] = database.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'")
        [(size,)] = database.execute("PRAGMA page_size")
    data = path.read_bytes()
    root = slice(size * (number - 1), size * number)
    page = data[root]
    for _ in range(4):
        data += page
        below = struct.pack(">I", len(data) // size)
        cell, many = below + b"\1", 580
        start = size - len(cell) * many
        places = struct.pack(f">{many}H", *range(start, size, len(cell)))
        head = struct.pack(">BHHHB", 5, 0, many, start, 0) + below
        page = (head + places).ljust(start, b"\0") + cell * many
    data = data[: root.start] + page + data[root.stop :]
    path.write_bytes(data[:28] + struct.pack(">I", len(data) // size) + data[32:])
    return path


def described(
    folder: Path, names: Sequence[str], mode: str, storage: str = "sqlite3", more: str = "", kind: str = STATES
) -> Path:
    files = "".join(f"\n    - {name}" for name in names)
    (folder / "metadata.yaml").write_text(
        f"{more}rosbag2_bagfile_information:\n  version: 4\n  storage_identifier: {storage}\n  duration:\n"
        "    nanoseconds: 0\n  starting_time:\n    nanoseconds_since_epoch: 0\n  message_count: 1\n"
        "  topics_with_message_count:\n    - topic_metadata:\n        name: /joint_states\n"
        f"        type: {kind}\n        serialization_format: cdr\n"
        "        offered_qos_profiles: ''\n      message_count: 1\n"
        f"  compression_format: {'zstd' if mode else chr(39) * 2}\n  compression_mode: {mode.upper() or 'NONE'}\n"
        f"  relative_file_paths:{files}\n"
    )
    return folder


def of_one_file(place: Path, mode: str) -> Path:
    """Write a bag of a file or a message of gigabytes."""
    place.mkdir()
    zeros = zstd(bytes(LARGE))
    sqlite(place / "bag.db3", [zeros] if mode == "message" else [])
    if mode == "file":
        with (place / "bag.db3.zstd").open("wb") as file:
            file.write(zstd((place / "bag.db3").read_bytes()))
            file.writelines([zeros] * 8)
        (place / "bag.db3").unlink()
        return described(place, ["bag.db3.zstd"], mode)
    return described(place, ["bag.db3"], mode)


def of_one_name(place: Path) -> Path:
    place.mkdir()
    sqlite(place / "bag.db3")
    (place / "bag.db3.zstd").write_bytes(zstd((place / "bag.db3").read_bytes() + bytes(10**8)))
    return described(place, ["bag.db3.zstd"] * 200, "file")


def of_aliases(place: Path) -> Path:
    place.mkdir()
    sqlite(place / "bag.db3")
    lines = "".join(f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]\n" for k in range(1, 40))
    return described(place, ["bag.db3"], "", "*a39", more="a0: &a0 [x]\n" + lines)


def of_merges(place: Path) -> Path:
    place.mkdir()
    sqlite(place / "bag.db3")
    lines = "".join(f"a{k}: &a{k} {{<<: [*a{k - 1}, *a{k - 1}]}}\n" for k in range(1, 40))
    return described(place, ["bag.db3"], "", more="a0: &a0 {x: 1}\n" + lines)


def in_folder(place: Path, content: bytes, mode: str = "") -> Path:
    """Write a bag of ROS 2 that is stored as MCAP without an index."""
    place.mkdir()
    known = {"channels": [channel(encoding="cdr")], "language": "ros2msg", "indexed": False}
    (place / "bag.mcap").write_bytes(mcap([content], "", **known))
    return described(place, ["bag.mcap"], mode, "mcap", kind="x/msg/JointState")


def written(place: Path, content: bytes) -> Path:
    place.write_bytes(content)
    return place


def messages(size: int) -> bytes:
    one = message()
    return one * (size // len(one))


def many_joints(first: int) -> bytes:
    """Return a message of joints, each order of which is kept with room for a thousand messages."""
    names = b"".join(text(f"{(first + k) % 3000}") for k in range(3000))
    return message(int32(3000) + bytes(8 * 3000) + int32(3000) + names)


def lying(content: bytes) -> bytes:
    """Return a bag of ROS 1 whose chunk states another size than its own."""
    return content.replace(b"size=" + int32(LARGE), b"size=" + int32(5000))


def alternating(packing: str) -> bytes:
    """Return a bag of two chunks whose messages alternate; a reader that holds one chunk unpacks each 2000 times."""
    times = [range(which, 4000, 2) for which in range(2)]
    data = [b"".join(message1(STATE, time) for time in each) for each in times]
    places = [[(time, k * len(message1())) for k, time in enumerate(each)] for each in times]
    return ros1([chunk1(packing, each + bytes(3 * 10**7)) for each in data], places)


def headed() -> bytes:
    """Return a bag of one message, which is asked for 7000 times, with 13 000 empty fields in its header."""
    known = (b"op=\2", b"conn=" + int32(0), b"time=" + bytes(8))
    header = b"".join(map(text, known)) + text(b"=") * 13_000
    return ros1([chunk1("bz2", text(header) + text(STATE))], [[(0, 0)] * 7000])


Bombs = dict[str, Callable[[Path], Path]]
BOMBS: Bombs = {
    # One chunk of gigabytes, that says so or not, with an index or without.
    "honest_lz4.mcap": lambda place: written(place, mcap([chunk("lz4", messages(MILLIONS))], "lz4")),
    "honest_zstd.mcap": lambda place: written(place, mcap([chunk("zstd", messages(MILLIONS))], "zstd")),
    "lying_lz4.mcap": lambda place: written(
        place, mcap([chunk("lz4", messages(MILLIONS), 5000)], "lz4", indexed=False)
    ),
    "lying_zstd.mcap": lambda place: written(place, mcap([chunk("zstd", messages(MILLIONS), 5000)], "zstd")),
    "unindexed_zstd.mcap": lambda place: written(
        place, mcap([chunk("zstd", messages(MILLIONS))], "zstd", indexed=False)
    ),
    # Chunks that are no larger than others, of messages by the million, or one chunk again and again.
    "messages.mcap": lambda place: written(place, mcap([chunk("zstd", messages(10**8))], "zstd")),
    "chunks.mcap": lambda place: written(place, mcap([chunk("zstd", messages(3 * 10**7))] * 20, "zstd")),
    "overlapping.mcap": lambda place: written(
        place, mcap([chunk("zstd", message(bytes(50_000), time=9) * 600)] * 50, "zstd")
    ),
    "again.mcap": lambda place: written(place, mcap([chunk("zstd", record(99, bytes(10**8)))], "zstd", times=300)),
    "channels.mcap": lambda place: written(
        place,
        mcap(
            [chunk("zstd", record(99, bytes(10**8)))],
            "zstd",
            channels=[channel(1 + k, f"/{k}") for k in range(400)],
        ),
    ),
    "in_summary.mcap": lambda place: written(
        place, mcap([chunk("zstd", messages(MILLIONS))], "zstd", indexed=False, summary=len(HEAD))
    ),
    # What the messages say.
    "objects.mcap": lambda place: written(
        place,
        mcap(
            [chunk("zstd", message(b"[" + b"{}," * (4 * 10**7) + b"{}]"))],
            "zstd",
            channels=[channel(encoding="json")],
        ),
    ),
    "empty_fields.mcap": lambda place: written(
        place,
        mcap(
            [chunk("", message(int32(10**9) + EMPTY))],
            "",
            definition=f"Empty[] a\n{JOINT_STATE}{'=' * 80}\nMSG: x/Empty\n",
        ),
    ),
    "names.mcap": lambda place: written(place, mcap([chunk("zstd", b"".join(map(many_joints, range(30))))], "zstd")),
    "brackets.mcap": lambda place: written(
        place, mcap([message()], "", indexed=False, definition=IDL.format("(" * 9 + "1" + ")" * 9), language="ros2idl")
    ),
    "shifts.mcap": lambda place: written(
        place, mcap([message()], "", indexed=False, definition=IDL.format("1 << 1 << 34"), language="ros2idl")
    ),
    "comments.mcap": lambda place: written(
        place, mcap([message()], "", indexed=False, definition=IDL.format("1") + "/* " * 60_000, language="ros2idl")
    ),
    # ROS 1
    "honest_lz4.bag": lambda place: written(place, ros1([chunk1("lz4", bytes(LARGE))], [[(0, 0)]])),
    "honest_bz2.bag": lambda place: written(place, ros1([chunk1("bz2", bytes(LARGE))], [[(0, 0)]])),
    "lying_lz4.bag": lambda place: written(place, lying(ros1([chunk1("lz4", bytes(LARGE))], [[(0, 0)]]))),
    "lying_bz2.bag": lambda place: written(place, lying(ros1([chunk1("bz2", bytes(LARGE))], [[(0, 0)]]))),
    "alternating_bz2.bag": lambda place: written(place, alternating("bz2")),
    "alternating_lz4.bag": lambda place: written(place, alternating("lz4")),
    "header.bag": lambda place: written(place, headed()),
    "again_bz2.bag": lambda place: written(
        place,
        ros1(
            [chunk1("bz2", message1(STATE + int32(10**7) + bytes(8 * 10**7)))],
            [[(0, 0)] * 5000],
            definition=f"{JOINT_STATE}float64[] x\n",
        ),
    ),
    "index.bag": lambda place: written(place, ros1([chunk1("none", message1())], [[(0, 0)] * 20_000], times=2000)),
    "empty_fields.bag": lambda place: written(
        place,
        ros1(
            [chunk1("none", message1(int32(10**9) + EMPTY))],
            [[(0, 0)]],
            definition=f"Empty[] a\n{JOINT_STATE}{'=' * 80}\nMSG: x/Empty\n",
        ),
    ),
    # ROS 2
    "file": lambda place: of_one_file(place, "file"),
    "message": lambda place: of_one_file(place, "message"),
    "one_name": of_one_name,
    "merges": of_merges,
    "aliases": of_aliases,
    "folder_zstd": lambda place: in_folder(place, chunk("zstd", messages(2 * MILLIONS))),
    "folder_message": lambda place: in_folder(place, message(zstd(bytes(LARGE))), "message"),
    "computed.db3": lambda place: sqlite(
        place,
        tables="CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        "data BLOB GENERATED ALWAYS AS (zeroblob(900000000)));"
        "INSERT INTO messages VALUES(1, 1, 5), (2, 1, 5);",
    ),
    "shared_pages.db3": shared_pages,
    "searched.db3": searched,
    "endless.db3": lambda place: sqlite(
        place,
        tables="CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
        "CREATE VIEW message_definitions AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) "
        "SELECT x AS id, x AS topic_type, x AS encoding, count(*) AS encoded_message_definition FROM c;"
        "CREATE VIEW schema AS SELECT encoded_message_definition AS schema_version FROM message_definitions;",
    ),
}
"""What writes each, by its name."""
