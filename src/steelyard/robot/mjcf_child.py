"""A program that compiles MJCF with MuJoCo for another process.

It reads a request as JSON from standard input, and writes the answer as JSON.
"""

from __future__ import annotations

import json
import re
import sys
from typing import Any, BinaryIO

__all__ = ["answer", "main"]


def answer(request: dict[str, Any]) -> dict[str, Any]:
    """Compile ``xml``; ``files`` are paths by the names that stand in it. A ``problem`` is what MuJoCo says of it."""
    import mujoco

    try:
        files = {}
        for name, path in request["files"].items():
            with open(path, "rb") as file:
                files[name] = file.read()
        model = mujoco.MjModel.from_xml_string(request["xml"], files)
    except (ValueError, OSError, mujoco.FatalError) as error:
        return {"problem": _reason(str(error))}
    return _told(mujoco, model)


def _reason(message: str) -> str:
    """Return what MuJoCo says, without lines, which are those of an excerpt."""
    text = " ".join(message.replace("Error: ", "").removeprefix("XML ").split())
    return re.sub(r"(, id \d+)?, line \d+", "", text).replace("Element name", "element")[:300]


def _told(mujoco: Any, model: Any) -> dict[str, Any]:
    kinds = mujoco.mjtObj

    def rows(prefix: str, count: int, kind: Any, names: str) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = []
        for index in range(count):
            arrays = {name: getattr(model, f"{prefix}_{name}", None) for name in names.split()}
            row = {name: None if array is None else array[index].tolist() for name, array in arrays.items()}
            found.append({"name": mujoco.mj_id2name(model, kind, index) or "", **row})
        return found

    joints = rows(
        "jnt", model.njnt, kinds.mjOBJ_JOINT, "type bodyid pos axis range limited stiffness actfrclimited actfrcrange"
    )
    for index, joint in enumerate(joints):
        degree, coordinate = model.jnt_dofadr[index], model.jnt_qposadr[index]
        joint |= {name: getattr(model, f"dof_{name}")[degree].tolist() for name in ("armature", "damping")}
        joint |= {"friction": model.dof_frictionloss[degree].tolist(), "ref": model.qpos0[coordinate].tolist()}
        joint["poly"] = bool(hasattr(model, "dof_dampingpoly") and model.dof_dampingpoly[degree].any())
    actuators = rows(
        "actuator",
        model.nu,
        kinds.mjOBJ_ACTUATOR,
        "trntype trnid gear gainprm biasprm armature damping dampingpoly",
    )
    for actuator in actuators:  # older versions give actuators neither armature nor damping
        actuator |= {name: actuator[name] or 0.0 for name in ("armature", "damping")}
        actuator["poly"] = any(actuator.pop("dampingpoly") or ())
    tendons = rows("tendon", model.ntendon, kinds.mjOBJ_TENDON, "adr num stiffness damping frictionloss armature")
    for tendon in tendons:
        wraps = range(tendon["adr"], tendon["adr"] + tendon["num"])
        of_joints = [k for k in wraps if model.wrap_type[k] == mujoco.mjtWrap.mjWRAP_JOINT]
        tendon["joints"] = [int(model.wrap_objid[k]) for k in of_joints]
        tendon["is_spatial"] = len(of_joints) < len(wraps)
    gravity = model.opt.gravity.tolist()
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        gravity = [0.0, 0.0, 0.0]
    return {
        "gravity": gravity,
        "bodies": rows(
            "body", model.nbody, kinds.mjOBJ_BODY, "parentid pos quat ipos iquat mass inertia mocapid gravcomp"
        ),
        "joints": joints,
        "equalities": rows("eq", model.neq, kinds.mjOBJ_EQUALITY, "type obj1id obj2id objtype active0 data"),
        "actuators": actuators,
        "tendons": tendons,
    }


def main(answers: BinaryIO) -> None:
    """Answer the request on standard input."""
    answers.write(json.dumps(answer(json.load(sys.stdin))).encode("ascii"))
