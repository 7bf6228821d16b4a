"""A sign that passes from -1 to 1 without a jump, for integration and differentiation."""

from __future__ import annotations

from typing import Any

from steelyard import graph

__all__ = ["SmoothSign"]


class SmoothSign:
    """The functions of an algebra of graph nodes, with ``x / sqrt(x² + w²)`` for the sign of x.

    At x = w the value is 0.707, at 10 w it is 0.995; the slope at zero is 1 / w. Thesis section 5.1.2 asks for a tight
    sigmoid; this one needs no exponential, and friction stays passive, because x times it is never negative.

    Parameters
    ----------
    width : Node
        w, positive; rad/s or m/s, of the joint or of the motor.

    Examples
    --------
    >>> from steelyard.graph import Graph, evaluate
    >>> v, w = Graph().inputs("x", 2)
    >>> [float(s) for s in evaluate([SmoothSign(w).sign(v)], {"x[0]": 3.0, "x[1]": 4.0})]
    [0.6]
    """

    def __init__(self, width: graph.Node) -> None:
        self._square = width * width

    @staticmethod
    def sin(x: Any) -> Any:
        """Return the sine."""
        return graph.sin(x)

    @staticmethod
    def cos(x: Any) -> Any:
        """Return the cosine."""
        return graph.cos(x)

    def sign(self, x: Any) -> Any:
        """Return the smooth sign."""
        return x / graph.sqrt(x * x + self._square)
