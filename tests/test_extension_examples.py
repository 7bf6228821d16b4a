"""The examples of the page on extensions do what the page says, and what extensions do wrong is said in a sentence."""

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import steelyard as sy
from steelyard.codegen import files
from steelyard.conic import Outcome, Solver, find_solver, solve, solver_table
from steelyard.dynamics import term_from_dict
from steelyard.errors import InputError, SolverError
from steelyard.estimators import estimate_with
from steelyard.excitation import FourierTrajectory
from steelyard.extensions import register
from steelyard.feasibility import verify_document
from steelyard.feasibility.constraints import Equality, constraints_from_dict
from steelyard.lmi import AffineBlock
from steelyard.robot import Condition, DescriptionFormat

PAGE = Path(__file__).resolve().parents[1] / "docs" / "how-to" / "extend.md"
EVERYTHING = frozenset({"quadratic", "zero", "nonnegative", "second-order", "semidefinite", "exponential"})


@pytest.fixture
def example(tmp_path, monkeypatch, no_extensions):
    """Return a function that runs the blocks of a section of the page and returns their names."""
    monkeypatch.chdir(tmp_path)

    def example(heading):
        text = PAGE.read_text(encoding="utf-8").partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
        names = {}
        for block in re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
            exec(compile(block, heading, "exec"), names)
        return names

    return example


@pytest.mark.skipif(shutil.which("node") is None, reason="JavaScript is run by Node.js")
def test_the_language_computes_what_the_model_computes(example):
    model = example("A code language")["model"]
    random = np.random.default_rng(0)
    q, dq, ddq = random.normal(size=(3, 2))
    delta = random.normal(size=model.parameter_count)
    given = ", ".join(json.dumps(list(values)) for values in (q, dq, ddq, delta))
    code = f"import * as d from './javascript/dynamics.mjs'; console.log(JSON.stringify(d.inverse_dynamics({given})))"
    run = subprocess.run(["node", "--input-type=module", "-e", code], capture_output=True, text=True, check=True)
    torque = json.loads(run.stdout)["torque"]
    # By the regressor, which is computed by other formulas.
    np.testing.assert_allclose(torque, model.regressor(q, dq, ddq) @ delta, rtol=1e-12, atol=1e-12)
    model.generate("javascript", ["gravity"], directory="javascript")  # it may be written again
    with pytest.raises(InputError, match='did you mean "javascript"'):
        model.generate("javascrpt", directory="elsewhere")


def test_the_solver_solves(example):
    names = example("A solver")
    default = sy.correct(names["feasible_set"], base=[1.0] * names["model"].base_parameters().count)
    assert names["correction"].squared_distance == pytest.approx(default.squared_distance, rel=1e-6)
    assert "patient" in str(solver_table())


ARM = """<mujoco><compiler angle="radian"/><option timestep="0.001" gravity="0 0 -9.81"/><worldbody><body name="upper">
<joint name="shoulder" axis="0 1 0" stiffness="8" springref="0.2" damping="0.3"/>
<inertial pos="0.2 0 0" mass="2" diaginertia="0.02 0.04 0.04"/><body name="fore" pos="0.4 0 0">
<joint name="elbow" axis="0 1 0" stiffness="5" springref="-0.3" damping="0.1"/>
<inertial pos="0.15 0 0" mass="1" diaginertia="0.01 0.02 0.02"/></body></body></worldbody></mujoco>"""
URDF = """<robot name="pair"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.04" iyz="0" izz="0.04"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.15 0 0"/><mass value="1"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/>
<axis xyz="0 1 0"/></joint></robot>"""
SPRINGS = """
[description]
urdf = "pair.urdf"
[processing]
cutoff = 20.0
[[terms]]
kind = "viscous"
[[terms]]
kind = "{}"
largest_rest = {}
"""


@pytest.fixture
def sprung(tmp_path):
    """A folder with the log of an arm with springs, whose torques MuJoCo computed, and its description without them."""
    mujoco = pytest.importorskip("mujoco")
    simulator = mujoco.MjModel.from_xml_string(ARM)
    data = mujoco.MjData(simulator)
    a, b = [[0.4, -0.3, 0.2], [0.3, 0.5, -0.2]], [[0.2, 0.3, -0.3], [-0.4, 0.2, 0.3]]
    trajectory = FourierTrajectory(a=np.array(a), b=np.array(b), center=np.array([0.1, -0.2]), frequency=0.2)
    t, q, dq, ddq = trajectory.sample(250.0, 5.0)
    torque = np.empty_like(q)
    for row, motion in enumerate(zip(q, dq, ddq, strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = motion
        mujoco.mj_inverse(simulator, data)
        torque[row] = data.qfrc_inverse
    sy.Recording(t=t, q=q, torque=torque, joint_names=("shoulder", "elbow")).save(tmp_path / "log.csv")
    for name in ("pair.urdf", "my_robot.urdf"):
        (tmp_path / name).write_text(URDF)
    return tmp_path


def _springs(estimate):
    values = dict(zip(estimate.parameter_names, estimate.parameters, strict=True))
    return [[values[f"{symbol}{joint}"] for symbol in ("Ks", "Cs", "Fvj")] for joint in (1, 2)]


@pytest.mark.slow
def test_the_term_passes_through_an_identification(example, sprung, run):
    example("A term")
    path = sprung / "robot.toml"
    path.write_text(SPRINGS.format("spring_with_rest", 0.5))
    assert run("identify", path, sprung / "log.csv", "--output", sprung / "result")[0] == 0
    estimate = sy.Estimate.load(sprung / "result" / "estimate.json")
    # Stiffness, stiffness times rest, and damping of MuJoCo's model, from filtered positions.
    np.testing.assert_allclose(_springs(estimate), [[8.0, 1.6, 0.3], [5.0, -1.5, 0.1]], rtol=0.01, atol=0.01)
    assert estimate.relative_error < 2e-3
    # The description has no place for a spring, and its damping is the viscous friction alone.
    tree = ElementTree.parse(sprung / "result" / "robot.urdf")
    dynamics = [joint.find("dynamics").attrib for joint in tree.getroot().iter("joint")]
    np.testing.assert_allclose([float(one["damping"]) for one in dynamics], [0.3, 0.1], atol=0.01)
    np.testing.assert_array_equal([float(one["friction"]) for one in dynamics], 0.0)
    # Its energy is that of its torques.
    model = sy.Model.load(path)
    q = np.array([0.7, -0.4])
    springs = np.where([name[:2] in ("Ks", "Cs") for name in model.parameter_names], estimate.parameters, 0.0)
    steps = 1e-6 * np.eye(2)
    slopes = [(model.potential_energy(q + s, springs) - model.potential_energy(q - s, springs)) / 2e-6 for s in steps]
    np.testing.assert_allclose(slopes, model.inverse_dynamics(q, [0.0, 0.0], [0.0, 0.0], springs), rtol=1e-7)


@pytest.mark.slow
def test_the_condition_of_the_term_binds(example, sprung):
    """Springs that are at rest farther out than the file says are not possible: the fit keeps them at the bound."""
    example("A term")
    path = sprung / "robot.toml"
    path.write_text(SPRINGS.format("spring_with_rest", 0.25))
    found = sy.identify(path, [sprung / "log.csv"])
    (near_stiffness, near, _), (stiffness, far, _) = _springs(found.estimate)
    assert -far / stiffness == pytest.approx(0.25, abs=1e-4)  # MuJoCo's is at -0.3
    assert abs(near) <= 0.25 * near_stiffness
    assert not found.verdict.feasible
    assert found.estimate.relative_error > 5 * found.unconstrained.relative_error
    assert [block.name for block in found.feasible_set.blocks if block.kind == "term" and block.size == 2] == [
        f"rest of the spring within its range at {joint}" for joint in ("shoulder", "elbow")
    ]


def test_an_import_path_runs_only_where_it_is_allowed(pair, tmp_path, run, install):
    text = PAGE.read_text(encoding="utf-8").partition("\n## A term\n")[2]
    (block, *_) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    install("springs", "commands", {}, block.replace("register(", "(lambda *a: None)("))
    path = tmp_path / "robot.toml"
    path.write_text(SPRINGS.format("of_springs:Spring", 0.5))
    estimate = tmp_path / "estimate.json"
    for line in (
        ("identify", path, tmp_path / "log.csv", "-o", tmp_path / "result"),
        ("inspect", path),
        ("check", path, estimate),
        ("correct", path, estimate, "-o", tmp_path / "corrected.json"),
        ("explain", path, estimate),
        ("generate", path, "--language", "c", "-o", tmp_path / "c"),
        ("simulate", path, estimate, "-o", tmp_path / "simulation"),
        ("excite", path, "-o", tmp_path / "excitation"),
    ):
        code, _, err = run(*line)
        assert code == 2
        assert "[[terms]] number 2: `of_springs:Spring` is code, which is not run because a file names it" in err
        assert "allow it with --allow-extensions" in err
        assert "of_springs" not in sys.modules
    code, out, _ = run("inspect", path, "--allow-extensions")
    assert code == 0
    assert "Ks1" in out
    assert run("generate", path, "--language", "c", "-o", tmp_path / "c", "--allow-extensions")[0] == 0


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("of_absent:Spring", "ModuleNotFoundError: No module named 'of_absent'"),
        ("os:system", "TypeError: expected a class derived from steelyard.Term, got"),
        ("os:", "cannot be loaded"),
        (":Spring", "cannot be loaded"),
        ("a b:c d", "cannot be loaded"),
    ],
)
def test_what_an_import_path_does_not_lead_to_is_said(kind, reason, tmp_path, no_extensions):
    (tmp_path / "pair.urdf").write_text(URDF)
    path = tmp_path / "robot.toml"
    path.write_text(SPRINGS.format(kind, 0.5))
    with pytest.raises(InputError, match="is code, which is not run"):
        sy.Model.load(path)
    with pytest.raises(InputError, match=r"\[\[terms\]\] number 2: the term `.*` cannot be loaded") as raised:
        sy.Model.load(path, allow_extensions=True)
    assert reason in str(raised.value)


class Drag(sy.Term):
    """Torque against the square of the velocity."""

    kind = "drag"
    parameters = (sy.TermParameter("Fq", "N·m·s²/rad²", "N·s²/m²", "drag", nonnegative=True),)

    def columns(self, k, q, dq, ddq, algebra):
        return ({k: algebra.sign(dq[k]) * dq[k] * dq[k]},)


@pytest.fixture
def pair(tmp_path):
    (tmp_path / "pair.urdf").write_text(URDF)
    return sy.Robot.from_urdf(tmp_path / "pair.urdf")


def test_a_term_that_is_no_friction_of_a_description_is_not_written_as_such(pair):
    """A line through its torques at two speeds has a negative value at rest, which no description takes."""
    model = sy.Model(pair.with_terms(sy.Coulomb(), Drag()))
    delta = np.zeros(model.parameter_count)
    delta[[model.parameter_names.index(name) for name in ("Fcj1", "Fq1", "Fcj2", "Fq2")]] = 0.5, 3.0, 0.25, 2.0
    drives = model.drives(delta)
    damping, friction = drives.damping, drives.friction
    assert (damping.tolist(), friction.tolist()) == ([0.0, 0.0], [0.5, 0.25])


def _odd(columns=None, **changes):
    def own(self, k, q, dq, ddq, algebra):
        return columns(k, q, dq, ddq, algebra)

    return type("Odd", (Drag,), changes | ({} if columns is None else {"columns": own}))()


@pytest.mark.parametrize(
    ("term", "reason"),
    [
        (_odd(lambda k, q, dq, ddq, a: ({k: ddq[k] * ddq[k]},)), "Fq does not depend linearly on the accelerations"),
        (_odd(lambda k, q, dq, ddq, a: ({k: a.sign(ddq[k])},)), "Fq does not depend linearly on the accelerations"),
        (_odd(lambda k, q, dq, ddq, a: ({k: q[k] / dq[k]},)), "the column of Fq is not finite at rest"),
        (_odd(lambda k, q, dq, ddq, a: ({k: a.sqrt(q[k] - 9.0)},)), "the column of Fq is not finite"),
        (_odd(lambda k, q, dq, ddq, a: ({k: a.tanh(dq[k])},)), "AttributeError"),
        (_odd(lambda k, q, dq, ddq, a: ({k: np.exp(dq[k])},)), "TypeError"),
        (_odd(lambda k, q, dq, ddq, a: ({k: 1.0 if dq[k] > 0 else 0.0},)), "TypeError"),
        (_odd(lambda k, q, dq, ddq, a: ({k: "one"},)), "ValueError: could not convert"),
        (_odd(lambda k, q, dq, ddq, a: ({k: dq[k]}, {k: 1.0})), "expected a tuple of 1 columns, got"),
        (_odd(lambda k, q, dq, ddq, a: {k: dq[k]}), "expected a tuple of 1 columns, got"),
        (_odd(lambda k, q, dq, ddq, a: ({2: dq[k]},)), "a column of Fq names the joint 2 of 2"),
        (_odd(lambda k, q, dq, ddq, a: ({k: dq[k + 1]},)), "IndexError"),
        (_odd(parameters=("Fq",)), "must be derived from Term, with TermParameter as its parameters, got"),
        (_odd(potential=lambda self, k, q, a: ()), "expected a tuple of 1 potentials"),
        (
            _odd(conditions=lambda self: (Condition("c", 1, np.zeros((1, 1)), {"Fx": np.eye(1)}),)),
            "the condition 'c' is about 'Fx'",
        ),
        (
            _odd(conditions=lambda self: (Condition("c", 1, np.zeros((1, 1)), {"Fq": np.eye(2)}),)),
            "block .c at shoulder. has a constant",
        ),
    ],
)
def test_what_a_term_does_wrong_is_said(term, reason, pair):
    with pytest.raises(InputError, match=rf"^(The term 'drag' cannot be used \()?.*{reason}") as raised:
        sy.FeasibleSet(sy.Model(pair.with_terms(term)))
    assert "\n" not in str(raised.value)


def test_the_name_of_a_term_is_its_kind(no_extensions):
    with pytest.raises(InputError, match="term `air` cannot be registered: expected a class whose kind is 'air'"):
        register("terms", "air", Drag)
    register("terms", "drag", Drag)
    assert type(term_from_dict({"kind": "drag"})) is Drag
    with pytest.raises(InputError, match=r"of kind 'drag': 'exponent' is no key of it; there are none"):
        term_from_dict({"kind": "drag", "exponent": 2})
    with pytest.raises(InputError, match='did you mean "drag"'):
        term_from_dict({"kind": "darg"})


RATIO = """
[description]
urdf = "pair.urdf"
[[constraints.{}]]
link = "fore"
other = "upper"
ratio = 0.4
"""


@pytest.mark.parametrize("name", ["mass_ratio", '"of_ratios:MassRatio"'])
def test_the_constraint_is_read_and_holds(name, pair, tmp_path, install):
    text = PAGE.read_text(encoding="utf-8").partition("\n## A constraint\n")[2]
    (block, *_) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    entries = {"mass_ratio": "of_ratios:MassRatio"} if name == "mass_ratio" else {}
    install("ratios", "constraints", entries, block.replace("register(", "(lambda *a: None)("))
    path = tmp_path / "robot.toml"
    path.write_text(RATIO.format(name))
    if name != "mass_ratio":
        file = sy.RobotFile.load(path)
        with pytest.raises(InputError, match=r"\[constraints\]: `of_ratios:MassRatio` is code, which is not run"):
            constraints_from_dict(file.section("constraints"), tmp_path)
    file = sy.RobotFile.load(path, allow_extensions=name != "mass_ratio")
    section = file.section("constraints")
    constraints = constraints_from_dict(section, tmp_path, allow_extensions=file.allow_extensions)
    model = sy.Model(pair)
    feasible_set = sy.FeasibleSet(model, constraints=list(constraints))
    assert feasible_set.blocks[-1].name == "mass of fore <= 0.4 times that of upper"
    verdict = sy.check(feasible_set, parameters=np.asarray(pair.parameters))  # 1 kg and 2 kg
    assert [one.block for one in verdict.violations] == ["mass of fore <= 0.4 times that of upper"]
    moved = np.array(pair.parameters)
    moved[[9, 19]] = 2.4 / 1.16 + 1e-4, 0.96 / 1.16  # the foot of the perpendicular on m2 = 0.4 m1
    assert sy.check(feasible_set, parameters=moved).feasible
    with pytest.raises(InputError, match=r"\[\[constraints.*MassRatio.*\]\] lacks 'link'|mass_ratio\]\] lacks 'link'"):
        constraints_from_dict({name.strip('"'): {"ratio": 1.0}}, allow_extensions=True)


@pytest.mark.parametrize(
    ("blocks", "equalities", "reason"),
    [
        ((3,), (), "TypeError: expected AffineBlock as blocks, got 3"),
        (None, (), "TypeError"),
        ((AffineBlock("b", np.zeros((1, 1)), np.array([20]), np.ones((1, 1, 1))),), (), "whole numbers from 0 to 19"),
        ((AffineBlock("b", np.zeros((1, 1)), np.array([1.5]), np.ones((1, 1, 1))),), (), "whole numbers from 0 to 19"),
        ((AffineBlock("b", np.array([[np.inf]]), np.array([1]), np.ones((1, 1, 1))),), (), "not finite"),
        ((), ("e",), "TypeError: expected Equality as equalities, got"),
        ((), (Equality("e", np.array([1, 2]), np.ones(1), 0.0),), "other numbers of indices and of coefficients"),
        ((), (Equality("e", np.array([-1]), np.ones(1), 0.0),), "whole numbers from 0 to 19"),
        ((), (Equality("e", np.array([1]), np.ones(1), np.nan),), "not finite"),
    ],
)
def test_what_a_constraint_does_wrong_is_said(blocks, equalities, reason, pair):
    odd = type("Odd", (), {"blocks": lambda self, model: blocks, "equalities": lambda self, model: equalities})
    with pytest.raises(InputError, match=rf"The constraint Odd cannot be used \(.*{reason}"):
        sy.FeasibleSet(sy.Model(pair), constraints=[odd()])


def test_a_constraint_is_no_law_of_physics(pair):
    """Blocks of other packages count as constraints, whatever the default of the class is."""
    block = AffineBlock("m2 <= 0.5 kg", 0.5 * np.eye(1), np.array([19]), -np.ones((1, 1, 1)))
    light = type("Light", (), {"blocks": lambda self, model: (block,), "equalities": lambda self, model: ()})
    feasible_set = sy.FeasibleSet(sy.Model(pair), constraints=[light()])
    assert [one.kind for one in feasible_set.blocks] == ["link", "link", "constraint"]


@pytest.fixture
def project():
    from steelyard.codegen import Project
    from steelyard.graph import Argument, Function, Graph, Output, sin

    x = Graph().inputs("x", 1)
    function = Function("f", (Argument("x", 1),), (Output("y", (), (sin(x[0]),)),))
    return Project("pendulum", (function,), "", (), {"x": np.array([[0.5]])}, "1.0")


HEAD = "# Generated by Steelyard\n"


@pytest.mark.parametrize(
    ("write", "reason"),
    [
        (lambda project: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda project: HEAD, "TypeError: expected a dict of texts by relative path, got"),
        (lambda project: {}, "TypeError: expected a dict"),
        (lambda project: {"a.txt": b"bytes"}, "TypeError: a.txt must be text"),
        (lambda project: {"/etc/passwd": HEAD}, "'/etc/passwd' is no path within the folder"),
        (lambda project: {"../a.txt": HEAD}, "'../a.txt' is no path within the folder"),
        (lambda project: {"a\\..\\b": HEAD}, "is no path within the folder"),
        (lambda project: {"a.txt": "x\n" + HEAD}, "the first line of a.txt must hold 'Generated by Steelyard'"),
        (lambda project, more: {"a.txt": HEAD}, "TypeError: .* missing 1 required positional argument"),
    ],
)
def test_what_a_language_does_wrong_is_said(write, reason, project, no_extensions):
    register("languages", "odd", write)
    with pytest.raises(
        InputError, match=rf"The language `odd` cannot write 'pendulum' \({'' if '`' in reason else '.*'}{reason}"
    ):
        files(project, "odd")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda solution: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda solution: solution.primal, "TypeError: expected a ConicSolution, got"),
        (lambda solution: replace(solution, primal=np.zeros(0)), "expected 1 finite numbers as primal, got shape"),
        (lambda solution: replace(solution, dual=solution.dual[:-1]), "finite numbers as dual"),
        (lambda solution: replace(solution, slack=np.nan * solution.slack), "finite numbers as slack"),
    ],
)
def test_what_a_solver_does_wrong_is_said(change, reason, no_extensions):
    from steelyard.conic import Cone, ConicProblem, Rows

    problem = ConicProblem.from_rows(-np.ones(1), [Rows(np.eye(1), np.array([2.0]), Cone("nonnegative", 1))])

    def run(problem, accuracy, iterations):
        return change(solve(problem, accuracy, iterations))

    register("solvers", "odd", Solver("odd", "Odd", "wrong", run, EVERYTHING))
    with pytest.raises(SolverError, match=rf"Odd failed \(.*{reason}.*; use another solver, such as"):
        solve(problem, solver="odd")


def test_a_solver_that_lies_is_not_believed(no_extensions):
    """What is printed about an answer was checked, whatever the solver said of it."""

    def run(problem, accuracy, iterations):
        found = solve(problem, accuracy, iterations)
        return replace(found, primal=found.primal + 0.5, outcome=Outcome.SOLVED)

    register("solvers", "liar", Solver("liar", "Liar", "wrong", run, EVERYTHING))
    feasible_set = sy.FeasibleSet(sy.Model(sy.Robot.from_dh([(0, 0.5, 0, "q")])))
    base = -np.ones(feasible_set.model.base_parameters().count)
    try:
        found = sy.correct(feasible_set, base=base, solver="liar")
    except (InputError, SolverError):
        return
    assert sy.check(feasible_set, parameters=found.parameters).feasible


def test_a_broken_solver_is_left_out_of_the_table(install):
    install("ill", "solvers", {"ill": "of_ill:solver"}, "1 / 0\n")
    assert [row[0] for row in solver_table().rows] == ["clarabel", "scs", "csdp", "dsdp", "sdpa"]
    with pytest.raises(InputError, match="The solver `ill` of ill cannot be loaded"):
        find_solver("ill")


@pytest.mark.slow
def test_the_estimator_passes_through_an_identification(sprung, run, install, tmp_path):
    text = PAGE.read_text(encoding="utf-8").partition("\n## An estimator\n")[2]
    (block, *_) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    install("near", "estimators", {"nearest": "of_near:nearest"}, block.replace("register(", "(lambda *a: None)("))
    path, output = sprung / "robot.toml", sprung / "result"
    path.write_text('terms = []\n[description]\nurdf = "pair.urdf"\n[processing]\ncutoff = 20.0\n')
    code, _, err = run("identify", path, sprung / "log.csv", "-o", output, "--estimator", "neerest")
    assert (code, "There is no estimator 'neerest'; did you mean \"nearest\"?" in err) == (2, True)
    assert "of_near" not in sys.modules
    assert "reading" not in err  # hours of logs are not read before that is said
    # The springs of this log are not in the model: an answer of any estimator is not to be relied on, and is written.
    assert run("identify", path, sprung / "log.csv", "-o", output, "--estimator", "nearest")[0] == 3
    estimate = sy.Estimate.load(output / "estimate.json")
    assert estimate.method.endswith("least squares, moved to the nearest possible robot")
    assert json.loads((output / "run.json").read_text())["options"]["estimator"] == "nearest"
    assert run("check", path, output / "estimate.json")[0] == 0


def test_the_estimator_finds_the_nearest_possible_pendulum(example, monkeypatch):
    """Its inertia must not be negative, and everything else may stay, since its mass is free."""
    monkeypatch.setattr(sy, "identify", lambda *a, **b: Identified)
    estimator = example("An estimator")["nearest"]
    model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    info = sy.Information.from_factor(10 * np.eye(3), [-0.1, 5.0, 0.0], 0.02, 100, model.base_parameters().names)
    found = estimate_with(estimator, info, sy.FeasibleSet(model))
    np.testing.assert_allclose(found.base, [0.0, 0.5, 0.0], atol=2e-4)
    assert found.base[0] > 0


class Identified:
    """Stands for a result of the page, which test_documentation makes."""

    class estimate:  # noqa: N801
        method = ""


def _answer(info, feasible_set, **options):
    return sy.fit(info, feasible_set)


@pytest.mark.parametrize(
    ("estimator", "reason"),
    [
        (lambda info, feasible_set: _answer(info, feasible_set), "TypeError: .* unexpected keyword argument"),
        (lambda *a, **b: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda *a, **b: _answer(*a).parameters, "TypeError: expected a steelyard.Estimate, got"),
        (lambda info, *a, **b: sy.least_squares(info), "got one with base parameters alone"),
        (lambda *a, **b: replace(_answer(*a), parameters=np.ones(3)), "must give 10 finite parameters, got"),
        (lambda *a, **b: replace(_answer(*a), parameters=-_answer(*a).parameters), "are not feasible, so that"),
        (lambda *a, **b: replace(_answer(*a), base=2 * _answer(*a).base), "do not make the base that it says"),
        (lambda *a, **b: replace(_answer(*a), relative_error=0.0), "do not make the relative_error that it says"),
        (lambda *a, **b: replace(_answer(*a), base_expressions=("a", "b", "c")), "its base_expressions are not those"),
        (lambda *a, **b: replace(_answer(*a), consistency="inertia"), "its consistency are not those"),
        (lambda *a, **b: replace(_answer(*a), standard_error=np.ones(2)), "its standard_error has the shape"),
    ],
)
def test_what_an_estimator_does_wrong_is_said(estimator, reason):
    model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    names = model.base_parameters().names
    info = sy.Information.from_factor(10 * np.eye(3), [-0.1, 5.0, 0.0], 0.02, 100, names)
    with pytest.raises((InputError, SolverError), match=reason) as raised:
        estimate_with(estimator, info, sy.FeasibleSet(model), weights="joint")
    assert "\n" not in str(raised.value)


def test_a_forged_proof_and_gap_are_not_told():
    model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    info = sy.Information.from_factor(10 * np.eye(3), [-0.1, 5.0, 0.0], 0.02, 100, model.base_parameters().names)

    def forged(*given, **options):
        return replace(_answer(*given), certificate={"verdict": "feasible"}, optimality_gap=0.0)

    found = estimate_with(forged, info, sy.FeasibleSet(model))
    assert found.optimality_gap is None
    assert verify_document(found.certificate, "proof").valid


def _dh_table(install):
    text = PAGE.read_text(encoding="utf-8").partition("\n## A description format\n")[2]
    (block, *_) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    source = block.replace("register(", "(lambda *a: None)(")
    install("tables", "description_formats", {"dh": "of_tables:DhTable", "rows": "of_tables:DhTable"}, source)


ROWS = [[0, 0.5, 0, "q"], [0, 0.4, 0, "q"]]


@pytest.mark.slow
@pytest.mark.parametrize("content", ["direct", "file", "xml"])
def test_the_description_passes_through_an_identification(content, tmp_path, run, install):
    model = sy.Model(sy.Robot.from_dh(ROWS).with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))
    random = np.random.default_rng(1)
    truth = np.array([0.0, 0, 0, 0.02, 0, 0.02, -0.2, 0.01, 0, 2.0, 0.3, 0.2, 0.0] * 2)
    waves = random.normal(size=(2, 2, 4)) * 0.4
    t, q, dq, ddq = FourierTrajectory(a=waves[0], b=waves[1], center=np.zeros(2), frequency=0.2).sample(200.0, 5.0)
    torque = model.inverse_dynamics(q, dq, ddq, truth)
    sy.Recording(t=t, q=q, torque=torque, joint_names=model.robot.joint_names).save(tmp_path / "log.csv")
    _dh_table(install)
    path = tmp_path / "arm.DH"
    path.write_text(json.dumps({"rows": ROWS, "owner": "me"}))
    if content == "file":
        (tmp_path / "robot.toml").write_text('[description]\nfile = "arm.DH"\n')
        given = tmp_path / "robot.toml"
    else:
        given = path
    if content == "xml":
        other = tmp_path / "arm.xml"
        other.write_text("<?xml version='1.0'?><!-- <robot> --><rows/>")
        with pytest.raises(InputError, match=r"arm.xml cannot be read .JSONDecodeError"):  # by its root element
            sy.RobotFile.load(other)
    assert run("identify", given, tmp_path / "log.csv", "-o", tmp_path / "result")[0] == 0
    estimate = sy.Estimate.load(tmp_path / "result" / "estimate.json")
    written = json.loads((tmp_path / "result" / "robot.dh").read_text())
    assert (written["owner"], written["rows"]) == ("me", ROWS)
    assert written["parameters"]["m2"] == dict(zip(estimate.parameter_names, estimate.parameters, strict=True))["m2"]
    np.testing.assert_allclose(written["damping"], [0.3, 0.3], atol=0.01)  # of the robot that was simulated
    assert "robot.dh" in json.loads((tmp_path / "result" / "run.json").read_text())["files"]
    assert run("identify", given, tmp_path / "log.csv", "-o", tmp_path / "result")[0] == 0  # it may be replaced
    assert run("check", given, tmp_path / "result" / "estimate.json")[0] == 0


class Odd(DescriptionFormat):
    def read(self, path, tip, locked, gravity):
        return {"1": lambda: 1 / 0, "2": dict, "3": lambda: sy.Robot.from_dh(ROWS)}[path.read_text()]()


def test_what_a_description_format_does_wrong_is_said(tmp_path, run, no_extensions):
    path = tmp_path / "arm.odd"
    path.write_text("1")
    with pytest.raises(InputError, match=r"by a .urdf, .* or a .toml file, got the suffix '.odd'"):
        sy.RobotFile.load(path)
    register("description_formats", "odd", Odd)
    with pytest.raises(InputError, match=r"arm.odd cannot be read \(ZeroDivisionError: division by zero\)"):
        sy.RobotFile.load(path)
    path.write_text("2")
    with pytest.raises(InputError, match=r"TypeError: expected a steelyard.Robot, got"):
        sy.RobotFile.load(path)
    path.write_text("3")
    assert sy.RobotFile.load(path).robot.source == path
    (tmp_path / "robot.toml").write_text('[description]\nfile = "arm.odd"\nurdf = "arm.urdf"\n')
    with pytest.raises(InputError, match="it has both urdf and file; keep one"):
        sy.RobotFile.load(tmp_path / "robot.toml")
    with pytest.raises(InputError, match=r"expected a class derived from steelyard\.robot\.DescriptionFormat"):
        register("description_formats", "other", Odd())
    model = sy.Model(sy.RobotFile.load(path).robot)
    parameters = np.array([0.1, 0, 0, 0.1, 0, 0.1, 0, 0, 0, 2.0] * 2)
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 50, 2))
    samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=model.inverse_dynamics(q, dq, ddq, parameters))
    estimate = sy.fit(sy.Information.from_samples(model, samples), sy.FeasibleSet(model))
    with pytest.raises(InputError, match=r"arm.odd: descriptions of this format are read only"):
        estimate.write_description(path, tmp_path / "new.odd")
