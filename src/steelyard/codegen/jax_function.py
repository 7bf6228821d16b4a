"""Graph functions as functions of JAX."""

from __future__ import annotations

import inspect
import keyword
import math
from collections.abc import Callable, Sequence
from typing import Any

from steelyard.errors import InputError, MissingExtraError
from steelyard.graph import Function

from .evaluation import evaluate_over
from .schedule import prefers_vectors, schedule
from .text import Names

__all__ = ["jax_function"]


def jax_function(function: Function, *, lowering: str = "automatic") -> Callable[..., Any]:
    """Return a function for JAX, which compiles, maps and differentiates it.

    It works under ``jax.jit``, ``jax.vmap``, ``jax.grad``, ``jax.jacfwd`` and ``jax.jacrev``; outside of these it
    compiles itself. Derivatives of a sign are 0.

    Parameters
    ----------
    function : Function
    lowering : {"automatic", "scalars", "vectors"}
        How the graph is handed to XLA. ``"scalars"``, one operation for each node, runs fastest, but where several
        outputs share many operations it takes minutes to compile. ``"vectors"`` gathers operations of one kind that
        do not need each other, and takes seconds. ``"automatic"`` takes the one that compiles sooner.

    Returns
    -------
    callable
        It takes an array (..., width) for each argument, by position or by name (a keyword of Python gets an underscore
        behind it); leading axes broadcast. It returns
        an array (..., \\*shape) where the function has one output, otherwise a dictionary of these by the name of
        the output.

        All numbers are of double precision, which JAX switches off by default; without
        ``jax.config.update("jax_enable_x64", True)`` a call raises :class:`~steelyard.errors.InputError`.

    Raises
    ------
    InputError
        If the lowering is unknown.
    MissingExtraError
        If JAX is not installed.

    Examples
    --------
    >>> import jax
    >>> from steelyard.graph import Argument, Graph, Output, sin
    >>> x = Graph().inputs("x", 2)
    >>> f = jax_function(Function("f", (Argument("x", 2),), (Output("y", (), (sin(x[0]) + x[0] * x[1],)),)))
    >>> jax.config.update("jax_enable_x64", True)
    >>> print(f([0.0, 3.0]), jax.grad(f)(jax.numpy.array([0.0, 3.0])))
    0.0 [4. 0.]
    """
    try:
        import jax
    except ImportError as error:
        raise MissingExtraError(
            "JAX functions need the package jax, which is not installed; pip install 'steelyard[jax]'."
        ) from error
    if lowering not in ("automatic", "scalars", "vectors"):
        raise InputError(f"lowering must be 'automatic', 'scalars' or 'vectors', got {lowering!r}.")
    vectors = prefers_vectors(function) if lowering == "automatic" else lowering == "vectors"
    compiled = jax.jit(_vectors(function) if vectors else _scalars(function))
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    scope = Names(keyword.kwlist)
    signature = inspect.Signature([inspect.Parameter(scope.take(a.name), kind) for a in function.arguments])

    def call(*arrays: Any, **named: Any) -> Any:
        results = compiled(*_checked(function, signature.bind(*arrays, **named).args))
        return results[0] if len(results) == 1 else dict(zip(names, results, strict=True))

    names = [output.name for output in function.outputs]
    call.__name__ = call.__qualname__ = function.name
    call.__doc__ = function.description
    call.__signature__ = signature  # type: ignore[attr-defined]
    return call


def _checked(function: Function, given: Sequence[Any]) -> list[Any]:
    import jax.numpy as jnp

    if jnp.result_type(float) != jnp.float64:
        raise InputError(
            f"{function.name} computes in double precision, which JAX has switched off; call "
            'jax.config.update("jax_enable_x64", True) when the program starts.'
        )
    arrays = []
    for argument, value in zip(function.arguments, given, strict=True):
        array = jnp.asarray(value)
        if array.ndim == 0 or array.shape[-1] != argument.width:
            raise InputError(f"{argument.name} must have shape (..., {argument.width}), got {array.shape}.")
        wide = jnp.complex128 if jnp.iscomplexobj(array) else jnp.float64
        arrays.append(array.astype(wide))
    return arrays


def _leading(arrays: Sequence[Any]) -> tuple[int, ...]:
    import jax.numpy as jnp

    return jnp.broadcast_shapes(*(array.shape[:-1] for array in arrays)) if arrays else ()


def _unary() -> dict[str, Callable[[Any], Any]]:
    import jax.numpy as jnp

    return {"sin": jnp.sin, "cos": jnp.cos, "sign": lambda x: jnp.sign(jnp.real(x)), "sqrt": jnp.sqrt}


def _scalars(function: Function) -> Callable[..., list[Any]]:
    import jax.numpy as jnp

    def evaluate(*arrays: Any) -> list[Any]:
        lead = _leading(arrays)
        elements = {
            argument.name: [array[..., k] for k in range(argument.width)]
            for argument, array in zip(function.arguments, arrays, strict=True)
        }
        results = []
        for output, values in zip(function.outputs, evaluate_over(function, elements, _unary()), strict=True):
            kind = jnp.result_type(jnp.float64, *values)
            columns = [jnp.broadcast_to(jnp.asarray(value, dtype=kind), lead) for value in values]
            flat = jnp.stack(columns, axis=-1) if columns else jnp.zeros((*lead, 0))
            results.append(flat.reshape(lead + output.shape))
        return results

    return evaluate


def _vectors(function: Function) -> Callable[..., list[Any]]:
    import jax.numpy as jnp
    from jax import lax

    plan = schedule(function)
    operations: dict[str, Callable[..., Any]] = {
        **_unary(),
        "neg": jnp.negative,
        "add": jnp.add,
        "mul": jnp.multiply,
        "div": jnp.divide,
    }

    def evaluate(*arrays: Any) -> list[Any]:
        lead = _leading(arrays)
        kind = jnp.result_type(jnp.float64, *arrays)
        # One row for each value, so that the operands of a step are whole rows, also in a batch.
        count = math.prod(lead)
        rows = [jnp.broadcast_to(a, (*lead, a.shape[-1])).reshape(count, a.shape[-1]).T for a in arrays]
        rows.append(jnp.broadcast_to(plan.constants[:, None], (len(plan.constants), count)))
        known = sum(len(part) for part in rows)
        values = jnp.concatenate([*rows, jnp.zeros((plan.size - known, count))], dtype=kind)
        for step in plan.steps:
            operands = [values[step.first]]
            if step.second is not None:
                second = values[step.second]
                operands.append(second if step.signs is None else second * step.signs[:, None])
            result = operations[step.operation](*operands)
            values = lax.dynamic_update_slice(values, result.astype(kind), (step.start, 0))
        return [
            values[places].T.reshape(lead + output.shape)
            for output, places in zip(function.outputs, plan.outputs, strict=True)
        ]

    return evaluate
