"""The experiment in software: a simulated robot of known parameters plays a trajectory and leaves a log."""

from .play import play as play

__all__ = ["play"]
