"""Bags of ROS 2."""

from __future__ import annotations

import contextlib
import sqlite3
import tempfile
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import quote

from steelyard.errors import require_package
from steelyard.files import shown

from .decoded import large_files
from .mcap_file import McapMessages
from .message_log import MessageLog, Topic
from .ros_messages import ros_decoder
from .unpacking import AT_ONCE, BAGS, RECORD, ZSTD, Unpacking

__all__ = ["Ros2Bag"]

NEWEST = 9
"""Version of the description of a bag that is known."""
DESCRIPTION = "metadata.yaml"
COPIED = 2**20
DEFINITIONS = "message_definitions"
TABLES = ("topics", "messages", DEFINITIONS)
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
                folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="steelyard-", dir=large_files()))
                paths = [_unpacked(path, Path(folder), unpacking) for path in paths]
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
        self._rows = 0
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, AT_ONCE)

    def topics(self) -> list[Topic]:
        """Return the topics, with what reads their messages as long as the database is open."""
        tables = self._tables()
        if not {"topics", "messages"} <= tables:
            raise ValueError("it has no tables of topics and messages")
        definitions = {}
        if DEFINITIONS in tables:  # since Iron
            definitions = {
                kind: (LANGUAGES.get(encoding, ""), text)
                for kind, encoding, text in self._database.execute(
                    f"SELECT topic_type, encoding, encoded_message_definition FROM {DEFINITIONS} ORDER BY id DESC"
                )
            }
        found: dict[tuple[str, str], dict[int, int]] = {}
        for number, name, kind, count in self._database.execute(
            "SELECT topics.id, name, type, count(messages.id) FROM topics LEFT JOIN messages "
            "ON topics.id == messages.topic_id GROUP BY topics.id ORDER BY topics.id"
        ):
            found.setdefault((name, kind), {})[number] = count
            self._rows += count
        return [
            Topic(
                name,
                kind,
                sum(counts.values()),
                partial(self._decoded, kind, definitions.get(kind, ("", "")), list(counts)),
            )
            for (name, kind), counts in found.items()
        ]

    def _tables(self) -> set[str]:
        """Return the tables that are there; what is computed in reading them could have no end."""
        found = set()
        for name, statement in self._database.execute("SELECT lower(name), sql FROM sqlite_master").fetchall():
            if name not in TABLES:
                continue
            columns = self._database.execute(f"PRAGMA table_xinfo({name})").fetchall()
            if not statement.startswith("CREATE TABLE") or any(hidden for *_, hidden in columns):
                raise ValueError(f"its table {name} is computed, not recorded")
            found.add(name)
        return found

    def _decoded(self, kind: str, definition: tuple[str, str], numbers: Sequence[int]) -> Iterator[tuple[int, Any]]:
        decode = ros_decoder(kind, *definition, self._unpacking, ros1=False)
        self._unpacking.spend(RECORD * self._rows)  # all are looked at, for each topic
        places = ", ".join("?" * len(numbers))
        query = f"SELECT timestamp, data FROM messages WHERE topic_id IN ({places}) ORDER BY timestamp"
        for recorded, packed in self._database.execute(query, numbers):
            data = self._unpacking.unpacked(self._compression, packed)
            if self._unpacking.takes(data):
                yield recorded, decode(data)
