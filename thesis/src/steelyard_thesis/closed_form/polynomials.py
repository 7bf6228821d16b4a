"""The polynomials that are positive where parameters are physically possible (thesis 3.1.1 and 3.1.2)."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np

from steelyard.codegen.sympy import exact_number, import_sympy, latex_name
from steelyard.errors import InputError
from steelyard.feasibility.constraints import ModelLike

__all__ = ["PolynomialCondition", "feasibility_polynomials", "standard_by_base"]

_SYMBOLS = ("Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m")


@dataclass(frozen=True)
class PolynomialCondition:
    """A polynomial that is positive where the parameters are physically possible.

    Attributes
    ----------
    name : str
        ``"m1"``, ``"P12"`` (which is P₁ of link 2), and so on; for terms what must hold.
    link, joint : str or None
        The link whose body, or the joint whose term, it is about.
    polynomial : sympy.Expr
        In symbols with the names of the model's parameters, all real.
    """

    name: str
    link: str | None
    joint: str | None
    polynomial: Any

    def _repr_latex_(self) -> str:
        names = {symbol: latex_name(symbol.name) for symbol in self.polynomial.free_symbols}
        return f"$\\displaystyle {import_sympy().latex(self.polynomial, symbol_names=names)} > 0$"


def feasibility_polynomials(
    model: ModelLike, consistency: Literal["inertia", "full"] = "inertia", base_dependent: bool = False
) -> tuple[PolynomialCondition, ...]:
    """Return the polynomials that are all positive exactly where the parameters are physically possible.

    ``"inertia"``: for each link its mass m and P₁, P₂, P₃, the leading minors of the inertia about the centre of mass
    times m² (thesis 3.1 to 3.5). In terms of what the printed (3.5) means, P₃ = m² det(L - S(l)ᵀ S(l) / m).
    ``"full"``: for each link J₁ to J₄, the leading minors of the pseudo-inertia [[tr(L)/2 - L, l], [lᵀ, m]] (Wensing et
    al. 2018), which hold just where a positive mass density exists. Either is followed by the conditions of the terms:
    friction and rotor inertia positive (thesis 3.6).

    Parameters
    ----------
    model : Model
    consistency : {"inertia", "full"}
    base_dependent : bool
        In base parameters ``beta1``, ``beta2``, … and dependent parameters instead of the standard ones (thesis 3.13 to
        3.15). The polynomials are then not expanded; ``sympy.expand`` does that.

    Returns
    -------
    tuple of PolynomialCondition
        Strict: values of exactly zero (no friction) lie on the boundary of the set.

    Raises
    ------
    InputError
        If `consistency` is something else.
    MissingExtraError
        If SymPy is not installed.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")]))
    >>> conditions = feasibility_polynomials(model)
    >>> [condition.name for condition in conditions]
    ['m1', 'P11', 'P21', 'P31']
    >>> conditions[1].polynomial
    Lxx1*m1**2 - ly1**2*m1 - lz1**2*m1
    """
    if consistency not in ("inertia", "full"):
        close = difflib.get_close_matches(str(consistency), ("full", "inertia"), n=1, cutoff=0.0)[0]
        raise InputError(f'consistency must be "full" or "inertia", got {consistency!r}; did you mean "{close}"?')
    sympy = import_sympy()
    symbols = [sympy.Symbol(name, real=True) for name in model.parameter_names]
    replaced = standard_by_base(model, exact_number) if base_dependent else {}
    generic, minors = _minors(consistency)
    conditions: list[PolynomialCondition] = []
    number = 0
    for condition in model.conditions(consistency):
        own = [symbols[index] for index in condition.indices]
        if condition.link is not None:
            number += 1
            named = [
                (f"{name}{number}", minor.xreplace(dict(zip(generic, own, strict=True)))) for name, minor in minors
            ]
        else:
            named = _term_minors(condition, own)
        conditions += [
            PolynomialCondition(name, condition.link, condition.joint, polynomial.xreplace(replaced))
            for name, polynomial in named
        ]
    return tuple(conditions)


@cache
def _minors(consistency: str) -> tuple[list[Any], list[tuple[str, Any]]]:
    """Return the ten symbols of a link, and its polynomials in them with their names."""
    sympy = import_sympy()
    symbols = [sympy.Symbol(name, real=True) for name in _SYMBOLS]
    xx, xy, xz, yy, yz, zz, x, y, z, m = symbols
    tensor = sympy.Matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    first = sympy.Matrix([x, y, z])
    if consistency == "full":
        pseudo = sympy.diag(tensor.trace() / 2 * sympy.eye(3) - tensor, m).as_mutable()
        pseudo[:3, 3], pseudo[3, :3] = first, first.T
        return symbols, [(f"J{k}", sympy.expand(pseudo[:k, :k].det(method="berkowitz"))) for k in range(1, 5)]
    # S(l)ᵀ S(l) = |l|² 1 - l lᵀ; m times the tensor keeps the minors free of fractions until they divide exactly.
    about_com = m * tensor - (first.dot(first) * sympy.eye(3) - first * first.T)
    found = [("m", m)]
    for k in range(1, 4):
        minor = sympy.expand(about_com[:k, :k].det(method="berkowitz"))
        found.append((f"P{k}", sympy.expand(minor * m ** (2 - k))))
    return symbols, found


def _term_minors(condition: Any, symbols: list[Any]) -> list[tuple[str, Any]]:
    """Return the leading minors of a term's condition."""
    sympy = import_sympy()

    def exact(matrix: Any) -> Any:
        return sympy.Matrix(condition.size, condition.size, [exact_number(float(x)) for x in np.ravel(matrix)])

    total = exact(condition.constant)
    for symbol, matrix in zip(symbols, condition.coefficients, strict=True):
        total += symbol * exact(matrix)
    if condition.size == 1:
        return [(condition.name, total[0])]
    return [
        (f"{condition.name}, minor {k}", sympy.expand(total[:k, :k].det(method="berkowitz")))
        for k in range(1, condition.size + 1)
    ]


def standard_by_base(model: ModelLike, number: Callable[[float], Any]) -> dict[Any, Any]:
    """Return each independent parameter in terms of its base parameter and dependent ones (thesis 3.13).

    Parameters
    ----------
    model : Model
    number : callable
        From coefficients to SymPy numbers.

    Returns
    -------
    dict
        From symbols to expressions.
    """
    sympy = import_sympy()
    symbols = [sympy.Symbol(name, real=True) for name in model.parameter_names]
    base = model.base_parameters()
    result = {}
    for row, (index, combination) in enumerate(zip(base.independent, np.asarray(base.K), strict=True)):
        others = [number(float(combination[k])) * symbols[k] for k in np.flatnonzero(combination) if k != index]
        result[symbols[index]] = sympy.Symbol(f"beta{row + 1}", real=True) - sympy.Add(*others)
    return result
