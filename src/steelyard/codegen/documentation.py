"""Documentation of a project's functions, arguments and outputs: lines for comments, and the README."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from steelyard.graph import Argument, Function, Output

from .naming import NamedFunction, shared_arguments
from .text import comment_text, markdown_text, marker

if TYPE_CHECKING:
    from .project import Project

__all__ = [
    "MARKDOWN",
    "PLAIN",
    "Prose",
    "argument_lines",
    "counted",
    "elements_lines",
    "function_lines",
    "operations_line",
    "output_lines",
    "readme",
    "shape_text",
]

Element = Callable[[str, int], str]


@dataclass(frozen=True)
class Prose:
    """The form in which a language writes documentation.

    Attributes
    ----------
    text : callable
        Changes any text so that it cannot end a comment or become markup.
    code : str
        Stands before and behind a name.
    bullet : str
        Stands before an entry of a list.
    """

    text: Callable[[str], str]
    code: str
    bullet: str

    def quoted(self, name: str) -> str:
        """Return a name of the language."""
        return f"{self.code}{name}{self.code}"


PLAIN = Prose(comment_text, "", "")
MARKDOWN = Prose(markdown_text, "`", "* ")


def counted(count: int) -> str:
    """Return how many numbers there are.

    Examples
    --------
    >>> counted(1), counted(7)
    ('1 number', '7 numbers')
    """
    return "1 number" if count == 1 else f"{count} numbers"


def shape_text(output: Output) -> str:
    """Return the shape of an output in words: ``1 number``, ``7 numbers``, ``7 x 7 numbers``."""
    return " x ".join(map(str, output.shape)) + " numbers" if len(output.shape) > 1 else counted(output.size)


def operations_line(function: Function) -> str:
    """Return one line with the number of operations.

    Examples
    --------
    >>> from steelyard.graph import Graph
    >>> x = Graph().inputs("x", 2)
    >>> operations_line(Function("f", (Argument("x", 2),), (Output("y", (), (x[0] * x[1],)),)))
    'Operations: 1 multiplication.'
    """
    words = {
        "mul": ("multiplication", "multiplications"),
        "add": ("addition or subtraction", "additions and subtractions"),
        "div": ("division", "divisions"),
        "neg": ("negation", "negations"),
        "sin": ("sine", "sines"),
        "cos": ("cosine", "cosines"),
        "sign": ("sign", "signs"),
        "sqrt": ("square root", "square roots"),
        "exp": ("exponential", "exponentials"),
        "log": ("logarithm", "logarithms"),
    }
    count = function.operation_count
    parts = [f"{count[kind]} {word[count[kind] > 1]}" for kind, word in words.items() if count[kind]]
    return f"Operations: {', '.join(parts) or 'none'}."


def argument_lines(
    argument: Argument, name: str, element: Element, *, elements: bool = True, prose: Prose = PLAIN
) -> list[str]:
    """Return lines that say what an argument is, element by element.

    Parameters
    ----------
    name : str
        What the language calls it.
    element : callable
        As in :class:`~steelyard.codegen.Syntax`.
    elements : bool
        Whether to list the elements.

    Examples
    --------
    >>> argument = Argument("q", 2, description="joint positions", elements=("shoulder, rad", "elbow, rad"))
    >>> argument_lines(argument, "q", lambda name, k: f"{name}[{k}]")
    ['q: 2 numbers; joint positions', '  q[0]: shoulder, rad', '  q[1]: elbow, rad']
    """
    lines = [_entry(name, counted(argument.width), argument.description, prose)]
    if elements:
        for k, text in enumerate(argument.elements):
            lines.append(f"  {prose.bullet}{prose.quoted(element(name, k))}: {prose.text(text)}")
    return lines


def output_lines(
    output: Output, name: str, element: Element, *, row_major: bool = True, prose: Prose = PLAIN
) -> list[str]:
    """Return lines that say what an output is and, where `row_major`, how its elements lie in memory.

    Parameters
    ----------
    name : str
        What the language calls it.
    element : callable
        As in :class:`~steelyard.codegen.Syntax`.
    row_major : bool
        False for languages with arrays of several dimensions.
    """
    lines = [_entry(name, shape_text(output), output.description, prose)]
    if row_major and len(output.shape) == 2:
        text = f"row by row: row 0 begins at {prose.quoted(element(name, 0))}"
        if output.shape[0] > 1:
            text += f", row 1 at {prose.quoted(element(name, output.shape[1]))}"
        lines.append(f"  {prose.bullet}{text}")
    elif row_major and len(output.shape) > 2:
        strides = [math.prod(output.shape[k + 1 :]) for k in range(len(output.shape))]
        lines.append(f"  {prose.bullet}strides of the indices: {', '.join(map(str, strides))}")
    return lines


def _entry(name: str, size: str, description: str, prose: Prose) -> str:
    text = prose.text(description)
    return f"{prose.bullet}{prose.quoted(name)}: {size}{'; ' if text else ''}{text}"


def function_lines(
    function: Function,
    names: Mapping[str, str],
    element: Element,
    shared: Sequence[Argument] = (),
    *,
    row_major: bool = True,
    prose: Prose = PLAIN,
) -> list[str]:
    """Return the whole documentation of a function as lines; an empty one separates paragraphs.

    Parameters
    ----------
    names : mapping
        What the language calls each argument and output.
    element : callable
        As in :class:`~steelyard.codegen.Syntax`.
    shared : sequence of Argument
        Their elements are documented elsewhere.
    row_major : bool
        See :func:`output_lines`.
    """
    known = {argument.name for argument in shared}
    lines = []
    text = prose.text(function.description)
    if text:
        lines += [text, ""]
    gap = [""] if prose.bullet else []
    lines += ["Arguments:", *gap] if function.arguments else ["No arguments."]
    for argument in function.arguments:
        elements = argument.name not in known
        found = argument_lines(argument, names[argument.name], element, elements=elements, prose=prose)
        lines += [f"  {line}" for line in found]
    lines += [*gap, "Outputs:", *gap]
    for output in function.outputs:
        found = output_lines(output, names[output.name], element, row_major=row_major, prose=prose)
        lines += [f"  {line}" for line in found]
    return [*lines, "", operations_line(function)]


def elements_lines(
    project: Project, functions: Sequence[NamedFunction], element: Element, *, prose: Prose = PLAIN
) -> list[str]:
    """Return lines on the elements of the arguments that mean the same in all the functions; none where there are none.

    `element` is as in :class:`~steelyard.codegen.Syntax`.
    """
    lines = []
    for argument in shared_arguments(project):
        if argument.elements:
            name = next(f.names[argument.name] for f in functions if argument.name in f.names)
            lines += ["", *argument_lines(argument, name, element, prose=prose)]
    return ["Elements of the arguments, which are the same in all the functions:", *lines] if lines else []


# The README of a generated project.


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
    language : str
        Its name for people.
    files : mapping
        What each file is, by path.
    use : sequence of str
        Markdown lines: how to build, test and call.
    element : callable
        As in :class:`~steelyard.codegen.Syntax`.
    layout : str
        A sentence on how an output of several dimensions is stored.
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
