"""Finding and reading the mesh files that a robot description names."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import unquote, urlparse

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError, MissingExtraError

from .engine import coal_or_none

__all__ = ["find_mesh", "read_mesh"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def find_mesh(reference: str, description: Path, packages: Iterable[str | Path] = ()) -> Path:
    """Return the file that the attribute `filename` of a ``<mesh>`` means.

    Parameters
    ----------
    reference : str
        ``package://name/path``, ``model://name/path``, ``file:///path``, or a path, absolute or relative to the
        folder of the description.
    description : Path
        The URDF.
    packages : iterable of path
        Folders of packages, or folders that hold packages; looked through first. Then come ``ROS_PACKAGE_PATH``,
        ``AMENT_PREFIX_PATH`` (its ``share``) and the folders above the description.

    Raises
    ------
    InputError
        When there is no such file; the message says where it was looked for.
    """
    scheme, separator, rest = reference.partition("://")
    scheme = scheme.lower() if separator else ""
    if scheme in ("package", "model"):
        name, _, inside = rest.partition("/")
        candidates = [folder / inside for folder in _package_folders(name, description, packages)]
        remedy = f"set ROS_PACKAGE_PATH to the folder that holds {name}, or name it in packages"
    elif scheme == "file":
        candidates = [Path(unquote(urlparse(reference).path) if rest.startswith("/") else rest)]
        remedy = "mend the path"
    elif scheme:
        raise InputError(f'a mesh is named "{reference}"; only package://, model:// and file:// can be read')
    else:
        candidates = [description.parent / reference]
        remedy = "mend the path, which is relative to the folder of the description"
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    looked = ", ".join(dict.fromkeys(str(candidate) for candidate in candidates[:6])) or "no folder"
    raise InputError(f'the mesh "{reference}" is not found (looked for {looked}); {remedy}')


def _package_folders(name: str, description: Path, packages: Iterable[str | Path]) -> list[Path]:
    roots = [Path(folder) for folder in packages]
    roots += [Path(folder) for folder in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if folder]
    prefixes = [Path(folder) for folder in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if folder]
    folders: list[Path] = []
    for root in (*roots, *(prefix / "share" for prefix in prefixes), *description.resolve().parents):
        if root.name == name:
            folders.append(root)
        folders.append(root / name)
    existing = [folder for folder in folders if folder.is_dir()]
    return existing or folders


def read_mesh(path: Path) -> tuple[Array, Indices]:
    """Return vertices (k, 3), in the unit of the file, and triangles (t, 3) of a mesh file.

    Read by coal (STL, OBJ, COLLADA, PLY and many more), or by trimesh where coal is absent.

    Raises
    ------
    InputError
        When the file is no mesh.
    MissingExtraError
        When neither package is installed.
    """
    coal = coal_or_none()
    try:
        if coal is not None:
            surface = coal.MeshLoader(coal.BV_OBBRSS).load(str(path), np.ones(3))
            faces = [surface.tri_indices(index) for index in range(surface.num_tris)]
            vertices = np.array(surface.vertices(), dtype=np.float64).reshape(-1, 3)
            triangles = np.array([(face[0], face[1], face[2]) for face in faces], dtype=np.intp).reshape(-1, 3)
        else:
            vertices, triangles = _with_trimesh(path)
    except MissingExtraError:
        raise
    except Exception as error:  # readers of meshes raise whatever they meet
        reason = _reason(error)
        raise InputError(f"{path}: the mesh cannot be read ({reason}); export it again, as STL or OBJ") from None
    if not len(vertices):
        raise InputError(f"{path}: the mesh has no vertices; export it again, as STL or OBJ")
    return vertices, triangles


def _reason(error: Exception) -> str:
    """Return what is wrong from a message of several lines, most of which say where in the library it was raised."""
    places = ("From file", "in function", "at line", "Hint", "message: Could not load")
    lines = [line.strip() for line in str(error).splitlines()]
    kept = [line for line in lines if line and not line.startswith(places)]
    return kept[-1].rstrip(".") if kept else type(error).__name__


def _with_trimesh(path: Path) -> tuple[Array, Indices]:
    try:
        import trimesh
    except ImportError as error:
        raise MissingExtraError(
            "Collision meshes need the package coal or trimesh, and neither is installed; "
            "pip install 'steelyard[collision]'."
        ) from error
    mesh = trimesh.load_scene(path).to_mesh()
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.intp)
