"""Work that is shared among threads."""

import inspect
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, NoReturn

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController, threadpool_limits

import steelyard as sy
from steelyard import estimators
from steelyard.dynamics.threads import in_threads, in_turns, one_thread, require_wanted, serial
from steelyard.estimators.plausible_fit import plausible_fit, tried_prior
from steelyard.files.advance import tell, watched
from steelyard.fleet.siblings import compare_siblings
from steelyard.identification.mistakes import find_mistakes


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_results_come_in_the_order_of_the_items(threads: int) -> None:
    def slowly(item: int) -> int:
        time.sleep(0.002 * (item % 3))
        return item * item

    with threadpool_limits(threads, "blas"):
        assert in_threads(slowly, range(20)) == [k * k for k in range(20)]
        assert in_threads(slowly, []) == []


def test_an_error_ends_the_work_and_is_told() -> None:
    done: list[int] = []

    def some(item: int) -> None:
        if item == 3:
            raise ArithmeticError("the fourth")
        time.sleep(0.001)
        done.append(item)

    with threadpool_limits(2, "blas"), pytest.raises(ArithmeticError, match="the fourth"):
        in_threads(some, range(1000))
    count = len(done)
    assert count < 20
    time.sleep(0.01)
    assert len(done) == count  # nobody works on


def test_shared_work_may_share_work() -> None:
    def outer(item: int) -> list[int]:
        return in_threads(lambda k: item + k, range(5))

    with threadpool_limits(2, "blas"):
        assert in_threads(outer, range(6)) == [[item + k for k in range(5)] for item in range(6)]


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("count", [0, 1, 2, 7, 8])
def test_turns_are_in_order_and_each_is_in_one_thread(threads: int, count: int) -> None:
    places: dict[int, set[int]] = {}
    begun = [threading.Event() for _ in range(count)]

    def slowly(number: int) -> int:
        begun[number].set()
        if threads > 1 and number ^ 1 < count:  # on a busy machine one thread could do both, one after the other
            assert begun[number ^ 1].wait(30.0)
        places[number] = set(in_threads(lambda _: time.sleep(0.001) or threading.get_ident(), range(4)))
        return number * number

    with threadpool_limits(threads, "blas"):
        assert list(in_turns(slowly, count)) == [k * k for k in range(count)]
    paired = [places[number] for number in range(count - count % 2)]  # the last of an odd number is alone
    assert all(len(found) == 1 for found in paired)
    assert len(set().union(*paired)) == min(threads, 2, len(paired))


def test_of_two_that_work_at_a_time_one_tells_how_far_it_has_come() -> None:
    told: list[float] = []
    with threadpool_limits(2, "blas"), watched(lambda what, done, total, unit: told.append(done)):
        list(in_turns(lambda number: tell("reading", number, 4, "rows"), 4))
    assert sorted(told) == [0, 2]


@pytest.mark.parametrize("interrupted", [0, 1, 2])
def test_an_interrupt_of_one_thread_ends_the_others_soon(interrupted: int) -> None:
    """Polars raises Ctrl-C in the thread that it works for, while the caller may wait for the work of another."""

    def work(number: int) -> None:
        if number == interrupted:
            raise KeyboardInterrupt
        begun = time.monotonic()
        while number >= interrupted - 1 and time.monotonic() < begun + 60.0:
            require_wanted()
            time.sleep(0.001)

    begun = time.monotonic()
    with threadpool_limits(2, "blas"), pytest.raises(KeyboardInterrupt):
        list(in_turns(work, 6))
    assert time.monotonic() < begun + 30.0


def test_whoever_takes_no_more_turns_ends_the_work_on_them() -> None:
    begun, ended = [], []

    def work(number: int) -> int:
        begun.append(number)
        try:
            while number:
                require_wanted()
                time.sleep(0.001)
        finally:
            ended.append(number)
        return number

    with threadpool_limits(2, "blas"):
        turns = in_turns(work, 100)
        assert next(turns) == 0
        turns.close()
    assert sorted(begun) == sorted(ended)
    assert len(begun) <= 4


def test_an_error_comes_in_its_turn() -> None:
    def work(number: int) -> int:
        if number == 2:
            raise ArithmeticError("the third")
        return number

    with threadpool_limits(2, "blas"):
        turns = in_turns(work, 9)
        assert [next(turns), next(turns)] == [0, 1]
        with pytest.raises(ArithmeticError, match="the third"):
            next(turns)


def test_work_stays_in_its_thread_where_others_have_the_processors() -> None:
    def where(_: int) -> int:
        time.sleep(0.002)
        return threading.get_ident()

    with threadpool_limits(2, "blas"), serial():
        assert set(in_threads(where, range(6))) == {threading.get_ident()}


def test_two_callers_share_the_threads() -> None:
    found: dict[int, list[float]] = {}

    def caller(number: int) -> None:
        matrices = list(np.random.default_rng(number).standard_normal((40, 30, 30)))
        found[number] = in_threads(lambda matrix: float(np.linalg.det(matrix)), matrices)

    with one_thread():
        callers = [threading.Thread(target=caller, args=(number,)) for number in range(3)]
        for one in callers:
            one.start()
        for one in callers:
            one.join()
    for number in range(3):
        expected = np.linalg.det(np.random.default_rng(number).standard_normal((40, 30, 30)))
        np.testing.assert_allclose(found[number], expected, rtol=1e-12)


def test_the_last_of_several_threads_lifts_the_limit_of_linear_algebra() -> None:
    libraries = [one for one in ThreadpoolController().lib_controllers if one.user_api == "blas"]
    before = [library.num_threads for library in libraries]

    def limits() -> list[int]:
        return [library.num_threads for library in libraries]

    def set_limits(numbers: list[int]) -> None:
        for library, number in zip(libraries, numbers, strict=True):
            library.set_num_threads(number)
            getattr(library, "clear_controlling_thread", list)()

    entered, left = threading.Event(), threading.Event()
    allowed: list[int] = []
    meanwhile: list[list[int]] = []

    def first() -> None:
        with one_thread() as outside:
            allowed.append(outside)
            entered.wait(10.0)
        left.set()
        finished.wait(10.0)  # threads that are alive keep what is theirs

    def second() -> None:
        with one_thread() as outside:
            allowed.append(outside)
            entered.set()
            left.wait(10.0)
            meanwhile.append(limits())

    set_limits([2] * len(libraries))
    two = limits()  # save for libraries that know one thread alone, as that of SCS
    try:
        for k in range(3):
            finished = threading.Event()
            entered.clear()
            left.clear()
            threads = [threading.Thread(target=one) for one in (first, second)]
            threads[0].start()
            while len(allowed) == 2 * k:
                time.sleep(0.001)
            threads[1].start()
            threads[1].join(10.0)
            finished.set()
            threads[0].join(10.0)
            assert limits() == two
    finally:
        set_limits(before)
    assert allowed == [2] * 6
    assert meanwhile == [[1] * len(libraries)] * 3


FORKED = """
import json, os, sys, threading, warnings
import numpy
from threadpoolctl import ThreadpoolController
from steelyard.dynamics.threads import one_thread

libraries = [one for one in ThreadpoolController().lib_controllers if one.user_api == "blas"]
for one in libraries:
    one.set_num_threads(2)
    getattr(one, "clear_controlling_thread", list)()

def limit():
    return max(one.num_threads for one in libraries)

def forked():
    reader, writer = os.pipe()
    if not os.fork():
        first = limit()
        with one_thread() as allowed:
            os.write(writer, json.dumps([first, allowed, limit()]).encode())
        sys.stdout.flush()
        if inside:
            within.__exit__(None, None, None)
        os.write(writer, json.dumps([limit()]).encode())
        os._exit(0)
    os.wait()
    return os.read(reader, 1000).decode()

inside = sys.argv[1] == "inside"
warnings.simplefilter("ignore")  # of the threads, which a forked process lacks
if inside:
    within = one_thread()
    within.__enter__()
    print(forked())
else:
    entered, left = threading.Event(), threading.Event()
    def other():
        with one_thread():
            entered.set()
            left.wait(10.0)
    thread = threading.Thread(target=other)
    thread.start()
    entered.wait(10.0)
    print(forked())
    left.set()
    thread.join()
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize(("place", "first"), [("inside", 1), ("beside", 2)])
def test_a_forked_process_keeps_the_limit_only_where_it_was_forked_within_it(place: str, first: int) -> None:
    done = subprocess.run([sys.executable, "-c", FORKED, place], capture_output=True, text=True, check=True)
    found, last = (json.loads(f"[{part}]") for part in done.stdout.strip()[1:-1].split("]["))
    assert found == [first, 2, 1]
    assert last == [2]


def test_threads_that_share_work_do_not_share_theirs() -> None:
    def where(_: int) -> int:
        time.sleep(0.002)
        return threading.get_ident()

    def own(_: int) -> bool:
        return set(in_threads(where, range(4))) == {threading.get_ident()} or threading.get_ident() == caller

    caller = threading.get_ident()
    with threadpool_limits(2, "blas"):
        assert all(in_threads(own, range(6)))


class _SeenError(Exception):
    """Tells how many threads BLAS had where something was first looked at."""

    def __init__(self) -> None:
        super().__init__(max(one["num_threads"] for one in ThreadpoolController().select(user_api="blas").info()))


class _Probe:
    def __getattribute__(self, name: str) -> NoReturn:
        raise _SeenError

    def __len__(self) -> NoReturn:
        raise _SeenError

    def __iter__(self) -> NoReturn:
        raise _SeenError


ESTIMATING = [getattr(estimators, name) for name in estimators.__all__ if name[0].islower()]
FEW_ROWS = {"gains_from_equations"}  # equations of a drive each
ALSO = {"estimate_payload": "unloaded", "check": "base", "correct": "base"}  # beside what has no default


@pytest.mark.parametrize(
    "function",
    [
        *(one for one in ESTIMATING if one.__name__ not in FEW_ROWS),
        tried_prior,
        plausible_fit,
        find_mistakes,
        compare_siblings,
        sy.check,
        sy.correct,
    ],
    ids=lambda one: one.__name__,
)
def test_what_estimates_keeps_linear_algebra_in_one_thread(function: Callable[..., Any]) -> None:
    """On a busy machine a fit took twenty times as long in two threads, which wait for each other at each column."""
    parameters = inspect.signature(function).parameters.values()
    needed = [one for one in parameters if one.default is one.empty or one.name == ALSO.get(function.__name__)]
    given = [_Probe() for one in needed if one.kind in (one.POSITIONAL_ONLY, one.POSITIONAL_OR_KEYWORD)]
    named = {one.name: _Probe() for one in needed if one.kind is one.KEYWORD_ONLY}
    with threadpool_limits(2, "blas"), pytest.raises(_SeenError, match=r"^1$"):
        function(*given, **named)
