"""A Python file that is no part of a package, as a module: generated source, and the scripts of the project."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType


def module_of_file(path: Path) -> ModuleType:
    """Run a file, and return its names."""
    spec = importlib.util.spec_from_file_location(f"file_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module.__name__] = module  # where dataclasses look for it while they are made
    try:
        spec.loader.exec_module(module)
    finally:
        del sys.modules[module.__name__]
    return module
