"""Functions to export: of the WAM with friction, and small ones that are odd in some way."""

import numpy as np
import pytest
from numpy.typing import NDArray
from published_arms import WAM_ROWS

import steelyard as sy
from steelyard.graph import Argument, Function, Graph, Kernel, Output, cos, sign, sin

Array = NDArray[np.float64]


@pytest.fixture(scope="session")
def wam_with_friction() -> sy.Model:
    return sy.Model(sy.Robot.from_dh(WAM_ROWS, name="WAM").with_terms(sy.Viscous(), sy.Coulomb()))


@pytest.fixture(scope="session")
def odd_function() -> Function:
    """Every operation, several outputs of several shapes, constants, and arguments that nothing reads."""
    graph = Graph()
    x, y, words = graph.inputs("x", 3), graph.inputs("y", 2), graph.inputs("lambda", 1)
    quotient = (x[0] - y[1]) / (2.0 + x[1] * x[1])
    total = sin(quotient) * cos(x[2]) - sign(y[0]) * words[0] + 1.0 / 3.0
    row = [total * (k - 1.5) + x[k % 3] for k in range(6)]
    cube = [row[k % 6] * y[k % 2] - float(k) for k in range(24)]
    return Function(
        "odd__",
        (Argument("x", 3), Argument("y", 2), Argument("empty", 0), Argument("lambda", 1, True), Argument("unused", 2)),
        (
            Output("number", (), (total,)),
            Output("same", (2,), (x[1], x[1])),
            Output("matrix", (2, 3), tuple(row)),
            Output("cube", (2, 3, 4), tuple(cube)),
            Output("constants", (3,), (graph.zero, graph.one, graph.constant(-2.5))),
        ),
        'Any text: """ \\ \n é.',
    )


def inputs_of(function: Function, random: np.random.Generator, samples: int = 3) -> dict[str, Array]:
    """Draw rows (samples, width) for each argument."""
    return {a.name: random.uniform(-2.0, 2.0, (samples, a.width)) for a in function.arguments}


def of_kernel(function: Function, values: dict[str, Array], sample: int) -> dict[str, Array]:
    """Compute one sample by machine code."""
    rows = [values[a.name][sample] if a.uniform else values[a.name][[sample]] for a in function.arguments]
    flat = Kernel(function)(*rows)[0]
    ends = np.cumsum([output.size for output in function.outputs])
    parts = np.split(flat, ends[:-1])
    return {o.name: part.reshape(o.shape) for o, part in zip(function.outputs, parts, strict=True)}


def complex_step(function: Function, values: dict[str, Array], by: str) -> dict[str, Array]:
    """Derivatives (*shape, width) by one argument, from the interpreter."""
    step = 1e-200
    width = len(values[by])
    shifted: dict[str, NDArray[np.complex128]] = {
        name: np.repeat(row[None].astype(complex), width, axis=0) for name, row in values.items()
    }
    shifted[by] = shifted[by] + 1j * step * np.eye(width)
    results = function.evaluate(shifted)
    return {name: np.moveaxis(np.imag(result), 0, -1) / step for name, result in results.items()}


def difference(found: Array, expected: Array) -> float:
    """The largest difference, relative to the largest value."""
    assert np.shape(found) == np.shape(expected)
    return float(np.max(np.abs(found - expected), initial=0.0) / max(np.max(np.abs(expected), initial=0.0), 1e-300))


def deep_chain(length: int) -> Function:
    """x -> c x + s with a new pair of operations for each element of the chain: 2 * length nodes in a row."""
    graph = Graph()
    x, s = graph.inputs("x", 2)
    for k in range(length):
        x = x * (1.0 / (1.0 + k % 3)) + s
    return Function("chain", (Argument("x", 2),), (Output("y", (), (x,)),))
