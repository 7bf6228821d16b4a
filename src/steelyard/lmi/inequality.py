"""Linear matrix inequalities in named variables, how they are printed, and semidefinite programs made of them."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.conic import SemidefiniteProgram
from steelyard.errors import InputError
from steelyard.files import read_number, suggestion

from .affine import AffineBlock, is_positive_definite
from .linear_expression import LinearExpression, as_expression, distinct_names, number_text
from .matrices import (
    block_from_coefficients,
    block_of_expressions,
    expressions_of_block,
    linear_map,
    names_of_matrices,
    read_matrix,
    rearranged,
    same_matrices,
    values_as_vector,
)

__all__ = [
    "LinearMatrixInequality",
    "block_diagonal",
    "inequality_of_program",
    "latex_matrix",
    "latex_name",
    "matrix_html",
    "matrix_text",
]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

ExpressionMatrix = npt.NDArray[Any]
Values = Mapping[str, Any] | npt.ArrayLike

_SHOWN = 12
"""Largest number of rows and columns of a matrix that is printed; the others become dots."""

MOST_NUMBERS = 50_000_000
"""Largest number of elements of the coefficient matrices of a block (400 MB)."""


@dataclass(frozen=True, eq=False)
class LinearMatrixInequality:
    """A block-diagonal symmetric matrix, affine in named variables, that must be positive: D(x) = D₀ + Σ Dᵢ xᵢ ⪰ 0.

    Thesis (3.22) to (3.30). Build one with `from_matrices` or `from_coefficients`, put several together with ``&``, or
    take that of a feasible set: `FeasibleSet.inequality`.

    Parameters
    ----------
    names : sequence of str
        The variables x, in the order of vectors.
    blocks : sequence of AffineBlock
        The diagonal; their `indices` point into `names`.
    strict : bool
        Whether D(x) ≻ 0 is meant (3.26) rather than D(x) ⪰ 0 (3.28); `with_margin` goes from the one to the other.

    Raises
    ------
    InputError
        If a name is given twice or a block uses a variable that does not exist.

    Examples
    --------
    Mass and first moment of a body whose density lies on the line between 0 and 1:

    >>> lmi = LinearMatrixInequality.from_matrices([["Sxx", "lx"], ["lx", "m"]], labels=["body"])
    >>> lmi = lmi & LinearMatrixInequality.from_matrices("lx - Sxx", labels=["between 0 and 1"])
    >>> lmi
    LinearMatrixInequality(2 blocks, of orders 2 and 1, in Sxx, lx, m)
    >>> print(lmi)
    body:
    ⎡ Sxx  lx ⎤
    ⎣ lx   m  ⎦ ⪰ 0
    between 0 and 1:
    [ -Sxx + lx ] ⪰ 0
    >>> lmi.smallest_eigenvalue({"Sxx": 0.5, "lx": 0.5, "m": 1.0})
    0.0
    """

    names: tuple[str, ...]
    blocks: tuple[AffineBlock, ...]
    strict: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", distinct_names(self.names))
        object.__setattr__(self, "blocks", tuple(self.blocks))
        for block in self.blocks:
            if len(block.indices) and not 0 <= block.indices.min() <= block.indices.max() < len(self.names):
                raise InputError(
                    f"block {block.name!r} uses variable number {block.indices.max() + 1}, but there are "
                    f"{len(self.names)} names; name every variable."
                )

    @classmethod
    def from_matrices(
        cls, *matrices: Any, names: Iterable[str] | None = None, labels: Sequence[str] = (), strict: bool = False
    ) -> LinearMatrixInequality:
        """From one or more symmetric matrices of expressions, the blocks of the diagonal.

        Parameters
        ----------
        *matrices : nested sequences, arrays or SymPy matrices
            Elements are numbers, texts such as ``"Lyy1 - 2*m3"``, `LinearExpression` or SymPy expressions; a single
            element is a 1 x 1 matrix.
        names : iterable of str, optional
            The variables and their order; by default the order in which they appear.
        labels : sequence of str
            Names of the blocks.
        strict : bool
            See the class.

        Raises
        ------
        InputError
            If a matrix is not square and symmetric, or an element is not affine or holds an unknown name.

        Examples
        --------
        >>> LinearMatrixInequality.from_matrices([[1, "x"], ["x", "y"]]).names
        ('x', 'y')
        """
        if not matrices:
            raise InputError("from_matrices needs at least one matrix; give each block of the diagonal.")
        titles = tuple(labels) or tuple(f"block {i + 1}" for i in range(len(matrices)))
        if len(titles) != len(matrices):
            raise InputError(f"from_matrices got {len(titles)} labels for {len(matrices)} matrices; give one for each.")
        known = None if names is None else distinct_names(names)
        read = [read_matrix(matrix, known, title) for matrix, title in zip(matrices, titles, strict=True)]
        found = known if known is not None else names_of_matrices(read)
        blocks = (block_of_expressions(m, found, title) for m, title in zip(read, titles, strict=True))
        return cls(found, tuple(blocks), strict)

    @classmethod
    def from_coefficients(
        cls,
        names: Sequence[str],
        constant: npt.ArrayLike | None,
        coefficients: npt.ArrayLike | Mapping[str, npt.ArrayLike],
        label: str = "block 1",
        strict: bool = False,
    ) -> LinearMatrixInequality:
        """From D₀ and the Dᵢ; one block.

        Parameters
        ----------
        names : sequence of str
        constant : (d, d), optional
            D₀; zero where absent.
        coefficients : (c, d, d), or mapping from name to (d, d)
            Dᵢ, in the order of `names`.
        label : str
        strict : bool

        Raises
        ------
        InputError
            If the matrices do not fit together, are not symmetric, or hold values that are not finite.

        Examples
        --------
        >>> lmi = LinearMatrixInequality.from_coefficients(["x"], [[0, 1], [1, 0]], {"x": [[1, 0], [0, 1]]})
        >>> print(lmi.pretty())
        block 1:
        ⎡ x  1 ⎤
        ⎣ 1  x ⎦ ⪰ 0
        """
        known = distinct_names(names)
        return cls(known, (block_from_coefficients(known, constant, coefficients, label),), strict)

    def __and__(self, other: object) -> LinearMatrixInequality:
        if not isinstance(other, LinearMatrixInequality):
            return NotImplemented
        return block_diagonal(self, other)

    def __eq__(self, other: object) -> bool:
        """Whether both consist of the same matrices, whatever the order of the variables; labels do not count."""
        if not isinstance(other, LinearMatrixInequality):
            return NotImplemented
        if set(self.names) != set(other.names) or self.strict != other.strict or len(self.blocks) != len(other.blocks):
            return False
        return all(map(same_matrices, self.blocks, other.with_names(self.names).blocks))

    def __hash__(self) -> int:
        return hash((frozenset(self.names), self.strict, tuple(block.size for block in self.blocks)))

    # What it consists of

    @property
    def size(self) -> int:
        """Rows of the whole block-diagonal matrix."""
        return sum(block.size for block in self.blocks)

    @property
    def constants(self) -> tuple[Matrix, ...]:
        """D₀ of each block."""
        return tuple(block.constant for block in self.blocks)

    def coefficients(self, name: str) -> tuple[Matrix, ...]:
        """Dᵢ of each block for one variable.

        Raises
        ------
        InputError
            If there is no such variable.

        Examples
        --------
        >>> lmi = LinearMatrixInequality.from_matrices([["x", 2], [2, "3*x + y"]])
        >>> lmi.coefficients("x")[0].tolist()
        [[1.0, 0.0], [0.0, 3.0]]
        """
        index = self._index(name)
        return tuple(
            block.coefficients[np.flatnonzero(block.indices == index)].sum(axis=0) + 0.0 for block in self.blocks
        )

    @property
    def expressions(self) -> tuple[ExpressionMatrix, ...]:
        """The matrices of `LinearExpression`; `from_matrices` takes them back."""
        return tuple(expressions_of_block(block, self.names) for block in self.blocks)

    def _index(self, name: str) -> int:
        if name not in self.names:
            raise InputError(f"the inequality has no variable {name!r}; {suggestion(str(name), self.names)}")
        return self.names.index(name)

    # Values

    def vector(self, values: Values) -> Vector:
        """Values of the variables as a vector in the order of `names`; InputError where one is missing."""
        return values_as_vector(values, self.names)

    def evaluate(self, values: Values) -> tuple[Matrix, ...]:
        """Each block of D(x).

        Parameters
        ----------
        values : mapping from name to float, or (c,) in the order of `names`

        Raises
        ------
        InputError
            As `vector`.
        """
        vector = self.vector(values)
        return tuple(block.evaluate(vector) for block in self.blocks)

    def matrix(self, values: Values) -> Matrix:
        """The whole block-diagonal D(x), (size, size) (thesis 3.25)."""
        found = np.zeros((self.size, self.size))
        start = 0
        for block in self.evaluate(values):
            stop = start + len(block)
            found[start:stop, start:stop] = block
            start = stop
        return found

    def eigenvalues(self, values: Values) -> Vector:
        """All eigenvalues of D(x), ascending."""
        found = [np.linalg.eigvalsh(block) for block in self.evaluate(values)]
        return np.sort(np.concatenate([np.zeros(0), *found]))

    def smallest_eigenvalue(self, values: Values) -> float:
        """Smallest eigenvalue of D(x); infinite without blocks."""
        return float(self.eigenvalues(values).min(initial=np.inf))

    def is_positive_definite(self, values: Values) -> bool:
        """Return whether every block is proved positive definite, by `is_positive_definite` of single matrices."""
        return all(is_positive_definite(block) for block in self.evaluate(values))

    # Others made from it

    def with_margin(self, margin: float) -> LinearMatrixInequality:
        """D(x) - margin 1 ⪰ 0: a non-strict inequality that keeps its points inside the strict one (thesis 3.29).

        Raises
        ------
        InputError
            If the margin is not a finite number.

        Examples
        --------
        >>> print(LinearMatrixInequality.from_matrices("m1", strict=True).with_margin(0.5))
        block 1:
        [ m1 - 0.5 ] ⪰ 0
        """
        distance = read_number(margin, "margin", "a finite number such as 1e-6")
        blocks = (replace(block, constant=block.constant - distance * np.eye(block.size)) for block in self.blocks)
        return replace(self, blocks=tuple(blocks), strict=False)

    def with_names(self, names: Sequence[str]) -> LinearMatrixInequality:
        """Return the inequality with its variables in another order, or with further ones that do not occur in it.

        Raises
        ------
        InputError
            If a variable of the inequality is left out.
        """
        order = distinct_names(names)
        return replace(self, names=order, blocks=tuple(rearranged(block, self.names, order) for block in self.blocks))

    def substitute(self, values: Mapping[str, Any]) -> LinearMatrixInequality:
        """Return the same inequality with expressions or numbers for some variables, all at once.

        New variables take the places of those that they replace.

        Parameters
        ----------
        values : mapping from name to number, text, LinearExpression or SymPy expression

        Raises
        ------
        InputError
            If a variable does not exist or a value is not affine.

        Examples
        --------
        >>> lmi = LinearMatrixInequality.from_matrices([["a", "b"], ["b", 1]])
        >>> print(lmi.substitute({"a": "u - 2*b", "b": 3}))
        block 1:
        ⎡ u - 2*b  3 ⎤
        ⎣ 3        1 ⎦ ⪰ 0
        """
        for name in values:
            self._index(name)
        names, matrix, offset = linear_map(self.names, values)
        return self.change_variables(matrix, names, offset)

    def change_variables(
        self, matrix: npt.ArrayLike, names: Sequence[str], offset: npt.ArrayLike | None = None
    ) -> LinearMatrixInequality:
        """Return the same inequality in variables y, where x = matrix y + offset.

        Parameters
        ----------
        matrix : (c, k)
        names : sequence of k str
        offset : (c,), optional

        Raises
        ------
        InputError
            If the shapes do not fit.

        """
        into, order = np.asarray(matrix, dtype=float), distinct_names(names)
        shift = np.zeros(len(self.names)) if offset is None else np.asarray(offset, dtype=float)
        if into.shape != (len(self.names), len(order)) or shift.shape != (len(self.names),):
            raise InputError(
                f"a change to {len(order)} variables needs a matrix of shape ({len(self.names)}, {len(order)}) and an "
                f"offset of shape ({len(self.names)},), got {into.shape} and {shift.shape}."
            )
        return replace(self, names=order, blocks=tuple(block.substitute(into, shift) for block in self.blocks))

    def program(self, objective: Any) -> SemidefiniteProgram:
        """The problem of minimising a linear expression subject to this inequality, for solvers and SDPA files.

        Parameters
        ----------
        objective : str, LinearExpression, mapping from name to float, or (c,)
            A constant in it has no effect.

        Returns
        -------
        SemidefiniteProgram
            Its matrices are F₀ = -D₀ and Fᵢ = Dᵢ; names of variables and blocks are kept.
            Strict inequalities become non-strict ones; see `with_margin`.

        Raises
        ------
        InputError
            If the objective is not affine in the variables of the inequality.
        """
        if not self.names or not self.blocks:
            raise InputError(f"{self!r} has no variable or no block; there is nothing to minimise.")
        parts: list[tuple[npt.NDArray[np.intp], ...]] = []
        values: list[Vector] = []
        for place, block in enumerate(self.blocks):
            # The first matrix of `stacked` belongs to F₀, which has the opposite sign.
            stacked = np.concatenate([-block.constant[None], block.coefficients])
            which, row, column = np.nonzero(np.triu(stacked))
            matrices = np.concatenate([[0], block.indices + 1]).astype(np.intp)[which]
            parts.append((matrices, np.full(len(row), place, dtype=np.intp), row, column))
            values.append(stacked[which, row, column])
        joined = [np.concatenate(part) for part in zip(*parts, strict=True)]
        value = np.concatenate(values)
        order = np.lexsort((joined[3], joined[2], joined[1], joined[0]))
        matrix, where, row, column = (part[order] for part in joined)
        return SemidefiniteProgram(
            cost=_cost(objective, self.names),
            block_sizes=tuple(block.size for block in self.blocks),
            matrix=matrix,
            block=where,
            row=row,
            column=column,
            value=value[order],
            variable_names=self.names,
            block_names=tuple(block.name for block in self.blocks),
        )

    # How it is shown

    def pretty(self, most: int = _SHOWN) -> str:
        """The matrices with their expressions; rows and columns beyond `most` become dots."""
        sign = "≻ 0" if self.strict else "⪰ 0"
        matrices = zip(self.blocks, self.expressions, strict=True)
        return "\n".join(f"{block.name}:\n{matrix_text(matrix, most)} {sign}" for block, matrix in matrices)

    def latex(self, most: int = _SHOWN) -> str:
        """The matrices in LaTeX, one a line, to stand in a ``gather`` or ``aligned``."""
        sign = r"\succ 0" if self.strict else r"\succeq 0"
        return " \\\\\n".join(f"{latex_matrix(matrix, most)} {sign}" for matrix in self.expressions)

    def __str__(self) -> str:
        return self.pretty()

    def __repr__(self) -> str:
        sizes = [block.size for block in self.blocks]
        if len(sizes) > 6 or not sizes:
            orders = f"of {self.size} rows in all"
        else:
            *first, last = map(str, sizes)
            orders = f"of orders {', '.join(first)} and {last}" if first else f"of order {last}"
        plural = "" if len(sizes) == 1 else "s"
        shown = f"{len(self.names)} variables" if len(self.names) > 8 else ", ".join(self.names) or "no variables"
        strict = ", strict" if self.strict else ""
        return f"LinearMatrixInequality({len(sizes)} block{plural}, {orders}, in {shown}{strict})"

    def _repr_html_(self) -> str:
        sign = "≻ 0" if self.strict else "⪰ 0"
        parts = "".join(
            f"<p>{html.escape(block.name)} {sign}</p>{matrix_html(matrix)}"
            for block, matrix in zip(self.blocks, self.expressions, strict=True)
        )
        return f"<p>{html.escape(repr(self))}</p>{parts}"


def block_diagonal(*inequalities: LinearMatrixInequality) -> LinearMatrixInequality:
    """Combine several inequalities into one block-diagonal inequality, like ``a & b`` for two (thesis 3.25).

    Parameters
    ----------
    *inequalities : LinearMatrixInequality
        The result has the variables of all of them, by name, in the order of their first appearance. It is strict if
        all of them are.

    Raises
    ------
    InputError
        If there are none, or strict and non-strict ones are mixed.
    """
    if not inequalities:
        raise InputError("block_diagonal needs at least one inequality.")
    if len({inequality.strict for inequality in inequalities}) > 1:
        raise InputError(
            "strict and non-strict inequalities cannot be put together; give the strict ones a margin with with_margin."
        )
    names = tuple(dict.fromkeys(name for inequality in inequalities for name in inequality.names))
    blocks = tuple(block for inequality in inequalities for block in inequality.with_names(names).blocks)
    return LinearMatrixInequality(names, blocks, inequalities[0].strict)


def _cost(objective: Any, names: tuple[str, ...]) -> Vector:
    if not isinstance(objective, str | Mapping | LinearExpression) and np.ndim(objective) == 1:
        return values_as_vector(objective, names)
    expression = as_expression(objective, names, "objective")
    return np.array([expression.coefficient(name) for name in names])


def inequality_of_program(program: SemidefiniteProgram, names: Sequence[str] | None = None) -> LinearMatrixInequality:
    """The inequality Σ xᵢ Fᵢ - F₀ ⪰ 0 of a semidefinite program, such as one that was read from an SDPA file.

    Parameters
    ----------
    program : SemidefiniteProgram
    names : sequence of str, optional
        Names of the variables; by default those of the program, or x1, x2, ... if it has none.

    Returns
    -------
    LinearMatrixInequality
        Each element of a diagonal block is a 1 x 1 block of its own.

    Raises
    ------
    InputError
        If the number of names does not fit, or a block is too large.

    Examples
    --------
    >>> program = LinearMatrixInequality.from_matrices([["x", 1], [1, "y"]]).program("x + y")
    >>> print(inequality_of_program(program))
    block 1:
    ⎡ x  1 ⎤
    ⎣ 1  y ⎦ ⪰ 0
    """
    count = len(program.cost)
    given = names if names is not None else program.variable_names or [f"x{i + 1}" for i in range(count)]
    variables = distinct_names(given)
    if len(variables) != count:
        raise InputError(f"the program has {count} variables, got {len(variables)} names; name each of them.")
    titles = program.block_names or tuple(f"block {i + 1}" for i in range(len(program.block_sizes)))
    order = np.argsort(program.block, kind="stable")
    ends = np.searchsorted(program.block[order], np.arange(len(titles) + 1))
    blocks: list[AffineBlock] = []
    for place, (title, size) in enumerate(zip(titles, program.block_sizes, strict=True)):
        own = order[ends[place] : ends[place + 1]]
        if size > 0:
            blocks.append(_block(program, own, np.zeros(len(own), dtype=np.intp), size, title))
            continue
        for element in range(-size):
            chosen = own[program.row[own] == element]
            label = title if size == -1 else f"{title}, element {element + 1}"
            blocks.append(_block(program, chosen, np.full(len(chosen), element, dtype=np.intp), 1, label))
    return LinearMatrixInequality(variables, tuple(blocks))


def _block(
    program: SemidefiniteProgram,
    entries: npt.NDArray[np.intp],
    offset: npt.NDArray[np.intp],
    size: int,
    label: str,
) -> AffineBlock:
    matrix, value = program.matrix[entries], program.value[entries]
    row, column = program.row[entries] - offset, program.column[entries] - offset
    used = np.unique(matrix[matrix > 0])
    if (len(used) + 1) * size**2 > MOST_NUMBERS:
        raise InputError(
            f"{label!r} is of order {size} and depends on {len(used)} variables, which would take more than "
            f"{MOST_NUMBERS:,} numbers; split it into smaller blocks."
        )
    constant = np.zeros((size, size))
    coefficients = np.zeros((len(used), size, size))
    fixed, free = matrix == 0, matrix > 0
    constant[row[fixed], column[fixed]] = constant[column[fixed], row[fixed]] = -value[fixed]
    which = np.searchsorted(used, matrix[free])
    coefficients[which, row[free], column[free]] = coefficients[which, column[free], row[free]] = value[free]
    return AffineBlock(label, constant, (used - 1).astype(np.intp), coefficients, "constraint")


Entries = Sequence[Sequence[Any]] | Any

_GREEK = {
    *("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu", "nu"),
    *("xi", "pi", "rho", "sigma", "tau", "upsilon", "phi", "chi", "psi", "omega"),
}


def matrix_text(matrix: Entries, most: int) -> str:
    """Rows between brackets, columns aligned; rows and columns beyond `most` become dots.

    Examples
    --------
    >>> print(matrix_text([["m1", "0"], ["0", "2*m1 - 1"]], 10))
    ⎡ m1  0        ⎤
    ⎣ 0   2*m1 - 1 ⎦
    """
    cells = [[str(element) for element in row] for row in _shortened(matrix, most, "⋯", "⋮", "⋱")]
    widths = [max(len(row[j]) for row in cells) for j in range(len(cells))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in cells]
    if len(lines) == 1:
        return f"[ {lines[0]} ]"
    left, right = "⎡" + "⎢" * (len(lines) - 2) + "⎣", "⎤" + "⎥" * (len(lines) - 2) + "⎦"
    return "\n".join(f"{a} {line} {b}" for a, line, b in zip(left, lines, right, strict=True))


def latex_matrix(matrix: Entries, most: int) -> str:
    r"""A ``bmatrix``.

    Examples
    --------
    >>> latex_matrix([[LinearExpression({"Lxx1": 1.0, "m1": -0.5}, 2.0)]], 10)
    '\\begin{bmatrix} L_{xx1} - 0.5\\, m_{1} + 2 \\end{bmatrix}'
    """
    rows = _shortened(matrix, most, r"\cdots", r"\vdots", r"\ddots")
    body = r" \\ ".join(" & ".join(_latex(element) for element in row) for row in rows)
    return rf"\begin{{bmatrix}} {body} \end{{bmatrix}}"


def latex_name(name: str) -> str:
    r"""A variable as a letter with an index, as in the thesis.

    Examples
    --------
    >>> latex_name("Lyy3"), latex_name("beta12"), latex_name("Fv1"), latex_name("u")
    ('L_{yy3}', '\\beta_{12}', 'F_{v1}', 'u')
    """
    found = re.fullmatch(r"([A-Za-z]+)_?(.*)", name, flags=re.DOTALL)
    if found is None:
        return rf"\text{{{_escaped(name)}}}"
    letters, rest = found.groups()
    if letters in _GREEK:
        head, index = f"\\{letters}", rest
    else:
        head, index = letters[0], name[1:].lstrip("_")
    return f"{head}_{{{_escaped(index)}}}" if index else head


def matrix_html(matrix: Entries) -> str:
    """An HTML table."""
    rows = _shortened(matrix, _SHOWN, "⋯", "⋮", "⋱")
    body = "".join(f"<tr>{''.join(f'<td>{html.escape(str(x))}</td>' for x in row)}</tr>" for row in rows)
    return f'<table style="border-left: 1px solid; border-right: 1px solid">{body}</table>'


def _shortened(matrix: Entries, most: int, across: str, down: str, diagonal: str) -> list[list[Any]]:
    size = len(matrix)
    if size <= most:
        return [list(row) for row in matrix]
    tail = max(1, (most - 1) // 3)
    head = max(1, most - 1 - tail)
    shown = [*range(head), None, *range(size - tail, size)]
    rows: list[list[Any]] = []
    for i in shown:
        if i is None:
            rows.append([diagonal if j is None else down for j in shown])
        else:
            rows.append([across if j is None else matrix[i][j] for j in shown])
    return rows


def _latex(element: object) -> str:
    if not isinstance(element, LinearExpression):
        return str(element)
    parts = [(value, latex_name(name)) for name, value in element.terms.items()]
    text = ""
    for value, name in parts:
        size = "" if abs(value) == 1.0 else rf"{_latex_number(abs(value))}\, "
        text += _joined(text, value < 0, size + name)
    if element.constant != 0.0 or not parts:
        text += _joined(text, element.constant < 0, _latex_number(abs(element.constant)))
    return text


def _joined(before: str, negative: bool, part: str) -> str:
    if not before:
        return f"-{part}" if negative else part
    return f" {'-' if negative else '+'} {part}"


def _latex_number(value: float) -> str:
    mantissa, _, exponent = number_text(value).partition("e")
    return rf"{mantissa} \cdot 10^{{{int(exponent)}}}" if exponent else mantissa


def _escaped(text: str) -> str:
    return re.sub(r"([\\{}$&#^_%~])", lambda found: "\\" + found[1] if found[1] not in "\\^~" else " ", text)
