"""The command line: one file per command, no logic."""

from .main import main as main

__all__ = ["main"]
