"""Finding and reading the mesh files that a robot description names."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterable, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError, is_installed, missing_extra
from steelyard.files import require_file
from steelyard.files.child_process import ChildLimits, run_child
from steelyard.robot.references import find_reference as find_mesh

from .shapes import coal_or_none

__all__ = ["MeshArrays", "find_mesh", "read_mesh", "read_meshes"]

Array = NDArray[np.float64]
MeshArrays = tuple[Array, NDArray[np.intp]]

LARGEST = 500_000_000  # bytes of a file
TIME, TIME_PER_BYTE = 20.0, 2e-6  # s that reading may take, also where others have the processors
# s of the processor besides: the libraries take 0.8 s to load, and a file of 60 MB takes 6 s. Damaged files make them
# go round in a circle.
PROCESSOR, PROCESSOR_PER_FILE = 4.0, 1.0
# Limit of the address space, bytes: a constant, and a multiple of the largest file. coal needs 13 bytes for each byte
# of a file of 60 MB.
MEMORY, MEMORY_PER_BYTE = 2**30, 50
REMEDY = "export it again, as STL or OBJ"


def read_mesh(path: Path) -> MeshArrays:
    """Return vertices (k, 3), in the unit of the file, and triangles (t, 3) of a mesh file.

    Raises
    ------
    InputError
        If the file is not a mesh.
    MissingExtraError
        If neither coal nor trimesh is installed.
    """
    found = read_meshes([path])[path]
    if isinstance(found, InputError):
        raise found
    return found


def read_meshes(paths: Iterable[Path], largest: int | None = None) -> dict[Path, MeshArrays | InputError]:
    """Read mesh files: STL, OBJ, COLLADA, PLY and other formats that coal or trimesh can read.

    Another process with limits of memory and time reads them, because damaged files may crash the libraries, exhaust
    the memory, or never end: 27 % of damaged PLY files ended the process that read them.

    Parameters
    ----------
    paths : iterable of path
    largest : int, optional
        Bytes above which a file is not read; by default 500 million.

    Returns
    -------
    dict
        For each path vertices (k, 3) and triangles (t, 3), or the reason why it cannot be read.

    Raises
    ------
    MissingExtraError
        If neither package is installed.
    """
    largest = LARGEST if largest is None else largest
    found: dict[Path, MeshArrays | InputError] = {}
    waiting: list[Path] = []
    for path in dict.fromkeys(paths):
        try:
            require_file(path, "give the path of a mesh")
            size = path.stat().st_size
            if not size:  # also what a system makes up, such as /proc/kmsg, which has no end
                raise InputError(f"{path}: is empty; {REMEDY}.")
            if size > largest:
                raise InputError(f"{path}: has more than {largest / 1e6:.0f} MB; simplify the mesh.")
        except InputError as error:
            found[path] = error
        else:
            waiting.append(path)
    libraries = _libraries() if waiting else []
    while waiting:
        answers, ending = _asked(waiting, libraries)
        for path in waiting:
            problem = _taken(path, answers, found)
            if problem:  # the process ended while it read this file
                found[path] = InputError(f"{path}: the mesh cannot be read ({ending}); {REMEDY}")
                break
        waiting = [path for path in waiting if path not in found]
    return found


def _libraries() -> list[str]:
    names = [*(["coal"] if coal_or_none() is not None else []), *(["trimesh"] if is_installed("trimesh") else [])]
    if not names:
        raise missing_extra("Meshes need the package coal or trimesh, and neither is installed", "collision")
    return names


def _asked(paths: Sequence[Path], libraries: Sequence[str]) -> tuple[BytesIO, str]:
    """Read meshes in another process; return its answers, and how it ended."""
    sizes = [path.stat().st_size for path in paths]
    seconds = TIME + TIME_PER_BYTE * sum(sizes)
    processor = int(PROCESSOR + PROCESSOR_PER_FILE * (len(sizes) - 1) + TIME_PER_BYTE * sum(sizes))
    limits = ChildLimits(seconds, processor, MEMORY + MEMORY_PER_BYTE * max(sizes))
    request = json.dumps([os.path.abspath(path) for path in paths]).encode()
    program = Path(__file__).with_name("mesh_child.py")
    answers, code = run_child(program, request, limits, "Meshes are read by another process", libraries)
    if code is None:
        longest = f"{processor} s of the processor or {seconds:.0f} s in all"
        return BytesIO(answers), f"reading it takes longer than {longest}"
    return BytesIO(answers), f"the library that reads it crashed, {_ending(code)}"


def _ending(code: int) -> str:
    try:
        return f"signal {signal.Signals(-code).name}"
    except ValueError:
        return f"exit {code}"


def _taken(path: Path, answers: BytesIO, found: dict[Path, MeshArrays | InputError]) -> bool:
    """Read the next answer into `found`; return whether there was none."""
    line = answers.readline()
    if not line.endswith(b"\n"):
        return True
    said = json.loads(line)
    if "problem" in said:
        found[path] = InputError(f"{path}: the mesh cannot be read ({said['problem']}); {REMEDY}")
        return False
    corners, sides = 3 * said["vertices"], 3 * said["triangles"]
    numbers, indices = answers.read(8 * corners), answers.read(8 * sides)
    if len(numbers) < 8 * corners or len(indices) < 8 * sides:
        return True
    vertices = np.frombuffer(numbers, dtype=np.float64).reshape(-1, 3)
    triangles = np.frombuffer(indices, dtype=np.int64).reshape(-1, 3).astype(np.intp)
    if not np.isfinite(vertices).all():
        found[path] = InputError(f"{path}: the mesh has vertices that are not finite; {REMEDY}")
    elif triangles.size and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        found[path] = InputError(f"{path}: triangles of the mesh name vertices that do not exist; {REMEDY}")
    else:
        found[path] = vertices, triangles
    return False
