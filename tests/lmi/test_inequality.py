import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet
from steelyard.lmi import LinearMatrixInequality, block_diagonal, variables

INERTIAL = ("Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m")


def generalised_inertia(number=""):
    """Thesis (3.20), element by element."""
    L = {k: f"L{k}{number}" for k in ("xx", "xy", "xz", "yy", "yz", "zz")}
    x, y, z, m = (f"{symbol}{number}" for symbol in ("lx", "ly", "lz", "m"))
    return [
        [L["xx"], L["xy"], L["xz"], 0, z, f"-{y}"],
        [L["xy"], L["yy"], L["yz"], f"-{z}", 0, x],
        [L["xz"], L["yz"], L["zz"], y, f"-{x}", 0],
        [0, f"-{z}", y, m, 0, 0],
        [z, 0, f"-{x}", 0, m, 0],
        [f"-{y}", x, 0, 0, 0, m],
    ]


def random_inequality(rng, names=("a", "b", "c"), sizes=(3, 1, 2)):
    blocks = []
    for size in sizes:
        matrices = rng.normal(size=(len(names) + 1, size, size))
        matrices += matrices.transpose(0, 2, 1)
        blocks.append(LinearMatrixInequality.from_coefficients(names, matrices[0], matrices[1:], f"of {size}"))
    return block_diagonal(*blocks)


def test_matrix_of_a_feasible_set_is_thesis_3_20(two_links):
    written = LinearMatrixInequality.from_matrices(
        generalised_inertia(1),
        generalised_inertia(2),
        "Fvj1",
        "Fvj2",
        names=two_links.parameter_names,
        strict=True,
    )
    assert FeasibleSet(two_links, "inertia").inequality == written


def test_names_are_those_of_the_model_and_values_agree_with_the_blocks(two_links):
    feasible = FeasibleSet(two_links)
    inequality = feasible.inequality
    assert inequality.names == two_links.parameter_names
    delta = np.random.default_rng(1).normal(size=22)
    by_name = dict(zip(two_links.parameter_names, delta, strict=True))
    for found, block in zip(inequality.evaluate(by_name), feasible.blocks, strict=True):
        np.testing.assert_array_equal(found, block.evaluate(delta))
    assert inequality.smallest_eigenvalue(delta) == feasible.stack.smallest_eigenvalues(delta).min()


def test_evaluation_agrees_with_sympy():
    sympy = pytest.importorskip("sympy", reason="SymPy is not installed")
    symbols = sympy.symbols("x y z")
    x, y, z = symbols
    matrix = sympy.Matrix([[x + 2 * y, z / 3 - 1], [z / 3 - 1, sympy.Rational(1, 2) - y]])
    inequality = LinearMatrixInequality.from_matrices(matrix, [[3 * z]], names=["x", "y", "z"])
    values = {"x": 0.3, "y": -1.25, "z": 2.0}
    expected = np.array(matrix.subs({s: values[str(s)] for s in symbols}), dtype=float)
    whole = inequality.matrix(values)
    np.testing.assert_allclose(whole[:2, :2], expected, rtol=1e-15)
    assert whole[2, 2] == 6.0
    assert not whole[:2, 2].any()
    np.testing.assert_allclose(inequality.eigenvalues(values), np.sort([6.0, *np.linalg.eigvalsh(expected)]))
    assert inequality.smallest_eigenvalue(values) == pytest.approx(float(np.linalg.eigvalsh(expected)[0]))


def test_definiteness_is_proved_or_denied():
    inequality = LinearMatrixInequality.from_matrices([["x", 1], [1, "y"]], "x - y")
    assert inequality.is_positive_definite({"x": 3.0, "y": 2.0})
    assert not inequality.is_positive_definite({"x": 2.0, "y": 2.0})
    assert not inequality.is_positive_definite({"x": 3.0, "y": 0.25})


def test_expressions_and_coefficients_make_the_same_inequality_again():
    inequality = random_inequality(np.random.default_rng(2))
    labels = [block.name for block in inequality.blocks]
    again = LinearMatrixInequality.from_matrices(*inequality.expressions, names=inequality.names, labels=labels)
    assert again == inequality
    parts = [
        LinearMatrixInequality.from_coefficients(
            inequality.names, constant, {name: inequality.coefficients(name)[i] for name in inequality.names}
        )
        for i, constant in enumerate(inequality.constants)
    ]
    assert block_diagonal(*parts) == inequality


def test_equality_disregards_order_of_variables_but_not_values():
    inequality = random_inequality(np.random.default_rng(3))
    assert inequality.with_names(["c", "a", "b"]) == inequality
    assert hash(inequality.with_names(["c", "a", "b"])) == hash(inequality)
    assert inequality.with_margin(1e-9) != inequality
    assert inequality.substitute({"a": "b", "b": "a"}) != inequality
    assert inequality != block_diagonal(inequality, inequality)
    assert (inequality == 3) is False


def test_substitution_evaluates_to_the_same():
    rng = np.random.default_rng(4)
    inequality = random_inequality(rng)
    u, v = variables("u v")
    substituted = inequality.substitute({"a": 2 * u - v + 0.5, "c": "3*b - u"})
    assert substituted.names == ("u", "v", "b")
    values = dict(zip(("u", "v", "b"), rng.normal(size=3), strict=True))
    old = {"a": 2 * values["u"] - values["v"] + 0.5, "b": values["b"], "c": 3 * values["b"] - values["u"]}
    np.testing.assert_allclose(substituted.matrix(values), inequality.matrix(old), atol=1e-13)


def test_numbers_for_variables_leave_a_smaller_inequality():
    inequality = LinearMatrixInequality.from_matrices([["x", "y"], ["y", 1]])
    fixed = inequality.substitute({"y": 2})
    assert fixed.names == ("x",)
    assert fixed.smallest_eigenvalue({"x": 4.0}) == pytest.approx(0.0, abs=1e-15)
    assert inequality.substitute({"x": 5, "y": 2}).smallest_eigenvalue({}) == pytest.approx(3 - 2 * 2**0.5)


def test_change_of_variables_is_substitution_by_a_matrix():
    rng = np.random.default_rng(5)
    inequality = random_inequality(rng)
    matrix, offset, y = rng.normal(size=(3, 4)), rng.normal(size=3), rng.normal(size=4)
    changed = inequality.change_variables(matrix, ["p", "q", "r", "s"], offset)
    np.testing.assert_allclose(changed.matrix(y), inequality.matrix(matrix @ y + offset), atol=1e-13)


def test_margin_moves_the_eigenvalues():
    inequality = LinearMatrixInequality.from_matrices([["x", 1], [1, "x"]], strict=True)
    moved = inequality.with_margin(0.25)
    assert (inequality.strict, moved.strict) == (True, False)
    np.testing.assert_allclose(moved.eigenvalues([3.0]), inequality.eigenvalues([3.0]) - 0.25)


def test_variables_of_several_are_joined_by_name():
    one = LinearMatrixInequality.from_matrices([["x", "y"], ["y", 1]])
    other = LinearMatrixInequality.from_matrices("z - 2*y")
    both = one & other
    assert both.names == ("x", "y", "z")
    assert both.size == 3
    assert both.matrix({"x": 1.0, "y": 2.0, "z": 7.0})[2, 2] == 3.0


def test_unused_variables_are_kept_and_may_be_added():
    inequality = LinearMatrixInequality.from_matrices("x", names=["w", "x"])
    assert inequality.names == ("w", "x")
    assert inequality.coefficients("w")[0].tolist() == [[0.0]]
    assert inequality.with_names(["x", "t"]).evaluate([3.0, 9.0])[0].tolist() == [[3.0]]


def test_text_is_aligned():
    inequality = LinearMatrixInequality.from_matrices([["m1", 0], [0, "2*m1 - 1"]], "x", labels=["body", "x >= 0"])
    assert str(inequality) == "body:\n⎡ m1  0        ⎤\n⎣ 0   2*m1 - 1 ⎦ ⪰ 0\nx >= 0:\n[ x ] ⪰ 0"
    assert "≻ 0" in LinearMatrixInequality.from_matrices("x", strict=True).pretty()
    assert repr(inequality) == "LinearMatrixInequality(2 blocks, of orders 2 and 1, in m1, x)"


def test_large_blocks_are_shortened():
    size = 30
    inequality = LinearMatrixInequality.from_coefficients(["t"], np.zeros((size, size)), [np.eye(size)])
    lines = inequality.pretty(most=6).splitlines()
    assert len(lines) == 1 + 6
    assert len({len(line) for line in lines[1:-1]}) == 1
    assert "⋯" in lines[1]


def test_html_and_latex_hold_the_names():
    inequality = LinearMatrixInequality.from_coefficients(
        ["Lxx1", "a<b"], [[-2, 0], [0, 1e-7]], {"Lxx1": [[1, 0], [0, 0]], "a<b": [[0, 1], [1, 0]]}, "x & y"
    )
    html = inequality._repr_html_()
    assert "x &amp; y" in html
    assert "<td>a&lt;b</td>" in html
    assert inequality.latex() == (
        r"\begin{bmatrix} L_{xx1} - 2 & a_{<b} \\ a_{<b} & 1 \cdot 10^{-7} \end{bmatrix} \succeq 0"
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: LinearMatrixInequality.from_matrices([["x", 1], [2, "x"]]), r"\(2, 1\) is 2, but \(1, 2\) is 1"),
        (lambda: LinearMatrixInequality.from_matrices([["x", 1]]), "row 1 of the matrix 'block 1' has 2 elements"),
        (lambda: LinearMatrixInequality.from_matrices(["x", "y"]), "row 1 of the matrix 'block 1' is 'x'"),
        (lambda: LinearMatrixInequality.from_matrices([]), "has no rows"),
        (lambda: LinearMatrixInequality.from_matrices(), "at least one matrix"),
        (lambda: LinearMatrixInequality.from_matrices([["x*y"]]), r"element \(1, 1\) of 'block 1': 'x\*y' is not lin"),
        (lambda: LinearMatrixInequality.from_matrices("x", names=["y"]), "'x' is not among the names"),
        (lambda: LinearMatrixInequality.from_matrices("x", labels=["a", "b"]), "2 labels for 1 matrices"),
        (lambda: LinearMatrixInequality.from_matrices("x", names=["x", "x"]), "named twice"),
        (
            lambda: LinearMatrixInequality.from_coefficients(["x"], [[0]], [[[1]], [[2]]]),
            "2 coefficient matrices for 1",
        ),
        (
            lambda: LinearMatrixInequality.from_coefficients(["x"], [[0, 1], [0, 0]], {}),
            "'constant' in 'block 1' is not",
        ),
        (lambda: LinearMatrixInequality.from_coefficients(["x"], [[0]], {"x": np.eye(2)}), "several sizes"),
        (lambda: LinearMatrixInequality.from_coefficients(["x"], [[0]], {"y": [[1]]}), "'y', which is not among"),
        (lambda: LinearMatrixInequality.from_coefficients(["x"], [[np.inf]], {}), "not finite"),
        (lambda: LinearMatrixInequality.from_coefficients(["x"], None, {}), "neither a constant nor coefficients"),
        (lambda: LinearMatrixInequality.from_coefficients(["x"], [["a"]], {}), "does not consist of numbers"),
    ],
)
def test_what_is_no_inequality_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize(
    ("use", "message"),
    [
        (lambda lmi: lmi.evaluate([1.0]), "each of 2 variables"),
        (lambda lmi: lmi.evaluate({"x": 1.0}), "no value was given for the variable 'y'"),
        (lambda lmi: lmi.evaluate([1.0, np.nan]), "value of 'y' must be finite"),
        (lambda lmi: lmi.evaluate(["a", "b"]), "must be numbers"),
        (lambda lmi: lmi.coefficients("X"), "no variable 'X'; did you mean \"x\""),
        (lambda lmi: lmi.substitute({"z": 1.0}), "no variable 'z'"),
        (lambda lmi: lmi.substitute({"x": "y*y"}), "the value of 'x': 'y\\*y' is not linear"),
        (lambda lmi: lmi.with_names(["x"]), "leave out 'y'"),
        (lambda lmi: lmi.with_margin(np.nan), "finite number"),
        (lambda lmi: lmi.change_variables(np.eye(3), ["a", "b", "c"]), r"a matrix of shape \(2, 3\)"),
        (lambda lmi: lmi & LinearMatrixInequality.from_matrices("x", strict=True), "strict and non-strict"),
    ],
)
def test_wrong_use_is_refused(use, message):
    with pytest.raises(InputError, match=message):
        use(LinearMatrixInequality.from_matrices([["x", "y"], ["y", 1]]))
