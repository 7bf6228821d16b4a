"""Several inequalities as one."""

from __future__ import annotations

from steelyard.errors import InputError

from .inequality import LinearMatrixInequality

__all__ = ["block_diagonal"]


def block_diagonal(*inequalities: LinearMatrixInequality) -> LinearMatrixInequality:
    """All of several inequalities as one, block-diagonal; ``a & b`` is the same for two (thesis 3.25).

    Parameters
    ----------
    *inequalities : LinearMatrixInequality
        The variables are all of theirs, by name, in the order of their first appearance. Strict where all are.

    Raises
    ------
    InputError
        Without any, or where strict and non-strict ones are mixed.
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
