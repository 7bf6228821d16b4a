"""Linear algebra on narrow blocks, which threads only wait for."""

import numpy as np
import threadpoolctl

import steelyard as sy


def test_identification_keeps_to_one_thread(tmp_path):
    threads = set()

    def step(text):
        threads.update(pool["num_threads"] for pool in threadpoolctl.threadpool_info() if pool["user_api"] == "blas")

    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        robot = tmp_path / "arm.urdf"
        robot.write_text(
            '<robot name="arm"><link name="base"/><link name="link"/><joint name="joint" type="revolute">'
            '<parent link="base"/><child link="link"/><axis xyz="0 1 0"/>'
            '<limit lower="-3" upper="3" velocity="3" effort="9"/></joint></robot>'
        )
        log = tmp_path / "log.csv"
        rows = ["t,q1,tau1"]
        for k in range(3000):
            t = k / 500
            q = np.sin(t) + 0.4 * np.sin(3.1 * t + 1.0)
            dq = np.cos(t) + 1.24 * np.cos(3.1 * t + 1.0)
            ddq = -np.sin(t) - 3.844 * np.sin(3.1 * t + 1.0)
            torque = 0.4 * ddq - 3.0 * np.sin(q) + 0.2 * np.sign(dq) + 0.1 * dq
            rows.append(f"{t},{q},{torque}")
        log.write_text("\n".join(rows))
        sy.identify(robot, [log], progress=step)
    assert threads == {1}
