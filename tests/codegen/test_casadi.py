"""CasADi functions against the interpreter, the kernels and complex steps."""

import sys

import numpy as np
import pytest
from exported_functions import complex_step, deep_chain, difference, inputs_of, of_kernel

import steelyard as sy
from steelyard.codegen import casadi_function
from steelyard.graph import Argument, Function, Graph, Output, sign

casadi = pytest.importorskip("casadi", reason="CasADi is not installed")


@pytest.mark.parametrize(
    "name",
    ["inverse_dynamics", "forward_dynamics", "inertia_matrix", pytest.param("regressor", marks=pytest.mark.slow)],
)
def test_robot_functions_agree(name: str, wam_with_friction: sy.Model, random: np.random.Generator) -> None:
    function = wam_with_friction.function(name)
    exported = casadi_function(function)
    (output,) = function.outputs
    values = inputs_of(function, random)
    expected = function.evaluate(values)[output.name]
    for sample in range(3):
        found = exported(*(values[a.name][sample] for a in function.arguments)).full()
        found = found.reshape(output.shape)
        assert difference(found, expected[sample]) < 1e-12
        assert difference(found, of_kernel(function, values, sample)[output.name]) < 1e-12


def test_names_and_shapes(odd_function: Function, random: np.random.Generator) -> None:
    exported = casadi_function(odd_function)
    assert exported.name_in() == ["x", "y", "empty", "lambda", "unused"]
    assert exported.name_out() == ["number", "same", "matrix", "cube", "constants"]
    assert [exported.size_in(k) for k in range(5)] == [(3, 1), (2, 1), (0, 1), (1, 1), (2, 1)]
    assert [exported.size_out(k) for k in range(5)] == [(1, 1), (2, 1), (2, 3), (6, 4), (3, 1)]
    assert casadi.Function.check_name(exported.name())
    values = {name: rows[0] for name, rows in inputs_of(odd_function, random).items()}
    found = exported(**values)
    for output in odd_function.outputs:
        expected = odd_function.evaluate(values)[output.name]
        assert difference(found[output.name].full().reshape(output.shape), expected) < 1e-13
    assert found["matrix"].full()[0, 1] == pytest.approx(
        float(odd_function.evaluate(values)["matrix"][0, 1]), rel=1e-13
    )


def test_jacobians_agree_with_complex_steps(wam_with_friction: sy.Model, random: np.random.Generator) -> None:
    function = wam_with_friction.function("inverse_dynamics")
    exported = casadi_function(function)
    values = {name: rows[0] for name, rows in inputs_of(function, random, 1).items()}
    names = [argument.name for argument in function.arguments]
    output = function.outputs[0].name
    jacobians = exported.factory("jacobians", names, [f"jac:{output}:{name}" for name in names])(*values.values())
    for name, found in zip(names, jacobians, strict=True):
        assert difference(found.full(), complex_step(function, values, name)[output]) < 1e-12


def test_jacobian_of_a_matrix_has_the_order_of_casadi(odd_function: Function, random: np.random.Generator) -> None:
    values = {name: rows[0] for name, rows in inputs_of(odd_function, random, 1).items()}
    exported = casadi_function(odd_function).factory("g", list(values), ["jac:matrix:x"])
    found = exported(*values.values()).full()
    expected = complex_step(odd_function, values, "x")["matrix"]  # (2, 3, 3)
    assert difference(found, expected.reshape(6, 3, order="F")) < 1e-12


def test_derivative_of_a_sign_is_zero() -> None:
    x = Graph().inputs("x", 1)
    function = Function("f", (Argument("x", 1),), (Output("y", (), (sign(x[0]) * x[0],)),))
    derivative = casadi_function(function).factory("g", ["x"], ["jac:y:x"])
    assert [float(derivative(v)) for v in (-3.0, 2.0)] == [-1.0, 1.0]


def test_function_is_mapped_over_a_batch(wam_with_friction: sy.Model, random: np.random.Generator) -> None:
    function = wam_with_friction.function("gravity")
    values = inputs_of(function, random, 4)
    found = casadi_function(function).map(4)(*(rows.T for rows in values.values())).full()
    assert difference(found.T, function.evaluate(values)[function.outputs[0].name]) < 1e-13


@pytest.mark.parametrize("name", ["jac", "hess", "null", "a__b", "f_"])
def test_reserved_names(name: str) -> None:
    graph = Graph()
    x = graph.inputs("jac", 1)
    function = Function(name, (Argument("jac", 1),), (Output("a__b", (), (x[0] + 1.0,)),))
    assert float(casadi_function(function)(jac=2.0)["a__b"]) == 3.0


@pytest.mark.slow
def test_deep_graph() -> None:
    function = deep_chain(10_000)
    exported = casadi_function(function)
    expected = function.evaluate({"x": [1.0, 0.5]})["y"]
    assert float(exported([1.0, 0.5])) == pytest.approx(float(expected), rel=1e-14)


def test_missing_casadi_names_the_extra(odd_function: Function, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(sy.MissingExtraError, match=r"pip install 'casadi>="):
        casadi_function(odd_function)
