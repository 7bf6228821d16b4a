"""Steelyard weighs a robot by moving it.

It turns a robot description and a motion log into the robot's dynamic parameters, physically possible and with a
proof, and hands them back as a URDF, JSON and a report.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

# Rooms are imported when a name of theirs is first used, so that importing the package costs next to nothing.
_ROOMS = {
    "robot": ("Inertia", "Joint", "Link", "Robot", "RobotFile", "Term", "TermParameter"),
    "graph": ("Graph", "Kernel"),
    "dynamics": ("BaseParameters", "Coulomb", "Model", "MotorSide", "Offset", "RotorInertia", "Viscous"),
    "recording": ("LogColumns", "Processing", "Recording", "Samples"),
    "regression": ("Estimate", "Information", "least_squares", "residual_covariance"),
    "feasibility": (
        "CenterOfMassBox",
        "CenterOfMassHull",
        "CenterOfMassSphere",
        "ConfidenceInterval",
        "ConstantPullbackPrior",
        "DensityInBox",
        "DensityInEllipsoid",
        "EntropicPrior",
        "EqualLinks",
        "EuclideanPrior",
        "FeasibleSet",
        "LinearBound",
        "LinearMatrixInequality",
        "MeasuredMass",
        "Preference",
        "SymmetricLink",
        "TotalMass",
        "Verdict",
        "check",
        "confidence_intervals",
        "constraint_prices",
        "correct",
        "explain_infeasibility",
        "fit",
        "l_curve",
        "lightest_robot",
        "parameter_intervals",
        "robust_information",
        "smallest_total_mass",
        "verify_certificate",
    ),
    "motion": ("ExcitationDesign", "FourierTrajectory", "MotionLimits", "design_excitation", "load_trajectory"),
    "simulation": ("Actuators", "ElasticContact", "Safety", "Sensors", "SimulationResult", "simulate"),
    "control": ("ComputedTorque", "FeedforwardTracking", "GravityCompensation", "ImpedanceControl", "TaskSpaceControl"),
    "laboratory": ("play",),
    "identification": ("Identification", "identify"),
    "errors": ("InputError", "MissingExtraError", "SolverError", "SteelyardError"),
}
_HOME = {name: room for room, names in _ROOMS.items() for name in names}

__all__ = sorted([*_HOME, "__version__"])


def __getattr__(name: str) -> Any:
    room = _HOME.get(name)
    if room is None:
        raise AttributeError(f"module 'steelyard' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"steelyard.{room}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return list(__all__)
