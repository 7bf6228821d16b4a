"""The limits file: what the joints may do, and what the robot must keep clear of, as TOML."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from steelyard.errors import InputError
from steelyard.files import read_toml, shown

from .limits import JOINT_FIELDS

__all__ = ["limits_from_file"]

_LIMITS = (*JOINT_FIELDS, "effort", "total_power")


def limits_from_file(path: str | Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read a limits file.

    Parameters
    ----------
    path : str or Path
        TOML. At its top level, or in a table ``[limits]``: ``lower``, ``upper``, ``velocity``, ``acceleration``,
        ``torque`` (or ``effort``), ``power``: a number for all the joints, a list with one for each, or a table by
        joint name; and ``total_power``.

    Returns
    -------
    limits : dict
        For :meth:`MotionLimits.updated`.
    sections : dict
        The other tables, which describe obstacles.

    Raises
    ------
    InputError
        If the file cannot be read, or has a key that is none of these.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "limits.toml"
    ...     _ = path.write_text("velocity = 2\\nacceleration = [4, 5]")
    ...     limits_from_file(path)
    ({'velocity': 2, 'acceleration': [4, 5]}, {})
    """
    place = Path(path)
    content = read_toml(place, remedy="give a limits file")
    table = content.pop("limits", {})
    if not isinstance(table, dict):
        raise InputError(f"{place}: limits must be a table [limits], got {shown(table)}.")
    limits = dict(table)
    sections: dict[str, Any] = {}
    for key, value in content.items():
        if key in _LIMITS:
            if key in limits:
                raise InputError(f"{place}: {key} stands both at the top and in [limits]; keep one of them.")
            limits[key] = value
        else:
            sections[key] = value
    unknown = [key for key in limits if key not in _LIMITS]
    unknown += [key for key, value in sections.items() if not isinstance(value, dict | list)]
    if unknown:
        raise InputError(f"{place}: {shown(unknown[0])} is no limit; there are {', '.join(_LIMITS)}.")
    return limits, sections
