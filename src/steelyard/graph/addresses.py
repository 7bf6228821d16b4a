"""Where the arrays that a kernel reads stand in memory, after they were checked."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

from .function import Argument

__all__ = ["DOUBLE", "Desk", "address_of", "addresses_of"]

Array = NDArray[np.float64]

DOUBLE = np.dtype(np.float64)


class Desk:
    """Memory for one sample at places that do not change, so that a call need not look for them.

    Parameters
    ----------
    arguments : tuple of Argument
    width : int
        Number of outputs.

    Attributes
    ----------
    places : tuple of ndarray
        One for each argument.
    out : ndarray
        (width,).
    given : tuple
        What a compiled function takes: one sample, the places, the outputs, and a stride of one.
    """

    def __init__(self, arguments: tuple[Argument, ...], width: int) -> None:
        self.places = tuple(np.empty(a.width) for a in arguments)
        self.out = np.empty(width)
        pointers = [ctypes.c_void_p(address_of(array)) for array in (*self.places, self.out)]
        self.given = (ctypes.c_int64(1), *pointers, ctypes.c_int64(1))


def address_of(array: Array) -> int:
    """Return where the first number of a contiguous array stands."""
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(array))  # type: ignore[arg-type]
    except (TypeError, ValueError, BufferError):  # an array that may not be written, or an empty one
        return int(array.ctypes.data)


def addresses_of(arguments: tuple[Argument, ...], arrays: tuple[Array, ...]) -> tuple[list[int], int, list[Array]]:
    """Return the addresses of the arrays, the number of samples, and arrays that must live until they are used."""
    if len(arrays) != len(arguments):
        names = ", ".join(a.name for a in arguments)
        raise InputError(f"the kernel reads {len(arguments)} arrays ({names}), got {len(arrays)}.")
    addresses, kept, count = [], [], None
    for argument, array in zip(arguments, arrays, strict=True):
        if type(array) is not np.ndarray or array.dtype is not DOUBLE or not array.flags.carray:
            array = np.require(array, np.float64, ["C", "A"])
            kept.append(array)
        shape = array.shape
        if shape != (argument.width,) if argument.uniform else len(shape) != 2 or shape[1] != argument.width:
            form = f"({argument.width},)" if argument.uniform else f"(S, {argument.width})"
            raise InputError(f"{argument.name} must have shape {form}, got {shape}.")
        if not argument.uniform:
            if count is None:
                count = shape[0]
            elif shape[0] != count:
                raise InputError(
                    f"{argument.name} must have as many rows as the arrays before it, {count}, got {shape[0]}."
                )
        addresses.append(address_of(array))
    return addresses, 1 if count is None else count, kept
