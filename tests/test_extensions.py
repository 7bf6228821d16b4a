"""What all kinds of extensions have in common: a table, a group of entry points, a sentence where one is broken."""

import subprocess
import sys

import pytest

from steelyard.errors import InputError
from steelyard.extensions import KINDS, Extensions, _table, register, unregister


def table(kind: str) -> Extensions:
    return _table(kind)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_has_a_table_with_its_name(kind):
    assert table(kind).kind == kind
    for name in table(kind).own:
        assert table(kind).get(name) is not None
    assert table(kind).get("no such thing") is None


@pytest.mark.parametrize("kind", KINDS)
def test_ones_own_do_not_ask_for_packages(kind, monkeypatch):
    monkeypatch.setattr("steelyard.extensions.entry_points", None)
    for name in table(kind).own:
        table(kind).get(name)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_broken_is_told_in_a_sentence_and_in_nobodys_way(kind, install):
    install("ill", kind, {"absent": "of_ill:absent", "faulty": "of_fault:x", "number": "of_ill:number"}, "number = 3\n")
    install("ended", kind, {"ended": "of_ended:x"}, "raise SystemExit(3)\n")
    install("twin", kind, {"number": "of_ended:x"})
    own = next(iter(table(kind).own), None)
    assert {"absent", "ended", "faulty", "number"} <= set(table(kind).names())  # which imports nothing
    assert not {"of_ill", "of_ended", "of_twin"} & set(sys.modules)
    for name, reason in (
        ("absent", "of ill cannot be loaded (AttributeError: "),
        ("faulty", "of ill cannot be loaded (ModuleNotFoundError: No module named 'of_fault')"),
        ("ended", "of ended cannot be loaded (SystemExit: 3)"),
        ("number", "is offered by ill and twin: uninstall all of them but one."),
    ):
        with pytest.raises(InputError) as raised:
            table(kind).get(name)
        assert f"The {table(kind).noun} `{name}` {reason}" in str(raised.value)
        assert "\n" not in str(raised.value)
    if own is not None:
        assert table(kind).get(own) is not None


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_of_another_kind_is_refused(kind, install):
    install("wrong", kind, {"number": "of_wrong:number"}, "number = 3\n")
    with pytest.raises(InputError, match=r"`number` of wrong cannot be loaded \(TypeError: expected .*, got"):
        table(kind).get("number")
    with pytest.raises(InputError, match=r"`number` cannot be registered: expected .*, got"):
        register(kind, "number", 3)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "commands"])
def test_a_name_of_our_own_cannot_be_taken(kind, install):
    own, *_ = table(kind).own
    before = table(kind).get(own)
    install("thief", kind, {own: "of_thief:stolen"}, "1 / 0\n")
    assert table(kind).get(own) is before
    assert "of_thief" not in sys.modules
    with pytest.raises(InputError, match=f"`{own}` is one of Steelyard's own; choose another name"):
        register(kind, own, before)


def test_names_are_words_and_kinds_are_known(no_extensions):
    with pytest.raises(InputError, match="no kind of extensions 'solver'; did you mean \"solvers\""):
        register("solver", "mine", None)
    for name in ("", "Two Words", "a:b", None):
        with pytest.raises(InputError, match="must be one word in lower case"):
            register("languages", name, str)
    with pytest.raises(InputError, match="No language is registered as 'c'; there are none"):
        unregister("languages", "c")


@pytest.mark.slow
def test_identifying_imports_no_package_that_adds_something():
    """Nor do lists of names, nor messages that suggest one."""
    code = (
        "import sys, steelyard.extensions as e\n"
        "e.entry_points = None\n"
        "import steelyard, steelyard.cli.main, steelyard.identification.identify, steelyard.conic.solver\n"
        "steelyard.conic.solver.find_solver('clarabel')\n"
        "print([m for m in sys.modules if 'scs_solver' in m or 'external_solver' in m or 'parquet_file' in m])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "[]\n"
