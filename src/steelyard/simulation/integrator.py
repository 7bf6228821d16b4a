"""What the integration methods have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from .plant import Plant
from .watch import Watch

__all__ = ["Integrator"]

Array = NDArray[np.float64]


class Integrator(ABC):
    """Carries R runs through time.

    Parameters
    ----------
    plant : Plant
    watch : Watch
        Sees the steps, and knows which runs have ended.
    state : ndarray
        (R, 2 N) at the start.

    Attributes
    ----------
    state : ndarray
        (R, 2 N) where the runs are; those that ended stay at their last state.
    """

    def __init__(self, plant: Plant, watch: Watch, state: Array) -> None:
        self.plant, self.watch = plant, watch
        self.state = np.array(state, dtype=np.float64, order="C")

    @abstractmethod
    def advance(self, t: float, end: float) -> None:
        """Carry the runs that have not ended from t to `end`; the torques of the plant hold between."""
