"""C++17: one header, one source, a self-test, a CMake project."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .assignments import Listing, Syntax
from .c_family import SIGN, CFamily, cmake, cpp_self_test
from .documentation import readme
from .naming import C_RESERVED, PROJECT_RESERVED, NamedFunction, Naming, naming, project_name, shadowing
from .text import comment_lines, marker

if TYPE_CHECKING:
    from steelyard.graph import Output

    from .project import Project

__all__ = ["write"]

# Robots stand inside a namespace of their own, so that none has the name of a function of the C library.
_OUTER = "steelyard"


class _Source(CFamily):
    ending, nothing = " noexcept", ""

    def __init__(self, project: Project) -> None:
        super().__init__(project, C_RESERVED | {_OUTER, project_name(project, PROJECT_RESERVED)})
        self.namespace = f"{_OUTER}::{self.name}"
        self.part = self.scope.take(f"{self.name.upper()}_PART")
        calls = {"sin": "std::sin({})", "cos": "std::cos({})", "sign": f"{SIGN}({{}})", "sqrt": "std::sqrt({})"}
        calls |= {"exp": "std::exp({})", "log": "std::log({})"}
        found = naming(project, self.scope)
        reserved = C_RESERVED | {SIGN, _OUTER, self.name, self.part}
        self.prepare(Naming(shadowing(found, reserved), found.sizes), Syntax(calls=calls))

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

    def comment(self, lines: Sequence[str]) -> list[str]:
        """Return lines as a comment."""
        return comment_lines(lines, "// ")

    def _first(self) -> list[str]:
        return [f"// {marker(self.project.version)}"]

    def parameters(self, named: NamedFunction) -> dict[str, str]:
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
        lines = [*self._first(), *self.comment(introduction), "#pragma once", ""]
        lines += ["#include <array>", "#include <cstddef>", "", f"namespace {self.namespace} {{", ""]
        for size in self.sizes.declared:
            lines += self.comment([size.description]) if size.description else []
            kind = "double" if isinstance(size.value, float) else "std::size_t" if size.value >= 0 else "int"
            lines.append(f"inline constexpr {kind} {size.name} = {size.literal};")
        lines.append("")
        lines += self.declarations()
        lines.append(f"}}  // namespace {self.namespace}")
        return "\n".join(lines) + "\n"

    def _source(self) -> str:
        operations = self.operations
        lines = [*self._first(), f'#include "{self.name}.hpp"', ""]
        lines += ["#include <cmath>", ""] if operations & {"sin", "cos", "sqrt", "exp", "log"} else []
        lines += [f"namespace {self.namespace} {{", ""]
        if "sign" in operations:
            lines += [
                "namespace {",
                "",
                f"double {SIGN}(double x) noexcept",
                "{",
                "    return x > 0.0 ? 1.0 : (x < 0.0 ? -1.0 : x + 0.0);",
                "}",
                "",
                "}  // namespace",
                "",
            ]
        lines += self.definitions(self.part, "[[gnu::noinline]]", "// {}")
        lines.append(f"}}  // namespace {self.namespace}")
        return "\n".join(lines) + "\n"

    def opening(self, named: NamedFunction, found: Listing) -> list[str]:
        """Return the first lines of a function."""
        pairs = zip(named.function.outputs, found.outputs, strict=True)
        return [f"    {named.names[output.name]}.fill(0.0);" for output, elements in pairs if elements.mostly_zero]

    def kept(self, name: str, places: int) -> tuple[str, str]:
        """Return the array between parts as a variable and as a parameter."""
        return f"std::array<double, {places}> {name}", f"std::array<double, {places}>& {name}"

    def element(self, output: Output, name: str, index: int) -> str:
        """Return an element of an output."""
        return f"{name}[{index}]" if output.shape else name

    def _use(self) -> list[str]:
        named = self.functions[0]
        outputs = []
        for output in named.function.outputs:
            name = named.names[output.name]
            size = f"{self.namespace}::{self.sizes.of[named.function.name, output.name]}"
            outputs.append(f"std::array<double, {size}> {name};" if output.shape else f"double {name};")
        call = f"{self.namespace}::{named.name}({', '.join(named.names.values())});"
        text = [
            "The functions allocate nothing, have no state, and may run in several threads. An output must not be one",
            "of the inputs or of the other outputs.",
        ]
        return self.use("cpp", f"{self.name}.hpp", outputs, call, text)


write = _Source.write
