"""Listings compute, operation by operation, what the graph computes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steelyard.codegen import Names, Syntax, listing
from steelyard.codegen.assignments import Store, partition
from steelyard.errors import InputError
from steelyard.graph import Argument, Function, Graph, Node, Output, cos, sign, sin

PYTHON = {"sin": np.sin, "cos": np.cos, "sign": np.sign}


def executed(function: Function, values: dict[str, np.ndarray], syntax: Syntax | None = None) -> list[np.float64]:
    """Run a listing as Python, which groups operations as C does."""
    found = listing(function, syntax or Syntax())
    names: dict[str, object] = {**PYTHON, **values}
    for assignment in found.assignments:
        exec(f"{assignment.name} = {assignment.expression}", names)
    return [np.float64(eval(text, names)) for part in found.outputs for text in part.elements]


@st.composite
def functions(draw: st.DrawFn) -> Function:
    graph = Graph()
    nodes: list[Node] = [*graph.inputs("x", 4), graph.constant(0.3), graph.constant(-1.7)]
    kinds = st.sampled_from(["add", "sub", "mul", "div", "neg", "sin", "cos", "sign"])
    for operation in draw(st.lists(kinds, max_size=60)):
        # Recent values first, so that some are used once and inlined, and some again.
        recent = nodes[-6:] if draw(st.booleans()) else nodes
        a, b = draw(st.sampled_from(recent)), draw(st.sampled_from(recent))
        if operation == "div":
            made = a / (b * b + 0.5)
        elif operation in ("sin", "cos", "sign"):
            made = {"sin": sin, "cos": cos, "sign": sign}[operation](a)
        elif operation == "neg":
            made = -a
        else:
            made = {"add": graph.add, "sub": graph.sub, "mul": graph.mul}[operation](a, b)
        nodes.append(made)
    outputs = draw(st.lists(st.sampled_from(nodes[-8:]), min_size=1, max_size=5))
    return Function("f", (Argument("x", 4),), (Output("y", (len(outputs),), tuple(outputs)),))


@given(functions(), st.integers(0, 1000))
def test_listing_gives_the_same_bits(function: Function, seed: int) -> None:
    values = {"x": np.random.default_rng(seed).uniform(-2.0, 2.0, 4)}
    with np.errstate(all="ignore"):
        assert np.array_equal(executed(function, values), function.evaluate(values)["y"], equal_nan=True)


@given(functions())
def test_pairs_of_sine_and_cosine_change_nothing(function: Function) -> None:
    values = {"x": np.array([0.1, -2.0, 0.7, 1.3])}
    pairs = Syntax(pair=("{}, {}", "(lambda angle: (sin(angle), cos(angle)))({})"))
    with np.errstate(all="ignore"):
        assert np.array_equal(executed(function, values, pairs), function.evaluate(values)["y"], equal_nan=True)


@given(functions(), st.integers(1, 7))
def test_parts_give_the_same_bits(function: Function, size: int) -> None:
    values = {"x": np.array([0.4, -1.1, 0.7, 2.3])}
    cut = partition(listing(function, Syntax()), largest=0, size=size)
    kept = [np.nan] * cut.places
    results: dict[int, np.float64] = {}
    with np.errstate(all="ignore"):
        for part in cut.parts:
            names: dict[str, object] = {**PYTHON, **values, **{name: kept[place] for name, place in part.reads}}
            assert len(part.statements) >= 1
            for statement in part.statements:
                value = eval(statement.expression, names)
                if isinstance(statement, Store):
                    results[statement.element] = np.float64(value)
                else:
                    names[statement.name] = value
            for name, place in part.keeps:
                kept[place] = names[name]  # type: ignore[call-overload]
        expected = function.evaluate(values)["y"]
        assert np.array_equal([results[k] for k in range(len(expected))], expected, equal_nan=True)


def test_sine_and_cosine_of_an_angle_stand_side_by_side() -> None:
    a, b = Graph().inputs("q", 2)
    y = sin(a) + sin(b) * (cos(b) + cos(a))
    function = Function("f", (Argument("q", 2),), (Output("y", (), (y,)),))
    found = listing(function, Syntax(pair=("({}, {})", "sin_cos({})")))
    assert [(x.name, x.expression) for x in found.assignments] == [
        ("(s1, c1)", "sin_cos(q[0])"),
        ("(s2, c2)", "sin_cos(q[1])"),
    ]
    assert found.outputs[0].elements == ("s1 + s2 * (c1 + c2)",) or found.outputs[0].elements == (
        "s1 + s2 * (c2 + c1)",
    )
    assert found.operations == {"input", "sin", "cos", "add", "mul"}


def test_shared_values_are_computed_once_and_lines_stay_short() -> None:
    graph = Graph()
    x = graph.inputs("x", 40)
    shared = x[0] * x[1] + x[2]
    total = shared
    for value in x:
        total = total * value + shared
    function = Function("f", (Argument("x", 40),), (Output("y", (), (total,)),))
    found = listing(function, Syntax())
    assert sum("x[0] * x[1]" in a.expression for a in found.assignments) == 1
    assert max(len(a.expression) for a in found.assignments) <= 100


def test_a_deep_graph_needs_no_deep_recursion() -> None:
    graph = Graph()
    x = graph.input("x[0]")
    total = x
    for _ in range(20_000):
        total = sin(total) * x + 1.0
    function = Function("f", (Argument("x", 1),), (Output("y", (), (total,)),))
    found = listing(function, Syntax())
    assert 20_000 <= len(found.assignments) <= 40_000
    assert max(len(a.expression) for a in found.assignments) <= 100


def test_local_names_avoid_those_in_use() -> None:
    graph = Graph()
    names = ("t1", "s1", "c1", "t_2")
    x = {name: graph.inputs(name, 1)[0] for name in names}
    square = (x["t1"] + sin(x["s1"])) * (x["c1"] + cos(x["s1"]))
    function = Function("f", tuple(Argument(n, 1) for n in names), (Output("y", (2,), (square, square * x["t_2"])),))
    found = listing(function, Syntax(), scope=Names({"c_1"}))
    locals_ = [a.name for a in found.assignments]
    assert len(set(locals_) | set(names) | {"c_1"}) == len(locals_) + len(names) + 1
    values = {name: np.array([0.1 * k + 0.2]) for k, name in enumerate(names)}
    assert np.array_equal(executed(function, values), function.evaluate(values)["y"])


def test_arguments_may_have_other_names_and_other_brackets() -> None:
    graph = Graph()
    a, _ = graph.inputs("q", 2)
    function = Function("f", (Argument("q", 2), Argument("dq", 2)), (Output("y", (), (2.0 * a,)),))
    found = listing(function, Syntax(element=lambda name, k: f"{name}({k + 1})"), {"q": "q_2"})
    assert found.outputs[0].elements == ("2.0 * q_2(1)",)
    assert found.used_arguments == {"q"}


def test_mostly_zero_outputs_store_what_is_not() -> None:
    graph = Graph()
    (x,) = graph.inputs("x", 1)
    nodes = [graph.zero] * 12
    nodes[4] = x
    function = Function(
        "f", (Argument("x", 1),), (Output("y", (3, 4), tuple(nodes)), Output("z", (2,), (x, graph.zero)))
    )
    first, second = listing(function, Syntax()).outputs
    assert (first.mostly_zero, first.stored) == (True, ((4, "x[0]"),))
    assert (second.mostly_zero, second.stored) == (False, ((0, "x[0]"), (1, "0.0")))


def test_reading_what_is_no_argument_is_refused() -> None:
    graph = Graph()
    y = graph.inputs("y", 3)[2]
    function = Function("f", (Argument("y", 2),), (Output("z", (), (y * y,)),))
    with pytest.raises(InputError, match=r"'f' reads y\[2\], which is no argument of it; add one"):
        listing(function, Syntax())
