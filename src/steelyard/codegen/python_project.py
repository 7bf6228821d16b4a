"""Source projects in Python: what all have in common (module, self-test, package description, README), and NumPy's."""

from __future__ import annotations

import keyword
import sys
from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from .assignments import CALLS, Listing, Syntax, listing
from .documentation import elements_lines, operations_line, readme, shape_text
from .naming import NamedFunction, naming, project_name, shadowing, shared_arguments
from .project import Project, SourceWriter
from .text import Names, comment_lines, comment_text, marker, number, number_lines

if TYPE_CHECKING:
    from steelyard.graph import Argument, Output

__all__ = ["EVALUATED_ON_ARRAYS", "PythonProject", "python_self_test", "shape_literal", "write"]


_CHECK = '''
class ReferenceValues(unittest.TestCase):
    """Each function must give its reference values."""

    def check(self, function, samples, expected, tolerances):
        for arrays, values in zip(samples, expected):
            results = evaluated(function, arrays)
            self.assertEqual(len(results), len(values))
            for result, value, tolerance in zip(results, values, tolerances):
                self.assertEqual(len(result), len(value))
                for k, (x, y) in enumerate(zip(result, value)):
                    message = f"element {k} is {x!r}, expected {y!r} within {tolerance}"
                    self.assertTrue(abs(x - y) <= tolerance, message)
'''


def python_self_test(project: Project, module: str, functions: Sequence[NamedFunction], comparison: list[str]) -> str:
    """Return the file that compares the functions of a module with their reference values.

    The lines of `comparison` import ``module`` and define ``evaluated``.
    """
    lines = [
        f"# {marker(project.version)}",
        f'"""Compare the functions of {module} with reference values: python -m unittest."""',
        "",
        "import unittest",
        "",
        *comparison,
        "",
        *_CHECK.rstrip("\n").split("\n"),
    ]
    for k, named in enumerate(functions):
        reference = project.references[named.function.name]
        lines += ["", f"    def test_{k + 1}_{named.name}(self):"]
        for name, arrays in (("samples", reference.inputs), ("expected", reference.outputs)):
            lines.append(f"        {name} = [")
            for sample in range(reference.samples):
                lines += ["            [", *_rows([array[sample] for array in arrays]), "            ],"]
            lines.append("        ]")
        tolerances = ", ".join(map(number, reference.tolerances))
        lines.append(f"        self.check(module.{named.name}, samples, expected, [{tolerances}])")
    return "\n".join([*lines, "", "", 'if __name__ == "__main__":', "    unittest.main()"]) + "\n"


def _rows(arrays: Sequence[NDArray[np.float64]]) -> list[str]:
    lines: list[str] = []
    for array in arrays:
        lines += ["                [", *number_lines(array, " " * 20), "                ],"]
    return lines


# What Python projects have in common: a module, its self-test, a package description, a README.

# A module of one of these names would hide another one, or be a folder of the build.
_MODULES = """
numpy jax jaxlib casadi pytest setuptools pip wheel test tests setup build dist conftest
"""
_PROJECT_RESERVED = frozenset([*_MODULES.split(), *keyword.kwlist, *keyword.softkwlist, *sys.stdlib_module_names])
_BUILTINS = """
annotations list tuple str int float len range zip map sum
"""
_RESERVED = frozenset([*_BUILTINS.split(), *keyword.kwlist])
_WIDTH = 100  # columns of a docstring


EVALUATED_ON_ARRAYS = (
    "def evaluated(function, arrays):",
    "    results = function(*map(np.array, arrays))",
    "    results = results if isinstance(results, tuple) else (results,)",
    "    return [np.ravel(result).tolist() for result in results]",
)
"""How a self-test calls a function of arrays, with NumPy as np."""


class PythonProject(SourceWriter):
    """Writes a project of one flavour of Python: with NumPy, JAX or CasADi."""

    title: ClassVar[str]
    requirements: ClassVar[tuple[str, ...]]
    python: ClassVar[str] = "3.9"
    reserved: ClassVar[frozenset[str]]
    calls: ClassVar[dict[str, str]]
    batches: ClassVar[bool] = True  # whether arguments have any leading axes

    def __init__(self, project: Project) -> None:
        super().__init__(project)
        self.name = project_name(project, _PROJECT_RESERVED)
        reserved = _RESERVED | self.reserved
        found = naming(project, Names(reserved), style=str.upper)
        self.functions, self.sizes = shadowing(found, reserved), found.sizes
        self.syntax = Syntax(calls=self.calls)

    def listing(self, named: NamedFunction) -> Listing:
        """List the assignments of a function."""
        return listing(named.function, self.syntax, named.names, named.scope)

    @abstractmethod
    def introduction(self) -> list[str]:
        """Return what the documentation of the module says about all the functions."""

    @abstractmethod
    def head(self) -> list[str]:
        """Return imports and private functions."""

    @abstractmethod
    def definition(self, index: int, named: NamedFunction) -> list[str]:
        """Return the definition of one function."""

    @abstractmethod
    def comparison(self) -> list[str]:
        """Return the lines of the self-test that define ``evaluated(function, arrays)``, a list of flat arrays."""

    @abstractmethod
    def use(self) -> list[str]:
        """Return lines of the README on how to call the functions."""

    def files(self) -> dict[str, str]:
        """Return the files by relative path."""
        described = {
            f"{self.name}.py": "the functions, their sizes, and what every argument is",
            f"test_{self.name}.py": "self-test with reference values",
            "pyproject.toml": "makes it installable",
        }
        use = [
            f"Copy `{self.name}.py`, or install the folder. The self-test, which pytest runs too:",
            "",
            "```sh",
            "python -m unittest",
            "```",
            "",
            *self.use(),
        ]
        layout = "Outputs have the shapes that are given."
        return {
            f"{self.name}.py": self._module(),
            f"test_{self.name}.py": python_self_test(self.project, self.name, self.functions, self.comparison()),
            "pyproject.toml": self._package(),
            "README.md": readme(self.project, self.title, described, use, self.functions, self.element, layout),
        }

    def element(self, name: str, index: int) -> str:
        """Return how a caller writes an element of an argument."""
        return f"{name}[..., {index}]" if self.batches else f"{name}[{index}]"

    def size(self, named: NamedFunction, item: str) -> str:
        """Return the name of the size of an argument or output."""
        return self.sizes.of[named.function.name, item]

    def signature(self, named: NamedFunction, kind: str, result: str) -> list[str]:
        """Return the first lines of a function that takes the arguments as `kind`."""
        typed = [f"{named.names[a.name]}: {kind}" for a in named.function.arguments]
        line = f"def {named.name}({', '.join(typed)}) -> {result}:"
        if len(line) <= _WIDTH:
            return [line]
        return [f"def {named.name}(", *(f"    {text}," for text in typed), f") -> {result}:"]

    def columns(self, named: NamedFunction, leading: str) -> list[str]:
        """Return the lines that bring arguments into columns, and their leading axes together."""
        names = named.argument_names
        sizes = [self.size(named, argument.name) for argument in named.function.arguments]
        lines = [f'    {name} = _columns("{name}", {name}, {size})' for name, size in zip(names, sizes, strict=True)]
        return [*lines, f"    {leading}.broadcast_shapes({', '.join(f'{name}.shape[1:]' for name in names)})"]

    def documentation(self, named: NamedFunction, kind: str) -> list[str]:
        """Return the docstring of a function that takes arrays, and whose outputs are of some type."""
        function = named.function
        shared = shared_arguments(self.project)
        lines = [comment_text(function.description) or f"Compute {named.name}.", ""]
        if function.arguments:
            lines += ["Parameters", "----------"]
        for argument in function.arguments:
            name = named.names[argument.name]
            lines += [f"{name} : array_like", f"    (..., {argument.width}) {comment_text(argument.description)}"]
            lines += self._elements(argument, name, argument in shared)
        lines += ["", "Returns", "-------"] if function.arguments else ["Returns", "-------"]
        for output in function.outputs:
            sizes = "".join(f", {size}" for size in output.shape)
            lines += [
                f"{named.names[output.name]} : {kind}",
                f"    (...{sizes}) {comment_text(output.description)}",
            ]
        lines += ["", "Notes", "-----", operations_line(function)]
        return self.docstring(lines)

    def _elements(self, argument: Argument, name: str, shared: bool) -> list[str]:
        if not argument.elements:
            return []
        if shared:
            return ["    Elements: see the module."]
        texts = [comment_text(text) for text in argument.elements]
        return ["", *(f"    * ``{self.element(name, k)}``: {text}" for k, text in enumerate(texts))]

    def documented_builder(self, named: NamedFunction) -> list[str]:
        """Return the docstring of a function that takes nothing and returns a `casadi.Function`."""
        function, names = named.function, named.names
        shared = shared_arguments(self.project)
        lines = [comment_text(function.description) or f"Compute {named.name}.", "", "Returns", "-------"]
        lines += ["casadi.Function", "    Inputs:" if function.arguments else "    It has no inputs."]
        for argument in function.arguments:
            name, text = names[argument.name], comment_text(argument.description)
            lines += ["", f"    * ``{name}`` ({argument.width}): {text}"]
            if argument not in shared:
                lines += self._elements(argument, name, False)
            elif argument.elements:
                lines.append("      (elements: see the module)")
        lines += ["", "    Outputs:"]
        for output in function.outputs:
            text = comment_text(output.description)
            lines += ["", f"    * ``{names[output.name]}``: {shape_text(output)}; {text}".rstrip("; ")]
        lines += ["", "Notes", "-----", operations_line(function)]
        return self.docstring(lines)

    @staticmethod
    def docstring(lines: Sequence[str]) -> list[str]:
        """Return harmless text as the docstring of a function."""
        return ['    """', *comment_lines(lines, "    "), '    """']

    def _module(self) -> str:
        project = self.project
        elements = elements_lines(project, self.functions, self.element)
        text = [project.name or self.name, "", project.description, "", *self.introduction(), "", *elements]
        lines = [f"# {marker(project.version)}", '"""', *comment_lines(text, ""), '"""', ""]
        lines += ["from __future__ import annotations", "", *self.head(), "", ""]
        exported = sorted([*(f.name for f in self.functions), *(s.name for s in self.sizes.declared)])
        lines += ["__all__ = [", *(f'    "{name}",' for name in exported), "]", ""]
        for size in self.sizes.declared:
            lines += comment_lines([size.description], "# ") if size.description else []
            lines.append(f"{size.name} = {size.literal}")
        for index, named in enumerate(self.functions):
            lines += ["", "", *self.definition(index, named)]
        return "\n".join(lines) + "\n"

    def _package(self) -> str:
        requirements = ", ".join(f'"{requirement}"' for requirement in self.requirements)
        return "\n".join(
            [
                f"# {marker(self.project.version)}",
                "[build-system]",
                'requires = ["setuptools>=61"]',
                'build-backend = "setuptools.build_meta"',
                "",
                "[project]",
                f'name = "{self.name.replace("_", "-")}"',
                'version = "0.1.0"',
                f'requires-python = ">={self.python}"',
                f"dependencies = [{requirements}]",
                "",
                "[tool.setuptools]",
                f'py-modules = ["{self.name}"]',
                "",
            ]
        )


def shape_literal(output: Output) -> str:
    """Return the shape of an output as a Python tuple.

    Examples
    --------
    >>> from steelyard.graph import Graph, Output
    >>> x = Graph().inputs("x", 2)
    >>> shape_literal(Output("y", (2,), tuple(x)))
    '(2,)'
    """
    return f"({', '.join(map(str, output.shape))}{',' if len(output.shape) == 1 else ''})"


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
        results = named.output_names
        kind = f"tuple[{', '.join(['Array'] * len(results))}]" if len(results) > 1 else "Array"
        lines = [*self.signature(named, "ArrayLike", kind), *self.documentation(named, "ndarray")]
        leading = named.scope.inner().take("leading")
        lines += self.columns(named, f"{leading} = np")
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
        outputs = ", ".join(named.output_names)
        arguments = ", ".join(named.argument_names)
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


write = _NumPyProject.write
