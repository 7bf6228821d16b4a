"""Derivatives of graphs against complex steps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steelyard.graph import Graph, cos, evaluate, exp, gradient, jacobian, log, sign, sin, sqrt

KINDS = ("add", "sub", "mul", "div", "neg", "sin", "cos", "sign", "sqrt", "exp", "log")
STEPS = st.lists(st.tuples(st.sampled_from(KINDS), st.integers(0, 99), st.integers(0, 99)))


def recorded(steps):
    """A random program over three inputs; every value may be used again."""
    graph = Graph()
    inputs = graph.inputs("x", 3)
    values = list(inputs)
    for kind, i, j in steps:
        a, b = values[i % len(values)], values[j % len(values)]
        if kind == "div":
            values.append(a / (b * b + 2.0))
        elif kind in ("add", "sub", "mul"):
            values.append({"add": a + b, "sub": a - b, "mul": a * b}[kind])
        else:
            values.append(
                {
                    "neg": -a,
                    "sin": sin(a),
                    "cos": cos(a),
                    "sign": sign(sin(a)),
                    "sqrt": sqrt(a * a + 0.5),
                    "exp": exp(-(a * a)),
                    "log": log(a * a + 0.5),
                }[kind]
            )
    return inputs, values


@given(STEPS, st.integers(0, 1000))
def test_forward_and_reverse_agree_with_complex_steps(steps, seed):
    inputs, values = recorded(steps[:12])
    point = np.random.default_rng(seed).uniform(0.2, 0.9, 3)
    named = {f"x[{k}]": v for k, v in enumerate(point)}
    expected = []
    for k in range(3):
        moved = {name: v + 1e-30j * (name == f"x[{k}]") for name, v in named.items()}
        expected.append([np.imag(v) / 1e-30 for v in evaluate(values, moved)])
    expected = np.transpose(expected)
    forward = np.array([evaluate(row, named) for row in jacobian(values, inputs)])
    backward = np.array([evaluate(gradient(value, inputs), named) for value in values])
    np.testing.assert_allclose(forward, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(backward, expected, rtol=1e-9, atol=1e-12)


def test_what_does_not_depend_has_the_derivative_zero():
    graph = Graph()
    x, y = graph.inputs("x", 2)
    assert jacobian([x, graph.constant(3.0)], [y]) == [[graph.zero], [graph.zero]]
    assert gradient(x, [y, x]) == [graph.zero, graph.one]
    assert jacobian([], [x]) == []
    with pytest.raises(ValueError, match="at least one"):
        jacobian([], [])
