"""Generated Python, JAX, CasADi and Octave, run at fresh inputs against the interpreter and the kernels."""

import ast
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from steelyard.generation import Constant, Project, files, generate
from steelyard.graph import Argument, Function, Graph, Kernel, Node, Output, cos, sin
from steelyard.graph.expression import reachable

from .conftest import inputs_of, need, project_of, run
from .test_hostile_text import HOSTILE

PYTHON = ("python", "casadi", "jax")
TOLERANCE = 1e-12  # of the largest value of an output
SAMPLES = 3

DRIVER = """
import json, sys
{setup}
import {module} as module
with open("inputs.json") as file:
    given = json.load(file)
import numpy as np
results = []
for name, samples in given:
    for arrays in samples:
        arrays = [np.array(a, dtype=float) for a in arrays]
        {call}
        results.append([np.ravel(v).tolist() for v in values])
print(json.dumps(results))
"""
SETUP = {"python": "", "casadi": "import casadi", "jax": 'import jax\njax.config.update("jax_enable_x64", True)'}
CALLS = {
    "python": "found = getattr(module, name)(*arrays); values = found if isinstance(found, tuple) else (found,)",
    "jax": "found = getattr(module, name)(*arrays); values = found if isinstance(found, tuple) else (found,)",
    "casadi": "values = [v.full() for v in getattr(module, name)().call([casadi.DM(a) for a in arrays])]",
}


def needs(language: str) -> None:
    if language in ("casadi", "jax"):
        pytest.importorskip(language, reason=f"{language} is not installed")


def module_of(folder: Path) -> str:
    (path,) = (p for p in folder.glob("*.py") if not p.name.startswith("test_") and p.name != "driver.py")
    return path.stem


def names_in(language: str, text: str) -> list[str]:
    pattern = {"octave": r"^function \[.*?\] = (\w+)\(", "julia": r"^function (\w+)!\("}.get(language, r"^def (\w+)\(")
    return [name for name in re.findall(pattern, text, re.MULTILINE) if not name.startswith("_")]


def fresh(project: Project) -> list[list[list[np.ndarray]]]:
    random = np.random.default_rng(20240301)
    return [
        [[random.uniform(-3.0, 3.0, a.width) for a in function.arguments] for _ in range(SAMPLES)]
        for function in project.functions
    ]


def check(
    project: Project, inputs: list[list[list[np.ndarray]]], found: list[list[np.ndarray]], least: float = 0.0
) -> None:
    """Compare outputs, for all the functions and samples in order, with the interpreter and the kernels.

    Elements with a constant factor below `least` are left out.
    """
    results = iter(found)
    for function, samples in zip(project.functions, inputs, strict=True):
        kernel = Kernel(function)
        ends = np.cumsum([output.size for output in function.outputs])[:-1]
        for values in samples:
            expected = function.evaluate({a.name: v for a, v in zip(function.arguments, values, strict=True)})
            batch = [v if a.uniform else v[None] for a, v in zip(function.arguments, values, strict=True)]
            of_kernel = np.split(kernel(*batch)[0], ends)
            for output, ours, other in zip(function.outputs, next(results), of_kernel, strict=True):
                target = expected[output.name].ravel()
                allowed = TOLERANCE * max(np.abs(target).max(), 1e-300)
                kept = np.array([smallest_factor(node) >= least for node in output.nodes])
                assert kept.any()
                assert np.abs(np.asarray(ours) - target)[kept].max() <= allowed, (function.name, output.name)
                assert np.abs(np.asarray(ours) - other)[kept].max() <= allowed, (function.name, output.name)


def smallest_factor(node: Node) -> float:
    """The smallest constant in an expression that is not 0."""
    values = [abs(float(n.value)) for n in reachable([node]) if n.operation == "constant" and n.value]
    return min(values, default=1.0)


def run_python(language: str, project: Project, folder: Path) -> None:
    needs(language)
    generate(project, language, folder)
    module = module_of(folder)
    names = names_in(language, (folder / f"{module}.py").read_text(encoding="utf-8"))
    inputs = fresh(project)
    given = [
        [name, [[a.tolist() for a in arrays] for arrays in samples]]
        for name, samples in zip(names, inputs, strict=True)
    ]
    (folder / "inputs.json").write_text(json.dumps(given))
    (folder / "driver.py").write_text(DRIVER.format(setup=SETUP[language], module=module, call=CALLS[language]))
    printed = run([sys.executable, "driver.py"], folder)
    # XLA takes numbers below 2.2e-308 for 0.
    check(project, inputs, json.loads(printed), least=1e-300 if language == "jax" else 0.0)


@pytest.mark.parametrize("language", PYTHON)
def test_robot_functions_agree_at_fresh_inputs(language: str, wam_generated: Project, tmp_path: Path) -> None:
    run_python(language, wam_generated, tmp_path)


@pytest.mark.parametrize("language", PYTHON)
def test_odd_functions_agree_at_fresh_inputs(language: str, odd_generated: Project, tmp_path: Path) -> None:
    run_python(language, odd_generated, tmp_path)


def plain_project(text: str = "plain", name: str = "plain robot") -> Project:
    """A small project in which `text` stands wherever a robot's file can put text."""
    graph = Graph()
    q, p = graph.inputs("q", 2), graph.inputs("parameters", 2)
    function = Function(
        "torque",
        (
            Argument("q", 2, description=text, elements=(text, f"x {text} y")),
            Argument("parameters", 2, True, text, (text, text)),
        ),
        (Output("tau", (2,), (p[0] * sin(q[0]), p[1] * cos(q[1]) - q[0]), text),),
        text,
    )
    values = inputs_of([function], np.random.default_rng(3), 2)
    return Project(name, (function,), text, (Constant("count", 2, text),), values, text[:5])


@pytest.mark.parametrize("language", [*PYTHON, "octave"])
def test_the_self_test_runs_and_a_changed_source_fails_it(language: str, tmp_path: Path) -> None:
    needs(language)
    written = generate(plain_project(), language, tmp_path)
    if language == "octave":
        need("octave-cli")
        command = ["octave-cli", "--norc", "--no-history", "--eval", "plain_robot_self_test"]
        source = tmp_path / "plain_robot_torque.m"
    else:
        command = [sys.executable, "-m", "unittest"]
        source = tmp_path / "plain_robot.py"
    assert source in written
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    text = source.read_text(encoding="utf-8")
    changed = re.sub(r"sin\(", "cos(", text, count=1) if language == "octave" else text.replace(".sin(", ".cos(", 1)
    assert changed != text
    source.write_text(changed, encoding="utf-8")
    shutil.rmtree(tmp_path / "__pycache__", ignore_errors=True)
    assert subprocess.run(command, cwd=tmp_path, capture_output=True, check=False).returncode != 0


def code_of(path: str, text: str) -> str:
    """What a file does, without comments and documentation."""
    if path.endswith(".py"):
        tree = ast.parse(text)
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node)
            if documented is not None and isinstance(body, list) and isinstance(body[0], ast.Expr):
                del body[0]
        return ast.dump(tree)
    if path.endswith((".jl", "Project.toml")):
        text = re.sub(r'^@doc raw""".*?^"""$', "", text, flags=re.MULTILINE | re.DOTALL)
        text = re.sub(r'^uuid = ".*"$', "", text, flags=re.MULTILINE)
    lines = [line for line in text.splitlines() if not re.match(r"\s*[%#]", line)]
    return "\n".join(lines)


@pytest.mark.parametrize("language", [*PYTHON, "octave", "julia"])
def test_hostile_text_changes_no_code(language: str) -> None:
    plain = files(plain_project(), language)
    for text in HOSTILE:
        hostile = files(plain_project(text), language)
        assert hostile.keys() == plain.keys()
        for name, content in plain.items():
            if not name.endswith(".md"):
                assert code_of(name, hostile[name]) == code_of(name, content), (name, text)
                content.encode("utf-8")


@pytest.mark.parametrize("language", [*PYTHON, "octave", "julia"])
def test_hostile_names_become_identifiers(language: str) -> None:
    for name in (*HOSTILE, "numpy", "class", "end", "Base", "7 joints", "sin", "x" * 200, "機械"):
        for path in files(plain_project(name=name), language):
            assert re.fullmatch(r"(src/|test/)?[A-Za-z]\w*(\.\w+)?", path), path


def test_octave_agrees_at_fresh_inputs(wam_generated: Project, odd_generated: Project, tmp_path: Path) -> None:
    """All the functions of both projects in one start of Octave."""
    need("octave-cli")
    lines, expected = [], []
    for k, project in enumerate((wam_generated, odd_generated)):
        folder = tmp_path / str(k)
        generate(project, "octave", folder)
        lines.append(f"addpath('{folder}');")
        inputs = fresh(project)
        expected.append((project, inputs))
        for function, samples in zip(project.functions, inputs, strict=True):
            (name,) = {
                found
                for path in folder.glob("*.m")
                for found in names_in("octave", path.read_text(encoding="utf-8"))
                if found.lower().endswith(f"_{function.name.lower()}")
            }
            for arrays in samples:
                values = ", ".join(f"[{' '.join(map(repr, map(float, a)))}]" if len(a) else "[]" for a in arrays)
                results = ", ".join(f"r{j}" for j in range(len(function.outputs)))
                lines.append(f"[{results}] = {name}({values});")
                for j in range(len(function.outputs)):
                    lines.append(f"r = permute(r{j}, ndims(r{j}):-1:1); printf('%.17g ', r(:)); printf('\\n');")
    (tmp_path / "driver.m").write_text("\n".join(lines))
    printed = run(["octave-cli", "--norc", "--no-history", "driver.m"], tmp_path).splitlines()
    rows = iter([[float(x) for x in line.split()] for line in printed])
    for project, inputs in expected:
        found = [
            [np.array(next(rows)) for _ in function.outputs]
            for function, samples in zip(project.functions, inputs, strict=True)
            for _ in samples
        ]
        check(project, inputs, found)


def test_m_files_are_matlab_too(wam_generated: Project, odd_generated: Project) -> None:
    """Nothing that Octave alone understands."""
    for project in (wam_generated, odd_generated):
        for path, text in files(project, "octave").items():
            if not path.endswith(".m"):
                continue
            assert len(path) <= 63 + 2
            code = "\n".join(line for line in text.splitlines() if not line.lstrip().startswith("%"))
            code = re.sub(r"'[^'\n]*'", "''", code)
            for foreign in ("#", '"', "!", "+=", "-=", "*=", "++", "--", "endfunction", "endif", "printf(", "**"):
                assert foreign not in code.replace("fprintf(", ""), (path, foreign)
            opened = len(re.findall(r"^\s*(?:function|if|for|while)\b", code, re.MULTILINE))
            assert opened == len(re.findall(r"^\s*end$", code, re.MULTILINE)), path


@pytest.mark.parametrize("language", [*PYTHON, "octave", "julia"])
def test_the_same_bytes_in_another_process(language: str) -> None:
    code = (
        "import hashlib, numpy as np, steelyard as sy\n"
        "from steelyard.generation import files\n"
        "from steelyard.dynamics.project import model_project\n"
        "model = sy.Model(sy.Robot.from_dh([(0, 1, 0, 'q'), ('pi/2', 0, 0, 'q')]).with_terms(sy.Viscous()))\n"
        f"texts = files(model_project(model, ['inverse_dynamics', 'gravity']), {language!r})\n"
        "print(hashlib.sha256(repr(sorted(texts.items())).encode()).hexdigest())"
    )
    seen = set()
    for seed in ("1", "2"):
        environment = {"PYTHONHASHSEED": seed, "STEELYARD_CACHE": "off"}
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        seen.add(done.stdout)
    assert len(seen) == 1


def test_wide_functions_keep_python_within_its_limits(tmp_path: Path) -> None:
    """Twenty thousand assignments, each on the last: no nesting that a parser gives up on."""
    graph = Graph()
    (x,) = graph.inputs("x", 1)
    value = x
    for k in range(20_000):
        value = value * 0.999 + (0.5 + k % 7) * x
    project = project_of("long", [Function("chain", (Argument("x", 1),), (Output("y", (), (value,)),))])
    run_python("python", replace(project, constants=()), tmp_path)
