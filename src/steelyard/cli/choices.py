"""The choices that options offer."""

from __future__ import annotations

from enum import Enum
from typing import Literal

__all__ = ["Consistency", "Preference", "Weights"]


class Consistency(Enum):
    """What counts as physically possible."""

    FULL = "full"
    INERTIA = "inertia"

    value: Literal["full", "inertia"]


class Weights(Enum):
    """How the joints are weighted."""

    JOINT = "joint"
    NONE = "none"


class Preference(Enum):
    """The choice among near-equal answers."""

    AUTO = "auto"
    CAD = "cad"
    LIGHTEST = "lightest"

    value: Literal["auto", "cad", "lightest"]
