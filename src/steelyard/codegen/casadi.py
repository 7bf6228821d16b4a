"""CasADi: graph functions as its functions, and source projects in Python that build them."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.errors import require_package
from steelyard.graph import Function, evaluate_over

from .assignments import CALLS
from .naming import NamedFunction
from .python_project import PythonProject

__all__ = ["casadi_function", "write"]


if TYPE_CHECKING:
    import casadi


def casadi_function(function: Function) -> casadi.Function:
    """Return a function for CasADi, which differentiates it, finds sparsity, and solves optimal control with it.

    The function is of SX type: scalar operations, the same and in the same order as in the graph. Inputs and outputs
    keep their names. An argument is a column (width, 1); batches go through CasADi's ``map``.

    An output of shape () is (1, 1), of shape (n,) a column (n, 1), of shape (n, m) a matrix (n, m). CasADi has no
    arrays of more dimensions: an output of shape (k, n, m) is the k matrices (n, m) below one another, (k n, m), so
    that ``numpy.asarray(value).reshape(k, n, m)`` restores it. The same holds for more dimensions.

    Derivatives of a sign are 0.

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
    require_package("casadi", "CasADi functions need the package", "casadi")
    import casadi

    inputs = [casadi.SX.sym(argument.name, argument.width) for argument in function.arguments]
    elements = {a.name: casadi.vertsplit(x) for a, x in zip(function.arguments, inputs, strict=True)}
    unary = {"sin": casadi.sin, "cos": casadi.cos, "sign": casadi.sign, "sqrt": casadi.sqrt}
    unary |= {"exp": casadi.exp, "log": casadi.log}
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


_HEAD = '''import casadi


def _shaped(elements: list[casadi.SX | float], rows: int, columns: int) -> casadi.SX:
    """Return elements, which come row by row, as a matrix; CasADi fills columns first."""
    return casadi.reshape(casadi.vertcat(*map(casadi.SX, elements)), columns, rows).T
'''


class _CasadiProject(PythonProject):
    title = "Python for CasADi"
    requirements = ("casadi>=3.6.5",)
    reserved = frozenset({"casadi", "_shaped"})
    calls: ClassVar[dict[str, str]] = {name: f"casadi.{name}({{}})" for name in CALLS}
    batches = False

    def introduction(self) -> list[str]:
        return [
            "Every function builds a casadi.Function with named inputs, which are columns, and named outputs. Its "
            "map() computes many samples, its jacobian() and factory() differentiate; the derivative of a sign is 0. "
            "A number is 1 x 1; an array of more than two dimensions stands as its matrices below one another.",
        ]

    def head(self) -> list[str]:
        return _HEAD.splitlines()

    def definition(self, index: int, named: NamedFunction) -> list[str]:
        function, names = named.function, named.names
        found = self.listing(named)
        lines = [f"def {named.name}() -> casadi.Function:", *self.documented_builder(named)]
        for argument in function.arguments:
            name = names[argument.name]
            lines.append(f'    {name} = casadi.SX.sym("{name}", {self.size(named, argument.name)})')
        lines += [f"    {a.name} = {a.expression}" for a in found.assignments]
        for output, elements in zip(function.outputs, found.outputs, strict=True):
            name = names[output.name]
            columns = output.shape[-1] if len(output.shape) > 1 else 1
            lines += [f"    {name} = _shaped(", "        ["]
            lines += [f"            {text}," for text in elements.elements]
            lines += ["        ],", f"        {output.size // columns},", f"        {columns},", "    )"]
        groups = [named.argument_names, named.output_names]
        parts = [f'"{_function_name(named.name)}"', *(f"[{', '.join(group)}]" for group in groups)]
        parts += ["[" + ", ".join(f'"{name}"' for name in group) + "]" for group in groups]
        return [*lines, "    return casadi.Function(", *(f"        {part}," for part in parts), "    )"]

    def comparison(self) -> list[str]:
        return [
            "import casadi",
            "",
            f"import {self.name} as module",
            "",
            "",
            "def evaluated(function, arrays):",
            "    results = function().call([casadi.DM(array) for array in arrays])",
            "    return [result.full().ravel().tolist() for result in results]",
        ]

    def use(self) -> list[str]:
        named = self.functions[0]
        return [
            "```python",
            f"import {self.name}",
            "",
            f"function = {self.name}.{named.name}()",
            "slopes = function.jacobian()",
            "```",
            "",
            "Each call builds a `casadi.Function` with named inputs and outputs; keep it. A number is 1 x 1; an array",
            "of more than two dimensions stands as its matrices below one another, so that NumPy's `reshape` restores",
            "it. The derivative of a sign is 0.",
        ]


write = _CasadiProject.write


def _function_name(name: str) -> str:
    """Return a name that CasADi takes for a function: no doubled underscores, none of its three words.

    Examples
    --------
    >>> _function_name("a__b"), _function_name("jac"), _function_name("jacobian")
    ('a_b', 'jac_function', 'jacobian')
    """
    plain = re.sub("_+", "_", name)
    return f"{plain}_function" if plain in ("null", "jac", "hess") else plain
