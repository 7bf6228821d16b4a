"""Feasibility of base parameters in closed form, for planar robots (thesis 3.1.3)."""

from __future__ import annotations

import time
from fractions import Fraction
from typing import Any, Literal

import numpy as np

from steelyard.codegen.sympy import import_sympy
from steelyard.errors import InputError
from steelyard.feasibility.constraints import ModelLike

from .polynomials import feasibility_polynomials, standard_by_base
from .quantifier_elimination import eliminate, qepcad_program

__all__ = ["closed_form_conditions"]

# For each axis the places, within a link's ten parameters, of what turning about it shows: moment of inertia, first
# moments, mass.
_PLANAR = ((0, 7, 8, 9), (3, 6, 8, 9), (5, 6, 7, 9))


def closed_form_conditions(
    model: ModelLike, consistency: Literal["inertia", "full"] = "inertia", timeout: float = 60.0
) -> Any:
    """Return the condition on base parameters alone for feasible standard parameters to exist (thesis 3.16).

    For planar robots: all axes are parallel, so that a link shows four parameters at most, about z ``Lzz lx ly m``.
    Values for its other six exist just where m > 0 and m Lzz > lx² + ly², for either consistency: the link can
    be a flat plate. The dependent parameters that are left are eliminated one after the other by the program QEPCAD
    (cylindrical algebraic decomposition, Collins 1975), whose work grows doubly exponentially with the number of
    variables: up to three joints that turn, or slide in the plane, take seconds; four turning joints, or two and one
    that slides along the axes (SCARA), hours or more.

    Parameters
    ----------
    model : Model
        Lengths must be short decimals, so that they are exact.
    consistency : {"inertia", "full"}
    timeout : float
        Seconds for all the eliminations.

    Returns
    -------
    sympy.Boolean
        In symbols ``beta1``, ``beta2``, …, which number the base parameters as in ``model.base_parameters()``. Where
        it holds with strict inequalities, ``steelyard.check`` says feasible.

    Raises
    ------
    InputError
        If the robot is not planar, lengths are not exact, or the elimination takes too long.
    MissingExtraError
        If SymPy or QEPCAD is not installed.

    See Also
    --------
    steelyard.check : decides for numbers, for any robot.

    Examples
    --------
    >>> import shutil, steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q"), (0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> if shutil.which("qepcad"):
    ...     condition = closed_form_conditions(model)
    """
    sympy = import_sympy()
    qepcad_program()
    if not timeout > 0:
        raise InputError(f"timeout must be a positive number of seconds, got {timeout!r}.")
    deadline = time.monotonic() + timeout
    conditions = [polynomial > 0 for polynomial in _conditions(model, consistency)]
    bases = {sympy.Symbol(f"beta{k + 1}", real=True) for k in range(model.base_parameters().count)}
    while True:
        unknown = {symbol for condition in conditions for symbol in condition.free_symbols} - bases
        if not unknown:
            return sympy.And(*conditions)
        # The variable whose conditions name the fewest others is the cheapest, and leaves the shortest conditions.
        chosen = min(unknown, key=lambda symbol: (len(_neighbours(symbol, conditions)), symbol.name))
        about = [condition for condition in conditions if chosen in condition.free_symbols]
        rest = [condition for condition in conditions if chosen not in condition.free_symbols]
        left = deadline - time.monotonic()
        found = eliminate(chosen, about, max(left, 0.01))
        conditions = _without_repetition([*rest, *sympy.And.make_args(found)])


def _neighbours(symbol: Any, conditions: list[Any]) -> set[Any]:
    return {s for condition in conditions if symbol in condition.free_symbols for s in condition.free_symbols}


def _without_repetition(conditions: list[Any]) -> list[Any]:
    """Strike from alternatives what the strict inequalities beside them decide."""
    sympy = import_sympy()
    decided: dict[Any, Any] = {}
    for condition in conditions:
        if isinstance(condition, (sympy.StrictGreaterThan, sympy.StrictLessThan)) and condition.rhs == 0:
            positive = isinstance(condition, sympy.StrictGreaterThan)
            for relation in (sympy.Gt, sympy.Ge, sympy.Lt, sympy.Le, sympy.Eq, sympy.Ne):
                holds = relation(1 if positive else -1, 0)
                decided[relation(condition.lhs, 0)] = holds
    strict = [c for c in conditions if c in decided and decided[c] == sympy.true and _is_strict(c)]
    other = [c.xreplace(decided) for c in conditions if c not in strict]
    return list(sympy.And.make_args(sympy.And(*strict, *other)))


def _is_strict(condition: Any) -> bool:
    sympy = import_sympy()
    return isinstance(condition, (sympy.StrictGreaterThan, sympy.StrictLessThan))


def _conditions(model: ModelLike, consistency: Literal["inertia", "full"]) -> list[Any]:
    """Return polynomials in base and dependent parameters, expanded, with exact coefficients."""
    sympy = import_sympy()
    names = list(model.parameter_names)
    symbols = [sympy.Symbol(name, real=True) for name in names]
    replaced = standard_by_base(model, _short)
    shown = set(np.flatnonzero(np.any(np.asarray(model.base_parameters().K) != 0.0, axis=0)).tolist())
    found = []
    for condition in model.conditions(consistency):
        if condition.link is None:
            continue
        columns = [int(index) for index in condition.indices]
        visible = {place for place, column in enumerate(columns) if column in shown}
        axis = next((places for places in _PLANAR if visible <= set(places)), None)
        if axis is None:
            seen = ", ".join(names[columns[place]] for place in sorted(visible))
            raise InputError(
                "closed forms are for planar robots, whose links show four parameters, but "
                f"{condition.link} of {model.robot.name} shows {seen}; use steelyard.check."
            )
        moment, x, y, mass = (symbols[columns[place]] for place in axis)
        found += [mass, mass * moment - x**2 - y**2]
    found += [
        sympy.nsimplify(condition.polynomial, rational=True)
        for condition in feasibility_polynomials(model, consistency)
        if condition.link is None
    ]
    return [_expanded(polynomial, replaced, model) for polynomial in found]


def _short(value: float) -> Any:
    """Return a float as the decimal fraction that it shows."""
    fraction = Fraction(repr(float(value)))
    return import_sympy().Rational(fraction.numerator, fraction.denominator)


def _expanded(polynomial: Any, replaced: dict[Any, Any], model: ModelLike) -> Any:
    """Expand; terms that should cancel must do so exactly, because the answer depends on whether they are there."""
    sympy = import_sympy()
    result = sympy.expand(polynomial.xreplace(replaced))
    sizes = [abs(term.as_coeff_Mul()[0]) for term in sympy.Add.make_args(result)]
    if min(sizes) < max(sizes) / 10**9:
        raise InputError(
            f"the lengths of {model.robot.name} are not short decimals, so that terms which should cancel do not; "
            "round them, for example to 0.1 mm."
        )
    return result
