"""Dynamics beside Pinocchio, MuJoCo, CasADi and SymPyBotics: time a sample, operations, and time to compile.

Every peer computes the same robot with the same parameters on one thread; ours too, unless said. Times are the least
of several rounds in which all take turns.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
import peers

import steelyard as sy

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "oracles"))
from published_arms import PUMA_ROWS, STANFORD_ROWS, WAM_ROWS

ARMS = {"WAM": WAM_ROWS, "Puma 560": PUMA_ROWS, "Stanford arm": STANFORD_ROWS}
# Thesis table 7.1: additions and multiplications of inverse dynamics.
TABLE_7_1 = {"WAM": (493, 626), "Puma 560": (454, 576), "Stanford arm": (393, 477)}
# SymPyBotics with these rows: inverse dynamics with all the parameters, with squares; with base parameters, without
# squares; the regressor, with squares.
SYMPYBOTICS = {"WAM": (1051, 879, 2301), "Puma 560": (904, 548, 1700), "Stanford arm": (810, 466, 1092)}
URDFS = {
    "Panda": ("panda_description/urdf/panda.urdf", ("panda_finger_joint1", "panda_finger_joint2")),
    "Talos": ("talos_data/robots/talos_reduced.urdf", ()),
}
CACHE = 512 * 1024  # bytes
HUMANOID = "human_description/robots/human.urdf"

COMPILED = (
    "inverse_dynamics",
    "gravity",
    "coriolis",
    "coriolis_matrix",
    "inertia_matrix",
    "forward_dynamics",
    "drive_torque",
    "regressor",
)
FRESH = """
import sys, time
began = time.perf_counter()
import numpy, llvmlite.binding, steelyard as sy, steelyard.dynamics
imported = time.perf_counter()
robot = sy.Robot.from_dh({rows!r}) if {rows!r} else sy.Robot.from_urdf({path!r})
model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))
for name in {names!r}:
    model.kernel(name).batch_function
model.base_columns.kernel.batch_function
print(imported - began, time.perf_counter() - imported)
"""


def collection():
    """Return the folder of example-robot-data, or None."""
    try:
        import pinocchio
    except ImportError:
        return None
    for place in pinocchio.__path__:
        for parent in Path(place).parents:
            folder = parent / "share" / "example-robot-data" / "robots"
            if folder.is_dir():
                return folder
    return None


def possible_parameters(count, random):
    """Return parameters of links that could be built: a few masses around each origin."""
    delta = []
    for _ in range(count):
        masses, places = random.uniform(0.2, 1.0, 8), random.normal(0.0, 0.1, (8, 3))
        first = masses @ places
        second = places.T @ (masses[:, None] * places)
        inertia = np.trace(second) * np.eye(3) - second
        delta += [*inertia[np.triu_indices(3)], *first, masses.sum()]
    return np.array(delta)


def cases(samples):
    """Yield name, case and DH rows of every robot."""
    random = np.random.default_rng(0)
    for name, rows in ARMS.items():
        yield name, make_case(sy.Robot.from_dh(rows, name=name), samples, random), rows
    folder = collection()
    if folder is None:
        print("example-robot-data is not installed: no robots from URDFs")
        return
    for name, (path, locked) in URDFS.items():
        yield name, make_case(sy.Robot.from_urdf(folder / path, locked=locked), samples, random), None


def make_case(robot, samples, random):
    q, dq, ddq, tau = random.normal(size=(4, samples, robot.dof))
    delta = np.asarray(robot.parameters, dtype=float)
    if not np.isfinite(delta).all():
        delta = possible_parameters(len(robot.links), random)
    return peers.Case(sy.Model(robot), delta, q, dq, ddq, tau)


def ours(case, function, *, threads=1, compact=False):
    """Return our batch kernel, which writes into an array that is there."""
    kernel, arrays = case.model.kernel(function), case.arguments(function)
    if compact:
        kernel = sy.graph.Kernel(case.model.function(function), compact=True)
    out = np.empty((len(case.q), kernel.width))
    return lambda: kernel(*arrays, out=out, threads=threads)


def batch_size(case, function):
    """Return so many samples that what is written stays in the cache."""
    width = case.model.kernel(function).width
    return min(len(case.q), max(64, CACHE // (8 * width) // 8 * 8))


def available(case, function, rows, missing):
    """Return the peers that are installed and have the function: what computes it, and for how many samples."""
    loops = max(32, len(case.q) // 16)
    builders = {
        "Pinocchio, Python loop": (peers.pinocchio_loop, loops),
        "Pinocchio, batch in C++": (peers.pinocchio_batch, len(case.q)),
        "MuJoCo, Python loop": (peers.mujoco_loop, loops),
        "MuJoCo, rollout in C++": (peers.mujoco_rollout, loops),
        "CasADi, map": (peers.casadi_map, loops),
        "our graph as CasADi's C, compiled": (peers.casadi_c, len(case.q)),
    }
    if rows is not None:
        builders["SymPyBotics, C by a compiler"] = (partial(peers.sympybotics_c, rows=rows), len(case.q))
    found = {}
    for name, (build, count) in builders.items():
        try:
            action = build(case.few(count), function)
        except ImportError as error:
            missing.add(f"{name}: {error}")
            continue
        if action is not None:
            found[name] = (action, count)
    return found


def agree(case, function, found):
    """Check that peers with the same form of output compute the same."""
    if function not in ("inverse_dynamics", "forward_dynamics"):
        return
    expected = case.model.kernel(function)(*case.arguments(function))
    for name in ("Pinocchio, Python loop", "our graph as CasADi's C, compiled", "SymPyBotics, C by a compiler"):
        if name in found:
            values = np.asarray(found[name][0]())
            assert np.allclose(values, expected[: len(values)], rtol=1e-7, atol=1e-7), (name, function)
    if "MuJoCo, Python loop" in found:
        action, count = found["MuJoCo, Python loop"]
        error = np.abs(action() - expected[count - 1]).max() / np.abs(expected[count - 1]).max()
        if error > 1e-6:
            print(f"  MuJoCo changed inertias that it does not accept; its result differs by {100 * error:.1g} %")


def processor_times(actions, rounds):
    """Return the least time on the clock and the least time of processors of each action, all taking turns."""
    best = [[float("inf")] * 2 for _ in actions]
    for action in actions:
        action()
    for _ in range(rounds):
        for row, action in zip(best, actions, strict=True):
            clock, processor = time.perf_counter(), time.process_time()
            action()
            for k, spent in enumerate((time.perf_counter() - clock, time.process_time() - processor)):
                row[k] = min(row[k], spent)
    return best


def least(actions, rounds):
    """Return the least time on the clock of each action, all taking turns."""
    return [clock for clock, _ in processor_times(actions, rounds)]


def times(samples, rounds):
    """Print ns a sample of every function, robot and peer, and how many times longer than ours."""
    print("ns a sample (how many times ours)")
    missing = set()
    for name, whole, rows in cases(samples):
        print(f"\n{name}, {whole.robot.dof} joints")
        for function in peers.FUNCTIONS:
            case = whole.few(batch_size(whole, function))
            count = len(case.q)
            found = available(case, function, rows, missing)
            agree(case, function, found)
            if function == "regressor":
                found = {"ours, without the zeros": (ours(case, function, compact=True), count)} | found
            row = {"ours": (ours(case, function), count)} | found
            measured = least([action for action, _ in row.values()], rounds)
            own, *others = (1e9 * t / n for t, (_, n) in zip(measured, row.values(), strict=True))
            print(f"  {function}, {count} samples: ours {own:.1f}")
            for peer, each in zip(found, others, strict=True):
                print(f"    {peer:30s} {each:9.0f}  ({each / own:.1f})")
    for line in sorted(missing):
        print(f"left out: {line}")


def threads(samples, rounds):
    """Print how much faster two threads are with large batches.

    Where others use the machine, the clock tells little; that two threads together need hardly more of the processors
    than one tells how much faster they are where two are free.
    """
    print("\ntwo threads, large batches: times faster by the clock (at most, by the time of the processors)")
    for name, whole, _ in cases(64 * samples):
        print(f"  {name:13s}", end="")
        for function in peers.FUNCTIONS:
            case = whole.few(128 * CACHE // (8 * whole.model.kernel(function).width))
            (one, alone), (two, both) = processor_times(
                [ours(case, function), ours(case, function, threads=2)], 2 * rounds
            )
            print(f"  {function} {one / two:.2f} ({2 * alone / both:.2f})", end="")
        print()


def every_size(samples, rounds):
    """Print how many times faster the regressor of a batch is than Pinocchio's loop, at every size."""
    print(
        "\nregressor from Python: ns a sample by the clock and of the processor, in brackets how many times faster than"
    )
    print("Pinocchio's loop by each; page faults a call")
    for name, whole, _ in cases(64 * samples):
        sizes = [k for k in (1, 2, 4, 8, 9, 16, 64, 256, 1024, 4096, 16384, 65536, 131072) if k <= len(whole.q)]
        width = whole.model.kernel("regressor").width
        sizes = [k for k in sizes if 8 * k * width <= 640 << 20]  # bytes
        try:
            loop = peers.pinocchio_loop(whole.few(256), "regressor")
        except ImportError:
            print("  Pinocchio is not installed")
            return
        peer = [t / 256 for t in processor_times([loop], 3 * rounds)[0]]
        print(f"  {name}: Pinocchio {1e9 * peer[0]:.0f} by the clock, {1e9 * peer[1]:.0f} of the processor")
        for size in sizes:
            case = whole.few(size)
            out = np.zeros((size, whole.robot.dof, len(whole.delta)))
            repeats = max(1, 400 // size)

            def call(case=case, repeats=repeats, out=None):
                for _ in range(repeats):
                    case.model.regressor(case.q, case.dq, case.ddq, out=out)

            measured = processor_times([call, partial(call, out=out)], max(rounds, min(200, 20000 // size)))
            faults = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
            call()
            faults = (resource.getrusage(resource.RUSAGE_SELF).ru_minflt - faults) / repeats
            print(f"    {size:7d} samples", end="")
            for what, row in zip((": ", ", with out "), measured, strict=True):
                clock, processor = (1e9 * t / (size * repeats) for t in row)
                times_faster = f"{1e9 * peer[0] / clock:.1f}, {1e9 * peer[1] / processor:.1f}"
                print(f"{what}{clock:6.0f} {processor:6.0f} ({times_faster})", end="")
            print(f"; {faults:.0f}")


def single_samples(rounds):
    """Print ns of one call from Python for one sample, ours and Pinocchio's."""
    print("\nns a call for one sample from Python: ours, with out, Pinocchio (how many times ours)")
    for name, case, _ in cases(1):
        model = case.model
        q, dq, ddq, tau = case.q[0], case.dq[0], case.ddq[0], case.tau[0]
        given = {
            "inverse_dynamics": (q, dq, ddq, case.delta),
            "gravity": (q, case.delta),
            "inertia_matrix": (q, case.delta),
            "forward_dynamics": (q, dq, tau, case.delta),
            "regressor": (q, dq, ddq),
        }
        theirs = pinocchio_calls(case)
        print(f"  {name}")
        for function, arguments in given.items():
            for _ in range(200):  # from the hundredth call on, machine code stands in the place of the method
                out = np.empty_like(getattr(model, function)(*arguments))
            method = getattr(model, function)
            actions = [partial(method, *arguments), partial(method, *arguments, out=out), theirs.get(function, int)]

            def repeat(call):
                def calls():
                    for _ in range(500):
                        call()

                return calls

            new, into, peer = (1e9 * t / 500 for t in least([repeat(action) for action in actions], 3 * rounds))
            print(f"    {function:18s} {new:6.0f} {into:6.0f} {peer:6.0f}  ({peer / new:.1f})")


def pinocchio_calls(case):
    """Return Pinocchio's calls for the first sample, by the names of our functions."""
    try:
        import pinocchio
    except ImportError:
        return {}
    model = peers.pinocchio_model(case)
    data, q, dq, ddq, tau = model.createData(), case.q[0], case.dq[0], case.ddq[0], case.tau[0]
    return {
        "inverse_dynamics": partial(pinocchio.rnea, model, data, q, dq, ddq),
        "gravity": partial(pinocchio.computeGeneralizedGravity, model, data, q),
        "inertia_matrix": partial(pinocchio.crba, model, data, q),
        "forward_dynamics": partial(pinocchio.aba, model, data, q, dq, tau),
        "regressor": partial(pinocchio.computeJointTorqueRegressor, model, data, q, dq, ddq),
    }


def operations():
    """Print additions and multiplications beside those published."""
    print("\noperations: additions + multiplications, rigid links")
    for name, rows in ARMS.items():
        model = sy.Model(sy.Robot.from_dh(rows))
        additions, multiplications = TABLE_7_1[name]
        everything, base, regressor = SYMPYBOTICS[name]

        def total(function, *, squares=True, in_base=False, model=model):
            recorded = model.function(function, base=in_base)
            count = recorded.operation_count["add"] + recorded.operation_count["mul"]
            return count if squares else count - square_count(recorded)

        table = (
            ("inverse dynamics, all parameters", total("inverse_dynamics"), everything),
            ("  base parameters, no squares", total("inverse_dynamics", squares=False, in_base=True), base),
            ("regressor", total("regressor"), regressor),
        )
        print(f"  {name}; thesis, table 7.1: {additions} + {multiplications} = {additions + multiplications}")
        for what, mine, theirs in table:
            print(f"    {what:34s} ours {mine:5d}   SymPyBotics {theirs:5d}   {mine / theirs:.3f}")


def square_count(function):
    """Return how many multiplications of a function are squares."""
    seen, stack = {}, list(function.nodes)
    while stack:
        node = stack.pop()
        if node.index not in seen:
            seen[node.index] = node
            stack.extend(node.arguments)
    return sum(n.operation == "mul" and n.arguments[0] is n.arguments[1] for n in seen.values())


def compile_times(rounds):
    """Print the time from the description to all the compiled kernels, in fresh processes."""
    print(f"\ns from the description to {len(COMPILED) + 1} compiled kernels (imports apart)")
    robots = {"WAM": (WAM_ROWS, None)}
    folder = collection()
    if folder is not None:
        robots["humanoid, 36 joints"] = (None, str(folder / HUMANOID))
    for name, (rows, path) in robots.items():
        script = FRESH.format(rows=rows, path=path, names=COMPILED)
        cold, warm, imports = [], [], []
        for _ in range(rounds):
            with tempfile.TemporaryDirectory() as cache:
                for target in (cold, warm):
                    environment = os.environ | {"STEELYARD_CACHE_DIR": cache, "STEELYARD_CACHE": "on"}
                    run = subprocess.run(
                        [sys.executable, "-W", "ignore", "-c", script],
                        env=environment, capture_output=True, text=True, check=True,
                    )  # fmt: skip
                    importing, making = map(float, run.stdout.split())
                    imports.append(importing)
                    target.append(making)
        print(f"  {name:20s} cold {min(cold):.3f}   warm {min(warm):.3f}   imports {min(imports):.3f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=2048)
    parser.add_argument("--rounds", type=int, default=15)
    parts = {
        "times": lambda: times(options.samples, options.rounds),
        "threads": lambda: threads(options.samples, options.rounds),
        "sizes": lambda: every_size(options.samples, options.rounds),
        "calls": lambda: single_samples(options.rounds),
        "operations": operations,
        "compile": lambda: compile_times(3),
    }
    parser.add_argument("--only", nargs="+", choices=parts, default=list(parts), help="parts to run, all by default")
    options = parser.parse_args()
    for part in options.only:
        parts[part]()


if __name__ == "__main__":
    main()
