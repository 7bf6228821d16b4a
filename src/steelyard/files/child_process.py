"""Running a file of this package as a program of its own, for work on files that may crash or never end."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from steelyard.errors import InputError

from .reading import find_password

__all__ = ["ChildLimits", "run_child"]

OUT_OF_TIME = int(getattr(signal, "SIGXCPU", 0))  # where there is no such signal, there is no such limit either


_SECRET = re.compile(r"key|token|secret|passw|credential|auth", re.IGNORECASE)
"""What tells variables of the environment that no child needs: xacro may write any of them into a description."""


class ChildLimits(NamedTuple):
    """Limits of the time and memory that a child process may take.

    Parameters
    ----------
    wait : float
        Time to wait for it, s.
    processor : int
        Processor time, s; it ends the process also where this one was killed.
    memory : int
        Bytes of the address space.
    """

    wait: float
    processor: int
    memory: int


def run_child(
    program: Path,
    request: bytes,
    limits: ChildLimits,
    what: str,
    arguments: Sequence[str] = (),
    folder: str | None = None,
) -> tuple[bytes, int | None]:
    """Run a Python file in another process, which finds the packages that this one finds.

    Parameters
    ----------
    program : Path
        The file. Its function ``main`` gets a file into which it writes its answers as bytes; what is printed is lost.
    request : bytes
        Its standard input.
    what : str
        What begins the message where it cannot be started: ``"Meshes are read by another process"``.
    folder : str, optional
        Where it runs; the current folder by default.

    Returns
    -------
    bytes, int or None
        Its answers, and its exit code; None where one of the times ran out.

    Raises
    ------
    InputError
        If it cannot be started.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     program = Path(folder, "program.py")
    ...     _ = program.write_text("import sys\\ndef main(answers): answers.write(sys.stdin.buffer.read()[::-1])")
    ...     run_child(program, b"drab", ChildLimits(60.0, 60, 2**30), "Words are turned round by another process")
    (b'bard', 0)
    """
    paths = os.pathsep.join(os.path.abspath(path) for path in sys.path if path)
    environment = {name: value for name, value in os.environ.items() if not _is_secret(name, value)}
    environment |= {"PYTHONPATH": paths, "OPENBLAS_NUM_THREADS": "1"}
    launcher = str(Path(__file__).with_name("child_launcher.py").absolute())
    bounds = (str(limits.memory), str(limits.processor))
    try:
        done = subprocess.run(
            [sys.executable, "-P", launcher, *bounds, str(program.absolute()), *arguments],
            input=request,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
            cwd=folder,
            timeout=limits.wait,
        )
    except subprocess.TimeoutExpired as error:
        return error.stdout or b"", None
    except OSError as error:
        raise InputError(f"{what}, which cannot be started ({error}).") from None
    return done.stdout, None if done.returncode == -OUT_OF_TIME else done.returncode


def _is_secret(name: str, value: str) -> bool:
    return bool(_SECRET.search(name) or find_password(value) is not None)
