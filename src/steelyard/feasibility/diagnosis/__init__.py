"""Diagnosis of infeasible estimates: contradictory conditions and the base parameters involved (thesis 8.1)."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .explanation import BaseParameterDegree as BaseParameterDegree
    from .explanation import InfeasibilityExplanation as InfeasibilityExplanation
    from .explanation import explain_infeasibility as explain_infeasibility
    from .irreducible_subsystem import IrreducibleInfeasibleSubsystem as IrreducibleInfeasibleSubsystem

__all__ = import_at_first_use(__name__, __file__)
