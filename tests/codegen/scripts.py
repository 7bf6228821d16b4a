"""What the tests of Python, JAX, CasADi, Octave and Julia source have in common."""

import json
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from published_arms import WAM_ROWS
from python_file import module_of_file

import steelyard as sy
from steelyard.codegen import Constant, Project, generate
from steelyard.graph import Argument, Function, Graph, Kernel, Node, Output, cos, sin
from steelyard.graph.expression import reachable

from .conftest import inputs_of, project_of, run

PYTHON = ("python", "jax", "casadi")
SCRIPTS = (*PYTHON, "octave", "julia")
TOLERANCE = 1e-12  # of the largest value of an output

Samples = list[list[list[np.ndarray]]]

_DRIVER = """
import json
{setup}
import {module} as module
import numpy as np
with open("inputs.json") as file:
    given = json.load(file)
results = []
for name, samples in given:
    for arrays in samples:
        arrays = [np.array(a, dtype=float) for a in arrays]
        {call}
        results.append([np.ravel(v).tolist() for v in values])
print(json.dumps(results))
"""
_SETUP = {"python": "", "casadi": "import casadi", "jax": 'import jax\njax.config.update("jax_enable_x64", True)'}
_RETURNED = "found = getattr(module, name)(*arrays); values = found if isinstance(found, tuple) else (found,)"
_CALLS = {
    "python": _RETURNED,
    "jax": _RETURNED,
    "casadi": "values = [v.full() for v in getattr(module, name)().call([casadi.DM(a) for a in arrays])]",
}


def needs(language: str) -> None:
    if language in ("casadi", "jax"):
        pytest.importorskip(language, reason=f"{language} is not installed")


def several_functions() -> Project:
    """A project with an argument that is called like a function, and with several outputs."""
    rows = WAM_ROWS[2:5]
    model = sy.Model(sy.Robot.from_dh(rows, name="elbow").with_terms(sy.Coulomb()))
    names = ("gravity", "inverse_dynamics_derivatives", "kinetic_energy", "jacobian", "energy_regressor")
    return project_of("elbow", [model.function(name, gravity="argument") for name in names])


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
    other = Function(
        "still", (Argument("q", 2, False, f"not as above {text}", (text, text)),), (Output("x", (), (q[0],)),)
    )
    values = inputs_of([function, other], np.random.default_rng(3), 2)
    return Project(name, (function, other), text, (Constant("count", 2, text),), values, "1.0")


def project_with_names(words: Sequence[str]) -> Project:
    """A function with arguments, and one with outputs, that have these names."""
    graph = Graph()
    total = graph.zero
    for k, word in enumerate(words):
        (x,) = graph.inputs(word, 1)
        total = total + sin(x) * cos(x) * (k + 1.0)
    arguments = Function("arguments", tuple(Argument(w, 1) for w in words), (Output("total", (), (total,)),))
    (x,) = Graph().inputs("source", 1)
    outputs = tuple(Output(w, (), (sin(x) * (k + 1.0),)) for k, w in enumerate(words))
    return project_of("words", [arguments, Function("outputs", (Argument("source", 1),), outputs)])


def fresh(project: Project, samples: int = 3) -> Samples:
    """Draw inputs: for each function, for each sample, for each argument."""
    random = np.random.default_rng(20240301)
    return [
        [[random.uniform(-3.0, 3.0, a.width) for a in function.arguments] for _ in range(samples)]
        for function in project.functions
    ]


def check(project: Project, inputs: Samples, found: list[list[np.ndarray]], least: float = 0.0) -> None:
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
                kept = np.array([_smallest_factor(node) >= least for node in output.nodes])
                assert kept.any()
                assert np.abs(np.asarray(ours) - target)[kept].max() <= allowed, (function.name, output.name)
                assert np.abs(np.asarray(ours) - other)[kept].max() <= allowed, (function.name, output.name)
    assert next(results, None) is None


def _smallest_factor(node: Node) -> float:
    """The smallest constant in an expression that is not 0."""
    values = [abs(float(n.value)) for n in reachable([node]) if n.operation == "constant" and n.value]
    return min(values, default=1.0)


def module_in(folder: Path) -> str:
    (path,) = (p for p in folder.glob("*.py") if not p.name.startswith("test_") and p.name != "driver.py")
    return path.stem


def public_functions(text: str) -> list[str]:
    return [name for name in re.findall(r"^def (\w+)\(", text, re.MULTILINE) if not name.startswith("_")]


def run_python(language: str, project: Project, folder: Path, least: float = 0.0) -> None:
    """Generate a module, call its functions in a process of their own, and compare."""
    needs(language)
    generate(project, language, folder)
    module = module_in(folder)
    names = public_functions((folder / f"{module}.py").read_text(encoding="utf-8"))
    inputs = fresh(project)
    given = [
        [name, [[a.tolist() for a in arrays] for arrays in samples]]
        for name, samples in zip(names, inputs, strict=True)
    ]
    (folder / "inputs.json").write_text(json.dumps(given))
    (folder / "driver.py").write_text(_DRIVER.format(setup=_SETUP[language], module=module, call=_CALLS[language]))
    check(project, inputs, json.loads(run([sys.executable, "driver.py"], folder)), least)


def self_test_of(folder: Path) -> int:
    """Run the self-test of a Python module; return its exit status."""
    command = [sys.executable, "-B", "-m", "unittest"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=300)
    assert "Ran 0 tests" not in done.stderr
    return done.returncode


def mutated(path: Path, pattern: str, replacement: str) -> None:
    """Change the last place in a file that matches."""
    text = path.read_text(encoding="utf-8")
    *_, place = re.finditer(pattern, text)
    path.write_text(text[: place.start()] + place.expand(replacement) + text[place.end() :], encoding="utf-8")


def module_of(project: Project, language: str, folder: Path) -> ModuleType:
    """Generate a project, and load the file that is not its tests."""
    generate(project, language, folder)
    (path,) = (p for p in folder.glob("*.py") if not p.name.startswith("test_"))
    return module_of_file(path)
