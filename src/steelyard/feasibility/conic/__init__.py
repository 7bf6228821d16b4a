"""Conic problems and the solvers that they are handed to."""

from .problem import Cone as Cone
from .problem import ConicProblem as ConicProblem
from .problem import ConicSolution as ConicSolution
from .problem import Outcome as Outcome
from .problem import solve as solve

__all__ = ["Cone", "ConicProblem", "ConicSolution", "Outcome", "solve"]
