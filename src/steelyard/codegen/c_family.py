"""What C and C++ write alike: functions whole or in parts, and how they are built and tested."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, ClassVar

from .assignments import Listing, Syntax, listing
from .c_words import PROJECT_RESERVED
from .naming import NamedFunction, Naming, project_name
from .partition import Part, Partition, Store, partition
from .text import Names, marker

if TYPE_CHECKING:
    from steelyard.graph import Output

    from .project import Project

__all__ = ["SIGN", "CFamily", "cmake"]

SIGN = "steelyard_sign"


class CFamily(ABC):
    """Writes the functions of a project in C or C++.

    Parameters
    ----------
    project : Project
    reserved : frozenset of str
        Names that neither functions nor their arguments may have.
    """

    ending: ClassVar[str]  # behind the parameters of a function
    nothing: ClassVar[str]  # in the place of no parameters

    def __init__(self, project: Project, reserved: frozenset[str]) -> None:
        self.project = project
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
        """Return the first lines of a function: what must be said of unused arguments, and fills with 0."""

    @abstractmethod
    def kept(self, name: str, places: int) -> tuple[str, str]:
        """Return the declaration of the array that hands values on between parts, as a variable and as a parameter."""

    @abstractmethod
    def element(self, output: Output, name: str, index: int) -> str:
        """Return an element of an output."""

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
        outputs = [named.names[output.name] for output in named.function.outputs]
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
