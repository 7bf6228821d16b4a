"""A program that reads meshes for another process, because damaged files may crash the libraries or exhaust the memory.

It is started with the names of the libraries as arguments, and reads a list of paths as JSON from standard input. For
each path it writes a line of JSON, followed by the bytes of vertices and triangles where the file
could be read.
"""

from __future__ import annotations

import json
import sys
from typing import Any, BinaryIO

import numpy as np

__all__ = ["answer", "main", "reason"]

# Beginnings of the lines of a message of coal that say where in the library an error was raised.
PLACES = ("From file", "in function", "at line", "Hint", "message: Could not load")


def reason(error: BaseException) -> str:
    """Return the cause from a message whose other lines say where in the library the error was raised."""
    lines = [line.strip() for line in str(error).splitlines()]
    kept = [line for line in lines if line and not line.startswith(PLACES)]
    return kept[-1].rstrip(".")[:200] if kept else type(error).__name__


def answer(path: str, libraries: list[str]) -> tuple[dict[str, Any], bytes]:
    """Read a mesh with the first library that can; return the line of the answer, and the bytes of the arrays."""
    problem = ""
    for library in libraries:
        try:
            vertices, triangles = (_by_coal if library == "coal" else _by_trimesh)(path)
        except Exception as error:  # the libraries raise exceptions of many types
            problem = problem or reason(error)
            continue
        if not len(vertices):
            problem = problem or "it has no vertices"
            continue
        return {"vertices": len(vertices), "triangles": len(triangles)}, vertices.tobytes() + triangles.tobytes()
    return {"problem": problem}, b""


def _by_coal(path: str) -> tuple[Any, Any]:
    import coal  # type: ignore[import-untyped]

    # The tree of bounding volumes is not used; this one takes a third of the time of reading with coal's finest.
    surface = coal.MeshLoader(coal.BV_AABB).load(path, np.ones(3))
    faces = [surface.tri_indices(index) for index in range(surface.num_tris)]
    vertices = np.array(surface.vertices(), dtype=np.float64).reshape(-1, 3)
    return vertices, np.array([(face[0], face[1], face[2]) for face in faces], dtype=np.int64).reshape(-1, 3)


def _by_trimesh(path: str) -> tuple[Any, Any]:
    import trimesh

    mesh = trimesh.load_scene(path).to_mesh()
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
    return vertices, np.ascontiguousarray(mesh.faces, dtype=np.int64).reshape(-1, 3)


def main(answers: BinaryIO) -> None:
    """Answer for every path on standard input."""
    paths = json.load(sys.stdin)
    for path in paths:
        said, arrays = answer(path, sys.argv[1:])
        answers.write(json.dumps(said).encode() + b"\n" + arrays)
        answers.flush()
