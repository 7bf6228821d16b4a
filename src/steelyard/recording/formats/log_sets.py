"""Sets of logs: folders, patterns such as ``logs/**/*.parquet``, partitioned data sets, and object stores."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from steelyard.errors import InputError
from steelyard.files.arguments import by_name

from .log_file import COMPRESSED, TEXTS
from .registry import LOG_FORMATS
from .remote import object_address, object_store

__all__ = ["is_log_set", "logs_in", "place_of"]

_ADDRESS = re.compile(r"([a-z][a-z0-9+.-]*)://(.*)", re.DOTALL)
_MAGIC = re.compile(r"[*?\[]")
_DEEP = re.compile(rf"(?:^|(?<=[{re.escape('/' + os.sep)}]))\*\*(?:[{re.escape('/' + os.sep)}]+|$)")
_ABOUT, _INFO = "meta", "info.json"
"""Where LeRobot describes a data set, in tables that are no logs."""
_RESULTS = {
    "parameters.csv": "run.json",
    "simulation.csv": "simulation.json",
    **dict.fromkeys(("trajectory.csv", "trajectory.parquet"), "excite.json"),
    **dict.fromkeys(("findings.parquet", "parameters.parquet", "robots.parquet"), "fleet.json"),
}
"""Tables that `identify`, `simulate`, `excite` and `fleet` write, and what stands beside each then: results may lie
among the logs, and a simulation of the robot that was found would confirm it."""
OTHER_COMPRESSIONS = ("7z", "br", "lz", "lz4", "lzo", "sz", "z")
ARCHIVES = ("7z", "rar", "tar", "tbz", "tgz", "txz", "zip")
"""Suffixes of files that may hold logs, and are not read; that they are passed over is told."""
LISTED = 5
MOST = 1_000_000
"""Logs of a set; a pattern that finds more was not meant."""


def is_log_set(text: str) -> bool:
    """Tell whether a path stands for other paths: a folder, a pattern, or an address in an object store.

    A folder that is a bag of ROS 2 is one log, and so is a file whose own name looks like a pattern.

    Examples
    --------
    >>> is_log_set("run1.csv"), is_log_set("logs/*.csv"), is_log_set("s3://bucket/run1.parquet")
    (False, True, True)
    """
    if _ADDRESS.match(text):
        return True
    if os.path.isdir(text):
        return not _is_bag(text)
    return bool(_MAGIC.search(text)) and not os.path.exists(text)


def logs_in(text: str, packed: list[str] | None = None) -> list[str]:
    """Return the logs of a set, in an order that follows from their names alone.

    Numbers in names count as numbers, so that ``run2.csv`` stands before ``run10.csv``. Files whose names, or whose
    folders, begin with a dot or an underscore are no logs, as in partitioned data sets
    (``robot=7/date=2026-11-22/part-0.parquet``), and neither are files whose suffix no format of logs has, what stands
    in the folder in which LeRobot describes a data set, nor the tables of earlier results unless the pattern ends with
    their name.

    Parameters
    ----------
    text : str
        A folder, which is searched with all folders inside; a pattern with ``*``, ``?``, ``[...]`` or ``**``; or an
        address such as ``s3://bucket/logs/*.parquet`` of an object, a folder of objects or a pattern.
    packed : list, optional
        Receives a sentence on files that look like logs in a form that is not read, such as ``run.csv.7z``, if there
        are any.

    Raises
    ------
    InputError
        If there is no log; or where what reads object stores is not installed, or fails.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name in ("run10.csv", "run2.csv", "notes.md"):
    ...     _ = (folder / name).write_text("t,q1,tau1")
    >>> [Path(log).name for log in logs_in(str(folder))]
    ['run2.csv', 'run10.csv']
    """
    suffixes = frozenset(LOG_FORMATS.names())  # asked for once: it takes milliseconds, see `Extensions`
    passed: list[str] = []
    files = (_objects_in if _ADDRESS.match(text) else _files_in)(text, suffixes, passed)
    told = _told_of_packed(text, sorted(dict.fromkeys(passed)))
    found = [name for name in files if os.path.basename(name) == os.path.basename(text) or not _is_result(name)]
    if len(found) > MOST:
        raise InputError(f"{text} stands for {len(found)} files; give a narrower pattern.")
    if not found:
        known = ", ".join(f".{suffix}" for suffix in LOG_FORMATS.names())
        remedy = told or f"give a folder with logs, or a pattern that finds some ({known})."
        raise InputError(f"{text} stands for no log; {remedy}")
    if told and packed is not None:
        packed.append(f"{text}: {told}")
    return sorted(found, key=lambda name: by_name(name.replace(os.sep, "\0")))


def place_of(log: str) -> str:
    """Return the real path of a log, or the address that its object has by itself: one log has one."""
    if not _ADDRESS.match(log):
        return os.path.realpath(log)
    place = object_address(*object_store(log), log)
    return os.path.realpath(place.removeprefix("file://")) if place.startswith("file:///") else place


def _files_in(text: str, suffixes: Collection[str], passed: list[str]) -> list[str]:
    if os.path.isdir(text):
        return [name for place, names in _folders(text) for name in _logs_at(place, names, suffixes, passed)]
    found: list[str] = []
    own = _named_like_a_pattern(text)
    rest = text[len(own) :]
    below = os.path.dirname(own + _fixed(rest))
    for name in dict.fromkeys(_matching(glob.escape(own) + rest)):
        if os.path.isdir(name) and not _is_bag(name):
            # `logs/*` means what is in a folder; `logs/**` finds each folder, and the files in it, by itself.
            continue
        if _is_log(name, suffixes, below):
            found.append(name)
        elif _is_packed(name, suffixes, below):
            passed.append(name)
    bags = {name for name in found if os.path.isdir(name)}
    return [name for name in found if os.path.dirname(name) not in bags]


def _named_like_a_pattern(text: str) -> str:
    """Return the longest folder at the beginning of a pattern that is there by that very name, such as ``run[1]``."""
    folder = os.path.dirname(text)
    while _MAGIC.search(folder):
        if os.path.isdir(folder):
            return folder
        folder = os.path.dirname(folder)
    return ""


def _matching(pattern: str) -> Iterator[str]:
    """Find files as `glob` does, but enter each folder once: links may make a folder endless."""
    deep = _DEEP.search(pattern)
    if deep is None:
        yield from glob.iglob(pattern)
        return
    before, behind = pattern[: deep.start()], pattern[deep.end() :]
    for top in glob.iglob(before) if before else [os.curdir]:
        for place, names in _folders(top):
            own = os.path.join(place, "")
            if not before:
                own = own.removeprefix(os.path.join(os.curdir, ""))
            if behind:
                yield from _matching(glob.escape(own) + behind)
            else:
                yield from (os.path.dirname(own), *(own + name for name in names))


def _folders(top: str) -> Iterator[tuple[str, list[str]]]:
    """Yield a folder and those inside it, also behind links, each once, with the names of what is in them but folders.

    A link to a folder that holds it is not followed. A bag counts as a folder with nothing inside.
    """

    def refuse(error: OSError) -> None:  # what is left out silently is missing in the answer
        raise InputError(f"{error.filename}: cannot be listed ({error.strerror}); give the right to read it.")

    seen: set[str] = set()
    for place, folders, names in os.walk(top, onerror=refuse, followlinks=True):
        real = os.path.realpath(place)
        holding = os.path.realpath(os.path.dirname(place)) if os.path.islink(place) and place != top else ""
        if real in seen or f"{holding}{os.sep}".startswith(f"{real.rstrip(os.sep)}{os.sep}"):
            folders.clear()
            continue
        seen.add(real)
        of_lerobot = _ABOUT in folders and os.path.isfile(os.path.join(place, _ABOUT, _INFO))
        folders[:] = sorted(
            name for name in folders if not name.startswith((".", "_")) and not (of_lerobot and name == _ABOUT)
        )
        if _is_bag(place):
            folders.clear()
        yield place, names


def _logs_at(place: str, names: Sequence[str], suffixes: Collection[str], passed: list[str]) -> list[str]:
    """Return the logs right in a folder, which may be one itself."""
    if _is_bag(place):
        return [str(Path(place))]
    passed += [str(Path(place, name)) for name in names if _is_packed(name, suffixes)]
    return [str(Path(place, name)) for name in names if _is_log(name, suffixes)]


def _objects_in(text: str, suffixes: Collection[str], passed: list[str]) -> list[str]:
    system, path = object_store(text)
    try:
        if _MAGIC.search(path) and not system.exists(path):
            names = [name for name, one in system.glob(path, detail=True).items() if one["type"] == "file"]
            below = os.path.dirname(_fixed(path))
        elif system.isdir(path):
            names, below = system.find(path), path
        elif system.exists(path):
            return [text]
        else:
            raise InputError(f"{text} does not exist; give the address of a log.")
    except InputError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"{text} cannot be listed ({reason}); check the address and who may read it.") from None
    about = tuple(f"{os.path.dirname(name)}/" for name in map(str, names) if name.endswith(f"/{_ABOUT}/{_INFO}"))
    logs = (str(name) for name in names if _is_log(str(name), suffixes, below) and not str(name).startswith(about))
    passed += [str(name) for name in names if _is_packed(str(name), suffixes, below)]
    return [object_address(system, name, text) for name in logs]


def _fixed(pattern: str) -> str:
    """Return the beginning of a pattern that is no pattern."""
    magic = _MAGIC.search(pattern)
    return pattern[: magic.start()] if magic else pattern


def _is_hidden(name: str, below: str) -> bool:
    parts = Path(name[len(below) :] if name.startswith(below) else name).parts
    return any(part.startswith((".", "_")) and part not in (".", "..") for part in parts)


def _suffixes(name: str) -> list[str]:
    return [suffix.lower().removeprefix(".") for suffix in Path(name).suffixes]


def _is_packed(name: str, known: Collection[str], below: str = "") -> bool:
    """Tell whether a file may hold a log in a form that is not read: another compression, or an archive."""
    *others, last = ["", *_suffixes(name)]
    if _is_hidden(name, below) or _is_log(name, known, below):
        return False
    return last in ARCHIVES or (last in (*COMPRESSED, *OTHER_COMPRESSIONS) and others[-1] in known)


def _told_of_packed(text: str, names: Sequence[str]) -> str:
    if not names:
        return ""
    listed = ", ".join(name.removeprefix(text).lstrip("/" + os.sep) or name for name in names[:LISTED])
    more = f" and {len(names) - LISTED} others" if len(names) > LISTED else ""
    one = len(names) == 1
    return (
        f"{listed}{more} {'was' if one else 'were'} passed over, since of compressed logs only texts are read "
        f"({', '.join(f'.{suffix}' for suffix in COMPRESSED)}) and no archives; unpack {'it' if one else 'them'} where "
        f"{'it holds a log' if one else 'they hold logs'}."
    )


def _is_log(name: str, known: Collection[str], below: str = "") -> bool:
    if _is_hidden(name, below):
        return False
    suffixes = _suffixes(name)
    if not suffixes:
        return os.path.isdir(name) and _is_bag(name)
    if suffixes[-1] in COMPRESSED:  # of compressed files only texts are read
        return len(suffixes) > 1 and suffixes[-2] in TEXTS
    return suffixes[-1] in known or os.path.isdir(name)


def _is_result(name: str) -> bool:
    folder, own = os.path.split(name)
    return own in _RESULTS and os.path.isfile(os.path.join(folder, _RESULTS[own]))


def _is_bag(folder: str) -> bool:
    return os.path.isfile(os.path.join(folder, "metadata.yaml"))
