"""Identification while the robot moves: how fast, how near to the batch fit, and how well a payload is found.

The robot is the seven-joint WAM arm of the thesis with its drives (119 parameters, 76 base parameters), simulated.

    python benchmarks/online.py                    # speed and the batch fit
    python benchmarks/online.py --payloads 100     # so many simulated pick-ups of 2 kg, 5 s each
    python benchmarks/online.py --cycles 15        # 2 kg picked up and put down so many times, 3 s each, after 12 s
"""

import argparse
import time

import numpy as np

import steelyard as sy
from steelyard.estimators import fitting_problems
from steelyard.identification.wam import simulated_log, true_parameters, wam_model
from steelyard.online import simulated_pick_up, watch_pick_up


def speed(seconds):
    """60 s of samples, one by one, and an answer after each ten of them; wall and processor time."""
    model = wam_model()
    log = simulated_log(model, "A", 2014, periods=seconds / 12.5)
    for detect in (False, True):
        estimator = sy.OnlineEstimator(model, detect_changes=detect)
        estimator.estimate()
        answers, updates, late, possible, stopped = [], [], 0, 0, 0
        wall, processor = time.perf_counter(), time.process_time()
        for k, (t, q, torque) in enumerate(zip(log.t, log.q, log.torque, strict=True)):
            begin = time.process_time()
            estimator.update(t, q, torque)
            updates.append(time.process_time() - begin)
            if k % 10 == 9:
                begin = time.process_time()
                answer = estimator.estimate(seconds=0.006)
                answers.append(time.process_time() - begin)
                late += answers[-1] + sum(updates[-10:]) > 0.01
                stopped += answer.rows > 0 and not answer.converged
                possible += estimator.feasible_set.contains(answer.parameters)
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        used = 1e3 * np.array(answers)[30:]
        rows = estimator.information.count
        print(
            f"{'with' if detect else 'without'} the search for changes: {log.t[-1]:.1f} s of {len(log.t)} samples in "
            f"{processor:.1f} s of one core ({wall:.1f} s passed): {log.t[-1] / processor:.2f} times faster than real "
            f"time; {len(answers)} answers, {possible} of them possible, {stopped} not optimal; an update takes "
            f"{1e6 * np.mean(updates):.0f} µs, "
            f"an answer {np.median(used):.1f} ms (99 %: {np.quantile(used, 0.99):.1f}, "
            f"worst {used.max():.1f}); ten updates and an answer took more than 10 ms {late} times; {rows} rows of "
            f"joints and {estimator.stream_counts['received']} samples counted",
            flush=True,
        )


def batch():
    """The answer after trajectory A, and the batch fit of the same samples."""
    model = wam_model()
    samples = simulated_log(model, "A", 2014).process(cutoff=4.8)
    estimator = sy.OnlineEstimator(model, least_speed=0.0)
    # Rows that the log leaves out come as missing torques.
    torque = np.where(samples.mask, samples.torque, np.nan)
    for k in range(samples.count):
        motion = (samples.dq[k], samples.ddq[k])
        estimator.update(k / 1000, samples.q[k], torque[k], *motion)
        if k % 10 == 9:
            estimator.estimate()
    estimator.flush()
    estimator.settle()
    answer = estimator.estimate(accuracy=1e-12)
    info = sy.Information.from_samples(model, samples)
    options = {"weights": answer.weights, "prior": answer.prior, "prior_weight": answer.prior_weight}
    prepared = answer.prior.prepare(estimator.feasible_set, answer.prior_weight)
    reduced = info.reduced(answer.weights)
    variance = reduced.residual2 / (reduced.count - info.base_count)

    def objective(estimate):
        left = reduced.R @ estimate.base - reduced.rho
        distance = prepared.distance(estimate.parameters)
        return (0.5 * float(left @ left) + 0.5 * reduced.residual2) / variance + answer.prior_weight * distance

    def compare(what, other):
        base = np.abs(answer.base - other.base).max() / np.abs(other.base).max()
        torque = np.linalg.norm(reduced.R @ (answer.base - other.base)) / np.linalg.norm(reduced.rho)
        print(
            f"{what}: objective differs by {(objective(answer) - objective(other)) / objective(other):.1e} of itself, "
            f"base parameters by {base:.1e} of the largest, predicted torques by {torque:.1e}",
            flush=True,
        )

    for one, other in zip(estimator.information.factors, info.factors, strict=True):
        products = one.triangle.T @ one.triangle, other.triangle.T @ other.triangle
        difference = np.abs(products[0] - products[1]).max() / np.abs(products[1]).max()
        print(f"Information of {info.joint_names[one.joint]}: {one.count - other.count} rows more, {difference:.1e}")
    compare("sy.fit of the batch Information", sy.fit(info, estimator.feasible_set, **options))
    kept = fitting_problems.ATTEMPTS
    fitting_problems.ATTEMPTS = (fitting_problems.Attempt(accuracy=1e-14), *kept[1:])
    try:
        compare("the same, Clarabel asked for 1e-14", sy.fit(info, estimator.feasible_set, **options))
    finally:
        fitting_problems.ATTEMPTS = kept


def payloads(first, count, mass=2.0, seconds=3.0):
    """How well payloads are found."""
    errors, inside, widths, delays, changes, begin = [], [], [], [], [], time.process_time()
    for seed in range(first, first + count):
        run = watch_pick_up(simulated_pick_up(seed, mass=mass, when=25.0, duration=25.0 + seconds))
        found, truth = run.at(seconds), run.simulated.payload
        changes.append(len(run.changes))
        if found is None:
            errors.append(1.0)
            inside.append([False] * 10)
            continue
        values = {"mass": truth.mass, **{f"c{a}": c for a, c in zip("xyz", truth.com, strict=True)}}
        for i, a in enumerate("xyz"):
            values |= {f"I{a}{b}": truth.about_com[i, j] for j, b in enumerate("xyz") if j >= i}
        errors.append(abs(found.mass / mass - 1.0))
        inside.append([value in found[name] for name, value in values.items()])
        widths.append((found["mass"].upper - found["mass"].lower) / 2)
        delays.append(run.times[0])
    held = np.sum(inside, axis=0)
    print(
        f"{mass:g} kg after {seconds:g} s: to 5 % in {np.sum(np.array(errors) < 0.05)} of {count} (median "
        f"{np.median(errors):.2%}, worst {max(errors):.2%}), half of the interval {np.median(widths):.3f} kg; "
        f"inside: mass {held[0]}, centre {held[1]} {held[2]} {held[3]}, inertia {' '.join(map(str, held[4:]))}; "
        f"first answer after {np.median(delays):.2f} s; one change noticed in {np.sum(np.array(changes) == 1)}; "
        f"{(time.process_time() - begin) / count:.1f} s each",
        flush=True,
    )


def cycles(seed, count, seconds=3.0, alone=12.0, mass=2.0):
    """How an arm that picks and places goes on learning: what is noticed, and how well the bare arm is known."""
    model, true, random = wam_model(), true_parameters(), np.random.default_rng(seed)
    t = np.arange(round(1000 * (alone + 2 * count * seconds))) / 1000
    paces, sizes = 2 * np.pi * random.uniform(0.05, 0.6, (5, 7)), random.uniform(0.1, 0.4, (5, 7))
    shifts = random.uniform(0, 2 * np.pi, (5, 7))
    q, dq, ddq = np.zeros((3, len(t), 7))
    for pace, size, shift in zip(paces, sizes, shifts, strict=True):
        wave = pace * t[:, None] + shift
        q += size * np.sin(wave)
        dq += size * pace * np.cos(wave)
        ddq -= size * pace**2 * np.sin(wave)
    loaded = true.copy()
    loaded[np.asarray(model.link_columns[-1])] += sy.Inertia.from_com(
        mass, [0.02, 0.01, 0.1], 0.01 * np.eye(3)
    ).parameters
    carries = (t >= alone) & (np.floor((t - alone) / seconds) % 2 == 0)
    torque = np.where(carries[:, None], *(model.inverse_dynamics(q, dq, ddq, p) for p in (loaded, true)))
    torque += 0.05 * np.sqrt(np.mean(torque**2, axis=0)) * random.normal(size=q.shape)
    q = q + 1e-5 * random.normal(size=q.shape)
    elsewhere = [random.uniform(-1, 1, (300, 7)) * size for size in (1.5, 1.0, 3.0)]
    truth = model.inverse_dynamics(*elsewhere, true)
    estimator = sy.OnlineEstimator(model, detect_changes=True)
    payload, errors, masses, inside, told = sy.OnlinePayload(estimator), [], [], 0, 0
    ends = [alone, *(alone + seconds * (k + 1) for k in range(2 * count))]
    for number, (begin, end) in enumerate(zip([0.0, *ends], ends, strict=False)):
        for start in range(round(1000 * begin), round(1000 * end), 10):
            estimator.update(*(one[start : start + 10] for one in (t, q, torque)))
        found = payload.estimate()
        if number % 2:
            masses.append(abs(found.mass / mass - 1.0) if found else 1.0)
            inside += found is not None and mass in found["mass"]
        else:
            predicted = model.inverse_dynamics(*elsewhere, estimator.estimate().parameters)
            errors.append(np.linalg.norm(predicted - truth) / np.linalg.norm(truth))
            told += found is not None and 0.0 not in found["mass"]
    print(
        f"seed {seed}, {count} times {mass:g} kg for {seconds:g} s: {estimator.change_count} of {2 * count} changes "
        f"noticed; torques of the bare arm to {errors[0]:.2%} at first, {errors[-1]:.2%} at last, "
        f"{max(errors):.2%} at worst; mass to {np.median(masses):.2%} (worst {max(masses):.2%}), in its interval "
        f"{inside} times; told of an arm that carries nothing: {told} times",
        flush=True,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--payloads", type=int, default=0)
    parser.add_argument("--cycles", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="seed of the first pick-up")
    arguments = parser.parse_args()
    if arguments.payloads:
        payloads(arguments.first, arguments.payloads)
    elif arguments.cycles:
        for seed in range(arguments.first, arguments.first + 5):
            cycles(seed, arguments.cycles)
    else:
        batch()
        speed(arguments.seconds)
