"""Algorithms on many problems side by side, against NumPy."""

import ctypes

import numpy as np

from steelyard.graph.loops import Code
from steelyard.graph.machine import address_of, batch_lanes, host_machine

SIZE = 7


def call(code: Code, name: str, *arrays: np.ndarray) -> None:
    loaded = host_machine(code.lanes).load_source(code.text, (name,), {})
    function = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * len(arrays))(loaded.addresses[name])
    function(*(address_of(array) for array in arrays))


def new_code() -> Code:
    return Code(batch_lanes(), host_machine(batch_lanes()).triple)


def test_products_of_a_matrix_with_vectors_side_by_side() -> None:
    code = new_code()
    with code.function("product", "words", "matrix", "given", "out") as (words, matrix, given, out):
        size = words.integer(0)
        for row in code.range(size):
            with code.fold([0.0], size) as loop:
                value = given[loop.index] * matrix.shared(row * size + loop.index)
                loop.next = [loop.values[0] + value]
            out[row] = loop.values[0]
    random = np.random.default_rng(0)
    matrix, given = random.normal(size=(SIZE, SIZE)), random.normal(size=(SIZE, code.lanes))
    out = np.zeros_like(given)
    call(code, "product", np.array([SIZE]), matrix, given, out)
    np.testing.assert_allclose(out, matrix @ given, rtol=1e-14, atol=1e-14)


def test_roots_by_newtons_method_until_all_are_found() -> None:
    """Those that are found stay as they are; numbers below zero, and none at all, are left out."""
    code = new_code()
    with code.function("roots", "given", "out") as (given, out):
        value = given[0]
        going = value > 0.0
        out[0] = going.choose(value, -1.0)
        with code.fold([], 60):
            code.leave(going & ((out[0] * out[0] - value).size() > value * 1e-14))
            better = 0.5 * (out[0] + value / out[0])
            out[0] = (going & better.is_finite()).choose(better, out[0])
    given = np.resize([4.0, 1e-8, 9e6, -2.0, np.nan, 2.0], code.lanes)
    out = np.zeros_like(given)
    call(code, "roots", given, out)
    with np.errstate(invalid="ignore"):
        np.testing.assert_allclose(out, np.where(given > 0.0, np.sqrt(given), -1.0), rtol=1e-14)


def test_numbers_that_all_problems_share_and_conditions() -> None:
    """Bits of bytes that are set, rows that hold one of them, and the sum over all columns of these."""
    code = new_code()
    with code.function("chosen", "used", "rows", "out", "counts", integers="width") as given:
        used, rows, out, counts, width = given
        bits = used.bytes_set(0)
        counts.put_integer(0, bits.count("ctpop"))
        counts.put_integer(1, bits.count("cttz"))
        counts.put_integer(2, code.known(63) - bits.count("ctlz"))
        counts.put_integer(3, width.below(5))
        for k in code.range(64):
            with code.when(bits.bits("lshr", k).bits("and", 1).holds("eq", 1) & ~(rows.at(k)[0] < -9.0).any()):
                out.put(0, out.shared(0) + code.total(rows[k]) * width.number())
                code.copy(out.shared_at(1), rows.at(k), code.lanes)
        code.leave_when(width.holds("sgt", 5) | width.holds("eq", 3))
        counts.put_integer(4, 1)
    random = np.random.default_rng(3)
    used, rows = random.random(64) < 0.4, random.normal(size=(64, code.lanes))
    used[:8], used[58:], used[[8, 57]] = False, False, True
    rows[8, 1] = -10.0
    loaded = host_machine(code.lanes).load_source(code.text, ("chosen",), {})
    function = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4, ctypes.c_int64)(loaded.addresses["chosen"])
    for width, goes_on in ((3, 0), (4, 1), (6, 0)):
        out, counts = np.zeros(1 + code.lanes), np.zeros(5, np.int64)
        function(*(address_of(array) for array in (used, rows, out, counts)), width)
        chosen = used.copy()
        chosen[8] = False
        np.testing.assert_allclose(out[0], width * rows[chosen].sum(), rtol=1e-12)
        np.testing.assert_array_equal(out[1:], rows[57])
        assert counts.tolist() == [used.sum(), 8, 57, min(width, 5), goes_on]
