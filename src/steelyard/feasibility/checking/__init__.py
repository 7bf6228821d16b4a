"""How a verdict is reached: largest margins, the face of the dual points, and exact proofs from solvers' answers."""

from .decision import Decision as Decision
from .decision import decide as decide
from .margin import MARGIN_CAP as MARGIN_CAP
from .margin import largest_margin as largest_margin
from .margin import least_violations as least_violations

__all__ = ["MARGIN_CAP", "Decision", "decide", "largest_margin", "least_violations"]
