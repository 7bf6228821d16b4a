"""The self-test of generated Python modules: reference values, and what compares with them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .naming import NamedFunction
from .text import marker, number, number_lines

if TYPE_CHECKING:
    from .project import Project

__all__ = ["python_self_test"]

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

    Parameters
    ----------
    project : Project
    module : str
    functions : sequence of NamedFunction
    comparison : list of str
        Imports ``module`` and defines ``evaluated``.
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
