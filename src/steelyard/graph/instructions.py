"""LLVM assembly as text: single instructions on a few samples side by side, and functions that all kernels share."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

__all__ = ["SUPPORT", "Instructions", "support_source"]


# pi/2 as a sum of two doubles. Fused, the first step is exact from 1 rad to 1e9 rad, and the second leaves an error
# below 1e-23 rad.
_HALF_PI = (1.5707963267948966, 6.123233995736766e-17)
_ROUNDER = 6755399441055744.0  # 1.5 * 2**52: adding it leaves the nearest integer in the low bits
# With z = x² up to (pi/4)²: sin(x) = x + x z S(z) and cos(x) = 1 + z C(z), with the least largest relative error by
# the Remez exchange algorithm; 0.06 and 0.001 units in the last place before rounding.
_SINE = (
    -0.16666666666666644,
    0.008333333333323667,
    -0.0001984126983014903,
    2.7557313653584147e-06,
    -2.5050734854289338e-08,
    1.5894727448356813e-10,
)
_COSINE = (
    -0.5,
    0.04166666666666652,
    -0.0013888888888865718,
    2.480158728532436e-05,
    -2.7557313305200587e-07,
    2.087559349884686e-09,
    -1.135337196245555e-11,
)

# ln 2 as a sum of two doubles; the first has 21 zeros at its end, so that its products with exponents are exact.
_LN_2 = (0.693147180369123816490, 1.90821492927058770002e-10)
# Taylor's series of exp(x) to |x| = ln(2)/2, and of log(x) = 2 s (1 + s²/3 + s⁴/5 ...) with s = (x - 1) / (x + 1) to
# x = sqrt(2): what is left out is 4e-18 and 2e-17 of the values.
_EXPONENTIAL = tuple(1.0 / math.factorial(k) for k in range(14))
_LOGARITHM = tuple(2.0 / (2 * k + 3) for k in range(11))
_OVERFLOWS, _UNDERFLOWS = 710.0, -746.0  # beyond, exp is infinite, and 0


class Instructions:
    """Lines of LLVM assembly, with a fresh name for each result.

    Parameters
    ----------
    lanes : int
        Numbers in a vector; 1 for plain numbers.
    prefix : str
        Begins the names, so that the lines of two objects can stand in one function.

    Attributes
    ----------
    lines : list of str
    type : str
        LLVM's type of a value.
    """

    def __init__(self, lanes: int, prefix: str = "t") -> None:
        self.lanes = lanes
        self.lines: list[str] = []
        self.type = "double" if lanes == 1 else f"<{lanes} x double>"
        self._integer_type = "i64" if lanes == 1 else f"<{lanes} x i64>"
        self._flag_type = "i1" if lanes == 1 else f"<{lanes} x i1>"
        self._suffix = "f64" if lanes == 1 else f"v{lanes}f64"
        self._constants: dict[float, str] = {}
        self._count = 0
        self._prefix = prefix

    @staticmethod
    def declarations(lanes: int) -> list[str]:
        """Return the declarations of what the instructions call."""
        it = Instructions(lanes)
        return [
            f"declare {it.type} @llvm.{name}.{it._suffix}({it.type}, {it.type}, {it.type})"
            for name in ("fma", "fmuladd")
        ] + [f"declare {it.type} @llvm.sqrt.{it._suffix}({it.type})"]

    def new(self, instruction: str) -> str:
        """Append an instruction and return the name of its result."""
        name = f"%{self._prefix}{self._count}"
        self._count += 1
        self.lines.append(f"  {name} = {instruction}")
        return name

    def constant(self, value: float) -> str:
        """Return a number as a value."""
        text = self._constants.get(value)
        if text is None:
            text = f"0x{_bits(value):016X}"
            if self.lanes > 1:
                text = "<" + ", ".join([f"double {text}"] * self.lanes) + ">"
            self._constants[value] = text
        return text

    def same(self, scalar: str) -> str:
        """Return a value with a number in all the lanes."""
        if self.lanes == 1:
            return scalar
        first = self.new(f"insertelement {self.type} undef, double {scalar}, i64 0")
        return self.new(f"shufflevector {self.type} {first}, {self.type} undef, <{self.lanes} x i32> zeroinitializer")

    def load(self, pointer: str, index: int | str, *, unchanging: bool = False) -> str:
        """Read the value with an index. Unchanging memory can be read at any later time instead."""
        address = self.new(f"getelementptr {self.type}, ptr {pointer}, i64 {index}")
        mark = ", !invariant.load !0" if unchanging else ""
        return self.new(f"load {self.type}, ptr {address}, align {8 * self.lanes}{mark}")

    def load_same(self, pointer: str, index: int) -> str:
        """Read one number of unchanging memory for all the lanes."""
        address = self.new(f"getelementptr double, ptr {pointer}, i64 {index}")
        return self.same(self.new(f"load double, ptr {address}, align 8, !invariant.load !0"))

    def store(self, value: str, pointer: str, index: int | str) -> None:
        """Write the value with an index."""
        address = self.new(f"getelementptr {self.type}, ptr {pointer}, i64 {index}")
        self.lines.append(f"  store {self.type} {value}, ptr {address}, align {8 * self.lanes}")

    def store_row(self, numbers: Sequence[str], pointer: str, index: int) -> None:
        """Write plain numbers that are neighbours in memory."""
        kind = f"<{len(numbers)} x double>"
        row = "zeroinitializer"
        for position, number in enumerate(numbers):
            if number != "0.0":
                row = self.new(f"insertelement {kind} {row}, double {number}, i64 {position}")
        address = self.new(f"getelementptr double, ptr {pointer}, i64 {index}")
        self.lines.append(f"  store {kind} {row}, ptr {address}, align 8")

    def binary(self, operation: str, a: str, b: str) -> str:
        """Return ``a + b``, ``a - b``, ``a * b`` or ``a / b``."""
        return self.new(f"f{operation} {self.type} {a}, {b}")

    def negative(self, a: str) -> str:
        """Return ``-a``."""
        return self.new(f"fneg {self.type} {a}")

    def multiply_add(self, a: str, b: str, c: str) -> str:
        """Return ``a b + c``, rounded once where the processor does that in one step."""
        return self._call("fmuladd", a, b, c)

    def sign(self, x: str) -> str:
        """Return -1, 0 or 1; NaN where x is NaN."""
        zero, one = self.constant(0.0), self.constant(1.0)
        positive = self._select(self.new(f"fcmp ogt {self.type} {x}, {zero}"), one, zero)
        below = self._select(self.new(f"fcmp olt {self.type} {x}, {zero}"), self.constant(-1.0), positive)
        return self._select(self.new(f"fcmp uno {self.type} {x}, {x}"), x, below)

    def square_root(self, x: str) -> str:
        """Return the square root, rounded once; NaN for a negative number."""
        return self.new(f"call {self.type} @llvm.sqrt.{self._suffix}({self.type} {x})")

    def sine_and_cosine(self, x: str) -> tuple[str, str]:
        """Return the sine and the cosine, each within 1.5 units in the last place.

        Both are polynomials of the distance to the nearest quarter turn.
        """
        t, i = self.type, self._integer_type
        turns = self.new(f"fmul {t} {x}, {self.constant(2.0 / math.pi)}")
        shifted = self.new(f"fadd {t} {turns}, {self.constant(_ROUNDER)}")
        quadrant = self.new(f"bitcast {t} {shifted} to {i}")
        whole = self.new(f"fsub {t} {shifted}, {self.constant(_ROUNDER)}")
        back = self.negative(whole)
        r = self._fused(back, self.constant(_HALF_PI[0]), x)
        r = self._fused(back, self.constant(_HALF_PI[1]), r)
        square = self.binary("mul", r, r)
        sine = self._fused(self.binary("mul", r, square), self._polynomial(_SINE, square), r)
        cosine = self._fused(square, self._polynomial(_COSINE, square), self.constant(1.0))
        odd = self.new(f"and {i} {quadrant}, {self._integer(1)}")
        swapped = self.new(f"icmp ne {i} {odd}, {self._integer(0)}")
        sine, cosine = self._select(swapped, cosine, sine), self._select(swapped, sine, cosine)
        following = self.new(f"add {i} {quadrant}, {self._integer(1)}")
        return self._flip(sine, quadrant), self._flip(cosine, following)

    def exponential(self, x: str) -> str:
        """Return the exponential within 1.5 units in the last place; 0 and infinity beyond the range of doubles."""
        t = self.type
        high, low = self.constant(_OVERFLOWS), self.constant(_UNDERFLOWS)
        x = self._select(self.new(f"fcmp ogt {t} {x}, {high}"), high, x)
        x = self._select(self.new(f"fcmp olt {t} {x}, {low}"), low, x)
        turns = self.new(f"fmul {t} {x}, {self.constant(1.0 / math.log(2.0))}")
        whole = self._rounded(turns)
        back = self.negative(whole)
        r = self._fused(back, self.constant(_LN_2[0]), x)
        r = self._fused(back, self.constant(_LN_2[1]), r)
        value = self._polynomial(_EXPONENTIAL, r)
        # Two factors, because 2 to the power of -1074 or 1024 is no normal number.
        half = self.new(f"fmul {t} {whole}, {self.constant(0.5)}")
        first = self._rounded(half)
        for power in (first, self.binary("sub", whole, first)):
            value = self.binary("mul", value, self._power_of_two(power))
        return value

    def logarithm(self, x: str) -> str:
        """Return the natural logarithm within 2 units in the last place; NaN below 0, minus infinity at 0."""
        t, i = self.type, self._integer_type
        zero, one = self.constant(0.0), self.constant(1.0)
        small = self.new(f"fcmp olt {t} {x}, {self.constant(2.0**-1022)}")
        normal = self._select(small, self.binary("mul", x, self.constant(2.0**54)), x)
        bits = self.new(f"bitcast {t} {normal} to {i}")
        # The exponent is taken from where the mantissa is 1/sqrt(2), so that what is left lies about 1.
        shifted = self.new(f"sub {i} {bits}, {self._integer(_bits(math.sqrt(0.5)))}")
        exponent = self.new(f"ashr {i} {shifted}, {self._integer(52)}")
        scaled = self.new(f"sub {i} {bits}, {self.new(f'shl {i} {exponent}, {self._integer(52)}')}")
        m = self.new(f"bitcast {i} {scaled} to {t}")
        power = self.new(f"sitofp {i} {exponent} to {t}")
        power = self._select(small, self.binary("sub", power, self.constant(54.0)), power)
        s = self.binary("div", self.binary("sub", m, one), self.binary("add", m, one))
        square = self.binary("mul", s, s)
        tail = self.binary("mul", self.binary("mul", s, square), self._polynomial(_LOGARITHM, square))
        tail = self._fused(power, self.constant(_LN_2[1]), tail)
        value = self._fused(self.constant(2.0), s, tail)
        value = self._fused(power, self.constant(_LN_2[0]), value)
        value = self._select(self.new(f"fcmp oeq {t} {x}, {zero}"), self.constant(-math.inf), value)
        value = self._select(self.new(f"fcmp olt {t} {x}, {zero}"), self.constant(math.nan), value)
        odd = self.new(f"fcmp ueq {t} {x}, {self.constant(math.inf)}")  # or NaN
        return self._select(odd, x, value)

    def transposed(self, rows: Sequence[str]) -> list[str]:
        """Transpose a square block of vectors in registers.

        First neighbouring numbers, then neighbouring pairs, which processors move at the least cost.
        """
        n = self.lanes
        low = [k for lane in range(0, n, 2) for k in (lane, lane + n)]
        even = [k for lane in range(0, n, 4) for k in (lane, lane + 1)]
        even = even + [k + n for k in even]

        def split(registers: list[str], columns: list[int]) -> dict[int, str]:
            if len(registers) == 1:
                return {columns[0]: registers[0]}
            pairs = list(zip(registers[::2], registers[1::2], strict=True))
            return split([self._shuffle(a, b, even) for a, b in pairs], columns[::2]) | split(
                [self._shuffle(a, b, [k + 2 for k in even]) for a, b in pairs], columns[1::2]
            )

        result: dict[int, str] = {}
        for parity in (0, 1):
            order = [k + parity for k in low]
            mixed = [self._shuffle(a, b, order) for a, b in zip(rows[::2], rows[1::2], strict=True)]
            result |= split(mixed, list(range(parity, n, 2)))
        return [result[column] for column in range(n)]

    def _shuffle(self, a: str, b: str, order: Sequence[int]) -> str:
        mask = ", ".join(f"i32 {k}" for k in order)
        return self.new(f"shufflevector {self.type} {a}, {self.type} {b}, <{self.lanes} x i32> <{mask}>")

    def _integer(self, value: int) -> str:
        return str(value) if self.lanes == 1 else "<" + ", ".join([f"i64 {value}"] * self.lanes) + ">"

    def _call(self, name: str, a: str, b: str, c: str) -> str:
        t = self.type
        return self.new(f"call {t} @llvm.{name}.{self._suffix}({t} {a}, {t} {b}, {t} {c})")

    def _fused(self, a: str, b: str, c: str) -> str:
        """Return ``a b + c`` rounded once on every processor."""
        return self._call("fma", a, b, c)

    def _select(self, condition: str, yes: str, no: str) -> str:
        return self.new(f"select {self._flag_type} {condition}, {self.type} {yes}, {self.type} {no}")

    def _rounded(self, x: str) -> str:
        """Return the nearest whole number, below 2 to the power of 51."""
        rounder = self.constant(_ROUNDER)
        return self.binary("sub", self.binary("add", x, rounder), rounder)

    def _power_of_two(self, whole: str) -> str:
        """Return 2 to the power of a whole number that gives a normal number."""
        t, i = self.type, self._integer_type
        shifted = self.new(f"fadd {t} {whole}, {self.constant(_ROUNDER + 1023.0)}")
        bits = self.new(f"shl {i} {self.new(f'bitcast {t} {shifted} to {i}')}, {self._integer(52)}")
        return self.new(f"bitcast {i} {bits} to {t}")

    def _polynomial(self, coefficients: Sequence[float], x: str) -> str:
        value = self.constant(coefficients[-1])
        for coefficient in reversed(coefficients[:-1]):
            value = self._fused(value, x, self.constant(coefficient))
        return value

    def _flip(self, value: str, quadrant: str) -> str:
        """Change the sign of `value` in quadrants 2 and 3."""
        t, i = self.type, self._integer_type
        bit = self.new(f"and {i} {quadrant}, {self._integer(2)}")
        mask = self.new(f"shl {i} {bit}, {self._integer(62)}")
        bits = self.new(f"bitcast {t} {value} to {i}")
        flipped = self.new(f"xor {i} {bits}, {mask}")
        return self.new(f"bitcast {i} {flipped} to {t}")


def _bits(value: float) -> int:
    return int(struct.unpack(">Q", struct.pack(">d", value))[0])


# The names that a kernel imports, and the types of what they take.
SUPPORT = {
    "gather": "ptr, i64, i64, i64, i64, ptr",
    "scatter": "ptr, i64, i64, i64, i64, ptr, ptr, i64",
    "sines_and_cosines": "ptr, i64",
    "clear": "ptr, i64",
}


def support_source(lanes: int, triple: str = "") -> str:
    """Return the LLVM assembly of the functions that kernels import, for one sample as well as for batches.

    ``gather(source, width, first, step, last, slots)`` reads the rows ``first``, ``first + step`` and so on, one for
    each lane, into `width` slots. Rows beyond ``last`` stand for the last one, so that a block need not be full: what
    is computed twice is written twice. ``scatter(slots, width, first, step, last, out, runs, count)`` is its reverse;
    where `step` is the number of lanes, so that all the rows begin at the same place of a line of the cache, it writes
    whole lines past the cache. `runs` are `count` pairs of slots, in ascending order, between which all numbers are
    zero, which is written without looking. ``sines_and_cosines(numbers, count)`` turns the first `count` numbers, which
    fill slots, into sines, in the next `count` numbers, and cosines, in those after. ``clear(numbers, count)`` writes
    zeros.

    Parameters
    ----------
    lanes : int
        Numbers in a slot, more than one.
    triple : str
        Target triple.
    """
    t = f"<{lanes} x double>"
    flags = f"<{lanes} x i1>"
    lines = [f'target triple = "{triple}"'] if triple else []
    lines += [
        *Instructions.declarations(lanes),
        "declare i64 @llvm.smin.i64(i64, i64)",
        f"declare {t} @llvm.masked.load.v{lanes}f64.p0(ptr, i32, {flags}, {t})",
        f"declare void @llvm.masked.store.v{lanes}f64.p0({t}, ptr, i32, {flags})",
        *_gather(lanes),
        *_scatter(lanes),
        *_sines_and_cosines(lanes),
        *_clear(lanes),
        "attributes #0 = { nounwind }",
        "!1 = !{i32 1}",
    ]
    return "\n".join(lines) + "\n"


def _function(head: str, *blocks: list[str]) -> list[str]:
    return [f"define void {head} #0 {{", *(line for block in blocks for line in block), "done:", "  ret void", "}"]


def _turns(
    label: str, body: Instructions, limit: str, step: int, *, before: str, begin: str = "0", after: str = "done"
) -> list[str]:
    """Return a block that is repeated while its counter, ``%c`` and the label, is below a limit, and at least once."""
    counter = f"%c{label}"
    return [
        f"{label}:",
        f"  {counter} = phi i64 [ {begin}, %{before} ], [ {counter}.next, %{label} ]",
        *body.lines,
        f"  {counter}.next = add i64 {counter}, {step}",
        f"  {counter}.more = icmp slt i64 {counter}.next, {limit}",
        f"  br i1 {counter}.more, label %{label}, label %{after}",
    ]


def _rows(it: Instructions, pointer: str) -> list[str]:
    rows = []
    for lane in range(it.lanes):
        row = it.new(f"add i64 %first, {it.new(f'mul i64 %step, {lane}')}")
        row = it.new(f"call i64 @llvm.smin.i64(i64 {row}, i64 %last)")
        rows.append(it.new(f"getelementptr double, ptr {pointer}, i64 {it.new(f'mul i64 {row}, %width')}"))
    return rows


def _lanes_below(it: Instructions, limit: str) -> str:
    """Return the flags of the lanes whose number is below the limit."""
    n = it.lanes
    first = it.new(f"insertelement <{n} x i64> undef, i64 {limit}, i64 0")
    same = it.new(f"shufflevector <{n} x i64> {first}, <{n} x i64> undef, <{n} x i32> zeroinitializer")
    return it.new(f"icmp sgt <{n} x i64> {same}, <{', '.join(f'i64 {lane}' for lane in range(n))}>")


def _gather(lanes: int) -> list[str]:
    start, body = Instructions(lanes, "e"), Instructions(lanes)
    rows = _rows(start, "%source")
    t = body.type
    flags = _lanes_below(body, body.new("sub i64 %width, %cloop"))
    loaded = []
    for row in rows:
        address = body.new(f"getelementptr double, ptr {row}, i64 %cloop")
        given = f"ptr {address}, i32 8, <{lanes} x i1> {flags}, {t} zeroinitializer"
        loaded.append(body.new(f"call {t} @llvm.masked.load.v{lanes}f64.p0({given})"))
    target = body.new(f"getelementptr {t}, ptr %slots, i64 %cloop")
    for lane, value in enumerate(body.transposed(loaded)):
        body.store(value, target, lane)
    return _function(
        "@gather(ptr noalias readonly %source, i64 %width, i64 %first, i64 %step, i64 %last, ptr noalias %slots)",
        ["entry:", *start.lines, "  br label %loop"],
        _turns("loop", body, "%width", lanes, before="entry"),
    )


def _scatter(lanes: int) -> list[str]:
    """Write blocks of columns, transposed, and zeros.

    Past the cache go whole lines, because memory otherwise reads each line before it is written, which takes as long
    again. They begin at the first column of a line, which is the same in all the rows; the columns before and after
    the whole lines go the ordinary way. Only where a block is not whole is a store masked: processors of AMD take 6
    cycles for one, which was half the time of a regressor. Of a run of zeros the blocks that lie in it are written
    without being read and transposed, which is what most of the time of a humanoid's regressor went to: six numbers of
    seven are zero there.
    """
    start, head, tail = (Instructions(lanes, prefix) for prefix in ("e", "h", "r"))
    rows = _rows(start, "%out")

    def moved(it: Instructions, column: str) -> list[tuple[str, str]]:
        source = it.new(f"getelementptr {it.type}, ptr %slots, i64 {column}")
        values = it.transposed([it.load(source, lane) for lane in range(lanes)])
        return [(v, it.new(f"getelementptr double, ptr {r}, i64 {column}")) for r, v in zip(rows, values, strict=True)]

    def masked(it: Instructions, column: str, rest: str) -> None:
        flags = _lanes_below(it, rest)
        for value, address in moved(it, column):
            given = f"{it.type} {value}, ptr {address}, i32 8, <{lanes} x i1> {flags}"
            it.lines.append(f"  call void @llvm.masked.store.v{lanes}f64.p0({given})")

    def written(label: str, how: str, before: str, begin: str) -> list[str]:
        """Return blocks that write all whole blocks of columns from `begin` on: up to each run of zeros, and those."""
        dense, zero = Instructions(lanes, label), Instructions(lanes, f"{label}z")
        for value, address in moved(dense, f"%c{label}"):
            dense.lines.append(f"  store {dense.type} {value}, ptr {address}, {how}")
        for row in rows:
            address = zero.new(f"getelementptr double, ptr {row}, i64 %c{label}zeros")
            zero.lines.append(f"  store {zero.type} {zero.constant(0.0)}, ptr {address}, {how}")
        run, at, reached = f"%{label}.run", f"%{label}.at", f"%{label}.reached"
        return [
            f"{label}run:",
            f"  {run} = phi i64 [ 0, %{before} ], [ {run}.next, %{label}step ]",
            f"  {at} = phi i64 [ {begin}, %{before} ], [ {at}.next, %{label}step ]",
            f"  %{label}.pair = shl i64 {run}, 1",
            f"  %{label}.first = getelementptr i64, ptr %runs, i64 %{label}.pair",
            f"  %{label}.second = getelementptr i64, ptr %{label}.first, i64 1",
            f"  %{label}.zeros = load i64, ptr %{label}.first",
            f"  %{label}.end = load i64, ptr %{label}.second",
            # Behind the last run comes all that is left of whole blocks.
            f"  %{label}.final = icmp eq i64 {run}, %count",
            f"  %{label}.stop = select i1 %{label}.final, i64 %limit, i64 %{label}.zeros",
            f"  %{label}.some = icmp slt i64 {at}, %{label}.stop",
            f"  br i1 %{label}.some, label %{label}, label %{label}behind",
            *_turns(label, dense, f"%{label}.stop", lanes, before=f"{label}run", begin=at, after=f"{label}behind"),
            f"{label}behind:",
            f"  {reached} = phi i64 [ {at}, %{label}run ], [ %c{label}.next, %{label} ]",
            f"  br i1 %{label}.final, label %ends, label %{label}whether",
            f"{label}whether:",
            f"  %{label}.limit = sub i64 %{label}.end, {lanes - 1}",
            f"  %{label}.any = icmp slt i64 {reached}, %{label}.limit",
            f"  br i1 %{label}.any, label %{label}zeros, label %{label}step",
            *_turns(
                f"{label}zeros",
                zero,
                f"%{label}.limit",
                lanes,
                before=f"{label}whether",
                begin=reached,
                after=f"{label}step",
            ),
            f"{label}step:",
            f"  {at}.next = phi i64 [ {reached}, %{label}whether ], [ %c{label}zeros.next, %{label}zeros ]",
            f"  {run}.next = add i64 {run}, 1",
            f"  br label %{label}run",
        ]

    distance = head.new(f"sub i64 0, {head.new(f'ptrtoint ptr {rows[0]} to i64')}")
    columns = head.new(f"lshr i64 {head.new(f'and i64 {distance}, {8 * lanes - 1}')}, 3")
    masked(head, "0", columns)
    masked(tail, "%rest", tail.new("sub i64 %width, %rest"))
    return _function(
        "@scatter(ptr noalias readonly %slots, i64 %width, i64 %first, i64 %step, i64 %last, ptr noalias %out, "
        "ptr noalias readonly %runs, i64 %count)",
        [
            "entry:",
            *start.lines,
            f"  %limit = sub i64 %width, {lanes - 1}",  # where the last whole block begins at the latest
            "  %past = icmp sgt i64 %step, 1",
            "  br i1 %past, label %head, label %choice",
            "choice:",
            "  %whole = icmp sgt i64 %limit, 0",
            "  br i1 %whole, label %nearrun, label %tail",
        ],
        written("near", "align 8", "choice", "0"),
        ["head:", *head.lines, "  br label %farrun"],
        written("far", f"align {8 * lanes}, !nontemporal !1", "head", columns),
        [
            "ends:",
            "  %reached = phi i64 [ %near.reached, %nearbehind ], [ %far.reached, %farbehind ]",
            "  %some = icmp slt i64 %reached, %width",
            "  br i1 %some, label %tail, label %done",
            "tail:",
            "  %rest = phi i64 [ 0, %choice ], [ %reached, %ends ]",
            *tail.lines,
            "  br label %done",
        ],
    )


def _sines_and_cosines(lanes: int) -> list[str]:
    body = Instructions(lanes)
    angles = body.new("getelementptr double, ptr %numbers, i64 %cloop")
    sines = body.new(f"getelementptr double, ptr {angles}, i64 %count")
    cosines = body.new(f"getelementptr double, ptr {sines}, i64 %count")
    sine, cosine = body.sine_and_cosine(body.load(angles, 0))
    body.store(sine, sines, 0)
    body.store(cosine, cosines, 0)
    return _function(
        "@sines_and_cosines(ptr noalias %numbers, i64 %count)",
        ["entry:", "  br label %loop"],
        _turns("loop", body, "%count", lanes, before="entry"),
    )


def _clear(lanes: int) -> list[str]:
    whole, single = Instructions(lanes), Instructions(1, "s")
    address = whole.new("getelementptr double, ptr %numbers, i64 %cwhole")
    whole.lines.append(f"  store {whole.type} {whole.constant(0.0)}, ptr {address}, align 8")
    single.store(single.constant(0.0), "%numbers", "%csingle")
    return _function(
        "@clear(ptr noalias %numbers, i64 %count)",
        [
            "entry:",
            f"  %limit = sub i64 %count, {lanes - 1}",
            "  %any = icmp sgt i64 %limit, 0",
            "  br i1 %any, label %whole, label %ends",
        ],
        _turns("whole", whole, "%limit", lanes, before="entry", after="ends"),
        [
            "ends:",
            "  %rest = phi i64 [ 0, %entry ], [ %cwhole.next, %whole ]",
            "  %some = icmp slt i64 %rest, %count",
            "  br i1 %some, label %single, label %done",
        ],
        _turns("single", single, "%count", 1, before="ends", begin="%rest"),
    )
