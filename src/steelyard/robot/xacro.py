"""Expanding a xacro, without ROS, to the URDF that it describes."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from steelyard.errors import InputError, missing_extra
from steelyard.files.child_process import ChildLimits, run_child

from .references import search_folders

__all__ = ["expand_xacro"]

# The largest xacro that was tried takes 0.8 s and 80 MB.
LIMITS = ChildLimits(wait=30.0, processor=10, memory=2**30)
MOST_KEPT = 16


def expand_xacro(path: Path, arguments: Mapping[str, str] | None = None) -> bytes:
    """Return the URDF that a xacro describes.

    The package xacro does it, in another process with limits of time and memory. Packages after ``$(find ...)`` are
    found as those of meshes are, see `find_package`; no file outside of the package of the xacro, of packages that it
    names and of ``ROS_PACKAGE_PATH`` is read.

    Parameters
    ----------
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
    key = (os.path.abspath(path), given, tuple(map(str, search_folders())))
    known = _EXPANDED.pop(key, None)
    if known is None or known.times != _times(known.times):
        known = _expanded(path, dict(given))
    _EXPANDED[key] = known  # at the end, since the first ones are forgotten first
    for oldest in list(_EXPANDED)[:-MOST_KEPT]:
        _EXPANDED.pop(oldest, None)  # unless another thread did
    return known.content


class _Expansion(NamedTuple):
    """A URDF, and when the files were changed that it was made of."""

    content: bytes
    times: dict[str, int]


_EXPANDED: dict[tuple[object, ...], _Expansion] = {}
"""By path, arguments and environment; one identification needs the same expansion several times."""


def _times(files: Iterable[str]) -> dict[str, int]:
    found = {}
    for file in files:
        with contextlib.suppress(OSError):
            found[file] = os.stat(file).st_mtime_ns
    return found


def _expanded(path: Path, arguments: Mapping[str, str]) -> _Expansion:
    request = json.dumps({"path": os.path.abspath(path), "arguments": arguments}).encode()
    program = Path(__file__).with_name("xacro_child.py")
    written, code = run_child(program, request, LIMITS, f"{path}: xacro is expanded by another process")
    if code is None:
        answer = {
            "problem": f"it takes longer than {LIMITS.processor} s of the processor or {LIMITS.wait:.0f} s in all"
        }
    else:
        answer = json.loads(written) if written else {"problem": "it takes too much time or memory"}
    if "missing" in answer:
        raise missing_extra(f"{path}: xacro needs the package {answer['missing']}, which is not installed", "xacro")
    if "problem" in answer:
        raise InputError(f"{path}: the xacro cannot be expanded ({answer['problem']}); mend it or give its arguments.")
    return _Expansion(str(answer["text"]).encode(), _times(answer["files"]))
