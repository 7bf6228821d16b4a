"""Octave and MATLAB: one file a function, valid in both."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .assignments import Listing, Syntax, listing
from .documentation import elements_lines, function_lines, shared_arguments
from .naming import NamedFunction, naming, project_name
from .readme import readme
from .text import Names, comment_lines, marker, number, number_lines

if TYPE_CHECKING:
    from collections.abc import Iterable

    from steelyard.graph import Output

    from .project import Project

__all__ = ["write"]

_KEYWORDS = """
break case catch classdef continue else elseif end for function global if otherwise parfor persistent return spmd switch
try while arguments do endfunction endif endfor endwhile end_try_catch end_unwind_protect endswitch endparfor until
unwind_protect unwind_protect_cleanup endclassdef enumeration events methods properties __FILE__ __LINE__ import
"""
_FUNCTIONS = """
sin cos sign zeros numel error abs max fprintf permute ndims pi i j inf nan eps ans nargin nargout varargin varargout
size isequal e NA true false
"""
_RESERVED = frozenset((_KEYWORDS + _FUNCTIONS).split())
_LONGEST = 63  # characters of a name in MATLAB


def write(project: Project) -> dict[str, str]:
    """Return the files of a folder of functions by relative path.

    Parameters
    ----------
    project : Project
    """
    return _Source(project).files()


def _index(shape: tuple[int, ...]) -> list[str]:
    """Return the index of each element, in row-major order."""
    if len(shape) == 1:
        return [f"({k + 1})" for k in range(shape[0])]
    return [f"({', '.join(str(k + 1) for k in place)})" for place in product(*(range(n) for n in shape))]


class _Source:
    def __init__(self, project: Project) -> None:
        self.project = project
        longest = max((len(function.name) for function in project.functions), default=0)
        self.name = project_name(project, _RESERVED)[: max(_LONGEST - longest - 6, 8)].rstrip("_")
        # File systems that ignore case would make one file of two.
        self.scope = Names(_RESERVED, ignore_case=True)
        self.sizes_name = self.scope.take(f"{self.name}_sizes")
        self.test_name = self.scope.take(f"{self.name}_self_test")
        names = naming(project, self.scope, prefix=f"{self.name}_")
        self.functions, self.sizes = names.functions, names.sizes
        self.syntax = Syntax(element=lambda name, index: f"{name}({index + 1})")
        self.listings = [listing(f.function, self.syntax, f.names, f.scope) for f in self.functions]

    def files(self) -> dict[str, str]:
        described = {f"{f.name}.m": "a function" for f in self.functions}
        described |= {f"{self.sizes_name}.m": "sizes and constants", f"{self.test_name}.m": "self-test"}
        result = {
            f"{named.name}.m": self._function(named, found)
            for named, found in zip(self.functions, self.listings, strict=True)
        }
        result |= {f"{self.sizes_name}.m": self._sizes(), f"{self.test_name}.m": self._test()}
        layout = "Vectors are columns, matrices are matrices, and a number is a scalar."
        text = readme(
            self.project, "Octave and MATLAB", described, self._use(), self.functions, self.syntax.element, layout
        )
        return {**result, "README.md": text}

    def _head(self, first: str, lines: Iterable[str]) -> list[str]:
        return [f"% {marker(self.project.version)}", first, *comment_lines(lines, "% ")]

    def _function(self, named: NamedFunction, found: Listing) -> str:
        function, names = named.function, named.names
        arguments = ", ".join(names[argument.name] for argument in function.arguments)
        results = ", ".join(names[output.name] for output in function.outputs)
        shared = shared_arguments(self.project)
        text = function_lines(function, names, self.syntax.element, shared, row_major=False)
        elements = elements_lines(self.project, [named], self.syntax.element) if self._complete(named) else []
        lines = self._head(f"function [{results}] = {named.name}({arguments})", [*text, "", *elements])
        for argument in function.arguments:
            name = names[argument.name]
            message = f"'{name} must have {argument.width} elements, not %d.'"
            lines += [
                f"  if numel({name}) ~= {argument.width}",
                f"    error('{named.name}:size', {message}, numel({name}));",
                "  end",
            ]
        lines += [f"  {a.name} = {a.expression};" for a in found.assignments]
        for output, listed in zip(function.outputs, found.outputs, strict=True):
            name = names[output.name]
            if not output.shape:
                lines.append(f"  {name} = {listed.elements[0]};")
                continue
            lines.append(f"  {name} = zeros({_shape(output)});")
            places = _index(output.shape)
            stored = zip(places, listed.elements, listed.zero, strict=True)
            lines += [f"  {name}{place} = {text};" for place, text, zero in stored if not zero]
        return "\n".join([*lines, "end", ""])

    def _complete(self, named: NamedFunction) -> bool:
        """Tell whether a function has all the arguments that are documented once for all."""
        have = {argument.name for argument in named.function.arguments}
        return all(argument.name in have for argument in shared_arguments(self.project) if argument.elements)

    def _sizes(self) -> str:
        text = [self.project.name or self.name, "", self.project.description, ""]
        text += elements_lines(self.project, self.functions, self.syntax.element)
        lines = self._head(f"function sizes = {self.sizes_name}()", text)
        for size in self.sizes.declared:
            value = number(size.value) if isinstance(size.value, float) else str(size.value)
            lines.append(f"  sizes.{size.name} = {value};")
        return "\n".join([*lines, "end", ""])

    def _test(self) -> str:
        lines = self._head(
            f"function {self.test_name}()",
            ["Compare the functions with reference values; an error tells what differs."],
        )
        tests: list[str] = []
        for k, named in enumerate(self.functions):
            lines.append(f"  test_{k + 1}();")
            reference = self.project.references[named.function.name]
            results = [f"result_{j + 1}" for j in range(len(named.function.outputs))]
            inputs = [f"input_{j + 1}" for j in range(len(reference.inputs))]
            tests += ["", f"function test_{k + 1}()"]
            for sample in range(reference.samples):
                for name, array in zip(inputs, reference.inputs, strict=True):
                    tests += _literal(name, array[sample])
                tests.append(f"  [{', '.join(results)}] = {named.name}({', '.join(inputs)});")
                outputs = zip(named.function.outputs, results, reference.outputs, reference.tolerances, strict=True)
                for output, result, array, tolerance in outputs:
                    tests += _literal("expected", array[sample])
                    what = f"{named.names[output.name]} of {named.name}"
                    tests.append(f"  compare('{what}', {result}, expected, {number(tolerance)});")
            tests.append("end")
        lines += [f"  fprintf('{self.name}: all the reference values agree.\\n');", "end"]
        return "\n".join([*lines, *tests, *_COMPARE]) + "\n"

    def _use(self) -> list[str]:
        named = self.functions[0]
        arguments = ", ".join(named.names[argument.name] for argument in named.function.arguments)
        results = ", ".join(named.names[output.name] for output in named.function.outputs)
        return [
            "Add the folder to the path. The self-test:",
            "",
            "```matlab",
            f"{self.test_name}",
            "```",
            "",
            "```matlab",
            f"[{results}] = {named.name}({arguments});",
            "```",
        ]


_COMPARE = (
    "",
    "function compare(what, actual, expected, tolerance)",
    "  % Elements row by row, as the reference values are.",
    "  actual = permute(actual, ndims(actual):-1:1);",
    "  actual = actual(:);",
    "  if numel(actual) ~= numel(expected)",
    "    error('self_test:size', '%s has %d elements, expected %d.', what, numel(actual), numel(expected));",
    "  end",
    "  difference = max(abs(actual - expected(:)));",
    "  if ~(difference <= tolerance)",
    "    error('self_test:value', '%s differs by %.3g, more than %.3g.', what, difference, tolerance);",
    "  end",
    "end",
)


def _literal(name: str, values: NDArray[np.float64]) -> list[str]:
    if len(values) == 0:
        return [f"  {name} = zeros(0, 1);"]
    rows = [f"{line} ..." for line in number_lines(values, "    ")]
    return [f"  {name} = [ ...", *rows, "  ];"]


def _shape(output: Output) -> str:
    return f"{output.shape[0]}, 1" if len(output.shape) == 1 else ", ".join(map(str, output.shape))
