"""Calls of kernels: threads, single samples, pointers, and arrays that do not fit."""

import contextlib
import ctypes
import gc
import os
import shutil
import subprocess
import sys
import threading
import time
import weakref
from functools import cache

import numpy as np
import pytest
from small_kernels import NO_CACHE, PARAMETERS, expected, motions, pendulum, unusual

from steelyard.errors import InputError
from steelyard.graph import Argument, Function, Graph, Kernel, Output, machine
from steelyard.graph import kernel as kernel_module
from steelyard.graph.machine import batch_lanes


@pytest.fixture(scope="module")
def kernel():
    return Kernel(pendulum(), cache=NO_CACHE)


@pytest.mark.parametrize("threads", [2, 3, 7])
@pytest.mark.parametrize("count", [1, 9, 511, 512, 1000, 4099])
def test_threads_compute_the_same(threads, count, monkeypatch):
    monkeypatch.setattr(kernel_module, "_WORTHWHILE", 1.0)
    shared = Kernel(pendulum(), cache=NO_CACHE)
    motion = motions(count)
    alone = shared(motion, PARAMETERS)
    out = np.full_like(alone, np.nan)
    assert shared(motion, PARAMETERS, out=out, threads=threads) is out
    assert out.tolist() == alone.tolist()
    np.testing.assert_allclose(alone, expected(motion), rtol=1e-12, atol=1e-13)


@pytest.mark.usefixtures("other_objects_aside")
def test_what_threads_write_lives_as_long_as_their_work(monkeypatch):
    """Whoever waits for them may be interrupted."""
    monkeypatch.setattr(kernel_module, "_WORTHWHILE", 1.0)
    shared = Kernel(pendulum(), cache=NO_CACHE)
    going_on, results = threading.Event(), []
    compute = shared.batch_function

    def slow(*given):
        if threading.current_thread() is not threading.main_thread():
            going_on.wait(10.0)
        compute(*given)

    def interrupted(others):
        pending.extend(others)
        raise KeyboardInterrupt

    def empty(shape):
        result = np.empty(shape)
        results.append(weakref.ref(result))
        return result

    pending = []
    shared.__dict__["batch_function"] = slow
    monkeypatch.setattr(kernel_module, "wait", interrupted)
    monkeypatch.setattr(Kernel, "empty", staticmethod(empty))
    with contextlib.suppress(KeyboardInterrupt):
        shared(motions(4099), PARAMETERS, threads=2)
    gc.collect()
    (result,) = results
    assert result() is not None
    going_on.set()
    pending.pop().result(10.0)
    pending.clear()
    for _ in range(100):  # the thread forgets its work a moment after it told the result
        if result() is None:
            break
        time.sleep(0.01)
    assert result() is None


def test_only_large_batches_are_shared(monkeypatch):
    shares = []
    monkeypatch.setattr(Kernel, "_share", lambda kernel, pieces, *_: shares.append(pieces))
    shared = Kernel(pendulum(), cache=NO_CACHE)
    for count in (2, 1000, 1_000_000):
        shared(motions(count), PARAMETERS, threads=3)
    assert shares == [3]


@pytest.mark.usefixtures("other_objects_aside")
@pytest.mark.parametrize("lanes", [1, batch_lanes()])
def test_functions_that_a_kernel_imports_live_as_long_as_its_code(lanes, monkeypatch):
    """Two threads at the same time each make a processor and its support, only one of which is kept by the caches."""
    made = cache(lambda lanes: machine.Machine(lanes))
    monkeypatch.setattr(machine, "host_machine", made)
    monkeypatch.setattr(kernel_module, "host_machine", made)
    new = Kernel(pendulum(), cache=NO_CACHE)
    function = {1: "single_function", batch_lanes(): "batch_function"}[lanes]
    assert getattr(new, function)
    support = weakref.ref(made(lanes).support)
    made.cache_clear()
    gc.collect()
    assert support() is not None
    del new
    gc.collect()
    assert support() is None


def test_many_callers_of_a_new_kernel():
    new = Kernel(pendulum(), cache=NO_CACHE)
    motion = motions(3000)
    results = [None] * 6

    def call(k):
        results[k] = new(motion[k:], PARAMETERS, threads=1 + k % 3)

    threads = [threading.Thread(target=call, args=(k,)) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for k, result in enumerate(results):
        np.testing.assert_allclose(result, expected(motion[k:]), rtol=1e-12, atol=1e-13)


def test_threads_that_compile_and_that_ask_for_sizes_do_not_wait_for_each_other(monkeypatch):
    new = Kernel(pendulum(), cache=NO_CACHE)
    loading, known = threading.Event(), threading.Event()
    load = Kernel._load

    def slow(kernel, lanes):
        loading.set()
        known.wait(1.0)
        return load(kernel, lanes)

    monkeypatch.setattr(Kernel, "_load", slow)

    def sizes():
        loading.wait(10.0)
        assert new.signature.size == 2
        known.set()

    targets = (sizes, lambda: new.batch_address)
    threads = [threading.Thread(target=target, daemon=True) for target in targets]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10.0)
    assert not any(thread.is_alive() for thread in threads)
    assert known.is_set()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are not forked here")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_process_that_is_forked_while_another_thread_compiles_can_compile():
    """In a process of its own, since libraries that other tests load warn of forks."""
    program = """
import multiprocessing, threading, time
from steelyard.graph import Argument, Function, Graph, Kernel, Output, machine

graph = Graph()
function = Function("f", (Argument("x", 1),), (Output("y", (), (2.0 * graph.inputs("x", 1)[0],)),))
held = threading.Event()

def hold():
    with machine.LOCK:
        held.set()
        time.sleep(0.2)

thread = threading.Thread(target=hold)
thread.start()
held.wait(10.0)
child = multiprocessing.get_context("fork").Process(target=lambda: Kernel(function).batch_address)
child.start()
thread.join()
child.join(20.0)
print(child.exitcode)
child.kill()
"""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stdout == "0\n", done.stderr


@pytest.mark.parametrize("threads", [0, -1, 1.5, None])
def test_a_number_of_threads_that_is_none(kernel, threads):
    with pytest.raises(InputError, match="threads must be a positive integer"):
        kernel(motions(3), PARAMETERS, threads=threads)


def test_arrays_that_do_not_fit(kernel):
    motion = motions(4)
    with pytest.raises(InputError, match=r"reads 2 arrays \(motion, parameters\), got 1"):
        kernel(motion)
    with pytest.raises(InputError, match=r"motion must have shape \(S, 3\), got \(3,\)"):
        kernel(motion[0], PARAMETERS)
    with pytest.raises(InputError, match=r"parameters must have shape \(2,\), got \(1, 2\)"):
        kernel(motion, PARAMETERS[None])
    with pytest.raises(InputError, match=r"out must be .* shape \(4, 2\), got float32"):
        kernel(motion, PARAMETERS, out=np.empty((4, 2), dtype=np.float32))


def test_batches_of_different_sizes_are_refused():
    g = Graph()
    sum_ = Function("f", (Argument("a", 1), Argument("b", 1)), (Output("y", (), (g.input("a[0]") + g.input("b[0]"),)),))
    with pytest.raises(InputError, match="b must have as many rows as the arrays before it, 5, got 4"):
        Kernel(sum_, cache=NO_CACHE)(np.zeros((5, 1)), np.zeros((4, 1)))


@pytest.mark.parametrize("count", [1, 9])
def test_arrays_of_any_kind_are_read(kernel, count):
    motion = motions(count)
    kernel(motion, PARAMETERS)
    for kind in unusual(motion):
        np.testing.assert_allclose(kernel(kind, PARAMETERS), expected(motion), rtol=1e-12)
        np.testing.assert_allclose(kernel.sample(kind[0], PARAMETERS), expected(motion)[0], rtol=1e-12)
    whole = np.arange(6).reshape(2, 3)
    np.testing.assert_allclose(kernel(whole, PARAMETERS), expected(whole), rtol=1e-12)


def test_single_samples(kernel):
    motion = motions(5)
    for row, values in zip(motion, expected(motion), strict=True):
        np.testing.assert_allclose(kernel.sample(row, PARAMETERS), values, rtol=1e-12)
        np.testing.assert_allclose(kernel(row[None], PARAMETERS)[0], values, rtol=1e-12)
        out = np.empty(2)
        assert kernel.sample(row, PARAMETERS, out=out) is out
        np.testing.assert_allclose(out, values, rtol=1e-12)
        np.testing.assert_allclose(kernel.sample(row.tolist(), PARAMETERS.tolist(), out=out), values, rtol=1e-12)


def test_single_samples_that_do_not_fit(kernel):
    motion = motions(2)
    with pytest.raises(InputError, match=r"motion must have shape \(3,\), got \(1, 3\)"):
        kernel.sample(motion[:1], PARAMETERS)
    with pytest.raises(InputError, match=r"motion must have shape \(3,\), got \(2,\)"):
        kernel.sample(motion[0, :2], PARAMETERS)
    with pytest.raises(InputError, match=r"parameters must have shape \(2,\), got \(3,\)"):
        kernel.sample(motion[0], np.ones(3))
    with pytest.raises(InputError, match="reads 2 arrays"):
        kernel.sample(motion[0])
    with pytest.raises(InputError, match="reads 2 arrays"):
        kernel.sample(motion[0], PARAMETERS, PARAMETERS)
    for out in (np.empty(3), np.empty((1, 2)), np.empty(2, dtype=np.float32)):
        with pytest.raises(InputError, match="out must be"):
            kernel.sample(motion[0], PARAMETERS, out=out)


def test_single_samples_of_many_callers_and_into_any_array(kernel):
    motion = motions(400)
    results = np.full((2, 400, 2), np.nan)

    def call(k):
        for s in range(k, 400, 4):
            kernel.sample(motion[s], PARAMETERS, out=results[0, s])
            kernel.sample(motion[s], PARAMETERS, out=results[1, s, ::-1])

    threads = [threading.Thread(target=call, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    np.testing.assert_allclose(results[0], expected(motion), rtol=1e-12)
    assert results[1, :, ::-1].tolist() == results[0].tolist()


def test_the_result_of_a_single_sample_is_not_overwritten(kernel):
    motion = motions(2)
    first = kernel.sample(motion[0], PARAMETERS)
    kernel.sample(motion[1], PARAMETERS)
    np.testing.assert_allclose(first, expected(motion)[0], rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 3, 13])
def test_a_bound_call_follows_what_stands_in_its_arrays_and_keeps_them(count):
    kernel = Kernel(pendulum(), cache=NO_CACHE)
    motion, parameters, out = np.empty((count, 3)), np.array(PARAMETERS), np.empty((count, 2))
    call, alive = kernel.bound(motion, parameters, out), weakref.ref(parameters)
    del kernel, parameters
    gc.collect()
    assert alive() is not None
    for own in motions(2 * count).reshape(2, count, 3):
        motion[...] = own
        call()
        np.testing.assert_allclose(out, expected(own), rtol=1e-12)


@pytest.mark.parametrize("count", [1, 3, 8, 13])
def test_the_functions_behind_a_kernel_are_c_functions(kernel, count):
    motion, out = motions(count), np.full((count + 1, 2), np.nan)
    for function in (kernel.single_function, kernel.batch_function):
        out[:] = np.nan
        function(count, motion.ctypes.data, PARAMETERS.ctypes.data, out.ctypes.data, 0)
        np.testing.assert_allclose(out[:count], expected(motion), rtol=1e-12)
        assert np.isnan(out[count]).all()
    assert batch_lanes() in (4, 8)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs a C compiler")
def test_a_control_loop_in_c_calls_the_machine_code(kernel, tmp_path):
    (tmp_path / "loop.c").write_text(
        "#include <stdint.h>\n"
        "typedef void kernel(int64_t, const double *, const double *, double *, int64_t);\n"
        "double loop(kernel *run, const double *parameters, int steps) {\n"
        "  double motion[3] = {1.0, 0.0, 0.0}, out[2], sum = 0.0;\n"
        "  for (int k = 0; k < steps; k++) { run(1, motion, parameters, out, 1); sum += out[0]; motion[0] += 0.01; }\n"
        "  return sum;\n}\n"
    )
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", "loop.so", "loop.c"], cwd=tmp_path, check=True)
    loop = ctypes.CDLL(str(tmp_path / "loop.so")).loop
    loop.argtypes, loop.restype = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int), ctypes.c_double
    result = loop(kernel.function_pointer, PARAMETERS.ctypes.data, 100)
    assert result == pytest.approx(sum(9.81 * np.sin(1.0 + 0.01 * k) for k in range(100)), rel=1e-12)
