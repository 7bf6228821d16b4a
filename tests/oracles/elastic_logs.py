"""Logs of simulated arms with elastic joints: Pinocchio's equations of motion, integrated by SciPy."""

import json

import numpy as np
from payload_logs import SimulatedArm
from pinocchio_oracle import pinocchio
from scipy.integrate import solve_ivp

LAWS = ("coulomb", "stribeck", "polynomial")
DELAY, ENCODER, NOISE = 1.7e-3, 1e-5, 0.01  # s, rad, of the torque's root mean square


class ElasticArm:
    """An arm of example-robot-data whose motors follow a motion exactly, and whose links follow by springs.

    Links, friction, rotors, stiffnesses, dampings and zeros of the encoders are drawn anew for each `random`. Friction
    of the motors is viscous and Coulomb's, with Stribeck's beside it where `law` says so, or the square and the cube of
    the speed.
    """

    def __init__(self, name, random, law="coulomb"):
        assert law in LAWS
        self.law = law
        self.arm = SimulatedArm(name)
        self.pin, count = self.arm.pin.copy(), self.arm.pin.nv
        for index in range(1, self.pin.njoints):  # the description is wrong by some ten percent
            body = self.pin.inertias[index]
            factor = random.uniform(0.85, 1.2)
            self.pin.inertias[index] = pinocchio.Inertia(factor * body.mass, body.lever, factor * body.inertia)
        self.stiffness = np.geomspace(3e4, 3e3, count) * random.uniform(0.7, 1.4, count)
        self.rotor = np.geomspace(1.5, 0.1, count) * random.uniform(0.7, 1.4, count)
        self.viscous = np.geomspace(10.0, 1.0, count) * random.uniform(0.7, 1.4, count)
        self.coulomb = np.geomspace(8.0, 1.0, count) * random.uniform(0.7, 1.4, count)
        data = self.pin.createData()
        inertia = np.diag(pinocchio.crba(self.pin, data, pinocchio.neutral(self.pin)))
        self.damping = 2 * 0.05 * np.sqrt(self.stiffness * np.maximum(inertia, 0.02))
        self.zero = 2e-3 * random.normal(size=count)
        self.delay = DELAY * random.uniform(0.5, 1.5, count)
        if law == "stribeck":  # of motions that reach about 1 rad/s
            self.breakaway = self.coulomb * random.uniform(0.6, 1.2, count)
            self.stribeck_speed = random.uniform(0.05, 0.2, count)
        if law == "polynomial":
            self.saturating = self.viscous * random.uniform(0.3, 0.5, count)

    def friction(self, speed):
        """Torque of friction at the motors, (S, N)."""
        torque = self.viscous * speed + self.coulomb * np.sign(speed)
        if self.law == "stribeck":
            torque = torque + self.breakaway * np.exp(-((speed / self.stribeck_speed) ** 2)) * np.sign(speed)
        if self.law == "polynomial":
            torque = torque + self.saturating * (0.3 * speed**3 - speed * np.abs(speed))
        return torque

    def log(self, random, noise=1.0, duration=20.0):
        """Columns of a log, as a dictionary: t, q1 … of the motors, tau1 …, and link1 … of the links."""
        t, theta, speed, acceleration = self.arm.motion(random)
        kept = t <= duration
        t, theta, speed, acceleration = t[kept], theta[kept], speed[kept], acceleration[kept]
        motion = _Interpolated(t, theta, speed, acceleration)
        data, count = self.pin.createData(), self.pin.nv

        def rate(time, state):
            q, dq = state[:count], state[count:]
            place, velocity = motion(time)
            torque = self.stiffness * (place - q) + self.damping * (velocity - dq)
            return np.concatenate([dq, pinocchio.aba(self.pin, data, q, dq, torque)])

        held = pinocchio.rnea(self.pin, data, theta[0], speed[0], acceleration[0])
        start = np.concatenate([theta[0] - held / self.stiffness, speed[0]])
        found = solve_ivp(rate, (t[0], t[-1]), start, method="DOP853", rtol=1e-7, atol=1e-9, dense_output=True)
        states = found.sol(t)
        q, dq = states[:count].T, states[count:].T
        spring = self.stiffness * (theta - q) + self.damping * (speed - dq)
        torque = self.rotor * acceleration + self.friction(speed) + spring
        late = np.column_stack([found.sol(np.maximum(t - d, t[0]))[k] for k, d in enumerate(self.delay)])
        torque = torque + noise * NOISE * np.sqrt(np.mean(torque**2, axis=0)) * random.normal(size=torque.shape)
        motor = theta + noise * ENCODER * random.normal(size=theta.shape)
        link = late - self.zero + noise * ENCODER * random.normal(size=theta.shape)
        columns = {"t": t}
        for name, values in (("q", motor), ("tau", torque), ("link", link)):
            columns |= {f"{name}{k + 1}": values[:, k] for k in range(count)}
        self.deflection = theta - q
        return columns

    def robot_file(self, folder, *, inertia=True, joints=None, second=True):
        """Write a robot.toml with the description as it is, not as the arm is."""
        joints = list(range(1, self.pin.nv + 1)) if joints is None else joints
        locked = f"locked = {json.dumps(list(self.arm.locked))}\n" if self.arm.locked else ""
        inertias = [float(self.rotor[k - 1]) for k in joints]
        path = folder / "robot.toml"
        path.write_text(
            f'[description]\nurdf = "{self.arm.path}"\n{locked}'
            + "".join(f'[[terms]]\nkind = "{kind}"\n' for kind in ("viscous", "coulomb", "offset", "rotor_inertia"))
            + '[log]\nposition = "q{}"\ntorque = "tau{}"\n[processing]\ncutoff = 10.0\n'
            + f"[elastic]\njoints = {joints}\n"
            + ('position = "link{}"\n' if second else "")
            + (f"motor_inertia = {inertias}\n" if inertia else "")
        )
        return path


class _Interpolated:
    """A motion between its samples, as a piecewise polynomial of degree five."""

    def __init__(self, t, q, dq, ddq):
        from scipy.interpolate import BPoly

        self.q = BPoly.from_derivatives(t, np.stack([q, dq, ddq], axis=1))
        self.dq = self.q.derivative()

    def __call__(self, time):
        return self.q(time), self.dq(time)
