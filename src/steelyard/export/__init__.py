"""Graph functions as objects of other libraries: SymPy, CasADi and JAX."""

from .casadi_function import casadi_function as casadi_function
from .evaluation import evaluate_over as evaluate_over
from .jax_function import jax_function as jax_function
from .symbolic_function import SymbolicFunction as SymbolicFunction
from .sympy_function import sympy_function as sympy_function

__all__ = [
    "SymbolicFunction",
    "casadi_function",
    "evaluate_over",
    "jax_function",
    "sympy_function",
]
