"""Bags of ROS 2."""

from __future__ import annotations

import contextlib
import sqlite3
from array import array
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import quote

import numpy as np

from steelyard.errors import InputError, require_package
from steelyard.files import shown
from steelyard.files.arguments import all_listed
from steelyard.files.writing import temporary_folder

from .decoded import large_files
from .mcap_file import McapMessages
from .message_log import MessageLog, Topic
from .ros_messages import ros_decoder
from .unpacking import AT_ONCE, BAGS, MESSAGE, RECORD, ZSTD, Unpacking

__all__ = ["Ros2Bag"]

NEWEST = 9
"""Version of the description of a bag that is known."""
DESCRIPTION = "metadata.yaml"
COPIED = 2**20
DEFINITIONS = "message_definitions"
TABLES = {
    "topics": ("id", "name", "type"),
    "messages": ("id", "topic_id", "timestamp", "data"),
    DEFINITIONS: ("id", "topic_type", "encoding", "encoded_message_definition"),
}
"""The first columns of the tables that are read; before them none may stand that is passed over in each row."""
LONGEST_SCHEMA = 2**16
"""Bytes of what describes a table."""
STEPS = 100
"""Steps of SQLite, which take as long as a message: a database of a few pages may have rows without end."""
LANGUAGES = {"ros2msg": "msg", "ros2idl": "idl"}


class Ros2Bag(MessageLog):
    """A bag of ROS 2: its folder, with files of SQLite or MCAP, or one file of SQLite."""

    kind = "a bag of ROS 2"
    remedy = "mend it with `ros2 bag reindex`, or record it again"

    @contextlib.contextmanager
    def _opened(self) -> Iterator[list[Topic]]:
        storage, mode, paths = _described(self.path) if self.path.is_dir() else ("sqlite3", "", [self.path])
        unpacking = Unpacking(self.path, sum(path.stat().st_size for path in paths))
        compression = "zstd" if mode == "message" else ""
        found: dict[tuple[str, str], list[Topic]] = {}
        with contextlib.ExitStack() as stack:
            if mode == "file":
                folder = stack.enter_context(temporary_folder(large_files() / "steelyard-bag"))
                paths = [_unpacked(path, folder, unpacking) for path in paths]
            for path in paths:
                if storage == "mcap":
                    topics = McapMessages(stack.enter_context(path.open("rb")), unpacking, compression).topics()
                else:
                    address = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
                    database = stack.enter_context(contextlib.closing(sqlite3.connect(address, uri=True)))
                    topics = _Database(database, unpacking, compression).topics()
                for topic in topics:
                    found.setdefault((topic.name, topic.kind), []).append(topic)
            yield [
                Topic(name, kind, sum(part.count for part in parts), partial(_joined, parts), parts[0].may_hold_joints)
                for (name, kind), parts in found.items()
            ]


def _joined(parts: Sequence[Topic]) -> Iterator[tuple[int, Any]]:
    for part in parts:
        yield from part.messages()


def _described(folder: Path) -> tuple[str, str, list[Path]]:
    """Return how the files of a bag are stored and compressed, and which they are, in their order."""
    yaml = require_package("ruamel.yaml", "Bags are read with the module", BAGS).YAML(typ="safe", pure=True)
    yaml.constructor.flatten_mapping = _refuse_merging
    described = yaml.load((folder / DESCRIPTION).read_text(encoding="utf-8"))
    try:
        content = described["rosbag2_bagfile_information"]
        version, storage = content["version"], content["storage_identifier"].lower()
        mode, packed_by = ((content.get(f"compression_{key}") or "none").lower() for key in ("mode", "format"))
        names = [PurePath(name).name for name in content["relative_file_paths"]]
        if version > NEWEST:
            raise ValueError(f"its version {version} is not known")
    except KeyError as key:
        raise ValueError(f"its {DESCRIPTION} has no {key}") from None
    except (TypeError, AttributeError):
        raise ValueError(f"its {DESCRIPTION} is not that of a bag") from None
    if storage not in ("sqlite3", "mcap"):
        raise ValueError(f"it is stored as {shown(storage)}, not as sqlite3 or mcap")
    if mode not in ("none", "file", "message") or (mode != "none" and packed_by != "zstd"):
        raise ValueError(f"its {shown(mode)} are compressed by {shown(packed_by)}, not by zstd")
    if len(set(names)) < len(names):
        raise ValueError(f"its {DESCRIPTION} names a file twice")
    missing = next((name for name in names if not (folder / name).is_file()), None)
    if missing is not None:
        raise ValueError(f"its file {shown(missing)} is not there")
    return storage, mode, [folder / name for name in names]


def _refuse_merging(node: Any) -> None:
    """Keep a few lines of YAML from standing for millions: merged mappings may merge others, twice each."""
    if any(str(key.tag) == "tag:yaml.org,2002:merge" for key, _ in node.value):
        raise ValueError(f"its {DESCRIPTION} merges mappings")


def _unpacked(path: Path, folder: Path, unpacking: Unpacking) -> Path:
    """Unpack a file of a bag into a folder."""
    library = require_package(ZSTD, "Compressed bags are read with the module", BAGS)
    target = folder / path.name
    with path.open("rb") as packed, library.open(packed, "rb") as source, target.open("wb") as file:
        while part := source.read(COPIED):
            unpacking.spend(len(part))
            file.write(part)
    return target


class _Database:
    """The messages of an open database.

    Parameters
    ----------
    database : sqlite3.Connection
    unpacking : Unpacking
    compression : str
        How each message is packed.
    """

    def __init__(self, database: sqlite3.Connection, unpacking: Unpacking, compression: str) -> None:
        self._database, self._unpacking, self._compression = database, unpacking, compression
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST_SCHEMA)
        database.set_progress_handler(self._step, STEPS)

    def _step(self) -> bool:
        """Return whether SQLite must stop."""
        try:
            self._unpacking.spend(MESSAGE)
        except InputError:
            return True
        return False

    @contextlib.contextmanager
    def _bounded(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.OperationalError:
            self._unpacking.spend(0)  # says why SQLite was stopped, if it was
            raise

    def _rows(self, query: str) -> Iterator[tuple[Any, ...]]:
        """Yield what a query finds."""
        with self._bounded():
            for row in self._database.execute(query):
                self._unpacking.spend(RECORD + sum(len(one) for one in row if isinstance(one, str | bytes)))
                yield row

    def topics(self) -> list[Topic]:
        """Return the topics, with what reads their messages as long as the database is open."""
        tables = self._tables()
        if not {"topics", "messages"} <= tables:
            raise ValueError("it has no tables of topics and messages")
        # SQLite orders nothing: it would put all that the rows hold into temporary files first.
        definitions: dict[str, tuple[str, str]] = {}
        if DEFINITIONS in tables:  # since Iron
            for kind, encoding, text in self._rows(
                f"SELECT topic_type, encoding, encoded_message_definition FROM {DEFINITIONS}"
            ):
                definitions.setdefault(kind, (LANGUAGES.get(encoding, ""), text))
        recorded: dict[int, tuple[array[int], array[int]]] = {}
        for number, topic, time in self._rows("SELECT id, topic_id, timestamp FROM messages NOT INDEXED"):
            if not type(number) is type(topic) is type(time) is int:
                raise ValueError("its messages have topics or times that are no whole numbers")
            times, places = recorded.setdefault(topic, (array("q"), array("q")))
            times.append(time)
            places.append(number)
        found: dict[tuple[str, str], list[tuple[array[int], array[int]]]] = {}
        for number, name, kind in self._rows("SELECT id, name, type FROM topics"):
            found.setdefault((name, kind), []).append(recorded.get(number, (array("q"), array("q"))))
        return [
            Topic(
                name,
                kind,
                sum(len(times) for times, _ in parts),
                partial(self._decoded, kind, definitions.get(kind, ("", "")), parts),
            )
            for (name, kind), parts in found.items()
        ]

    def _tables(self) -> set[str]:
        """Return the tables that are there; what is computed in reading them could have no end."""
        found = set()
        listed = list(self._rows("SELECT lower(name), sql FROM sqlite_master"))
        self._database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, AT_ONCE)
        for name, statement in listed:
            if name not in TABLES:
                continue
            columns = list(self._rows(f"PRAGMA table_xinfo({name})"))
            if not statement.startswith("CREATE TABLE") or any(hidden for *_, hidden in columns):
                raise ValueError(f"its table {name} is computed, not recorded")
            if tuple(column for _, column, *_ in columns)[: len(TABLES[name])] != TABLES[name]:
                raise ValueError(f"its table {name} does not begin with the columns {all_listed(TABLES[name])}")
            found.add(name)
        return found

    def _decoded(
        self, kind: str, definition: tuple[str, str], parts: Sequence[tuple[array[int], array[int]]]
    ) -> Iterator[tuple[int, Any]]:
        decode = ros_decoder(kind, *definition, self._unpacking, ros1=False)
        times, places = (np.concatenate([np.frombuffer(part[k], np.int64) for part in parts]) for k in (0, 1))
        order = np.lexsort((places, times))
        cursor, query = self._database.cursor(), "SELECT data FROM messages WHERE id = ?"
        with self._bounded():
            for time, place in zip(times[order].tolist(), places[order].tolist(), strict=True):
                (packed,) = cursor.execute(query, (place,)).fetchone()
                data = self._unpacking.unpacked(self._compression, packed)
                if self._unpacking.takes(data):
                    yield time, decode(data)
