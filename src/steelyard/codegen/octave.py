"""Octave and MATLAB: one file a function, valid in both."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .assignments import Syntax, listing
from .documentation import elements_lines, function_lines, readme
from .naming import NamedFunction, naming, project_name
from .project import Project, SourceWriter
from .text import Names, comment_lines, indices_from_one, marker, number, number_lines

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["write"]

_KEYWORDS = """
break case catch classdef continue else elseif end for function global if otherwise parfor persistent return spmd switch
try while arguments do endfunction endif endfor endwhile end_try_catch end_unwind_protect endswitch endparfor until
unwind_protect unwind_protect_cleanup endclassdef enumeration events methods properties __FILE__ __LINE__ import
endarguments endenumeration endevents endmethods endproperties endspmd
"""
_FUNCTIONS = """
sin cos sign sqrt exp log zeros numel error abs all fprintf permute ndims pi i j inf nan eps ans nargin nargout varargin
varargout size isa isreal isequal double e NA true false
"""
_RESERVED = frozenset((_KEYWORDS + _FUNCTIONS).split())
_LONGEST = 63  # characters of a name in MATLAB
_COMPARE = """
function compare(what, actual, expected, tolerance)
  % Elements row by row, as the reference values are.
  actual = permute(actual, ndims(actual):-1:1);
  actual = actual(:);
  if numel(actual) ~= numel(expected)
    error('self_test:size', '%s has %d elements, expected %d.', what, numel(actual), numel(expected));
  end
  for k = 1:numel(expected)
    if ~(abs(actual(k) - expected(k)) <= tolerance)
      error('self_test:value', 'element %d of %s, row by row, is %.17g, expected %.17g within %.3g.', ...
            k, what, actual(k), expected(k), tolerance);
    end
  end
end
"""


class _Source(SourceWriter):
    def __init__(self, project: Project) -> None:
        super().__init__(project)
        longest = max(len(function.name) for function in project.functions)
        self.name = project_name(project, _RESERVED)[: max(_LONGEST - longest - 6, 8)].rstrip("_")
        # File systems that ignore case would make one file of two.
        scope = Names(_RESERVED, ignore_case=True)
        self.sizes_name = scope.take(f"{self.name}_sizes")
        self.test_name = scope.take(f"{self.name}_self_test")
        found = naming(project, scope, prefix=f"{self.name}_")
        self.sizes = found.sizes
        files = Names([*_RESERVED, self.sizes_name, self.test_name], ignore_case=True)
        self.functions = [
            NamedFunction(f.function, files.take(f.name[: _LONGEST - 3]), f.names, f.scope) for f in found.functions
        ]
        self.syntax = Syntax(element=lambda name, index: f"{name}({index + 1})")

    def files(self) -> dict[str, str]:
        described = {f"{f.name}.m": "a function, with help" for f in self.functions}
        described |= {f"{self.sizes_name}.m": "sizes and constants", f"{self.test_name}.m": "self-test"}
        result = {f"{named.name}.m": self._function(named) for named in self.functions}
        result |= {f"{self.sizes_name}.m": self._sizes(), f"{self.test_name}.m": self._test()}
        layout = "Vectors are columns, matrices are matrices, and a number is a scalar."
        text = readme(
            self.project, "Octave and MATLAB", described, self._use(), self.functions, self.syntax.element, layout
        )
        return {**result, "README.md": text}

    def _head(self, name: str, signature: str, lines: Iterable[str]) -> list[str]:
        """Return the help of a function, which both take from the first block of comments, and its first line."""
        first = f"% {name}. {marker(self.project.version)}"
        return [first, "%", *comment_lines(lines, "% "), f"function {signature}"]

    def _function(self, named: NamedFunction) -> str:
        function, names = named.function, named.names
        found = listing(function, self.syntax, names, named.scope)
        arguments = ", ".join(named.argument_names)
        results = ", ".join(named.output_names)
        text = function_lines(function, names, self.syntax.element, row_major=False)
        lines = self._head(named.name, f"[{results}] = {named.name}({arguments}) %#codegen", text)
        for argument in function.arguments:
            name, width = names[argument.name], argument.width
            message = f"{name} must be a real double array of {width} elements, not %d."
            lines += [
                f"  if ~(isa({name}, 'double') && isreal({name}) && numel({name}) == {width})",
                f"    error('{named.name}:{name}', '{message}', numel({name}));",
                "  end",
            ]
        lines += [f"  {a.name} = {a.expression};" for a in found.assignments]
        for output, listed in zip(function.outputs, found.outputs, strict=True):
            name = names[output.name]
            if not output.shape:
                lines.append(f"  {name} = {listed.elements[0]};")
                continue
            shape = f"{output.shape[0]}, 1" if len(output.shape) == 1 else ", ".join(map(str, output.shape))
            lines.append(f"  {name} = zeros({shape});")
            stored = zip(indices_from_one(output.shape), listed.elements, listed.zero, strict=True)
            lines += [f"  {name}({place}) = {text};" for place, text, zero in stored if not zero]
        return "\n".join([*lines, "end", ""])

    def _sizes(self) -> str:
        text = ["Sizes and constants of all the functions.", "", self.project.name or self.name, ""]
        text += [self.project.description, ""]
        text += elements_lines(self.project, self.functions, self.syntax.element)
        lines = self._head(self.sizes_name, f"sizes = {self.sizes_name}()", text)
        fields = Names(_RESERVED)
        for size in self.sizes.declared:
            lines += comment_lines([size.description], "  % ") if size.description else []
            lines.append(f"  sizes.{fields.take(size.name.removeprefix(f'{self.name}_'))} = {size.literal};")
        return "\n".join([*lines, "end", ""])

    def _test(self) -> str:
        what = "Compare the functions with reference values; an error tells what differs."
        lines = self._head(self.test_name, f"{self.test_name}()", [what])
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
                    label = f"{named.names[output.name]} of {named.name}"
                    tests.append(f"  compare('{label}', {result}, expected, {number(tolerance)});")
            tests.append("end")
        lines += [f"  fprintf('{self.name}: all the reference values agree.\\n');", "end"]
        return "\n".join([*lines, *tests]) + "\n" + _COMPARE

    def _use(self) -> list[str]:
        named = self.functions[0]
        arguments = ", ".join(named.argument_names)
        results = ", ".join(named.output_names)
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
            "",
            f"`help {named.name}` tells what every element of an argument is. Arguments are rows or columns of double",
            "precision, one sample a call. The functions keep nothing, and are ready for MATLAB Coder.",
        ]


write = _Source.write


def _literal(name: str, values: NDArray[np.float64]) -> list[str]:
    if len(values) == 0:
        return [f"  {name} = zeros(0, 1);"]
    rows = [f"{line} ..." for line in number_lines(values, "    ")]
    return [f"  {name} = [ ...", *rows, "  ];"]
