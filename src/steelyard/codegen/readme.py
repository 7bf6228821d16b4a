"""The README of a generated project."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from steelyard.graph import Argument

from .documentation import counted, operations_line, shape_text, shared_arguments
from .naming import NamedFunction
from .text import markdown_text, marker

if TYPE_CHECKING:
    from .project import Project

__all__ = ["readme"]


def readme(
    project: Project,
    language: str,
    files: Mapping[str, str],
    use: Sequence[str],
    functions: Sequence[NamedFunction],
    element: Callable[[str, int], str],
    layout: str = "Matrices are stored row by row: element (i, j) of `M` with n columns is `M[n * i + j]`.",
) -> str:
    """Return the README.md of a project.

    Parameters
    ----------
    project : Project
    language : str
        Its name for people.
    files : mapping
        What each file is, by path.
    use : sequence of str
        Markdown lines: how to build, test and call.
    functions : sequence of NamedFunction
    element : callable
        As in :class:`~steelyard.codegen.Syntax`.
    layout : str
        How an output of several dimensions is stored.
    """
    lines = [
        f"<!-- {marker(project.version)} -->",
        "",
        f"# {markdown_text(project.name) or 'Robot'}, in {language}",
        "",
    ]
    if markdown_text(project.description):
        lines += [markdown_text(project.description), ""]
    lines += ["| File | What it is |", "|---|---|"]
    lines += [f"| `{name}` | {what} |" for name, what in files.items()]
    lines += ["", "## Use", "", *use, ""]
    lines += [
        "## Accuracy",
        "",
        "The self-test holds reference inputs and outputs. Each output must come within 1e-12 of its largest",
        "reference value; where an output is the small difference of large numbers, within what their rounding",
        "amounts to. The operations and their order are the same in every language. Compilers that contract",
        "`a * b + c` into one fused operation, and libraries with another sine, change results by rounding alone,",
        "within the same tolerance.",
        "",
        "## Functions",
        "",
        layout,
        "",
    ]
    shared = shared_arguments(project)
    known = {argument.name for argument in shared}
    for named in functions:
        lines += _function(named, known, element)
    tables = [table for argument in shared for table in _elements(argument, _called(argument, functions), element)]
    if tables:
        lines += ["## Elements of the arguments", "", *tables]
    return "\n".join(lines).rstrip("\n") + "\n"


def _called(argument: Argument, functions: Sequence[NamedFunction]) -> str:
    return next(named.names[argument.name] for named in functions if argument in named.function.arguments)


def _function(named: NamedFunction, known: set[str], element: Callable[[str, int], str]) -> list[str]:
    function = named.function
    lines = [f"### `{named.name}`", ""]
    if markdown_text(function.description):
        lines += [markdown_text(function.description), ""]
    lines += ["| | Name | Size | What it is |", "|---|---|---|---|"]
    for argument in function.arguments:
        name, text = named.names[argument.name], markdown_text(argument.description)
        lines.append(f"| in | `{name}` | {counted(argument.width)} | {text} |")
    for output in function.outputs:
        name, text = named.names[output.name], markdown_text(output.description)
        lines.append(f"| out | `{name}` | {shape_text(output)} | {text} |")
    lines += ["", operations_line(function), ""]
    for argument in function.arguments:
        if argument.name not in known:
            lines += _elements(argument, named.names[argument.name], element)
    return lines


def _elements(argument: Argument, name: str, element: Callable[[str, int], str]) -> list[str]:
    if not argument.elements:
        return []
    rows = [f"| `{element(name, k)}` | {markdown_text(text)} |" for k, text in enumerate(argument.elements)]
    return [f"| Element of `{name}` | What it is |", "|---|---|", *rows, ""]
