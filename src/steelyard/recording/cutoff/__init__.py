"""Choosing a cutoff frequency from the data, with evidence."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .by_spectra import ResidualAnalysis as ResidualAnalysis
    from .by_spectra import Spectra as Spectra
    from .by_spectra import choose_cutoff as choose_cutoff
    from .by_spectra import motion_spectra as motion_spectra
    from .by_spectra import residual_analysis as residual_analysis
    from .by_torques import cutoff_by_torques as cutoff_by_torques
    from .evidence import CutoffChoice as CutoffChoice

__all__ = import_at_first_use(__name__, __file__)
