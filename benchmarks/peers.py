"""The same robot in other people's libraries, each as functions that compute a batch on one thread.

Each takes a case and the name of a function, and returns what computes it for all the samples, or None where it has no
such function. A library that is missing raises ImportError.
"""

import ctypes
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import steelyard as sy

FUNCTIONS = ("inverse_dynamics", "regressor", "inertia_matrix", "forward_dynamics")


@dataclass
class Case:
    """A robot, its parameters, and samples (S, N)."""

    model: sy.Model
    delta: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    tau: np.ndarray

    @property
    def robot(self):
        return self.model.robot

    def few(self, count):
        """Return the first samples, for peers that are slow."""
        return Case(self.model, self.delta, self.q[:count], self.dq[:count], self.ddq[:count], self.tau[:count])

    def arguments(self, function):
        """Return the samples and parameters that our function reads."""
        moving = {
            "inverse_dynamics": (self.q, self.dq, self.ddq),
            "regressor": (self.q, self.dq, self.ddq),
            "inertia_matrix": (self.q,),
            "forward_dynamics": (self.q, self.dq, self.tau),
        }[function]
        return moving if function == "regressor" else (*moving, self.delta)


def pinocchio_model(case):
    """Build the robot in Pinocchio from its joints, with the same inertias."""
    import pinocchio

    robot = case.robot
    model = pinocchio.Model()
    model.gravity.linear = np.asarray(robot.gravity, dtype=float)
    ids, after = [], []
    for k, (joint, columns) in enumerate(zip(robot.joints, case.model.link_columns, strict=True)):
        assert (joint.coordinate, joint.multiplier, joint.offset) == (k, 1.0, 0.0)
        before = pinocchio.SE3(np.array(joint.before))
        root = joint.parent < 0
        placement = before if root else after[joint.parent] * before
        kind = pinocchio.JointModelPZ() if joint.kind == "prismatic" else pinocchio.JointModelRZ()
        ids.append(model.addJoint(0 if root else ids[joint.parent], kind, placement, f"joint {k}"))
        after.append(pinocchio.SE3(np.array(joint.after)))
        xx, xy, xz, yy, yz, zz, lx, ly, lz, m = case.delta[columns]
        com = np.array([lx, ly, lz]) / m if m else np.zeros(3)
        about_com = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        about_com = about_com - m * (com @ com * np.eye(3) - np.outer(com, com))
        model.appendBodyToJoint(ids[-1], pinocchio.Inertia(m, com, about_com), after[-1])
    return model


def pinocchio_loop(case, function):
    """Pinocchio, called from Python once a sample."""
    import pinocchio

    model = pinocchio_model(case)
    data = model.createData()
    q, dq, ddq, tau = (list(a) for a in (case.q, case.dq, case.ddq, case.tau))
    steps = range(len(q))
    return {
        "inverse_dynamics": lambda: [pinocchio.rnea(model, data, q[s], dq[s], ddq[s]) for s in steps],
        "regressor": lambda: [pinocchio.computeJointTorqueRegressor(model, data, q[s], dq[s], ddq[s]) for s in steps],
        "inertia_matrix": lambda: [pinocchio.crba(model, data, q[s]) for s in steps],
        "forward_dynamics": lambda: [pinocchio.aba(model, data, q[s], dq[s], tau[s]) for s in steps],
    }[function]


def pinocchio_batch(case, function):
    """Pinocchio's own loops in C++, where the wheel has them."""
    import pinocchio

    if not hasattr(pinocchio, "rneaInParallel"):
        raise ImportError("this build of Pinocchio has no batch calls")
    pool = pinocchio.ModelPool(pinocchio_model(case), 1)
    q, dq, ddq, tau = (np.asfortranarray(a.T) for a in (case.q, case.dq, case.ddq, case.tau))
    out = np.empty_like(q)
    return {
        "inverse_dynamics": lambda: pinocchio.rneaInParallel(1, pool, q, dq, ddq, out),
        "forward_dynamics": lambda: pinocchio.abaInParallel(1, pool, q, dq, tau, out),
    }.get(function)


def mujoco_model(case):
    """Build the robot in MuJoCo, link by link as Pinocchio has it."""
    import mujoco
    import pinocchio

    ours = pinocchio_model(case)
    children = {k: [] for k in range(ours.njoints)}
    for k in range(1, ours.njoints):
        children[ours.parents[k]].append(k)

    def body(k):
        place, inertia = ours.jointPlacements[k], ours.inertias[k]
        x, y, z, w = pinocchio.Quaternion(place.rotation).coeffs()
        i = inertia.inertia
        numbers = (i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
        kind = "slide" if case.robot.joints[k - 1].kind == "prismatic" else "hinge"
        return (
            (
                f'<body pos="{" ".join(map(repr, map(float, place.translation)))}" quat="{w!r} {x!r} {y!r} {z!r}">'
                f'<inertial mass="{max(inertia.mass, 1e-6)!r}" pos="{" ".join(map(repr, map(float, inertia.lever)))}" '
                f'fullinertia="{" ".join(repr(float(v)) for v in numbers)}"/>'
                f'<joint type="{kind}" axis="0 0 1"/>{"".join(map(body, children[k]))}</body>'
            )
            .replace("np.float64(", "")
            .replace(")", "")
        )

    gravity = " ".join(map(repr, map(float, case.robot.gravity)))
    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler balanceinertia="true"/>'
        f'<option gravity="{gravity}"><flag contact="disable" constraint="disable" energy="disable"/></option>'
        f"<worldbody>{''.join(map(body, children[0]))}</worldbody></mujoco>"
    )


def mujoco_loop(case, function):
    """MuJoCo, called from Python once a sample."""
    import mujoco

    model = mujoco_model(case)
    data = mujoco.MjData(model)
    steps = range(len(case.q))

    def inverse():
        for s in steps:
            data.qpos, data.qvel, data.qacc = case.q[s], case.dq[s], case.ddq[s]
            mujoco.mj_inverse(model, data)
        return data.qfrc_inverse

    def inertia():
        for s in steps:
            data.qpos = case.q[s]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_makeM(model, data) if hasattr(mujoco, "mj_makeM") else mujoco.mj_crb(model, data)
        return data.M if hasattr(data, "M") else data.qM

    def forward():
        for s in steps:
            data.qpos, data.qvel, data.qfrc_applied = case.q[s], case.dq[s], case.tau[s]
            mujoco.mj_forward(model, data)
        return data.qacc

    return {"inverse_dynamics": inverse, "inertia_matrix": inertia, "forward_dynamics": forward}.get(function)


def mujoco_rollout(case, function):
    """MuJoCo's own loop in C++, one step a sample: forward dynamics and a step of integration."""
    import mujoco
    from mujoco import rollout

    if function != "forward_dynamics":
        return None
    model = mujoco_model(case)
    data = mujoco.MjData(model)
    states = np.hstack([np.zeros((len(case.q), 1)), case.q, case.dq])
    forces = case.tau[:, None, :].copy()
    spec = mujoco.mjtState.mjSTATE_QFRC_APPLIED.value
    runner = rollout.Rollout(nthread=0)
    return lambda: runner.rollout(model, data, states, forces, control_spec=spec, nstep=1)


def casadi_map(case, function):
    """CasADi's interpreter over our graph, mapped over the batch, without copies."""
    mapped = case.model.casadi(function).map(len(case.q), "serial")
    arrays = [np.ascontiguousarray(a) for a in case.arguments(function)]
    if function != "regressor":
        arrays[-1] = np.tile(arrays[-1], (len(case.q), 1))
    out = np.empty(mapped.nnz_out(0))
    buffer, evaluate = mapped.buffer()
    for k, array in enumerate(arrays):
        buffer.set_arg(k, memoryview(array))
    buffer.set_res(0, memoryview(out))

    def run(kept=(buffer, mapped, arrays)):
        evaluate()
        return out

    return run


_LOOP = """
void batch(long count, long n, const double **in, const long *steps, double *out, long width) {{
  static casadi_int iw[{iw} + 1]; static double w[{w} + 1];
  for (long s = 0; s < count; s++) {{
    const double *arg[{arg} + 8]; double *res[{res} + 8];
    for (long k = 0; k < n; k++) arg[k] = in[k] + s * steps[k];
    res[0] = out + s * width;
    {name}(arg, res, iw, w, 0);
  }}
}}
"""


def casadi_c(case, function):
    """The C code that CasADi writes of our graph, compiled with a loop around it."""
    import casadi

    recorded = case.model.casadi(function)
    writer = casadi.CodeGenerator("code.c", {"with_header": False})
    writer.add(recorded)
    sizes = {"iw": recorded.sz_iw(), "w": recorded.sz_w(), "arg": recorded.sz_arg(), "res": recorded.sz_res()}
    batch = _compiled(writer.dump() + _LOOP.format(name=recorded.name(), **sizes)).batch
    batch.argtypes = [ctypes.c_long, ctypes.c_long, *[ctypes.c_void_p] * 3, ctypes.c_long]
    arrays = [np.ascontiguousarray(a) for a in case.arguments(function)]
    pointers = (ctypes.c_void_p * len(arrays))(*(a.ctypes.data for a in arrays))
    steps = (ctypes.c_long * len(arrays))(*(0 if a.ndim == 1 else a.shape[1] for a in arrays))
    out = np.empty((len(case.q), recorded.nnz_out(0)))

    def run():
        batch(len(out), len(arrays), pointers, steps, out.ctypes.data, out.shape[1])
        return out

    return run


_ARM_LOOP = """
void batch(long count, const double *p, const double *q, const double *dq, const double *ddq, double *out) {{
  for (long s = 0; s < count; s++) invdyn(out + {n} * s, p, q + {n} * s, dq + {n} * s, ddq + {n} * s);
}}
"""


def sympybotics_c(case, function, rows):
    """The C code that SymPyBotics writes, compiled with a loop around it (arms given by DH rows only)."""
    import sympy
    import sympybotics
    from sympybotics import robotcodegen

    if function != "inverse_dynamics":
        return None

    q = sympybotics.q if hasattr(sympybotics, "q") else sympy.Symbol("q", real=True)
    table = [tuple(sympy.sympify(v).subs(sympy.Symbol("q"), q) for v in row) for row in rows]
    definition = sympybotics.RobotDef("arm", table, dh_convention="standard")
    code = sympybotics.RobotDynCode(definition)
    source = robotcodegen.robot_code_to_func("C", code.invdyn_code, "tau_out", "invdyn", definition)
    source += _ARM_LOOP.format(n=len(rows))
    batch = _compiled("#include <math.h>\n" + source).batch
    batch.argtypes = [ctypes.c_long, *[ctypes.c_void_p] * 5]
    out = np.empty_like(case.q)
    given = [np.ascontiguousarray(a) for a in (case.delta, case.q, case.dq, case.ddq)]

    def run():
        batch(len(out), *(a.ctypes.data for a in given), out.ctypes.data)
        return out

    return run


def _compiled(source):
    compiler = shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise ImportError("there is no C compiler")
    folder = Path(tempfile.mkdtemp())
    (folder / "code.c").write_text(source)
    options = ["-O3", "-march=native", "-ffp-contract=fast", "-fno-math-errno", "-shared", "-fPIC"]
    subprocess.run([compiler, *options, "-o", "code.so", "code.c", "-lm"], cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "code.so"))
    shutil.rmtree(folder)
    return library
