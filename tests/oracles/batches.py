"""Batches for functions whose leading axes broadcast, and what they must give: each sample computed alone."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

import steelyard as sy
from steelyard.graph import Argument, Function

Array = NDArray[np.float64]
Shapes = tuple[tuple[int, ...], ...]


def small_model() -> sy.Model:
    """Two joints with terms: arguments are 2, 3 or 26 wide, and so are batches."""
    robot = sy.Robot.from_dh([("pi/2", 0.1, 0.2, "q"), (0.3, 0.1, "q", 0.2)], name="small")
    return sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.RotorInertia()))


def leading_shapes(arguments: Sequence[Argument]) -> Iterator[Shapes]:
    """Yield leading shapes of arguments: every one against every other, as long as any of them is wide."""
    count = len(arguments)
    widths = sorted({argument.width for argument in arguments})
    yield ((),) * count
    yield tuple((widths[k % len(widths)], *(1,) * (count - 1 - k)) for k in range(count))  # an axis for each
    yield from (single_beside(count, k, (argument.width,)) for k, argument in enumerate(arguments))
    for k, argument in enumerate(arguments):
        yield from (single_beside(count, k, (size,)) for size in widths if size != argument.width)
        yield from (tuple((size,) if j == k else () for j in range(count)) for size in widths)
        yield tuple((3, argument.width) if j == k else (argument.width,) for j in range(count))


def single_beside(count: int, single: int, shape: tuple[int, ...]) -> Shapes:
    """Return shapes of one single argument and others that are batches."""
    return tuple(() if k == single else shape for k in range(count))


def drawn(arguments: Sequence[Argument], shapes: Shapes, random: np.random.Generator) -> list[Array]:
    """Return arrays of these leading shapes."""
    return [random.uniform(-1.0, 1.0, (*shape, a.width)) for a, shape in zip(arguments, shapes, strict=True)]


def one_by_one(function: Function, arrays: Sequence[Array]) -> list[Array]:
    """Return the outputs (..., *shape) of samples that the function's graph computes as rows of their own."""
    leading = np.broadcast_shapes(*(array.shape[:-1] for array in arrays))
    values = {
        argument.name: np.array([array_of(array, place) for place in np.ndindex(*leading)])
        for argument, array in zip(function.arguments, arrays, strict=True)
    }
    return [
        result.reshape((*leading, *output.shape))
        for result, output in zip(function.evaluate(values).values(), function.outputs, strict=True)
    ]


def array_of(array: Array, place: tuple[int, ...]) -> Array:
    """Return the elements of one sample: axes align at the last, and one of length 1 counts for all."""
    axes = array.ndim - 1
    near = place[len(place) - axes :]
    return array[tuple(k if length > 1 else 0 for k, length in zip(near, array.shape[:-1], strict=True))]
