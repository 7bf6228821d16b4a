"""Inequalities as semidefinite programs, the form that SDPA files hold, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError

from .affine import AffineBlock
from .expression import LinearExpression, distinct_names
from .expression_reader import as_expression
from .inequality import LinearMatrixInequality
from .values import values_as_vector

if TYPE_CHECKING:
    from steelyard.conic import SemidefiniteProgram

__all__ = ["inequality_of_program", "program_of_inequality"]

Vector = npt.NDArray[np.float64]

_MOST_NUMBERS = 50_000_000
"""The coefficient matrices of a block may hold this many numbers (400 MB)."""


def program_of_inequality(inequality: LinearMatrixInequality, objective: Any) -> SemidefiniteProgram:
    """The problem of minimising a linear expression subject to D(x) ⪰ 0; see `LinearMatrixInequality.program`.

    The matrices of the program are F₀ = -D₀ and Fᵢ = Dᵢ; names of variables and blocks are kept.
    """
    from steelyard.conic import SemidefiniteProgram

    if not inequality.names or not inequality.blocks:
        raise InputError(f"{inequality!r} has no variable or no block; there is nothing to minimise.")
    parts: list[tuple[npt.NDArray[np.intp], ...]] = []
    values: list[Vector] = []
    for place, block in enumerate(inequality.blocks):
        # Element (0, 0, 0) of `stacked` belongs to F₀, whose sign is the other one.
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
        cost=_cost(objective, inequality.names),
        block_sizes=tuple(block.size for block in inequality.blocks),
        matrix=matrix,
        block=where,
        row=row,
        column=column,
        value=value[order],
        variable_names=inequality.names,
        block_names=tuple(block.name for block in inequality.blocks),
    )


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
        Of the variables; those of the program where absent, or x1, x2, ... where it has none.

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
    if (len(used) + 1) * size**2 > _MOST_NUMBERS:
        raise InputError(f"{label!r} is of order {size} and depends on {len(used)} variables, which is too large.")
    constant = np.zeros((size, size))
    coefficients = np.zeros((len(used), size, size))
    fixed, free = matrix == 0, matrix > 0
    constant[row[fixed], column[fixed]] = constant[column[fixed], row[fixed]] = -value[fixed]
    which = np.searchsorted(used, matrix[free])
    coefficients[which, row[free], column[free]] = coefficients[which, column[free], row[free]] = value[free]
    return AffineBlock(label, constant, (used - 1).astype(np.intp), coefficients, "constraint")
