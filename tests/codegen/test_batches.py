"""Batches of generated and exported functions, every argument against every other, beside samples computed alone."""

import itertools
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
from batches import Shapes, drawn, leading_shapes, one_by_one, single_beside, small_model

import steelyard as sy
from steelyard.codegen import Project, casadi_function, jax_function
from steelyard.dynamics.model_source import model_project
from steelyard.graph import Argument, Function, Graph, Output

from .conftest import project_of
from .scripts import module_of

FUNCTIONS = small_model().functions
CASES = [5, pytest.param(None, marks=pytest.mark.slow)]  # JAX compiles each shape anew


@pytest.fixture(scope="module")
def model() -> sy.Model:
    return small_model()


@pytest.fixture(scope="module")
def project(model: sy.Model) -> Project:
    """All the functions, gravity an argument as well."""
    return model_project(model._functions, FUNCTIONS, gravity="argument")


@pytest.fixture
def double_precision(quick_compilation: None) -> Iterator[None]:
    jax = pytest.importorskip("jax", reason="JAX is not installed")
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", False)


def little_function() -> Function:
    """Widths 2, 3 and 4, and outputs of several shapes, one of them constant."""
    graph = Graph()
    x, y, z = graph.inputs("x", 3), graph.inputs("y", 2), graph.inputs("z", 4)
    table = tuple(x[k % 3] * y[k % 2] - z[k % 4] for k in range(6))
    return Function(
        "little",
        (Argument("x", 3), Argument("y", 2), Argument("z", 4, uniform=True)),
        (Output("table", (2, 3), table), Output("number", (), (table[4],)), Output("fixed", (1,), (graph.one,))),
    )


def compare(function: Function, call: Callable[..., object], cases: Iterable[Shapes]) -> None:
    random = np.random.default_rng(17)
    for shapes in cases:
        arrays = drawn(function.arguments, shapes, random)
        results = call(*arrays)
        if isinstance(results, dict):
            results = tuple(results[output.name] for output in function.outputs)
        found = results if isinstance(results, tuple) else (results,)
        for value, wanted in zip(found, one_by_one(function, arrays), strict=True):
            assert np.shape(value) == wanted.shape, shapes
            np.testing.assert_allclose(
                value, wanted, rtol=1e-12, atol=1e-12 * np.abs(wanted).max(), err_msg=str(shapes)
            )


def few_shapes(function: Function) -> tuple[Shapes, Shapes]:
    """Return an axis for each argument, and a batch as long as the widest argument, which is single."""
    widths = [argument.width for argument in function.arguments]
    widest = int(np.argmax(widths))
    _, apart = itertools.islice(leading_shapes(function.arguments), 2)
    return apart, single_beside(len(widths), widest, (widths[widest],))


@pytest.mark.slow
def test_numpy_source(model: sy.Model, project: Project, tmp_path: Path) -> None:
    module = module_of(project, "python", tmp_path)
    for function in (model.function(name, gravity="argument") for name in FUNCTIONS):
        compare(function, getattr(module, function.name), leading_shapes(function.arguments))


@pytest.mark.slow
@pytest.mark.parametrize("vectors", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("cases", CASES)
def test_jax_source_of_a_little_function(
    cases: int | None, vectors: bool, double_precision: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("steelyard.codegen.jax.prefers_vectors", lambda function: vectors)
    function = little_function()
    module = module_of(project_of("little", [function]), "jax", tmp_path)
    compare(function, module.little, itertools.islice(leading_shapes(function.arguments), cases))


@pytest.mark.slow
def test_jax_source_of_all_functions(
    model: sy.Model,
    project: Project,
    double_precision: None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Every second one by vectors; those that stand here by vectors are `jax_function`s of numbers below."""
    monkeypatch.setattr(
        "steelyard.codegen.jax.prefers_vectors", lambda function: FUNCTIONS.index(function.name) % 2 == 0
    )
    module = module_of(project, "jax", tmp_path)
    for function in (model.function(name, gravity="argument") for name in FUNCTIONS):
        compare(function, getattr(module, function.name), few_shapes(function))


@pytest.mark.slow
@pytest.mark.parametrize("lowering", ["scalars", "vectors"])
@pytest.mark.parametrize("cases", CASES)
def test_jax_function(cases: int | None, lowering: str, double_precision: None) -> None:
    function = little_function()
    compare(
        function, jax_function(function, lowering=lowering), itertools.islice(leading_shapes(function.arguments), cases)
    )


@pytest.mark.slow
def test_jax_functions_of_a_model(model: sy.Model, double_precision: None) -> None:
    jax = pytest.importorskip("jax")
    for number, name in enumerate(FUNCTIONS):
        function = model.function(name, gravity="argument")
        lowering = "vectors" if number % 2 else "scalars"
        compare(function, jax.jit(jax_function(function, lowering=lowering)), few_shapes(function))


@pytest.mark.slow
@pytest.mark.parametrize("generated", [False, True])
def test_columns_of_casadi_functions(generated: bool, model: sy.Model, project: Project, tmp_path: Path) -> None:
    """CasADi takes a batch as columns beside each other, and single columns beside it count for all of them."""
    casadi = pytest.importorskip("casadi", reason="CasADi is not installed")
    module = module_of(project, "casadi", tmp_path) if generated else None
    random = np.random.default_rng(18)
    for name in FUNCTIONS:
        function = model.function(name, gravity="argument")
        call = casadi_function(function) if module is None else getattr(module, function.name)()
        for shapes in leading_shapes(function.arguments):
            size = max((shape[0] for shape in shapes if shape), default=1)
            if any(len(shape) > 1 for shape in shapes):
                continue
            arrays = drawn(function.arguments, shapes, random)
            found = call.call([casadi.DM(np.atleast_2d(array).T) for array in arrays])
            for value, wanted, output in zip(found, one_by_one(function, arrays), function.outputs, strict=True):
                width = output.shape[-1] if len(output.shape) > 1 else 1
                beside = np.concatenate(list(wanted.reshape(size, -1, width)), axis=1)
                np.testing.assert_allclose(value.full(), beside, rtol=1e-12, atol=1e-12 * np.abs(wanted).max())
