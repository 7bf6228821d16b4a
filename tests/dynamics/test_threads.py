"""Work that is shared among threads."""

import threading
import time

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from steelyard.dynamics.threads import in_threads, one_thread, serial


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
