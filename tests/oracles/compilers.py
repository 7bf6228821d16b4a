"""Compilers and other programs that tests run where they are installed."""

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

C_FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow", "-Wmissing-prototypes"]


def run(command: Sequence[str | Path], folder: Path) -> str:
    """Run a command that must succeed; its output is in the failure."""
    done = subprocess.run([str(part) for part in command], cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def need(tool: str) -> None:
    if shutil.which(tool) is None:
        pytest.skip(f"{tool} is not installed")
