"""Evaluation of graph functions over any algebra."""

from fractions import Fraction

import numpy as np
import pytest
from exported_functions import deep_chain, inputs_of

import steelyard as sy
from steelyard.codegen.jax import repeated_operations, schedule
from steelyard.graph import Argument, Function, Graph, Output, evaluate_over, sin


def test_numbers_of_any_kind(odd_function: Function, random: np.random.Generator) -> None:
    values = {name: rows[0] for name, rows in inputs_of(odd_function, random).items()}
    unary = {"sin": np.sin, "cos": np.cos, "sign": np.sign}
    found = evaluate_over(odd_function, {k: list(v) for k, v in values.items()}, unary)
    expected = odd_function.evaluate(values)
    for output, elements in zip(odd_function.outputs, found, strict=True):
        np.testing.assert_array_equal(np.reshape(elements, output.shape), expected[output.name])


def test_fractions_stay_exact() -> None:
    a, b = Graph().inputs("x", 2)
    function = Function("f", (Argument("x", 2),), (Output("y", (2,), (a / b - a, -(a + 0.5))),))
    elements = {"x": [Fraction(1, 3), Fraction(2, 7)]}
    assert evaluate_over(function, elements, {}, Fraction) == ([Fraction(5, 6), Fraction(-5, 6)],)


@pytest.mark.parametrize("elements", [{}, {"x": [1.0]}, {"x": [1.0, 2.0, 3.0]}])
def test_wrong_number_of_elements(elements: dict[str, list[float]]) -> None:
    a, b = Graph().inputs("x", 2)
    function = Function("f", (Argument("x", 2),), (Output("y", (), (a * b,)),))
    with pytest.raises(sy.InputError, match=r"'x' of 'f' has 2 elements, got"):
        evaluate_over(function, elements, {})


def test_input_that_is_no_argument() -> None:
    a, b = Graph().inputs("x", 2)
    function = Function("f", (Argument("x", 1),), (Output("y", (), (a * b,)),))
    with pytest.raises(sy.InputError, match=r"'f' reads x\[1\], which is no argument"):
        evaluate_over(function, {"x": [1.0]}, {})


def _interpreted(function: Function, values: dict[str, np.ndarray]) -> list[np.ndarray]:
    plan = schedule(function)
    vector = np.full(plan.size, np.nan)
    start = np.concatenate([values[a.name] for a in function.arguments] + [plan.constants])
    vector[: len(start)] = start
    operations = {"add": np.add, "mul": np.multiply, "div": np.divide, "neg": np.negative}
    operations |= {"sin": np.sin, "cos": np.cos, "sign": np.sign}
    for step in plan.steps:
        operands = [vector[step.first]]
        if step.second is not None:
            operands.append(vector[step.second] * (1.0 if step.signs is None else step.signs))
        vector[step.start : step.start + len(step.first)] = operations[step.operation](*operands)
    return [vector[places] for places in plan.outputs]


def test_schedule_computes_the_function(
    odd_function: Function, wam_with_friction: sy.Model, random: np.random.Generator
) -> None:
    for function in (odd_function, wam_with_friction.function("inverse_dynamics")):
        values = {name: rows[0] for name, rows in inputs_of(function, random).items()}
        expected = function.evaluate(values)
        for output, found in zip(function.outputs, _interpreted(function, values), strict=True):
            np.testing.assert_array_equal(found.reshape(output.shape), expected[output.name])


def test_schedule_has_few_steps(wam_with_friction: sy.Model) -> None:
    function = wam_with_friction.function("inverse_dynamics")
    assert len(schedule(function).steps) < sum(function.operation_count.values()) / 8


def test_repeated_operations_count_shared_ones_again() -> None:
    graph = Graph()
    x = graph.inputs("x", 3)
    shared = sin(x[0])  # needed by both outputs
    function = Function("f", (Argument("x", 3),), (Output("y", (3,), (shared * x[1], shared + x[2], x[0])),))
    assert repeated_operations(function) == 4


@pytest.mark.slow
@pytest.mark.timeout(300)  # one second where nothing else runs; many minutes were it quadratic
def test_deep_and_large_graphs_take_time_in_proportion() -> None:
    function = deep_chain(50_000)
    (elements,) = evaluate_over(function, {"x": [1.0, 0.5]}, {})
    plan = schedule(function)
    assert repeated_operations(function) == sum(function.operation_count.values())
    assert plan.size > 83_000
    np.testing.assert_allclose(elements[0], function.evaluate({"x": [1.0, 0.5]})["y"], rtol=1e-15)
