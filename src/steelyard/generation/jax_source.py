"""Python with JAX: functions to compile, map and differentiate."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from .assignments import Listing
from .naming import NamedFunction
from .python_project import PythonProject, shape_literal

if TYPE_CHECKING:
    from .project import Project

__all__ = ["write"]


def write(project: Project) -> dict[str, str]:
    """Return the files of a JAX project by relative path.

    Parameters
    ----------
    project : Project
    """
    return _JaxProject(project).files()


class _JaxProject(PythonProject):
    title = "Python for JAX"
    requirement = "jax"
    reserved = frozenset({"jax", "jnp", "annotations", "_checked", "_stacked"})
    calls: ClassVar[dict[str, str]] = {"sin": "jnp.sin({})", "cos": "jnp.cos({})", "sign": "jnp.sign({})"}

    def head(self) -> list[str]:
        return [
            "import jax",
            "import jax.numpy as jnp",
            "",
            "",
            "def _checked(name: str, values: jax.typing.ArrayLike, size: int) -> jax.Array:",
            "    array = jnp.asarray(values)",
            "    if array.ndim == 0 or array.shape[-1] != size:",
            '        raise ValueError(f"{name} must have shape (..., {size}), got {array.shape}")',
            "    return jnp.moveaxis(array, -1, 0)",
            "",
            "",
            "def _stacked(elements: list, leading: tuple, shape: tuple) -> jax.Array:",
            "    columns = [jnp.broadcast_to(element, leading) for element in elements]",
            "    return jnp.stack(columns, axis=-1).reshape((*leading, *shape))",
            "",
        ]

    def definition(self, named: NamedFunction, found: Listing, documentation: list[str]) -> list[str]:
        function, names = named.function, named.names
        arguments = [names[argument.name] for argument in function.arguments]
        kind = (
            f"tuple[{', '.join(['jax.Array'] * len(function.outputs))}]" if len(function.outputs) > 1 else "jax.Array"
        )
        typed = ", ".join(f"{name}: jax.typing.ArrayLike" for name in arguments)
        lines = [f"def {named.name}({typed}) -> {kind}:", *documentation]
        leading = named.scope.take("leading")
        for argument, name in zip(function.arguments, arguments, strict=True):
            lines.append(f'    {name} = _checked("{name}", {name}, {argument.width})')
        shapes = ", ".join(f"{name}.shape[1:]" for name in arguments)
        lines.append(f"    {leading} = jnp.broadcast_shapes({shapes})")
        lines += [f"    {a.name} = {a.expression}" for a in found.assignments]
        for output, elements in zip(function.outputs, found.outputs, strict=True):
            name = names[output.name]
            lines += [f"    {name} = [", *(f"        {text}," for text in elements.elements), "    ]"]
            lines.append(f"    {name} = _stacked({name}, {leading}, {shape_literal(output)})")
        return [*lines, f"    return {', '.join(names[output.name] for output in function.outputs)}"]

    def comparison(self) -> list[str]:
        return [
            "import jax",
            "import numpy as np",
            "",
            'jax.config.update("jax_enable_x64", True)  # the reference values are of double precision',
            "",
            f"import {self.name} as module  # noqa: E402",
            "",
            "",
            "def evaluated(function, arrays):",
            "    results = function(*map(np.array, arrays))",
            "    return [np.ravel(r) for r in (results if isinstance(results, tuple) else (results,))]",
        ]

    def use(self) -> list[str]:
        named = self.functions[0]
        arguments = ", ".join(named.names[argument.name] for argument in named.function.arguments)
        return [
            "```python",
            "import jax",
            "",
            'jax.config.update("jax_enable_x64", True)  # for double precision; JAX computes in single without it',
            f"import {self.name}",
            "",
            f"compiled = jax.jit({self.name}.{named.name})",
            f"slope = jax.jacfwd({self.name}.{named.name})({arguments})",
            "```",
            "",
            "Arguments are arrays of shape (..., width); `jit`, `vmap`, `grad`, `jacfwd` and `jacrev` apply. The",
            "derivative of the sign is 0.",
        ]
