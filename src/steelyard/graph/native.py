"""Calls of compiled functions for one sample, from Python without a detour.

A function of the Python C interface, itself compiled here, looks at the arrays where NumPy keeps their sizes and calls
the machine code. It takes a tenth of the time that the same checks take in Python. Where the interpreter is another
one, or lays out its objects in another way, there is no such function.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from .machine import host_machine

__all__ = ["native_caller"]

_MOST = 16  # arrays
_READABLE, _WRITABLE = 0x101, 0x501  # NumPy's flags: contiguous and aligned, and writeable
_FAST_CALL = 0x80  # METH_FASTCALL
_HEAD = object.__basicsize__

# Numbers of 64 bits in the description: how many arrays, where the machine code is, the addresses of NumPy's type and
# of its data type, and for each array its dimensions, its last length and its flags.
_SOURCE = """\
declare void @Py_IncRef(ptr)
define ptr @call_sample(ptr %self, ptr %given, i64 %count) #0 {{
entry:
  %table = alloca [{most} x ptr], align 8
  %d = getelementptr i8, ptr %self, i64 {content}
  %expected = load i64, ptr %d
  %code_at = getelementptr i64, ptr %d, i64 1
  %code = load ptr, ptr %code_at
  %type_at = getelementptr i64, ptr %d, i64 2
  %type = load ptr, ptr %type_at
  %double_at = getelementptr i64, ptr %d, i64 3
  %double = load ptr, ptr %double_at
  %none_at = getelementptr i64, ptr %d, i64 4
  %none = load ptr, ptr %none_at
  %complete = icmp eq i64 %expected, %count
  br i1 %complete, label %next, label %refuse
next:
  %k = phi i64 [ 0, %entry ], [ %following, %accept ]
  %a_at = getelementptr ptr, ptr %given, i64 %k
  %a = load ptr, ptr %a_at
  %own_type_at = getelementptr i8, ptr %a, i64 {type}
  %own_type = load ptr, ptr %own_type_at
  %is_array = icmp eq ptr %own_type, %type
  br i1 %is_array, label %array, label %refuse
array:
  %row = mul i64 %k, 3
  %row_at = getelementptr i64, ptr %d, i64 %row
  %want_dimensions_at = getelementptr i64, ptr %row_at, i64 5
  %want_dimensions = load i64, ptr %want_dimensions_at
  %want_length_at = getelementptr i64, ptr %row_at, i64 6
  %want_length = load i64, ptr %want_length_at
  %want_flags_at = getelementptr i64, ptr %row_at, i64 7
  %want_flags = load i64, ptr %want_flags_at
  %own_double_at = getelementptr i8, ptr %a, i64 {double}
  %own_double = load ptr, ptr %own_double_at
  %is_double = icmp eq ptr %own_double, %double
  %flags_at = getelementptr i8, ptr %a, i64 {flags}
  %flags = load i32, ptr %flags_at
  %flags_wide = zext i32 %flags to i64
  %has = and i64 %flags_wide, %want_flags
  %has_flags = icmp eq i64 %has, %want_flags
  %dimensions_at = getelementptr i8, ptr %a, i64 {dimensions}
  %dimensions = load i32, ptr %dimensions_at
  %dimensions_wide = sext i32 %dimensions to i64
  %has_dimensions = icmp eq i64 %dimensions_wide, %want_dimensions
  %fits_a = and i1 %is_double, %has_flags
  %fits_b = and i1 %fits_a, %has_dimensions
  br i1 %fits_b, label %lengths, label %refuse
lengths:
  %shape_at = getelementptr i8, ptr %a, i64 {shape}
  %shape = load ptr, ptr %shape_at
  %last = sub i64 %want_dimensions, 1
  %length_at = getelementptr i64, ptr %shape, i64 %last
  %length = load i64, ptr %length_at
  %has_length = icmp eq i64 %length, %want_length
  %first = load i64, ptr %shape
  %is_single = icmp eq i64 %first, 1
  %is_flat = icmp eq i64 %want_dimensions, 1
  %is_one = or i1 %is_single, %is_flat
  %fits_c = and i1 %has_length, %is_one
  br i1 %fits_c, label %accept, label %refuse
accept:
  %data_at = getelementptr i8, ptr %a, i64 {data}
  %data = load ptr, ptr %data_at
  %slot = getelementptr ptr, ptr %table, i64 %k
  store ptr %data, ptr %slot
  %following = add i64 %k, 1
  %more = icmp slt i64 %following, %count
  br i1 %more, label %next, label %run
run:
  call void %code(ptr %table)
  call void @Py_IncRef(ptr %a)
  ret ptr %a
refuse:
  call void @Py_IncRef(ptr %none)
  ret ptr %none
}}
attributes #0 = {{ nounwind }}
"""


class _Method(ctypes.Structure):
    """What the interpreter reads about a function: PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("description", ctypes.c_char_p),
    )


def native_caller(code: int, lengths: Sequence[int], dimensions: Sequence[int]) -> Callable[..., Any] | None:
    """Return a function ``(*arrays, out) -> out`` for one sample, or None where this interpreter does not allow it.

    It returns None, and does nothing, where an array is not a contiguous array of doubles of the given shape.

    Parameters
    ----------
    code : int
        Address of machine code that takes a table of the arrays' addresses, those of the arguments and that of the
        outputs; it must outlive the function.
    lengths : sequence of int
        Last length of each array.
    dimensions : sequence of int
        1, or 2 for arrays with one row.
    """
    address = _caller_address()
    if address is None or len(lengths) > _MOST:
        return None
    numbers = [len(lengths), code, id(np.ndarray), id(np.dtype(np.float64)), id(None)]
    for k, (length, dimension) in enumerate(zip(lengths, dimensions, strict=True)):
        numbers += [dimension, length, _WRITABLE if k == len(lengths) - 1 else _READABLE]
    description = np.array(numbers, dtype=np.uint64).tobytes()
    method = _METHODS.setdefault(address, _Method(b"sample", address, _FAST_CALL, None))
    create = ctypes.pythonapi.PyCFunction_NewEx
    create.argtypes, create.restype = (ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p), ctypes.py_object
    function: Callable[..., Any] = create(ctypes.addressof(method), description, None)
    return function


_METHODS: dict[int, _Method] = {}  # the interpreter keeps pointers to them


@cache
def _caller_address() -> int | None:
    if sys.implementation.name != "cpython" or not _objects_are_as_expected():
        return None
    source = _SOURCE.format(
        most=_MOST,
        content=bytes.__basicsize__ - 1,
        type=_HEAD - 8,
        data=_HEAD,
        dimensions=_HEAD + 8,
        shape=_HEAD + 16,
        double=_HEAD + 40,
        flags=_HEAD + 48,
    )
    count = ctypes.cast(ctypes.pythonapi.Py_IncRef, ctypes.c_void_p).value
    return host_machine(1).permanent(source, "call_sample", {"Py_IncRef": int(count or 0)})


def _objects_are_as_expected() -> bool:
    """Tell whether an array and a text of bytes have their fields where the machine code looks for them."""
    if ctypes.sizeof(ctypes.c_void_p) != 8 or sys.byteorder != "little" or np.ndarray.__basicsize__ < _HEAD + 56:
        return False
    array, text = np.zeros((3, 5)), b"steelyard"

    def number(offset: int) -> int:
        return ctypes.c_uint64.from_address(id(array) + offset).value

    shape = (ctypes.c_int64 * 2).from_address(number(_HEAD + 16)) if number(_HEAD + 16) else ()
    return (
        number(_HEAD - 8) == id(np.ndarray)
        and number(_HEAD) == array.ctypes.data
        and number(_HEAD + 8) & 0xFFFFFFFF == 2
        and tuple(shape) == (3, 5)
        and number(_HEAD + 40) == id(np.dtype(np.float64))
        and number(_HEAD + 48) & _WRITABLE == _WRITABLE
        and ctypes.string_at(id(text) + bytes.__basicsize__ - 1, len(text)) == text
    )
