"""Generated C, C++ and Rust, compiled without a warning, against the interpreter and the kernels."""

import re
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import steelyard as sy
from steelyard.codegen import Project, generate
from steelyard.codegen.rust import EXPONENTIAL, SQUARE_ROOT
from steelyard.graph import Argument, Function, Graph, Kernel, Output, cos, sin

from .conftest import (
    C_FLAGS,
    CPP_FLAGS,
    RUST_FLAGS,
    STANDARD,
    Compiled,
    build_self_test,
    compiled,
    need,
    project_of,
    run,
    source_of,
)

LANGUAGES = ("c", "cpp", "rust")
# Compilers of C++ and Rust take longer than that of C: the fast tests have one comparison and one self-test of each.
COMPARED = ["c", *(pytest.param(language, marks=pytest.mark.slow) for language in LANGUAGES[1:])]
OTHERS = {("cpp", "wam_generated"), ("cpp", "odd_generated"), ("rust", "odd_generated")}
TOLERANCE = 1e-12  # of the largest value of an output


def largest_difference(project: Project, functions: Sequence[Compiled], samples: int = 5) -> float:
    """Compare with the interpreter and the kernels at fresh inputs, relative to the size of each output."""
    random = np.random.default_rng(20240229)
    worst = 0.0
    for function, call in zip(project.functions, functions, strict=True):
        kernel = Kernel(function)
        ends = np.cumsum([output.size for output in function.outputs])[:-1]
        for _ in range(samples):
            values = [random.uniform(-3.0, 3.0, argument.width) for argument in function.arguments]
            expected = function.evaluate({a.name: v for a, v in zip(function.arguments, values, strict=True)})
            batch = [v if a.uniform else v[None] for a, v in zip(function.arguments, values, strict=True)]
            of_kernel = np.split(kernel(*batch)[0], ends)
            for output, found, other in zip(function.outputs, call(*values), of_kernel, strict=True):
                target = expected[output.name].ravel()
                difference = max(np.abs(found - target).max(), np.abs(found - other).max())
                assert np.isfinite(difference)
                worst = max(worst, difference / max(np.abs(target).max(), 1e-300))
    return worst


@pytest.mark.parametrize("language", COMPARED)
def test_robot_functions_agree_at_fresh_inputs(language: str, wam_generated: Project, tmp_path: Path) -> None:
    assert largest_difference(wam_generated, compiled(language, wam_generated, tmp_path)) < TOLERANCE


@pytest.mark.parametrize("language", LANGUAGES)
def test_odd_functions_agree_at_fresh_inputs(language: str, odd_generated: Project, tmp_path: Path) -> None:
    assert largest_difference(odd_generated, compiled(language, odd_generated, tmp_path)) < TOLERANCE


def _long() -> Project:
    """Functions long enough to be cut into parts: one whose parts share nothing, and one whose parts share much."""
    graph = Graph()
    x = graph.inputs("x", 2100)
    apart = Function("apart", (Argument("x", 2100),), (Output("y", (2100,), tuple(sin(value) for value in x)),))
    graph = Graph()
    z, kept = graph.inputs("z", 3), graph.inputs("kept", 2)
    values = [z[0] * kept[0], z[1] + kept[1], z[2]]
    for k in range(1200):
        values.append(0.5 * sin(values[-1]) - 0.3 * values[k // 2])
    zeros = [graph.zero] * 900
    outputs = (Output("all", (2, 3, 350), (*values, *zeros)[:2100]), Output("last", (), (values[-1],)))
    return project_of("long", [apart, Function("chain", (Argument("z", 3), Argument("kept", 2, True)), outputs)])


@pytest.mark.slow
@pytest.mark.parametrize("language", [pytest.param(n, marks=pytest.mark.slow if n == "cpp" else ()) for n in LANGUAGES])
def test_long_functions_agree_in_parts(language: str, tmp_path: Path) -> None:
    project = _long()
    functions = compiled(language, project, tmp_path)
    assert len(re.findall(r"(?:void|fn) \w+_part_\d+\(", source_of(language, tmp_path).read_text())) >= 10
    assert largest_difference(project, functions, samples=1) < TOLERANCE


@pytest.mark.parametrize("language", COMPARED)
def test_sign_and_not_a_number(language: str, odd_generated: Project, tmp_path: Path) -> None:
    arithmetic = compiled(language, odd_generated, tmp_path)[-1]
    signs = []
    for values in ([1.0, 1.0, 2.0, 3.0, 0.0], [2.0, 1.0, 2.0, -3.0, 0.0], [2.0, 1.0, -2.0, -3.0, 0.0]):
        signs.append(arithmetic(np.array(values))[0][11])
    assert signs == [1.0, 0.0, -2.0]
    y, z = arithmetic(np.array([np.nan, 1.0, 2.0, 3.0, 4.0]))
    assert np.isnan(y[11])
    assert np.isnan(z[0])
    assert np.isfinite(y[13])  # does not depend on what is not a number


@pytest.mark.parametrize(
    ("language", "name"),
    [
        pytest.param(language, name, marks=pytest.mark.slow if (language, name) in OTHERS else ())
        for language in LANGUAGES
        for name in ("wam_generated", "odd_generated")
    ],
)
def test_self_test_passes(language: str, name: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    generate(request.getfixturevalue(name), language, tmp_path)
    assert run([build_self_test(language, tmp_path)], tmp_path)


@pytest.mark.slow
def test_fused_operations_stay_within_the_tolerance(wam_generated: Project, tmp_path: Path) -> None:
    need("gcc")
    generate(wam_generated, "c", tmp_path)
    fused = ["-O3", "-march=native", "-ffp-contract=fast"]
    run(["gcc", *C_FLAGS, *fused, "wam.c", "wam_test.c", "-lm", "-o", "fused"], tmp_path)
    run([tmp_path / "fused"], tmp_path)


MUTATIONS = {
    "a sum": lambda text: re.sub(r"(t\d+ = \S+) \+ ", r"\1 - ", text, count=1),
    "a number": lambda text: text.replace("0.045", "0.0450000001", 1),
    "a place": lambda text: text.replace("torque[3] =", "torque[2] =", 1),
    "not a number": lambda text: re.sub(r"(t1 = )", r"\g<1>(0.0 / 0.0) * ", text, count=1),
}
NOTICED = {("c", "a sum"), ("c", "not a number"), ("rust", "a number")}
"""What the fast tests change."""


@pytest.mark.parametrize(
    ("language", "mutation"),
    [
        pytest.param(language, mutation, marks=() if (language, mutation) in NOTICED else pytest.mark.slow)
        for language, mutation in (*(("c", one) for one in MUTATIONS), ("cpp", "a number"), ("rust", "a number"))
    ],
)
def test_self_test_notices_a_wrong_source(language: str, mutation: str, wam_generated: Project, tmp_path: Path) -> None:
    generate(wam_generated, language, tmp_path)
    source = source_of(language, tmp_path)
    text = source.read_text(encoding="utf-8")
    changed = MUTATIONS[mutation](text)
    assert changed != text
    source.write_text(changed, encoding="utf-8")
    program = build_self_test(language, tmp_path)
    done = subprocess.run([program], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode not in (0, None)
    assert "torque" in done.stdout
    assert "expected" in done.stdout


def test_c_header_serves_cpp(wam_generated: Project, tmp_path: Path) -> None:
    need("gcc")
    need("g++")
    generate(wam_generated, "c", tmp_path)
    (tmp_path / "main.cpp").write_text(
        """
        #include "wam.h"
        int main() {
            double q[WAM_Q_SIZE] = {}, dq[WAM_DQ_SIZE] = {}, ddq[WAM_DDQ_SIZE] = {};
            double parameters[WAM_PARAMETERS_SIZE] = {};
            double torque[WAM_INVERSE_DYNAMICS_TORQUE_SIZE];
            dq[1] = -1.0;
            parameters[12 + 11] = 0.25;  // Coulomb friction of the second joint
            wam_inverse_dynamics(q, dq, ddq, parameters, torque);
            return torque[1] == -0.25 && WAM_JOINT_COUNT == 7 && WAM_LOWEST == -3 && WAM_TIME_STEP == 0.002 ? 0 : 1;
        }
        """,
        encoding="utf-8",
    )
    run(["gcc", *C_FLAGS, "-c", "wam.c", "-o", "wam.o"], tmp_path)
    run(["g++", *CPP_FLAGS, "main.cpp", "wam.o", "-lm", "-o", "main"], tmp_path)
    run([tmp_path / "main"], tmp_path)


def test_every_element_of_an_argument_is_documented(wam_generated: Project, tmp_path: Path) -> None:
    parameters = wam_generated.functions[0].arguments[3]
    assert len(parameters.elements) == parameters.width == 84
    for language in LANGUAGES:
        folder = tmp_path / language
        generate(wam_generated, language, folder)
        pattern = r"parameters\[(\d+)\]`?: (\w+):"
        header = source_of(language, folder).with_suffix({"c": ".h", "cpp": ".hpp", "rust": ".rs"}[language])
        documented = dict(re.findall(pattern, header.read_text(encoding="utf-8")))
        expected = {str(k): text.partition(":")[0] for k, text in enumerate(parameters.elements)}
        assert documented == expected
        readme = (folder / "README.md").read_text(encoding="utf-8")
        assert dict(re.findall(r"`parameters\[(\d+)\]` \| (\w+):", readme)) == expected


def _angles() -> Project:
    graph = Graph()
    (x,) = graph.inputs("x", 1)
    outputs = (Output("sine", (), (sin(x),)), Output("cosine", (), (cos(x),)))
    return project_of("angles", [Function("sine_and_cosine", (Argument("x", 1),), outputs)])


def test_sine_and_cosine_without_a_standard_library(tmp_path: Path) -> None:
    (call,) = compiled("rust", _angles(), tmp_path, flags=[])
    random = np.random.default_rng(3)
    quarter_turns = np.arange(-40, 41) * (np.pi / 2)
    far = random.integers(-600_000, 600_000, 200) * (np.pi / 2)
    angles = np.concatenate(
        [
            random.uniform(-7.0, 7.0, 1000),
            random.uniform(-1e6, 1e6, 1000),
            np.concatenate([np.nextafter(quarter_turns, s * np.inf) for s in (-1, 1)]),
            quarter_turns,
            far,
            [0.0, 1e-300, -1e-9, 999_999.9],
        ]
    )
    found = np.array([call(np.array([angle])) for angle in angles])[..., 0]
    expected = np.stack([np.sin(angles), np.cos(angles)], axis=1)
    assert np.abs(found - expected).max() < 5e-16
    assert np.all(np.abs(found - expected) <= 8e-16 * np.abs(expected))  # also where one of them is nearly 0
    assert np.isnan([call(np.array([x])) for x in (np.nan, np.inf, -np.inf, 1.1e6)]).all()


def test_compiling_a_crate_shows_whether_it_uses_the_standard_library(tmp_path: Path) -> None:
    need("rustc")
    generate(_angles(), "rust", tmp_path)
    command = ["rustc", *RUST_FLAGS, "--crate-type", "rlib", "--crate-name", "angles", tmp_path / "src" / "lib.rs"]
    run([*command, "-o", tmp_path / "without.rlib"], tmp_path)
    run([*command, *STANDARD, "-o", tmp_path / "with.rlib"], tmp_path)
    path = tmp_path / "src" / "trigonometry.rs"
    path.write_text(path.read_text(encoding="utf-8").replace('#[cfg(feature = "std")]\nextern crate std;\n', ""))
    with pytest.raises(AssertionError, match="no method named `sin_cos`"):
        run([*command, *STANDARD, "-o", tmp_path / "with.rlib"], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("language", ["c", "cpp"])
def test_cmake_project(language: str, wam_generated: Project, tmp_path: Path) -> None:
    need("cmake")
    generate(wam_generated, language, tmp_path)
    run(["cmake", "-S", ".", "-B", "build"], tmp_path)
    run(["cmake", "--build", "build"], tmp_path)
    assert "100% tests passed" in run(["ctest", "--test-dir", "build"], tmp_path)
    source = source_of(language, tmp_path)
    source.write_text(source.read_text(encoding="utf-8").replace("0.045", "0.046"), encoding="utf-8")
    run(["cmake", "--build", "build"], tmp_path)
    with pytest.raises(AssertionError, match="reference_values"):
        run(["ctest", "--test-dir", "build"], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("options", [[], ["--no-default-features"]])
def test_cargo_project_needs_no_network(options: list[str], wam_generated: Project, tmp_path: Path) -> None:
    need("cargo")
    generate(wam_generated, "rust", tmp_path)
    assert "2 passed" in run(["cargo", "test", "--offline", *options], tmp_path)
    run(["cargo", "doc", "--offline", *options], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("language", LANGUAGES)
def test_a_humanoid_compiles(language: str, tmp_path: Path) -> None:
    rows = [(("pi/2", "-pi/2")[k % 2], 0.1 + 0.01 * k, 0.05 * k, "q") for k in range(36)]
    model = sy.Model(sy.Robot.from_dh(rows, name="chain of 36"))
    project = project_of("chain of 36", [model.function("inverse_dynamics"), model.function("regressor")])
    assert largest_difference(project, compiled(language, project, tmp_path), samples=1) < 1e-11


def test_the_square_root_without_a_standard_library(tmp_path: Path) -> None:
    """Within one unit in the last place of the processor's, from the smallest numbers to the largest."""
    need("rustc")
    check = """
fn main() {
    let mut x = 5.0e-324;
    while x < f64::INFINITY {
        for factor in [1.0, 1.1, 1.5, 1.9, 1.9999] {
            let (ours, exact) = (sqrt(x * factor), (x * factor).sqrt());
            assert!((ours.to_bits() as i64 - exact.to_bits() as i64).abs() <= 1, "{} {} {}", x * factor, ours, exact);
        }
        x *= 2.0;
    }
    assert!(sqrt(-1.0).is_nan() && sqrt(f64::NAN).is_nan());
    assert!(sqrt(0.0) == 0.0 && sqrt(f64::INFINITY) == f64::INFINITY);
}
"""
    (tmp_path / "root.rs").write_text(SQUARE_ROOT.replace("//!", "//") + check)
    run(["rustc", "-A", "unexpected_cfgs", "-O", "root.rs", "-o", "root"], tmp_path)
    run([str(tmp_path / "root")], tmp_path)


@pytest.mark.slow
def test_exponentials_without_a_standard_library(tmp_path: Path) -> None:
    """Within two units in the last place of the standard library's, from the smallest numbers to the largest."""
    need("rustc")
    check = """
fn near(ours: f64, exact: f64, x: f64) {
    assert!((ours.to_bits() as i64 - exact.to_bits() as i64).abs() <= 2, "{} {} {}", x, ours, exact);
}

fn main() {
    let mut x = 5.0e-324;
    while x < f64::INFINITY {
        for factor in [1.0, 1.1, 1.4, 1.5, 1.9, 1.9999] {
            if x * factor < f64::INFINITY {
                near(log(x * factor), (x * factor).ln(), x * factor);
            }
        }
        x *= 2.0;
    }
    let mut y = -750.0;
    while y < 720.0 {
        near(exp(y), y.exp(), y);
        y += 0.0137;
    }
    assert!(log(-1.0).is_nan() && log(f64::NAN).is_nan() && exp(f64::NAN).is_nan());
    assert!(log(0.0) == -f64::INFINITY && log(f64::INFINITY) == f64::INFINITY);
    assert!(exp(-f64::INFINITY) == 0.0 && exp(f64::INFINITY) == f64::INFINITY);
}
"""
    (tmp_path / "exponential.rs").write_text(
        EXPONENTIAL.replace("//!", "//").replace("#![allow(dead_code)]", "") + check
    )
    run(["rustc", "-A", "unexpected_cfgs", "-O", "exponential.rs", "-o", "exponential"], tmp_path)
    run([str(tmp_path / "exponential")], tmp_path)
