import math
import operator
from fractions import Fraction

import numpy as np
import pytest
from any_text import CHARACTERS
from hypothesis import given
from hypothesis import strategies as st

from steelyard.errors import InputError
from steelyard.lmi import LinearExpression, as_expression, parse_expression, variables

numbers = st.floats(-1e6, 1e6, allow_nan=False).map(lambda value: float(f"{value:.6g}"))
names = st.sampled_from(["m1", "Lxx2", "lz3", "Fv_1", "beta12"])


def leaves():
    return st.one_of(names, numbers.map(lambda value: f"({value!r})"))


def sums(inner):
    combined = st.tuples(inner, st.sampled_from(["+", "-"]), inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})")
    scaled = st.tuples(numbers, inner).map(lambda t: f"{t[0]!r} * {t[1]}")
    divided = st.tuples(inner, numbers.filter(lambda v: abs(v) > 1e-3)).map(lambda t: f"{t[0]} / ({t[1]!r})")
    return st.one_of(combined, scaled, divided, inner.map(lambda text: f"-{text}"))


@given(text=st.recursive(leaves(), sums, max_leaves=12), values=st.lists(numbers, min_size=5, max_size=5))
def test_texts_have_the_value_that_python_gives_them(text, values):
    given_values = dict(zip(["m1", "Lxx2", "lz3", "Fv_1", "beta12"], values, strict=True))
    expected = eval(text, {"__builtins__": {}}, given_values)
    found = parse_expression(text)
    sizes = [abs(found.constant), *(abs(c * given_values[name]) for name, c in found.terms.items())]
    assert found.evaluate(given_values) == pytest.approx(expected, rel=1e-9, abs=1e-9 * max(sizes, default=1.0))


@given(
    terms=st.dictionaries(names, st.floats(allow_nan=False, allow_infinity=False), max_size=5),
    constant=st.floats(allow_nan=False, allow_infinity=False),
)
def test_what_is_printed_reads_back_exactly(terms, constant):
    expression = LinearExpression(terms, constant)
    assert parse_expression(str(expression)) == expression


def test_order_of_the_terms_is_kept():
    assert str(parse_expression("Lzz2 + Iam1 - 2*m3 + Lyy1 + 0*m9 - 3")) == "Lzz2 + Iam1 - 2*m3 + Lyy1 - 3"
    assert parse_expression("b - a").names == ("b", "a")


def test_arithmetic_with_numbers_of_all_kinds():
    x, y = variables("x, y")
    mixed = 2 * x + y / Fraction(1, 2) - np.float64(0.5) * x + np.int64(3) - y
    assert dict(mixed.terms) == {"x": 1.5, "y": 1.0}
    assert mixed.constant == 3.0
    assert 1 - x == -(x - 1)
    assert sum([x, y, 2]) == x + y + 2
    assert x - x == 0
    assert (x - x).names == ()


def test_arrays_of_expressions_multiply_as_matrices():
    x, y = variables("x y")
    first, second = np.array([[1.0, 2.0], [3.0, -4.0]]) @ np.array([x, y])
    assert first == x + 2 * y
    assert second == 3 * x - 4 * y


def test_equal_expressions_have_equal_hashes():
    x, y = variables("x y")
    assert len({x + y, y + x, 2 * x - x + y}) == 1
    assert hash(LinearExpression(constant=2.0)) == hash(2)


def test_products_of_expressions_are_refused():
    x, y = variables("x y")
    with pytest.raises(InputError, match=r"\(x\) \* \(y\) is not linear"):
        x * y
    with pytest.raises(InputError, match=r"\(1\) / \(y\) is not linear"):
        1 / y
    with pytest.raises(InputError, match="divided by zero"):
        x / 0
    assert x * (y - y + 3) == 3 * x


def test_texts_are_no_operands():
    (x,) = variables("x")
    with pytest.raises(TypeError):
        operator.add(x, "y")


def test_substitution_is_simultaneous():
    x, y = variables("x y")
    assert (x - 3 * y).substitute({"x": y, "y": x}) == y - 3 * x


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("   ", "is empty"),
        ("m1 +", "cannot be read"),
        ("2m1", "cannot be read"),
        ("m1 m2", "cannot be read"),
        ("m1^2", r"holds 'm1\^2'"),
        ("m1**2", r"holds 'm1\*\*2'"),
        ("2*(m1*m2)", r"not linear in 'm1\*m2'"),
        ("m1/m2", "not linear in 'm1/m2'"),
        ("m1/(2 - 2)", "divides by zero"),
        ("sin(m1)", r"holds 'sin\(m1\)'"),
        ("m1 == 2", "holds 'm1 == 2'"),
        ("True*m1", "holds 'True'"),
        ("3j*m1", "holds '3j'"),
        ("[m1]", r"holds '\[m1\]'"),
        ("m1.real", "holds 'm1.real'"),
        ("m1 if 1 else m2", "holds 'm1 if 1 else m2'"),
        ("'m1'", "holds \"'m1'\""),
        ("1e400*m1", "too large"),
        ("1e308*10*m1", "too large"),
        ("1" + 400 * "0", "too large"),
        ("m1\0", "cannot be read"),
        ("Lyy3 + m1", 'did you mean "Lyy2"'),
        ("q", 'known are "Lyy1", "Lyy2", "m1", "m2"'),
        ("(" * 3000 + "m1" + ")" * 3000, "cannot be read|too long"),
        ("-" * 100000 + "m1", "too long or nested too deeply"),
        ("__import__('os').system('true')", "cannot be read; write a sum"),
    ],
)
def test_what_is_no_affine_text_is_refused(text, message):
    with pytest.raises(InputError, match=message):
        parse_expression(text, ["Lyy1", "Lyy2", "m1", "m2"])


@given(text=st.text(CHARACTERS, max_size=30))
def test_any_text_is_an_expression_or_an_error(text):
    try:
        found = parse_expression(text)
    except InputError:
        return
    assert all(map(math.isfinite, (*found.terms.values(), found.constant)))


def test_long_sums_and_odd_signs():
    assert len(parse_expression(" + ".join(f"m{i}" for i in range(900))).names) == 900
    assert parse_expression("−m1·2 +\n 3 × m2") == parse_expression("3*m2 - 2*m1")
    assert parse_expression("pi*m1").coefficient("m1") == math.pi
    assert parse_expression("pi", ["pi"]).names == ("pi",)


def test_letters_that_python_normalises_are_found():
    assert parse_expression("Fᵥ1", ["Fᵥ1"]).names == ("Fᵥ1",)


def test_sympy_expressions_are_read():
    sympy = pytest.importorskip("sympy", reason="SymPy is not installed")
    x, y = sympy.symbols("x y")
    found = as_expression(sympy.sqrt(2) * x + (x + 1) ** 2 - x**2 - y / 3)
    assert found.coefficient("x") == pytest.approx(math.sqrt(2) + 2, rel=1e-15)
    assert found.coefficient("y") == pytest.approx(-1 / 3, rel=1e-15)
    assert found.constant == 1.0
    for text in ("x*y", "sin(x)", "x**2"):
        with pytest.raises(InputError, match="is not linear in x"):
            as_expression(sympy.sympify(text))
    for value in (sympy.I * x, x + sympy.zoo, sympy.Symbol("x") > 0):
        with pytest.raises(InputError, match="not an affine expression with real"):
            as_expression(value)
    with pytest.raises(InputError, match="not finite"):
        as_expression(sympy.oo * x)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: LinearExpression({"x": math.nan}), "coefficient of x must be finite"),
        (lambda: LinearExpression({"x": "2"}), "coefficient of x must be a number, got '2'"),
        (lambda: LinearExpression({"": 1.0}), "must have a name"),
        (lambda: LinearExpression({3: 1.0}), "must have a name, got 3"),
        (lambda: LinearExpression(constant=math.inf), "constant of an expression must be finite"),
        (lambda: variables("a b a"), "'a' is named twice"),
        (lambda: variables(" "), "needs at least one name"),
        (lambda: as_expression([1, 2]), "must be a number, a text or an expression"),
        (lambda: as_expression(True), "must be a number, got True"),
        (lambda: as_expression({"Lyy9": 1.0}, ["Lyy1"]), 'did you mean "Lyy1"'),
        (lambda: parse_expression("x").evaluate({"y": 1.0}), "no value was given for 'x'"),
        (lambda: parse_expression(3), "must be a text, got 3"),
    ],
)
def test_wrong_values_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
