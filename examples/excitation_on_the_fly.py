"""Moves a simulated arm, of which only the kinematics are known, until its torques are predicted to 2 %."""

import numpy as np

import steelyard as sy
from steelyard.online import ActiveExcitation
from steelyard.simulation import Sensors

robot = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], name="arm", gravity=(0, -9.81, 0))
model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb()))
upper = [*sy.Inertia.from_com(3.0, [-0.2, 0.02, 0.0], 0.02 * np.eye(3)).parameters, 0.6, 0.9]
lower = [*sy.Inertia.from_com(1.2, [-0.15, -0.01, 0.0], 0.006 * np.eye(3)).parameters, 0.3, 0.4]
truth = np.array([*upper, *lower])  # what the controller is not told

limits = {"lower": -2.0, "upper": 2.0, "velocity": 2.0, "acceleration": 6.0, "torque": [60.0, 30.0]}
excitation = ActiveExcitation(model, limits, accuracy=0.02, cutoff=8.0)
sensors = Sensors(velocity="none", torque_noise=[0.3, 0.15], torque_time_constant=0.02)
run = sy.simulate(model, truth, [0.2, -0.3], [0.0, 0.0], 24.0, excitation, sensors=sensors)

print(excitation.table())
print(excitation)
print("largest speed:", np.abs(run.dq).max().round(2), "rad/s, the limit is 2")
print("base parameters, true:     ", model.base_parameters().values(truth).round(3))
print("base parameters, estimated:", np.asarray(excitation.estimate.base).round(3))
