"""Graph functions as functions of CasADi."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from steelyard.errors import MissingExtraError
from steelyard.graph import Function

from .evaluation import evaluate_over

if TYPE_CHECKING:
    import casadi

__all__ = ["casadi_function"]


def casadi_function(function: Function) -> casadi.Function:
    """Return a function for CasADi, which differentiates it, finds sparsity, and solves optimal control with it.

    The function is of SX type: scalar operations, the same and in the same order as in the graph. Inputs and outputs
    keep their names. An argument is a column (width, 1); batches go through CasADi's ``map``.

    An output of shape () is (1, 1), of shape (n,) a column (n, 1), of shape (n, m) a matrix (n, m). CasADi has no
    arrays of more dimensions: an output of shape (k, n, m) is the k matrices (n, m) below one another, (k n, m), so
    that ``numpy.asarray(value).reshape(k, n, m)`` restores it. The same holds for more dimensions.

    Derivatives of a sign are 0.

    Parameters
    ----------
    function : Function

    Returns
    -------
    casadi.Function
        With the name of the graph function, changed where CasADi would refuse it: ``jac``, ``hess``, ``null``, and
        doubled underscores.

    Raises
    ------
    MissingExtraError
        If CasADi is not installed.

    Examples
    --------
    >>> from steelyard.graph import Argument, Graph, Output, sin
    >>> x = Graph().inputs("x", 2)
    >>> f = casadi_function(Function("f", (Argument("x", 2),), (Output("y", (1, 2), (sin(x[0]), x[0] * x[1])),)))
    >>> f
    Function(f:(x[2])->(y[1x2]) SXFunction)
    >>> f([0.0, 3.0])
    DM([[0, 0]])
    >>> f.factory("g", ["x"], ["jac:y:x"])([0.0, 3.0])
    DM(
    [[1, 00],
     [3, 0]])
    """
    try:
        import casadi
    except ImportError as error:
        raise MissingExtraError(
            "CasADi functions need the package casadi, which is not installed; pip install 'steelyard[casadi]'."
        ) from error
    inputs = [casadi.SX.sym(argument.name, argument.width) for argument in function.arguments]
    elements = {a.name: casadi.vertsplit(x) for a, x in zip(function.arguments, inputs, strict=True)}
    unary = {"sin": casadi.sin, "cos": casadi.cos, "sign": casadi.sign, "sqrt": casadi.sqrt}
    outputs = [
        _shaped(casadi, casadi.vertcat(*values), output.shape)
        for output, values in zip(function.outputs, evaluate_over(function, elements, unary, casadi.SX), strict=True)
    ]
    name = function.name
    if not casadi.Function.check_name(name):
        name = casadi.Function.fix_name(name)
    return casadi.Function(
        name, inputs, outputs, [a.name for a in function.arguments], [o.name for o in function.outputs]
    )


def _shaped(casadi: Any, column: Any, shape: tuple[int, ...]) -> Any:
    """Return row-major elements as a matrix; CasADi's own order is column-major."""
    if len(shape) < 2:
        return column
    width = shape[-1]
    rows = column.numel() // width if width else 0
    return casadi.reshape(column, width, rows).T
