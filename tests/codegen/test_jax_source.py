"""Generated JAX modules, run in processes of their own."""

import sys
from pathlib import Path

import numpy as np
import pytest

from steelyard.codegen import Project, files, generate
from steelyard.codegen.jax import prefers_vectors

from .conftest import project_of, run
from .scripts import mutated, plain_project, run_python, self_test_of, several_functions

pytest.importorskip("jax", reason="JAX is not installed")

# XLA takes numbers below 2.2e-308 for 0.
LEAST = 1e-300


@pytest.mark.slow
def test_robot_functions_agree_at_fresh_inputs(wam_generated: Project, tmp_path: Path) -> None:
    """The inverse dynamics as single numbers, the regressor as vectors."""
    assert [prefers_vectors(function) for function in wam_generated.functions] == [False, True]
    run_python("jax", wam_generated, tmp_path)


@pytest.mark.slow
def test_odd_functions_agree_at_fresh_inputs(odd_generated: Project, tmp_path: Path) -> None:
    run_python("jax", odd_generated, tmp_path, least=LEAST)


@pytest.mark.slow
def test_several_outputs_and_arguments_called_like_functions(tmp_path: Path) -> None:
    run_python("jax", several_functions(), tmp_path)


@pytest.mark.slow
def test_odd_functions_agree_as_vectors(
    odd_generated: Project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("steelyard.codegen.jax.prefers_vectors", lambda function: True)
    run_python("jax", odd_generated, tmp_path, least=LEAST)


# Without most of XLA's optimisations, which take half of the time: the tests above run with them.
CHECKS = """
import jax
import numpy as np
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_disable_most_optimizations", True)
import {module} as module
values = np.load("values.npz")
arrays = [values[name] for name in {names!r}]
jacobians = jax.jacfwd(module.{function}, argnums=(0, 1))(*(a[0] for a in arrays))
backward = jax.jacrev(module.{function})(*(a[0] for a in arrays))
mapped = jax.vmap(module.{function})(*arrays)
broadcast = module.{function}(*arrays)
np.savez("results.npz", by_q=jacobians[0], by_dq=jacobians[1], back_q=backward, mapped=mapped, broadcast=broadcast)
"""


@pytest.mark.slow
@pytest.mark.parametrize("which", [0, 1])
def test_derivatives_and_batches(which: int, wam_generated: Project, tmp_path: Path) -> None:
    """Of a function of single numbers, and of one of vectors, against complex steps."""
    function = wam_generated.functions[which]
    generate(project_of("WAM", [function]), "jax", tmp_path)
    random = np.random.default_rng(11)
    values = {a.name: random.uniform(-1.0, 1.0, (3, a.width)) for a in function.arguments}
    np.savez(tmp_path / "values.npz", **values)
    names = [a.name for a in function.arguments]
    (tmp_path / "checks.py").write_text(CHECKS.format(module="wam", names=names, function=function.name))
    run([sys.executable, "checks.py"], tmp_path)
    results = np.load(tmp_path / "results.npz")
    (output,) = function.outputs
    expected = function.evaluate(values)[output.name]
    scale = np.abs(expected).max()
    for name in ("mapped", "broadcast"):
        assert np.abs(results[name] - expected).max() < 1e-12 * scale
    for name, key in (("q", "by_q"), ("dq", "by_dq"), ("q", "back_q")):
        shifted = {n: np.repeat(v[:1].astype(complex), 7, axis=0) for n, v in values.items()}
        shifted[name] = shifted[name] + 1e-200j * np.eye(7)
        exact = np.moveaxis(np.imag(function.evaluate(shifted)[output.name]) / 1e-200, 0, -1)
        assert np.abs(results[key] - exact).max() < 1e-12 * np.abs(exact).max()


@pytest.mark.slow
def test_single_precision_and_complex_numbers_are_refused_rather_than_cut(tmp_path: Path) -> None:
    generate(plain_project(), "jax", tmp_path)
    code = (
        "import jax, numpy as np, plain_robot as module\n"
        "for numbers in (np.array([0.1, 0.2]), np.array([0.1 + 1j, 0.2])):\n"
        "    try:\n        module.torque(numbers, np.array([1.0, 2.0]))\n"
        "    except Exception as error:\n        print(f'{type(error).__name__}: {error}')\n"
        "    jax.config.update('jax_enable_x64', True)\n"
    )
    single, cut = run([sys.executable, "-c", code], tmp_path).strip().splitlines()
    assert single.startswith("RuntimeError: ")
    assert 'jax.config.update("jax_enable_x64", True)' in single
    assert cut == "ValueError: q must be real, got complex128"


@pytest.mark.slow
def test_a_changed_table_fails_the_self_test(wam_generated: Project, tmp_path: Path) -> None:
    generate(project_of("WAM", [wam_generated.functions[1]]), "jax", tmp_path)
    assert self_test_of(tmp_path) == 0
    mutated(tmp_path / "wam.py", r'^        "mul",$'.replace("^", "(?m:^").replace("$", "$)"), '        "add",')
    assert self_test_of(tmp_path) == 1


def test_small_modules_hold_no_machinery_for_vectors(wam_generated: Project) -> None:
    text = files(project_of("WAM", [wam_generated.functions[0]]), "jax")["wam.py"]
    assert "_computed" not in text
    assert "numpy as np" not in text
