"""Loops over arrays as LLVM assembly, for algorithms on many problems that stand side by side in the registers.

An expression graph has no loops; here each element of an array is a vector with one number of each problem, so that an
algorithm is written once, as for one problem. The problems may as well be neighbouring columns of matrices.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

__all__ = ["Array", "Code", "Condition", "Fold", "Index", "Mask", "Number"]


class Index:
    """An integer that is known while the assembly is written, or when it runs."""

    def __init__(self, code: Code, value: int | str) -> None:
        self.code, self.value = code, value

    def __str__(self) -> str:
        return str(self.value)

    def _with(self, operation: str, other: Index | int) -> Index:
        mine, given = self.value, other.value if isinstance(other, Index) else other
        if isinstance(mine, int) and isinstance(given, int):
            return Index(self.code, {"add": mine + given, "sub": mine - given, "mul": mine * given}[operation])
        return Index(self.code, self.code.let(f"{operation} i64 {mine}, {given}"))

    def __add__(self, other: Index | int) -> Index:
        return self._with("add", other)

    def __sub__(self, other: Index | int) -> Index:
        return self._with("sub", other)

    def __mul__(self, other: Index | int) -> Index:
        return self._with("mul", other)

    def bits(self, operation: str, other: Index | int) -> Index:
        """Return what an operation of the processor makes of the bits of both, such as ``"and"`` or ``"shl"``."""
        return Index(self.code, self.code.let(f"{operation} i64 {self}, {other}"))

    def count(self, what: str) -> Index:
        """Return how many bits are set (``"ctpop"``), or are not before the first (``"cttz"``) or the last one."""
        return self.code.counted(what, self)

    def below(self, other: Index | int) -> Index:
        """Return the less of both."""
        return self.code.lesser(self, other)

    def number(self) -> Number:
        """Return it as a number that all problems share."""
        return self.code.spread(self.code.let(f"sitofp i64 {self} to double"))

    def holds(self, comparison: str, other: Index | int) -> Condition:
        """Tell whether a comparison holds, such as ``"eq"``, ``"sgt"`` (above) or ``"sle"`` (at most)."""
        return Condition(self.code, self.code.let(f"icmp {comparison} i64 {self}, {other}"))


class Condition:
    """Something that holds or does not, for all problems alike."""

    def __init__(self, code: Code, text: str) -> None:
        self.code, self.text = code, text

    def __and__(self, other: Condition) -> Condition:
        return Condition(self.code, self.code.let(f"and i1 {self.text}, {other.text}"))

    def __or__(self, other: Condition) -> Condition:
        return Condition(self.code, self.code.let(f"or i1 {self.text}, {other.text}"))

    def __invert__(self) -> Condition:
        return Condition(self.code, self.code.let(f"xor i1 {self.text}, true"))


class Number:
    """A number of each problem. Products and sums may be fused."""

    def __init__(self, code: Code, text: str) -> None:
        self.code, self.text = code, text

    def _with(self, operation: str, other: Number | float, turned: bool = False) -> Number:
        pair = [self.text, self.code.number(other).text]
        first, second = reversed(pair) if turned else pair
        return Number(self.code, self.code.let(f"{operation} {self.code.vector} {first}, {second}"))

    def __add__(self, other: Number | float) -> Number:
        return self._with("fadd contract", other)

    def __sub__(self, other: Number | float) -> Number:
        return self._with("fsub contract", other)

    def __mul__(self, other: Number | float) -> Number:
        return self._with("fmul contract", other)

    def __truediv__(self, other: Number | float) -> Number:
        return self._with("fdiv", other)

    def __rsub__(self, other: float) -> Number:
        return self._with("fsub contract", other, turned=True)

    def __rtruediv__(self, other: float) -> Number:
        return self._with("fdiv", other, turned=True)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Number:
        return Number(self.code, self.code.let(f"fneg {self.code.vector} {self.text}"))

    def __gt__(self, other: Number | float) -> Mask:
        """Tell of which problems it is greater; of none where one of both is not a number."""
        text = f"fcmp ogt {self.code.vector} {self.text}, {self.code.number(other).text}"
        return Mask(self.code, self.code.let(text))

    def __lt__(self, other: Number | float) -> Mask:
        return self.code.number(other) > self

    def above(self, other: Number | float) -> Number:
        """Return the greater of both; the other where this is not a number."""
        return (self > other).choose(self, other)

    def below(self, other: Number | float) -> Number:
        """Return the less of both; the other where this is not a number."""
        return (self < other).choose(self, other)

    def root(self) -> Number:
        """Return the square root."""
        return self.code.call("sqrt", self)

    def size(self) -> Number:
        """Return the number without its sign."""
        return self.code.call("fabs", self)

    def total(self) -> Number:
        """Return the sum over all problems, which each of them receives."""
        return self.code.total(self)

    def is_finite(self) -> Mask:
        """Tell of which problems it is neither infinite nor not a number."""
        return self.size() < math.inf


class Mask:
    """A mask that says of each problem whether a condition holds."""

    def __init__(self, code: Code, text: str) -> None:
        self.code, self.text = code, text

    def __and__(self, other: Mask) -> Mask:
        return Mask(self.code, self.code.let(f"and {self.code.mask} {self.text}, {other.text}"))

    def __or__(self, other: Mask) -> Mask:
        return Mask(self.code, self.code.let(f"or {self.code.mask} {self.text}, {other.text}"))

    def any(self) -> Condition:
        """Tell whether it holds of any problem."""
        code = self.code
        bits = code.let(f"bitcast {code.mask} {self.text} to i{code.lanes}")
        return Condition(code, code.let(f"icmp ne i{code.lanes} {bits}, 0"))

    def choose(self, one: Number | float, other: Number | float) -> Number:
        """Return one number where it holds, the other where it does not."""
        code, a, b = self.code, self.code.number(one), self.code.number(other)
        return Number(code, code.let(f"select {code.mask} {self.text}, {code.vector} {a.text}, {code.vector} {b.text}"))


class Array:
    """A place in memory: numbers of each problem, or numbers or integers that all problems share."""

    def __init__(self, code: Code, text: str) -> None:
        self.code, self.text = code, text

    def _place(self, kind: str, index: Index | int) -> str:
        return self.code.let(f"getelementptr {kind}, ptr {self.text}, i64 {index}")

    def at(self, index: Index | int) -> Array:
        """Return what begins at an element."""
        return Array(self.code, self._place(self.code.vector, index))

    def shared_at(self, index: Index | int) -> Array:
        """Return what begins at an element that all problems share."""
        return Array(self.code, self._place("double", index))

    def __getitem__(self, index: Index | int) -> Number:
        kind = self.code.vector
        return Number(self.code, self.code.let(f"load {kind}, ptr {self._place(kind, index)}, align 8"))

    def __setitem__(self, index: Index | int, value: Number | float) -> None:
        kind = self.code.vector
        text = self.code.number(value).text
        self.code.add(f"store {kind} {text}, ptr {self._place(kind, index)}, align 8")

    def of_first(self, held: int) -> Number:
        """Return what begins here of the first `held` problems, and 0 of the others, whose memory is not touched."""
        code = self.code
        if held == code.lanes:
            return self[0]
        name = f"@llvm.masked.load.v{code.lanes}f64.p0"
        code._declare(name, code.vector, f"ptr, i32, {code.mask}, {code.vector}")
        chosen = f"{code.mask} <{', '.join(f'i1 {int(lane < held)}' for lane in range(code.lanes))}>"
        return Number(
            code,
            code.let(f"call {code.vector} {name}(ptr {self.text}, i32 8, {chosen}, {code.vector} zeroinitializer)"),
        )

    def shared(self, index: Index | int) -> Number:
        """Return a number that all problems share."""
        return self.code.spread(self.code.let(f"load double, ptr {self._place('double', index)}, align 8"))

    def put(self, index: Index | int, value: Number | float) -> None:
        """Store the number of the first problem, as one that all share."""
        code = self.code
        one = code.let(f"extractelement {code.vector} {code.number(value).text}, i32 0")
        code.add(f"store double {one}, ptr {self._place('double', index)}, align 8")

    def put_integer(self, index: Index | int, value: Index | int) -> None:
        """Store an integer that all problems share."""
        self.code.add(f"store i64 {value}, ptr {self._place('i64', index)}, align 8")

    def bytes_set(self, index: Index | int) -> Index:
        """Return which of 64 bytes from this one on are not zero, as bits of an integer."""
        code = self.code
        found = code.let(f"load <64 x i8>, ptr {self._place('i8', index)}, align 1")
        bits = code.let(f"icmp ne <64 x i8> {found}, zeroinitializer")
        return Index(code, code.let(f"bitcast <64 x i1> {bits} to i64"))

    def integer(self, index: Index | int) -> Index:
        """Return an integer that all problems share."""
        return Index(self.code, self.code.let(f"load i64, ptr {self._place('i64', index)}, align 8"))

    def array(self, index: Index | int) -> Array:
        """Return the array whose address is an element."""
        return Array(self.code, self.code.let(f"load ptr, ptr {self._place('i64', index)}, align 8"))


class Fold:
    """A loop that carries numbers from one turn to the next; see `Code.fold`."""

    def __init__(self, code: Code, index: Index, values: list[Number]) -> None:
        self.code, self.index, self.values = code, index, values
        self.next: list[Number] = []


class Code:
    """LLVM assembly that is written function by function.

    Parameters
    ----------
    lanes : int
        Problems side by side.
    triple : str
        The processor, as `Machine.triple` names it.

    Examples
    --------
    >>> code = Code(4, "x86_64-unknown-linux-gnu")
    >>> with code.function("doubled", "values") as (values,):
    ...     values[0] = values[0] * 2.0
    >>> print(code.text.splitlines()[-2])
      ret void
    """

    def __init__(self, lanes: int, triple: str) -> None:
        self.lanes = lanes
        self.vector, self.mask = f"<{lanes} x double>", f"<{lanes} x i1>"
        self._lines = [f'target triple = "{triple}"']
        self._declared: dict[str, str] = {}
        self._count, self._block = 0, "entry"

    @property
    def text(self) -> str:
        """The assembly."""
        return "\n".join([*self._lines, *(self._declared[name] for name in sorted(self._declared)), ""])

    def add(self, line: str) -> None:
        """Add a line to the function that is written."""
        self._lines.append(f"  {line}")

    def let(self, instruction: str) -> str:
        """Add an instruction, and return the name of what it gives."""
        self._count += 1
        self.add(f"%t{self._count} = {instruction}")
        return f"%t{self._count}"

    def number(self, value: Number | float) -> Number:
        """Return a number of which all problems have the same."""
        if isinstance(value, Number):
            return value
        bits = f"double 0x{struct.unpack('>Q', struct.pack('>d', value))[0]:016X}"
        return Number(self, f"<{', '.join([bits] * self.lanes)}>")

    def known(self, value: int) -> Index:
        """Return an integer that is known while the assembly is written."""
        return Index(self, value)

    def call(self, name: str, value: Number) -> Number:
        """Call one of LLVM's functions of a number."""
        name = self._declare(f"@llvm.{name}.v{self.lanes}f64", self.vector, self.vector)
        return Number(self, self.let(f"call {self.vector} {name}({self.vector} {value.text})"))

    def total(self, value: Number) -> Number:
        """Return the sum over all problems, which each of them receives."""
        name = self._declare(f"@llvm.vector.reduce.fadd.v{self.lanes}f64", "double", f"double, {self.vector}")
        return self.spread(self.let(f"call double {name}(double -0.0, {self.vector} {value.text})"))

    def counted(self, what: str, value: Index) -> Index:
        """Return a count of the bits of an integer: ``"ctpop"``, ``"cttz"`` or ``"ctlz"``."""
        name = self._declare(f"@llvm.{what}.i64", "i64", "i64" if what == "ctpop" else "i64, i1")
        return Index(self, self.let(f"call i64 {name}(i64 {value}{'' if what == 'ctpop' else ', i1 false'})"))

    def lesser(self, one: Index, other: Index | int) -> Index:
        """Return the less of two integers."""
        name = self._declare("@llvm.smin.i64", "i64", "i64, i64")
        return Index(self, self.let(f"call i64 {name}(i64 {one}, i64 {other})"))

    def copy(self, target: Array, source: Array, numbers: Index | int) -> None:
        """Copy so many numbers, one after the other, between places that do not overlap."""
        name = self._declare("@llvm.memcpy.p0.p0.i64", "void", "ptr, ptr, i64, i1")
        size = self.known(8) * numbers
        self.add(f"call void {name}(ptr {target.text}, ptr {source.text}, i64 {size}, i1 false)")

    def spread(self, one: str) -> Number:
        """Return a number that all problems share."""
        kind = self.vector
        lane = self.let(f"insertelement {kind} poison, double {one}, i32 0")
        return Number(
            self, self.let(f"shufflevector {kind} {lane}, {kind} poison, <{self.lanes} x i32> zeroinitializer")
        )

    def _declare(self, name: str, result: str, arguments: str) -> str:
        self._declared[name] = f"declare {result} {name}({arguments})"
        return name

    @contextmanager
    def function(self, name: str, *arguments: str, exported: bool = True, integers: str = "") -> Iterator[list[Any]]:
        """Write a function of arrays, and integers whose names follow; what is not exported is called by others."""
        own = integers.split()
        listed = ", ".join([*(f"ptr %{argument}" for argument in arguments), *(f"i64 %{one}" for one in own)])
        self._lines += [f"define {'' if exported else 'internal '}void @{name}({listed}) {{", "entry:"]
        self._block = "entry"
        yield [*(Array(self, f"%{argument}") for argument in arguments), *(Index(self, f"%{one}") for one in own)]
        self._lines += ["  ret void", "}"]

    def run(self, name: str | Array, *arguments: Array | Index | int) -> None:
        """Call a function of this code, or one whose address is given."""
        given = (f"ptr {one.text}" if isinstance(one, Array) else f"i64 {one}" for one in arguments)
        self.add(f"call void {name.text if isinstance(name, Array) else f'@{name}'}({', '.join(given)})")

    def _label(self, kind: str) -> str:
        self._count += 1
        return f"{kind}{self._count}"

    def _begin(self, label: str) -> None:
        self._lines.append(f"{label}:")
        self._block = label

    @contextmanager
    def fold(
        self, values: Sequence[Number | float], stop: Index | int, start: Index | int = 0, step: int = 1
    ) -> Iterator[Fold]:
        """Loop over indices; `next` of the loop are its values in the next turn, and after it `values` are the last."""
        head, body, end = (self._label(kind) for kind in ("head", "body", "end"))
        before, initial = self._block, [self.number(value).text for value in values]
        names = [f"%{head}v{k}" for k in range(len(initial))]
        self.add(f"br label %{head}")
        self._begin(head)
        place = len(self._lines)
        more = self.let(f"icmp slt i64 %{head}i, {stop}")
        self.add(f"br i1 {more}, label %{body}, label %{end}")
        self._begin(body)
        loop = Fold(self, Index(self, f"%{head}i"), [Number(self, name) for name in names])
        yield loop
        following = self.let(f"add i64 %{head}i, {step}")
        phis = [f"  %{head}i = phi i64 [ {start}, %{before} ], [ {following}, %{self._block} ]"]
        phis += [
            f"  {name} = phi {self.vector} [ {first}, %{before} ], [ {last.text}, %{self._block} ]"
            for name, first, last in zip(names, initial, loop.next, strict=True)
        ]
        self.add(f"br label %{head}")
        self._lines[place:place] = phis
        self._begin(end)

    def range(self, stop: Index | int, start: Index | int = 0, step: int = 1) -> Iterator[Index]:
        """Loop over indices: ``for i in code.range(n):``, whose body is written once."""
        with self.fold([], stop, start, step) as loop:
            yield loop.index

    @contextmanager
    def when(self, condition: Condition) -> Iterator[None]:
        """Do something where a condition holds; what it finds has to go into arrays."""
        then, end = self._label("then"), self._label("end")
        self.add(f"br i1 {condition.text}, label %{then}, label %{end}")
        self._begin(then)
        yield
        self.add(f"br label %{end}")
        self._begin(end)

    def leave(self, going: Mask) -> None:
        """Return from the function where something holds of no problem."""
        self.leave_when(~going.any())

    def leave_when(self, condition: Condition) -> None:
        """Return from the function where a condition holds."""
        rest, out = self._label("rest"), self._label("out")
        self.add(f"br i1 {condition.text}, label %{out}, label %{rest}")
        self._begin(out)
        self.add("ret void")
        self._begin(rest)
