"""Verifying certificates with integers alone, without a solver and without floating point."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from .rational import dot, is_definite, nearest_double
from .statement import EQUATION_TOLERANCE, Matrix, Statement

__all__ = [
    "CONSISTENCIES",
    "CertificateCheck",
    "bodies",
    "body_matrix",
    "refused",
    "verify_dual_point",
    "verify_witness",
]


CONSISTENCIES = ("full", "inertia")

_SYMBOLS = ("Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m")


def bodies(parameter_names: Sequence[str]) -> dict[str, tuple[int, ...]]:
    """Return where the ten inertial parameters of each link stand, by the ending that their names share.

    Examples
    --------
    >>> bodies(["Fv1", "Lxx1", "Lxy1", "Lxz1", "Lyy1", "Lyz1", "Lzz1", "lx1", "ly1", "lz1", "m1"])
    {'1': (1, 2, 3, 4, 5, 6, 7, 8, 9, 10)}
    """
    places = {name: index for index, name in enumerate(parameter_names)}
    endings = (name.removeprefix(_SYMBOLS[0]) for name in parameter_names if name.startswith(_SYMBOLS[0]))
    return {
        ending: tuple(places[symbol + ending] for symbol in _SYMBOLS)
        for ending in endings
        if all(symbol + ending in places for symbol in _SYMBOLS)
    }


def body_matrix(inertial: Sequence[Fraction], consistency: str) -> Matrix:
    """Return the matrix that is positive definite for a body that can exist.

    The pseudo-inertia ``[[tr(L)/2 - L, l], [l', m]]`` (Wensing et al. 2018, eq. 5) for ``"full"``; for ``"inertia"``
    ``[[L, S(l)'], [S(l), m 1]]`` (thesis 3.20).

    Parameters
    ----------
    inertial : sequence of Fraction
        ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m``.
    consistency : {"full", "inertia"}
    """
    xx, xy, xz, yy, yz, zz, x, y, z, m = inertial
    o = Fraction(0)
    if consistency == "full":
        half = (xx + yy + zz) / 2
        return [[half - xx, -xy, -xz, x], [-xy, half - yy, -yz, y], [-xz, -yz, half - zz, z], [x, y, z, m]]
    return [
        [xx, xy, xz, o, -z, y],
        [xy, yy, yz, z, o, -x],
        [xz, yz, zz, -y, x, o],
        [o, z, -y, m, o, o],
        [-z, o, x, o, m, o],
        [y, -x, o, o, o, m],
    ]


LEAST_TRACE_BOUND, LEAST_RELATIVE_TRACE_BOUND = 10**6, 10**4
"""Least trace bound of a proof of infeasibility up to a size, in kg and kg m², and relative to the largest base
parameter. No real robot is larger. With a bound that is too small, all base parameters would be proved infeasible."""


@dataclass(frozen=True)
class CertificateCheck:
    """Outcome of verifying a certificate; true if the proof is valid.

    Attributes
    ----------
    valid : bool
    sentence : str
        The statement that is proved, or the error.
    gap : float
        Amount by which the dual point contradicts feasibility; 0 for a witness.
    trace_bound : float
        Sum of the traces of the links' and terms' matrices (kg, kg m² and units of friction) up to which
        infeasibility is proved; infinite if it is proved without restriction.
    """

    valid: bool
    sentence: str
    gap: float = 0.0
    trace_bound: float = float("inf")

    def __bool__(self) -> bool:
        return self.valid


def verify_witness(statement: Statement, parameters: Sequence[Fraction]) -> CertificateCheck:
    """Check K δ = β, every equation, and that every condition is definite at δ (thesis 3.34).

    The conditions of the bodies are checked even if the statement does not name them, so that none can be left out.
    """
    links = bodies(statement.parameter_names)
    if statement.consistency not in CONSISTENCIES:
        return refused(f"its consistency is {statement.consistency!r}, which nothing defines")
    if not links or len(links) < sum(name.startswith("Lxx") for name in statement.parameter_names):
        return refused("its statement does not name the ten inertial parameters of each body")
    if len(parameters) != len(statement.parameter_names):
        return refused(f"it has {len(parameters)} parameters instead of {len(statement.parameter_names)}")
    for row, value, expression in zip(statement.base_map, statement.base, statement.base_expressions, strict=True):
        if dot(row, parameters) != value:
            return refused(f"its parameters do not have the base parameter {expression}")
    for equation in statement.equations:
        if equation.tolerance > EQUATION_TOLERANCE * equation.scale:
            return refused(f"its statement lets {equation.name} be missed by {nearest_double(equation.tolerance):.3g}")
        if abs(dot(equation.coefficients, parameters) - equation.value) > equation.tolerance:
            return refused(f"its parameters do not satisfy {equation.name}")
    for condition in statement.conditions:
        if not is_definite(condition.evaluate(parameters), condition.strict):
            kind = "positive definite" if condition.strict else "positive semidefinite"
            return refused(f"at its parameters the condition {condition.name} is not {kind}")
    for ending, columns in links.items():
        if not is_definite(body_matrix([parameters[k] for k in columns], statement.consistency), strict=True):
            return refused(f"at its parameters no body has the mass m{ending} and the inertia that go with it")
    return CertificateCheck(
        True,
        "Proved in exact arithmetic: these base parameters are feasible; the parameters given have them, make "
        f'{len(links)} possible bodies under "{statement.consistency}" consistency, and satisfy {_stated(statement)}.',
    )


def verify_dual_point(
    statement: Statement,
    direction: Sequence[Fraction],
    duals: Mapping[int, Matrix],
    multipliers: Sequence[Fraction],
    shift: Fraction,
) -> CertificateCheck:
    """Check that no δ satisfies all conditions and equations.

    For Z_b, y and λ with Σ <D_bi, Z_b> + Σ λ_e E_ei = (Kᵀ y)_i for every parameter i,

    Σ <D_b(δ), Z_b> = Σ <D_b0, Z_b> + yᵀβ - λᵀ E δ

    for all δ with K δ = β. The left side is not negative where Z_b ⪰ 0 and δ is feasible, so that a negative right side
    proves infeasibility. If only Z_b + shift 1 ⪰ 0 holds, this is proved for all δ up to a size, the trace bound.

    Parameters
    ----------
    direction : (n_b,)
        y.
    duals : mapping from condition index to Z_b
    multipliers : (r,)
        λ.
    shift : Fraction
        Not negative; 0 for a proof without restriction.
    """
    if statement.consistency not in CONSISTENCIES:
        return refused(f"its consistency is {statement.consistency!r}, which nothing defines")
    if len(direction) != len(statement.base) or len(multipliers) != len(statement.equations) or shift < 0:
        return refused("its dual point does not fit its statement")
    gradient: dict[int, Fraction] = {}
    value, touches_strict = Fraction(0), False
    for index, dual in duals.items():
        condition = statement.conditions[index]
        if len(dual) != condition.size or any(len(row) != condition.size for row in dual):
            return refused(f"the dual matrix of {condition.name} has another size than the condition")
        slack = shift if condition.physical else Fraction(0)
        shifted = [[entry + slack * (i == j) for j, entry in enumerate(row)] for i, row in enumerate(dual)]
        if not is_definite(shifted, strict=False):
            return refused(f"the dual matrix of {condition.name} is not positive semidefinite")
        constant, products = condition.products(dual)
        value += constant
        touches_strict |= condition.strict and any(entry for row in dual for entry in row)
        for parameter, product in products.items():
            gradient[parameter] = gradient.get(parameter, Fraction(0)) + product
    for equation, multiplier in zip(statement.equations, multipliers, strict=True):
        value += abs(multiplier) * equation.tolerance - multiplier * equation.value
        for parameter, coefficient in equation.coefficients.items():
            gradient[parameter] = gradient.get(parameter, Fraction(0)) + multiplier * coefficient
    for row, weight, base in zip(statement.base_map, direction, statement.base, strict=True):
        value += weight * base
        for parameter, coefficient in row.items():
            gradient[parameter] = gradient.get(parameter, Fraction(0)) - weight * coefficient
    for parameter, rest in gradient.items():
        if rest:
            return refused(f"its dual point is not orthogonal to changes of {statement.parameter_names[parameter]}")
    if value > 0 or (value == 0 and (shift or not touches_strict)):
        return refused("its dual point does not contradict feasibility")
    gap = nearest_double(-value)
    if shift:
        trace_bound = nearest_double(-value / shift)
        bound = f"the traces of their matrices add to less than {trace_bound:.3g} (kg and kg m²)"
        largest = max((abs(number) for number in statement.base), default=Fraction(0))
        if -value < shift * max(Fraction(LEAST_TRACE_BOUND), LEAST_RELATIVE_TRACE_BOUND * largest):
            return refused(
                f"it excludes only parameters as far as {bound}, and must reach {LEAST_TRACE_BOUND:.0e} and "
                f"{LEAST_RELATIVE_TRACE_BOUND:.0e} times the largest base parameter"
            )
        return CertificateCheck(
            True,
            f"Proved in exact arithmetic, as far as {bound}: no parameters with these base parameters satisfy "
            f"{_stated(statement)}.",
            gap,
            trace_bound,
        )
    return CertificateCheck(
        True,
        f"Proved in exact arithmetic: no parameters with these base parameters satisfy {_stated(statement)}.",
        gap,
    )


def _stated(statement: Statement) -> str:
    count = len(statement.conditions) + len(statement.equations)
    return "the one condition stated" if count == 1 else f"all {count} conditions stated"


def refused(reason: str) -> CertificateCheck:
    """The outcome for a certificate that proves nothing."""
    return CertificateCheck(False, f"Not a proof: {reason}.", 0.0, 0.0)
