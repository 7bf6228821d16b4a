"""JAX functions against the interpreter, the kernels and complex steps."""

import sys
from collections.abc import Iterator

import numpy as np
import pytest
from exported_functions import complex_step, difference, inputs_of, of_kernel

import steelyard as sy
from steelyard.codegen import jax_function
from steelyard.graph import Argument, Function, Graph, Output, sign

jax = pytest.importorskip("jax", reason="JAX is not installed")
LOWERINGS = ("scalars", "vectors")
slow = pytest.mark.slow


@pytest.fixture(autouse=True)
def double_precision() -> Iterator[None]:
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", False)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["inverse_dynamics", *(pytest.param(n, marks=slow) for n in ("forward_dynamics", "regressor"))]
)
def test_robot_functions_agree(name: str, wam_with_friction: sy.Model, random: np.random.Generator) -> None:
    function = wam_with_friction.function(name)
    exported = jax_function(function)
    (output,) = function.outputs
    values = inputs_of(function, random)
    expected = function.evaluate(values)[output.name]
    for sample in range(3):
        found = exported(*(values[a.name][sample] for a in function.arguments))
        assert found.dtype == np.float64
        assert difference(np.asarray(found), expected[sample]) < 1e-12
        assert difference(np.asarray(found), of_kernel(function, values, sample)[output.name]) < 1e-12


@pytest.mark.usefixtures("quick_compilation")
@pytest.mark.slow
@pytest.mark.parametrize("lowering", [pytest.param("scalars", marks=slow), "vectors"])
def test_several_outputs_and_names(lowering: str, odd_function: Function, random: np.random.Generator) -> None:
    exported = jax_function(odd_function, lowering=lowering)
    assert exported.__name__ == "odd__"
    values = inputs_of(odd_function, random)
    expected = odd_function.evaluate(values)
    one = {name if name != "lambda" else "lambda_": rows[0] for name, rows in values.items()}
    for found, sample in ((exported(*values.values()), slice(None)), (exported(**one), 0)):
        assert list(found) == ["number", "same", "matrix", "cube", "constants"]
        for name, value in found.items():
            assert value.dtype == np.float64
            assert difference(np.asarray(value), expected[name][sample]) < 1e-13


@pytest.mark.usefixtures("quick_compilation")
@pytest.mark.slow
@pytest.mark.parametrize("lowering", [pytest.param("scalars", marks=slow), "vectors"])
def test_transformations_go_together(lowering: str, odd_function: Function, random: np.random.Generator) -> None:
    exported = jax_function(odd_function, lowering=lowering)
    values = inputs_of(odd_function, random)
    expected = odd_function.evaluate(values)
    mapped = jax.jit(jax.vmap(exported, in_axes=(0, 0, 0, None, 0)))
    rows = [*values.values()]
    rows[3] = rows[3][0]
    shared = odd_function.evaluate({**values, "lambda": values["lambda"][0]})
    for name, value in mapped(*rows).items():
        assert difference(np.asarray(value), shared[name]) < 1e-13
    batch = exported(
        values["x"][:, None], values["y"][:, None], values["empty"][0], values["lambda"], values["unused"][0]
    )
    assert batch["matrix"].shape == (3, 3, 2, 3)
    for k in range(3):
        assert difference(np.asarray(batch["matrix"][k, k]), expected["matrix"][k]) < 1e-13
    gradient = jax.grad(lambda x, *others: exported(x, *others)["number"])(*(row[0] for row in values.values()))
    exact = complex_step(odd_function, {name: row[0] for name, row in values.items()}, "x")["number"]
    assert difference(np.asarray(gradient), exact) < 1e-12


@pytest.mark.usefixtures("quick_compilation")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("transformation", "lowering"),
    [
        ("jacfwd", "scalars"),
        ("jacrev", "vectors"),
        ("jacfwd", "vectors"),
        ("jacrev", "scalars"),
    ],
)
def test_jacobians_agree_with_complex_steps(
    transformation: str, lowering: str, odd_function: Function, random: np.random.Generator
) -> None:
    exported = jax_function(odd_function, lowering=lowering)
    values = {name: rows[0] for name, rows in inputs_of(odd_function, random, 1).items()}
    jacobian = getattr(jax, transformation)(exported, argnums=tuple(range(len(values))))
    found = jax.jit(jacobian)(*values.values())
    for k, name in enumerate(values):
        for output, expected in complex_step(odd_function, values, name).items():
            assert difference(np.asarray(found[output][k]), expected) < 1e-12


@slow
@pytest.mark.timeout(300)  # about one second where nothing else runs
def test_robot_compiles_and_differentiates_in_seconds(wam_with_friction: sy.Model, random: np.random.Generator) -> None:
    function = wam_with_friction.function("inverse_dynamics")
    exported = jax_function(function)
    values = {name: rows[0] for name, rows in inputs_of(function, random, 1).items()}
    jax.block_until_ready(jax.jit(exported)(**values))
    output = function.outputs[0].name
    jacobians = jax.jit(jax.jacfwd(exported, argnums=(0, 1)))(*values.values())
    for name, found in zip(("q", "dq"), jacobians, strict=True):
        assert difference(np.asarray(found), complex_step(function, values, name)[output]) < 1e-12


@pytest.mark.slow
def test_derivative_of_a_sign_is_zero_and_complex_numbers_pass() -> None:
    x = Graph().inputs("x", 1)
    function = Function("f", (Argument("x", 1),), (Output("y", (), (sign(x[0]) * x[0],)),))
    for lowering in LOWERINGS:
        exported = jax_function(function, lowering=lowering)
        assert [float(jax.grad(exported)(np.array([v]))[0]) for v in (-3.0, 2.0)] == [-1.0, 1.0]
        assert complex(exported(np.array([-2.0 + 1e-3j]))) == 2.0 - 1e-3j


def test_numbers_of_single_precision_are_widened() -> None:
    x = Graph().inputs("x", 1)
    exported = jax_function(Function("f", (Argument("x", 1),), (Output("y", (), (x[0] / 3.0,)),)))
    for one in (np.ones(1, dtype=np.float32), np.ones(1, dtype=np.int64), [1], jax.numpy.ones(1, dtype="float32")):
        assert float(exported(one)) == 1.0 / 3.0


def test_single_precision_is_refused(odd_function: Function) -> None:
    jax.config.update("jax_enable_x64", False)
    x = Graph().inputs("x", 1)
    exported = jax_function(Function("f", (Argument("x", 1),), (Output("y", (), (x[0] / 3.0,)),)))
    with pytest.raises(sy.InputError, match="jax_enable_x64"):
        exported([1.0])


def test_wrong_arguments_are_refused() -> None:
    x = Graph().inputs("x", 2)
    function = Function("f", (Argument("x", 2),), (Output("y", (), (x[0] / x[1],)),))
    for wrong in (1.0, [1.0, 2.0, 3.0], np.zeros((2, 1))):
        with pytest.raises(sy.InputError, match=r"x must have shape \(\.\.\., 2\), got"):
            jax_function(function)(wrong)
    with pytest.raises(TypeError, match="missing a required argument: 'x'"):
        jax_function(function)()
    with pytest.raises(sy.InputError, match="lowering must be 'automatic', 'scalars' or 'vectors', got 'fast'"):
        jax_function(function, lowering="fast")


@slow
@pytest.mark.timeout(300)  # some seconds where nothing else runs
def test_large_functions_become_vectors(wam_with_friction: sy.Model) -> None:
    """Many outputs that share thousands of operations."""
    function = wam_with_friction.function("inverse_dynamics_derivatives")
    values = {a.name: np.linspace(-1.0, 1.0, a.width) for a in function.arguments}
    found = jax_function(function)(**values)
    for name, expected in function.evaluate(values).items():
        assert difference(np.asarray(found[name]), expected) < 1e-12


def test_missing_jax_names_the_extra(odd_function: Function, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(sy.MissingExtraError, match=r"pip install 'jax>="):
        jax_function(odd_function)
