"""Closed-form conditions on base parameters, against a derivation by hand and against the solver."""

from __future__ import annotations

import shutil
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError, MissingExtraError
from steelyard_thesis import closed_form_conditions
from steelyard_thesis.closed_form import quantifier_elimination

sympy = pytest.importorskip("sympy", reason="closed forms need sympy")
needs_qepcad = pytest.mark.skipif(shutil.which("qepcad") is None, reason="the program qepcad is not installed")

GRAVITY = (0, -9.81, 0)


def planar(lengths: list[float], *terms: Any, gravity: Any = GRAVITY) -> sy.Model:
    robot = sy.Robot.from_dh([(0, a, 0, "q") for a in lengths], gravity=gravity, name="planar")
    return sy.Model(robot.with_terms(*terms))


def evaluated(condition: Any, base: Any) -> bool:
    return bool(condition.xreplace({sympy.Symbol(f"beta{k + 1}", real=True): v for k, v in enumerate(base)}))


def around_feasible(model: sy.Model, count: int, seed: int) -> Any:
    """Yield base vectors of random flat links, disturbed so that about half of them are impossible."""
    generator = np.random.default_rng(seed)
    names = list(model.parameter_names)
    for _ in range(count):
        delta = np.zeros(len(names))
        for name in names:
            delta[names.index(name)] = generator.uniform(0.0, 0.5)
        for link in range(1, len(model.robot.link_names) + 1):
            mass, x, y = generator.uniform(0.5, 3.0), *generator.uniform(-0.5, 0.5, 2)
            moment = mass * (x**2 + y**2) + generator.uniform(0.0, 0.2)
            for symbol, value in (("Lzz", moment), ("lx", mass * x), ("ly", mass * y), ("m", mass)):
                delta[names.index(f"{symbol}{link}")] = value
        base = model.base_parameters().values(delta)
        yield base + generator.choice([0.0, 0.3, 1.0]) * generator.normal(size=len(base))


@needs_qepcad
@pytest.mark.slow
def test_two_joints_against_a_derivation_by_hand() -> None:
    """About its own axis link 2 has the moment J₂ = Lzz₂ + 2 a₂ lx₂ + a₂² m₂, in which m₂ falls out of β, and so on.

    m₁ is free: link 1 with the mass m₂ at its end needs J₁ > a₁² m₂ only, because m₁ may be as large as it takes. Some
    m₂ below J₁ / a₁² must hold link 2: m₂ J₂ > sx² + ly₂², with the first moment about the axis sx = lx₂ + a₂ m₂.
    """
    a1, a2 = 0.5, 0.25
    model = planar([a1, a2])
    assert model.base_parameters().names == ("Lzz1", "lx1", "ly1", "Lzz2", "lx2", "ly2")
    condition = closed_form_conditions(model)
    verdicts = []
    for base in around_feasible(model, 120, 1):
        zz1, x1, _, zz2, x2, y2 = base
        # β: zz1 = Lzz1 - a1² (m1 + m2), x1 = lx1 + a1 (m1 + m2), zz2 = Lzz2 - a2² m2, x2 = lx2 + a2 m2.
        first = zz1 + 2 * a1 * x1  # J₁ + a₁² m₂ of link 1 with that mass
        second = zz2 + 2 * a2 * x2
        expected = first > 0 and second > 0 and first / a1**2 * second > x2**2 + y2**2
        assert evaluated(condition, base) == expected
        verdicts.append(expected)
    assert 20 < sum(verdicts) < 100


@pytest.mark.slow
@needs_qepcad
@pytest.mark.parametrize(
    ("lengths", "terms", "gravity", "consistency"),
    [
        ([0.4], (sy.Viscous(),), GRAVITY, "inertia"),
        ([0.55, 0.3], (sy.RotorInertia(), sy.Coulomb()), GRAVITY, "inertia"),
        ([0.55, 0.3], (), GRAVITY, "full"),
        pytest.param([0.5, 0.5, 0.5], (), GRAVITY, "inertia", marks=pytest.mark.slow),
        pytest.param([0.55, 0.3, 0.2], (), (0, 0, -9.81), "full", marks=pytest.mark.slow),
    ],
    ids=["one", "two-with-terms", "two-full", "three", "three-lying"],
)
def test_agrees_with_the_solver(lengths: list[float], terms: Any, gravity: Any, consistency: Any) -> None:
    model = planar(lengths, *terms, gravity=gravity)
    condition = closed_form_conditions(model, consistency)
    assert condition.free_symbols <= {
        sympy.Symbol(f"beta{k + 1}", real=True) for k in range(len(model.base_parameters().names))
    }
    feasible = sy.FeasibleSet(model, consistency=consistency)
    verdicts = []
    for base in around_feasible(model, 15, 2):
        verdict = sy.check(feasible, base=base).feasible
        assert evaluated(condition, base) == verdict
        verdicts.append(verdict)
    assert 2 < sum(verdicts) < 13


SLIDING = {
    "last": [(0, 0.55, 0, "q"), ("pi/2", 0.3, 0, "q"), (0, 0, "q", 0)],
    "middle": [("pi/2", 0.55, 0, "q"), ("-pi/2", 0.1, "q", 0), (0, 0.3, 0, "q")],
    "first": [("pi/2", 0, "q", 0), (0, 0.55, 0, "q"), (0, 0.3, 0, "q")],
}


@needs_qepcad
@pytest.mark.slow
@pytest.mark.parametrize(
    "rows",
    [
        pytest.param(rows, id=place, marks=() if place == "first" else pytest.mark.slow)
        for place, rows in SLIDING.items()
    ],
)
def test_joints_that_slide_in_the_plane(rows: Any) -> None:
    """Links of mass points, disturbed; frames that slide are turned, so that they show other parameters."""
    model = sy.Model(sy.Robot.from_dh(rows, gravity=GRAVITY))
    condition, feasible = closed_form_conditions(model), sy.FeasibleSet(model, consistency="inertia")
    generator, verdicts = np.random.default_rng(1), []
    for _ in range(20):
        links: list[float] = []
        for _ in rows:
            points, masses = generator.normal(size=(5, 3)), generator.uniform(0.1, 0.6, 5)
            moments = np.einsum("k,ki,kj->ij", masses, points, points)
            tensor = np.trace(moments) * np.eye(3) - moments
            links += [*tensor[np.triu_indices(3)], *(masses @ points), masses.sum()]
        base = model.base_parameters().values(np.array(links))
        base = base + generator.choice([0.0, 0.5, 2.0]) * generator.normal(size=len(base))
        verdict = sy.check(feasible, base=base).feasible
        assert evaluated(condition, base) == verdict
        verdicts.append(verdict)
    assert 3 < sum(verdicts) < 20


@needs_qepcad
def test_robots_in_space_are_refused() -> None:
    model = sy.Model(sy.Robot.from_dh([("pi/2", 0.2, 0, "q"), (0, 0.3, 0, "q")]))
    with pytest.raises(InputError, match="closed forms are for planar robots"):
        closed_form_conditions(model)


@needs_qepcad
def test_lengths_that_do_not_cancel_are_refused() -> None:
    with pytest.raises(InputError, match="short decimals"):
        closed_form_conditions(planar([1 / 3, 0.5]))


@needs_qepcad
def test_what_is_too_hard_ends_in_time() -> None:
    start = time.monotonic()
    with pytest.raises(InputError, match="doubly exponential"):
        closed_form_conditions(planar([0.5] * 4), timeout=0.5)
    assert time.monotonic() - start < 20.0


@needs_qepcad
def test_impossible_timeout_is_refused() -> None:
    with pytest.raises(InputError, match="positive number of seconds"):
        closed_form_conditions(planar([0.5]), timeout=0)


def test_absent_program_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(MissingExtraError, match=r"apt install .*qepcad"):
        closed_form_conditions(planar([0.5]))


def stand_in(monkeypatch: pytest.MonkeyPatch, tmp_path: Any, code: str) -> None:
    program = tmp_path / "qepcad"
    program.write_text(f"#!{sys.executable}\nimport sys, time\n{code}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("v1 > 0 /\\ 2 v1 v2^2 - 3 v2 + 1 < 0", "(x > 0) & (2*x*y**2 - 3*y + 1 < 0)"),
        ("[ v1 >= 0 \\/ v2 /= 0 ] /\\ - v1 - v2\n <= 0", "((x >= 0) | Ne(y, 0)) & (-x - y <= 0)"),
        ("~[ v1 = 0 ]", "Ne(x, 0)"),
        ("TRUE", "True"),
        ("v1 > 0 /\\ FALSE", "False"),
    ],
)
def test_answers_are_read(text: str, expected: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    answer = f"An equivalent quantifier-free formula:\n\n{text}\n\n\n=====================  The End\n"
    stand_in(monkeypatch, tmp_path, f"sys.stdin.read()\nprint({answer!r})")
    x, y, z = sympy.symbols("x y z", real=True)
    found = quantifier_elimination.eliminate(z, [x + y + z > 0], float("inf"))
    assert found == sympy.sympify(expected, locals={"x": x, "y": y})


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("print('Reason for the failure: Too few cells.')", "could not eliminate z .* Too few cells"),
        ("print('An equivalent quantifier-free formula:\\n v1 = _root_1 v2\\n======')", "could not eliminate"),
        ("print('An equivalent quantifier-free formula:\\n v1 $ 0\\n======')", "no formula"),
        ("print('An equivalent quantifier-free formula:\\n v1 > 0 /\\\\ \\n======')", "ends within a formula"),
        ("time.sleep(60)", "was stopped after"),
    ],
)
def test_failures_are_explained(code: str, message: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    stand_in(monkeypatch, tmp_path, code)
    x, z = sympy.symbols("x z", real=True)
    with pytest.raises(InputError, match=message):
        quantifier_elimination.eliminate(z, [x + z > 0], 1.0)


@pytest.mark.slow
def test_what_the_program_started_ends_with_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    """A child in a session of its own, as Singular is, holds a lock, which the system frees when it ends."""
    fcntl = pytest.importorskip("fcntl", reason="locks of files are those of POSIX")
    if not list(Path("/proc/self/task").glob("*/children")):
        pytest.skip("this system does not list the children of a process")
    lock = tmp_path / "lock"
    lock.touch()
    child = (
        "import fcntl, sys, time; f = open(sys.argv[1], 'w'); fcntl.flock(f, fcntl.LOCK_EX); "
        "f.write('held'); f.flush(); time.sleep(20)"
    )
    start = f"[sys.executable, '-c', {child!r}, {str(lock)!r}], start_new_session=True, stdout=null, stderr=null"
    # Nobody waits for what the child writes.
    code = f"import subprocess; null = subprocess.DEVNULL; subprocess.Popen({start})\ntime.sleep(20)"
    stand_in(monkeypatch, tmp_path, code)
    x, z = sympy.symbols("x z", real=True)
    with pytest.raises(InputError, match="was stopped after"):
        quantifier_elimination.eliminate(z, [x + z > 0], 2.0)
    assert lock.read_text() == "held"
    deadline = time.monotonic() + 5.0
    with lock.open("r+") as file:
        while not _locked(fcntl, file):
            assert time.monotonic() < deadline, "the child still runs"
            time.sleep(0.05)


def _locked(fcntl: Any, file: Any) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


@pytest.mark.slow
@needs_qepcad
def test_elimination_of_textbook_formulas() -> None:
    a, b, c, x = sympy.symbols("a b c x", real=True)
    half = sympy.Rational(1, 2)
    found = quantifier_elimination.eliminate(x, [sympy.Eq(x**2 + b * x + half * c, 0)], 30.0)
    for values in ((0, 1), (2, 1), (2, 2), (-3, 4), (1, half), (1, 1)):
        numbers = dict(zip((b, c), values, strict=True))
        assert bool(found.xreplace(numbers)) == bool((b**2 - 2 * c >= 0).xreplace(numbers))
    assert quantifier_elimination.eliminate(x, [x > 1, x < 2], 30.0) == sympy.true
    assert quantifier_elimination.eliminate(x, [x > 2, x < 1], 30.0) == sympy.false
    either = quantifier_elimination.eliminate(x, [sympy.Or(x > a, x < -1), x < 0], 30.0)
    assert either == sympy.true
