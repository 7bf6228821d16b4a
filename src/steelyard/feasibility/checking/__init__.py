"""The search for proofs of feasibility or infeasibility: margins, dual centers, witnesses and exact dual points."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .dual_center import Fibre as Fibre
    from .dual_center import center as center
    from .margin import MARGIN_CAP as MARGIN_CAP
    from .margin import largest_margin as largest_margin
    from .margin import least_violations as least_violations
    from .proof_search import Decision as Decision
    from .proof_search import decide as decide

__all__ = import_at_first_use(__name__, __file__)
