"""Packages that formats need and that are installed only where they are wanted."""

from __future__ import annotations

import importlib
from typing import Any

from steelyard.errors import missing_extra

__all__ = ["require_package"]


def require_package(module: str, files: str, extra: str) -> Any:
    """Import a module of a package.

    Parameters
    ----------
    module : str
    files : str
        What it reads, for the message.
    extra : str
        The extra that brings the package.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise missing_extra(f"{files} are read with the module {module}, which is not installed", extra) from None
