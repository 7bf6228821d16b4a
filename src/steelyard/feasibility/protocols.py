"""What this room needs of a model: its parameters, base parameters and conditions."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

__all__ = ["BaseParametersLike", "ConditionLike", "InformationLike", "ModelLike", "ReducedLike", "RobotLike"]


class RobotLike(Protocol):
    """The part of `steelyard.Robot` that is used: names of the links and parameter values from CAD."""

    @property
    def link_names(self) -> Sequence[str]:
        """Names of the links, in the order of the parameters."""

    @property
    def parameters(self) -> npt.NDArray[np.float64]:
        """Values from CAD, NaN where unknown, (n,)."""


class BaseParametersLike(Protocol):
    """The base parameters β = K δ, with K = [1 K_d] Pᵀ (thesis 2.41, 3.9)."""

    @property
    def K(self) -> npt.NDArray[np.float64]:
        """(n_b, n)."""

    @property
    def independent(self) -> Any:
        """Indices of the n_b parameters that the base parameters lead with."""

    @property
    def dependent(self) -> Any:
        """Indices of the other n_d parameters."""


class ConditionLike(Protocol):
    """A symmetric matrix, affine in the parameters, that must be positive semidefinite."""

    @property
    def name(self) -> str:
        """E.g. ``"link 4 (forearm): inertia"``."""

    @property
    def link(self) -> str | None:
        """Link that it speaks of, None for a term."""

    @property
    def joint(self) -> str | None:
        """Joint that it speaks of, None for a link."""

    @property
    def constant(self) -> npt.NDArray[np.float64]:
        """(d, d)."""

    @property
    def indices(self) -> Any:
        """Indices of the parameters, (c,)."""

    @property
    def coefficients(self) -> npt.NDArray[np.float64]:
        """(c, d, d)."""


class ModelLike(Protocol):
    """The part of `steelyard.Model` that is used."""

    @property
    def robot(self) -> Any:
        """A `RobotLike`."""

    @property
    def parameter_names(self) -> Sequence[str]:
        """Names of the standard parameters, (n,)."""

    def base_parameters(self) -> Any:
        """A `BaseParametersLike`."""

    def conditions(self, consistency: Any) -> Sequence[Any]:
        """The conditions (`ConditionLike`) of ``"inertia"`` or ``"full"`` consistency."""


class ReducedLike(Protocol):
    """‖W β - ω‖² = ‖R β - rho‖² + residual2, over `count` rows; norm2 = ‖ω‖²."""

    @property
    def R(self) -> npt.NDArray[np.float64]:
        """(n_b, n_b)."""

    @property
    def rho(self) -> npt.NDArray[np.float64]:
        """(n_b,)."""

    @property
    def residual2(self) -> float:
        """Smallest squared residual."""

    @property
    def count(self) -> int:
        """Number of rows."""

    @property
    def norm2(self) -> float:
        """Squared norm of the regressand."""


class InformationLike(Protocol):
    """The part of `steelyard.Information` that is used."""

    def reduced(self, weights: Any = "joint") -> Any:
        """A `ReducedLike`."""
