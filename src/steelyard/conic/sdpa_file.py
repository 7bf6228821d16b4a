"""SDPA sparse files: reading and writing.

The format: comment lines that begin with ``*`` or ``"``; the number of variables; the number of blocks; the block
sizes, negative for diagonal blocks; the cost; then one entry a line: matrix, block, row, column, value (SDPA user's
manual; SDPLIB). Commas, braces and parentheses count as blanks, and text after the numbers of a header line is ignored.
"""

import json
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from steelyard.errors import InputError
from steelyard.files import LARGEST_JSON, read_bytes, write_text

from .semidefinite_program import SemidefiniteProgram

__all__ = ["read_program", "write_program"]

# Possessive, so that no line is slow to refuse.
_NUMBER = re.compile(r"[\s,(){}]*+([+-]?(?:[0-9]++(?:\.[0-9]*+)?+|\.[0-9]++)(?:[eEdD][+-]?[0-9]++)?+)(?=[\s,(){}=]|$)")
_BLANK = re.compile(r"[\s,(){}]*")
_NAME = re.compile(r'\*\s*(variable|block)\s+([0-9]{1,9}):\s*(".*")\s*$')
_LINE_END = re.compile(r"\r\n|\r|\n")
_LARGEST = 2**31 - 1


def write_program(program: SemidefiniteProgram, path: Path) -> Path:
    """Write it beside and rename."""
    if not len(program.cost) or not program.block_sizes:
        raise InputError(f"{path}: an SDPA file needs at least one variable and one block, and {program!r} lacks them.")
    lines = [f"* variable {i + 1}: {json.dumps(name)}" for i, name in enumerate(program.variable_names)]
    lines += [f"* block {i + 1}: {json.dumps(name)}" for i, name in enumerate(program.block_names)]
    lines += [str(len(program.cost)), str(len(program.block_sizes)), " ".join(map(str, program.block_sizes))]
    lines.append(" ".join(repr(float(value)) for value in program.cost))
    entries = zip(program.matrix, program.block, program.row, program.column, program.value, strict=True)
    lines += [f"{m} {b + 1} {i + 1} {j + 1} {float(value)!r}" for m, b, i, j, value in entries]
    write_text("\n".join(lines) + "\n", path)
    return path


@dataclass
class _Lines:
    """The lines of a file that are neither blank nor comments, with names found in comments."""

    path: Path
    lines: list[str]
    place: int = 0
    names: dict[str, dict[int, str]] = field(default_factory=lambda: {"variable": {}, "block": {}})

    def next(self) -> str | None:
        """The next line that holds something."""
        while self.place < len(self.lines):
            line = self.lines[self.place]
            self.place += 1
            if line.lstrip().startswith(("*", '"')):
                self._remember(line)
            elif line.strip(" \t\n\r\f\v,(){}"):
                return line
        return None

    def _remember(self, line: str) -> None:
        found = _NAME.match(line.strip())
        if found:
            try:
                name = json.loads(found[3])
            except ValueError:
                return
            # Not half of a pair of surrogates, which cannot be printed.
            if isinstance(name, str) and not re.search("[\ud800-\udfff]", name):
                self.names[found[1]][int(found[2])] = name

    def error(self, message: str) -> InputError:
        """An error that names file and line."""
        return InputError(f"{self.path}, line {min(self.place, len(self.lines))}: {message}")

    def numbers(self, line: str) -> tuple[list[str], str]:
        """The numbers that a line begins with, and what follows."""
        found, place = [], 0
        while match := _NUMBER.match(line, place):
            found.append(match[1])
            place = match.end()
        return found, line[_BLANK.match(line, place).end() :]  # type: ignore[union-attr]

    def header(self, count: int, what: str) -> list[str]:
        """That many numbers, which may go over several lines; text after the last is ignored."""
        found: list[str] = []
        while len(found) < count:
            line = self.next()
            if line is None:
                raise self.error(f"the file ends, but {what} expected {_count(count)} and {len(found)} were found.")
            values, rest = self.numbers(line)
            found += values
            if len(found) < count and (rest or not values):
                raise self.error(f"{what} expected {_count(count)}, but after {len(found)} came {_quoted(rest)}.")
        if len(found) > count:
            raise self.error(f"{what} expected {_count(count)}, but {len(found)} were found.")
        return found

    def integer(self, text: str, what: str, smallest: int, largest: int = _LARGEST) -> int:
        """A whole number, which may be written as 2.0."""
        value = self.real(text, what)
        if value != int(value) or not smallest <= value <= largest:
            limits = f"from {smallest} to {largest}" if largest < _LARGEST else f"of at least {smallest}"
            if smallest == -_LARGEST:
                limits = "within 31 bits"
            raise self.error(f"{what} must be a whole number {limits}, got {_quoted(text)}.")
        return int(value)

    def real(self, text: str, what: str) -> float:
        """A finite number."""
        value = float(text.replace("d", "e").replace("D", "e"))
        if not np.isfinite(value):
            raise self.error(f"{what} is beyond the range of floating-point numbers: {_quoted(text)}.")
        return value


def _count(count: int) -> str:
    return "1 number" if count == 1 else f"{count} numbers"


def _quoted(text: str) -> str:
    text = text.strip()
    return repr(text if len(text) <= 40 else text[:40] + "…") if text else "nothing"


def read_program(path: Path) -> SemidefiniteProgram:
    """Read a file line by line; nothing is allocated for what it only claims to hold."""
    content = read_bytes(path, largest=LARGEST_JSON, remedy="give the path of a .dat-s file")
    text = content.decode("utf-8-sig", errors="replace")
    lines = _Lines(path, _LINE_END.split(text))
    count = lines.integer(lines.header(1, "the number of variables")[0], "the number of variables", 1)
    blocks = lines.integer(lines.header(1, "the number of blocks")[0], "the number of blocks", 1)
    sizes = [lines.integer(size, "a block size", -_LARGEST) for size in lines.header(blocks, "the block sizes")]
    if 0 in sizes:
        raise lines.error(f"block {sizes.index(0) + 1} has size 0; leave it out.")
    cost = [lines.real(value, "a cost") for value in lines.header(count, "the cost")]
    entries = _entries(lines, count, sizes)
    places = np.array(list(entries), dtype=np.intp).reshape(-1, 4)
    value = np.array([entry[0] for entry in entries.values()], dtype=float)
    kept = value != 0
    places, value = places[kept], value[kept]
    names = {
        kind: tuple(found[i] for i in sorted(found)) if _counts_up(found, expected) else ()
        for kind, found, expected in (
            ("variable", lines.names["variable"], count),
            ("block", lines.names["block"], blocks),
        )
    }
    matrix, block, row, column = (np.ascontiguousarray(part) for part in places.T)
    return SemidefiniteProgram(
        np.array(cost), tuple(sizes), matrix, block, row, column, value, names["variable"], names["block"]
    )


def _counts_up(found: dict[int, str], expected: int) -> bool:
    """Whether names were found for 1, 2, …, expected."""
    return len(found) == expected and all(i in found for i in range(1, expected + 1))


def _entries(lines: _Lines, count: int, sizes: list[int]) -> dict[tuple[int, int, int, int], tuple[float, int, bool]]:
    """(matrix, block, row, column), the last three from 0, to (value, line, whether it stood below the diagonal)."""
    found: dict[tuple[int, int, int, int], tuple[float, int, bool]] = {}
    while (line := lines.next()) is not None:
        values, rest = lines.numbers(line)
        if len(values) != 5 or rest:
            what = f"{len(values)} numbers" + (f" and then {_quoted(rest)}" if rest else "")
            raise lines.error(f"an entry is five numbers (matrix, block, row, column, value), got {what}.")
        matrix = lines.integer(values[0], "the matrix of an entry", 0, count)
        block = lines.integer(values[1], "the block of an entry", 1, len(sizes))
        size = sizes[block - 1]
        row = lines.integer(values[2], f"the row of an entry of block {block}", 1, abs(size))
        column = lines.integer(values[3], f"the column of an entry of block {block}", 1, abs(size))
        value = lines.real(values[4], "the value of an entry")
        if size < 0 and row != column:
            if value == 0:
                continue
            raise lines.error(f"block {block} is diagonal, but an entry of it stands in row {row}, column {column}.")
        place = (matrix, block - 1, min(row, column) - 1, max(row, column) - 1)
        if place in found:
            before, number, below = found[place]
            # A whole symmetric matrix may be written out; anything else is read differently by different programs.
            if below == (row > column) or before != value:
                raise lines.error(
                    f"element ({row}, {column}) of block {block} of matrix {matrix} was given in line {number} "
                    "already; keep one of the two."
                )
            continue
        found[place] = (value, lines.place, row > column)
    return found
