"""What Python projects have in common: a module, its self-test, a package description, a README."""

from __future__ import annotations

import builtins
import keyword
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

from .assignments import Listing, Syntax, listing
from .documentation import elements_lines, function_lines, shared_arguments
from .naming import NamedFunction, naming, project_name
from .readme import readme
from .text import Names, comment_lines, marker, number, number_lines

if TYPE_CHECKING:
    from steelyard.graph import Output

    from .project import Project

__all__ = ["PythonProject"]

_PROJECT_RESERVED = frozenset(
    [
        *keyword.kwlist,
        *keyword.softkwlist,
        "numpy",
        "jax",
        "casadi",
        "math",
        "unittest",
        "test",
        "setup",
        "build",
        "dist",
    ]
)
_RESERVED = frozenset([*keyword.kwlist, *dir(builtins)])


class PythonProject(ABC):
    """Writes a project of one flavour of Python: with NumPy, JAX or CasADi.

    Parameters
    ----------
    project : Project
    """

    title: ClassVar[str]
    requirement: ClassVar[str]
    reserved: ClassVar[frozenset[str]]
    calls: ClassVar[dict[str, str]]

    def __init__(self, project: Project) -> None:
        self.project = project
        self.name = project_name(project, _PROJECT_RESERVED)
        self.scope = Names(_RESERVED | self.reserved)
        names = naming(project, self.scope, style=str.upper)
        self.functions, self.sizes = names.functions, names.sizes
        self.syntax = Syntax(calls=self.calls)
        self.listings = [listing(f.function, self.syntax, f.names, f.scope) for f in self.functions]

    @abstractmethod
    def head(self) -> list[str]:
        """Return imports and private functions."""

    @abstractmethod
    def definition(self, named: NamedFunction, found: Listing, documentation: list[str]) -> list[str]:
        """Return the definition of one function."""

    @abstractmethod
    def comparison(self) -> list[str]:
        """Return the lines of the self-test that call ``function`` with ``arrays`` and return a list of flat arrays."""

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
            f"Copy `{self.name}.py`, or install the folder. The self-test:",
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
            f"test_{self.name}.py": self._test(),
            "pyproject.toml": self._package(),
            "README.md": readme(self.project, self.title, described, use, self.functions, self.syntax.element, layout),
        }

    def _module(self) -> str:
        project = self.project
        elements = elements_lines(project, self.functions, self.syntax.element)
        introduction = [project.name or self.name, "", project.description, "", *elements]
        lines = [f"# {marker(project.version)}", '"""', *comment_lines(introduction, ""), '"""', ""]
        lines += ["from __future__ import annotations", "", *self.head(), ""]
        exported = sorted([*(f.name for f in self.functions), *(s.name for s in self.sizes.declared)])
        lines += ["__all__ = [", *(f'    "{name}",' for name in exported), "]", ""]
        for size in self.sizes.declared:
            lines += comment_lines([size.description], "# ") if size.description else []
            value = number(size.value) if isinstance(size.value, float) else str(size.value)
            lines.append(f"{size.name} = {value}")
        shared = shared_arguments(project)
        for named, found in zip(self.functions, self.listings, strict=True):
            text = function_lines(named.function, named.names, self.syntax.element, shared, row_major=False)
            documentation = ['    """', *comment_lines(text, "    "), '    """']
            lines += ["", "", *self.definition(named, found, documentation)]
        return "\n".join(lines) + "\n"

    def _package(self) -> str:
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
                'requires-python = ">=3.9"',
                f'dependencies = ["{self.requirement}"]',
                "",
                "[tool.setuptools]",
                f'py-modules = ["{self.name}"]',
                "",
            ]
        )

    def _test(self) -> str:
        lines = [
            f"# {marker(self.project.version)}",
            '"""Compare the functions with reference values: python -m unittest."""',
            "",
            "import unittest",
            "",
            *self.comparison(),
            "",
            "",
            "class ReferenceValues(unittest.TestCase):",
            "    def check(self, function, samples, expected, tolerances):",
            "        for arrays, values in zip(samples, expected):",
            "            results = evaluated(function, arrays)",
            "            self.assertEqual(len(results), len(values))",
            "            for result, value, tolerance in zip(results, values, tolerances):",
            "                self.assertEqual(len(result), len(value))",
            "                for k, (x, y) in enumerate(zip(result, value)):",
            '                    self.assertTrue(abs(x - y) <= tolerance, f"element {k} is {x}, expected {y}")',
        ]
        for k, named in enumerate(self.functions):
            reference = self.project.references[named.function.name]
            lines += ["", f"    def test_{k + 1}_{named.name}(self):", "        samples = ["]
            for sample in range(reference.samples):
                lines += ["            [", *self._rows([a[sample] for a in reference.inputs]), "            ],"]
            lines += ["        ]", "        expected = ["]
            for sample in range(reference.samples):
                lines += ["            [", *self._rows([a[sample] for a in reference.outputs]), "            ],"]
            tolerances = ", ".join(map(number, reference.tolerances))
            lines += ["        ]", f"        self.check(module.{named.name}, samples, expected, [{tolerances}])"]
        return "\n".join([*lines, "", "", 'if __name__ == "__main__":', "    unittest.main()"]) + "\n"

    @staticmethod
    def _rows(arrays: list[object]) -> list[str]:
        lines: list[str] = []
        for array in arrays:
            lines += ["                [", *number_lines(array, " " * 20), "                ],"]  # type: ignore[arg-type]
        return lines


def shape_literal(output: Output) -> str:
    """Return the shape of an output as a Python tuple."""
    return f"({', '.join(map(str, output.shape))}{',' if len(output.shape) == 1 else ''})"
