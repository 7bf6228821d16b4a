"""The choice of a cutoff frequency from the data, with its evidence."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .choice import CutoffChoice as CutoffChoice
    from .choice import choose_cutoff as choose_cutoff
    from .residuals import ResidualAnalysis as ResidualAnalysis
    from .residuals import residual_analysis as residual_analysis
    from .spectra import Spectra as Spectra
    from .spectra import motion_spectra as motion_spectra
    from .torques import TorqueCutoffChoice as TorqueCutoffChoice
    from .torques import cutoff_by_torques as cutoff_by_torques

__all__ = import_at_first_use(__name__, __file__)
