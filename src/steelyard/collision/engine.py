"""The optional package coal, which computes distances between bodies and reads meshes."""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any

from steelyard.errors import MissingExtraError

__all__ = ["coal_or_none", "require_coal"]


@cache
def coal_or_none() -> Any:
    """Return the module coal, or None where it is absent."""
    try:
        return importlib.import_module("coal")
    except ImportError:
        return None


def require_coal() -> Any:
    """Return the module coal.

    Raises
    ------
    MissingExtraError
        When it is not installed.
    """
    coal = coal_or_none()
    if coal is None:
        raise MissingExtraError(
            "Distances between bodies need the package coal, which is not installed; "
            "pip install 'steelyard[collision]'."
        )
    return coal
