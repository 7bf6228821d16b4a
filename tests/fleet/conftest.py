"""Logs of a double pendulum whose torques are in closed form."""

from pathlib import Path

import numpy as np
import pytest

ROBOT = """\
[description]
convention = "standard"
rows = [["pi/2", 0, 0.3, "q"], [0, 0.5, 0, "q"]]

[processing]
cutoff = "none"
"""


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """Return a folder with ``robot.toml`` and five logs, ``logs/run1.csv`` to ``run5.csv``, of different motions."""
    (tmp_path / "logs").mkdir()
    (tmp_path / "robot.toml").write_text(ROBOT)
    t = np.arange(600) / 200.0
    noise = np.random.default_rng(1)
    for number in range(1, 6):
        rates = np.array([2.1 + 0.3 * number, 3.4 - 0.2 * number])
        phase = t[:, None] * rates
        q, ddq = np.sin(phase), -(rates**2) * np.sin(phase)
        # The second link is a point mass of 2 kg on a rod of 0.5 m; the first one turns it about the vertical.
        torque = np.column_stack([0.3 * ddq[:, 0], 0.5 * ddq[:, 1] + 9.81 * np.cos(q[:, 1])])
        torque += noise.normal(0.0, 0.05, q.shape)
        table = np.column_stack([t, q, torque])
        path = tmp_path / "logs" / f"run{number}.csv"
        np.savetxt(path, table, delimiter=",", header="t,q1,q2,tau1,tau2", comments="", fmt="%.9g")
    return tmp_path
