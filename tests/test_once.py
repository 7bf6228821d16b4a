"""Attributes that several threads ask for at once."""

import re
import threading
from pathlib import Path

import steelyard
from steelyard.once import cached_property


class Pair:
    """Two attributes, each of which takes its time and the other one of another object."""

    def __init__(self) -> None:
        self.both = threading.Barrier(2, timeout=10.0)
        self.other = self

    @cached_property
    def left(self) -> list[str]:
        self.both.wait()
        return ["left", *(self.other.right if self.other is not self else [])]

    @cached_property
    def right(self) -> list[str]:
        self.both.wait()
        return ["right", *(self.other.left if self.other is not self else [])]


def test_threads_that_ask_at_once_get_the_same() -> None:
    pair, found = Pair(), list[object]()
    threads = [threading.Thread(target=lambda: found.append(pair.left)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found[0] is found[1] is pair.left


def test_threads_that_need_attributes_of_each_others_kind_do_not_wait_for_each_other() -> None:
    one, two, last = Pair(), Pair(), Pair()
    one.other = two.other = last
    two.both = one.both
    last.both = threading.Barrier(1)
    threads = [threading.Thread(target=getattr, args=given, daemon=True) for given in ((one, "left"), (two, "right"))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10.0)
    assert not any(thread.is_alive() for thread in threads)
    assert one.left == ["left", "right"]
    assert two.right == ["right", "left"]


def test_no_attribute_is_computed_under_a_lock_of_its_class() -> None:
    files = [path for path in Path(steelyard.__file__).parent.rglob("*.py") if path.name != "once.py"]
    assert [path for path in files if re.search(r"functools.*cached_property", path.read_text(encoding="utf-8"))] == []
