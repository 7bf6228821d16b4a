"""Solvers by name: the table, plug-ins, and programs that are missing or misbehave."""

import stat
import sys
from pathlib import Path

import numpy as np
import pytest

from steelyard.conic import (
    Cone,
    Outcome,
    Solver,
    external_solver,
    find_solver,
    solve,
    solver_table,
)
from steelyard.conic.clarabel_solver import solve_with_clarabel
from steelyard.errors import InputError, MissingExtraError, SolverError
from steelyard.extensions import register, unregister
from steelyard.lmi import symmetric_to_vector


@pytest.fixture
def interval(conic):
    """Minimise x for 1 <= x <= 2."""
    return conic(None, [1.0], [[-1.0], [1.0]], [-1.0, 2.0], Cone("nonnegative", 2))


@pytest.fixture
def impostor(tmp_path, monkeypatch):
    """Puts a Python program in the place of all three."""

    def install(source):
        folder = tmp_path / "bin"
        folder.mkdir(exist_ok=True)
        for name in ("csdp", "dsdp5", "sdpa"):
            file = folder / name
            file.write_text(f"#!{sys.executable}\nimport sys, os, time\n{source}\n")
            file.chmod(file.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setenv("PATH", str(folder))

    return install


PROGRAMS = ("csdp", "dsdp", "sdpa")


def test_table_says_what_each_can_do():
    table = solver_table()
    rows = {row[0]: dict(zip(table.headings, row, strict=True)) for row in table.rows}
    assert list(rows)[:5] == ["clarabel", "scs", "csdp", "dsdp", "sdpa"]
    assert rows["clarabel"]["exponential"] == "yes"
    assert rows["clarabel"]["here"].startswith("yes, 0.")
    for name in PROGRAMS:
        assert rows[name]["quadratic"] == rows[name]["second-order"] == "rewritten"
        assert (rows[name]["semidefinite"], rows[name]["exponential"]) == ("yes", "no")
        assert rows[name]["access"] == "SDPA file"
    lines = str(table).splitlines()
    assert len(lines) == 2 + len(table.rows)
    assert len({line.find("in memory") for line in lines if "in memory" in line}) == 1
    assert repr(table) == str(table)
    assert table._repr_html_().count("<tr>") == 1 + len(table.rows)


def test_table_says_how_to_install_what_is_absent(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    text = str(solver_table())
    for package in ("coinor-csdp", "dsdp", "sdpa"):
        assert f"apt install {package}" in text
    html = solver_table()._repr_html_()
    assert "<td>no</td>" in html


def test_table_escapes_html():
    register(
        "solvers", "plug", Solver("plug", "Plug", "<b>fast</b> & good", solve_with_clarabel, frozenset({"nonnegative"}))
    )
    try:
        assert "&lt;b&gt;fast&lt;/b&gt; &amp; good" in solver_table()._repr_html_()
    finally:
        unregister("solvers", "plug")


def test_plug_in(interval):
    seen = []

    def run(problem, accuracy, iterations):
        seen.append((accuracy, iterations))
        return solve_with_clarabel(problem, accuracy, iterations)

    register("solvers", "mine", Solver("mine", "Mine", "a test", run, frozenset({"nonnegative"})))
    try:
        assert solve(interval, accuracy=1e-6, iterations=30, solver="Mine").primal[0] == pytest.approx(1.0, abs=1e-5)
        assert seen == [(1e-6, 30)]
        assert solver_table().solvers[-1].title == "Mine"
    finally:
        unregister("solvers", "mine")
    with pytest.raises(InputError, match="no solver 'mine'"):
        find_solver("mine")


@pytest.mark.parametrize(
    ("name", "close"),
    [("clarabell", "clarabel"), ("SDPT", "sdpa"), *((name, 'clarabel", "scs"') for name in ("", None, 3))],
)
def test_unknown_names_get_the_closest(interval, name, close):
    with pytest.raises(InputError, match=f'there is no solver .* (did you mean|known are) "{close}'):
        solve(interval, solver=name)


@pytest.mark.parametrize(
    ("name", "features"), [("two words", ["zero"]), ("Upper", ["zero"]), ("", ["zero"]), ("good", ["cubic"])]
)
def test_plug_ins_that_do_not_fit(name, features):
    with pytest.raises(InputError):
        register("solvers", name, Solver(name, "T", "d", solve_with_clarabel, frozenset(features)))


def test_features_that_a_solver_lacks_are_named(interval, conic):
    register("solvers", "linear", Solver("linear", "Linear", "d", solve_with_clarabel, frozenset({"nonnegative"})))
    try:
        solve(interval, solver="linear")
        with pytest.raises(InputError, match=r"Linear does not take a quadratic objective; use solver=\"clarabel\""):
            solve(conic(np.eye(1), [0.0], [[1.0]], [1.0], Cone("nonnegative", 1)), solver="linear")
        with pytest.raises(InputError, match="Linear does not take the semidefinite cone"):
            solve(conic(None, [0.0], [[1.0]], [1.0], Cone("semidefinite", 1)), solver="linear")
    finally:
        unregister("solvers", "linear")


@pytest.mark.parametrize(("accuracy", "iterations"), [(0.0, 10), (2.0, 10), (np.nan, 10), (1e-8, 0)])
def test_settings_that_make_no_sense(interval, accuracy, iterations):
    with pytest.raises(InputError, match="accuracy must lie between 0 and 1"):
        solve(interval, accuracy=accuracy, iterations=iterations)


def test_missing_package_names_the_extra(interval, monkeypatch):
    monkeypatch.setattr("steelyard.conic.scs_solver.find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"SCS is not installed; install it with: pip install 'scs>="):
        solve(interval, solver="scs")


@pytest.mark.parametrize(("name", "package"), [("csdp", "coinor-csdp"), ("dsdp", "dsdp"), ("sdpa", "sdpa")])
def test_missing_program_names_the_package(interval, monkeypatch, tmp_path, name, package):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SolverError, match=f"not installed; install it with: apt install {package}"):
        solve(interval, solver=name)


@pytest.mark.parametrize("name", PROGRAMS)
@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("os.kill(os.getpid(), 11)", r"crashed \(signal 11\)"),
        ("print('out of cheese'); sys.exit(77)", r"cannot be read \(exit code 77, its last words: 'out of cheese'\)"),
        ("pass", "cannot be read"),
        ("open('problem.solution', 'w').write('1.0 2.0 nonsense')", "cannot be read"),
        ("open('problem.solution', 'w').write('1.0 2.0 3.0 4.0 5.0\\n2 1 1 1 1.0\\n')", "cannot be read"),
        ("open('problem.solution', 'w').write('1.0\\n2 9 1 1 1.0\\n')", "cannot be read"),
        ("open('problem.solution', 'w').write('1.0\\n2 1 9 9 1.0\\n')", "cannot be read"),
        ("open('problem.solution', 'wb').write(bytes(range(256)))", "cannot be read"),
        ("open('problem.solution', 'w').write('phase.value = pdOPT\\nxVec = \\n{1,2}\\n')", "cannot be read"),
        ("time.sleep(60)", "stopped after 0.2 s"),
    ],
    ids=["crash", "words", "silence", "text", "length", "block", "element", "bytes", "cut", "sleep"],
)
def test_programs_that_misbehave(interval, impostor, monkeypatch, name, source, words):
    impostor(source)
    monkeypatch.setattr(external_solver, "TIME_LIMIT", 0.2 if "sleep" in source else 20.0)
    with pytest.raises(SolverError, match=words) as caught:
        solve(interval, solver=name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", [PROGRAMS[0], *(pytest.param(name, marks=pytest.mark.slow) for name in PROGRAMS[1:])])
def test_a_program_that_lies_is_not_believed(interval, impostor, name):
    """It says that all went well, but its point is none."""
    impostor(
        "open('problem.solution', 'w').write('7.0\\n2 1 1 1 5.0\\n' if 'sdpa' not in sys.argv[0] else "
        "'phase.value = pdOPT\\nIteration = 3\\nxVec = \\n{7.0}\\nyMat = \\n{\\n{5.0, 0.0}\\n}\\n')\n"
        "print('DSDP Converged')"
    )
    solution = solve(interval, solver=name)
    assert solution.outcome is Outcome.STOPPED
    assert solution.solver.lower() == name


@pytest.mark.parametrize("name", PROGRAMS)
def test_programs_run_in_one_thread_and_leave_nothing(interval, impostor, tmp_path, monkeypatch, name):
    note = tmp_path / "note"
    impostor(
        f"open({str(note)!r}, 'w').write(' '.join([os.getcwd(), os.environ['OMP_NUM_THREADS'], "
        "os.environ['OPENBLAS_NUM_THREADS'], os.environ['LC_ALL']]))\nsys.exit(99)"
    )
    with pytest.raises(SolverError):
        solve(interval, solver=name)
    folder, *settings = note.read_text().split()
    assert settings == ["1", "1", "C"]
    assert not Path(folder).exists()


def test_sentences_name_the_solver(conic):
    problem = conic(None, [0.0], [[-1.0], [1.0]], [-1.0, 0.0], Cone("nonnegative", 2))
    with pytest.raises(SolverError, match="Clarabel could not find x"):
        solve(problem).require("find x")


def test_a_weak_proof_is_not_believed(conic):
    """Points as far out as b is large exist, but a direction with Aᵀz = 1e-8 seems to exclude them."""
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(3, 3))
    for size in (1e7, 1e9):
        given = size * symmetric_to_vector(matrix + matrix.T)
        problem = conic(2 * np.eye(6), np.zeros(6), -np.eye(6), given, Cone("semidefinite", 3))
        solution = solve(problem)
        assert solution.outcome is Outcome.SOLVED
        expected = size**2 * (np.minimum(np.linalg.eigvalsh(matrix + matrix.T), 0) ** 2).sum()
        assert solution.objective == pytest.approx(expected, rel=1e-6)


def test_documented_table_is_that_of_the_solvers():
    page = Path(__file__).resolve().parents[2] / "docs" / "reference" / "solvers.md"
    lines = [line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    rows = {cells[0]: cells for cells in ([cell.strip(" `") for cell in line.strip("|").split("|")] for line in lines)}
    table = solver_table()
    for row in table.rows[:5]:
        known = dict(zip(table.headings, row, strict=True))
        _, method, access, *features, install = rows[known["solver"]]
        assert known["method"].removesuffix(", default") == method
        assert known["access"] == access
        assert [known[name] for name in ("quadratic", "second-order", "semidefinite", "exponential")] == features
        remedy = find_solver(known["solver"]).remedy
        assert install == remedy or known["solver"] == "clarabel"
