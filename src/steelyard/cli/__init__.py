"""The command line: one file per command, no logic."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .main import main as main

__all__ = import_at_first_use(__name__, __file__)
