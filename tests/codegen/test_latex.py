"""Symbolic functions as LaTeX, in files and in notebooks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from published_arms import WAM_ROWS

import steelyard as sy

pytest.importorskip("sympy", reason="symbolic expressions need sympy")


@pytest.fixture(scope="module")
def planar() -> sy.Model:
    rows = [(0, "a1", 0, "q"), (0, "a2", 0, "q")]
    return sy.Model(sy.Robot.from_dh(rows, name="planar", gravity=(0, -10, 0)))


def test_latex_names_are_those_of_the_thesis(planar: sy.Model) -> None:
    text = sy.Model(planar.robot.with_terms(sy.Viscous())).symbolic("inverse_dynamics", closed=False).latex()
    for piece in (r"\dot{q}_1", r"\ddot{q}_2", r"L_{zz,1}", r"l_{x,2}", r"F_{vj,2}", "m_2", "a_1", r"\mathrm{torque}"):
        assert piece in text
    assert text.startswith("\\begin{aligned}\nx_1 &= ")
    base = sy.Model(planar.robot.with_lengths({"a1": 1.0, "a2": 1.0})).symbolic("inertia_matrix", base=True)
    assert r"\beta_1" in base.latex()


@pytest.mark.parametrize("closed", [True, False])
def test_latex_reads_as_the_same_expression(closed: bool, planar: sy.Model) -> None:
    """An independent reading: LaTeX turned back to Python by a few replacements, and evaluated."""
    found = planar.symbolic("gravity", closed=closed)
    numbers = {s: float(k) / 7 + 0.3 for k, s in enumerate(found.symbols.values())}
    expected = found.closed().outputs["torque"].xreplace(numbers)
    values: dict[str, Any] = {}
    lines = found.latex().removeprefix("\\begin{aligned}\n").removesuffix("\n\\end{aligned}")
    names = {"q_1": "q1", "q_2": "q2", "l_{x,1}": "lx1", "l_{y,1}": "ly1", "l_{x,2}": "lx2", "l_{y,2}": "ly2"}
    names |= {"m_1": "m1", "m_2": "m2", "a_1": "a1", "a_2": "a2"}
    values |= {name.name: number for name, number in numbers.items()} | {"sin": np.sin, "cos": np.cos}
    *assignments, output = lines.split(" \\\\\n") if not closed else [lines]
    read = ""
    for line in [*assignments, output]:
        left, right = line.split(" &= ", 1)
        right = right.removeprefix(r"\left[\begin{matrix}").removesuffix(r"\end{matrix}\right]")
        for piece, name in names.items():
            right = right.replace(piece, f" {name} ")
        for piece, plain in (
            (r"\left", ""),
            (r"\right", ""),
            ("{", ""),
            ("}", ""),
            ("\\sin", " sin"),
            ("\\cos", " cos"),
        ):
            right = right.replace(piece, plain)
        read = right
        rows = [eval(_product(row), {"__builtins__": {}}, values) for row in right.split("\\\\")]
        values[left.strip().replace("_", "").replace("{", "").replace("}", "")] = rows[0]
    assert read
    assert rows == pytest.approx([float(e) for e in expected])


def _product(text: str) -> str:
    """Write the products that juxtaposition means."""
    tokens = text.replace("_", "").replace("(", " ( ").replace(")", " ) ").split()
    result: list[str] = []
    for token in tokens:
        starts = token == "(" or token[0].isalnum()
        if result and starts and (result[-1] == ")" or result[-1][-1].isalnum()) and result[-1] not in ("sin", "cos"):
            result.append("*")
        result.append(token)
    return " ".join(result)


@pytest.mark.slow
def test_notebooks_show_the_beginning_of_long_functions() -> None:
    model = sy.Model(sy.Robot.from_dh(WAM_ROWS, name="wam"))
    for closed, name in ((False, "inverse_dynamics"), (True, "gravity")):
        found = model.symbolic(name, closed=closed)
        text = found._repr_latex_()
        assert "operations" in text
        assert len(text) < 6000 < len(found.latex())
        assert text.count("{") == text.count("}")
    short = model.symbolic("pose(link1)")
    assert short.latex() in short._repr_latex_()
