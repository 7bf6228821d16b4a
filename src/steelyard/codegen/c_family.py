"""The parts of a project that are the same in C and C++: functions, whole or cut, build files, and self-tests."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from .assignments import Listing, Part, Partition, Store, Syntax, listing, partition
from .documentation import elements_lines, function_lines
from .naming import PROJECT_RESERVED, NamedFunction, Naming, project_name, shared_arguments
from .project import Project, SourceWriter
from .reference import Reference
from .text import Names, marker, number, number_lines

if TYPE_CHECKING:
    from steelyard.graph import Output

__all__ = ["SIGN", "CFamily", "c_self_test", "cmake", "cpp_self_test"]

SIGN = "steelyard_sign"


class CFamily(SourceWriter):
    """Writes the functions of a project in C or C++.

    Neither functions nor their arguments may have `reserved` names.
    """

    ending: ClassVar[str]  # behind the parameters of a function
    nothing: ClassVar[str]  # in the place of no parameters

    def __init__(self, project: Project, reserved: frozenset[str]) -> None:
        super().__init__(project)
        self.name = project_name(project, PROJECT_RESERVED)
        self.scope = Names(reserved | {SIGN})

    def prepare(self, names: Naming, syntax: Syntax) -> None:
        """List the functions with their names."""
        self.functions, self.sizes, self.syntax = names.functions, names.sizes, syntax
        self.listings: list[Listing] = [listing(f.function, syntax, f.names, f.scope) for f in self.functions]

    @abstractmethod
    def parameters(self, named: NamedFunction) -> dict[str, str]:
        """Return the declaration of each argument and output, by its name in the source."""

    @abstractmethod
    def opening(self, named: NamedFunction, found: Listing) -> list[str]:
        """Return the first lines of a function: they mark unused arguments, and fill outputs with 0."""

    @abstractmethod
    def kept(self, name: str, places: int) -> tuple[str, str]:
        """Return the declaration of the array that hands values on between parts, as a variable and as a parameter."""

    @abstractmethod
    def element(self, output: Output, name: str, index: int) -> str:
        """Return an element of an output."""

    @abstractmethod
    def comment(self, lines: Sequence[str]) -> list[str]:
        """Return lines as a comment."""

    def declarations(self) -> list[str]:
        """Return the heads of all the functions, each behind its documentation."""
        shared = shared_arguments(self.project)
        text = elements_lines(self.project, self.functions, self.syntax.element)
        lines = [*self.comment(text), ""] if text else []
        for named in self.functions:
            text = function_lines(named.function, named.names, self.syntax.element, shared)
            lines += [*self.comment(text), f"{self.prototype(named.name, self.parameters(named).values())};", ""]
        return lines

    def prototype(self, name: str, parameters: Iterable[str]) -> str:
        """Return the head of a function."""
        parts = list(parameters)
        joined = f"void {name}({', '.join(parts) or self.nothing}){self.ending}"
        return joined if len(joined) <= 100 else f"void {name}(\n    " + ",\n    ".join(parts) + f"){self.ending}"

    def definitions(self, part: str, attribute: str, comment: str) -> list[str]:
        """Return the definitions of all the functions.

        Parameters
        ----------
        part : str
            Name of the macro that keeps compilers from putting the parts of a long function together again.
        attribute : str
            What the macro stands for with GCC and Clang.
        comment : str
            Template of a comment.
        """
        cuts = [partition(found) for found in self.listings]
        lines = []
        if any(len(cut.parts) > 1 for cut in cuts):
            why = "Long functions are cut into parts, because compilers take very long over one that is whole."
            lines += [comment.format(why), "#if defined(__GNUC__)", f"#define {part} {attribute} static", "#else"]
            lines += [f"#define {part} static", "#endif", ""]
        for named, found, cut in zip(self.functions, self.listings, cuts, strict=True):
            lines += self._definition(named, found, cut, part)
        return lines

    def _definition(self, named: NamedFunction, found: Listing, cut: Partition, part_macro: str) -> list[str]:
        parameters, body = self.parameters(named), self.opening(named, found)
        head = self.prototype(named.name, parameters.values())
        if len(cut.parts) == 1:
            return [head, "{", *body, *self._statements(named, cut.parts[0], ""), "}", ""]
        kept = named.scope.inner().take("kept")
        variable, parameter = self.kept(kept, cut.places)
        outputs = named.output_names
        lines = []
        body += [f"    {variable};"] if cut.places else []
        for k, part in enumerate(cut.parts):
            name = self.scope.take(f"{named.name}_part_{k + 1}")
            needed = part.names | {outputs[j] for j in part.stored}
            passed = {key: text for key, text in parameters.items() if key in needed}
            if part.reads or part.keeps:
                passed[kept] = parameter
            lines.append(f"{part_macro} {self.prototype(name, passed.values())}")
            lines += ["{", *self._statements(named, part, kept), "}", ""]
            body.append(f"    {name}({', '.join(passed)});")
        return [*lines, head, "{", *body, "}", ""]

    def _statements(self, named: NamedFunction, part: Part, kept: str) -> list[str]:
        lines = [f"    const double {name} = {kept}[{place}];" for name, place in part.reads]
        for statement in part.statements:
            if isinstance(statement, Store):
                output = named.function.outputs[statement.output]
                place = self.element(output, named.names[output.name], statement.element)
                lines.append(f"    {place} = {statement.expression};")
            else:
                lines.append(f"    const double {statement.name} = {statement.expression};")
        return [*lines, *(f"    {kept}[{place}] = {name};" for name, place in part.keeps)]

    @property
    def operations(self) -> frozenset[str]:
        """The operations of all the functions."""
        return frozenset[str]().union(*(found.operations for found in self.listings))

    def use(self, language: str, include: str, outputs: Sequence[str], call: str, overlap: Sequence[str]) -> list[str]:
        """Return lines of the README on how to build, test and call.

        Parameters
        ----------
        language : str
            For the highlighting of the example.
        include : str
            File name of the declarations.
        outputs : sequence of str
            Declarations of the outputs of the first function.
        call : str
            The call of the first function.
        overlap : sequence of str
            Lines that end what is said of threads and overlapping arrays.
        """
        return [
            "Add the two files to your project, or build and test with CMake:",
            "",
            "```sh",
            "cmake -S . -B build -DCMAKE_BUILD_TYPE=Release && cmake --build build && (cd build && ctest)",
            "```",
            "",
            f"```{language}",
            f'#include "{include}"',
            "",
            *outputs,
            call,
            "```",
            "",
            *overlap,
        ]


def cmake(project: Project, name: str, language: str, standard: str, source: str, header: str, test: str) -> str:
    """Return the CMakeLists.txt of a C or C++ library with a self-test."""
    return "\n".join(
        [
            f"# {marker(project.version)}",
            "cmake_minimum_required(VERSION 3.15)",
            f"project({name} LANGUAGES {language})",
            "",
            f"add_library({name} {source} {header})",
            f"target_include_directories({name} PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}})",
            f"target_compile_features({name} PUBLIC {standard})",
            "if(MSVC)",
            f"  target_compile_options({name} PUBLIC /utf-8)",
            "elseif(UNIX)",
            f"  target_link_libraries({name} PUBLIC m)",
            "endif()",
            "",
            "# The self-test, where this is the project that is built.",
            "if(CMAKE_SOURCE_DIR STREQUAL CMAKE_CURRENT_SOURCE_DIR)",
            "  enable_testing()",
            f"  add_executable({name}_test {test})",
            f"  target_link_libraries({name}_test PRIVATE {name})",
            f"  add_test(NAME {name}_reference_values COMMAND {name}_test)",
            "endif()",
            "",
        ]
    )


# The self-test of generated C99 and C++17: reference values, and the program that compares with them.

_C_HEAD = """
#include <math.h>
#include <stdio.h>

/* Print the elements that differ by more than the tolerance, and return how many there are. */
static int differences(const char *what, int sample, int size, const double actual[],
                       const double expected[], double tolerance)
{
    int count = 0;
    for (int i = 0; i < size; ++i) {
        if (!(fabs(actual[i] - expected[i]) <= tolerance)) {
            ++count;
            if (count <= 5) {
                printf("%s[%d] of sample %d is %.17g, expected %.17g within %.3g\\n", what, i, sample,
                       actual[i], expected[i], tolerance);
            }
        }
    }
    return count;
}
"""

_CPP_HEAD = """
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>

namespace {

// Print the elements that differ by more than the tolerance, and return how many there are.
int differences(const char* what, std::size_t sample, std::size_t size, const double* actual,
                const double* expected, double tolerance)
{
    int count = 0;
    for (std::size_t i = 0; i < size; ++i) {
        if (!(std::fabs(actual[i] - expected[i]) <= tolerance)) {
            ++count;
            if (count <= 5) {
                std::printf("%s[%zu] of sample %zu is %.17g, expected %.17g within %.3g\\n", what, i, sample,
                            actual[i], expected[i], tolerance);
            }
        }
    }
    return count;
}
"""


def c_self_test(project: Project, header: str, functions: Sequence[NamedFunction]) -> str:
    """Return the C99 program that compares the functions with their reference values.

    The functions are declared in the file `header`.
    """
    lines = [f"/* {marker(project.version)} */", f'#include "{header}"', *_C_HEAD.splitlines(), ""]
    for k, named in enumerate(functions):
        lines += [f"/* {named.name} */", f"static int test_{k + 1}(void)", "{"]
        lines += [*_c_body(named, project.references[named.function.name]), "}", ""]
    calls = [f"    count += test_{k + 1}();" for k in range(len(functions))]
    lines += ["int main(void)", "{", "    int count = 0;", *calls, *_verdict("printf", len(functions))]
    return "\n".join(lines) + "\n"


def cpp_self_test(project: Project, header: str, namespace: str, functions: Sequence[NamedFunction]) -> str:
    """Return the C++17 program that compares the functions with their reference values.

    Parameters
    ----------
    header : str
        File name of the functions' declarations.
    namespace : str
        Of the functions.
    """
    lines = [f"// {marker(project.version)}", f'#include "{header}"', *_CPP_HEAD.splitlines(), ""]
    for k, named in enumerate(functions):
        lines += [f"// {named.name}", f"int test_{k + 1}()", "{"]
        lines += [*_cpp_body(named, namespace, project.references[named.function.name]), "}", ""]
    calls = [f"    count += test_{k + 1}();" for k in range(len(functions))]
    lines += ["}  // namespace", "", "int main()", "{", "    int count = 0;", *calls]
    return "\n".join([*lines, *_verdict("std::printf", len(functions))]) + "\n"


def _verdict(printf: str, count: int) -> list[str]:
    functions = f"{count} functions agree" if count > 1 else "1 function agrees"
    return [
        "    if (count > 0) {",
        f'        {printf}("%d values differ\\n", count);',
        "        return 1;",
        "    }",
        f'    {printf}("{functions} with the reference values\\n");',
        "    return 0;",
        "}",
    ]


def _c_body(named: NamedFunction, reference: Reference) -> list[str]:
    tables = [(f"input_{k + 1}", values) for k, values in enumerate(reference.inputs)]
    tables += [(f"expected_{k + 1}", values) for k, values in enumerate(reference.outputs)]
    lines = []
    for name, values in tables:
        # An array has at least one element, also where the argument has none.
        rows = values if values.shape[1] else np.zeros((len(values), 1))
        lines.append(f"    static const double {name}[{len(rows)}][{rows.shape[1]}] = {{")
        for row in rows:
            lines += ["        {", *number_lines(row, "            "), "        },"]
        lines.append("    };")
    outputs = named.function.outputs
    lines += [f"    static double actual_{k + 1}[{o.size}];" for k, o in enumerate(outputs)]
    lines += ["    int count = 0;", f"    for (int sample = 0; sample < {reference.samples}; ++sample) {{"]
    for k, output in enumerate(outputs):
        lines.append(f"        for (int i = 0; i < {output.size}; ++i) {{")
        lines += [f"            actual_{k + 1}[i] = HUGE_VAL;", "        }"]
    passed = [f"input_{k + 1}[sample]" for k in range(len(reference.inputs))]
    passed += [f"actual_{k + 1}" for k in range(len(outputs))]
    lines.append(f"        {named.name}({', '.join(passed)});")
    for k, (output, tolerance) in enumerate(zip(outputs, reference.tolerances, strict=True)):
        lines.append(
            f'        count += differences("{named.names[output.name]} of {named.name}", sample, {output.size},'
        )
        lines.append(f"                             actual_{k + 1}, expected_{k + 1}[sample], {number(tolerance)});")
    return [*lines, "    }", "    return count;"]


def _cpp_body(named: NamedFunction, namespace: str, reference: Reference) -> list[str]:
    lines = []
    for k, values in enumerate(reference.inputs):
        lines += _cpp_table(f"input_{k + 1}", values)
    for k, values in enumerate(reference.outputs):
        lines += _cpp_table(f"expected_{k + 1}", values)
    outputs = named.function.outputs
    lines += ["    int count = 0;", f"    for (std::size_t sample = 0; sample < {reference.samples}; ++sample) {{"]
    passed = [f"input_{k + 1}[sample]" for k in range(len(reference.inputs))]
    for k, output in enumerate(outputs):
        passed.append(f"actual_{k + 1}")
        if output.shape == ():
            lines.append(f"        double actual_{k + 1} = HUGE_VAL;")
        else:
            lines.append(f"        static std::array<double, {output.size}> actual_{k + 1};")
            lines.append(f"        actual_{k + 1}.fill(HUGE_VAL);")
    lines.append(f"        {namespace}::{named.name}({', '.join(passed)});")
    for k, (output, tolerance) in enumerate(zip(outputs, reference.tolerances, strict=True)):
        pointer = f"&actual_{k + 1}" if output.shape == () else f"actual_{k + 1}.data()"
        lines.append(
            f'        count += differences("{named.names[output.name]} of {named.name}", sample, {output.size},'
        )
        lines.append(f"            {pointer}, expected_{k + 1}[sample].data(), {number(tolerance)});")
    return [*lines, "    }", "    return count;"]


def _cpp_table(name: str, values: NDArray[np.float64]) -> list[str]:
    count, width = values.shape
    kind = f"std::array<std::array<double, {width}>, {count}>"
    if width == 0:
        return [f"    static const {kind} {name}{{}};"]
    lines = [f"    static const {kind} {name} = {{{{"]
    for row in values:
        lines += ["        {{", *number_lines(row, "            "), "        }},"]
    return [*lines, "    }};"]
