"""Programs of every size and form, compiled, against NumPy."""

import numpy as np
import pytest

from steelyard.graph import Argument, Function, Graph, Kernel, ObjectCache, Output, cos, sign, sin
from steelyard.graph.llvm import Program

NO_CACHE = ObjectCache(None)
ARGUMENTS = (Argument("x", 5), Argument("p", 4, uniform=True), Argument("y", 9))


def random_program(operations, outputs, seed):
    """Return a function of random operations that keep numbers near 1."""
    random = np.random.default_rng(seed)
    g = Graph()
    nodes = g.inputs("x", 5) + g.inputs("p", 4) + g.inputs("y", 9) + [g.constant(0.75), g.constant(-2.0)]
    while len(nodes) < operations + 20:
        a, b = (nodes[len(nodes) - 1 - int(k)] for k in random.geometric(0.02, 2).clip(max=len(nodes)) - 1)
        kind = random.integers(12)
        if kind < 4:
            node = 0.5 * (a + b)
        elif kind < 6:
            node = 0.5 * (a - b)
        elif kind < 9:
            node = a * b - (b * 0.3) * a
        elif kind == 9:
            node = a / (2.0 + b * b)
        else:
            node = (sin, cos, sign)[random.integers(3)](a) if random.integers(8) == 0 else -a
        nodes.append(g.node(node))
    chosen = [nodes[int(k)] for k in random.integers(len(nodes), size=outputs - 3)]
    return Function("f", ARGUMENTS, (Output("z", (outputs,), (*chosen, g.zero, nodes[0], nodes[6])),))


@pytest.mark.parametrize(
    ("operations", "outputs", "seed"),
    [
        (5, 4, 1),
        (200, 11, 2),
        pytest.param(1000, 70, 3, marks=pytest.mark.slow),
        pytest.param(3000, 40, 4, marks=pytest.mark.slow),
        pytest.param(5000, 300, 5, marks=pytest.mark.slow),
    ],
)
def test_programs_agree_with_numpy_and_lanes_with_each_other(operations, outputs, seed):
    function = random_program(operations, outputs, seed)
    random = np.random.default_rng(seed)
    x, p, y = random.normal(size=(19, 5)), random.normal(size=4), random.normal(size=(19, 9))
    kernel = Kernel(function, cache=NO_CACHE)
    result = kernel(x, p, y)
    np.testing.assert_allclose(result, function.evaluate({"x": x, "p": p, "y": y})["z"], rtol=1e-12, atol=1e-13)
    for s in range(19):
        assert kernel.sample(x[s], p, y[s]).tolist() == result[s].tolist()


def test_long_programs_are_divided_and_complete():
    function = random_program(5000, 300, 5)
    program = Program(function.arguments, function.nodes)
    assert len(program.parts) > 2
    assert max(map(len, program.parts)) <= 1200
    placed = [node.index for part in program.parts for node in part]
    assert len(placed) == len(set(placed))
    position = {index: k for k, index in enumerate(placed)}
    for part in program.parts:
        for node in part:
            for operand in program.operands(node):
                assert position.get(operand.index, -1) < position[node.index]


def test_what_is_the_same_for_all_samples_is_computed_once():
    g = Graph()
    x, p = g.input("x[0]"), g.inputs("p", 2)
    same = sin(p[0]) * p[1] + 3.0
    program = Program((Argument("x", 1), Argument("p", 2, uniform=True)), [same * x, same, cos(x) * p[0]])
    assert [n.operation for n in program.once] == ["sin", "mul", "add"]
    assert sum(map(len, program.parts)) == 2
    assert [n.value for n in program.angles] == ["x[0]"]


def test_functions_of_uniform_arguments_or_of_none():
    g = Graph()
    p = g.inputs("p", 2)
    shared = Function("f", (Argument("p", 2, uniform=True),), (Output("y", (2,), (p[0] / p[1], sin(p[0]))),))
    values = np.array([0.3, 0.7])
    np.testing.assert_allclose(Kernel(shared, cache=NO_CACHE)(values), [[0.3 / 0.7, np.sin(0.3)]], rtol=1e-15)
    constant = Function("f", (Argument("x", 1),), (Output("y", (2,), (g.constant(1.5), g.zero)),))
    assert Kernel(constant, cache=NO_CACHE)(np.ones((3, 1))).tolist() == [[1.5, 0.0]] * 3
    nothing = Function("f", (), (Output("y", (), (g.constant(1.5),)),))
    assert Kernel(nothing, cache=NO_CACHE)().tolist() == [[1.5]]


def test_sines_of_what_depends_on_sines():
    x = Graph().inputs("x", 2)
    inner = sin(x[0] + x[1])
    nodes = (sin(inner), cos(inner) * inner, sin(cos(x[0]) * x[1]), cos(x[0] * x[1]))
    function = Function("f", (Argument("x", 2),), (Output("y", (4,), nodes),))
    samples = np.random.default_rng(0).normal(size=(11, 2))
    np.testing.assert_allclose(
        Kernel(function, cache=NO_CACHE)(samples), function.evaluate({"x": samples})["y"], rtol=1e-14, atol=1e-15
    )
