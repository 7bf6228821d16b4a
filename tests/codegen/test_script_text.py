"""Whatever the names and descriptions of a robot say, the generated scripts do the same, in the same bytes."""

import ast
import re

import pytest
from child_programs import printed_twice

from steelyard.codegen import files

from .scripts import SCRIPTS, plain_project
from .test_hostile_text import HOSTILE

# JAX and CasADi are written by the writer of Python, and take longest.
MOST_UNLIKE = [pytest.param(name, marks=pytest.mark.slow) if name in ("jax", "casadi") else name for name in SCRIPTS]


def code_of(path: str, text: str) -> str:
    """What a file does, without comments and documentation."""
    if path.endswith(".py"):
        tree = ast.parse(text)
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
                del node.body[0]
        return ast.dump(tree)
    if path.endswith((".jl", "Project.toml")):
        text = re.sub(r'^@doc raw""".*?^"""$', "", text, flags=re.MULTILINE | re.DOTALL)
        text = re.sub(r'^uuid = ".*"$', "", text, flags=re.MULTILINE)
    return "\n".join(line for line in text.splitlines() if not re.match(r"\s*[%#]", line))


@pytest.mark.parametrize("language", MOST_UNLIKE)
def test_hostile_text_changes_no_code(language: str) -> None:
    plain = files(plain_project(), language)
    for text in HOSTILE:
        hostile = files(plain_project(text), language)
        assert hostile.keys() == plain.keys()
        for name, content in plain.items():
            if not name.endswith(".md"):
                assert code_of(name, hostile[name]) == code_of(name, content), (name, text)
            hostile[name].encode("utf-8")


@pytest.mark.parametrize("language", MOST_UNLIKE)
def test_hostile_names_become_identifiers(language: str) -> None:
    for name in (*HOSTILE, "numpy", "class", "end", "Base", "7 joints", "sin", "x" * 200, "機械"):
        written = files(plain_project(name=name), language)
        for path, text in written.items():
            assert re.fullmatch(r"(src/|test/)?[A-Za-z]\w*(\.\w+)?", path), path
            if path.endswith(".py"):
                compile(text, path, "exec")


@pytest.mark.parametrize("language", SCRIPTS)
def test_docstrings_are_text(language: str) -> None:
    """A hostile description stands in the documentation, harmless, and nothing else of it is left."""
    text = 'ends """ with $(injected) and \\N{DIGIT ONE} %{ *} and #= too'
    for path, content in files(plain_project(text), language).items():
        for line in content.splitlines():
            assert '""" with' not in line, path
            assert "\\N" not in line, path


@pytest.mark.slow
def test_the_same_bytes_in_another_process() -> None:
    code = (
        "import hashlib, numpy as np, steelyard as sy\n"
        "from steelyard.codegen import files\n"
        "from steelyard.dynamics.model_source import model_project\n"
        "model = sy.Model(sy.Robot.from_dh([(0, 1, 0, 'q'), ('pi/2', 0, 0, 'q')]).with_terms(sy.Viscous()))\n"
        "project = model_project(model._functions, ['inverse_dynamics', 'regressor'])\n"
        f"for language in {SCRIPTS!r}:\n"
        "    texts = files(project, language)\n"
        "    print(language, hashlib.sha256(repr(sorted(texts.items())).encode()).hexdigest())"
    )
    here, there = printed_twice(code)
    assert there == here
    assert len(there.splitlines()) == len(SCRIPTS)
