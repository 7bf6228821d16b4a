"""Projects to generate, and compilers that turn generated source into functions to call."""

import ctypes
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from compilers import C_FLAGS as C_FLAGS
from compilers import need as need
from compilers import run as run
from exported_functions import odd_function as odd_function
from exported_functions import wam_with_friction as wam_with_friction
from numpy.typing import NDArray
from published_arms import WAM_ROWS

import steelyard as sy
from steelyard.codegen import Constant, Project, generate
from steelyard.graph import Argument, Function, Graph, Output, cos, exp, log, sign, sin, sqrt

Array = NDArray[np.float64]
Compiled = Callable[..., list[Array]]

CPP_FLAGS = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow"]
RUST_FLAGS = ["--edition", "2021", "-D", "warnings"]
TOOLS = {"c": "gcc", "cpp": "g++", "rust": "rustc"}
STANDARD = ["--cfg", 'feature="std"']


def inputs_of(functions: Sequence[Function], random: np.random.Generator, samples: int) -> dict[str, Array]:
    """Draw values of all the arguments."""
    widths = {argument.name: argument.width for function in functions for argument in function.arguments}
    return {name: random.uniform(-2.0, 2.0, (samples, width)) for name, width in widths.items()}


def project_of(name: str, functions: Sequence[Function], description: str = "") -> Project:
    reference = inputs_of(functions, np.random.default_rng(7), 2)
    constants = (
        Constant("joint_count", 7, description),
        Constant("lowest", -3, description),
        Constant("time_step", 0.002, description),
    )
    return Project(name, tuple(functions), description, constants, reference, "1.2.3")


@pytest.fixture
def quick_compilation() -> Iterator[None]:
    """Let XLA compile without most of its optimisations, which take half of the time; others test what they do."""
    jax = pytest.importorskip("jax", reason="JAX is not installed")
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", False)


@pytest.fixture(scope="session")
def wam_generated() -> Project:
    """The WAM's inverse dynamics and its regressor, mostly zeros."""
    robot = sy.Robot.from_dh(WAM_ROWS, name="WAM").with_terms(sy.Viscous(), sy.Coulomb())
    model = sy.Model(robot)
    return project_of("WAM", [model.function("inverse_dynamics"), model.function("regressor")], "A 7-joint arm.")


def _arithmetic() -> Function:
    graph = Graph()
    a, b, c, d, e = graph.inputs("x", 5)
    values = {
        "a minus (b plus c)": a - (b + c),
        "(a minus b) minus c": (a - b) - c,
        "a minus (b minus c)": a - (b - c),
        "a over (b times c)": a / (b * c),
        "(a over b) times c": (a / b) * c,
        "a over (b over c)": a / (b / c),
        "(a over b) over c": (a / b) / c,
        "a times (b over c)": a * (b / c),
        "minus (a times b) plus c over d": (-(a * b) + c) / d,
        "minus of a sum": -(a + d * e),
        "square": (a + b) * (a + b),
        "sign": sign(a - b) * sign(c) + sign(d),
        "sine alone": sin(a * b),
        "cosine alone": cos(d - e),
        "sine and cosine": sin(e) * cos(e) - sin(a + e) / (2.5 + cos(a + e)),
        "small and large constants": 1e-300 * a * 1e300 + 5e-324 * b - 1.7976931348623157e308 * (c * 1e-308),
        "square root": sqrt(a * a + b * b) - sqrt(c * c) * d,
        "exponential": exp(-(a * a)) * exp(b - c) / exp(d),
        "logarithm": log(a * a + 0.5) - log(b * b + 1e-300),
        "negative constants": a * -0.1 + -3.0 / (4.0 + b * b) - (-7.5 - c),
    }
    return Function(
        "arithmetic",
        (Argument("x", 5),),
        (Output("y", (len(values),), tuple(values.values()), "; ".join(values)), Output("z", (), (a * b * c + d,))),
        "Groups and signs.",
    )


def _odd() -> list[Function]:
    """Names that are keywords, locals or macros; arguments that nothing reads; outputs that are inputs or constants."""
    names = ("class", "double", "t1", "s1", "c1", "i", "fn", "NULL", "linux", "sample", "q_size", "Q_SIZE")
    graph = Graph()
    x = {name: graph.inputs(name, 2) for name in names}
    total = graph.zero
    for k, name in enumerate(names):
        if name != "double":
            total = total + sin(x[name][0]) * cos(x[name][0]) * (k + 1.0) + x[name][1] * x["i"][0]
    words = Function(
        "int",
        tuple(Argument(name, 2) for name in names),
        (
            Output("while", (), (total,)),
            Output("register", (2,), (x["linux"][1], total * total)),
            Output("std", (2, 3), tuple(graph.constant(v) for v in (0.0, 1.0 / 3.0, -2.0, 1e22, 0.0, 5e-324))),
        ),
    )
    nothing = Graph()
    zeros = Function("main", (), (Output("zeros", (3, 4), (nothing.zero,) * 12), Output("one", (), (nothing.one,))))
    cube = Graph()
    p = cube.inputs("p", 3)
    nodes = [cube.zero] * 27
    nodes[5], nodes[26] = p[0] * p[1], p[2]
    tensor = Function(
        "tensor",
        (Argument("p", 3, True), Argument("empty", 0), Argument("unused", 4)),
        (Output("T", (3, 3, 3), tuple(nodes)),),
    )
    return [words, zeros, tensor, _arithmetic()]


@pytest.fixture(scope="session")
def odd_generated() -> Project:
    return project_of("7 odd/robots", _odd())


def source_of(language: str, folder: Path) -> Path:
    """The file with the functions."""
    if language == "rust":
        return folder / "src" / "lib.rs"
    (path,) = (p for p in folder.glob(f"*.{language}") if not p.stem.endswith("_test"))
    return path


def build_self_test(language: str, folder: Path) -> Path:
    """Compile the self-test with all warnings as errors, as its CMake or Cargo project would."""
    need(TOOLS[language])
    program = folder / "self_test"
    source = source_of(language, folder)
    if language == "c":
        run(["gcc", *C_FLAGS, source, source.with_name(f"{source.stem}_test.c"), "-lm", "-o", program], folder)
    elif language == "cpp":
        run(["g++", *CPP_FLAGS, source, source.with_name(f"{source.stem}_test.cpp"), "-o", program], folder)
    else:
        crate = crate_of(folder)
        compile_crate(folder, STANDARD)
        test = folder / "tests" / "reference.rs"
        extern = f"{crate}={folder / f'lib{crate}.rlib'}"
        run(["rustc", *RUST_FLAGS, "--test", "--extern", extern, test, "-o", program], folder)
    return program


def crate_of(folder: Path) -> str:
    found = re.search(r'^name = "(\w+)"$', (folder / "Cargo.toml").read_text(encoding="utf-8"), re.MULTILINE)
    assert found is not None
    return found[1]


def compile_crate(folder: Path, flags: Sequence[str]) -> None:
    crate = crate_of(folder)
    library = ["--crate-type", "rlib", "--crate-name", crate, "-o", folder / f"lib{crate}.rlib"]
    run(["rustc", *RUST_FLAGS, *flags, *library, "src/lib.rs"], folder)


def compiled(language: str, project: Project, folder: Path, flags: Sequence[str] = STANDARD) -> list[Compiled]:
    """Generate a project, compile it into a shared library, and return its functions, to call with 1-D arrays."""
    need(TOOLS[language])
    generate(project, language, folder)
    source = source_of(language, folder)
    shared = folder / "shared.so"
    if language == "c":
        run(["gcc", *C_FLAGS, "-shared", "-fPIC", source, "-lm", "-o", shared], folder)
        names = re.findall(r"^void (\w+)\(", source.read_text(encoding="utf-8"), re.MULTILINE)
    elif language == "cpp":
        wrapper = folder / "wrapper" / "wrapper.cpp"
        wrapper.parent.mkdir()
        wrapper.write_text(_cpp_wrapper(project, source), encoding="utf-8")
        run(["g++", *CPP_FLAGS, "-shared", "-fPIC", "-I", folder, source, wrapper, "-o", shared], folder)
        names = [f"call_{k}" for k in range(len(project.functions))]
    else:
        compile_crate(folder, flags)
        wrapper = folder / "wrapper.rs"
        wrapper.write_text(_rust_wrapper(project, source, crate_of(folder)), encoding="utf-8")
        extern = f"{crate_of(folder)}={folder / f'lib{crate_of(folder)}.rlib'}"
        run(["rustc", *RUST_FLAGS, "--crate-type", "cdylib", "--extern", extern, wrapper, "-o", shared], folder)
        names = [f"call_{k}" for k in range(len(project.functions))]
    library = ctypes.CDLL(str(shared))
    return [_callable(getattr(library, n), f) for n, f in zip(names, project.functions, strict=True)]


def _callable(pointer: Callable[..., None], function: Function) -> Compiled:
    def call(*inputs: Array) -> list[Array]:
        arrays = [np.ascontiguousarray(values, dtype=np.float64) for values in inputs]
        outputs = [np.full(output.size, np.nan) for output in function.outputs]
        pointer(*(ctypes.c_void_p(array.ctypes.data) for array in (*arrays, *outputs)))
        return outputs

    return call


def _cpp_wrapper(project: Project, source: Path) -> str:
    text = source.read_text(encoding="utf-8")
    (namespace,) = re.findall(r"^namespace ([\w:]+) \{", text, re.MULTILINE)
    names = re.findall(r"^void (\w+)\(", text, re.MULTILINE)
    lines = [f'#include "{source.stem}.hpp"', "#include <algorithm>", 'extern "C" {']
    for k, (function, name) in enumerate(zip(project.functions, names, strict=True)):
        arguments = [f"const double* in{j}" for j in range(len(function.arguments))]
        arguments += [f"double* out{j}" for j in range(len(function.outputs))]
        body, passed = [], []
        for j, argument in enumerate(function.arguments):
            body.append(f"std::array<double, {argument.width}> a{j};")
            body.append(f"std::copy_n(in{j}, {argument.width}, a{j}.begin());")
            passed.append(f"a{j}")
        for j, output in enumerate(function.outputs):
            body.append(f"std::array<double, {output.size}> b{j};" if output.shape else f"double b{j};")
            passed.append(f"b{j}")
        body.append(f"{namespace}::{name}({', '.join(passed)});")
        for j, output in enumerate(function.outputs):
            body.append(f"std::copy_n({f'b{j}.begin()' if output.shape else f'&b{j}'}, {output.size}, out{j});")
        prototype = f"void call_{k}({', '.join(arguments)})"
        lines += [f"{prototype};", f"{prototype} {{ {' '.join(body)} }}"]
    return "\n".join([*lines, "}", ""])


def _rust_wrapper(project: Project, source: Path, crate: str) -> str:
    names = re.findall(r"^pub fn (\w+)\(", source.read_text(encoding="utf-8"), re.MULTILINE)
    lines = []
    for k, (function, name) in enumerate(zip(project.functions, names, strict=True)):
        arguments = [f"a{j}: &[f64; {argument.width}]" for j, argument in enumerate(function.arguments)]
        for j, output in enumerate(function.outputs):
            arguments.append(f"b{j}: &mut {f'[f64; {output.size}]' if output.shape else 'f64'}")
        passed = [argument.partition(":")[0] for argument in arguments]
        lines.append(f'#[no_mangle] pub extern "C" fn call_{k}({", ".join(arguments)})')
        lines.append(f"{{ {crate}::{name}({', '.join(passed)}); }}")
    return "\n".join([*lines, ""])
