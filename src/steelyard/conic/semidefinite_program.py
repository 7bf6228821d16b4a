"""Semidefinite programs in the form that SDPA sparse files hold, and these files.

The format: comment lines that begin with ``*`` or ``"``; the number of variables; the number of blocks; the block
sizes, negative for diagonal blocks; the cost; then one entry a line: matrix, block, row, column, value (SDPA user's
manual; SDPLIB). Commas, braces and parentheses count as blanks, and text after the numbers of a header line is ignored.
"""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.errors import InputError
from steelyard.files import LARGEST_JSON, read_bytes, write_text
from steelyard.files.arguments import real_array

from .problem import Cone, ConicProblem, ConicSolution, stacked_triangle
from .solver import solve

__all__ = ["SemidefiniteProgram"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

MOST_ROWS = 20_000_000
"""Largest number of elements of all blocks together that `to_conic` stores (160 MB)."""

# Possessive quantifiers, so that no line takes quadratic time to be refused.
_NUMBER = re.compile(r"[\s,(){}]*+([+-]?(?:[0-9]++(?:\.[0-9]*+)?+|\.[0-9]++)(?:[eEdD][+-]?[0-9]++)?+)(?=[\s,(){}=]|$)")
_BLANK = re.compile(r"[\s,(){}]*")
_NAME = re.compile(r'\*\s*(variable|block)\s+([0-9]{1,9}):\s*(".*")\s*$')
_LINE_END = re.compile(r"\r\n|\r|\n")
_LARGEST = 2**31 - 1


@dataclass(frozen=True, eq=False)
class SemidefiniteProgram:
    """Minimise cᵀx subject to F(x) = x₁ F₁ + … + x_m F_m - F₀ positive semidefinite, F block diagonal.

    Its dual is to maximise tr(F₀ Y) subject to tr(F_i Y) = c_i, Y positive semidefinite. The matrices are stored by
    their nonzero elements: entry k says that element (row[k], column[k]) of block[k] of F_matrix[k] is value[k].

    Attributes
    ----------
    cost : (m,)
        c.
    block_sizes : tuple of int
        Order of each block; negative for a diagonal block of that many elements.
    matrix : (entries,) int
        0 for F₀, i for F_i.
    block, row, column : (entries,) int
        Counted from 0, row ≤ column.
    value : (entries,)
    variable_names : tuple of str
        Names of the m variables, or empty.
    block_names : tuple of str
        Names of the blocks, or empty.

    Raises
    ------
    InputError
        If sizes do not fit, an index is outside, an element is given twice or a number is not finite.

    Examples
    --------
    The smallest x with [[x, 1], [1, x]] positive semidefinite:

    >>> program = SemidefiniteProgram.from_matrices([1.0], [[-np.array([[0.0, 1.0], [1.0, 0.0]])], [np.eye(2)]])
    >>> program
    SemidefiniteProgram(1 variable, 1 block of size 2, 3 entries)
    >>> round(program.solve().objective, 6)
    1.0
    """

    cost: Vector
    block_sizes: tuple[int, ...]
    matrix: Indices
    block: Indices
    row: Indices
    column: Indices
    value: Vector
    variable_names: tuple[str, ...] = field(default=())
    block_names: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        count = len(self.value)
        if any(len(part) != count for part in (self.matrix, self.block, self.row, self.column)):
            raise InputError("the entries of a semidefinite program need matrix, block, row, column and value alike.")
        if self.cost.ndim != 1 or not (np.all(np.isfinite(self.cost)) and np.all(np.isfinite(self.value))):
            raise InputError("the numbers of a semidefinite program must be finite; check its cost and its entries.")
        if any(size == 0 for size in self.block_sizes):
            raise InputError("a block of a semidefinite program has size 0; leave it out.")
        for names, expected in ((self.variable_names, len(self.cost)), (self.block_names, len(self.block_sizes))):
            if names and len(names) != expected:
                raise InputError(f"a semidefinite program got {len(names)} names for {expected} variables or blocks.")
        if not count:
            return
        sizes = np.asarray(self.block_sizes, dtype=np.int64)
        inside = (self.block >= 0) & (self.block < len(sizes)) & (self.matrix >= 0) & (self.matrix <= len(self.cost))
        if not np.all(inside):
            raise InputError("an entry of a semidefinite program names a matrix or a block that does not exist.")
        own = sizes[self.block]
        if not np.all((self.row >= 0) & (self.row <= self.column) & (self.column < np.abs(own))):
            raise InputError("an entry of a semidefinite program lies outside the upper triangle of its block.")
        if np.any((own < 0) & (self.row != self.column)):
            raise InputError("an entry of a semidefinite program lies beside the diagonal of a diagonal block.")
        places = np.stack([self.matrix, self.block, self.row, self.column], axis=1)
        if len(np.unique(places, axis=0)) < count:
            raise InputError("a semidefinite program gives the same element twice; add such entries up first.")

    def __repr__(self) -> str:
        variables = f"{len(self.cost)} variable{'' if len(self.cost) == 1 else 's'}"
        shown = ", ".join(str(size) for size in self.block_sizes[:6]) + (", …" if len(self.block_sizes) > 6 else "")
        blocks = f"{len(self.block_sizes)} block{'' if len(self.block_sizes) == 1 else 's'}"
        sizes = f" of size {shown}" if self.block_sizes else ""
        return f"SemidefiniteProgram({variables}, {blocks}{sizes}, {len(self.value)} entries)"

    @classmethod
    def from_matrices(
        cls,
        cost: npt.ArrayLike,
        matrices: Sequence[Sequence[npt.ArrayLike]],
        variable_names: Sequence[str] = (),
        block_names: Sequence[str] = (),
    ) -> "SemidefiniteProgram":
        """Build a semidefinite program from dense blocks.

        Parameters
        ----------
        cost : (m,)
        matrices : m + 1 sequences of blocks
            The blocks of F₀, F₁, …: symmetric (d, d), or (d,) for a diagonal block.
        variable_names, block_names : sequence of str, optional

        Raises
        ------
        InputError
            If the number of matrices or a shape does not fit, or a block is not symmetric.
        """
        costs = np.atleast_1d(real_array(cost, "the cost of a semidefinite program"))
        dense = [
            [real_array(block, f"a block of F{number} of a semidefinite program") for block in blocks]
            for number, blocks in enumerate(matrices)
        ]
        if len(dense) != len(costs) + 1:
            raise InputError(f"{len(costs)} variables need {len(costs) + 1} matrices F₀, F₁, …, got {len(dense)}.")
        shapes = [block.shape for block in dense[0]]
        parts: list[tuple[Indices, ...]] = []
        values: list[Vector] = []
        for number, blocks in enumerate(dense):
            if [block.shape for block in blocks] != shapes:
                raise InputError(f"the blocks of F{number} have other shapes than those of F0.")
            for place, block in enumerate(blocks):
                if block.ndim not in (1, 2) or (block.ndim == 2 and not np.array_equal(block, block.T)):
                    raise InputError(f"block {place + 1} of F{number} is not symmetric; give (d, d) or (d,) arrays.")
                upper = np.diag(block) if block.ndim == 1 else np.triu(block)
                row, column = np.nonzero(upper)
                parts.append((np.full(len(row), number), np.full(len(row), place), row, column))
                values.append(upper[row, column])
        none = np.zeros(0, dtype=np.intp)
        number_of, place_of, row_of, column_of = (
            np.concatenate([none, *(part[k] for part in parts)]) for k in range(4)
        )
        return cls(
            cost=costs,
            block_sizes=tuple(shape[0] if len(shape) == 2 else -shape[0] for shape in shapes),
            matrix=number_of,
            block=place_of,
            row=row_of,
            column=column_of,
            value=np.concatenate([np.zeros(0), *values]),
            variable_names=tuple(variable_names),
            block_names=tuple(block_names),
        )

    @classmethod
    def from_conic(cls, problem: ConicProblem) -> "SemidefiniteProgram":
        """Convert a problem with a linear objective over nonnegative and semidefinite cones.

        Neighbouring nonnegative rows become one diagonal block.

        Raises
        ------
        InputError
            If it has another cone or a quadratic objective.
        """
        if problem.P.count_nonzero() or any(c.kind not in ("nonnegative", "semidefinite") for c in problem.cones):
            raise InputError(
                "only a linear objective over nonnegative and semidefinite cones is a semidefinite program as it "
                'stands; solve(problem, solver="csdp") rewrites the others.'
            )
        sizes: list[int] = []
        blocks, rows, columns = [], [], []
        for cone in problem.cones:
            if cone.kind == "nonnegative" and cone.size:
                row = column = np.arange(cone.size)
                sizes.append(-cone.size)
            elif cone.size:
                row, column, _ = stacked_triangle(cone.size)
                sizes.append(cone.size)
            else:
                continue
            blocks.append(np.full(len(row), len(sizes) - 1))
            rows.append(row)
            columns.append(column)
        none = np.zeros(0, dtype=np.intp)
        block, row, column = (np.concatenate([none, *parts]) for parts in (blocks, rows, columns))
        scale = np.where(row == column, 1.0, np.sqrt(0.5))
        A = sparse.coo_array(problem.A)
        constant = np.flatnonzero(problem.b)
        place = np.concatenate([constant, A.coords[0]])
        matrix = np.concatenate([np.zeros(len(constant), dtype=np.intp), A.coords[1] + 1])
        value = -np.concatenate([problem.b[constant], A.data]) * scale[place]
        kept = value != 0
        matrix, place, value = matrix[kept], place[kept], value[kept]
        order = np.lexsort((place, matrix))
        matrix, place, value = matrix[order], place[order], value[order]
        return cls(problem.q, tuple(sizes), matrix, block[place], row[place], column[place], value)

    def to_conic(self) -> ConicProblem:
        """Return the program as a conic problem: diagonal blocks as nonnegative cones, the others as semidefinite ones.

        Raises
        ------
        InputError
            If the blocks are too large to be unfolded.
        """
        cones = tuple(Cone("nonnegative" if size < 0 else "semidefinite", abs(size)) for size in self.block_sizes)
        total = sum(cone.rows for cone in cones)
        if total > MOST_ROWS:
            largest = max(abs(size) for size in self.block_sizes)
            raise InputError(
                f"the blocks of this semidefinite program (the largest of order {largest}) have {total} elements, more "
                f"than the {MOST_ROWS} that are unfolded; split them into smaller ones."
            )
        starts = np.concatenate([[0], np.cumsum([cone.rows for cone in cones])]).astype(np.intp)
        diagonal = np.asarray(self.block_sizes, dtype=np.int64)[self.block] < 0 if len(self.value) else self.block < 0
        within = np.where(diagonal, self.column, self.column * (self.column + 1) // 2 + self.row)
        place = starts[self.block] + within
        scaled = self.value * np.where(self.row == self.column, 1.0, np.sqrt(2.0))
        constant, linear = self.matrix == 0, self.matrix > 0
        b = np.zeros(total)
        b[place[constant]] = -scaled[constant]
        count = len(self.cost)
        coordinates = (place[linear], self.matrix[linear] - 1)
        A = sparse.csc_array(sparse.coo_array((-scaled[linear], coordinates), shape=(total, count)))
        return ConicProblem(sparse.csc_array((count, count)), self.cost, A, b, cones)

    def evaluate(self, x: npt.ArrayLike) -> tuple[Matrix, ...]:
        """The blocks of F(x): (d, d), or (d,) for diagonal ones.

        Parameters
        ----------
        x : (m,)
        """
        weights = np.concatenate([[-1.0], np.asarray(x, dtype=float)])
        found = []
        for place, size in enumerate(self.block_sizes):
            own = self.block == place
            matrix = np.zeros((abs(size), abs(size)))
            np.add.at(matrix, (self.row[own], self.column[own]), self.value[own] * weights[self.matrix[own]])
            found.append(np.diag(matrix) if size < 0 else matrix + np.triu(matrix, 1).T)
        return tuple(found)

    def solve(self, accuracy: float = 1e-8, iterations: int = 200, solver: str = "clarabel") -> ConicSolution:
        """Solve it with any of the solvers; the primal of the answer is x. See `steelyard.conic.solve`."""
        return solve(self.to_conic(), accuracy, iterations, solver)

    def write(self, path: str | Path) -> Path:
        """Write an SDPA sparse file (``.dat-s``) with all digits; it appears whole or not at all.

        Names of variables and blocks stand in comment lines, where `read` finds them.

        Raises
        ------
        InputError
            If there is nothing to write, or the file cannot be written.

        Examples
        --------
        >>> import tempfile
        >>> program = SemidefiniteProgram.from_matrices([1.0], [[[-1.0, 0.5]], [[1.0, 0.0]]], variable_names=["mass"])
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = program.write(Path(folder) / "small.dat-s")
        ...     print(path.read_text())
        ...     SemidefiniteProgram.read(path).variable_names
        * variable 1: "mass"
        1
        1
        -2
        1.0
        0 1 1 1 -1.0
        0 1 2 2 0.5
        1 1 1 1 1.0
        <BLANKLINE>
        ('mass',)
        """
        target = Path(path)
        if not len(self.cost) or not self.block_sizes:
            raise InputError(
                f"{target}: an SDPA file needs at least one variable and one block, and {self!r} lacks them."
            )
        lines = [f"* variable {i + 1}: {json.dumps(name)}" for i, name in enumerate(self.variable_names)]
        lines += [f"* block {i + 1}: {json.dumps(name)}" for i, name in enumerate(self.block_names)]
        lines += [str(len(self.cost)), str(len(self.block_sizes)), " ".join(map(str, self.block_sizes))]
        lines.append(" ".join(repr(float(value)) for value in self.cost))
        entries = zip(self.matrix, self.block, self.row, self.column, self.value, strict=True)
        lines += [f"{m} {b + 1} {i + 1} {j + 1} {float(value)!r}" for m, b, i, j, value in entries]
        write_text("\n".join(lines) + "\n", target)
        return target

    @classmethod
    def read(cls, path: str | Path) -> "SemidefiniteProgram":
        """Read an SDPA sparse file (``.dat-s``) as the manual and SDPLIB define it.

        Raises
        ------
        InputError
            If it cannot be read; names the line, what was found and what was expected.
        """
        # Entry by entry: no memory is allocated for sizes that the file only claims to have.
        content = read_bytes(Path(path), largest=LARGEST_JSON, remedy="give the path of a .dat-s file")
        text = content.decode("utf-8-sig", errors="replace")
        lines = _Lines(Path(path), _LINE_END.split(text))
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
        return cls(np.array(cost), tuple(sizes), matrix, block, row, column, value, names["variable"], names["block"])


@dataclass
class _Lines:
    """The lines of a file that are neither blank nor comments, with names found in comments."""

    path: Path
    lines: list[str]
    place: int = 0
    names: dict[str, dict[int, str]] = field(default_factory=lambda: {"variable": {}, "block": {}})

    def next(self) -> str | None:
        """The next line that is neither blank nor a comment; None at the end."""
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
        """Read `count` numbers, which may span several lines; text after the last one is ignored."""
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


def _counts_up(found: dict[int, str], expected: int) -> bool:
    """Return whether names were found for 1, 2, …, expected."""
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
