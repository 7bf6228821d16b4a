"""Change from standard parameters δ to base-dependent ones (β, δ_d) and back (thesis 3.10 to 3.13, 3.32)."""

from __future__ import annotations

from typing import Any

import numpy as np

from steelyard.errors import InputError

from .inequality import LinearMatrixInequality
from .linear_expression import LinearExpression

__all__ = ["base_variable_names", "to_base_dependent", "to_standard"]


def base_variable_names(model: Any, named: str = "number") -> tuple[str, ...]:
    """Names of the base parameters as variables.

    Parameters
    ----------
    model : Model or BaseParameters
    named : {"number", "leading"}
        ``"number"``: beta1, beta2, ...; ``"leading"``: by the standard parameter that leads each combination, as in
        beta_Lzz1.

    Returns
    -------
    tuple of n_b str

    Raises
    ------
    InputError
        If `named` is something else.

    Examples
    --------
    >>> from steelyard.dynamics import Model
    >>> from steelyard.robot import Robot
    >>> model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> base_variable_names(model), base_variable_names(model, "leading")
    (('beta1', 'beta2', 'beta3'), ('beta_Lzz1', 'beta_lx1', 'beta_ly1'))
    """
    base, names = _parts(model)
    if named == "number":
        return tuple(f"beta{i + 1}" for i in range(len(base.independent)))
    if named == "leading":
        return tuple(f"beta_{names[i]}" for i in base.independent)
    raise InputError(f'named must be "number" (beta1) or "leading" (beta_Lzz1), got {named!r}.')


def to_base_dependent(inequality: LinearMatrixInequality, model: Any, named: str = "number") -> LinearMatrixInequality:
    """The inequality in (β, δ_d): each independent parameter is replaced by β - K_d δ_d (thesis 3.13, 3.32).

    Parameters
    ----------
    inequality : LinearMatrixInequality
        In standard parameters, named as the model names them; other variables, such as u, stay.
    model : Model or BaseParameters
    named : {"number", "leading"}
        See `base_variable_names`.

    Returns
    -------
    LinearMatrixInequality
        In β, the dependent parameters, and the other variables, in this order.

    Raises
    ------
    InputError
        If the inequality has variables named as base parameters already.

    Examples
    --------
    >>> from steelyard.dynamics import Model
    >>> from steelyard.robot import Robot
    >>> model = Model(Robot.from_dh([("0", 1.0, 0.0, "q"), ("0", 1.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> model.base_parameters().expressions[1]
    'lx1 + m1 + m2'
    >>> print(to_base_dependent(LinearMatrixInequality.from_matrices("lx1"), model).pretty())
    block 1:
    [ beta2 - m1 - m2 ] ⪰ 0
    """
    base, names = _parts(model)
    betas = base_variable_names(model, named)
    _none_of(betas, inequality, "the inequality is in base-dependent parameters already")
    independent, dependent = list(base.independent), list(base.dependent)
    Kd = np.asarray(base.K, dtype=float)[:, dependent]
    values = {}
    for beta, index, row in zip(betas, independent, Kd, strict=True):
        if names[index] in inequality.names:
            terms = {names[j]: -float(value) for j, value in zip(dependent, row, strict=True)}
            values[names[index]] = LinearExpression({beta: 1.0} | terms)
    order = (*betas, *(names[j] for j in dependent))
    return _ordered(inequality.substitute(values), order, set(names))


def to_standard(inequality: LinearMatrixInequality, model: Any, named: str = "number") -> LinearMatrixInequality:
    """The inequality in standard parameters: β is replaced by δ_b + K_d δ_d (thesis 3.11).

    Parameters
    ----------
    inequality : LinearMatrixInequality
        In base parameters named as `base_variable_names` does, and dependent parameters; other variables stay.
    model : Model or BaseParameters
    named : {"number", "leading"}

    Returns
    -------
    LinearMatrixInequality
        In the model's parameters and the other variables, in this order.

    Raises
    ------
    InputError
        If the inequality has independent standard parameters among its variables already.

    Examples
    --------
    >>> from steelyard.dynamics import Model
    >>> from steelyard.robot import Robot
    >>> model = Model(Robot.from_dh([("0", 1.0, 0.0, "q"), ("0", 1.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> print(to_standard(LinearMatrixInequality.from_matrices("beta2 - m1 - m2"), model).pretty())
    block 1:
    [ lx1 ] ⪰ 0
    """
    base, names = _parts(model)
    betas = base_variable_names(model, named)
    _none_of([names[i] for i in base.independent], inequality, "the inequality is in standard parameters already")
    K = np.asarray(base.K, dtype=float)
    values = {
        beta: LinearExpression({name: float(value) for name, value in zip(names, row, strict=True)})
        for beta, row in zip(betas, K, strict=True)
        if beta in inequality.names
    }
    return _ordered(inequality.substitute(values), names, set(betas))


def _parts(model: Any) -> tuple[Any, tuple[str, ...]]:
    base = model.base_parameters() if hasattr(model, "base_parameters") else model
    owner = model if hasattr(model, "parameter_names") else base
    if not hasattr(base, "K") or not hasattr(owner, "parameter_names"):
        raise InputError(f"a Model or its base_parameters() was expected, got {model!r}.")
    return base, tuple(owner.parameter_names)


def _none_of(names: Any, inequality: LinearMatrixInequality, what: str) -> None:
    found = [name for name in names if name in inequality.names]
    if found:
        raise InputError(f"{what}: it has the variable {found[0]!r}; rename that variable, or leave the change out.")


def _ordered(inequality: LinearMatrixInequality, order: tuple[str, ...], replaced: set[str]) -> LinearMatrixInequality:
    others = (name for name in inequality.names if name not in order and name not in replaced)
    return inequality.with_names((*order, *others))
