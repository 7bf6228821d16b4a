"""Robot and data in memory, as in a notebook: from a data frame to parameters, a plot and a folder of results.

Run it with ``python examples/from_a_notebook.py``; it needs nothing but Steelyard. With pandas it is the same with its
data frames.
"""

import tempfile
from pathlib import Path

import numpy as np
import polars as pl

import steelyard as sy

# The robot: Denavit-Hartenberg rows here; sy.Robot.from_urdf(path) reads a URDF.
robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")], name="elbow")
model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))

# Two recordings as data frames. They are simulated here, with noise on the torques; yours come from anywhere.
body = sy.Inertia.from_com(mass=2.0, com=(-0.1, 0.02, 0.0), about_com=np.diag([0.01, 0.02, 0.02]))
truth = np.concatenate([[*body.parameters, 0.4, 0.6, 0.1]] * 2)
random = np.random.default_rng(1)
frames = []
for _ in range(2):
    a, b = random.normal(size=(2, 2, 4))
    t, q, dq, ddq = sy.excitation.FourierTrajectory(a=a, b=b, center=[0.0, 0.5], frequency=0.1).sample(rate=200.0)
    torque = model.inverse_dynamics(q, dq, ddq, truth) + random.normal(scale=0.2, size=q.shape)
    columns = {f"{joint}_pos": q[:, k] for k, joint in enumerate(robot.joint_names)}
    columns |= {f"{joint}_effort": torque[:, k] for k, joint in enumerate(robot.joint_names)}
    frames.append(pl.DataFrame({"time": t, **columns}))

# Columns are found by their names, as those of a file are.
result = sy.identify(robot, frames[0], validate=frames[1])
print(result.headline)
print(result.parameters["m2"])
print(result.parameters.to_frame().filter(pl.col("basis") == "measured").select("name", "value", "unit"))

# The answer stands wherever parameters do.
predicted = model.inverse_dynamics(q, dq, ddq, result)
print(f"left of the torques: {np.linalg.norm(torque - predicted) / np.linalg.norm(torque):.1%}")

# A figure for the notebook, and what the command line would write.
figure = result.plot(joints=["joint2"])
print(f"{len(figure.data)} curves")
with tempfile.TemporaryDirectory() as folder:
    print(*sorted(path.name for path in result.save(Path(folder) / "result")))
