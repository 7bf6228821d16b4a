"""The choice of a cutoff frequency from the data, with its evidence."""

from steelyard.recording.cutoff.choice import CutoffChoice as CutoffChoice
from steelyard.recording.cutoff.choice import choose_cutoff as choose_cutoff
from steelyard.recording.cutoff.residuals import ResidualAnalysis as ResidualAnalysis
from steelyard.recording.cutoff.residuals import residual_analysis as residual_analysis
from steelyard.recording.cutoff.spectra import Spectra as Spectra
from steelyard.recording.cutoff.spectra import motion_spectra as motion_spectra
from steelyard.recording.cutoff.torques import TorqueCutoffChoice as TorqueCutoffChoice
from steelyard.recording.cutoff.torques import cutoff_by_torques as cutoff_by_torques

__all__ = [
    "CutoffChoice",
    "ResidualAnalysis",
    "Spectra",
    "TorqueCutoffChoice",
    "choose_cutoff",
    "cutoff_by_torques",
    "motion_spectra",
    "residual_analysis",
]
