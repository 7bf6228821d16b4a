"""Programs that are run by another process, called in this one: most of the time of a small file is their start."""

import contextlib
import io
import os
import runpy
import subprocess
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest


def run_here(
    program: Path,
    request: bytes,
    limits: Any,
    what: str,
    arguments: Sequence[str] = (),
    folder: str | None = None,
) -> tuple[bytes, int]:
    """Do what `run_child` does, but for the limits, and a process that may crash."""
    answers = io.BytesIO()
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # which nobody sees who runs another process
        if folder is not None:
            patch.chdir(folder)
        patch.setattr(sys, "argv", [str(program), *arguments])
        patch.setattr(sys, "stdin", io.StringIO(request.decode()))
        runpy.run_path(str(program))["main"](answers)
    return answers.getvalue(), 0


def printed_twice(program: str) -> tuple[str, str]:
    """Return what a program prints in this process, and in one that compiles anew and orders sets otherwise."""
    here = io.StringIO()
    with contextlib.redirect_stdout(here):
        exec(program, {})
    seed = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    there = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
        env={**os.environ, "PYTHONHASHSEED": seed, "STEELYARD_CACHE": "off"},
    )
    return here.getvalue(), there.stdout
