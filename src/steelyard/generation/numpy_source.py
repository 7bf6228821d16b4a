"""Python with NumPy: a module of functions over any leading dimensions."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from .assignments import Listing
from .naming import NamedFunction
from .python_project import PythonProject, shape_literal

if TYPE_CHECKING:
    from .project import Project

__all__ = ["write"]


def write(project: Project) -> dict[str, str]:
    """Return the files of a Python project by relative path.

    Parameters
    ----------
    project : Project
    """
    return _NumPyProject(project).files()


class _NumPyProject(PythonProject):
    title = "Python"
    requirement = "numpy"
    reserved = frozenset({"np", "ArrayLike", "NDArray", "annotations", "_checked", "_leading"})
    calls: ClassVar[dict[str, str]] = {"sin": "np.sin({})", "cos": "np.cos({})", "sign": "np.sign({})"}

    def head(self) -> list[str]:
        return [
            "import numpy as np",
            "from numpy.typing import ArrayLike, NDArray",
            "",
            "",
            "def _checked(name: str, values: ArrayLike, size: int) -> NDArray[np.float64]:",
            "    array = np.asarray(values, dtype=np.float64)",
            "    if array.ndim == 0 or array.shape[-1] != size:",
            '        raise ValueError(f"{name} must have shape (..., {size}), got {array.shape}")',
            "    return array",
            "",
        ]

    def definition(self, named: NamedFunction, found: Listing, documentation: list[str]) -> list[str]:
        function, names = named.function, named.names
        arguments = [names[argument.name] for argument in function.arguments]
        several = len(function.outputs) > 1
        array = "NDArray[np.float64]"
        kind = f"tuple[{', '.join([array] * len(function.outputs))}]" if several else array
        lines = [f"def {named.name}({', '.join(f'{name}: ArrayLike' for name in arguments)}) -> {kind}:"]
        lines += documentation
        leading = named.scope.take("leading")
        for argument, name in zip(function.arguments, arguments, strict=True):
            lines.append(f'    {name} = _checked("{name}", {name}, {argument.width})')
        shapes = ", ".join(f"{name}.shape[:-1]" for name in arguments)
        lines.append(f"    {leading} = np.broadcast_shapes({shapes})")
        lines += [f"    {name} = np.moveaxis({name}, -1, 0)" for name in arguments]
        lines += [f"    {a.name} = {a.expression}" for a in found.assignments]
        for output, elements in zip(function.outputs, found.outputs, strict=True):
            name = names[output.name]
            make = "zeros" if elements.mostly_zero else "empty"
            lines.append(f"    {name} = np.{make}((*{leading}, {output.size}))")
            lines += [f"    {name}[..., {k}] = {text}" for k, text in elements.stored]
            lines.append(f"    {name} = {name}.reshape((*{leading}, *{shape_literal(output)}))")
        return [*lines, f"    return {', '.join(names[output.name] for output in function.outputs)}"]

    def comparison(self) -> list[str]:
        return [
            "import numpy as np",
            f"import {self.name} as module",
            "",
            "",
            "def evaluated(function, arrays):",
            "    results = function(*map(np.array, arrays))",
            "    return [np.ravel(r) for r in (results if isinstance(results, tuple) else (results,))]",
        ]

    def use(self) -> list[str]:
        named = self.functions[0]
        outputs = ", ".join(named.names[output.name] for output in named.function.outputs)
        arguments = ", ".join(named.names[argument.name] for argument in named.function.arguments)
        return [
            "```python",
            f"import {self.name}",
            "",
            f"{outputs} = {self.name}.{named.name}({arguments})",
            "```",
            "",
            "Arguments are arrays of shape (..., width) for one sample or many; leading dimensions are broadcast,",
            "so that parameters may be given once for all.",
        ]
