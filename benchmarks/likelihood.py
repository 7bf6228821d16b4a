"""Maximum likelihood beside least squares: whether standard errors are right, and how near the bound estimates are.

An arm of three joints with friction moves; its torques have noise that is white, that follows an autoregressive model
of each joint with innovations that joints share, or that lasts with white noise on it, which no such model is:
`lasting` is shared by the joints as a whole, of `partly shared` noise only what lasts. Errors of the base parameters
are taken over many seeds: whether their 95 % intervals hold the truth, and their variance over the bound of Cramér and
Rao for the true noise. `--masked` leaves out the rows of each joint near its standstill.

    python benchmarks/likelihood.py                     # 200 seeds of each noise
    python benchmarks/likelihood.py --seeds 20 --noises autoregressive
"""

import argparse
import time

import numpy as np
from scipy.linalg import block_diag, solve_triangular, toeplitz
from scipy.signal import lfilter

import steelyard as sy
from steelyard.estimators import likelihood_information

RATE, SECONDS = 100.0, 20.0
SIZES = np.array([1.0, 0.6, 0.2])
"""Standard deviations of the innovations, N·m."""
SHARED = np.array([[1.0, 0.6, -0.3], [0.6, 1.0, 0.4], [-0.3, 0.4, 1.0]])
COEFFICIENTS = ([0.9], [1.2, -0.4], [0.6, 0.2])
"""Of the last values of each joint."""
LASTING, WHITE = 0.95, 0.7
STANDSTILL = 0.1


def arm():
    """Model and true parameters of an arm with three joints and friction."""
    robot = sy.Robot.from_dh(
        [("-pi/2", 0.0, 0.3, "q"), (0, 0.4, 0.0, "q"), (0, 0.3, 0.0, "q")], gravity=(0, 0, -9.81), name="arm"
    ).with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset())
    model = sy.Model(robot)
    random = np.random.default_rng(0)
    truth = np.empty(model.parameter_count)
    for columns, mass in zip(model.link_columns, (5.0, 3.0, 1.5), strict=True):
        com = random.normal(size=3) * 0.1
        shape = random.normal(size=(3, 3)) * 0.1
        about = mass * (shape @ shape.T)
        truth[columns] = sy.Inertia.from_com(mass, com, np.trace(about) * np.eye(3) - about).parameters
    for index, name in enumerate(map(str, model.parameter_names)):
        if name.startswith("F"):
            truth[index] = 0.3 * random.normal() if name.startswith("Fo") else random.uniform(0.5, 2.0)
    return model, truth


def motion(model, seed=0):
    """Time, positions, velocities, accelerations."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, SECONDS, 1.0 / RATE)
    q, dq, ddq = np.zeros((3, len(t), model.dof))
    for k in range(model.dof):
        for number in range(1, 6):
            w = 2 * np.pi * 0.1 * number * (1 + 0.05 * k)
            a, b = random.normal(size=2) * 0.6 / np.sqrt(number)
            q[:, k] += a * np.sin(w * t) + b * np.cos(w * t)
            dq[:, k] += w * (a * np.cos(w * t) - b * np.sin(w * t))
            ddq[:, k] -= w * w * (a * np.sin(w * t) + b * np.cos(w * t))
    return t, q, dq, ddq


def noise_of(kind, random, count):
    """Noise (count, 3) of that kind."""
    root = np.linalg.cholesky(SHARED if kind != "white" else np.eye(3))
    settle = 400
    drive = random.normal(size=(count + settle, 3)) @ root.T * SIZES
    if kind == "white":
        return drive[settle:]
    if kind == "autoregressive":
        filters = [[1.0, *(-np.array(own))] for own in COEFFICIENTS]
        made = np.column_stack([lfilter([1.0], own, drive[:, k]) for k, own in enumerate(filters)])
        return made[settle:]
    lasting = lfilter([np.sqrt(1 - LASTING**2)], [1.0, -LASTING], drive, axis=0)
    white = random.normal(size=(count, 3))
    return lasting[settle:] + WHITE * (white @ root.T if kind == "lasting" else white) * SIZES


def covariance_of(kind, count):
    """The covariance of all rows, joint by joint, (3 count, 3 count)."""
    if kind == "white":
        return block_diag(*[size**2 * np.eye(count) for size in SIZES])
    impulse = np.zeros(2000)
    impulse[0] = 1.0
    if kind == "autoregressive":
        responses = [lfilter([1.0], [1.0, *(-np.array(c))], impulse) for c in COEFFICIENTS]
    else:
        responses = [lfilter([np.sqrt(1 - LASTING**2)], [1.0, -LASTING], impulse)] * 3
    blocks = []
    for i in range(3):
        row = []
        for j in range(3):
            both = np.correlate(responses[i], responses[j], "full") * SHARED[i, j] * SIZES[i] * SIZES[j]
            middle = len(impulse) - 1
            ahead, behind = np.zeros((2, count))
            most = min(count, len(impulse))
            ahead[:most], behind[:most] = both[middle : middle + most], both[middle::-1][:most]
            part = toeplitz(ahead, behind)  # element (s, t) is the covariance of joint i at s and joint j at t
            if kind == "lasting":
                part = part + WHITE**2 * SHARED[i, j] * SIZES[i] * SIZES[j] * np.eye(count)
            if kind == "partly shared" and i == j:
                part = part + (WHITE * SIZES[i]) ** 2 * np.eye(count)
            row.append(part)
        blocks.append(row)
    return np.block(blocks)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--noises", default="white,autoregressive,lasting,partly shared")
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--masked", action="store_true", help="leave out the rows near standstill")
    options = parser.parse_args()
    model, truth = arm()
    t, q, dq, ddq = motion(model)
    torque, base = model.inverse_dynamics(q, dq, ddq, truth), model.base_parameters().values(truth)
    regressor = np.asarray(model.regressor(q, dq, ddq)) @ model.base_parameters().Pb
    mask = np.abs(dq) > STANDSTILL if options.masked else np.ones(dq.shape, dtype=bool)
    used = mask.T.ravel()
    print(f"{len(base)} base parameters, {mask.sum()} of {mask.size} rows of 3 joints, {options.seeds} seeds")
    for kind in options.noises.split(","):
        root = np.linalg.cholesky(covariance_of(kind, len(t))[np.ix_(used, used)])
        white = solve_triangular(root, np.concatenate([regressor[:, k] for k in range(3)])[used], lower=True)
        bound = np.diag(np.linalg.inv(white.T @ white))
        errors, sizes, seconds, orders = {}, {}, {}, []
        for seed in range(options.seeds):
            random = np.random.default_rng([seed, 1])
            given = torque + noise_of(kind, random, len(t))
            samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=given, t=t, mask=None if mask.all() else mask)
            plain = sy.Information.from_samples(model, samples)
            begun = time.process_time()
            found = {"ordinary": sy.least_squares(plain, None), "joint-weighted": sy.least_squares(plain)}
            middle = time.process_time()
            information = likelihood_information(model, samples)
            found["maximum likelihood"] = sy.least_squares(information)
            took = {"ordinary": middle - begun, "joint-weighted": middle - begun}
            took["maximum likelihood"] = time.process_time() - middle
            orders.append(information.noise.orders)
            for name, estimate in found.items():
                errors.setdefault(name, []).append(estimate.base - base)
                sizes.setdefault(name, []).append(estimate.standard_error)
                seconds.setdefault(name, []).append(took[name])
        print(f"{kind} noise (orders {np.median(orders, axis=0).astype(int).tolist()} in the median)")
        for name in errors:
            error, size = np.array(errors[name]), np.array(sizes[name])
            inside = np.mean(np.abs(error) <= 1.959964 * size)
            ratio = np.mean(error**2, axis=0) / bound
            over = np.sqrt(np.mean(size**2 / np.mean(error**2, axis=0)))
            print(
                f"  {name:19} variance over the bound: mean {ratio.mean():.2f}, worst {ratio.max():.2f}; intervals "
                f"hold {100 * inside:.1f} %; standard error over true {over:.2f}; "
                f"{1e3 * np.median(seconds[name]):.0f} ms",
                flush=True,
            )


if __name__ == "__main__":
    main()
