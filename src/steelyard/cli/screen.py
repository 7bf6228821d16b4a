"""Safe output on a terminal: plain text, and no control sequences except the colours that this program sets."""

from __future__ import annotations

import os
import re
import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

__all__ = ["LONGEST_SENTENCE", "echo", "guarded", "printable", "sentence"]

LONGEST_SENTENCE = 1500  # characters of a message; names in files may be of any length, and a screen has about 2000
_COLOUR = re.compile(r"(\x1b\[[0-9;]*m)")
# Control characters, marks that turn the direction of writing, halves of characters, and separators of lines.
_HIDDEN = ("Cc", "Cf", "Cs", "Zl", "Zp")


def printable(text: str) -> str:
    r"""Return a text whose control characters are written out: names in files may hold any.

    Examples
    --------
    >>> printable("elbow\x1b[2J"), printable("größe, 20 µm")
    ('elbow\\x1b[2J', 'größe, 20 µm')
    """
    plain = text.replace("\n", " ").replace("\t", " ")
    if plain.isascii() and plain.isprintable():
        return text
    return "".join(
        one.encode("unicode_escape").decode("ascii")
        if one not in "\n\t" and unicodedata.category(one) in _HIDDEN
        else one
        for one in text
    )


def sentence(text: object) -> str:
    """Return a message as one line of limited length."""
    line = printable(" ".join(str(text).split()))
    if len(line) <= LONGEST_SENTENCE:
        return line
    half = LONGEST_SENTENCE // 2
    return f"{line[:half]} […] {line[-half:]}"


def echo(text: object) -> None:
    """Print a line on standard output."""
    print(printable(str(text)))


class _Guarded:
    """A stream that replaces control characters, and characters that its encoding does not have, by escapes."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text; colours stay where the stream is a terminal."""
        parts = _COLOUR.split(text) if self._stream.isatty() else [text]
        safe = "".join(part if index % 2 else printable(part) for index, part in enumerate(parts))
        encoding = self._stream.encoding or "utf-8"
        self._stream.write(safe.encode(encoding, "backslashreplace").decode(encoding))
        return len(text)

    def writelines(self, lines: Any) -> None:
        """Write several texts."""
        for line in lines:
            self.write(line)


@contextmanager
def guarded() -> Iterator[None]:
    """Guard standard output and standard error, also against what libraries print."""
    output, errors = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = _Guarded(output), _Guarded(errors)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = output, errors
        try:
            output.flush()
        except OSError:  # the reader of a pipe has gone; without this Python would print one more error when it exits
            with suppress(OSError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), output.fileno())
