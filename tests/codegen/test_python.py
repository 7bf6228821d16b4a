"""Generated NumPy modules, run in processes of their own."""

import ast
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from steelyard.codegen import Project, files, generate
from steelyard.graph import Argument, Function, Graph, Output

from .conftest import inputs_of, project_of
from .scripts import PYTHON, module_of, mutated, needs, plain_project, run_python, self_test_of, several_functions


@pytest.mark.parametrize("name", [pytest.param("wam_generated", marks=pytest.mark.slow), "odd_generated"])
def test_functions_agree_at_fresh_inputs(name: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    run_python("python", request.getfixturevalue(name), tmp_path)


@pytest.mark.slow
def test_several_outputs_and_arguments_called_like_functions(tmp_path: Path) -> None:
    project = several_functions()
    run_python("python", project, tmp_path)
    tree = ast.parse((tmp_path / "elbow.py").read_text(encoding="utf-8"))
    found = {node.name: [a.arg for a in node.args.args] for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert found["gravity"] == ["q", "parameters", "gravity"]
    assert found["jacobian"] == ["q", "point"]


def test_batches_broadcast(wam_generated: Project, tmp_path: Path) -> None:
    module = module_of(wam_generated, "python", tmp_path)
    function = wam_generated.functions[0]
    random = np.random.default_rng(5)
    values = inputs_of([function], random, 6)
    values["parameters"] = values["parameters"][0]
    expected = function.evaluate(values)["torque"]
    np.testing.assert_allclose(module.inverse_dynamics(**values), expected, rtol=1e-12, atol=1e-12)
    grid = {name: v.reshape(2, 3, 7) if v.ndim == 2 else v for name, v in values.items()}
    np.testing.assert_array_equal(module.inverse_dynamics(**grid), module.inverse_dynamics(**values).reshape(2, 3, 7))
    outer = module.inverse_dynamics(grid["q"][:, :1], grid["dq"][:1], grid["ddq"][0, 0], values["parameters"])
    assert outer.shape == (2, 3, 7)
    single = module.inverse_dynamics(*(v[0] if v.ndim == 2 else v for v in values.values()))
    np.testing.assert_allclose(single, expected[0], rtol=1e-12, atol=1e-12)
    regressor = module.regressor(values["q"], values["dq"], values["ddq"])
    assert regressor.shape == (6, *wam_generated.functions[1].outputs[0].shape)


def test_arguments_stay_as_they_are_and_outputs_are_new(tmp_path: Path) -> None:
    x = Graph().inputs("x", 2)
    same = Function("same", (Argument("x", 2),), (Output("y", (2,), tuple(x)), Output("z", (), (x[0],))))
    module = module_of(project_of("same", [same]), "python", tmp_path)
    given = np.array([1.0, 2.0])
    y, z = module.same(given)
    y[0] = 7.0
    assert given.tolist() == [1.0, 2.0]
    assert z.shape == ()


def test_wrong_sizes_are_refused(wam_generated: Project, tmp_path: Path) -> None:
    module = module_of(wam_generated, "python", tmp_path)
    seven = np.zeros(7)
    for wrong in (np.zeros(6), 1.0, np.zeros((7, 1))):
        with pytest.raises(ValueError, match=r"dq must have shape \(\.\.\., 7\), got"):
            module.regressor(seven, wrong, seven)


def test_sizes_and_names_are_exported(tmp_path: Path) -> None:
    module = module_of(several_functions(), "python", tmp_path)
    assert (module.Q_SIZE, module.GRAVITY_SIZE, module.JACOBIAN_ROWS, module.JACOBIAN_COLUMNS) == (3, 3, 6, 3)
    assert (module.JOINT_COUNT, module.LOWEST, module.TIME_STEP) == (7, -3, 0.002)
    assert all(hasattr(module, name) for name in module.__all__)
    public = {name for name in vars(module) if not name.startswith("_")}
    assert public == {*module.__all__, "annotations", "np", "Array", "ArrayLike", "NDArray"}


def test_every_element_is_documented(tmp_path: Path) -> None:
    project = several_functions()
    module = module_of(project, "python", tmp_path)
    assert module.__doc__
    for function in project.functions:
        text = re.sub(r"\s+", " ", module.__doc__ + str(getattr(module, function.name).__doc__))
        assert re.search(r"Parameters -{10}.* Returns -{7}", text)
        for argument in function.arguments:
            assert f"{argument.name} : array_like (..., {argument.width}) {argument.description}" in text
            for k, element in enumerate(argument.elements):
                assert re.search(rf"{argument.name}\[\.\.\., {k}\](``)?: {re.escape(element)}", text)
        for output in function.outputs:
            assert (
                f"{output.name} : ndarray (...{''.join(f', {n}' for n in output.shape)}) {output.description}" in text
            )


@pytest.mark.slow
@pytest.mark.parametrize(
    "language", [name if name == "python" else pytest.param(name, marks=pytest.mark.slow) for name in PYTHON]
)
def test_self_test_passes_and_notices_changes(language: str, tmp_path: Path) -> None:
    needs(language)
    generate(plain_project(), language, tmp_path)
    assert self_test_of(tmp_path) == 0
    path = tmp_path / "plain_robot.py"
    good = path.read_text(encoding="utf-8")
    for pattern, replacement in ((r"\.sin\(", ".cos("), (r"parameters\[1\]", "parameters[0]"), (r" - q\[0\]", "")):
        mutated(path, pattern, replacement)
        assert path.read_text(encoding="utf-8") != good
        assert self_test_of(tmp_path) == 1, pattern
        path.write_text(good, encoding="utf-8")


def test_self_test_notices_what_is_not_a_number(tmp_path: Path) -> None:
    generate(plain_project(), "python", tmp_path)
    mutated(tmp_path / "plain_robot.py", r"\.sin\(", ".arccosh(-1 - 0 * ")
    assert self_test_of(tmp_path) == 1


@pytest.mark.slow
def test_pytest_runs_the_self_test(tmp_path: Path) -> None:
    generate(plain_project(), "python", tmp_path)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "."]
    alone = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = subprocess.run(command, cwd=tmp_path, env=alone, capture_output=True, text=True, check=False)
    assert "2 passed" in done.stdout


@pytest.mark.parametrize("language", PYTHON)
def test_package_description(language: str) -> None:
    written = files(plain_project(name="KUKA LBR iiwa (7)"), language)
    description = tomllib.loads(written["pyproject.toml"])
    assert description["project"]["name"] == "kuka-lbr-iiwa-7"
    assert description["tool"]["setuptools"]["py-modules"] == ["kuka_lbr_iiwa_7"]
    assert set(written) == {"README.md", "pyproject.toml", "kuka_lbr_iiwa_7.py", "test_kuka_lbr_iiwa_7.py"}
    requirement = {"python": "numpy", "jax": "jax", "casadi": "casadi"}[language]
    assert [r.partition(">")[0] for r in description["project"]["dependencies"]] == [requirement]


@pytest.mark.parametrize("name", ["numpy", "random", "json", "Types", "class", "match", "unittest", "jax", "test"])
def test_a_robot_never_hides_a_module(name: str) -> None:
    assert f"{name.lower()}_robot.py" in files(plain_project(name=name), "python")


@pytest.fixture(scope="module")
def types(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where mypy keeps what it knows of NumPy, which takes it longest."""
    return tmp_path_factory.mktemp("mypy")


@pytest.mark.slow
@pytest.mark.parametrize("language", PYTHON)
def test_modules_are_typed(language: str, types: Path, tmp_path: Path) -> None:
    """Checked strictly where mypy is installed, which generated code must please in users' projects."""
    needs(language)
    pytest.importorskip("mypy", reason="mypy is not installed")
    generate(several_functions(), language, tmp_path)
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--ignore-missing-imports",
        "--cache-dir",
        str(types),
        "elbow.py",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
def test_long_functions_stay_within_the_limits_of_python(tmp_path: Path) -> None:
    """Twenty thousand assignments, each on the last: no nesting that a parser gives up on."""
    graph = Graph()
    (x,) = graph.inputs("x", 1)
    value = x
    for k in range(20_000):
        value = value * 0.999 + (0.5 + k % 7) * x
    chain = Function("chain", (Argument("x", 1),), (Output("y", (), (value,)),))
    run_python("python", project_of("long", [chain]), tmp_path)
