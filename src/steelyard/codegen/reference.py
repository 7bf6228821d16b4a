"""Reference values of a generated self-test: inputs, the values that the graph gives for them, and tolerances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.graph import Function
from steelyard.graph.expression import reachable

__all__ = ["TOLERANCE", "Reference", "reference_of"]

TOLERANCE = 1e-12  # of the largest value of an output
_MOST_NUMBERS = 20_000  # reference outputs of a function, which take half a megabyte of the self-test
_EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class Reference:
    """Inputs and expected outputs of one function.

    Attributes
    ----------
    inputs : tuple of ndarray
        For each argument (S, width).
    outputs : tuple of ndarray
        For each output (S, size), elements in row-major order.
    tolerances : tuple of float
        For each output the largest allowed difference: 1e-12 of its largest value, or what rounding alone may
        amount to where the value is a small difference of large numbers.
    """

    inputs: tuple[NDArray[np.float64], ...]
    outputs: tuple[NDArray[np.float64], ...]
    tolerances: tuple[float, ...]

    @property
    def samples(self) -> int:
        """Number S of rows."""
        return len(self.outputs[0])


def reference_of(function: Function, values: Mapping[str, NDArray[np.float64]]) -> Reference:
    """Evaluate a function at reference inputs.

    Parameters
    ----------
    values : mapping
        For each argument rows (S, width); S is the same for all. Only the first rows are used where the function
        has very many outputs.

    Raises
    ------
    InputError
        Where an argument is missing or has the wrong shape, or where an output is not finite.
    """
    rows: dict[str, NDArray[np.float64]] = {}
    for argument in function.arguments:
        if argument.name not in values:
            raise InputError(
                f"the self-test of {function.name!r} needs reference values of {argument.name!r}; add them."
            )
        array = np.asarray(values[argument.name], dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != argument.width or len(array) == 0:
            raise InputError(
                f"the reference values of {argument.name!r} must have shape (S, {argument.width}) with S > 0 "
                f"for {function.name!r}, got {array.shape}."
            )
        rows[argument.name] = array
    counts = {len(array) for array in rows.values()} or {1}
    if len(counts) > 1:
        raise InputError(
            f"the reference values of the arguments of {function.name!r} must have equally many rows, got "
            f"{', '.join(f'{len(array)} of {name}' for name, array in rows.items())}."
        )
    size = max(len(function.nodes), 1)
    samples = max(1, min(min(counts), _MOST_NUMBERS // size))
    rows = {name: array[:samples] for name, array in rows.items()}
    with np.errstate(all="ignore"):
        results = function.evaluate(rows)
        bounds = _rounding_bounds(function, rows)
    outputs, tolerances = [], []
    for output in function.outputs:
        array = np.broadcast_to(results[output.name], (samples, *output.shape)).reshape(samples, output.size)
        if not np.isfinite(array).all():
            raise InputError(
                f"the output {output.name!r} of {function.name!r} is not finite at the reference values; choose others."
            )
        largest = float(np.abs(array).max(initial=0.0))
        outputs.append(array)
        tolerances.append(max(TOLERANCE * largest, float(bounds[output.name].max(initial=0.0)), 1e-300))
    return Reference(tuple(rows[a.name] for a in function.arguments), tuple(outputs), tuple(tolerances))


def _rounding_bounds(function: Function, rows: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    """Bound how far two correct programs may differ, to first order, for each element of each output.

    Each operation adds at most one rounding of its own result (two units for sine and cosine, which libraries round
    differently) to what its operands bring; two programs differ by at most twice that.
    """
    values: dict[int, NDArray[np.float64]] = {}
    errors: dict[int, NDArray[np.float64]] = {}
    nothing = np.zeros(())
    inputs = {f"{name}[{k}]": array[:, k] for name, array in rows.items() for k in range(array.shape[1])}
    for node in reachable(function.nodes):
        kind = node.operation
        if kind in ("constant", "input"):
            value = np.asarray(node.value if kind == "constant" else inputs[str(node.value)], dtype=np.float64)
            values[node.index], errors[node.index] = value, nothing
            continue
        a = values[node.arguments[0].index]
        error = errors[node.arguments[0].index]
        rounding = _EPSILON
        if kind == "neg":
            value, rounding = -a, 0.0
        elif kind == "sign":
            value, error, rounding = np.sign(a), nothing, 0.0
        elif kind == "sqrt":
            value = np.sqrt(a)
            error, rounding = error / (2.0 * value), 2.0 * _EPSILON
        elif kind == "exp":
            value = np.exp(a)
            error, rounding = error * value, 2.0 * _EPSILON
        elif kind == "log":
            value = np.log(a)
            error, rounding = error / a, 2.0 * _EPSILON
        elif kind in ("sin", "cos"):
            value, error, rounding = (np.sin(a) if kind == "sin" else np.cos(a)), error, 2.0 * _EPSILON
        else:
            b, other = values[node.arguments[1].index], errors[node.arguments[1].index]
            if kind == "mul":
                value, error = a * b, np.abs(a) * other + np.abs(b) * error
            elif kind == "div":
                value = a / b
                error = (error + np.abs(value) * other) / np.abs(b)
            else:
                value, error = (a + b if kind == "add" else a - b), error + other
        values[node.index] = value
        errors[node.index] = error + rounding * np.abs(value)
    samples = max((len(array) for array in rows.values()), default=1)
    return {
        output.name: np.array([2.0 * np.broadcast_to(errors[node.index], (samples,)) for node in output.nodes])
        for output in function.outputs
    }
