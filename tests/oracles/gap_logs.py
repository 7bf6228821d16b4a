"""Logs of a joint behind a spring with a gap, integrated in small steps by NumPy alone."""

import numpy as np


def gap_log(
    seed, *, backlash, stiffness=3e4, delay=0.0, noise=1e-5, seconds=30.0, rate=250.0, ratio=1.0, hardening=0.0
):
    """Return motor and link positions, the torque of the motor and the rate, with gravity and friction of both sides.

    The motor follows a motion exactly; the link turns under gravity, its own friction and the spring, whose torque is
    zero within the gap, and whose stiffness grows by the factor 1 + hardening where it carries 30 N·m. Encoders and
    torque have noise; the second encoder lags by the delay.
    """
    random = np.random.default_rng(seed)
    inertia, weight = random.uniform(1.0, 3.0), random.uniform(15.0, 60.0)
    link_friction, motor_friction, viscous, rotor = random.uniform([1.0, 1.0, 0.5, 0.2], [6.0, 6.0, 3.0, 1.0])
    damping = 2.0 * 0.1 * np.sqrt(stiffness * inertia)
    parts = 10  # steps of integration a row
    h = 1.0 / (rate * parts)
    t = h * np.arange(round(seconds / h))
    speeds, sizes = random.uniform(0.7, 5.0, 5), random.uniform(0.1, 0.35, 5)
    phases = np.multiply.outer(t, speeds) + random.uniform(0, 2 * np.pi, 5)
    theta, speed = np.sin(phases) @ sizes + random.uniform(-0.3, 0.3), np.cos(phases) @ (sizes * speeds)
    acceleration = -np.sin(phases) @ (sizes * speeds**2)
    q, dq, springs = np.empty_like(t), float(speed[0]), np.empty_like(t)
    place = float(theta[0])
    half = backlash / 2
    for k in range(len(t)):
        gap = theta[k] - place
        pressed = gap - min(max(gap, -half), half)
        spring = stiffness * pressed * (1.0 + hardening * (stiffness * pressed / 30.0) ** 2) + (
            damping * (speed[k] - dq) if pressed else 0.0
        )
        q[k], springs[k] = place, spring
        drive = spring - weight * np.sin(place)
        rubbing = min(max(drive + inertia * dq / h, -link_friction), link_friction)  # sticks where it can
        dq += h * (drive - rubbing) / inertia
        place += h * dq
    tau = springs + rotor * acceleration + viscous * speed + motor_friction * np.sign(speed)
    late = np.interp(t - delay, t, q)
    rows = slice(None, None, parts)
    count = len(t[rows])
    return (
        ratio * (theta[rows] + noise * random.normal(size=count)),
        late[rows] + 2e-3 + noise * random.normal(size=count),
        tau[rows] + 0.02 * np.std(tau) * random.normal(size=count),
        rate,
    )
