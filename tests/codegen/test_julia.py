"""Generated Julia, evaluated by a reader that knows the language and nothing of how it is written."""

import re
import tomllib
import uuid
from pathlib import Path

import numpy as np
import pytest

from steelyard.codegen import Project, files, generate

from .conftest import need, run
from .julia_reader import DimensionMismatchError, JuliaError, JuliaModule, Reader
from .scripts import check, fresh, plain_project, project_with_names, several_functions


def module_of(written: dict[str, str]) -> JuliaModule:
    (source,) = (text for path, text in written.items() if path.startswith("src/"))
    return Reader(source).module()


@pytest.mark.parametrize("name", [pytest.param("wam_generated", marks=pytest.mark.slow), "odd_generated", "several"])
def test_functions_agree_at_fresh_inputs(name: str, request: pytest.FixtureRequest) -> None:
    project = several_functions() if name == "several" else request.getfixturevalue(name)
    module = module_of(files(project, "julia"))
    inputs = fresh(project)
    found = []
    for julia_name, function, samples in zip(module.functions, project.functions, inputs, strict=True):
        for arrays in samples:
            outputs = [np.full(output.shape, np.nan) for output in function.outputs]
            module.call(julia_name, *outputs, *arrays)
            found.append([output.ravel() for output in outputs])
    check(project, inputs, found)


@pytest.mark.parametrize("name", [pytest.param("wam_generated", marks=pytest.mark.slow), "odd_generated", "several"])
def test_self_test_passes_in_the_reader(name: str, request: pytest.FixtureRequest) -> None:
    project = several_functions() if name == "several" else request.getfixturevalue(name)
    written = files(project, "julia")
    module = module_of(written)
    verdicts = Reader.of_self_test(written["test/runtests.jl"]).run_self_test(module)
    assert list(verdicts) == list(module.functions)
    for function, found in zip(project.functions, verdicts.values(), strict=True):
        assert found == [True] * (len(function.outputs) * project.references[function.name].samples)


@pytest.mark.parametrize(
    ("pattern", "replacement"),
    [(r"parameters\[2\] \*", "parameters[1] *"), (r" - q\[1\]", ""), (r"sin\(q\[1\]\)", "sin(q[2])")],
)
def test_self_test_notices_changes(pattern: str, replacement: str) -> None:
    written = files(plain_project(), "julia")
    text, count = re.subn(pattern, replacement, written["src/PlainRobot.jl"])
    assert count == 1
    verdicts = Reader.of_self_test(written["test/runtests.jl"]).run_self_test(Reader(text).module())
    assert not all(verdicts["torque!"])


def test_the_package() -> None:
    written = files(several_functions(), "julia")
    assert set(written) == {"Project.toml", "README.md", "src/Elbow.jl", "test/runtests.jl"}
    description = tomllib.loads(written["Project.toml"])
    assert description["name"] == "Elbow"
    assert uuid.UUID(description["uuid"]).version == 5
    assert description["targets"] == {"test": ["Test"]}
    assert description["uuid"] != tomllib.loads(files(plain_project(name="elbow"), "julia")["Project.toml"])["uuid"]
    module = module_of(written)
    assert module.name == "Elbow"
    assert module.exported == [*module.functions, *module.constants]
    assert (module.constants["Q_SIZE"], module.constants["JACOBIAN_COLUMNS"]) == (3, 3)
    assert [name for name, _ in module.functions["gravity!"].parameters] == ["torque", "q", "parameters", "gravity"]


def test_every_element_is_documented() -> None:
    project = several_functions()
    (source,) = (text for path, text in files(project, "julia").items() if path.startswith("src/"))
    text = re.sub(r"\s+", " ", source.replace("\n#", "\n"))
    for function in project.functions:
        for argument in function.arguments:
            for k, element in enumerate(argument.elements):
                assert re.search(rf"{argument.name}\[{k + 1}\]`?: {re.escape(element)}", text)
    for name, function in Reader(source).module().functions.items():
        documented = re.sub(r"\s+", " ", function.documentation)
        arguments = ", ".join(parameter for parameter, _ in function.parameters)
        assert documented.startswith(f'raw""" {name}({arguments}) ')


def test_wrong_sizes_are_refused() -> None:
    module = module_of(files(several_functions(), "julia"))
    three = np.zeros(3)
    module.call("jacobian!", np.zeros((6, 3)), three, three)
    for wrong in (
        (np.zeros((3, 6)), three, three),
        (np.zeros((6, 3)), np.zeros(2), three),
        (np.zeros((6, 3)), three, np.zeros(4)),
    ):
        with pytest.raises(DimensionMismatchError, match="must have"):
            module.call("jacobian!", *wrong)


@pytest.mark.parametrize("name", ["Base", "test", "linear algebra", "random", "end", "Main"])
def test_a_robot_never_hides_a_package(name: str) -> None:
    module = module_of(files(plain_project(name=name), "julia"))
    assert module.name.endswith("Robot")


# What the parser of Julia takes for no name of an argument.
KEYWORDS = re.findall(
    r"\w+",
    """
baremodule begin break catch ccall cglobal const continue do else elseif end export false finally for function global if
import let local macro module quote return struct true try using while in isa
""",
)


def test_keywords_are_no_names() -> None:
    project = project_with_names(KEYWORDS)
    for function in module_of(files(project, "julia")).functions.values():
        assert len(function.parameters) == len(KEYWORDS) + 1
        assert not {name for name, _ in function.parameters} & set(KEYWORDS)


BODY = """module M
@doc raw\"\"\"
    f!(y, x)
\"\"\"
function f!(
    y::AbstractVector{Float64},
    x::AbstractVector{Float64},
)
    @inbounds begin
        LINE
    end
    return nothing
end
end
"""


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("x[1] - (x[2] - 0.5)", 3.0 - (5.0 - 0.5)),
        ("x[1] - x[2] - 0.5", 3.0 - 5.0 - 0.5),
        ("x[1] / x[2] / 2.0", 3.0 / 5.0 / 2.0),
        ("x[1] / (x[2] / 2.0)", 3.0 / (5.0 / 2.0)),
        ("-x[1] * x[2] + 1e-1", -15.0 + 0.1),
        ("2.0 + 3.0 * -(x[1] + 1.0)", 2.0 - 12.0),
    ],
)
def test_the_reader_groups_as_julia_does(expression: str, value: float) -> None:
    y = np.zeros(1)
    Reader(BODY.replace("LINE", f"y[1] = {expression}")).module().call("f!", y, np.array([3.0, 5.0]))
    assert y[0] == value


@pytest.mark.parametrize(
    "line",
    [
        "y[1] = 2x[1]",
        "y[1] = x[1] * 2.0; run(`true`)",
        'y[1] = "$(x)"',
        "y[1] = 2.0(x[1])",
        "y[0] = x[1]",
        "y[1] = x[3]",
        "y[1, 1] = x[1]",
        "y[1] = 2 * x[1]",
        "t1 = x[1]\n t1 = x[2]",
        "y[1] = z",
        "#= y[1] = x[1] =#",
        "while true",
    ],
)
def test_the_reader_refuses_what_is_wrong(line: str) -> None:
    with pytest.raises((JuliaError, AssertionError, KeyError)):
        Reader(BODY.replace("LINE", line)).module().call("f!", np.zeros(1), np.array([3.0, 5.0]))


def test_julia_runs_where_it_is_installed(wam_generated: Project, odd_generated: Project, tmp_path: Path) -> None:
    need("julia")
    projects = (wam_generated, odd_generated, several_functions(), project_with_names(KEYWORDS))
    for k, project in enumerate(projects):
        generate(project, "julia", tmp_path / str(k))
        run(["julia", "--startup-file=no", "--project=.", "test/runtests.jl"], tmp_path / str(k))
