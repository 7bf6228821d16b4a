"""Bounds on linear combinations of parameters, and confidence intervals of estimates."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError
from steelyard.files import is_real, read_number, suggestion
from steelyard.lmi import AffineBlock, LinearExpression, as_expression
from steelyard.regression import Estimate

from .constraint import Equality, ModelLike, call_text, scalar_block
from .toml_section import read_quantity

__all__ = ["ConfidenceInterval", "LinearBound", "confidence_intervals"]

Vector = npt.NDArray[np.float64]

_UNITS = {"L": "kg m²", "l": "kg m", "m": "kg"}


@dataclass(frozen=True)
class LinearBound:
    """Bounds a linear combination of parameters.

    Parameters
    ----------
    expression : str, mapping from name to coefficient, or LinearExpression
        Such as ``"Lyy1 + Iam1"``, in the model's parameters; ``beta1``, ``beta2``, ... are its base parameters. The
        expression of a base parameter, as in `BaseParameters.expressions`, is taken as that base parameter, with all
        the digits of its coefficients.
    minimum, maximum : float, optional
        Bounds; equal ones give an exact value.
    equal : float, optional
        The exact value, instead of bounds.
    unit : str, optional
        Unit of the values; it follows from the names if all parameters are masses, first moments or moments of inertia.

    Raises
    ------
    InputError
        If the expression is not affine, no bound is given, or the bounds contradict each other.

    Examples
    --------
    >>> LinearBound("m2 + m3 - 1", minimum=2.0)
    LinearBound('m2 + m3 - 1', minimum=2.0)
    """

    expression: Any
    minimum: float | None = None
    maximum: float | None = None
    equal: float | None = None
    unit: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "expression", _combination(self.expression, "LinearBound"))
        where = f"LinearBound of {self.expression}"
        for key in ("minimum", "maximum", "equal"):
            if getattr(self, key) is not None:
                value = read_number(getattr(self, key), f"{key} of {where}", infinite=key != "equal")
                object.__setattr__(self, key, None if np.isinf(value) and _open(key, value) else value)
        if self.unit is not None and not isinstance(self.unit, str):
            raise InputError(f"unit of {where} must be a text, got {self.unit!r}.")
        if self.minimum is None and self.maximum is None and self.equal is None:
            raise InputError(f"{where} needs a finite bound; give minimum, maximum or equal.")
        if self.equal is not None and (self.minimum is not None or self.maximum is not None):
            raise InputError(f"{where} takes either equal or bounds (minimum, maximum), not both; remove one.")
        low = -np.inf if self.minimum is None else self.minimum
        high = np.inf if self.maximum is None else self.maximum
        if low > high or np.inf in (low, -high):
            raise InputError(f"{where} has minimum {low:g} above its maximum {high:g}; swap or correct them.")

    def __repr__(self) -> str:
        return call_text(self, str(self.expression))

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """Return the bounds as 1 x 1 blocks."""
        row, constant = _resolved(self.expression, model, "LinearBound")
        if self._exact is not None:
            return ()
        unit = _unit(row, model) if self.unit is None else self.unit
        return _interval(str(self.expression), unit, row, constant, self.minimum, self.maximum)

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """Return the exact value as an equation; none where it is bounded."""
        row, constant = _resolved(self.expression, model, "LinearBound")
        if self._exact is None:
            return ()
        return (_equation(f"{self.expression} = {self._exact:g}", row, self._exact - constant),)

    @property
    def _exact(self) -> float | None:
        return self.minimum if self.minimum is not None and self.minimum == self.maximum else self.equal


@dataclass(frozen=True)
class ConfidenceInterval:
    """Keeps a linear combination of parameters within some standard deviations of an estimated value.

    Parameters
    ----------
    expression : str, mapping from name to coefficient, or LinearExpression
        As that of `LinearBound`.
    value : float
        The estimate.
    standard_deviation : float
        Standard deviation of the estimate; with 0 the value is exact.
    deviations : float
        Number of standard deviations by which the true value may differ.
    base_expressions : tuple of str
        The base parameters that beta1, beta2, ... stand for; by default those of the model.

    Raises
    ------
    InputError
        If the expression is not affine or a number is not one.

    See Also
    --------
    confidence_intervals : Those of an `Estimate`.

    Examples
    --------
    >>> ConfidenceInterval("lx2 + m3", value=0.31, standard_deviation=0.004)
    ConfidenceInterval('lx2 + m3', value=0.31, standard_deviation=0.004, deviations=3.0)
    """

    expression: Any
    value: float
    standard_deviation: float
    deviations: float = 3.0
    base_expressions: tuple[str, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "expression", _combination(self.expression, "ConfidenceInterval"))
        where = f"ConfidenceInterval of {self.expression}"
        object.__setattr__(self, "value", read_quantity(self.value, f"value of {where}"))
        deviation = read_quantity(self.standard_deviation, f"standard_deviation of {where}", nonnegative=True)
        object.__setattr__(self, "standard_deviation", deviation)
        factor = read_quantity(self.deviations, f"deviations of {where}", positive=True)
        object.__setattr__(self, "deviations", factor)
        object.__setattr__(self, "base_expressions", tuple(self.base_expressions))

    def __repr__(self) -> str:
        numbers = ("value", "standard_deviation", "deviations")
        return (
            f"ConfidenceInterval({str(self.expression)!r}, {', '.join(f'{k}={getattr(self, k)!r}' for k in numbers)})"
        )

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """Return both ends of the interval as 1 x 1 blocks."""
        row, constant = self._resolved(model)
        if self.standard_deviation == 0:
            return ()
        reach = self.deviations * self.standard_deviation
        label = f"confidence interval of {self._label}"
        return _interval(label, _unit(row, model), row, constant, self.value - reach, self.value + reach)

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """The value as an equation if it is exact."""
        row, constant = self._resolved(model)
        if self.standard_deviation != 0:
            return ()
        return (_equation(f"estimate of {self._label} = {self.value:g}", row, self.value - constant),)

    def _resolved(self, model: ModelLike) -> tuple[Vector, float]:
        own = tuple(getattr(model.base_parameters(), "expressions", self.base_expressions))
        if self.base_expressions and own != self.base_expressions:
            raise InputError(
                f"the confidence interval of {self.expression} is of an estimate of another robot or of other terms; "
                "use an estimate of the same robot."
            )
        return _resolved(self.expression, model, "ConfidenceInterval")

    @property
    def _label(self) -> str:
        found = re.fullmatch(r"beta(\d+)", str(self.expression))
        if found and 1 <= int(found[1]) <= len(self.base_expressions):
            return self.base_expressions[int(found[1]) - 1]
        return str(self.expression)


def confidence_intervals(
    estimate: Estimate,
    deviations: float = 3.0,
    combinations: Sequence[Any] | None = None,
    covariance: npt.ArrayLike | None = None,
) -> tuple[ConfidenceInterval, ...]:
    """The confidence intervals of an estimate as constraints.

    Parameters
    ----------
    estimate : Estimate
        Preferably one of other data than those that the constraints will be used with.
    deviations : float
        Number of standard deviations by which true values may differ; 3 hold 99.7 % of a normal distribution.
    combinations : sequence of str, mapping or LinearExpression, optional
        Combinations of beta1, beta2, ..., of names of base parameters (those of their leading parameters), or
        expressions of base parameters. By default every base parameter.
    covariance : (n_b, n_b), optional
        Covariance of the base parameters. Without it a combination gets Σ |cᵢ| σᵢ, the largest standard deviation that
        the standard errors of its parts allow.

    Returns
    -------
    tuple of ConfidenceInterval
        Combinations that the data does not determine are left out.

    Raises
    ------
    InputError
        If a combination is not one of base parameters, or the covariance does not fit.

    Examples
    --------
    >>> estimate = Estimate(
    ...     method="ordinary least squares", base_names=("Lzz1", "lx1"), base_expressions=("Lzz1 + m2", "lx1 - m2"),
    ...     base=np.array([2.0, 0.5]), standard_error=np.array([0.1, np.inf]), joint_names=("joint1",),
    ...     relative_error=0.05, row_count=100, condition_number=1.0,
    ... )
    >>> confidence_intervals(estimate)
    (ConfidenceInterval('beta1', value=2.0, standard_deviation=0.1, deviations=3.0),)
    """
    expressions = tuple(estimate.base_expressions)
    betas = [f"beta{i + 1}" for i in range(len(expressions))]
    named = dict(zip(betas, betas, strict=True)) | dict(zip(estimate.base_names, betas, strict=True))
    written = {_parsed(text): beta for text, beta in zip(expressions, betas, strict=True)}
    errors = np.full(len(betas), np.inf) if estimate.filtered_torque else np.asarray(estimate.standard_error)
    matrix = None if covariance is None else _covariance(covariance, len(betas))
    found = []
    for given in betas if combinations is None else combinations:
        expression = _combination(given, "combination")
        if expression in written:
            expression = LinearExpression({written[expression]: 1.0})
        for name in expression.names:
            if name not in named:
                raise InputError(
                    f"combination {str(expression)!r} names {name!r}, which is no base parameter of the estimate; "
                    f"{suggestion(name, named)}"
                )
        expression = expression.substitute({name: LinearExpression({named[name]: 1.0}) for name in expression.names})
        row = np.array([expression.coefficient(beta) for beta in betas])
        used = row != 0
        if matrix is None:
            deviation = float(np.abs(row[used]) @ errors[used])
        else:
            deviation = float(np.sqrt(max(row @ matrix @ row, 0.0)))
        if np.isfinite(deviation):
            value = float(row @ estimate.base) + expression.constant
            found.append(ConfidenceInterval(expression, value, deviation, deviations, expressions))
    return tuple(found)


def _covariance(covariance: npt.ArrayLike, count: int) -> npt.NDArray[np.float64]:
    matrix = np.asarray(covariance, dtype=float)
    if matrix.shape != (count, count) or not np.all(np.isfinite(matrix)):
        raise InputError(f"covariance must be finite, of shape ({count}, {count}), got the shape {matrix.shape}.")
    return matrix


def _open(key: str, value: float) -> bool:
    """Return whether an infinite bound leaves its side open, so that it can be left out."""
    return (key == "minimum") == (value < 0)


def _combination(expression: Any, where: str) -> LinearExpression:
    if is_real(expression):
        raise InputError(f"{where} must have a combination of parameters such as 'Lyy1 + Iam1', got {expression!r}.")
    found = as_expression(expression, where=f"expression of {where}")
    if not found.names:
        raise InputError(f"expression of {where} depends on no parameter, got {str(found)!r}; name at least one.")
    return found


@lru_cache(maxsize=4096)
def _parsed(text: str) -> LinearExpression:
    return as_expression(text)


def _resolved(expression: LinearExpression, model: ModelLike, where: str) -> tuple[Vector, float]:
    """The expression as a row over the model's parameters and a constant."""
    names = list(model.parameter_names)
    base = model.base_parameters()
    K = np.asarray(base.K, dtype=float)
    for i, text in enumerate(getattr(base, "expressions", ())):
        if _parsed(text) == expression:
            return K[i].copy(), 0.0
    row = np.zeros(len(names))
    for name, coefficient in expression.terms.items():
        number = re.fullmatch(r"beta([1-9]\d*)", name)
        if name in names:
            row[names.index(name)] += coefficient
        elif number and int(number[1]) <= len(K):
            row += coefficient * K[int(number[1]) - 1]
        else:
            raise InputError(
                f"{where} of {expression} names {name!r}, which is no parameter of the model; "
                f"{suggestion(name, names)} (base parameters: beta1 to beta{len(K)})."
            )
    if not np.any(row):
        raise InputError(f"{where} of {expression} does not depend on any parameter; correct the expression.")
    return row, expression.constant


def _unit(row: Vector, model: ModelLike) -> str:
    """The unit of a combination of inertial parameters of one kind; empty for others."""
    names = [list(model.parameter_names)[i] for i in np.flatnonzero(row)]
    kinds = {re.fullmatch(r"(?:(L)[xyz]{2}|(l)[xyz]|(m))\d+", name) for name in names}
    letters = {next(filter(None, kind.groups())) for kind in kinds if kind}
    return _UNITS[letters.pop()] if None not in kinds and len(letters) == 1 else ""


def _interval(
    label: str, unit: str, row: Vector, constant: float, low: float | None, high: float | None
) -> tuple[AffineBlock, ...]:
    places = np.arange(len(row))
    shown = f" {unit}" if unit else ""
    found = []
    if low is not None:
        found.append(scalar_block(f"{label} >= {low:g}{shown}", unit, places, row, constant - low))
    if high is not None:
        found.append(scalar_block(f"{label} <= {high:g}{shown}", unit, places, -row, high - constant))
    return tuple(found)


def _equation(name: str, row: Vector, value: float) -> Equality:
    used = np.flatnonzero(row)
    return Equality(name, used, row[used], value)
