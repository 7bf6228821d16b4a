"""Scalar expression graph: hash-consed nodes, simplification, operation counts, and the LLVM compiler."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .cache import ObjectCache as ObjectCache
    from .differentiation import gradient as gradient
    from .differentiation import jacobian as jacobian
    from .expression import Graph as Graph
    from .expression import Node as Node
    from .expression import cos as cos
    from .expression import evaluate as evaluate
    from .expression import exp as exp
    from .expression import log as log
    from .expression import operation_count as operation_count
    from .expression import sign as sign
    from .expression import sin as sin
    from .expression import sqrt as sqrt
    from .function import Argument as Argument
    from .function import Function as Function
    from .function import Output as Output
    from .function import evaluate_over as evaluate_over
    from .kernel import Kernel as Kernel

__all__ = import_at_first_use(__name__, __file__)
