"""Matrices of expressions as text, LaTeX and HTML."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from typing import Any

from .linear_expression import LinearExpression, number_text

__all__ = ["latex_matrix", "latex_name", "matrix_html", "matrix_text"]

Matrix = Sequence[Sequence[Any]] | Any

_GREEK = {
    *("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu", "nu"),
    *("xi", "pi", "rho", "sigma", "tau", "upsilon", "phi", "chi", "psi", "omega"),
}


def matrix_text(matrix: Matrix, most: int) -> str:
    """Rows between brackets, columns aligned; rows and columns beyond `most` become dots.

    Examples
    --------
    >>> print(matrix_text([["m1", "0"], ["0", "2*m1 - 1"]], 10))
    ⎡ m1  0        ⎤
    ⎣ 0   2*m1 - 1 ⎦
    """
    cells = [[str(element) for element in row] for row in _shortened(matrix, most, "⋯", "⋮", "⋱")]
    widths = [max(len(row[j]) for row in cells) for j in range(len(cells))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in cells]
    if len(lines) == 1:
        return f"[ {lines[0]} ]"
    left, right = "⎡" + "⎢" * (len(lines) - 2) + "⎣", "⎤" + "⎥" * (len(lines) - 2) + "⎦"
    return "\n".join(f"{a} {line} {b}" for a, line, b in zip(left, lines, right, strict=True))


def latex_matrix(matrix: Matrix, most: int) -> str:
    r"""A ``bmatrix``.

    Examples
    --------
    >>> latex_matrix([[LinearExpression({"Lxx1": 1.0, "m1": -0.5}, 2.0)]], 10)
    '\\begin{bmatrix} L_{xx1} - 0.5\\, m_{1} + 2 \\end{bmatrix}'
    """
    rows = _shortened(matrix, most, r"\cdots", r"\vdots", r"\ddots")
    body = r" \\ ".join(" & ".join(_latex(element) for element in row) for row in rows)
    return rf"\begin{{bmatrix}} {body} \end{{bmatrix}}"


def latex_name(name: str) -> str:
    r"""A variable as a letter with an index, as in the thesis.

    Examples
    --------
    >>> latex_name("Lyy3"), latex_name("beta12"), latex_name("Fv1"), latex_name("u")
    ('L_{yy3}', '\\beta_{12}', 'F_{v1}', 'u')
    """
    found = re.fullmatch(r"([A-Za-z]+)_?(.*)", name, flags=re.DOTALL)
    if found is None:
        return rf"\text{{{_escaped(name)}}}"
    letters, rest = found.groups()
    if letters in _GREEK:
        head, index = f"\\{letters}", rest
    else:
        head, index = letters[0], name[1:].lstrip("_")
    return f"{head}_{{{_escaped(index)}}}" if index else head


def matrix_html(matrix: Matrix, most: int) -> str:
    """An HTML table."""
    rows = _shortened(matrix, most, "⋯", "⋮", "⋱")
    body = "".join(f"<tr>{''.join(f'<td>{html.escape(str(x))}</td>' for x in row)}</tr>" for row in rows)
    return f'<table style="border-left: 1px solid; border-right: 1px solid">{body}</table>'


def _shortened(matrix: Matrix, most: int, across: str, down: str, diagonal: str) -> list[list[Any]]:
    size = len(matrix)
    if size <= most:
        return [list(row) for row in matrix]
    tail = max(1, (most - 1) // 3)
    head = max(1, most - 1 - tail)
    shown = [*range(head), None, *range(size - tail, size)]
    rows: list[list[Any]] = []
    for i in shown:
        if i is None:
            rows.append([diagonal if j is None else down for j in shown])
        else:
            rows.append([across if j is None else matrix[i][j] for j in shown])
    return rows


def _latex(element: object) -> str:
    if not isinstance(element, LinearExpression):
        return str(element)
    parts = [(value, latex_name(name)) for name, value in element.terms.items()]
    text = ""
    for value, name in parts:
        size = "" if abs(value) == 1.0 else rf"{_latex_number(abs(value))}\, "
        text += _joined(text, value < 0, size + name)
    if element.constant != 0.0 or not parts:
        text += _joined(text, element.constant < 0, _latex_number(abs(element.constant)))
    return text


def _joined(before: str, negative: bool, part: str) -> str:
    if not before:
        return f"-{part}" if negative else part
    return f" {'-' if negative else '+'} {part}"


def _latex_number(value: float) -> str:
    mantissa, _, exponent = number_text(value).partition("e")
    return rf"{mantissa} \cdot 10^{{{int(exponent)}}}" if exponent else mantissa


def _escaped(text: str) -> str:
    return re.sub(r"([\\{}$&#^_%~])", lambda found: "\\" + found[1] if found[1] not in "\\^~" else " ", text)
