"""Graph functions as SymPy expressions, against textbooks, another derivation and the interpreter."""

from __future__ import annotations

import sys
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from published_arms import WAM_ROWS

import steelyard as sy
from steelyard.codegen import sympy_function
from steelyard.errors import InputError, MissingExtraError
from steelyard.graph import Argument, Function, Graph, Node, Output, cos, sign, sin

sympy = pytest.importorskip("sympy", reason="symbolic expressions need sympy")


def symbols(text: str) -> Any:
    return sympy.symbols(text, real=True)


@pytest.fixture(scope="module")
def planar() -> sy.Model:
    rows = [(0, "a1", 0, "q"), (0, "a2", 0, "q")]
    return sy.Model(sy.Robot.from_dh(rows, name="planar", gravity=(0, -10, 0)))


@pytest.mark.slow
def test_planar_arm_is_that_of_textbooks(planar: sy.Model) -> None:
    """Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, section 7.4 (planar elbow manipulator)."""
    q1, q2, v1, v2, a1, a2, m1, m2, c1, c2, i1, i2 = symbols("q1 q2 dq1 dq2 a1 a2 m1 m2 c1 c2 i1 i2")
    # Frames stand at the far ends: the centres of mass are at c - a; inertias about them are i.
    links = {}
    for k, (mass, c, a, i) in enumerate(((m1, c1, a1, i1), (m2, c2, a2, i2)), start=1):
        links |= {f"lx{k}": mass * (c - a), f"ly{k}": 0, f"Lzz{k}": i + mass * (c - a) ** 2}
    g = 10
    d11 = m1 * c1**2 + m2 * (a1**2 + c2**2 + 2 * a1 * c2 * sympy.cos(q2)) + i1 + i2
    d12 = m2 * (c2**2 + a1 * c2 * sympy.cos(q2)) + i2
    d22 = m2 * c2**2 + i2
    h = -m2 * a1 * c2 * sympy.sin(q2)
    phi1 = (m1 * c1 + m2 * a1) * g * sympy.cos(q1) + m2 * c2 * g * sympy.cos(q1 + q2)
    expected = {
        "inertia_matrix": ("matrix", [d11, d12, d12, d22]),
        "coriolis_matrix": ("matrix", [h * v2, h * (v1 + v2), -h * v1, 0]),
        "gravity": ("torque", [phi1, m2 * c2 * g * sympy.cos(q1 + q2)]),
    }
    for name, (output, elements) in expected.items():
        found = planar.symbolic(name, substitute=links).outputs[output]
        assert [sympy.simplify(a - b) for a, b in zip(found, elements, strict=True)] == [0] * len(elements), name


@pytest.fixture(scope="module")
def example() -> sy.Model:
    robot = sy.Robot.from_dh([("-pi/2", 0, 0, "q+pi/2"), ("pi/2", 0, 0, "q-pi/2")], gravity=(0, 0, -9.81))
    return sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb()))


def test_kinematics_of_the_example_in_the_thesis(example: sy.Model) -> None:
    """Thesis section 7.1.2."""
    q1, q2 = symbols("q1 q2")
    s1, c1, s2, c2 = sympy.sin(q1), sympy.cos(q1), sympy.sin(q2), sympy.cos(q2)
    pose = [[-s1 * s2, -c1, s1 * c2, 0], [s2 * c1, -s1, -c1 * c2, 0], [c2, 0, s2, 0], [0, 0, 0, 1]]
    assert example.symbolic("pose").outputs["pose"] == sympy.Matrix(pose)
    jacobian = example.symbolic("jacobian", substitute={"px": 0, "py": 0, "pz": 0}).outputs["jacobian"]
    assert jacobian == sympy.Matrix([[0, 0], [0, 0], [0, 0], [0, -c1], [0, -s1], [1, 0]])


def test_inverse_dynamics_of_the_example_in_the_thesis(example: sy.Model) -> None:
    """Thesis section 7.1.3, the C code as printed; it renames only what a digit of `x^2` stands for."""
    found = example.symbolic("inverse_dynamics")
    assert found.arguments["parameters"][10:12] == symbols("Fvj1 Fcj1")
    q, dq, ddq, p = (found.arguments[name] for name in ("q", "dq", "ddq", "parameters"))
    number = sympy.Float(9.81)
    x0, x1 = sympy.cos(q[1]), sympy.sin(q[1])
    x2, x3 = number * x1, dq[0]
    x4, x5 = x1 * x3, x0 * x3
    x6 = dq[1] * p[15] + p[13] * x5 + p[16] * x4
    x7, x8 = -x4, -ddq[0]
    x9 = -x8
    x10, x11 = dq[1] * x5 + x1 * x9, dq[1] * x7 + x0 * x9
    x12 = dq[1] * p[16] + p[14] * x5 + p[17] * x4
    x13 = dq[1] * p[13] + p[12] * x5 + p[14] * x4
    x14 = number * x0
    first = (
        dq[0] * p[10]
        + p[11] * sympy.sign(dq[0])
        - p[3] * x8
        + x0 * (ddq[1] * p[13] + dq[1] * x12 + p[12] * x11 + p[14] * x10 + p[19] * x2 + x6 * x7)
        - x1 * (-ddq[1] * p[16] + dq[1] * x13 - p[14] * x11 - p[17] * x10 + p[19] * x14 - x5 * x6)
    )
    second = (
        ddq[1] * p[15]
        + dq[1] * p[22]
        + p[13] * x11
        + p[16] * x10
        - p[18] * x2
        + p[20] * x14
        + p[23] * sympy.sign(dq[1])
        - x12 * x5
        + x13 * x4
    )
    difference = sympy.Matrix([first, second]) - found.outputs["torque"]
    assert [sympy.simplify(sympy.expand(d).xreplace({number: sympy.Symbol("g")})) for d in difference] == [0, 0]


def lagrange(rows: list[tuple[str, Any, Any]], inertias: list[list[Any]], gravity: Any) -> tuple[Any, ...]:
    """Torques from the energies alone: (alpha, a, d) per joint, all turning, ten parameters per link."""
    count = len(rows)
    q, dq, ddq = (symbols(" ".join(f"{n}{k + 1}" for k in range(count)) + " ") for n in ("q", "dq", "ddq"))
    pose, kinetic, potential = sympy.eye(4), 0, 0
    for k, ((alpha, a, d), p) in enumerate(zip(rows, inertias, strict=True)):
        angle = sympy.sympify(alpha)
        ca, sa, cq, sq = sympy.cos(angle), sympy.sin(angle), sympy.cos(q[k]), sympy.sin(q[k])
        step = [[cq, -sq * ca, sq * sa, a * cq], [sq, cq * ca, -cq * sa, a * sq], [0, sa, ca, d], [0, 0, 0, 1]]
        pose = pose * sympy.Matrix(step)
        xx, xy, xz, yy, yz, zz, lx, ly, lz, m = p
        half = sympy.Rational(1, 2)  # the second moments of mass, from those of inertia
        pseudo = sympy.Matrix(
            [
                [half * (yy + zz - xx), -xy, -xz, lx],
                [-xy, half * (xx + zz - yy), -yz, ly],
                [-xz, -yz, half * (xx + yy - zz), lz],
                [lx, ly, lz, m],
            ]
        )
        rate = sum((pose.diff(q[j]) * dq[j] for j in range(count)), sympy.zeros(4))
        kinetic += half * (rate * pseudo * rate.T).trace()
        potential -= (sympy.Matrix([[*gravity, 0]]) * pose * sympy.Matrix([lx, ly, lz, m]))[0]
    torques = []
    for k in range(count):
        momentum = kinetic.diff(dq[k])
        torque = sum(momentum.diff(q[j]) * dq[j] + momentum.diff(dq[j]) * ddq[j] for j in range(count))
        torques.append(torque - kinetic.diff(q[k]) + potential.diff(q[k]))
    return tuple(torques)


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 3])
def test_spatial_arm_is_that_of_the_lagrangian(count: int) -> None:
    lengths = [sympy.Rational(1, 4), sympy.Rational(1, 2), sympy.Rational(3, 8)]
    rows = [("-pi/2", 0, lengths[0]), ("0", lengths[1], 0), ("pi/2", lengths[2], sympy.Rational(1, 8))][:count]
    gravity = symbols("gx gy gz")
    robot = sy.Robot.from_dh([(alpha, float(a), float(d), "q") for alpha, a, d in rows])
    found = sy.Model(robot).symbolic("inverse_dynamics", gravity="argument")
    links = [list(found.arguments["parameters"][10 * k : 10 * k + 10]) for k in range(count)]
    expected = lagrange(rows, links, gravity)
    generator = np.random.default_rng(3)
    numbers = generator.integers(-40, 40, len(found.symbols))
    point = {s: sympy.Rational(int(n), 16) for s, n in zip(found.symbols.values(), numbers, strict=True)}
    turned = {}
    for k in range(count):  # angles of Pythagorean triples keep everything rational
        t, angle = sympy.Rational(int(generator.integers(1, 9)), 5), symbols(f"q{k + 1}")
        del point[angle]
        turned |= {sympy.sin(angle): 2 * t / (1 + t**2), sympy.cos(angle): (1 - t**2) / (1 + t**2)}
    for ours, theirs in zip(found.outputs["torque"], expected, strict=True):
        value = ours.xreplace(turned).xreplace(point)
        assert value.is_Rational
        assert value == theirs.xreplace(turned).xreplace(point)


def random_function(seed: int) -> Function:
    generator = np.random.default_rng(seed)
    graph = Graph()
    arguments = (Argument("u", 3), Argument("v", 2, uniform=True))
    nodes: list[Node] = [graph.constant(0.375), graph.constant(2.0), graph.constant(0.1)]
    for argument in arguments:
        nodes += graph.inputs(argument.name, argument.width)
    for _ in range(60):
        a, b = (nodes[int(k)] for k in generator.integers(max(0, len(nodes) - 20), len(nodes), 2))
        kind = int(generator.integers(0, 8))
        if kind < 3:
            nodes.append(a + b if kind else a - b)
        elif kind < 5:
            nodes.append(a * sin(b))  # stays of moderate size
        elif kind == 5:
            nodes.append(a / (b * b + 1.0))
        else:
            nodes.append(-cos(a) if kind == 6 else sign(a) * b)
    outputs = (
        Output("scalar", (), (nodes[-1],)),
        Output("vector", (3,), tuple(nodes[-4:-1])),
        Output("matrix", (2, 2), tuple(nodes[-8:-4])),
        Output("tensor", (2, 1, 2), tuple(nodes[-12:-8])),
    )
    return Function("random", arguments, outputs)


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(k, marks=pytest.mark.slow) for k in range(2, 6))])
def test_random_functions_agree_with_the_interpreter(seed: int) -> None:
    function = random_function(seed)
    generator = np.random.default_rng(100 + seed)
    numbers = {a.name: [Fraction(int(n), 8) for n in generator.integers(-20, 20, a.width)] for a in function.arguments}
    expected = function.evaluate({name: [float(x) for x in row] for name, row in numbers.items()})
    values = {f"{name}{k + 1}": x for name, row in numbers.items() for k, x in enumerate(row)}
    with_variables = sympy_function(function, closed=False)
    assert with_variables.assignments
    before: set[Any] = set(with_variables.symbols.values())
    for symbol, expression in with_variables.assignments:
        assert expression.free_symbols <= before
        before.add(symbol)
    forms = [
        with_variables.substitute(values).closed(),
        with_variables.closed().substitute(values),
        sympy_function(function, substitute=values),
    ]
    for form in forms:
        assert (form.assignments, form.symbols) == ((), {})
        for name, array in expected.items():
            found = form.outputs[name]
            flat = [found] if array.ndim == 0 else sympy.flatten(found.tolist())
            assert np.array([float(x) for x in flat]).reshape(array.shape) == pytest.approx(array, rel=1e-10, abs=1e-10)


def test_numbers_are_exact_where_they_are_short() -> None:
    (x,) = Graph().inputs("x", 1)
    function = Function("f", (Argument("x", 1),), (Output("y", (3,), (x * 3.0, x * 0.375, x * 0.1)),))
    row = sympy_function(function).outputs["y"]
    assert row.shape == (3, 1)
    assert [e.args[0] for e in row] == [3, sympy.Rational(3, 8), sympy.Float(0.1)]
    assert row[2].args[0].is_Float
    assert float(row[2].args[0]) == 0.1


def test_symbols_carry_the_names_of_the_model(planar: sy.Model) -> None:
    found = planar.symbolic("inverse_dynamics", closed=False)
    names = {key: " ".join(s.name for s in row) for key, row in found.arguments.items()}
    assert names["q"] == "q1 q2"
    assert names["ddq"] == "ddq1 ddq2"
    assert names["parameters"].split() == list(planar.parameter_names)
    assert names["lengths"] == "a1 a2"
    assert all(symbol.is_real for symbol in found.symbols.values())
    base = sy.Model(planar.robot.with_lengths({"a1": 1.0, "a2": 1.0})).symbolic("gravity", base=True)
    assert base.arguments["base_parameters"][0].name == "beta1"
    moved = planar.symbolic("gravity", gravity="argument")
    assert " ".join(s.name for s in moved.arguments["gravity"]) == "gx gy gz"


def test_symbols_never_share_a_name() -> None:
    graph = Graph()
    q, lengths = graph.inputs("q", 2), graph.inputs("lengths", 2)
    arguments = (
        Argument("q", 2),
        Argument("lengths", 2, elements=("length q1, m", "length x1, m")),
        Argument("parameters", 1, elements=("m 1\n*/: hostile",)),
    )
    total = (q[0] + lengths[0]) * lengths[1]
    outputs = (Output("y", (2,), (total * total, sin(total) * graph.input("parameters[0]"))),)
    found = sympy_function(Function("f", arguments, outputs), closed=False)
    assert [s.name for s in found.arguments["lengths"]] == ["lengths1", "lengths2"]
    assert [s.name for s in found.arguments["parameters"]] == ["parameters1"]
    own = [symbol for symbol, _ in sympy_function(Function("f", arguments, outputs), closed=False).assignments]
    assert not set(own) & set(found.symbols.values())
    renamed = found.substitute({"q1": "x1"})
    assert {s.name[0] for s, _ in renamed.assignments} == {"y"}
    assert not {s for s, _ in renamed.assignments} & set(renamed.symbols.values())
    x1, other, third = symbols("x1 lengths1 lengths2")
    assert sympy.expand(renamed.closed().outputs["y"][0] - ((x1 + other) * third) ** 2) == 0


def test_substitution_takes_numbers_and_expressions(planar: sy.Model) -> None:
    found = planar.symbolic("gravity")
    m2, c, q1 = symbols("m2 c q1")
    values = {"lx1": 0, "ly1": 0.0, "m1": np.float64(0.5), "lx2": "m2*(c - a2)", "ly2": 0, "a1": Fraction(1, 4)}
    form = found.substitute(values)
    second = form.outputs["torque"][1]
    assert sympy.simplify(second - 10 * m2 * c * sympy.cos(q1 + symbols("q2"))) == 0
    assert form.arguments["substituted"] == (c,)
    assert [s.name for s in form.arguments["lengths"]] == ["a2"]
    assert planar.symbolic("gravity", substitute=values).outputs == form.outputs
    swapped = found.substitute({"m1": "m2", "m2": "m1"})  # all at once
    assert swapped.substitute({"m1": "m2", "m2": "m1"}).outputs == found.outputs
    assert found.substitute({"m2": sympy.Symbol("m1")}).symbols.keys() == found.symbols.keys() - {"m2"}


def test_zeros_fold_away() -> None:
    robot = sy.Robot.from_dh([("-pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q"), ("pi/2", 0.4, 0, "q")])
    function = sy.Model(robot).symbolic("inverse_dynamics", closed=False)
    still = function.substitute({f"{n}{k}": 0 for n in ("dq", "ddq") for k in (1, 2, 3)})
    assert len(still.assignments) < len(function.assignments) / 2
    gravity = sy.Model(robot).symbolic("gravity").outputs["torque"]
    assert sympy.simplify(still.closed().outputs["torque"] - gravity) == sympy.zeros(3, 1)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"lx": 0}, 'did you mean "lx'),
        ({"m1": float("nan")}, "finite number"),
        ({"m1": True}, "finite number"),
        ({"m1": None}, "finite number"),
        ({"m1": "__import__('os').getcwd()"}, "was expected"),
        ({"m1": "m2.free_symbols"}, "was expected"),
        ({"m1": "2 +"}, "was expected"),
        ({"m1": "m2/0"}, "was expected"),
        ({"m1": "9**9**9"}, "was expected"),
        ({"m1": "sin"}, "was expected"),
    ],
)
def test_bad_substitutions_are_explained(planar: sy.Model, values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        planar.symbolic("inverse_dynamics", substitute=values)


def test_division_by_zero_is_explained() -> None:
    a, b = Graph().inputs("x", 2)
    function = Function("ratio", (Argument("x", 2),), (Output("y", (), (a / b,)),))
    for substitute in (lambda v: sympy_function(function, substitute=v), sympy_function(function).substitute):
        with pytest.raises(InputError, match="divides by 0"):
            substitute({"x2": 0})


@pytest.mark.slow
def test_closed_forms_that_would_explode_are_refused() -> None:
    model = sy.Model(sy.Robot.from_dh(WAM_ROWS, name="wam"))
    with pytest.raises(InputError, match="use closed=False"):
        model.symbolic("inverse_dynamics")
    assert len(model.symbolic("inverse_dynamics", closed=False).assignments) > 100
    assert model.symbolic("gravity").assignments == ()


@pytest.mark.slow
def test_deep_functions_need_no_recursion() -> None:
    graph = Graph()
    x, y = graph.inputs("x", 2)
    node = x
    for _ in range(1100):
        node = sin(node * y) + x
    function = Function("deep", (Argument("x", 2),), (Output("y", (), (node,)),))
    found = sympy_function(function, closed=False)
    assert len(found.latex()) > 1100
    assert found.substitute({"x2": 0}).outputs["y"] == found.arguments["x"][0]
    with pytest.raises(InputError, match="use closed=False"):
        found.closed()


def test_as_deep_as_is_allowed_can_be_printed() -> None:
    graph = Graph()
    x, y = graph.inputs("x", 2)
    node, last = x, None
    for _ in range(200):
        node = sin(node * y) + x
        try:
            last = sympy_function(Function("deep", (Argument("x", 2),), (Output("y", (), (node,)),)))
        except InputError:
            break
    assert last is not None
    assert str(last.outputs["y"]).count("sin") > 30
    assert last.latex().count(r"\sin") > 30
    assert last.substitute({"x1": 0.5}).outputs["y"].free_symbols == {symbols("x2")}


def test_absent_sympy_is_explained(planar: sy.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sympy", None)
    with pytest.raises(MissingExtraError, match=r"sympy>="):
        planar.symbolic("gravity")
