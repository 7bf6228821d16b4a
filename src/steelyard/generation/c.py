"""C99: one header, one source, a self-test, a CMake project."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from .assignments import Listing, Syntax, listing
from .c_self_test import c_self_test
from .c_words import C_RESERVED, PROJECT_RESERVED
from .documentation import elements_lines, function_lines, shared_arguments
from .naming import NamedFunction, naming, project_name
from .partition import Part, Partition, Store, partition
from .readme import readme
from .text import Names, comment_lines, marker, number

if TYPE_CHECKING:
    from .project import Project

__all__ = ["cmake", "write"]

_SIGN = "steelyard_sign"


def write(project: Project) -> dict[str, str]:
    """Return the files of a C99 project by relative path.

    Parameters
    ----------
    project : Project
    """
    return _Source(project).files()


class _Source:
    def __init__(self, project: Project) -> None:
        self.project = project
        self.name = project_name(project, PROJECT_RESERVED)
        self.scope = Names(C_RESERVED | {_SIGN})
        macro = self.name.upper()
        self.guard = self.scope.take(f"{macro}_H")
        self.array = self.scope.take(f"{macro}_ARRAY")
        self.part = self.scope.take(f"{macro}_PART")
        names = naming(project, self.scope, prefix=f"{self.name}_", style=str.upper)
        self.functions, self.sizes = names.functions, names.sizes
        self.syntax = Syntax(calls={"sin": "sin({})", "cos": "cos({})", "sign": f"{_SIGN}({{}})"})
        self.listings: list[Listing] = [listing(f.function, self.syntax, f.names, f.scope) for f in self.functions]

    def files(self) -> dict[str, str]:
        project, name = self.project, self.name
        described = {
            f"{name}.h": "declarations, sizes, and what every argument is",
            f"{name}.c": "the functions; needs only `sin` and `cos` of the mathematical library",
            f"{name}_test.c": "self-test with reference values",
            "CMakeLists.txt": "builds the library and the self-test",
        }
        return {
            f"{name}.h": self._header(),
            f"{name}.c": self._source(),
            f"{name}_test.c": c_self_test(project, f"{name}.h", self.functions),
            "CMakeLists.txt": cmake(project, name, "C", "c_std_99", f"{name}.c", f"{name}.h", f"{name}_test.c"),
            "README.md": readme(self.project, "C99", described, self._use(), self.functions, self.syntax.element),
        }

    def _comment(self, lines: list[str]) -> list[str]:
        return ["/*", *comment_lines(lines, " * "), " */"]

    def _first(self) -> list[str]:
        return [f"/* {marker(self.project.version)} */"]

    def _parameters(self, named: NamedFunction) -> dict[str, str]:
        """Return the declaration of each argument and output, by its name in the source."""
        found = {}
        for argument in named.function.arguments:
            found[named.names[argument.name]] = self._array(named, argument.name, argument.width, "const double")
        for output in named.function.outputs:
            found[named.names[output.name]] = self._array(named, output.name, output.size, "double")
        return found

    def _array(self, named: NamedFunction, item: str, size: int, kind: str) -> str:
        name = named.names[item]
        if size == 0:  # an array parameter of C has at least one element
            return f"{kind} {name}[]"
        return f"{kind} {name}[{self.array}({self.sizes.of[named.function.name, item]})]"

    def _header(self) -> str:
        project = self.project
        introduction = [
            project.name,
            project.description,
            "",
            "Every function reads arrays and writes arrays; it allocates nothing and keeps nothing. Outputs must not "
            "overlap inputs or each other. A number is an array of one element; matrices are stored row by row.",
        ]
        lines = [*self._first(), *self._comment(introduction), f"#ifndef {self.guard}", f"#define {self.guard}", ""]
        for size in self.sizes.declared:
            value = number(size.value) if isinstance(size.value, float) else str(size.value)
            text = comment_lines([size.description], "") if size.description else []
            lines += [f"/* {line} */" for line in text if line]
            lines.append(f"#define {size.name} {value}" if size.value >= 0 else f"#define {size.name} ({value})")
        lines += [
            "",
            "/* Array parameters: C99 compilers learn the size, and that arrays do not overlap. */",
            "#if defined(__cplusplus) || defined(_MSC_VER)",
            f"#define {self.array}(size)",
            "#else",
            f"#define {self.array}(size) restrict static size",
            "#endif",
            "",
            "#ifdef __cplusplus",
            'extern "C" {',
            "#endif",
            "",
        ]
        shared = shared_arguments(project)
        text = elements_lines(project, self.functions, self.syntax.element)
        lines += [*self._comment(text), ""] if text else []
        for named in self.functions:
            text = function_lines(named.function, named.names, self.syntax.element, shared)
            lines += [*self._comment(text), f"{_prototype(named.name, self._parameters(named).values())};", ""]
        lines += ["#ifdef __cplusplus", "}", "#endif", "", f"#endif /* {self.guard} */"]
        return "\n".join(lines) + "\n"

    def _source(self) -> str:
        lines = [*self._first(), f'#include "{self.name}.h"', ""]
        operations = frozenset().union(*(found.operations for found in self.listings))
        if operations & {"sin", "cos"}:
            lines += ["#include <math.h>", ""]
        if "sign" in operations:
            lines += [
                f"static double {_SIGN}(double x)",
                "{",
                "    return x > 0.0 ? 1.0 : (x < 0.0 ? -1.0 : x + 0.0);",
                "}",
                "",
            ]
        cuts = [partition(found) for found in self.listings]
        if any(len(cut.parts) > 1 for cut in cuts):
            lines += [
                "/* Long functions are cut into parts, because compilers take very long over one that is whole. */",
                "#if defined(__GNUC__)",
                f"#define {self.part} __attribute__((noinline)) static",
                "#else",
                f"#define {self.part} static",
                "#endif",
                "",
            ]
        for named, found, cut in zip(self.functions, self.listings, cuts, strict=True):
            lines += self._definition(named, found, cut)
        return "\n".join(lines).rstrip("\n") + "\n"

    def _definition(self, named: NamedFunction, found: Listing, cut: Partition) -> list[str]:
        parameters = self._parameters(named)
        unused = [a.name for a in named.function.arguments if a.name not in found.used_arguments]
        body = [f"    (void){named.names[name]};" for name in unused]
        for output, elements in zip(named.function.outputs, found.outputs, strict=True):
            if elements.mostly_zero:
                body += self._fill(named, output.name)
        if len(cut.parts) == 1:
            body += _statements(named, cut.parts[0], "")
            return [_prototype(named.name, parameters.values()), "{", *body, "}", ""]
        kept = named.scope.inner().take("kept")
        lines = []
        body += [f"    double {kept}[{cut.places}];"] if cut.places else []
        outputs = [named.names[output.name] for output in named.function.outputs]
        for k, part in enumerate(cut.parts):
            name = self.scope.take(f"{named.name}_part_{k + 1}")
            needed = part.names | {outputs[j] for j in part.stored}
            passed = {key: text for key, text in parameters.items() if key in needed}
            if part.reads or part.keeps:
                passed[kept] = f"double {kept}[{self.array}({cut.places})]"
            head = _prototype(name, passed.values()).replace("void", f"{self.part} void", 1)
            lines += [head, "{", *_statements(named, part, kept), "}", ""]
            body.append(f"    {name}({', '.join(passed)});")
        return [*lines, _prototype(named.name, parameters.values()), "{", *body, "}", ""]

    def _fill(self, named: NamedFunction, output: str) -> list[str]:
        index = named.scope.inner().take("i")
        size = self.sizes.of[named.function.name, output]
        return [
            f"    for (int {index} = 0; {index} < {size}; ++{index}) {{",
            f"        {named.names[output]}[{index}] = 0.0;",
            "    }",
        ]

    def _use(self) -> list[str]:
        named = self.functions[0]
        outputs = [
            f"double {named.names[o.name]}[{self.sizes.of[named.function.name, o.name]}];"
            for o in named.function.outputs
        ]
        call = f"{named.name}({', '.join(named.names.values())});"
        return [
            "Add the two files to your project, or build and test with CMake:",
            "",
            "```sh",
            "cmake -S . -B build -DCMAKE_BUILD_TYPE=Release && cmake --build build && (cd build && ctest)",
            "```",
            "",
            "```c",
            f'#include "{self.name}.h"',
            "",
            *outputs,
            call,
            "```",
            "",
            "The functions allocate nothing, have no state, and may run in several threads. Outputs must not overlap",
            "inputs or each other.",
        ]


def _prototype(name: str, parameters: Iterable[str]) -> str:
    parts = list(parameters)
    joined = f"void {name}({', '.join(parts) or 'void'})"
    return joined if len(joined) <= 100 else f"void {name}(\n    " + ",\n    ".join(parts) + ")"


def _statements(named: NamedFunction, part: Part, kept: str) -> list[str]:
    lines = [f"    const double {name} = {kept}[{place}];" for name, place in part.reads]
    for statement in part.statements:
        if isinstance(statement, Store):
            output = named.function.outputs[statement.output]
            lines.append(f"    {named.names[output.name]}[{statement.element}] = {statement.expression};")
        else:
            lines.append(f"    const double {statement.name} = {statement.expression};")
    return [*lines, *(f"    {kept}[{place}] = {name};" for name, place in part.keeps)]


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
