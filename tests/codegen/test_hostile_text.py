"""Whatever the names and descriptions of a robot say, the compiled program is the same."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from any_text import CHARACTERS
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from steelyard.codegen import Constant, Project, files, generate
from steelyard.graph import Argument, Function, Graph, Output, cos, sin

from .conftest import C_FLAGS, CPP_FLAGS, RUST_FLAGS, TOOLS, build_self_test, inputs_of, need, run

LANGUAGES = ("c", "cpp", "rust")
COMPILED = ["c", pytest.param("cpp", marks=pytest.mark.slow), "rust"]
"""Languages, with that whose compiler takes longest among the slow tests."""

HOSTILE = (
    '*/ int injected(void) { return system("true"); } /*',
    "\n#error injected\n",
    "\r#error injected\r",
    "ends with a backslash \\",
    "ends with a trigraph ??/",
    "??/\n#error injected",
    "*??/\n/ injected",
    "*\\\n/ injected",
    "\u2028injected\u2029injected\u0085injected\x0binjected\x0cinjected",
    "\u202e right to left \u2066 isolate \u2069 \u200f mark",
    "\ud800 lone surrogate \udfff",
    "\x00 nothing \x07 bell \x1b[31m escape \x1a end of file",
    "'''\"\"\" ``` injected \"\"\"'''",
    "]] ]=] --> <!-- <script>alert(1)</script>",
    "%{\ninjected\n%}",
    "#= injected =# #{ injected #}",
    "$(injected) ${injected} $injected #{injected}",
    "{injected} {} %s %n %d %%",
    "    indented as code",
    "```\nassert!(false);\n```",
    "[link][injected] ![](injected) [`Self::injected`] <https://example.org>",
    "//! injected\n/// injected\n#![allow(x)]",
    "-*- coding: utf-7 -*-",
    "vim: set injected:",
    "=begin injected",
    "@include injected",
    "\ufeff byte order mark \ufffe\uffff",
    "'; DROP TABLE joints; --",
    "²·°µΩ 関節 угол",
    "",
    " ",
)

nasty = st.one_of(
    st.sampled_from(HOSTILE),
    st.text(CHARACTERS, max_size=40),
    st.text(st.sampled_from("*/\\?\n\r%{}#=\"'`-<>![]() u\u2028\u202e"), max_size=30),
)


def project_with(texts: Sequence[str], name: str) -> Project:
    """A project that holds the texts wherever a text can stand."""
    graph = Graph()
    x, p = graph.inputs("x", 3), graph.inputs("p", len(texts))
    outputs = (
        Output("y", (2, 2), (sin(x[0]) * x[1], cos(x[0]), p[1] * x[2] + p[0], graph.zero), texts[0]),
        Output("z", (), (x[1] * x[2],), texts[1]),
    )
    arguments = (Argument("x", 3, False, texts[2]), Argument("p", len(texts), True, texts[3], tuple(texts)))
    first = Function("first", arguments, outputs, texts[4])
    other = Graph()
    w = other.inputs("x", 3)
    # The argument x means something else here, so that its elements are described with the function.
    argument = Argument("x", 3, False, texts[5], tuple(texts[6:9]))
    second = Function("second", (argument,), (Output("y", (), (w[0] + w[2],)),))
    constants = (Constant("count", 3, texts[9]), Constant("step", 0.5, texts[10]))
    reference = inputs_of((first,), np.random.default_rng(5), 1)
    return Project(name, (first, second), texts[11], constants, reference, texts[12])


LONG = [*HOSTILE, " ".join(HOSTILE), "".join(HOSTILE), "x" * 300 + "*/", "*" * 200 + "/", "?" * 201 + "/"]


def machine_code(language: str, project: Project, folder: Path) -> bytes:
    """Compile the functions; comments leave no trace in the result."""
    need(TOOLS[language])
    generate(project, language, folder)
    if language == "rust":
        flags = ["--crate-type", "rlib", "--crate-name", "arm", "--emit", "asm", "-C", "codegen-units=1"]
        run(["rustc", *RUST_FLAGS, *flags, "src/lib.rs", "-o", "arm.s"], folder)
        return (folder / "arm.s").read_bytes()
    compiler = ["gcc", *C_FLAGS] if language == "c" else ["g++", *CPP_FLAGS]
    run([*compiler, "-c", f"arm.{language}", "-o", "arm.o"], folder)
    return (folder / "arm.o").read_bytes()


@pytest.mark.parametrize("language", COMPILED)
def test_descriptions_leave_no_trace_in_the_program(language: str, tmp_path: Path) -> None:
    plain = machine_code(language, project_with([""] * len(LONG), "arm"), tmp_path / "plain")
    for shift in (0, 7):
        hostile = project_with(LONG[shift:] + LONG[:shift], "arm")
        assert machine_code(language, hostile, tmp_path / f"hostile_{shift}") == plain
    fewer = project_with(LONG, "arm")
    changed = replace(fewer, functions=fewer.functions[:1])
    assert machine_code(language, changed, tmp_path / "changed") != plain


@pytest.mark.parametrize("language", LANGUAGES)
@settings(max_examples=2, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(texts=st.lists(nasty, min_size=40, max_size=40))
@pytest.mark.slow
def test_random_descriptions_leave_no_trace_in_the_program(
    language: str, texts: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("random")
    plain = machine_code(language, project_with([""] * len(texts), "arm"), folder / "plain")
    assert machine_code(language, project_with(texts, "arm"), folder / "hostile") == plain


NAMES = (
    "",
    "math",
    "test",
    "std",
    "int",
    "M",
    "aux",
    "7 dof",
    "../../etc/passwd",
    "a\nb",
    "クラス",
    "link",
    "DBL",
    "self",
)


@pytest.mark.parametrize("language", ["c", *(pytest.param(one, marks=pytest.mark.slow) for one in ("cpp", "rust"))])
def test_hostile_names_of_robots(language: str, tmp_path: Path) -> None:
    for k, name in enumerate((*NAMES, *HOSTILE)):
        folder = tmp_path / str(k)
        paths = generate(project_with(HOSTILE[:13], name), language, folder)
        assert all(path.resolve().is_relative_to(folder.resolve()) for path in paths)


QUICK = {("c", NAMES[0]), ("c", NAMES[1])}


@pytest.mark.parametrize(
    ("language", "name"),
    [
        pytest.param(language, name, marks=() if (language, name) in QUICK else pytest.mark.slow)
        for language in LANGUAGES
        for name in (NAMES if language == "c" else NAMES[:4])
    ],
)
def test_programs_of_robots_with_hostile_names_run(language: str, name: str, tmp_path: Path) -> None:
    generate(project_with(HOSTILE, name), language, tmp_path)
    run([build_self_test(language, tmp_path)], tmp_path)


@settings(max_examples=6)  # of 40 texts each, written in eight languages
@given(texts=st.lists(nasty, min_size=40, max_size=40), name=nasty)
def test_every_line_of_every_file_can_be_read(texts: list[str], name: str) -> None:
    project = project_with(texts, name)
    for language in LANGUAGES:
        for path, text in files(project, language).items():
            assert re.fullmatch(r"((src|tests)/)?[A-Za-z][A-Za-z0-9_]*\.[a-z]+", path)
            text.encode()
            assert len(text.splitlines()) == text.count("\n")
            assert "Generated by Steelyard" in text.partition("\n")[0]
