"""Points of a body from files: meshes, and arrays of coordinates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError, MissingExtraError

__all__ = ["read_points"]

Matrix = npt.NDArray[np.float64]


def read_points(path: str | Path) -> Matrix:
    """The vertices of a mesh, or the points of an array.

    Parameters
    ----------
    path : str or Path
        ``.npy`` (k, 3); ``.csv``, ``.txt`` or ``.xyz`` with three columns, a line of column names or ``#`` comments
        allowed; or a mesh that trimesh reads, such as ``.stl``, ``.obj``, ``.ply`` or ``.glb``.

    Returns
    -------
    (k, 3)

    Raises
    ------
    InputError
        If the file cannot be read or holds no points.
    MissingExtraError
        For a mesh, without trimesh.

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
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; give the path of a mesh, or of a file of points.")
    points = _READERS.get(path.suffix.lower(), _mesh)(path)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise InputError(f"{path}: holds an array of shape {points.shape}; points are rows of x, y and z.")
    if not np.all(np.isfinite(points)):
        raise InputError(f"{path}: row {int(np.argwhere(~np.isfinite(points))[0, 0]) + 1} is not finite; remove it.")
    return points


def _array(path: Path) -> Matrix:
    try:
        values = np.load(path, allow_pickle=False)
        return np.asarray(values, dtype=float)
    except (OSError, ValueError, TypeError, EOFError):
        raise InputError(f"{path}: is no array of numbers in NumPy's format; write it with numpy.save.") from None


def _columns(path: Path) -> Matrix:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError):
        raise InputError(f"{path}: cannot be read as text in UTF-8; write rows of x, y and z.") from None
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
            raise InputError(f"{path}: line {number} is {line.strip()!r}; write numbers x, y and z.") from None
        if len(row) != 3:
            raise InputError(f"{path}: line {number} has {len(row)} numbers; write x, y and z.")
        rows.append(row)
    if not rows:
        raise InputError(f"{path}: holds no points; write rows of x, y and z.")
    return np.array(rows)


def _mesh(path: Path) -> Matrix:
    try:
        import trimesh
    except ImportError as error:
        raise MissingExtraError(
            "Meshes need the package trimesh, which is not installed; pip install 'steelyard[meshes]'."
        ) from error
    if path.suffix.lower().lstrip(".") not in trimesh.available_formats():
        raise InputError(
            f"{path}: trimesh reads no files with the suffix {path.suffix!r} as it is installed; give an STL or OBJ "
            "file (for .dae install pycollada)."
        )
    try:
        mesh = trimesh.load_scene(path).to_mesh()
        points = np.asarray(mesh.vertices, dtype=float)
    except Exception as error:  # trimesh's readers raise whatever they meet
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: trimesh cannot read the mesh ({reason}); export it again, as STL or OBJ.") from None
    if not points.size:
        raise InputError(f"{path}: the mesh has no vertices; give one with a surface.")
    return points


_READERS = {".npy": _array, ".csv": _columns, ".txt": _columns, ".xyz": _columns}
