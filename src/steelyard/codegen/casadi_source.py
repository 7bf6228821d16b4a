"""Python with CasADi: functions that CasADi differentiates, maps and turns into code."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, ClassVar

from .assignments import CALLS
from .naming import NamedFunction
from .python_project import PythonProject

if TYPE_CHECKING:
    from .project import Project

__all__ = ["write"]

_HEAD = '''import casadi


def _shaped(elements: list[casadi.SX | float], rows: int, columns: int) -> casadi.SX:
    """Return elements, which come row by row, as a matrix; CasADi fills columns first."""
    return casadi.reshape(casadi.vertcat(*map(casadi.SX, elements)), columns, rows).T
'''


def write(project: Project) -> dict[str, str]:
    """Return the files of a CasADi project by relative path.

    Parameters
    ----------
    project : Project
    """
    return _CasadiProject(project).files()


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
        lines = [f"def {named.name}() -> casadi.Function:", *self.documented_builder(named, "casadi.Function")]
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
        groups = [[names[a.name] for a in function.arguments], [names[o.name] for o in function.outputs]]
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


def _function_name(name: str) -> str:
    """Return a name that CasADi takes for a function: no doubled underscores, none of its three words.

    Examples
    --------
    >>> _function_name("a__b"), _function_name("jac"), _function_name("jacobian")
    ('a_b', 'jac_function', 'jacobian')
    """
    plain = re.sub("_+", "_", name)
    return f"{plain}_function" if plain in ("null", "jac", "hess") else plain
