"""Inverse dynamics and regressor of the rigid WAM: our batch kernels against Pinocchio called from Python in a loop."""

import statistics
import time

import numpy as np
import pinocchio

import steelyard as sy
from steelyard.identification.wam import DH_ROWS, true_parameters, wam_model
from steelyard.robot import Robot

SAMPLES = 4096
ROUNDS = 15


def pinocchio_wam() -> tuple[pinocchio.Model, np.ndarray]:
    """Build the same arm in Pinocchio from its joint placements, with the same link inertias."""
    robot = Robot.from_dh(DH_ROWS)
    full = wam_model()
    delta = true_parameters()
    model = pinocchio.Model()
    parent, before = 0, pinocchio.SE3.Identity()
    for k, (joint, columns) in enumerate(zip(robot.joints, full.link_columns, strict=True)):
        placement = before * pinocchio.SE3(np.array(joint.before))
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), placement, joint.name)
        xx, xy, xz, yy, yz, zz, lx, ly, lz, m = delta[columns]
        com = np.array([lx, ly, lz]) / m
        about_com = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        about_com = about_com - m * (com @ com * np.eye(3) - np.outer(com, com))
        after = pinocchio.SE3(np.array(joint.after))
        model.appendBodyToJoint(parent, pinocchio.Inertia(m, com, about_com), after)
        before = after
        assert k < 7
    return model, np.concatenate([delta[c] for c in full.link_columns])


def interleaved(ours, theirs) -> tuple[float, float]:
    """Return the median times of both, measured in turn."""
    ours(), theirs()
    pairs = []
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        ours()
        middle = time.perf_counter()
        theirs()
        pairs.append((middle - begin, time.perf_counter() - middle))
    return tuple(statistics.median(side) for side in zip(*pairs, strict=True))


def main() -> None:
    model, delta = pinocchio_wam()
    data = model.createData()
    arm = sy.Model(Robot.from_dh(DH_ROWS, name="wam"))
    random = np.random.default_rng(0)
    q, dq, ddq = random.normal(size=(3, SAMPLES, 7))
    few = range(SAMPLES // 8)

    expected = np.array([pinocchio.rnea(model, data, q[s], dq[s], ddq[s]) for s in few])
    assert np.allclose(arm.inverse_dynamics(q, dq, ddq, delta)[: len(few)], expected, rtol=1e-9, atol=1e-9)
    assert np.allclose(arm.regressor(q, dq, ddq)[: len(few)] @ delta, expected, rtol=1e-9, atol=1e-9)

    inverse, regressor = arm.kernel("inverse_dynamics"), arm.kernel("regressor")
    torque, rows = np.empty((SAMPLES, 7)), np.empty((SAMPLES, 490))
    print(f"{'WAM, rigid links':22s} {'ours':>10s} {'Pinocchio':>10s} {'ratio':>7s}   ns a sample")
    cases = (
        (
            "inverse dynamics",
            lambda: inverse(q, dq, ddq, delta, out=torque),
            lambda: [pinocchio.rnea(model, data, q[s], dq[s], ddq[s]) for s in few],
        ),
        (
            "regressor",
            lambda: regressor(q, dq, ddq, out=rows),
            lambda: [pinocchio.computeJointTorqueRegressor(model, data, q[s], dq[s], ddq[s]) for s in few],
        ),
    )
    for name, ours, theirs in cases:
        a, b = interleaved(ours, theirs)
        a, b = 1e9 * a / SAMPLES, 1e9 * b / len(few)
        print(f"{name:22s} {a:10.1f} {b:10.1f} {b / a:7.1f}")


if __name__ == "__main__":
    main()
