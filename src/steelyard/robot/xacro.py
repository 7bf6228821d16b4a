"""Expanding a xacro, without ROS, to the URDF that it describes."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from steelyard.errors import InputError, missing_extra
from steelyard.files.child_process import ChildLimits, run_child

__all__ = ["expand_xacro"]

# The largest xacro that was tried takes 0.8 s and 80 MB.
LIMITS = ChildLimits(wait=60.0, processor=30, memory=2**30)


def expand_xacro(path: Path, arguments: Mapping[str, str] | None = None) -> bytes:
    """Return the URDF that a xacro describes.

    The package xacro does it, in another process with limits of time and memory. Packages after ``$(find ...)`` are
    found as those of meshes are, see `find_package`; no file outside of the package of the xacro, of packages that it
    names and of ``ROS_PACKAGE_PATH`` is read.

    Parameters
    ----------
    path : Path
    arguments : mapping, optional
        Values of ``<xacro:arg>``.

    Raises
    ------
    InputError
        If it cannot be expanded.
    MissingExtraError
        If xacro is not installed (extra ``xacro``).
    """
    given = tuple(sorted((str(key), str(value)) for key, value in (arguments or {}).items()))
    return _expanded(os.path.abspath(path), str(path), given, _state(path))


def _state(path: Path) -> tuple[int, str]:
    """What must be the same for an expansion to be used again."""
    try:
        changed = path.stat().st_mtime_ns
    except (OSError, ValueError):
        changed = 0
    return changed, os.environ.get("ROS_PACKAGE_PATH", "")


@lru_cache(maxsize=16)
def _expanded(path: str, shown: str, arguments: tuple[tuple[str, str], ...], _: tuple[int, str]) -> bytes:
    request = json.dumps({"path": path, "arguments": dict(arguments)}).encode()
    program = Path(__file__).with_name("xacro_child.py")
    written, code = run_child(program, request, LIMITS, f"{shown}: xacro is expanded by another process")
    if code is None:
        answer = {"problem": f"it takes longer than {LIMITS.wait:.0f} s"}
    else:
        answer = json.loads(written) if written else {"problem": "it takes too much time or memory"}
    if "missing" in answer:
        raise missing_extra(f"{shown}: xacro needs the package {answer['missing']}, which is not installed", "xacro")
    if "problem" in answer:
        raise InputError(f"{shown}: the xacro cannot be expanded ({answer['problem']}); mend it or give its arguments.")
    return str(answer["text"]).encode()
