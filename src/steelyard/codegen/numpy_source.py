"""Python with NumPy: a module of functions over any leading axes."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from .assignments import CALLS
from .naming import NamedFunction
from .python_project import EVALUATED_ON_ARRAYS, PythonProject, shape_literal

if TYPE_CHECKING:
    from .project import Project

__all__ = ["write"]

_HEAD = '''import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def _columns(name: str, values: ArrayLike, size: int) -> Array:
    """Return an argument with its last axis first."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != size:
        raise ValueError(f"{name} must have shape (..., {size}), got {array.shape}")
    return np.moveaxis(array, -1, 0)
'''


def write(project: Project) -> dict[str, str]:
    """Return the files of a Python project by relative path.

    Parameters
    ----------
    project : Project
    """
    return _NumPyProject(project).files()


class _NumPyProject(PythonProject):
    title = "Python"
    requirements = ("numpy>=1.21",)
    reserved = frozenset({"np", "ArrayLike", "NDArray", "Array", "_columns"})
    calls: ClassVar[dict[str, str]] = {name: f"np.{name}({{}})" for name in CALLS}

    def introduction(self) -> list[str]:
        return [
            "Every function takes arrays (..., width) with any leading axes, which broadcast: one sample, or many at "
            "once. It keeps nothing and changes none of its arguments. An argument of another width raises ValueError.",
        ]

    def head(self) -> list[str]:
        return _HEAD.splitlines()

    def definition(self, index: int, named: NamedFunction) -> list[str]:
        function, names = named.function, named.names
        found = self.listing(named)
        results = [names[output.name] for output in function.outputs]
        kind = f"tuple[{', '.join(['Array'] * len(results))}]" if len(results) > 1 else "Array"
        lines = [*self.signature(named, "ArrayLike", kind), *self.documentation(named, "ndarray")]
        leading = named.scope.inner().take("leading")
        shapes = []
        for argument in function.arguments:
            name = names[argument.name]
            lines.append(f'    {name} = _columns("{name}", {name}, {self.size(named, argument.name)})')
            shapes.append(f"{name}.shape[1:]")
        lines.append(f"    {leading} = np.broadcast_shapes({', '.join(shapes)})")
        lines += [f"    {a.name} = {a.expression}" for a in found.assignments]
        for output, elements in zip(function.outputs, found.outputs, strict=True):
            name = names[output.name]
            make = "zeros" if elements.mostly_zero else "empty"
            lines.append(f"    {name} = np.{make}((*{leading}, {self.size(named, output.name)}))")
            lines += [f"    {name}[..., {k}] = {text}" for k, text in elements.stored]
            if len(output.shape) != 1:
                lines.append(f"    {name} = {name}.reshape((*{leading}, *{shape_literal(output)}))")
        return [*lines, f"    return {', '.join(results)}"]

    def comparison(self) -> list[str]:
        return [
            "import numpy as np",
            "",
            f"import {self.name} as module",
            "",
            "",
            *EVALUATED_ON_ARRAYS,
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
            "Arguments are arrays of shape (..., width) for one sample or many; leading axes broadcast,",
            "so that parameters may be given once for all. A function with several outputs returns a tuple. Very long",
            "recordings are best computed in parts of some thousand samples, which stay in the processor's cache.",
        ]
