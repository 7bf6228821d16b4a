"""Calls the compiled functions of a model with whatever arrays a user has."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

from .functions import ModelFunctions

__all__ = ["Evaluator"]

Array = NDArray[np.float64]


class Evaluator:
    """Checks shapes, flattens batches for the kernels, and shapes what they return.

    Parameters
    ----------
    functions : ModelFunctions
    threads : int
        How many share a large batch.
    """

    def __init__(self, functions: ModelFunctions, threads: int = 1) -> None:
        if not isinstance(threads, int) or threads < 1:
            raise InputError(f"threads must be a positive integer, got {threads!r}.")
        self._threads = threads
        self._functions = functions
        self._robot = functions.robot
        self._parameter_count = len(functions.layout.names)

    def __call__(
        self,
        function: str,
        motion: Sequence[ArrayLike],
        parameters: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        point: ArrayLike | None = None,
    ) -> Array:
        """Return the outputs of a function of the catalogue side by side, (..., elements).

        Parameters
        ----------
        function : str
        motion : sequence of array_like
            (..., N) each.
        parameters, gravity, point : array_like, optional
            (n,), (3,) and (3,).

        Raises
        ------
        InputError
            If an array has the wrong shape.
        """
        arrays, shape = self._motion(motion)
        if parameters is not None:
            arrays.append(self._vector(parameters, self._parameter_count, "parameters"))
        if point is not None:
            arrays.append(self._vector(point, 3, "coordinates of a point"))
        if gravity is not None:
            arrays.append(self._vector(gravity, 3, "elements of gravity"))
        kernel = self._functions.kernel(function, gravity="fixed" if gravity is None else "argument")
        flat = kernel.sample(*arrays)[np.newaxis] if shape == () else kernel(*arrays, threads=self._threads)
        if kernel.compact:
            full = np.zeros((len(flat), kernel.signature.size))
            full[:, kernel.places] = flat
            flat = full
        return flat.reshape((*shape, flat.shape[-1]))

    def matrix(self, function: str, motion: Sequence[ArrayLike], parameters: ArrayLike) -> Array:
        """Return the only output of a function, an (..., N, N) matrix."""
        flat = self(function, motion, parameters)
        return flat.reshape((*flat.shape[:-1], self._robot.dof, self._robot.dof))

    def _motion(self, arrays: Sequence[ArrayLike]) -> tuple[list[Array], tuple[int, ...]]:
        converted = [np.asarray(a, dtype=np.float64) for a in arrays]
        n = self._robot.dof
        if all(array.shape == (n,) for array in converted):
            return converted, ()  # one sample
        for array in converted:
            if array.ndim == 0 or array.shape[-1] != n:
                raise InputError(
                    f"{self._robot.name} has {n} joints: expected arrays of shape (..., {n}), got {array.shape}."
                )
        shape = converted[0].shape
        if all(array.shape == shape for array in converted):  # the usual case, without the price of broadcasting
            return [array.reshape(-1, n) for array in converted], shape[:-1]
        try:
            shape = np.broadcast_shapes(*(a.shape for a in converted))
        except ValueError:
            raise InputError(f"Motion arrays do not fit each other: {[a.shape for a in converted]}.") from None
        return [np.broadcast_to(a, shape).reshape(-1, n) for a in converted], shape[:-1]

    def _vector(self, values: ArrayLike, size: int, what: str) -> Array:
        vector = np.asarray(values, dtype=np.float64)
        if vector.shape != (size,):
            raise InputError(f"{self._robot.name} has {size} {what}: expected shape ({size},), got {vector.shape}.")
        return vector
