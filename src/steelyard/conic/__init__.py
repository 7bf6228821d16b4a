"""Conic problems and the solvers that they are handed to."""

from .problem import Cone as Cone
from .problem import ConicProblem as ConicProblem
from .problem import ConicSolution as ConicSolution
from .problem import Outcome as Outcome
from .provided import PROVIDED as PROVIDED
from .semidefinite_program import SemidefiniteProgram as SemidefiniteProgram
from .solver import Solver as Solver
from .solver import find_solver as find_solver
from .solver import register_solver as register_solver
from .solver import registered_solvers as registered_solvers
from .solver import solve as solve
from .solver import unregister_solver as unregister_solver
from .table import SolverTable as SolverTable
from .table import solver_table as solver_table

__all__ = [
    "PROVIDED",
    "Cone",
    "ConicProblem",
    "ConicSolution",
    "Outcome",
    "SemidefiniteProgram",
    "Solver",
    "SolverTable",
    "find_solver",
    "register_solver",
    "registered_solvers",
    "solve",
    "solver_table",
    "unregister_solver",
]
