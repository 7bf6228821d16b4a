"""The choice of a cutoff frequency from the data, with its evidence."""

from steelyard.recording.cutoff.choice import CutoffChoice as CutoffChoice
from steelyard.recording.cutoff.choice import choose_cutoff as choose_cutoff
from steelyard.recording.cutoff.residuals import ResidualAnalysis as ResidualAnalysis
from steelyard.recording.cutoff.residuals import residual_analysis as residual_analysis
from steelyard.recording.cutoff.spectra import Spectra as Spectra
from steelyard.recording.cutoff.spectra import motion_spectra as motion_spectra

__all__ = [
    "CutoffChoice",
    "ResidualAnalysis",
    "Spectra",
    "choose_cutoff",
    "motion_spectra",
    "residual_analysis",
]
