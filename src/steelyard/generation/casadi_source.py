"""Python with CasADi: functions that CasADi differentiates, maps and turns into code."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

from .assignments import Listing
from .naming import NamedFunction
from .python_project import PythonProject

if TYPE_CHECKING:
    from .project import Project

__all__ = ["write"]


def write(project: Project) -> dict[str, str]:
    """Return the files of a CasADi project by relative path.

    Parameters
    ----------
    project : Project
    """
    return _CasadiProject(project).files()


class _CasadiProject(PythonProject):
    title = "Python for CasADi"
    requirement = "casadi"
    reserved = frozenset({"casadi", "annotations", "_shaped"})
    calls: ClassVar[dict[str, str]] = {"sin": "casadi.sin({})", "cos": "casadi.cos({})", "sign": "casadi.sign({})"}

    def head(self) -> list[str]:
        return [
            "import casadi",
            "",
            "",
            "def _shaped(elements: list, rows: int, columns: int) -> casadi.SX:",
            "    # CasADi fills columns first, the elements come row by row.",
            "    return casadi.reshape(casadi.vertcat(*elements), columns, rows).T",
            "",
        ]

    def definition(self, named: NamedFunction, found: Listing, documentation: list[str]) -> list[str]:
        function, names = named.function, named.names
        lines = [f"def {named.name}() -> casadi.Function:", *documentation]
        for argument in function.arguments:
            name = names[argument.name]
            lines.append(f'    {name} = casadi.SX.sym("{name}", {argument.width})')
        lines += [f"    {a.name} = {a.expression}" for a in found.assignments]
        for output, elements in zip(function.outputs, found.outputs, strict=True):
            name = names[output.name]
            columns = output.shape[-1] if len(output.shape) > 1 else 1
            rows = math.prod(output.shape) // columns
            lines += [f"    {name} = [", *(f"        {text}," for text in elements.elements), "    ]"]
            lines.append(f"    {name} = _shaped({name}, {rows}, {columns})")
        inputs = [names[a.name] for a in function.arguments]
        outputs = [names[o.name] for o in function.outputs]
        quoted = ["[" + ", ".join(f'"{name}"' for name in group) + "]" for group in (inputs, outputs)]
        arrays = [f"[{', '.join(group)}]" for group in (inputs, outputs)]
        return [*lines, f'    return casadi.Function("{named.name}", {", ".join([*arrays, *quoted])})']

    def comparison(self) -> list[str]:
        return [
            "import casadi",
            f"import {self.name} as module",
            "",
            "",
            "def evaluated(function, arrays):",
            "    results = function().call([casadi.DM(array) for array in arrays])",
            '    return [result.T.full().ravel(order="F") for result in results]',
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
            "Each call builds a `casadi.Function` with named inputs and outputs. A number is 1 x 1; an array of more",
            "than two dimensions stands as a matrix whose columns are its last dimension.",
        ]
