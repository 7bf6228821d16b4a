"""Reading arrays in NumPy's format from streams that anybody may have made.

It is a file of its own because certificates are read and verified without NumPy.
"""

from __future__ import annotations

import math
from typing import IO, Any

import numpy as np

from .meanwhile import without_warnings

__all__ = ["read_array", "read_array_header"]


def read_array_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Read the header of an array: its shape, whether its columns come first, and its type.

    The stream then stands at the first byte of the data.

    Raises
    ------
    ValueError
        For anything that is no header.
    """
    try:
        with without_warnings:  # about headers of Python 2
            version = np.lib.format.read_magic(stream)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, column_major, kind = read(stream)
    except OSError:
        raise
    except Exception as error:  # the header is parsed as a Python expression, with all that can happen there
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        raise ValueError(f"the header of an array cannot be read, {reason}") from None
    if any(isinstance(size, bool) or size < 0 for size in shape):
        raise ValueError(f"an array has the shape {shape}")
    return shape, column_major, kind


def read_array(stream: IO[bytes], size: int) -> np.ndarray[Any, Any]:
    """Read an array of numbers from a stream of `size` bytes.

    Raises
    ------
    ValueError
        For anything that is no array of numbers, or is shorter than its header claims.
    """
    shape, column_major, kind = read_array_header(stream)
    count = math.prod(shape)
    if kind.kind not in "fiub" or count * kind.itemsize > size:
        raise ValueError(f"{count} values of type {kind} do not fit into {size} bytes")
    data = stream.read(count * kind.itemsize)
    if len(data) < count * kind.itemsize:
        raise ValueError("the array ends before its last value")
    return np.frombuffer(data, dtype=kind).reshape(shape, order="F" if column_major else "C")
