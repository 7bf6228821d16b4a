"""The self-test of generated C99 and C++17: reference values, and the program that compares with them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .naming import NamedFunction
from .reference import Reference
from .text import marker, number, number_lines

if TYPE_CHECKING:
    from .project import Project

__all__ = ["c_self_test", "cpp_self_test"]

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

    Parameters
    ----------
    project : Project
    header : str
        File name of the functions' declarations.
    functions : sequence of NamedFunction
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
    project : Project
    header : str
        File name of the functions' declarations.
    namespace : str
        Of the functions.
    functions : sequence of NamedFunction
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
