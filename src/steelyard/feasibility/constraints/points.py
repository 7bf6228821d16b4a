"""Points of a body from files: meshes, and arrays of coordinates."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import numpy.typing as npt

from steelyard.collision.mesh_files import read_mesh
from steelyard.errors import InputError
from steelyard.files import read_bytes, read_text, require_file, shown
from steelyard.files.npy import read_array

__all__ = ["read_points"]

LARGEST = 1e15  # in the unit of the file
Matrix = npt.NDArray[np.float64]


def read_points(path: str | Path) -> Matrix:
    """The vertices of a mesh, or the points of an array.

    Parameters
    ----------
    path : str or Path
        ``.npy`` (k, 3); ``.csv``, ``.txt`` or ``.xyz`` with three columns, a line of column names or ``#`` comments
        allowed; or a mesh that coal or trimesh reads, such as ``.stl``, ``.obj``, ``.ply`` or ``.glb``.

    Returns
    -------
    (k, 3)

    Raises
    ------
    InputError
        If the file cannot be read or holds no points.
    MissingExtraError
        For a mesh, without coal and trimesh.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "corners.csv"
    ...     _ = path.write_text("x,y,z\\n0,0,0\\n0.1,0,0\\n")
    ...     read_points(path).tolist()
    [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]
    """
    path = Path(path)
    require_file(path, "give the path of a mesh, or of a file of points")
    points = _READERS.get(path.suffix.lower(), _mesh)(path)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise InputError(f"{path}: holds an array of shape {points.shape}; points are rows of x, y and z.")
    bad = ~(np.abs(points) <= LARGEST)
    if bad.any():
        row = int(np.argwhere(bad)[0, 0]) + 1
        raise InputError(f"{path}: row {row} is not finite, or beyond {LARGEST:g}; remove it.")
    return points


def _array(path: Path) -> Matrix:
    content = read_bytes(path, remedy="give an array of NumPy")
    try:
        values = read_array(BytesIO(content), len(content))
        return np.asarray(values, dtype=float)
    except (ValueError, TypeError):
        raise InputError(f"{path}: is no array of numbers in NumPy's format; write it with numpy.save.") from None


def _columns(path: Path) -> Matrix:
    lines = read_text(path, remedy="write rows of x, y and z").splitlines()
    rows: list[list[float]] = []
    heading = False
    for number, line in enumerate(lines, start=1):
        cells = line.partition("#")[0].replace(",", " ").replace(";", " ").split()
        if not cells:
            continue
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            if not rows and not heading:
                heading = True
                continue
            raise InputError(f"{path}: line {number} is {shown(line.strip())}; write numbers x, y and z.") from None
        if len(row) != 3:
            raise InputError(f"{path}: line {number} has {len(row)} numbers; write x, y and z.")
        rows.append(row)
    if not rows:
        raise InputError(f"{path}: holds no points; write rows of x, y and z.")
    return np.array(rows)


def _mesh(path: Path) -> Matrix:
    return read_mesh(path)[0]


_READERS = {".npy": _array, ".csv": _columns, ".txt": _columns, ".xyz": _columns}
