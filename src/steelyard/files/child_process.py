"""Running a file of this package as a program of its own, for work on files that may crash or never end."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from steelyard.errors import InputError

__all__ = ["run_child"]


def run_child(
    program: Path,
    request: bytes,
    seconds: float,
    what: str,
    arguments: Sequence[str] = (),
    folder: str | None = None,
) -> tuple[bytes, int | None]:
    """Run a Python file in another process, which finds the packages that this one finds.

    Parameters
    ----------
    program : Path
        The file. It limits its own memory and time, so that it ends also where this process was killed.
    request : bytes
        Its standard input.
    seconds : float
        Time to wait for it, s.
    what : str
        What begins the message where it cannot be started: ``"Meshes are read by another process"``.
    arguments : sequence of str
    folder : str, optional
        Where it runs; the current folder by default.

    Returns
    -------
    bytes, int or None
        What it wrote to standard output, and its exit code; None where the time ran out.

    Raises
    ------
    InputError
        If it cannot be started.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     program = Path(folder, "program.py")
    ...     _ = program.write_text("import sys; print(sys.stdin.read()[::-1], end=''); sys.exit(3)")
    ...     run_child(program, b"drab", 60.0, "Words are turned round by another process")
    (b'bard', 3)
    """
    paths = os.pathsep.join(os.path.abspath(path) for path in sys.path if path)
    environment = {**os.environ, "PYTHONPATH": paths, "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            [sys.executable, "-P", str(program.absolute()), *arguments],
            input=request,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
            cwd=folder,
            timeout=seconds,
        )
    except subprocess.TimeoutExpired as error:
        return error.stdout or b"", None
    except OSError as error:
        raise InputError(f"{what}, which cannot be started ({error}).") from None
    return done.stdout, done.returncode
