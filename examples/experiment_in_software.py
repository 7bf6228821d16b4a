"""The whole experiment without a robot: excite, record, identify, and use the model in a simulation.

python examples/experiment_in_software.py
"""

import numpy as np

import steelyard as sy
from steelyard.excitation import SearchOptions

# A planar arm that moves under gravity, with friction; its true parameters are what the identification is to find.
robot = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], name="arm", gravity=(0, -9.81, 0))
model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))
truth = {"m": (3.0, 2.0), "lx": (-0.6, -0.4), "Lxx": (0.01, 0.01), "Lyy": (0.22, 0.12), "Lzz": (0.22, 0.12)}
truth |= {"Fvj": (0.4, 0.2), "Fcj": (0.8, 0.3), "Foj": (0.0, 0.1)}
delta = np.zeros(model.parameter_count)
for symbol, values in truth.items():
    for joint, value in enumerate(values, start=1):
        delta[model.parameter_names.index(f"{symbol}{joint}")] = value

# 1. A motion that shows the parameters, within limits; from rest to rest, two periods.
limits = {"lower": -2.0, "upper": 2.0, "velocity": 3.0, "acceleration": 10.0}
design = sy.design_excitation(
    model, limits, period=5.0, harmonics=4, periods=2, search=SearchOptions(starts=4), parameters=delta
)
print(design)

# 2. The robot follows this motion under a controller, with the resolution of its encoders and noise of its torques.
sensors = sy.simulation.Sensors(encoder_resolution=2 * np.pi / 65536, torque_noise=0.2)
log = sy.play(model, delta, design.trajectory, sensors=sensors, seed=1)

# 3. From the log to a model that is physically possible, with a proof.
information = sy.Information.from_samples(model, log.process(cutoff="auto", velocity_threshold=0.05))
feasible_set = sy.FeasibleSet(model)
estimate = sy.fit(information, feasible_set)
verdict = sy.check(feasible_set, parameters=estimate.parameters)
print(verdict)
error = estimate.relative_error
print(f"relative error of the torques {error:.2%}")
for name, found, true in zip(
    estimate.base_expressions, estimate.base, model.base_parameters().values(delta), strict=True
):
    print(f"  {name:32} {found:8.4f}   true {true:8.4f}")

# 4. Use of the model: the free fall of the true and of the identified arm.
still = np.zeros(2)
falls = [sy.simulate(model, p, still, still, 1.0) for p in (delta, estimate.parameters)]
apart = np.abs(falls[0].q - falls[1].q).max()
print(f"after a second of free fall the two are at most {apart:.4f} rad apart")
