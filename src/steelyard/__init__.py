"""Steelyard weighs a robot by moving it.

It turns a robot description and a motion log into the robot's dynamic parameters, physically possible and with a
proof, and hands them back as a URDF, JSON and a report.
"""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

# The list of names is the one that type checkers read. Files are imported when a name of theirs is first used, so that
# importing the package costs next to nothing.
_LIST = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_HOME = {name: home for home, name in re.findall(r"^from (\.[\w.]+) import (\w+) as \2$", _LIST, re.MULTILINE)}

__all__ = sorted([*_HOME, "__version__"])


def __getattr__(name: str) -> Any:
    home = _HOME.get(name)
    if home is None:
        raise AttributeError(f"module 'steelyard' has no attribute {name!r}")
    value = getattr(importlib.import_module(home, __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return list(__all__)
