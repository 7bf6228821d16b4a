"""Calls of compiled functions from Python for a few samples, where the call itself takes longer than the computation.

Through ctypes a call for one sample takes 3 to 5 µs, nearly all of which is Python that looks at arrays. Here LLVM
compiles what looks at them: a function with CPython's own calling convention (``METH_FASTCALL``) that reads the arrays
where NumPy keeps them, as every extension does that is compiled against NumPy. It can stand in the place of a method,
which it then calls for whatever it does not do itself: a method of Python around it would take another 0.2 µs.
"""

from __future__ import annotations

import ctypes
import inspect
import sys
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from .function import Argument
from .machine import LoadedCode, batch_lanes, host_machine

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["direct_call"]

DirectCall = Callable[..., Any]

_MOST_ARGUMENTS = 8
_MOST_SHAPE = 4
_MOST_LEADING = 4
_FASTCALL_KEYWORDS = 0x0080 | 0x0002
# Where the words of an array stand after the head of the object: data, nd, dimensions, strides, base, descr, flags, and
# the list of weak references.
_DATA, _ND, _DIMENSIONS, _DESCR, _FLAGS, _WEAK = 0, 8, 16, 40, 48, 56
_C_CONTIGUOUS, _ALIGNED, _WRITEABLE = 0x0001, 0x0100, 0x0400
_DOUBLE = np.dtype(np.float64)
# Where NumPy keeps the version of its binary interface, its type of arrays and the function that makes one: the same
# places in all of its releases, or extensions that were compiled against one would not run with the next.
_VERSION_OF_NUMPY, _TYPE_OF_ARRAYS, _NEW_ARRAY = 0, 2, 93
_KNOWN_VERSIONS = (1, 2)

# Words of the table that belongs to one compiled function.
_SINGLE, _BATCH, _COUNT, _MOST, _MADE, _FEW, _ARRAY, _DTYPE, _NEW, _NONE, _OTHERWISE, _OUT, _WIDTH, _SHAPE_SIZE = range(
    14
)
_SHAPE = 14
_ARGUMENTS = _SHAPE + _MOST_SHAPE
# Items of the tuple to which the function belongs: the table, what is called otherwise, and then results that it has
# returned. Two, because in a loop the last result still has its name while the next one is computed.
_OTHERS, _KEPT = 2, 2
_OUT_NAME = sys.intern("out")  # as names of arguments in compiled code are, so that their addresses are equal


class _MethodDefinition(ctypes.Structure):
    """What CPython knows of a built-in function; with it lives the code at the address."""

    code: LoadedCode
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("address", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("documentation", ctypes.c_char_p),
    )


class _Kept(tuple[Any, ...]):
    """The items that belong to a function; a copy of one in the place of a method is the method of a copy."""

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        # As what belongs to a function is pickled, followed by the name that the function has in it.
        owner = getattr(self[_OTHERS - 1], "__self__", None)
        if owner is None:
            raise TypeError("a function that is machine code of this process cannot be pickled")
        return _itself, (owner,)


def _itself(owner: Any) -> Any:
    return owner


def direct_call(
    arguments: Sequence[Argument],
    shape: tuple[int, ...],
    *,
    single: LoadedCode,
    batch: LoadedCode,
    few: int,
    most: int,
    made: int,
    otherwise: Callable[..., Any] | None = None,
) -> DirectCall | None:
    """Return a built-in function that computes a compiled function for a few samples, or None where there is none.

    Called with the arguments, (..., width) each, or (width,) where uniform, and ``out`` (..., *shape), it writes and
    returns `out`, or a new array where `out` is None; instead of a new one, an earlier one that nobody has any more
    (making and freeing one takes 0.09 to 0.15 µs). It does so only where all of them are plain arrays of doubles,
    C-contiguous and aligned, whose shapes fit and whose memory is not that of `out`. Otherwise it does nothing and
    returns None, so that the caller finds out what was wrong.

    Parameters
    ----------
    shape : tuple of int
        Of the outputs of one sample.
    single, batch : LoadedCode
        Of the functions that compute samples one by one and side by side, see
        :attr:`steelyard.graph.Kernel.batch_function`. It stays in memory with what is returned.
    few : int
        How many samples that are left over are computed one by one rather than in a register that would not be full.
    most : int
        How many samples are computed at all. Other threads of Python wait meanwhile.
    made : int
        How many samples are computed into a new array.
    otherwise : callable, optional
        What is called, with the same arguments, instead of returning None. `out` may then only be given by its name, or
        not at all, and the built-in function has the name, the signature and the documentation of this one.
    """
    if not 1 <= len(arguments) <= _MOST_ARGUMENTS or arguments[0].uniform or len(shape) > _MOST_SHAPE:
        return None
    if not _arrays_are_known():
        return None
    table = np.zeros(_ARGUMENTS + 2 * len(arguments), dtype=np.int64)
    table[:_SHAPE] = (
        single.addresses["kernel"],
        batch.addresses["kernel"],
        len(arguments),
        most,
        made,
        few,
        id(np.ndarray),
        id(_DOUBLE),
        _new_array(),
        id(None),
        0 if otherwise is None else id(otherwise),
        id(_OUT_NAME),
        int(np.prod(shape, dtype=np.int64)),
        len(shape),
    )
    table[_SHAPE : _SHAPE + len(shape)] = shape
    table[_ARGUMENTS:] = [number for a in arguments for number in (a.width, a.uniform)]
    # A function of its own, since others may give those of `pythonapi` other types.
    create = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)(
        ("PyCFunction_NewEx", ctypes.pythonapi)
    )
    # Which keeps the tuple, and so the table, what is called otherwise, the last results, the code, and its own
    # definition: where two threads ask for one at the same time, one of them gets what the cache does not keep.
    definition = _definition(*_described(otherwise))
    kept = _Kept((table, otherwise, *[None] * _KEPT, definition, single, batch))
    result: DirectCall = create(ctypes.byref(definition), kept, None)
    return result


def _described(function: Callable[..., Any] | None) -> tuple[str, str | None]:
    """Return name and documentation, which begins with the signature where `inspect` looks for that of a built-in."""
    if function is None:
        return "direct", None
    signature = inspect.signature(function)
    plain = [p.replace(annotation=p.empty) for p in signature.parameters.values()]
    text = str(signature.replace(parameters=plain, return_annotation=signature.empty))
    return function.__name__, f"{function.__name__}{text}\n--\n\n{inspect.getdoc(function) or ''}"


@cache
def _interface_of_numpy() -> Sequence[int]:
    """Return the addresses that NumPy gives to extensions, up to those that are wanted here."""
    from numpy._core import _multiarray_umath  # type: ignore[attr-defined]

    pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
        ("PyCapsule_GetPointer", ctypes.pythonapi)
    )
    table = pointer(_multiarray_umath._ARRAY_API, None)
    return list((ctypes.c_int64 * (_NEW_ARRAY + 1)).from_address(table or 0))


def _new_array() -> int:
    """Return the address of NumPy's ``PyArray_New``."""
    return _interface_of_numpy()[_NEW_ARRAY]


@cache
def _arrays_are_known() -> bool:
    """Tell whether an array of NumPy is made, and stands in memory, as the machine code does it and reads it."""
    try:
        interface = _interface_of_numpy()
    except (ImportError, AttributeError, ValueError):
        return False
    version = ctypes.CFUNCTYPE(ctypes.c_uint)(interface[_VERSION_OF_NUMPY])() >> 24
    if version not in _KNOWN_VERSIONS or interface[_TYPE_OF_ARRAYS] != id(np.ndarray):
        return False
    head = object.__basicsize__
    if ctypes.sizeof(ctypes.c_void_p) != 8 or head % 8 or np.ndarray.__weakrefoffset__ != head + _WEAK:
        return False
    array: NDArray[np.float64] = np.zeros((2, 3))
    pair = _Kept((array, _OUT_NAME))
    start = id(array) + head

    def word(address: int) -> int:
        return ctypes.c_int64.from_address(address).value

    return (
        [word(id(pair) + tuple.__basicsize__ + k) for k in (-8, 0, 8)] == [2, id(array), id(_OUT_NAME)]
        and word(start - 8) == id(np.ndarray)
        and word(start + _DATA) == array.ctypes.data
        and ctypes.c_int.from_address(start + _ND).value == 2
        and word(start + _DESCR) == id(_DOUBLE)
        and ctypes.c_int.from_address(start + _FLAGS).value == array.flags.num
        and list((ctypes.c_int64 * 2).from_address(word(start + _DIMENSIONS))) == [2, 3]
    )


def _references_are_counted() -> bool:
    """Tell whether the number of references to an object is where the machine code reads it, whatever thread asks."""
    # `sys.getrefcount` would count what the interpreter has on its stack, or not, depending on its version.
    things = [object() for _ in range(3)]
    more = [[*things], things[1:]]
    found = [ctypes.c_int32.from_address(address).value for address in map(id, things)]
    return len(more) == 2 and found == [2, 3, 3] and getattr(sys, "_is_gil_enabled", lambda: True)()


@cache
def _loaded() -> LoadedCode:
    machine = host_machine(1)
    names = ("Py_IncRef", "Py_DecRef", "PyObject_Vectorcall")
    imports = {name: ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0 for name in names}
    sizes = object.__basicsize__, tuple.__basicsize__
    source = _source(machine.triple, *sizes, batch_lanes(), _DOUBLE.num, counted=_references_are_counted())
    return machine.load_source(source, ("direct",), imports)


@cache
def _definition(name: str, documentation: str | None) -> _MethodDefinition:
    text, code = None if documentation is None else documentation.encode(), _loaded()
    definition = _MethodDefinition(name.encode(), code.addresses["direct"], _FASTCALL_KEYWORDS, text)
    definition.code = code
    return definition


class _Lines:
    """LLVM assembly with a fresh name for each result; where a check fails, it goes on at the label `failed`."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.failed = "none"
        self._count = 0

    def new(self, instruction: str) -> str:
        name = f"%t{self._count}"
        self._count += 1
        self.lines.append(f"  {name} = {instruction}")
        return name

    def op(self, kind: str, a: str, b: str | int) -> str:
        """Combine two integers."""
        return self.new(f"{kind} i64 {a}, {b}")

    def moved(self, pointer: str, kind: str, index: str | int) -> str:
        """Return the address of an item of a row."""
        return self.new(f"getelementptr {kind}, ptr {pointer}, i64 {index}")

    def item(self, pointer: str, index: str | int, kind: str = "i64") -> str:
        """Read an item of a row of words."""
        return self.new(f"load {kind}, ptr {self.moved(pointer, kind, index)}")

    def at(self, pointer: str, offset: int, kind: str = "i64") -> str:
        """Read what stands so many bytes after a pointer."""
        return self.new(f"load {kind}, ptr {self.moved(pointer, 'i8', offset)}")

    def label(self, name: str) -> None:
        """Begin a block that follows."""
        self.lines += [f"  br label %{name}", f"{name}:"]

    def fork(self, condition: str, yes: str, no: str) -> None:
        """End a block."""
        self.lines.append(f"  br i1 {self.new(condition)}, label %{yes}, label %{no}")

    def require(self, condition: str) -> None:
        """Go on only where the condition holds."""
        self._count += 1
        name = f"on{self._count}"
        self.fork(condition, name, self.failed)
        self.lines.append(f"{name}:")

    def repeat(self, name: str, count: str) -> str:
        """Begin a block for each of the integers below a count, which `again` ends; return the integer."""
        self.label(f"{name}entry")
        self.fork(f"icmp sgt i64 {count}, 0", f"{name}loop", f"{name}done")
        self.lines += [f"{name}loop:", f"  %{name}k = phi i64 [ 0, %{name}entry ], [ %{name}next, %{name}turn ]"]
        return f"%{name}k"

    def again(self, name: str, count: str) -> None:
        """End a block that is repeated."""
        self.label(f"{name}turn")
        self.lines.append(f"  %{name}next = add i64 %{name}k, 1")
        self.fork(f"icmp slt i64 %{name}next, {count}", f"{name}loop", f"{name}done")
        self.lines.append(f"{name}done:")

    def same(self, name: str, first: str, second: str, count: str) -> None:
        """Require that two rows of integers are equal."""
        k = self.repeat(name, count)
        self.require(f"icmp eq i64 {self.item(first, k)}, {self.item(second, k)}")
        self.again(name, count)

    def copy(self, name: str, target: str, source: str, count: str) -> None:
        """Copy a row of integers."""
        k = self.repeat(name, count)
        self.lines.append(f"  store i64 {self.item(source, k)}, ptr {self.moved(target, 'i64', k)}")
        self.again(name, count)

    def array(self, thing: str, head: int, flags: int) -> tuple[str, str, str]:
        """Require a plain array with some flags; return its data, its dimensions and their number."""
        self.require(f"icmp eq i64 {self.at(thing, head - 8)}, %array")
        self.require(f"icmp eq i64 {self.at(thing, head + _DESCR)}, %dtype")
        found = self.new(f"and i32 {self.at(thing, head + _FLAGS, 'i32')}, {flags}")
        self.require(f"icmp eq i32 {found}, {flags}")
        size = self.new(f"sext i32 {self.at(thing, head + _ND, 'i32')} to i64")
        return self.at(thing, head + _DATA, "ptr"), self.at(thing, head + _DIMENSIONS, "ptr"), size

    def result(self, name: str, thing: str, head: int, leading: str, lead: str, tail: str) -> str:
        """Require an array that the result can be written into; return its data."""
        data, sizes, size = self.array(thing, head, _C_CONTIGUOUS | _ALIGNED | _WRITEABLE)
        self.require(f"icmp eq i64 {size}, {self.op('add', lead, '%tail')}")
        self.same(f"leading{name}", sizes, leading, lead)
        self.same(f"shape{name}", self.moved(sizes, "i64", lead), tail, "%tail")
        return data


def _source(triple: str, head: int, items: int, lanes: int, double: int, *, counted: bool) -> str:
    """Return the LLVM assembly of ``direct(self, things, given, names)``: the arguments, then what is written, or None.

    The items of a tuple, such as `self` with the table and `names`, stand `items` bytes after its address. `double` is
    NumPy's number of that type. Whether references are counted where an object begins is told by `counted`.
    """
    it = _Lines()
    table = it.at(it.at("%self", items, "ptr"), head + _DATA, "ptr")
    words = {"array": _ARRAY, "dtype": _DTYPE, "n": _COUNT, "width": _WIDTH, "tail": _SHAPE_SIZE, "most": _MOST}
    for name, index in (words | {"made": _MADE, "few": _FEW}).items():
        it.lines.append(f"  %{name} = load i64, ptr {it.moved(table, 'i64', index)}")
    pointers = {
        "single": _SINGLE,
        "batch": _BATCH,
        "new": _NEW,
        "nothing": _NONE,
        "otherwise": _OTHERWISE,
        "name": _OUT,
    }
    for name, index in pointers.items():
        it.lines.append(f"  %{name} = load ptr, ptr {it.moved(table, 'ptr', index)}")

    # What is written is the last argument, or, in the place of a method, the only one with a name, if there is any.
    it.fork("icmp eq ptr %otherwise, null", "unnamed", "method")
    it.lines.append("unnamed:")
    it.require("icmp eq ptr %names, null")
    it.require(f"icmp eq i64 %given, {it.op('add', '%n', 1)}")
    it.lines.append("  br label %last")
    it.lines.append("method:")
    it.require("icmp eq i64 %given, %n")
    it.label("positional")
    it.fork("icmp eq ptr %names, null", "known", "named")
    it.lines.append("named:")
    it.require(f"icmp eq i64 {it.at('%names', items - 8)}, 1")
    it.require(f"icmp eq ptr {it.at('%names', items, 'ptr')}, %name")
    it.label("last")
    named = it.item("%things", "%n", "ptr")
    it.label("known")
    out = it.new(f"phi ptr [ %nothing, %positional ], [ {named}, %last ]")

    # The first argument tells the leading dimensions, which all that are not uniform must have.
    _, leading, dimensions = it.array(it.item("%things", 0, "ptr"), head, _C_CONTIGUOUS | _ALIGNED)
    lead = it.op("sub", dimensions, 1)
    it.require(f"icmp sge i64 {lead}, 0")
    it.require(f"icmp sle i64 {lead}, {_MOST_LEADING}")
    it.label("product")
    it.fork(f"icmp sgt i64 {lead}, 0", "times", "counted")
    it.lines += [
        "times:",
        "  %d = phi i64 [ 0, %product ], [ %dnext, %times ]",
        "  %c = phi i64 [ 1, %product ], [ %cnext, %times ]",
    ]
    it.lines += [f"  %cnext = mul i64 %c, {it.item(leading, '%d')}", "  %dnext = add i64 %d, 1"]
    it.fork(f"icmp slt i64 %dnext, {lead}", "times", "counted")
    it.lines += ["counted:", "  %count = phi i64 [ 1, %product ], [ %cnext, %times ]"]
    it.require("icmp sgt i64 %count, 0")
    it.require("icmp sle i64 %count, %most")

    # What is written has them, too; a new array has no memory in common with any other.
    tail = it.moved(table, "i64", _SHAPE)
    it.fork(f"icmp eq ptr {out}, %nothing", "make", "take")
    it.lines.append("make:")
    it.fork("icmp sle i64 %count, %made", "begin", "none")
    it.lines.append("take:")
    own = it.result("own", out, head, leading, lead, tail)
    origin = it.new(f"ptrtoint ptr {own} to i64")
    limit = it.op("add", origin, it.op("shl", it.op("mul", "%count", "%width"), 3))
    it.label("taken")
    it.label("begin")
    memory = it.new(f"phi ptr [ null, %make ], [ {own}, %taken ]")
    start = it.new(f"phi i64 [ 0, %make ], [ {origin}, %taken ]")
    end = it.new(f"phi i64 [ 0, %make ], [ {limit}, %taken ]")

    # The arguments, one after the other.
    it.label("arguments")
    it.label("argument")
    it.lines.append("  %k = phi i64 [ 0, %arguments ], [ %knext, %kept ]")
    read, sizes, number = it.array(it.item("%things", "%k", "ptr"), head, _C_CONTIGUOUS | _ALIGNED)
    place = it.op("add", it.op("shl", "%k", 1), _ARGUMENTS)
    width, is_uniform = it.item(table, place), it.item(table, it.op("add", place, 1))
    uniform = it.new(f"icmp ne i64 {is_uniform}, 0")
    expected = it.new(f"select i1 {uniform}, i64 1, i64 {dimensions}")
    it.require(f"icmp eq i64 {number}, {expected}")
    before = it.op("sub", expected, 1)
    it.require(f"icmp eq i64 {it.item(sizes, before)}, {width}")
    it.same("lead", sizes, leading, before)
    first = it.new(f"ptrtoint ptr {read} to i64")
    rows = it.new(f"select i1 {uniform}, i64 1, i64 %count")
    stop = it.op("add", first, it.op("shl", it.op("mul", rows, width), 3))
    begins, ends = it.new(f"icmp sge i64 {first}, {end}"), it.new(f"icmp sge i64 {start}, {stop}")
    it.require(f"or i1 {begins}, {ends}")
    it.lines.append(f"  store ptr {read}, ptr {it.moved('%pointers', 'ptr', '%k')}")
    step = it.new(f"select i1 {uniform}, i64 0, i64 {it.op('shl', width, 3)}")
    it.lines.append(f"  store i64 {step}, ptr {it.moved('%steps', 'i64', '%k')}")
    it.label("kept")
    it.lines.append("  %knext = add i64 %k, 1")
    it.fork("icmp slt i64 %knext, %n", "argument", "compute")

    it.lines.append("compute:")
    it.fork(f"icmp eq ptr {out}, %nothing", "create", "handed")
    it.lines += ["handed:", f"  call void @Py_IncRef(ptr {out})", "  br label %write"]
    found = {"handed": (out, memory)}

    # Results that were returned before and that nobody but this function has any more are returned anew.
    it.lines.append("create:")
    for kept in range(_KEPT if counted else 0):
        it.label(f"kept{kept}")
        it.failed = f"kept{kept + 1}"
        earlier = it.at("%self", items + 8 * (_OTHERS + kept), "ptr")
        it.require(f"icmp eq i32 {it.at(earlier, 0, 'i32')}, 1")
        it.require(f"icmp eq ptr {it.at(earlier, head + _WEAK, 'ptr')}, null")
        data = it.result(f"kept{kept}", earlier, head, leading, lead, tail)
        it.label(f"again{kept}")
        it.lines += [f"  call void @Py_IncRef(ptr {earlier})", "  br label %write"]
        found[f"again{kept}"] = (earlier, data)
    it.failed = "none"
    it.label(f"kept{_KEPT}")
    it.copy("heads", "%sizes", leading, lead)
    it.copy("tails", it.moved("%sizes", "i64", lead), tail, "%tail")
    rank = it.new(f"trunc i64 {it.op('add', lead, '%tail')} to i32")
    plain = f"i32 {double}, ptr null, ptr null, i32 0, i32 0, ptr null"
    created = it.new(f"call ptr %new(ptr {it.new('inttoptr i64 %array to ptr')}, i32 {rank}, ptr %sizes, {plain})")
    it.fork(f"icmp eq ptr {created}, null", "failed", "created")
    it.lines.append("created:")
    fresh = it.at(created, head + _DATA, "ptr")
    if counted:
        it.lines.append(f"  call void @Py_IncRef(ptr {created})")
        moving = created
        for kept in range(_KEPT):
            place = it.moved("%self", "i8", items + 8 * (_OTHERS + kept))
            before = it.new(f"load ptr, ptr {place}")
            it.lines.append(f"  store ptr {moving}, ptr {place}")
            moving = before
        it.lines.append(f"  call void @Py_DecRef(ptr {moving})")
    it.lines += ["  br label %write", "write:"]
    found["created"] = (created, fresh)
    result, data = (
        it.new("phi ptr " + ", ".join(f"[ {values[k]}, %{label} ]" for label, values in found.items())) for k in (0, 1)
    )

    # Full registers side by side; what is left, one by one where it is little.
    left = it.op("and", "%count", lanes - 1)
    little = it.new(f"icmp sle i64 {left}, %few")
    apart = it.new(f"select i1 {little}, i64 {left}, i64 0")
    together = it.op("sub", "%count", apart)
    target = it.moved(data, "double", it.op("mul", together, "%width"))
    cases = " ".join(f"i64 {k}, label %both{k}" for k in range(1, _MOST_ARGUMENTS + 1))
    it.lines.append(f"  switch i64 %n, label %none [ {cases} ]")
    for k in range(1, _MOST_ARGUMENTS + 1):
        it.lines.append(f"both{k}:")
        values = [it.item("%pointers", j, "ptr") for j in range(k)]
        it.fork(f"icmp sgt i64 {together}, 0", f"batch{k}", f"middle{k}")
        it.lines.append(f"batch{k}:")
        given = ", ".join(f"ptr {v}" for v in values)
        it.lines.append(f"  call void %batch(i64 {together}, {given}, ptr {data}, i64 1)")
        it.label(f"middle{k}")
        it.fork(f"icmp sgt i64 {apart}, 0", f"single{k}", "done")
        it.lines.append(f"single{k}:")
        last = [it.moved(v, "i8", it.op("mul", together, it.item("%steps", j))) for j, v in enumerate(values)]
        given = ", ".join(f"ptr {v}" for v in last)
        it.lines += [f"  call void %single(i64 {apart}, {given}, ptr {target}, i64 1)", "  br label %done"]
    return "\n".join(
        [
            f'target triple = "{triple}"',
            "declare void @Py_IncRef(ptr)",
            "declare void @Py_DecRef(ptr)",
            "declare ptr @PyObject_Vectorcall(ptr, ptr, i64, ptr)",
            "define ptr @direct(ptr %self, ptr %things, i64 %given, ptr %names) nounwind {",
            "entry:",
            f"  %pointers = alloca [{_MOST_ARGUMENTS} x ptr]",
            f"  %steps = alloca [{_MOST_ARGUMENTS} x i64]",
            f"  %sizes = alloca [{_MOST_LEADING + _MOST_SHAPE} x i64]",
            *it.lines,
            "done:",
            f"  ret ptr {result}",
            "failed:",
            "  ret ptr null",
            "none:",
            "  %apart = icmp eq ptr %otherwise, null",
            "  br i1 %apart, label %nothing.done, label %leave",
            "leave:",
            "  %left = call ptr @PyObject_Vectorcall(ptr %otherwise, ptr %things, i64 %given, ptr %names)",
            "  ret ptr %left",
            "nothing.done:",
            "  call void @Py_IncRef(ptr %nothing)",
            "  ret ptr %nothing",
            "}",
            "",
        ]
    )
