"""What the process has once, changed by several threads for a while."""

import ast
import contextlib
import re
import threading
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import steelyard
from steelyard.files import Meanwhile
from steelyard.lmi import LinearExpression
from steelyard.lmi.linear_expression import parse_expression


def test_the_last_of_several_threads_takes_it_back() -> None:
    told: list[str] = []

    @contextlib.contextmanager
    def change() -> Iterator[None]:
        told.append("changed")
        yield
        told.append("as before")

    meanwhile, barrier = Meanwhile(change), threading.Barrier(3, timeout=10.0)

    def work() -> None:
        with meanwhile:
            barrier.wait()
            assert told == ["changed"]

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert told == ["changed", "as before"]
    with pytest.raises(ValueError, match="in it"), meanwhile:
        raise ValueError("in it")
    assert told == 2 * ["changed", "as before"]


def test_threads_leave_the_filters_of_warnings_as_they_were(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two threads read expressions; the one that came first goes first."""
    before, parse = list(warnings.filters), ast.parse
    first, second, gone = (threading.Event() for _ in range(3))

    def slow(*given: Any, **options: Any) -> ast.AST:
        if threading.current_thread().name == "first":
            first.set()
            second.wait(10.0)
        elif threading.current_thread().name == "second":
            second.set()
            gone.wait(10.0)
        return parse(*given, **options)

    monkeypatch.setattr(ast, "parse", slow)
    found: list[LinearExpression] = []
    threads = [
        threading.Thread(target=lambda: found.append(parse_expression("2*a - b")), name=name)
        for name in ("first", "second")
    ]
    threads[0].start()
    first.wait(10.0)
    threads[1].start()
    threads[0].join()
    gone.set()
    threads[1].join()
    try:
        assert list(warnings.filters) == before
    finally:
        warnings.filters[:] = before  # type: ignore[index]
    assert [str(one) for one in found] == 2 * ["2*a - b"]


def test_nobody_else_changes_the_filters() -> None:
    package = Path(steelyard.__file__).parent
    files = [one for one in package.rglob("*.py") if re.search("catch_warnings|simplefilter", one.read_text("utf-8"))]
    # The latter is the program of another process.
    assert sorted(path.name for path in files) == ["mat_child.py", "meanwhile.py"]
