"""A summary of a description as plain data: joints, parameters, base parameters, and whether it is possible."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from steelyard.dynamics import Model
from steelyard.feasibility import FeasibleSet, check
from steelyard.files import plain
from steelyard.identification.preflight import LinkReport, Preflight, preflight

__all__ = ["inspection"]

INSPECTION_FORMAT = "steelyard-inspection-1"


def inspection(
    model: Model, consistency: Literal["full", "inertia"] = "full", findings: Preflight | None = None
) -> dict[str, Any]:
    """Return what is known of a robot before it moves, as plain data for JSON; what is not finite is None.

    Parameters
    ----------
    model : Model
    consistency : {"full", "inertia"}
        In which sense the inertias of the description are judged, see :class:`steelyard.FeasibleSet`.
    findings : Preflight, optional
        Those on the description of this robot; looked for by default. Each link has what is wrong with it: ``cause``,
        ``evidence``, ``finding`` (both as a sentence) and ``remedy``, which are empty where nothing is.

    Examples
    --------
    >>> import steelyard as sy
    >>> told = inspection(sy.Model(sy.Robot.from_dh([(0, 0.3, 0, "q")], name="arm")))
    >>> told["robot"], told["joints"][0]["name"], len(told["base_parameters"]), told["verdict"]
    ('arm', 'joint1', 1, None)
    """
    robot, base = model.robot, model.base_parameters()
    values = np.asarray(robot.parameters)
    joints = [
        {
            "name": joint.name,
            "kind": joint.kind,
            "mimics": joint.mimics,
            "link": link.name,
            "mass": None if link.inertia is None else link.inertia.mass,
            "lower": joint.lower,
            "upper": joint.upper,
            "velocity_limit": joint.velocity_limit,
            "effort_limit": joint.effort_limit,
        }
        for joint, link in zip(robot.joints, robot.links, strict=True)
    ]
    known = all(np.isfinite(values[columns]).all() for columns in model.link_columns)
    verdict = check(FeasibleSet(model, consistency, terms=False), parameters=np.nan_to_num(values)) if known else None
    found: dict[str, Any] = plain(
        {
            "format": INSPECTION_FORMAT,
            "robot": robot.name,
            "gravity": robot.gravity,
            "terms": [term.to_dict() for term in robot.terms],
            "joints": joints,
            "parameters": dict(zip(model.parameter_names, values.tolist(), strict=True)),
            "base_parameters": base.expressions,
            "base_error": base.error,
            "verdict": None if verdict is None else verdict.to_dict(),
            "links": [_link(one) for one in (findings or preflight(robot)).links],
        }
    )
    return found


def _link(one: LinkReport) -> dict[str, Any]:
    return {
        "link": one.link,
        "mass": one.mass,
        "margin": one.margin,
        "possible": one.possible,
        "cause": one.cause,
        "evidence": one.evidence,
        "finding": one.sentence,
        "remedy": one.remedy,
    }
