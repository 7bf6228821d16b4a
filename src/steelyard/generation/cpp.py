"""C++17: one header, one source, a self-test, a CMake project."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from .assignments import Listing, Syntax, listing
from .c import cmake
from .c_self_test import cpp_self_test
from .c_words import C_RESERVED, PROJECT_RESERVED
from .documentation import elements_lines, function_lines, shared_arguments
from .naming import NamedFunction, naming, project_name
from .partition import Part, Partition, Store, partition
from .readme import readme
from .text import Names, comment_lines, marker, number

if TYPE_CHECKING:
    from steelyard.graph import Output

    from .project import Project

__all__ = ["write"]

_SIGN = "steelyard_sign"
# Robots stand inside a namespace of their own, so that none has the name of a function of the C library.
_OUTER = "steelyard"


def write(project: Project) -> dict[str, str]:
    """Return the files of a C++17 project by relative path.

    Parameters
    ----------
    project : Project
    """
    return _Source(project).files()


class _Source:
    def __init__(self, project: Project) -> None:
        self.project = project
        self.name = project_name(project, PROJECT_RESERVED)
        self.namespace = f"{_OUTER}::{self.name}"
        self.scope = Names(C_RESERVED | {_SIGN, _OUTER, self.name})
        self.part = self.scope.take(f"{self.name.upper()}_PART")
        names = naming(project, self.scope)
        self.functions, self.sizes = names.functions, names.sizes
        self.syntax = Syntax(calls={"sin": "std::sin({})", "cos": "std::cos({})", "sign": f"{_SIGN}({{}})"})
        self.listings: list[Listing] = [listing(f.function, self.syntax, f.names, f.scope) for f in self.functions]

    def files(self) -> dict[str, str]:
        project, name = self.project, self.name
        described = {
            f"{name}.hpp": "declarations, sizes, and what every argument is",
            f"{name}.cpp": "the functions",
            f"{name}_test.cpp": "self-test with reference values",
            "CMakeLists.txt": "builds the library and the self-test",
        }
        build = cmake(project, name, "CXX", "cxx_std_17", f"{name}.cpp", f"{name}.hpp", f"{name}_test.cpp")
        return {
            f"{name}.hpp": self._header(),
            f"{name}.cpp": self._source(),
            f"{name}_test.cpp": cpp_self_test(project, f"{name}.hpp", self.namespace, self.functions),
            "CMakeLists.txt": build,
            "README.md": readme(project, "C++17", described, self._use(), self.functions, self.syntax.element),
        }

    def _comment(self, lines: list[str]) -> list[str]:
        return comment_lines(lines, "// ")

    def _first(self) -> list[str]:
        return [f"// {marker(self.project.version)}"]

    def _parameters(self, named: NamedFunction) -> dict[str, str]:
        """Return the declaration of each argument and output, by its name in the source."""
        function, found = named.function, {}
        used = self.listings[self.functions.index(named)].used_arguments
        for argument in function.arguments:
            name, size = named.names[argument.name], self.sizes.of[function.name, argument.name]
            unused = "" if argument.name in used else "[[maybe_unused]] "
            found[name] = f"{unused}const std::array<double, {size}>& {name}"
        for output in function.outputs:
            name = named.names[output.name]
            found[name] = f"{self._output_type(named, output)}& {name}"
        return found

    def _output_type(self, named: NamedFunction, output: Output) -> str:
        return f"std::array<double, {self.sizes.of[named.function.name, output.name]}>" if output.shape else "double"

    def _header(self) -> str:
        project = self.project
        introduction = [
            project.name,
            project.description,
            "",
            "Every function reads arrays and writes arrays; it allocates nothing and keeps nothing. An output must not "
            "be one of the inputs or of the other outputs. Matrices are stored row by row.",
        ]
        lines = [*self._first(), *self._comment(introduction), "#pragma once", ""]
        lines += ["#include <array>", "#include <cstddef>", "", f"namespace {self.namespace} {{", ""]
        for size in self.sizes.declared:
            lines += self._comment([size.description]) if size.description else []
            lines.append(f"inline constexpr {_typed(size.name, size.value)};")
        lines.append("")
        shared = shared_arguments(project)
        text = elements_lines(project, self.functions, self.syntax.element)
        lines += [*self._comment(text), ""] if text else []
        for named in self.functions:
            text = function_lines(named.function, named.names, self.syntax.element, shared)
            lines += [*self._comment(text), f"{_prototype(named.name, self._parameters(named).values())};", ""]
        lines.append(f"}}  // namespace {self.namespace}")
        return "\n".join(lines) + "\n"

    def _source(self) -> str:
        operations = frozenset[str]().union(*(found.operations for found in self.listings))
        lines = [*self._first(), f'#include "{self.name}.hpp"', ""]
        lines += ["#include <cmath>", ""] if operations & {"sin", "cos"} else []
        lines += [f"namespace {self.namespace} {{", ""]
        if "sign" in operations:
            lines += [
                "namespace {",
                "",
                f"double {_SIGN}(double x) noexcept",
                "{",
                "    return x > 0.0 ? 1.0 : (x < 0.0 ? -1.0 : x + 0.0);",
                "}",
                "",
                "}  // namespace",
                "",
            ]
        cuts = [partition(found) for found in self.listings]
        if any(len(cut.parts) > 1 for cut in cuts):
            text = "// Long functions are cut into parts, because compilers take very long over one that is whole."
            macro = self.part
            lines += [text, "#if defined(__GNUC__)", f"#define {macro} [[gnu::noinline]] static", "#else"]
            lines += [f"#define {macro} static", "#endif", ""]
        for named, found, cut in zip(self.functions, self.listings, cuts, strict=True):
            lines += self._definition(named, found, cut)
        lines.append(f"}}  // namespace {self.namespace}")
        return "\n".join(lines) + "\n"

    def _definition(self, named: NamedFunction, found: Listing, cut: Partition) -> list[str]:
        parameters = self._parameters(named)
        outputs = [named.names[output.name] for output in named.function.outputs]
        pairs = zip(outputs, found.outputs, strict=True)
        body = [f"    {name}.fill(0.0);" for name, elements in pairs if elements.mostly_zero]
        if len(cut.parts) == 1:
            body += _statements(named, cut.parts[0], "")
            return [_prototype(named.name, parameters.values()), "{", *body, "}", ""]
        kept = named.scope.inner().take("kept")
        kind = f"std::array<double, {cut.places}>"
        lines = []
        body += [f"    {kind} {kept};"] if cut.places else []
        for k, part in enumerate(cut.parts):
            name = self.scope.take(f"{named.name}_part_{k + 1}")
            needed = part.names | {outputs[j] for j in part.stored}
            passed = {key: text for key, text in parameters.items() if key in needed}
            if part.reads or part.keeps:
                passed[kept] = f"{kind}& {kept}"
            lines += [f"{self.part} {_prototype(name, passed.values())}", "{", *_statements(named, part, kept), "}", ""]
            body.append(f"    {name}({', '.join(passed)});")
        return [*lines, _prototype(named.name, parameters.values()), "{", *body, "}", ""]

    def _use(self) -> list[str]:
        named = self.functions[0]
        outputs = []
        for output in named.function.outputs:
            name = named.names[output.name]
            size = f"{self.namespace}::{self.sizes.of[named.function.name, output.name]}"
            outputs.append(f"std::array<double, {size}> {name};" if output.shape else f"double {name};")
        return [
            "Add the two files to your project, or build and test with CMake:",
            "",
            "```sh",
            "cmake -S . -B build -DCMAKE_BUILD_TYPE=Release && cmake --build build && (cd build && ctest)",
            "```",
            "",
            "```cpp",
            f'#include "{self.name}.hpp"',
            "",
            *outputs,
            f"{self.namespace}::{named.name}({', '.join(named.names.values())});",
            "```",
            "",
            "The functions allocate nothing, have no state, and may run in several threads. An output must not be one",
            "of the inputs or of the other outputs.",
        ]


def _typed(name: str, value: int | float) -> str:
    if isinstance(value, float):
        return f"double {name} = {number(value)}"
    return f"{'std::size_t' if value >= 0 else 'int'} {name} = {value}"


def _prototype(name: str, parameters: Iterable[str]) -> str:
    parts = list(parameters)
    joined = f"void {name}({', '.join(parts)}) noexcept"
    return joined if len(joined) <= 100 else f"void {name}(\n    " + ",\n    ".join(parts) + ") noexcept"


def _statements(named: NamedFunction, part: Part, kept: str) -> list[str]:
    lines = [f"    const double {name} = {kept}[{place}];" for name, place in part.reads]
    for statement in part.statements:
        if isinstance(statement, Store):
            output = named.function.outputs[statement.output]
            place = f"[{statement.element}]" if output.shape else ""
            lines.append(f"    {named.names[output.name]}{place} = {statement.expression};")
        else:
            lines.append(f"    const double {statement.name} = {statement.expression};")
    return [*lines, *(f"    {kept}[{place}] = {name};" for name, place in part.keeps)]
