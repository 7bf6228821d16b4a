"""Compares the numbers of a saved estimate with those that its certificate proves, with the standard library alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["certified_numbers_differ"]


def certified_numbers_differ(estimate: Mapping[str, Any]) -> str:
    """Say in what an estimate differs from its certificate; empty where they agree, or where it claims nothing.

    The certificate holds exact numbers and the estimate holds doubles, so that each number of the estimate must be the
    double that is nearest to the exact one. That the exact numbers prove anything is another question, which
    `verify_certificate` answers. The estimate is plain data, as ``estimate.json`` holds it.

    Examples
    --------
    >>> names = {"consistency": "full", "parameter_names": ["m1"], "base_expressions": ["m1"]}
    >>> certificate = {
    ...     "verdict": "feasible", "statement": names | {"base": ["1/3"]}, "proof": {"parameters": ["1/3"]}
    ... }
    >>> estimate = names | {"base": [1 / 3], "parameters": [1 / 3], "certificate": certificate}
    >>> certified_numbers_differ(estimate)
    ''
    >>> certified_numbers_differ(estimate | {"parameters": [-5.0]})
    'm1 is -5.0, while its certificate proves 0.3333333333333333'
    """
    certificate = estimate.get("certificate")
    if certificate is None:
        claim = estimate.get("consistency")
        return f"it says that its parameters are feasible ({claim!r}), but holds no certificate" if claim else ""
    try:
        statement, proof = certificate["statement"], certificate["proof"]
        if certificate["verdict"] != "feasible":
            return f"its certificate proves it to be {certificate['verdict']}"
        for name in ("consistency", "parameter_names", "base_expressions"):
            given = estimate[name]
            if statement[name] != (list(given) if isinstance(given, tuple) else given):
                return f"it differs from its certificate in the {name.replace('_', ' ')}"
        if estimate["parameters"] is None:
            return "it has no parameters, while its certificate speaks of some"
        return _difference(estimate["parameters"], proof["parameters"], estimate["parameter_names"]) or _difference(
            estimate["base"], statement["base"], estimate["base_expressions"]
        )
    except (KeyError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        return f"its certificate is damaged ({'lacks ' if isinstance(error, KeyError) else ''}{error})"


def _difference(given: Sequence[float], exact: Sequence[str], names: Sequence[str]) -> str:
    if not len(given) == len(exact) == len(names):
        return f"it has {len(given)} numbers where its certificate has {len(exact)}"
    for value, text, name in zip(given, exact, names, strict=True):
        proved = _nearest_double(text)
        if value != proved:
            return f"{name} is {value}, while its certificate proves {proved}"
    return ""


def _nearest_double(text: str) -> float:
    # Python rounds correctly both when it reads a decimal and when it divides integers.
    numerator, slash, denominator = text.partition("/")
    return int(numerator) / int(denominator) if slash else float(numerator)
