"""The feasible set by polynomials, and by conditions on the base parameters alone where these can be had."""

from .conditions import closed_form_conditions as closed_form_conditions
from .polynomials import PolynomialCondition as PolynomialCondition
from .polynomials import feasibility_polynomials as feasibility_polynomials

__all__ = ["PolynomialCondition", "closed_form_conditions", "feasibility_polynomials"]
