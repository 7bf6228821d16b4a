"""LLVM assembly that all kernels share: samples into the slots of a workspace and back, and sines and cosines."""

from __future__ import annotations

from .instructions import Instructions

__all__ = ["SUPPORT", "support_source"]

# The names that a kernel imports, and the types of what they take.
SUPPORT = {
    "gather": "ptr, i64, i64, i64, ptr",
    "scatter": "ptr, i64, i64, i64, ptr",
    "columns": "ptr, i64, i64, i64, ptr, i64",
    "sines_and_cosines": "ptr, i64",
    "clear": "ptr, i64",
}


def support_source(lanes: int, triple: str = "") -> str:
    """Return the LLVM assembly of the functions that a kernel imports.

    ``gather(source, width, first, last, slots)`` reads the rows ``first`` to ``first + lanes - 1`` into `width` slots.
    Rows beyond ``last`` stand for the last one, so that a block need not be full: what is computed twice is written
    twice. ``scatter(slots, width, first, last, out)`` is its reverse; ``columns(slots, width, first, last, out,
    stride)`` writes each slot to a row of its own. ``sines_and_cosines(slots, count)`` turns the first `count` slots
    into sines, in the next `count` slots, and cosines, in those after. ``clear(slots, count)`` writes zeros.

    Parameters
    ----------
    lanes : int
    triple : str
        Target triple.

    Returns
    -------
    str
    """
    lines = [f'target triple = "{triple}"'] if triple else []
    lines += Instructions.declarations(lanes)
    if lanes > 1:
        t = f"<{lanes} x double>"
        flags = f"<{lanes} x i1>"
        lines += [
            "declare i64 @llvm.smin.i64(i64, i64)",
            f"declare {t} @llvm.masked.load.v{lanes}f64.p0(ptr, i32, {flags}, {t})",
            f"declare void @llvm.masked.store.v{lanes}f64.p0({t}, ptr, i32, {flags})",
            *_gather(lanes),
            *_scatter(lanes),
            *_columns(lanes),
        ]
    lines += [*_sines_and_cosines(lanes), *_clear(lanes)]
    lines.append("attributes #0 = { nounwind }")
    return "\n".join(lines) + "\n"


def _loop(head: str, start: Instructions, body: Instructions, count: str, step: int) -> list[str]:
    """Return a function with a loop over ``%c``; it must run at least once."""
    return [
        f"define void {head} #0 {{",
        "entry:",
        *start.lines,
        "  br label %loop",
        "loop:",
        "  %c = phi i64 [ 0, %entry ], [ %following, %loop ]",
        *body.lines,
        f"  %following = add i64 %c, {step}",
        f"  %more = icmp slt i64 %following, {count}",
        "  br i1 %more, label %loop, label %done",
        "done:",
        "  ret void",
        "}",
    ]


def _rows(it: Instructions, pointer: str) -> list[str]:
    rows = []
    for lane in range(it.lanes):
        row = it.new(f"add i64 %first, {lane}")
        row = it.new(f"call i64 @llvm.smin.i64(i64 {row}, i64 %last)")
        rows.append(it.new(f"getelementptr double, ptr {pointer}, i64 {it.new(f'mul i64 {row}, %width')}"))
    return rows


def _lanes_below(it: Instructions, limit: str) -> str:
    """Return the flags of the lanes whose number is below the limit."""
    n = it.lanes
    first = it.new(f"insertelement <{n} x i64> undef, i64 {limit}, i64 0")
    same = it.new(f"shufflevector <{n} x i64> {first}, <{n} x i64> undef, <{n} x i32> zeroinitializer")
    return it.new(f"icmp sgt <{n} x i64> {same}, <{', '.join(f'i64 {lane}' for lane in range(n))}>")


def _masked_store(it: Instructions, value: str, address: str, flags: str) -> None:
    n, t = it.lanes, it.type
    it.lines.append(f"  call void @llvm.masked.store.v{n}f64.p0({t} {value}, ptr {address}, i32 8, <{n} x i1> {flags})")


def _gather(lanes: int) -> list[str]:
    start, body = Instructions(lanes, "e"), Instructions(lanes)
    rows = _rows(start, "%source")
    t = body.type
    flags = _lanes_below(body, body.new("sub i64 %width, %c"))
    loaded = []
    for row in rows:
        address = body.new(f"getelementptr double, ptr {row}, i64 %c")
        given = f"ptr {address}, i32 8, <{lanes} x i1> {flags}, {t} zeroinitializer"
        loaded.append(body.new(f"call {t} @llvm.masked.load.v{lanes}f64.p0({given})"))
    target = body.new(f"getelementptr {t}, ptr %slots, i64 %c")
    for lane, value in enumerate(body.transposed(loaded)):
        body.store(value, target, lane)
    head = "@gather(ptr noalias readonly %source, i64 %width, i64 %first, i64 %last, ptr noalias %slots)"
    return _loop(head, start, body, "%width", lanes)


def _scatter(lanes: int) -> list[str]:
    start, body = Instructions(lanes, "e"), Instructions(lanes)
    rows = _rows(start, "%out")
    flags = _lanes_below(body, body.new("sub i64 %width, %c"))
    source = body.new(f"getelementptr {body.type}, ptr %slots, i64 %c")
    values = body.transposed([body.load(source, lane) for lane in range(lanes)])
    for row, value in zip(rows, values, strict=True):
        _masked_store(body, value, body.new(f"getelementptr double, ptr {row}, i64 %c"), flags)
    head = "@scatter(ptr noalias readonly %slots, i64 %width, i64 %first, i64 %last, ptr noalias %out)"
    return _loop(head, start, body, "%width", lanes)


def _columns(lanes: int) -> list[str]:
    start, body = Instructions(lanes, "e"), Instructions(lanes)
    rest = start.new(f"add i64 {start.new('sub i64 %last, %first')}, 1")
    flags = _lanes_below(start, rest)
    index = body.new(f"add i64 {body.new('mul i64 %c, %stride')}, %first")
    _masked_store(body, body.load("%slots", "%c"), body.new(f"getelementptr double, ptr %out, i64 {index}"), flags)
    head = "@columns(ptr noalias readonly %slots, i64 %width, i64 %first, i64 %last, ptr noalias %out, i64 %stride)"
    return _loop(head, start, body, "%width", 1)


def _sines_and_cosines(lanes: int) -> list[str]:
    start, body = Instructions(lanes, "e"), Instructions(lanes)
    sines = start.new(f"getelementptr {start.type}, ptr %slots, i64 %count")
    cosines = start.new(f"getelementptr {start.type}, ptr {sines}, i64 %count")
    sine, cosine = body.sine_and_cosine(body.load("%slots", "%c"))
    body.store(sine, sines, "%c")
    body.store(cosine, cosines, "%c")
    return _loop("@sines_and_cosines(ptr noalias %slots, i64 %count)", start, body, "%count", 1)


def _clear(lanes: int) -> list[str]:
    start, body = Instructions(lanes, "e"), Instructions(lanes)
    body.store(body.constant(0.0), "%slots", "%c")
    return _loop("@clear(ptr noalias %slots, i64 %count)", start, body, "%count", 1)
