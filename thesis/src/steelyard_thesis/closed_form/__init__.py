"""The feasible set by polynomials, and by conditions on the base parameters alone where these can be had."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .conditions import closed_form_conditions as closed_form_conditions
    from .polynomials import PolynomialCondition as PolynomialCondition
    from .polynomials import feasibility_polynomials as feasibility_polynomials

__all__ = import_at_first_use(__name__, __file__)
