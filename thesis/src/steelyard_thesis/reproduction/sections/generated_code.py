"""Section 7.1.4: operations and time of generated inverse dynamics."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from steelyard.dynamics import Model
from steelyard.identification.wam import DH_ROWS
from steelyard.robot import Robot

from ..comparison import Comparison
from ..published import rows
from ..section import Context, Section, SectionResult, Table

__all__ = ["ROBOTS", "SECTION"]

# Standard Denavit-Hartenberg rows: the arms of the literature that the table names.
_PUMA = (
    ("pi/2", 0, 0, "q"),
    (0, 0.4318, 0, "q"),
    ("-pi/2", 0.0203, 0.15005, "q"),
    ("pi/2", 0, 0.4318, "q"),
    ("-pi/2", 0, 0, "q"),
    (0, 0, 0, "q"),
)
_STANFORD = (
    ("-pi/2", 0, 0.412, "q"),
    ("pi/2", 0, 0.154, "q"),
    (0, 0, "q", "-pi/2"),
    ("-pi/2", 0, 0, "q"),
    ("pi/2", 0, 0, "q"),
    (0, 0, 0.263, "q"),
)
ROBOTS: dict[str, Sequence[Sequence[str | float]]] = {"Stanford": _STANFORD, "Puma 560": _PUMA, "WAM 7-DOF": DH_ROWS}
_REPEATS = 200  # calls whose mean is one measurement


def _compute(context: Context) -> SectionResult:
    published = {row["quantity"]: row for row in rows("7.1")}
    measured: list[tuple[str | float, ...]] = []
    comparisons = []
    for name, links in ROBOTS.items():
        context.say(name)
        begin = time.perf_counter()
        model = Model(Robot.from_dh(links, name="arm"))
        with tempfile.TemporaryDirectory() as folder:
            model.generate("c", ["inverse_dynamics"], directory=folder)
            seconds = time.perf_counter() - begin
            count = model.operation_count("inverse_dynamics")
            c = _time_of_c(Path(folder), model)
        with tempfile.TemporaryDirectory() as folder:
            model.generate("python", ["inverse_dynamics"], directory=folder)
            python = _time_of_python(Path(folder), model)
        for kind, key in (("additions", "add"), ("multiplications", "mul")):
            theirs = float(published[kind][name])
            fewer = "fewer" if count[key] < theirs else "more"
            comparisons.append(
                Comparison(
                    f"{kind} of inverse dynamics, {name}",
                    theirs,
                    float(count[key]),
                    0.0,
                    f"{abs(count[key] - theirs):.0f} {fewer}: another algorithm and other simplifications",
                )
            )
        theirs_c, theirs_python = (float(published[f"{what} execution (us)"][name]) for what in ("C", "Python"))
        measured.append(
            (name, seconds, float(published["code generation time (s)"][name]), c, theirs_c, python, theirs_python)
        )
    table = Table(
        "Times, on this machine and on that of the thesis (Intel i3-380M)",
        ("robot", "generation, s", "published", "C, µs", "published", "Python, µs", "published"),
        tuple(measured),
    )
    return SectionResult(
        tuple(comparisons), (table,), remarks=("Times differ from run to run and do not count as values.",)
    )


def _best(call: Callable[[], object]) -> float:
    """Return the best time of a call in µs."""
    best = np.inf
    for _ in range(7):
        begin = time.perf_counter()
        for _ in range(_REPEATS):
            call()
        best = min(best, (time.perf_counter() - begin) / _REPEATS)
    return 1e6 * best


def _time_of_c(folder: Path, model: Model) -> float:
    """Return the time of a call of the C function in a loop in C, µs; NaN without a compiler."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        return float("nan")
    n, p = model.dof, model.parameter_count
    loop = f"""
#include "arm.h"
double run(long count) {{
    double q[{n}], dq[{n}], ddq[{n}], delta[{p}], tau[{n}], sum = 0.0;
    for (int i = 0; i < {n}; ++i) {{ q[i] = 0.1 * i; dq[i] = 0.2 - 0.1 * i; ddq[i] = 0.3 * i; }}
    for (int i = 0; i < {p}; ++i) delta[i] = 0.5 + 0.01 * i;
    for (long k = 0; k < count; ++k) {{ q[0] += 1e-6; arm_inverse_dynamics(q, dq, ddq, delta, tau); sum += tau[0]; }}
    return sum;
}}
"""
    (folder / "loop.c").write_text(loop, encoding="utf-8")
    library = folder / "loop.so"
    command = [compiler, "-O2", "-shared", "-fPIC", "loop.c", "arm.c", "-lm", "-o", str(library)]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    run = ctypes.CDLL(str(library)).run
    run.restype, run.argtypes = ctypes.c_double, [ctypes.c_long]
    return _best(lambda: run(100)) / 100.0


def _time_of_python(folder: Path, model: Model) -> float:
    """Return the time of a call of the generated Python function, µs."""
    names: dict[str, object] = {}
    source = folder / "arm.py"
    exec(compile(source.read_text(encoding="utf-8"), str(source), "exec"), names)
    function = names["inverse_dynamics"]
    assert callable(function)
    q, delta = np.linspace(0.1, 0.7, model.dof), np.linspace(0.5, 1.0, model.parameter_count)
    return _best(lambda: function(q, 0.5 * q, -q, delta))


SECTION = Section("7.1.4", "Generated code (table 7.1)", _compute)
