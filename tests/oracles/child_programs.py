"""Programs that are run by another process, called in this one: most of the time of a small file is their start."""

import io
import runpy
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
