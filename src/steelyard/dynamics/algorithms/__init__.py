"""The algorithms of rigid-body dynamics, one a file, each written once over generic scalars."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .coriolis_matrix import coriolis_matrix as coriolis_matrix
    from .derivatives import inverse_dynamics_derivatives as inverse_dynamics_derivatives
    from .forward_dynamics import articulated_body as articulated_body
    from .forward_dynamics import solve_inertia as solve_inertia
    from .inertia_matrix import inertia_matrix as inertia_matrix
    from .jacobians import jacobian as jacobian
    from .jacobians import jacobian_rate as jacobian_rate
    from .newton_euler import inverse_dynamics as inverse_dynamics
    from .regressor import kinetic_energy_regressor as kinetic_energy_regressor
    from .regressor import potential_energy_regressor as potential_energy_regressor

__all__ = import_at_first_use(__name__, __file__)
