"""The manifest of a fleet: which robots there are, where what is known of each lies, and when it was recorded."""

from __future__ import annotations

import contextlib
import datetime
import glob
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from steelyard.errors import InputError
from steelyard.files import TomlTable, read_table, read_toml, require_file, shown
from steelyard.files.arguments import LONGEST_NAME, is_name
from steelyard.identification.given import files_named, is_information

__all__ = ["FleetEntry", "FleetManifest"]

ROBOT_KEYS = ("id", "group", "date", "robot", "logs", "informations", "validate")
TOP_LEVEL = ("name", "robot", "table", "robots", "false_discovery_rate", "intervals")
LISTS = ("logs", "informations", "validate")
SEPARATOR = ";"
"""Between several paths in a cell of a table."""


@dataclass(frozen=True)
class FleetEntry:
    """One robot at one date, with its data.

    Attributes
    ----------
    id : str
        Such as its serial number.
    group : str
        Robots of one group are siblings: built alike, so that they should be alike.
    date : str
        In the form of ISO 8601, so that the order of texts is that of time; with a time zone in UTC, as ``+00:00``
        says; empty where there is none.
    robot : Path
        The description, or the robot.toml.
    logs, informations, validate : tuple of str
        Paths and patterns, as absolute ones, of logs (also folders and addresses of objects), of what logs were reduced
        to (what :meth:`steelyard.Information.save` wrote), and of logs, as before, or Informations that the fit does
        not see.
    where : str
        The place in the manifest, for messages.
    """

    id: str
    group: str
    date: str
    robot: Path
    logs: tuple[str, ...] = ()
    informations: tuple[str, ...] = ()
    validate: tuple[str, ...] = ()
    where: str = field(default="", compare=False)

    @property
    def label(self) -> str:
        """The robot, with its date where there is one."""
        return f"{self.id} ({self.date})" if self.date else self.id

    @property
    def gives_informations(self) -> bool:
        """Whether some of its data are Informations, so that their rows are not at hand."""
        return bool(self.informations) or any(is_information(path) for path in self.validate)

    def files(self, key: str) -> tuple[str, ...]:
        """Return the files of `informations` or `validate`, see `files_named`."""
        return files_named(getattr(self, key), f"correct {key} of {self.label} in the manifest")


@dataclass(frozen=True)
class FleetManifest:
    """Robots and their data, as a file in TOML, CSV or Parquet lists them.

    Attributes
    ----------
    path : Path
    name : str
        Of the fleet; that of the file by default.
    entries : tuple of FleetEntry
    table : Path or None
        The CSV or Parquet file that it names.
    false_discovery_rate : float
        At most this part of the robots that are said to differ, or to have drifted, does so by chance.
    intervals : {"base", "all"}
        Whether intervals are computed for base parameters alone, or for masses, centres of mass and so on as well,
        which takes a second for a robot.

    Examples
    --------
    >>> import tempfile
    >>> text = '''
    ... robot = "arm.urdf"
    ...
    ... [[robots]]
    ... id = "A-17"
    ... group = "line 3"
    ... date = 2026-03-01
    ... logs = ["A-17/*.csv"]
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "fleet.toml")
    ...     _ = path.write_text(text)
    ...     manifest = FleetManifest.load(path)
    >>> manifest.entries[0].label, manifest.entries[0].group
    ('A-17 (2026-03-01)', 'line 3')
    """

    path: Path
    name: str
    entries: tuple[FleetEntry, ...] = field(repr=False)
    table: Path | None = None
    false_discovery_rate: float = 0.05
    intervals: str = "base"

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> FleetManifest:
        """Read a manifest.

        Parameters
        ----------
        path : str or path
            TOML with ``robot`` and tables ``[[robots]]``, or ``table``, the path of a CSV or Parquet file with a row
            for each robot; or such a table itself, with a column ``robot``.

        Raises
        ------
        InputError
            If a key or a column is not known, a value does not fit, or a robot is there twice.
        """
        given = Path(path)
        require_file(given, "give the path of a manifest")
        if given.suffix.lower() in (".csv", ".parquet"):
            return cls._checked(given, given.stem, tuple(_rows(given, None)))
        content = TomlTable(read_toml(given, remedy="give a manifest in TOML"), str(given), TOP_LEVEL)
        shared = content.text("robot", "the path of a robot")
        robot = None if shared is None else _beside(given, shared)
        entries = [
            _entry(TomlTable(table, where, ROBOT_KEYS), given, robot) for where, table in content.tables("robots")
        ]
        table = content.text("table", "the path of a CSV or Parquet file")
        listed = None if table is None else Path(_beside(given, table))
        if listed is not None:
            entries += _rows(listed, robot)
        rate = content.number("false_discovery_rate") if "false_discovery_rate" in content else 0.05
        if not 0.0 < rate < 1.0:
            raise content.refuse("false_discovery_rate", "a number between 0 and 1, such as 0.05")
        intervals = content.get("intervals", "base")
        if intervals not in ("base", "all"):
            raise content.refuse("intervals", '"base" or "all"')
        return cls._checked(given, content.text("name") or given.stem, tuple(entries), listed, rate, intervals)

    @classmethod
    def _checked(
        cls,
        path: Path,
        name: str,
        entries: tuple[FleetEntry, ...],
        table: Path | None = None,
        rate: float = 0.05,
        intervals: str = "base",
    ) -> FleetManifest:
        if not entries:
            raise InputError(f"{path} names no robots; give [[robots]], one table each, or `table`, a CSV file.")
        taken: dict[tuple[str, str], FleetEntry] = {}
        groups: dict[str, FleetEntry] = {}
        undated: dict[str, FleetEntry] = {}
        zoned: dict[tuple[str, bool], FleetEntry] = {}
        for one in entries:
            before = taken.setdefault((one.id, one.date), one)
            if before is not one:
                when = f"on {one.date}" if one.date else "without a date"
                raise InputError(
                    f"{one.where}: robot {shown(one.id)} is there twice {when}, first in {before.where}; name all its "
                    "logs in one place, or give dates."
                )
            if not one.date:
                undated[one.id] = one
            if "T" in one.date:
                zoned[one.id, _has_zone(one.date)] = one
                other = zoned.get((one.id, not _has_zone(one.date)))
                if other is not None:
                    here, there = ("a", "none") if _has_zone(one.date) else ("no", "one")
                    raise InputError(
                        f"{one.where}: the time of robot {shown(one.id)} has {here} time zone, and {there} in "
                        f"{other.where}, so that nobody knows which was first; give all or none of them a zone."
                    )
            first = groups.setdefault(one.id, one)
            if first.group != one.group:
                raise InputError(
                    f"{one.where}: robot {shown(one.id)} is in the group {shown(one.group)}, and in "
                    f"{shown(first.group)} in {first.where}; give the same group."
                )
        for one in entries:
            if one.date and one.id in undated:
                raise InputError(
                    f"{undated[one.id].where}: robot {shown(one.id)} has no date here, but has one in {one.where}; "
                    "give all of its dates."
                )
        return cls(path, name, entries, table, rate, intervals)


def _beside(file: Path, path: str, *, pattern: bool = False) -> str:
    """A path of a file, as an absolute one; it counts from the folder of the file. Addresses stay as they are."""
    if "://" in path:
        return path
    given = os.path.expanduser(path)
    plain = os.path.abspath(os.path.join(file.parent, given))
    if not pattern or os.path.exists(plain):
        return plain
    if "+" in path and not glob.has_magic(path) and all(parts := path.split("+")):  # a log of several files
        return "+".join(_beside(file, part.strip(), pattern=True) for part in parts)
    # `*`, `?` and `[` in the name of the manifest's own folder belong to no pattern.
    return os.path.abspath(os.path.join(glob.escape(str(file.parent)), given))


def _entry(table: TomlTable, file: Path, shared: str | None) -> FleetEntry:
    table.require("id")
    identity = table["id"]
    if isinstance(identity, int) and not isinstance(identity, bool):
        identity = str(identity)
    if not isinstance(identity, str) or not is_name(identity.strip()):
        raise table.refuse("id", f"a text of one line and at most {LONGEST_NAME} letters, such as a serial number")
    robot = table.text("robot", "the path of a robot")
    if robot is None and shared is None:
        raise InputError(f"{table.where} lacks 'robot', and the manifest names none for all; give the path of one.")
    # A path that is there again is the same data: no log counts twice.
    lists = {key: tuple(dict.fromkeys(_beside(file, one, pattern=True) for one in table.texts(key))) for key in LISTS}
    if not lists["logs"] and not lists["informations"]:
        raise InputError(f"{table.where} has neither logs nor informations; give the paths of some.")
    if lists["logs"] and lists["informations"]:
        raise InputError(f"{table.where} has logs and informations; give one of them, so that no data counts twice.")
    return FleetEntry(
        identity.strip(),
        table.text("group") or "",
        _date(table),
        Path(shared if robot is None else _beside(file, robot)),  # type: ignore[arg-type]
        **lists,
        where=table.where,
    )


def _date(table: TomlTable) -> str:
    value = table.get("date")
    if value is None:
        return ""
    expected = "a date such as 2026-03-01, or a date with a time"
    try:
        if isinstance(value, datetime.datetime):
            found = value
        elif isinstance(value, datetime.date):
            return value.isoformat()
        elif isinstance(value, str):
            with contextlib.suppress(ValueError):  # also 20260301, which is the same day
                return datetime.date.fromisoformat(value).isoformat()
            found = datetime.datetime.fromisoformat(value)
        else:
            raise table.refuse("date", expected)
        # Times of different zones follow each other as their texts do, which say that they are in UTC.
        return (found if found.tzinfo is None else found.astimezone(datetime.UTC)).isoformat()
    except InputError:
        raise
    except (OverflowError, ValueError):  # a zone may lead beyond the years that there are
        raise table.refuse("date", expected) from None


def _has_zone(date: str) -> bool:
    return date.endswith("+00:00")


def _rows(path: Path, shared: str | None) -> Iterator[FleetEntry]:
    """Yield what the rows of a table say; empty cells say nothing."""
    frame = read_table(path, "correct `table` in the manifest", text=True)
    TomlTable(dict.fromkeys(frame.columns), str(path), ROBOT_KEYS, "is no column of a manifest")
    for number, row in enumerate(frame.iter_rows(named=True), start=1):
        yield _entry(TomlTable(_cells(row), f"{path}, row {number}", ROBOT_KEYS), path, shared)


def _cells(row: Mapping[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in row.items():
        if value is None or value == "":
            continue
        if key in LISTS and isinstance(value, str):
            value = [part.strip() for part in value.split(SEPARATOR) if part.strip()]
        found[key] = value
    return found
