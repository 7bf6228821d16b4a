"""Reading of files that anybody may have made: regular, of bounded size, with texts and numbers that can be used."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import io
import json
import math
import os
import re
import stat
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from threading import Lock
from typing import Any

from steelyard.errors import InputError

__all__ = [
    "LARGEST_JSON",
    "LARGEST_TEXT",
    "file_hash",
    "find_password",
    "parse_json",
    "read_bytes",
    "read_json",
    "read_text",
    "read_toml",
    "reading_table",
    "require_file",
    "require_format",
    "shown",
]

# A description of the largest humanoid has 1 MB, a saved Information of 60 joints 30 MB, its certificate 100 MB.
LARGEST_TEXT = 50_000_000
LARGEST_JSON = 200_000_000
# The parser of Python takes a time that grows with the square of the number of parts of a dotted key: minutes for 2 MB.
LARGEST_TOML = 2_000_000
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_ENDLESS_KEY = re.compile(rf"(?<![\w.-])(?:{_PART}\.[ \t]*+){{100}}")

# In addresses of repositories, github://owner:repository@branch, what stands there is none.
_PASSWORD = re.compile(r"(?<![\w+.-])(?!git(?:hub)?://)[\w+.-]+://[^/:\s]*:([^/\s]*)@")

# Nothing that is saved here is nested more than ten times; a message that quotes a value must be able to print it.
DEEPEST = 50
LARGEST_INTEGER = 2**63
LONGEST_QUOTE = 200  # characters, so that a message stays a sentence


def find_password(text: str) -> slice | None:
    """Return where a text, such as an address, holds the password of an address; None where it holds none.

    Examples
    --------
    >>> address = "sftp://robot:pass:word@host/run.csv"
    >>> address[find_password(address)]
    'pass:word'
    >>> find_password("github://owner:repository@main/run.csv")
    """
    found = _PASSWORD.search(text)
    return None if found is None else slice(*found.span(1))


def shown(value: object) -> str:
    """Return a value as a message quotes it, shortened where it is long.

    Examples
    --------
    >>> shown("elbow"), len(shown("e" * 1000)), shown(10**5000)
    ("'elbow'", 200, 'a number of more than 300 digits')
    """
    if isinstance(value, int) and abs(value) > 10**300:  # which Python may refuse to print
        return "a number of more than 300 digits"
    if isinstance(value, str | bytes):
        value = value[: LONGEST_QUOTE + 1]
    elif isinstance(value, list | tuple) and len(value) > LONGEST_QUOTE:
        value = value[:LONGEST_QUOTE]
    try:
        text = repr(value)
    except (RecursionError, ValueError):
        return f"a {type(value).__name__}"
    return text if len(text) <= LONGEST_QUOTE else f"{text[: LONGEST_QUOTE - 1]}…"


def require_file(path: str | os.PathLike[str], remedy: str = "give the path of a file") -> None:
    """Make sure that a path leads to a regular file: a device or a pipe may have no end.

    Raises
    ------
    InputError
        Where it does not; the message ends with the remedy.
    """
    try:
        mode = os.stat(path).st_mode
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise InputError(f"{shown(os.fspath(path))}: is longer than a path can be; {remedy}.") from None
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); {remedy}.") from None
    except ValueError:
        raise InputError(f"{shown(os.fspath(path))}: is not a valid path; {remedy}.") from None
    _require_regular(mode, path, remedy)


@contextlib.contextmanager
def _opened(path: str | os.PathLike[str], remedy: str) -> Iterator[io.BufferedReader[_Ready]]:
    """Open a regular file; refuse what is none, and what cannot be read, also while it is."""
    # Without O_NONBLOCK a pipe that nobody writes to would be waited for in `open`.
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
    try:
        if os.path.isdir(path):
            raise InputError(f"{path}: is a folder; {remedy}.")
        with io.BufferedReader(_Ready(os.open(path, flags))) as file:
            _require_regular(os.fstat(file.fileno()).st_mode, path, remedy)
            yield file
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); {remedy}.") from None
    except InputError:
        raise
    except ValueError:  # the path holds a NUL, or half of a surrogate pair
        raise InputError(f"{shown(os.fspath(path))}: is not a valid path; {remedy}.") from None


class _Ready(io.FileIO):
    """A file that refuses to wait: some that the system makes up, such as ``/proc/kmsg``, call themselves regular."""

    def readinto(self, buffer: Any) -> int:
        count = super().readinto(buffer)
        if count is None:
            raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
        return count


def file_hash(path: Path, *, remedy: str = "give the path of a file") -> str:
    """Return the SHA-256 hash of the content of a file, by which one can tell whether it is the same.

    Raises
    ------
    InputError
        For a file that cannot be read, a folder, a device or a pipe.
    """
    with _opened(path, remedy) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_bytes(
    path: str | os.PathLike[str], *, largest: int = LARGEST_TEXT, remedy: str = "give the path of a file"
) -> bytes:
    """Read a regular file whole.

    Parameters
    ----------
    path : str or path
    largest : int
        Bytes; a larger file is refused before anything is read.
    remedy : str
        What the message advises where the file cannot be read.

    Raises
    ------
    InputError
        For a file that is missing, too large or cannot be read, a folder, a device or a pipe.
    """
    with _opened(path, remedy) as file:
        if os.fstat(file.fileno()).st_size <= largest:
            content = file.read(largest + 1)
            if len(content) <= largest:
                return content
    raise InputError(f"{path}: has more than {largest / 1e6:.0f} MB, which is too large; {remedy}.")


def _require_regular(mode: int, path: str | os.PathLike[str], remedy: str) -> None:
    if stat.S_ISDIR(mode):
        raise InputError(f"{path}: is a folder; {remedy}.")
    if not stat.S_ISREG(mode):
        kind = "a pipe" if stat.S_ISFIFO(mode) else "a socket" if stat.S_ISSOCK(mode) else "a device"
        raise InputError(f"{path}: is {kind} and no regular file; {remedy}.")


def read_text(
    path: str | os.PathLike[str], *, largest: int = LARGEST_TEXT, remedy: str = "give the path of a text file"
) -> str:
    """Read a text in UTF-8, with or without a byte order mark.

    Raises
    ------
    InputError
        As in `read_bytes`; and for bytes that are not UTF-8, or a NUL.
    """
    content = read_bytes(path, largest=largest, remedy=remedy)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8; save the file as UTF-8.") from None
    if "\0" in text:
        raise InputError(f"{path}: is not a text file (byte {content.index(0)} is 0); {remedy}.")
    return text


def read_toml(path: str | os.PathLike[str], *, remedy: str = "give the path of a TOML file") -> dict[str, Any]:
    """Read a TOML file; its numbers fit into floats, its texts hold no NUL, and it is not nested deeply.

    Infinities and NaN, which TOML can express, are accepted; the caller knows whether the value may be one.

    Raises
    ------
    InputError
        As in `read_text`; and for what is not TOML or goes beyond these bounds.
    """
    text = read_text(path, largest=LARGEST_TOML, remedy=remedy)
    if endless := _ENDLESS_KEY.search(text):
        line = text.count("\n", 0, endless.start()) + 1
        raise InputError(f"{path}: line {line} has a key of more than 100 parts; mend the file.")
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML ({error}); mend the file.") from None
    except RecursionError:
        raise InputError(f"{path}: not valid TOML (nested too deeply); mend the file.") from None
    except ValueError:  # of `int`, for more digits than Python converts
        raise InputError(f"{path}: holds a number with too many digits; mend the file.") from None
    _require_usable(content, path, finite=False)
    return content


def read_json(path: str | os.PathLike[str], *, remedy: str = "give the path of a JSON file") -> Any:
    """Read a JSON file; its numbers are finite, its keys differ, and it is not nested deeply.

    Raises
    ------
    InputError
        As in `read_text`; and for what is not JSON or goes beyond these bounds.
    """
    return parse_json(read_text(path, largest=LARGEST_JSON, remedy=remedy), path, remedy=remedy)


def parse_json(text: str, path: str | os.PathLike[str], *, remedy: str) -> Any:
    """Return what a text in JSON holds, as `read_json` does; `path` says in messages where it stands."""
    try:
        content = json.loads(text, object_pairs_hook=_object, parse_constant=_refuse_constant)
    except _RefusedError as refused:
        raise InputError(f"{path}: {refused}; save it again.") from None
    except RecursionError:
        raise InputError(f"{path}: is not JSON (nested too deeply); {remedy}.") from None
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: is not JSON ({error}); {remedy}.") from None
    except ValueError:  # of `int`, for more digits than Python converts
        raise InputError(f"{path}: holds a number with too many digits; save it again.") from None
    _require_usable(content, path, finite=True)
    return content


def require_format(given: object, expected: str, where: str | os.PathLike[str], remedy: str) -> None:
    """Make sure that a saved document is of the format that is read here, whose version its name ends with.

    Parameters
    ----------
    given : object
        What the document says of its format.
    expected : str
    where : str or path
        Named in the message.
    remedy : str
        What the message advises, unless a newer version of this package wrote the document.

    Raises
    ------
    InputError
        For any other format.

    Examples
    --------
    >>> require_format("steelyard-estimate-9", "steelyard-estimate-3", "estimate.json", "identify the robot anew")
    Traceback (most recent call last):
    ...
    steelyard.errors.InputError: estimate.json: format is 'steelyard-estimate-9', expected 'steelyard-estimate-3'; \
a newer Steelyard wrote it: upgrade this one.
    """
    if given == expected:
        return
    kind, _, version = expected.rpartition("-")
    later = re.fullmatch(rf"{re.escape(kind)}-([0-9]{{1,9}})", given) if isinstance(given, str) else None
    if later and int(later[1]) > int(version):
        remedy = "a newer Steelyard wrote it: upgrade this one"
    raise InputError(f"{where}: format is {shown(given)}, expected {expected!r}; {remedy}.")


class _RefusedError(ValueError):
    """Raised for what Python's parser accepts as JSON, but this package never writes."""


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    made = dict(pairs)
    if len(made) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        # Programs that read JSON differ in which of the two values they take.
        raise _RefusedError(f"holds the key {shown(twice)} twice in one object")
    return made


def _refuse_constant(text: str) -> float:
    raise _RefusedError(f"holds the number {text}, which JSON does not have")


def _require_usable(content: Any, path: str | os.PathLike[str], *, finite: bool) -> None:
    """Check every value of a document, without recursion."""
    waiting = [(content, 0)]
    while waiting:
        value, depth = waiting.pop()
        if isinstance(value, list | Mapping):
            if depth >= DEEPEST:
                raise InputError(f"{path}: is nested more than {DEEPEST} times; mend the file.")
            waiting += [(item, depth + 1) for item in value]
            if isinstance(value, Mapping):
                waiting += [(item, depth + 1) for item in value.values()]
        elif isinstance(value, str):
            if "\0" in value or not _is_unicode(value):
                raise InputError(
                    f"{path}: holds the text {shown(value)}, with a character that is not valid in a text; "
                    "mend the file."
                )
        elif isinstance(value, int):
            if not -LARGEST_INTEGER <= value < LARGEST_INTEGER:
                raise InputError(f"{path}: holds a whole number beyond 64 bits ({shown(value)}); mend the file.")
        elif isinstance(value, float) and finite and not math.isfinite(value):
            raise InputError(f"{path}: holds a number beyond the range of floating-point numbers; mend the file.")


def _is_unicode(text: str) -> bool:
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:  # half of a pair of surrogates
        return False
    return True


class _Silence:
    """Keeps what a panic prints from the terminal: Rust writes it to the file of standard error itself.

    There is one such file for all threads, so that the first to be silent closes it and the last opens it again. What
    is written meanwhile appears then, unless reading failed: other threads may have something to say, too, such as the
    main one that the user interrupted it.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._count, self._kept, self._meanwhile, self._failed = 0, -1, -1, False

    def __enter__(self) -> None:
        with self._lock:
            self._count += 1
            if self._count > 1:
                return
            import tempfile  # loaded where tables are read

            try:
                with tempfile.TemporaryFile() as meanwhile:
                    self._kept, self._meanwhile = os.dup(2), os.dup(meanwhile.fileno())
            except OSError:  # there is no standard error, or no place for a file
                self._kept = -1
                return
            self._failed = False
            os.dup2(self._meanwhile, 2)

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        with self._lock:
            self._failed |= error is not None and not isinstance(error, KeyboardInterrupt)
            self._count -= 1
            if self._count or self._kept < 0:
                return
            os.dup2(self._kept, 2)
            os.close(self._kept)
            with os.fdopen(self._meanwhile, "rb") as meanwhile:
                meanwhile.seek(0)
                while not self._failed and (part := meanwhile.read(65536)):
                    os.write(2, part)


_SILENCE = _Silence()


@contextlib.contextmanager
def reading_table(path: str | os.PathLike[str], kind: str) -> Iterator[None]:
    """Say in one sentence why Polars cannot read a file.

    Parameters
    ----------
    path : str or path
    kind : str
        What the file should be, such as "Parquet".

    Raises
    ------
    InputError
        For whatever Polars raises, a panic of its Rust code among it, which is no `Exception`.
    """
    from polars.exceptions import PanicException, PolarsError

    try:
        with _SILENCE:
            yield
    except InputError:
        raise
    except (PolarsError, PanicException, OSError, ValueError, TypeError, OverflowError) as error:
        lines = str(error).splitlines() or [type(error).__name__]
        raise InputError(f"{path} cannot be read as {kind}: {lines[0][:200]}; save it again.") from None
