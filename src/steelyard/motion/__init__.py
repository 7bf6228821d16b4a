"""Trajectories that show a robot's parameters."""

from .fourier import FourierTrajectory as FourierTrajectory

__all__ = ["FourierTrajectory"]
