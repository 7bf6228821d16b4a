"""The library in one page: a robot, a motion, two data sets that add up, and a robot that can exist.

Run it with ``python examples/library_tour.py``; it needs nothing but Steelyard.
"""

import numpy as np

import steelyard as sy

# A robot: standard Denavit-Hartenberg rows (alpha, a, d, theta), and what its drives add.
rows = [("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q"), ("pi/2", 0.1, 0, "q")]
robot = sy.Robot.from_dh(rows, name="elbow").with_terms(sy.Viscous(), sy.Coulomb(), sy.RotorInertia())
model = sy.Model(robot)
base = model.base_parameters()
print(model)
print(f"{base.count} base parameters, the first: {base.expressions[0]}")

# Two recordings of a motion, here simulated: inverse dynamics at the true parameters, and noise.
truth = np.zeros(model.parameter_count)
for columns, mass in zip(model.link_columns, (4.0, 2.0, 0.8), strict=True):
    rod = sy.Inertia.from_com(mass=mass, com=np.array([-0.1, 0.0, 0.02]), about_com=np.diag([0.01, 0.02, 0.02]))
    truth[columns] = rod.parameters
    truth[columns[-1] + 1 : columns[-1] + 4] = (0.4, 0.6, 0.05)  # viscous, Coulomb, rotor inertia
random = np.random.default_rng(1)
information = sy.Information.empty(model)
for _ in range(2):
    a, b = random.normal(size=(2, 3, 5)) * 0.6
    trajectory = sy.excitation.FourierTrajectory(a=a, b=b, center=np.zeros(3), frequency=0.1)
    _, q, dq, ddq = trajectory.sample(rate=200.0)
    torque = model.inverse_dynamics(q, dq, ddq, truth) + random.normal(size=q.shape) * [1.0, 1.0, 0.3]
    information = information + sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
print(information)

# Plain least squares, and whether such a robot could exist.
plain = sy.least_squares(information)
feasible_set = sy.FeasibleSet(model, constraints=[sy.TotalMass(maximum=10.0)])
print(plain)
print(sy.check(feasible_set, base=plain.base))

# The best robot that can.
answer = sy.fit(information, feasible_set)
print(answer)
print(sy.check(feasible_set, parameters=answer.parameters))
error = np.abs(answer.base - base.values(truth)).max() / np.abs(base.values(truth)).max()
print(f"largest error of a base parameter: {error:.1%} of the largest one")
