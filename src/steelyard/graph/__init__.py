"""Scalar expression graph: hash-consed nodes, simplification, operation counts, and the LLVM compiler."""

from .cache import ObjectCache as ObjectCache
from .differentiation import gradient as gradient
from .differentiation import jacobian as jacobian
from .expression import Graph as Graph
from .expression import Node as Node
from .expression import cos as cos
from .expression import evaluate as evaluate
from .expression import operation_count as operation_count
from .expression import sign as sign
from .expression import sin as sin
from .expression import sqrt as sqrt
from .function import Argument as Argument
from .function import Function as Function
from .function import Output as Output
from .kernel import Kernel as Kernel

__all__ = [
    "Argument",
    "Function",
    "Graph",
    "Kernel",
    "Node",
    "ObjectCache",
    "Output",
    "cos",
    "evaluate",
    "gradient",
    "jacobian",
    "operation_count",
    "sign",
    "sin",
    "sqrt",
]
