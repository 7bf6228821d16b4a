"""Results that are written past the cache, and the memory that large ones use again."""

import gc
import sys
import threading

import numpy as np
import pytest
from small_kernels import NO_CACHE, kernel_of, outputs_of

from steelyard.graph import Argument, Graph, evaluate, large_arrays
from steelyard.graph import kernel as kernel_module

recycles = pytest.mark.skipif(sys.platform != "linux", reason="memory is used again on Linux only")


@pytest.mark.parametrize(("width", "lanes"), [(25, 8), (32, 8), (33, 4), (46, 8), (46, 4), (64, 4), (71, 8)])
def test_past_the_cache_and_through_it_are_the_same(width, lanes, monkeypatch):
    monkeypatch.setattr(kernel_module, "batch_lanes", lambda: lanes)
    require_the_same(outputs_of(Graph(), width))


@pytest.mark.parametrize("lanes", [2, 4, 8])
@pytest.mark.parametrize(
    "zeros", [{0: 16}, {1: 15, 20: 17}, {48: 16}, {9: 8, 17: 40}, {0: 33, 40: 24}, {0: 63}, {0: 64}]
)
def test_runs_of_zeros_are_written_as_zeros(zeros, lanes, monkeypatch):
    """They begin at the keys, and are so long; also where a row is whole pages of the memory."""
    monkeypatch.setattr(kernel_module, "batch_lanes", lambda: lanes)
    for width in (64, 67):
        graph = Graph()
        outputs = outputs_of(graph, width)
        for begin, length in zeros.items():
            outputs[begin : begin + length] = [graph.constant(0.0)] * length
        require_the_same(outputs)


def require_the_same(outputs):
    """Compute outputs through the cache and past it, wherever in a line of it they begin, and beside NumPy."""
    width = len(outputs)
    kernel = kernel_of([Argument("x", 3), Argument("p", 2, uniform=True)], outputs)
    random = np.random.default_rng(width)
    p = random.normal(size=2)
    for count in (1, 8, 63, 64, 65, 130, 200):
        x = random.normal(size=(count, 3))
        names = {f"x[{k}]": x[:, k] for k in range(3)} | {f"p[{k}]": p[k] for k in range(2)}
        expected = np.array([np.broadcast_to(v, (count,)) for v in evaluate(outputs, names)]).T
        for first in range(8):  # where in a line of the cache the result begins
            memory_of_both = np.full((2, 8 + count * width + 8), np.nan)
            for whole, cached in zip(memory_of_both, (1, -1), strict=True):
                out = whole[first : first + count * width]
                kernel.batch_function(count, x.ctypes.data, p.ctypes.data, out.ctypes.data, cached)
                assert np.isnan(whole[:first]).all()
                assert np.isnan(whole[first + count * width :]).all()
            assert memory_of_both[0].tobytes() == memory_of_both[1].tobytes()
            np.testing.assert_allclose(out.reshape(count, width), expected, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_large_results_are_written_past_the_cache(threads, monkeypatch):
    monkeypatch.setattr(kernel_module, "_WORTHWHILE", 1.0)
    graph = Graph()
    kernel = kernel_of([Argument("x", 3), Argument("p", 2, uniform=True)], outputs_of(graph, 41))
    x, p = np.random.default_rng(2).normal(size=(1003, 3)), np.array([0.3, -2.0])
    alone = kernel(x, p)
    ways = []
    compute = kernel.batch_function
    monkeypatch.setattr(kernel_module, "_LARGE", alone.nbytes)
    kernel.__dict__["batch_function"] = lambda *given: ways.append(given[-1]) or compute(*given)
    out = np.full_like(alone, np.nan)
    assert kernel(x, p, out=out, threads=threads).tobytes() == alone.tobytes()
    assert set(ways) == {-1}
    kernel(x[1:], p)
    assert ways[-1] == 1


@pytest.mark.usefixtures("other_objects_aside")
@recycles
def test_memory_is_used_again_when_no_view_of_it_is_left():
    shape = (300, 1001)
    first = large_arrays.large_array(shape)
    address, view = first.ctypes.data, first[7:, ::3]
    first[...] = 1.0
    del first
    other = large_arrays.large_array(shape)
    other[...] = 2.0
    assert other.ctypes.data != address
    assert (view == 1.0).all()
    del view
    gc.collect()
    assert large_arrays.large_array(shape).ctypes.data == address


@recycles
def test_little_memory_is_kept(monkeypatch):
    monkeypatch.setattr(large_arrays, "_IDLE", [])
    arrays = [large_arrays.large_array((k << 18,)) for k in (1, 2, 5, 9)]  # 2, 4, 10 and 18 MiB
    while arrays:
        del arrays[0]
    assert sorted(block.size >> 20 for block in large_arrays._IDLE) == [10, 18]
    assert large_arrays.large_array((5 << 17,)).ctypes.data not in {block.address for block in large_arrays._IDLE}
    monkeypatch.setattr(large_arrays, "_most_idle", lambda: 12 << 20)
    del large_arrays._IDLE[:]
    arrays = [large_arrays.large_array((k << 18,)) for k in (4, 3, 2)]
    large = large_arrays.large_array((9 << 18,))
    assert large.flags.owndata
    while arrays:
        del arrays[0]
    assert [block.size >> 20 for block in large_arrays._IDLE] == [6, 4]


@recycles
def test_threads_that_take_and_give_back(monkeypatch):
    monkeypatch.setattr(large_arrays, "_IDLE", [])
    wrong = []

    def work(number):
        for turn in range(200):
            array = large_arrays.large_array((40_000 + turn,))
            array[::500] = number
            wrong.append(not (array[::500] == number).all())

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not any(wrong)
    assert len(large_arrays._IDLE) <= large_arrays._MOST_BLOCKS


@recycles
def test_where_the_system_gives_no_huge_pages(monkeypatch):
    def refuse(*_, **__):
        raise OSError(12, "Cannot allocate memory")

    monkeypatch.setattr(large_arrays, "_IDLE", [])
    monkeypatch.setattr(large_arrays.mmap, "mmap", refuse)
    assert large_arrays.large_array((300, 1001)).flags.owndata


def test_without_such_memory_arrays_come_from_numpy(monkeypatch):
    monkeypatch.setattr(large_arrays, "_most_idle", lambda: 0)
    assert large_arrays.large_array((300, 1001)).flags.owndata
    assert kernel_of([Argument("x", 3)], outputs_of_one(), cache=NO_CACHE)(np.zeros((1 << 16, 3))).shape == (1 << 16, 1)


def outputs_of_one():
    return [Graph().inputs("x", 3)[1]]


@recycles
def test_free_memory_goes_back_to_the_system() -> None:
    def held() -> int:
        with open("/proc/self/status") as file:
            return next(int(line.split()[1]) for line in file if line.startswith("RssAnon"))

    if large_arrays._trim() is None:
        pytest.skip("the C library keeps no free memory")
    arrays = [np.ones(12_000) for _ in range(1_000)]  # 96 kB each, too small to be mapped one by one
    above = arrays[-1]
    del arrays
    before = held()
    large_arrays.return_free_memory()
    assert before - held() > 50_000
    assert above.all()
