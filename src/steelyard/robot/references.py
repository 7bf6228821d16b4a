"""Search for the files that a description names: meshes, models and packages, without ROS or Gazebo."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from steelyard.errors import InputError
from steelyard.files import read_bytes, shown

__all__ = ["find_package", "find_reference", "moved_reference", "package_folders", "package_root", "search_folders"]

PATHS = ("ROS_PACKAGE_PATH", "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "GAZEBO_MODEL_PATH", "SDF_PATH")
"""Variables of the environment that list folders of packages or models."""

MARKS = ("package.xml", "manifest.xml", "model.config", ".git")
"""What a folder holds that is the root of a package, of a model or of a repository."""

ENDINGS = ("_description", "_support")
"""Endings of the names of packages of robots, which collections of robots leave out or exchange."""

LARGEST_MARK = 1_000_000  # bytes of a package.xml
_NAME = re.compile(rb"<name[^<>]*>\s*([^<\s]+)\s*</name>")


def find_reference(
    reference: str, description: Path, packages: Iterable[str | Path] = (), what: str = "mesh", folder: bool = False
) -> Path:
    """Return the file that a description names.

    Parameters
    ----------
    reference : str
        ``package://name/path``, ``model://name/path``, ``file:///path``, or a path, absolute or relative to the
        folder of the description.
    description : Path
        Path of the description.
    packages : iterable of path
        Folders of packages, or folders that contain packages, which are searched first; see `find_package`.
    what : str
        What is looked for, for messages.
    folder : bool
        Whether it may be a folder.

    Raises
    ------
    InputError
        If there is no such file; the message says where it was searched for. If ``..`` leads out of a package: out of
        the folder named after ``package://``, or, for a path that is relative, out of the folder above the description
        that has a package.xml, manifest.xml, model.config or .git, else of the package of Python, else of the folder
        above that of the description.

    Examples
    --------
    >>> find_reference("package://arm/../../key", Path("arm.urdf"))
    Traceback (most recent call last):
        ...
    steelyard.errors.InputError: the mesh "package://arm/../../key" leads out of its package; name a file within it
    """
    named = f'"{reference[:200]}"'
    scheme, separator, rest = reference.partition("://")
    scheme = scheme.lower() if separator else ""
    if scheme in ("package", "model"):
        name, _, inside = rest.partition("/")
        inside = unquote(inside) if "%" in inside else inside
        if not _is_name(name) or not _stays_inside(inside):
            raise InputError(f"the {what} {named} leads out of its package; name a file within it")
        candidates = [folder / inside for folder in package_folders(name, description, packages)]
        remedy = f"set ROS_PACKAGE_PATH to the folder that holds {name}, or put it beside the description"
    elif scheme == "file":
        candidates = [Path(unquote(rest) if rest.startswith("/") else rest)]
        remedy = "mend the path"
    elif scheme:
        raise InputError(f"a {what} is named {named}; only package://, model:// and file:// can be read")
    else:
        candidates = [description.parent / reference]
        remedy = "mend the path, which is relative to the folder of the description"
        root = package_root(description)
        place = os.path.normpath(Path(os.path.abspath(description.parent)) / reference)
        if ".." in PurePosixPath(reference).parts and not Path(place).is_relative_to(root):
            raise InputError(
                f"the {what} {named} leads out of {root}, to which the description belongs; name it with "
                "package:// or file://"
            )
    for candidate in candidates:
        try:
            if candidate.is_file() or (folder and candidate.is_dir()):
                return candidate
        except (ValueError, OSError):  # a NUL, or a name that is too long
            continue
    looked = ", ".join(dict.fromkeys(str(candidate) for candidate in candidates[:6])) or "no folder"
    raise InputError(f"the {what} {named} is not found (looked for {looked}); {remedy}")


def moved_reference(reference: str, description: Path, copy: Path) -> str | None:
    """Return what a copy of a description calls a file that the description names relative to its own folder.

    Parameters
    ----------
    reference : str
        As in the description.

    Returns
    -------
    str or None
        The absolute path. None where the name stays: both stand in one folder, it says by itself where the file is, or
        there is no such file.
    """
    folder = description.resolve().parent
    if not reference or "://" in reference or folder == copy.resolve().parent:
        return None
    path = os.path.normpath(folder / reference)
    return None if os.path.isabs(reference) or not os.path.exists(path) else Path(path).as_posix()


def find_package(name: str, description: Path) -> Path:
    """Return the folder of a package.

    It is looked for in the folders of ``ROS_PACKAGE_PATH``, of ``AMENT_PREFIX_PATH`` (its ``share``) and of the
    variables of Gazebo, then in those above the description. A folder belongs to the package where it has its name, or
    a package.xml with it; where there is none, a folder counts whose name differs by the ending ``_description`` or
    ``_support`` alone.

    Parameters
    ----------
    description : Path
        The file that names it.

    Raises
    ------
    InputError
        If there is none.
    """
    if not _is_name(name):
        raise InputError(f"{shown(name)} cannot be the name of a package, which is one word without slashes")
    for folder in package_folders(name, description, ()):
        if folder.is_dir():
            return folder
    raise InputError(
        f'the package "{name}" is not found in the folders above {description}, nor in ROS_PACKAGE_PATH or '
        f"AMENT_PREFIX_PATH; set ROS_PACKAGE_PATH to the folder that holds {name}"
    )


def package_folders(name: str, description: Path, packages: Iterable[str | Path]) -> list[Path]:
    """Return the folders that may be a package: those that exist, or else all that were thought of."""
    folders: list[Path] = []
    roots = [*search_folders(packages), *description.resolve().parents]
    for root in roots:
        if root.name == name or _package_name(root) == name:
            folders.append(root)
        folders.append(root / name)
    # Where nothing has the name, a folder that lacks the usual ending, or has another one, may be meant.
    folders += [root / other for root in roots for other in _other_names(name)]
    folders += [root for root in roots if root.name in _other_names(name)]
    existing = [folder for folder in folders if folder.is_dir()]
    return existing or folders


def search_folders(packages: Iterable[str | Path] = ()) -> list[Path]:
    """Return the folders of packages, or of folders of packages, that are given or that the environment names."""
    roots = [Path(folder) for folder in packages]
    for variable in PATHS:
        roots += [Path(folder) for folder in os.environ.get(variable, "").split(os.pathsep) if folder]
    prefixes = [Path(folder) for folder in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if folder]
    return [*roots, *(prefix / "share" for prefix in prefixes)]


def _other_names(name: str) -> list[str]:
    """Names by which the folder of a package goes as well, as arm_description for arm or arm_support."""
    stem = next((name.removesuffix(ending) for ending in ENDINGS if name.endswith(ending)), name)
    return [other for other in (stem, *(stem + ending for ending in ENDINGS)) if other != name]


def _package_name(folder: Path) -> str:
    """Return the name that the package.xml of a folder gives; empty where there is none."""
    try:
        text = read_bytes(folder / "package.xml", largest=LARGEST_MARK)
    except InputError:
        return ""
    found = _NAME.search(text)
    return found[1].decode("utf-8", "replace") if found else ""


def _is_name(name: str) -> bool:
    return bool(name) and name not in (".", "..") and not set("\\/\0") & set(name)


def _stays_inside(inside: str) -> bool:
    normal = os.path.normpath(inside or ".")
    return "\0" not in inside and not os.path.isabs(normal) and normal.split(os.sep)[0] != ".."


def package_root(description: Path) -> Path:
    """Return the folder that the relative paths of a description must not leave."""
    place = Path(os.path.abspath(description)).parent
    for folder in (place, *place.parents):
        if any((folder / mark).exists() for mark in MARKS):
            return folder
    # A package of Python may hold models far from their meshes.
    packages = [folder for folder in (place, *place.parents) if (folder / "__init__.py").exists()]
    return packages[-1] if packages else place.parent
