"""Generated CasADi modules, run in processes of their own."""

import sys
from pathlib import Path

import numpy as np
import pytest

from steelyard.codegen import Project, generate
from steelyard.graph import Argument, Function, Graph, Output

from .conftest import project_of, run
from .scripts import run_python, several_functions

casadi = pytest.importorskip("casadi", reason="CasADi is not installed")


@pytest.mark.parametrize("name", [pytest.param("wam_generated", marks=pytest.mark.slow), "odd_generated"])
def test_functions_agree_at_fresh_inputs(name: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    run_python("casadi", request.getfixturevalue(name), tmp_path)


@pytest.mark.slow
def test_several_outputs_and_arguments_called_like_functions(tmp_path: Path) -> None:
    run_python("casadi", several_functions(), tmp_path)


def test_names_that_casadi_refuses(tmp_path: Path) -> None:
    functions = []
    for name in ("jac", "hess", "null", "a__b", "casadi"):
        x = Graph().inputs("casadi", 1)
        functions.append(Function(name, (Argument("casadi", 1),), (Output("jac", (), (x[0] * 2.0,)),)))
    run_python("casadi", project_of("names", functions), tmp_path)


CHECKS = """
import casadi
import numpy as np
import wam as module
function = module.inverse_dynamics()
assert function.name_in() == ["q", "dq", "ddq", "parameters"] and function.name_out() == ["torque"]
values = np.load("values.npz")
inputs = [values[name] for name in function.name_in()]
outputs = ["jac:torque:q", "jac:torque:dq"]
by_q, by_dq = function.factory("slopes", function.name_in(), outputs)(*(v[0] for v in inputs))
mapped = function.map(3)(*(v.T for v in inputs))
np.savez("results.npz", by_q=by_q.full(), by_dq=by_dq.full(), mapped=mapped.full())
"""


@pytest.mark.slow
def test_derivatives_and_batches(wam_generated: Project, tmp_path: Path) -> None:
    function = wam_generated.functions[0]
    generate(wam_generated, "casadi", tmp_path)
    random = np.random.default_rng(11)
    values = {a.name: random.uniform(-1.0, 1.0, (3, a.width)) for a in function.arguments}
    np.savez(tmp_path / "values.npz", **values)
    (tmp_path / "checks.py").write_text(CHECKS)
    run([sys.executable, "checks.py"], tmp_path)
    results = np.load(tmp_path / "results.npz")
    expected = function.evaluate(values)["torque"]
    assert np.abs(results["mapped"].T - expected).max() < 1e-12 * np.abs(expected).max()
    for name, key in (("q", "by_q"), ("dq", "by_dq")):
        shifted = {n: np.repeat(v[:1].astype(complex), 7, axis=0) for n, v in values.items()}
        shifted[name] = shifted[name] + 1e-200j * np.eye(7)
        exact = np.imag(function.evaluate(shifted)["torque"]).T / 1e-200
        assert np.abs(results[key] - exact).max() < 1e-12 * np.abs(exact).max()
