"""Examples in docstrings that need an extra are skipped where it is not installed."""

from importlib.util import find_spec

import pytest

# What the examples of a file import.
NEEDS = {
    "casadi_function.py": "casadi",
    "jax_function.py": "jax",
    "symbolic_function.py": "sympy",
    "symbols.py": "sympy",
    "sympy_function.py": "sympy",
    "closed_form.py": "sympy",
    "polynomials.py": "sympy",
    "quantifier_elimination.py": "sympy",
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the examples whose extra is missing."""
    for item in items:
        extra = NEEDS.get(item.path.name) if isinstance(item, pytest.DoctestItem) else None
        if extra is not None and find_spec(extra) is None:
            item.add_marker(pytest.mark.skip(reason=f"{extra} is not installed"))
