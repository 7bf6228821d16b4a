"""Loops over arrays as LLVM assembly, for algorithms on many problems that stand side by side in the registers.

An expression graph has no loops; here each element of an array is a vector with one number of each problem, so that an
algorithm is written once, as for one problem.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

__all__ = ["Array", "Code", "Fold", "Index", "Mask", "Number"]


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

    def shared(self, index: Index | int) -> Number:
        """Return a number that all problems share."""
        code, kind = self.code, self.code.vector
        one = code.let(f"load double, ptr {self._place('double', index)}, align 8")
        lane = code.let(f"insertelement {kind} poison, double {one}, i32 0")
        return Number(
            code, code.let(f"shufflevector {kind} {lane}, {kind} poison, <{code.lanes} x i32> zeroinitializer")
        )

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
        self._declared: set[str] = set()
        self._count, self._block = 0, "entry"

    @property
    def text(self) -> str:
        """The assembly."""
        declared = [f"declare {self.vector} {name}({self.vector})" for name in sorted(self._declared)]
        return "\n".join([*self._lines, *declared, ""])

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
        name = f"@llvm.{name}.v{self.lanes}f64"
        self._declared.add(name)
        return Number(self, self.let(f"call {self.vector} {name}({self.vector} {value.text})"))

    @contextmanager
    def function(self, name: str, *arguments: str, exported: bool = True) -> Iterator[list[Array]]:
        """Write a function of arrays; what is not exported is called by others."""
        listed = ", ".join(f"ptr %{argument}" for argument in arguments)
        self._lines += [f"define {'' if exported else 'internal '}void @{name}({listed}) {{", "entry:"]
        self._block = "entry"
        yield [Array(self, f"%{argument}") for argument in arguments]
        self._lines += ["  ret void", "}"]

    def run(self, name: str, *arguments: Array) -> None:
        """Call a function of this code."""
        self.add(f"call void @{name}({', '.join(f'ptr {one.text}' for one in arguments)})")

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

    def leave(self, going: Mask) -> None:
        """Return from the function where something holds of no problem."""
        rest, out = self._label("rest"), self._label("out")
        bits = self.let(f"bitcast {self.mask} {going.text} to i{self.lanes}")
        none = self.let(f"icmp eq i{self.lanes} {bits}, 0")
        self.add(f"br i1 {none}, label %{out}, label %{rest}")
        self._begin(out)
        self.add("ret void")
        self._begin(rest)
