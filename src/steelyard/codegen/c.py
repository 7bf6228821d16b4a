"""C99: one header, one source, a self-test, a CMake project."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .assignments import Listing, Syntax
from .c_family import SIGN, CFamily, c_self_test, cmake
from .documentation import readme
from .naming import C_RESERVED, NamedFunction, naming
from .text import comment_lines, marker

if TYPE_CHECKING:
    from steelyard.graph import Output

    from .project import Project

__all__ = ["write"]


class _Source(CFamily):
    ending, nothing = "", "void"

    def __init__(self, project: Project) -> None:
        super().__init__(project, C_RESERVED)
        macro = self.name.upper()
        self.guard = self.scope.take(f"{macro}_H")
        self.array = self.scope.take(f"{macro}_ARRAY")
        self.part = self.scope.take(f"{macro}_PART")
        calls = {"sin": "sin({})", "cos": "cos({})", "sign": f"{SIGN}({{}})", "sqrt": "sqrt({})"}
        calls |= {"exp": "exp({})", "log": "log({})"}
        self.prepare(naming(project, self.scope, prefix=f"{self.name}_", style=str.upper), Syntax(calls=calls))

    def files(self) -> dict[str, str]:
        project, name = self.project, self.name
        described = {
            f"{name}.h": "declarations, sizes, and what every argument is",
            f"{name}.c": "the functions; needs only `sin`, `cos`, `sqrt`, `exp` and `log` of the mathematical library",
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

    def comment(self, lines: Sequence[str]) -> list[str]:
        """Return lines as a comment."""
        return ["/*", *comment_lines(lines, " * "), " */"]

    def _first(self) -> list[str]:
        return [f"/* {marker(self.project.version)} */"]

    def parameters(self, named: NamedFunction) -> dict[str, str]:
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
        lines = [*self._first(), *self.comment(introduction), f"#ifndef {self.guard}", f"#define {self.guard}", ""]
        for size in self.sizes.declared:
            value = size.literal
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
        lines += self.declarations()
        lines += ["#ifdef __cplusplus", "}", "#endif", "", f"#endif /* {self.guard} */"]
        return "\n".join(lines) + "\n"

    def _source(self) -> str:
        lines = [*self._first(), f'#include "{self.name}.h"', ""]
        operations = self.operations
        if operations & {"sin", "cos", "sqrt", "exp", "log"}:
            lines += ["#include <math.h>", ""]
        if "sign" in operations:
            lines += [
                f"static double {SIGN}(double x)",
                "{",
                "    return x > 0.0 ? 1.0 : (x < 0.0 ? -1.0 : x + 0.0);",
                "}",
                "",
            ]
        lines += self.definitions(self.part, "__attribute__((noinline))", "/* {} */")
        return "\n".join(lines).rstrip("\n") + "\n"

    def opening(self, named: NamedFunction, found: Listing) -> list[str]:
        """Return the first lines of a function."""
        unused = [a.name for a in named.function.arguments if a.name not in found.used_arguments]
        lines = [f"    (void){named.names[name]};" for name in unused]
        for output, elements in zip(named.function.outputs, found.outputs, strict=True):
            if elements.mostly_zero:
                lines += self._fill(named, output.name)
        return lines

    def kept(self, name: str, places: int) -> tuple[str, str]:
        """Return the array between parts as a variable and as a parameter."""
        return f"double {name}[{places}]", f"double {name}[{self.array}({places})]"

    def element(self, output: Output, name: str, index: int) -> str:
        """Return an element of an output; a number is an array of one."""
        return f"{name}[{index}]"

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
        text = [
            "The functions allocate nothing, have no state, and may run in several threads. Outputs must not overlap",
            "inputs or each other.",
        ]
        return self.use("c", f"{self.name}.h", outputs, call, text)


write = _Source.write
