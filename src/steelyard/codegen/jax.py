"""JAX: graph functions as functions of JAX, and source projects in Python that compile, map and differentiate.

XLA compiles very many scalar operations slowly, so that a large function becomes a few operations on vectors.
"""

from __future__ import annotations

import inspect
import keyword
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError, require_package
from steelyard.graph import Function, Node, evaluate_over
from steelyard.graph.expression import reachable

from .assignments import CALLS
from .naming import NamedFunction
from .python_project import EVALUATED_ON_ARRAYS, PythonProject, shape_literal
from .text import Names, number_lines, wrapped_lines

if TYPE_CHECKING:
    from .project import Project

__all__ = ["Schedule", "Step", "jax_function", "prefers_vectors", "repeated_operations", "schedule", "write"]


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
    jax = require_package("jax", "JAX functions need the package", "jax")
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

    return {
        "sin": jnp.sin,
        "cos": jnp.cos,
        "sign": lambda x: jnp.sign(jnp.real(x)),
        "sqrt": jnp.sqrt,
        "exp": jnp.exp,
        "log": jnp.log,
    }


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


_HEAD = '''{collections}import jax
import jax.numpy as jnp
{numpy}from jax.typing import ArrayLike


def _columns(name: str, values: ArrayLike, size: int) -> jax.Array:
    """Return an argument with its last axis first."""
    array = jnp.asarray(values)
    if jnp.iscomplexobj(array):
        raise ValueError(f"{{name}} must be real, got {{array.dtype}}")
    if array.ndim == 0 or array.shape[-1] != size:
        raise ValueError(f"{{name}} must have shape (..., {{size}}), got {{array.shape}}")
    return jnp.moveaxis(array.astype(jnp.float64), -1, 0)


def _stacked(elements: list[ArrayLike], leading: tuple[int, ...], shape: tuple[int, ...]) -> jax.Array:
    """Return the elements of an output, in row-major order, as an array of its shape."""
    columns = [jnp.broadcast_to(jnp.asarray(element, dtype=jnp.float64), leading) for element in elements]
    return jnp.stack(columns, axis=-1).reshape((*leading, *shape))


def _require_double_precision() -> None:
    if jnp.result_type(float) != jnp.float64:
        raise RuntimeError(
            "these functions compute in double precision, which JAX has switched off; "
            'call jax.config.update("jax_enable_x64", True) when the program starts'
        )
'''

_VECTORS = '''

_OPERATIONS: dict[str, Callable[..., jax.Array]] = {
    "add": jnp.add,
    "mul": jnp.multiply,
    "div": jnp.divide,
    "neg": jnp.negative,
    "sin": jnp.sin,
    "cos": jnp.cos,
    "sign": jnp.sign,
    "sqrt": jnp.sqrt,
    "exp": jnp.exp,
    "log": jnp.log,
}


def _computed(
    arguments: list[jax.Array],
    leading: tuple[int, ...],
    constants: tuple[float, ...],
    steps: tuple[tuple[str, tuple[int, ...], tuple[int, ...], tuple[int, ...]], ...],
) -> jax.Array:
    """Return all the values of a function in one array: arguments, constants, and the results of the steps.

    A step is an operation, the places of its first and second operands, and the signs of the second operands where
    some are subtracted. Its operations do not need each other, so that they are one operation on vectors.
    """
    count = 1
    for length in leading:
        count *= length
    # The first axis is an argument's elements; batches are aligned at their last axes.
    spread = [jnp.broadcast_to(jnp.moveaxis(a, 0, -1), (*leading, len(a))) for a in arguments]
    rows = [jnp.moveaxis(a, -1, 0).reshape((a.shape[-1], count)) for a in spread]
    rows.append(jnp.broadcast_to(np.array(constants, dtype=np.float64)[:, None], (len(constants), count)))
    start = sum(map(len, rows))
    size = start + sum(len(first) for _, first, _, _ in steps)
    values = jnp.concatenate([*rows, jnp.zeros((size - start, count))])
    for operation, first, second, signs in steps:
        operands = [values[np.array(places)] for places in (first, second) if places]
        if signs:
            operands[1] = operands[1] * np.array(signs, dtype=np.float64)[:, None]
        result = _OPERATIONS[operation](*operands)
        values = jax.lax.dynamic_update_slice(values, result, (start, 0))
        start += len(first)
    return values


def _selected(values: jax.Array, places: list[int], leading: tuple[int, ...], shape: tuple[int, ...]) -> jax.Array:
    """Return an output whose elements stand at some places."""
    return values[np.array(places)].T.reshape((*leading, *shape))
'''

_RESERVED = """
jax jnp np ArrayLike Callable _columns _stacked _require_double_precision _OPERATIONS _computed _selected
"""


class _JaxProject(PythonProject):
    title = "Python for JAX"
    requirements = ("jax>=0.4.30",)
    python = "3.10"
    reserved = frozenset(_RESERVED.split())
    calls: ClassVar[dict[str, str]] = {name: f"jnp.{name}({{}})" for name in CALLS}

    def __init__(self, project: Project) -> None:
        super().__init__(project)
        self.vectors = [prefers_vectors(function) for function in project.functions]

    def introduction(self) -> list[str]:
        return [
            "Every function takes arrays (..., width) with any leading axes, which broadcast, and is compiled by JAX "
            "at its first call. jax.vmap, jax.grad, jax.jacfwd and jax.jacrev apply; the derivative of a sign is 0. "
            'Without double precision, jax.config.update("jax_enable_x64", True), a function raises RuntimeError; an '
            "argument of another width raises ValueError.",
        ]

    def head(self) -> list[str]:
        some = any(self.vectors)
        extra = {"collections": "from collections.abc import Callable\n\n", "numpy": "import numpy as np\n"}
        head = _HEAD.format(**(extra if some else dict.fromkeys(extra, "")))
        return (head + (_VECTORS + "\n" if some else "")).splitlines()

    def definition(self, index: int, named: NamedFunction) -> list[str]:
        names = named.names
        results = named.output_names
        kind = f"tuple[{', '.join(['jax.Array'] * len(results))}]" if len(results) > 1 else "jax.Array"
        lines = ["@jax.jit", *self.signature(named, "ArrayLike", kind), *self.documentation(named, "jax.Array")]
        lines.append("    _require_double_precision()")
        leading = named.scope.inner().take("leading")
        lines += self.columns(named, f"{leading} = jnp")
        end = f"    return {', '.join(results)}"
        if self.vectors[index]:
            plan = schedule(named.function)
            return [*_tables(index, plan), *lines, *self._vectors(index, named, leading, plan), end]
        found = self.listing(named)
        lines += [f"    {a.name} = {a.expression}" for a in found.assignments]
        for output, elements in zip(named.function.outputs, found.outputs, strict=True):
            name = names[output.name]
            lines += [f"    {name} = _stacked(", "        ["]
            lines += [f"            {text}," for text in elements.elements]
            lines += ["        ],", f"        {leading},", f"        {shape_literal(output)},", "    )"]
        return [*lines, end]

    @staticmethod
    def _vectors(index: int, named: NamedFunction, leading: str, plan: Schedule) -> list[str]:
        function, names = named.function, named.names
        arguments = ", ".join(named.argument_names)
        values = named.scope.inner().take("values")
        lines = [f"    {values} = _computed([{arguments}], {leading}, _CONSTANTS_{index + 1}, _STEPS_{index + 1})"]
        for output, places in zip(function.outputs, plan.outputs, strict=True):
            name = names[output.name]
            lines += [f"    {name} = _selected(", f"        {values},", "        ["]
            lines += _integers(places.tolist())
            lines += ["        ],", f"        {leading},", f"        {shape_literal(output)},", "    )"]
        return lines

    def comparison(self) -> list[str]:
        return [
            "import jax",
            "import numpy as np",
            "",
            'jax.config.update("jax_enable_x64", True)  # the reference values are of double precision',
            "",
            f"import {self.name} as module  # noqa: E402",
            "",
            "",
            *EVALUATED_ON_ARRAYS,
        ]

    def use(self) -> list[str]:
        named = self.functions[0]
        outputs = ", ".join(named.output_names)
        arguments = ", ".join(named.argument_names)
        return [
            "```python",
            "import jax",
            "",
            'jax.config.update("jax_enable_x64", True)  # double precision, which JAX switches off by default',
            f"import {self.name}",
            "",
            f"{outputs} = {self.name}.{named.name}({arguments})",
            f"slopes = jax.jacfwd({self.name}.{named.name})({arguments})",
            "```",
            "",
            "Arguments are arrays of shape (..., width) for one sample or many; leading axes broadcast. Functions are",
            "compiled at their first call, and work inside others that are; `vmap`, `grad`, `jacfwd` and `jacrev`",
            "apply. The derivative of a sign is 0. Functions with many operations are tables of vector operations,",
            "which XLA compiles much sooner than thousands of single ones. XLA takes numbers below 2.2e-308 for 0.",
        ]


write = _JaxProject.write


def _tables(index: int, plan: Schedule) -> list[str]:
    """Return the constants and steps of a schedule as tuples."""
    lines = [f"_CONSTANTS_{index + 1} = (", *_ended(number_lines(plan.constants, "    ")), ")"]
    lines.append(f"_STEPS_{index + 1} = (")
    for step in plan.steps:
        lines += ["    (", f'        "{step.operation}",']
        for values in (step.first, step.second, step.signs):
            inner = _integers([] if values is None else values.tolist())
            if len(inner) > 1:
                lines += ["        (", *inner, "        ),"]
            else:
                lines.append(f"        ({inner[0].strip() if inner else ''}),")
        lines.append("    ),")
    return [*lines, ")", "", ""]


def _integers(values: Sequence[float]) -> list[str]:
    return _ended(wrapped_lines([", ".join(str(int(value)) for value in values)], " " * 12)) if values else []


def _ended(lines: list[str]) -> list[str]:
    """Return the lines of a tuple with a comma at the end, also where it has one element."""
    return [*lines[:-1], f"{lines[-1]},"] if lines else []


# XLA repeats operations that several outputs share. From so many repeated operations on, operations on vectors compile
# and differentiate in less time.
_MOST_REPEATED = 5_000

Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Step:
    """One operation on elements of a vector of values, whose results are appended side by side.

    Attributes
    ----------
    operation : str
        ``"add"``, ``"mul"``, ``"div"``, ``"neg"``, ``"sin"``, ``"cos"``, ``"sign"``, ``"sqrt"``, ``"exp"`` or
        ``"log"``.
    first : ndarray
        (k,) places of the first operands.
    second : ndarray or None
        (k,) places of the second operands, of additions, multiplications and divisions.
    signs : ndarray or None
        (k,) factors 1 and -1 of the second operands of additions, where some are subtractions.
    start : int
        Place of the first result.
    """

    operation: str
    first: Indices
    second: Indices | None
    signs: NDArray[np.float64] | None
    start: int


@dataclass(frozen=True, eq=False)
class Schedule:
    """A function as steps on one vector: first the arguments' elements, then the constants, then the results.

    Attributes
    ----------
    constants : ndarray
        (c,).
    size : int
        Length of the vector.
    outputs : tuple of ndarray
        For each output the places of its elements.
    """

    constants: NDArray[np.float64]
    steps: tuple[Step, ...]
    size: int
    outputs: tuple[Indices, ...]


def schedule(function: Function) -> Schedule:
    """Group the operations of a function that do not need each other and are of one kind.

    Each step takes all the operations of one kind whose operands are known. The kind is that of the operation with the
    longest chain of operations that depend on it. The work is linear in the number of operations, except for the search
    of that operation among those that are ready.

    Examples
    --------
    >>> from steelyard.graph import Argument, Graph, Output, sin
    >>> a, b, c, d = Graph().inputs("x", 4)
    >>> f = Function("f", (Argument("x", 4),), (Output("y", (), ((a * b + c * d) * (a - d),)),))
    >>> for step in schedule(f).steps:
    ...     print(step.operation, step.first, step.second)
    mul [0 2] [1 3]
    add [0 4] [3 5]
    mul [7] [6]
    """
    inputs = [f"{a.name}[{k}]" for a in function.arguments for k in range(a.width)]
    places = {name: place for place, name in enumerate(inputs)}
    nodes = reachable(function.nodes)
    constants = [node for node in nodes if node.operation == "constant"]
    where = {node.index: len(places) + k for k, node in enumerate(constants)}
    where |= {node.index: places[str(node.value)] for node in nodes if node.operation == "input"}
    size = len(places) + len(constants)
    waiting = {node.index: len(node.arguments) for node in nodes}
    users: dict[int, list[Node]] = {node.index: [] for node in nodes}
    for node in nodes:
        for argument in node.arguments:
            users[argument.index].append(node)
    behind: dict[int, int] = {}
    for node in reversed(nodes):
        behind[node.index] = 1 + max((behind[user.index] for user in users[node.index]), default=0)
    ready: dict[str, list[Node]] = {}

    def finish(done: list[Node]) -> None:
        for node in done:
            for user in users[node.index]:
                waiting[user.index] -= 1
                if not waiting[user.index]:
                    ready.setdefault("add" if user.operation == "sub" else user.operation, []).append(user)

    finish([node for node in nodes if not node.arguments])
    steps = []
    while ready:
        kind = max(ready, key=lambda kind: (max(behind[node.index] for node in ready[kind]), kind))
        members = ready.pop(kind)
        steps.append(_step(kind, members, where, size))
        where |= {node.index: size + k for k, node in enumerate(members)}
        size += len(members)
        finish(members)
    outputs = tuple(np.array([where[n.index] for n in o.nodes], dtype=np.intp) for o in function.outputs)
    return Schedule(np.array([float(node.value) for node in constants]), tuple(steps), size, outputs)


def _step(kind: str, members: list[Node], where: Mapping[int, int], start: int) -> Step:
    first = np.array([where[node.arguments[0].index] for node in members], dtype=np.intp)
    second, signs = None, None
    if len(members[0].arguments) == 2:
        second = np.array([where[node.arguments[1].index] for node in members], dtype=np.intp)
    if any(node.operation == "sub" for node in members):
        signs = np.array([-1.0 if node.operation == "sub" else 1.0 for node in members])
    return Step(kind, first, second, signs, start)


def repeated_operations(function: Function) -> int:
    """Return how many operations there are where each element of the outputs is computed by itself.

    A compiler has this much to do when it fuses scalar operations into one loop for each element.

    Examples
    --------
    >>> from steelyard.graph import Argument, Graph, Output, sin
    >>> x = Graph().inputs("x", 2)
    >>> y = sin(x[0])
    >>> repeated_operations(Function("f", (Argument("x", 2),), (Output("y", (2,), (y * x[1], y + x[1])),)))
    4
    """
    users: dict[int, int] = {}  # for each node a bit for every element that needs it
    for bit, node in enumerate({node.index: node for node in function.nodes}.values()):
        users[node.index] = 1 << bit
    count = 0
    for node in reversed(reachable(function.nodes)):
        mask = users.pop(node.index)
        if node.arguments:
            count += mask.bit_count()
        for argument in node.arguments:
            users[argument.index] = users.get(argument.index, 0) | mask
    return count


def prefers_vectors(function: Function) -> bool:
    """Tell whether XLA compiles a function sooner from a :func:`schedule` than from single numbers."""
    if sum(function.operation_count.values()) > _MOST_REPEATED:
        return True
    return repeated_operations(function) > _MOST_REPEATED
