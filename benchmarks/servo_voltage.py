"""Why a servo with a known pendulum seems to have another gain in each recording: torque against voltage.

The torque of a weighed pendulum (README of the recordings: mass, lever, inertia of its free swings) is regressed on
the voltage across the winding, ``duty V - ke dq``, and friction: Coulomb's, by the load, and by the load at low speeds.
Each line adds what may explain that R / kt differs between recordings. Errors are those of recordings that are left
out in turn.

    python benchmarks/servo_voltage.py --data ../shared/data/payload_xl330
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.signal import butter, filtfilt, lfilter

WEIGHT, LINK, INERTIA = 0.4805, 0.0049, 0.0068  # N·m, kg·m² of the load, and with armature as free swings show it
BACK_EMF = 0.44  # V·s/rad, from rows at 5 rad/s and more; what is wrong of it is left to viscous friction
SUPPLY, STEP, CUTOFF, SLOWEST = 7.3, 0.005, 8.0, 0.3  # V, s, Hz, rad/s below which a joint may stick
RUNS = [(gain, run) for gain in (100, 400, 800) for run in ("sin_sin", "up_and_down", "sin_time_square")]
FRICTION = ("sign", "load", "slow load", "speed", "one")
TRIED = {
    "nothing": (),
    "supply as logged in place of 7.3 V": ("supply",),
    "pulses (supply sags by the current in each)": ("pulses",),
    "Coulomb friction by the motor's torque": ("motor load",),
    "friction by the square of the load": ("square load",),
    "heat of the last second": ("heat",),
    "temperature": ("temperature",),
    "torque that falls behind the voltage": ("square",),
    "that and temperature": ("square", "temperature"),
    "behind duty V without back EMF, and temperature": ("applied square", "temperature"),
    "all": ("square", "temperature", "supply", "pulses", "motor load", "square load", "heat"),
}


def columns_of(folder, gain, run):
    """Columns of the regression, and the torque of the pendulum, at rows where it moves."""
    log = np.genfromtxt(folder / f"kp{gain}_{run}.csv", delimiter=",", names=True)
    t = np.arange(log["t"][0], log["t"][-1], STEP)

    def smooth(values, cutoff=CUTOFF):
        return filtfilt(*butter(4, 2 * STEP * cutoff), np.interp(t, log["t"], values))

    q = smooth(log["q"])
    dq = np.gradient(q, STEP)
    ddq = np.gradient(dq, STEP)
    duty, supply, temperature = smooth(log["duty"]), smooth(log["voltage"]), smooth(log["temperature"], 0.5)
    torque, load = WEIGHT * np.sin(q) + INERTIA * ddq, np.abs(WEIGHT * np.sin(q) + LINK * ddq)
    voltage, sign = duty * SUPPLY - BACK_EMF * dq, np.tanh(dq / 0.05)
    found = {
        "voltage": voltage,
        "sign": sign,
        "load": load * sign,
        "slow load": load * sign * np.exp(-np.abs(dq) / 3.0),
        "speed": dq,
        "one": np.ones_like(t),
        "supply": duty * (supply - SUPPLY),
        "pulses": np.abs(duty) * (1.0 - np.abs(duty)) * voltage,
        "motor load": np.abs(voltage) * sign,
        "square load": load**2 * sign,
        "heat": lfilter([STEP], [1.0, -np.exp(-STEP)], voltage**2) * voltage,
        "temperature": (temperature - 28.0) * voltage,
        "square": voltage * np.abs(voltage),
        "applied square": SUPPLY**2 * duty * np.abs(duty),
    }
    used = np.abs(dq) > SLOWEST
    used[:40] = used[-40:] = False  # where filters ring
    return {name: values[used] for name, values in found.items()}, torque[used]


def main():
    """Print errors of recordings that are left out, and R / kt by gain."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder of the recordings")
    folder = parser.parse_args().data
    read = {run: columns_of(folder, *run) for run in RUNS}

    def rows(names, runs):
        matrix = np.vstack([np.column_stack([read[run][0][name] for name in names]) for run in runs])
        return matrix, np.concatenate([read[run][1] for run in runs])

    def fitted(names, runs):
        return np.linalg.lstsq(*rows(names, runs), rcond=None)[0]

    for words, more in TRIED.items():
        names = ("voltage", *more, *FRICTION)
        errors, total = 0.0, 0.0
        for run in RUNS:
            matrix, torque = rows(names, [run])
            left = torque - matrix @ fitted(names, [other for other in RUNS if other != run])
            errors, total = errors + left @ left, total + torque @ torque
        at_gain = [1.0 / fitted(names, [run for run in RUNS if run[0] == gain])[0] for gain in (100, 400, 800)]
        told = "" if "temperature" in more else "; R / kt by gain " + ", ".join(f"{one:.1f}" for one in at_gain)
        print(f"{words:48s} {np.sqrt(errors / total):6.1%}{told}")
    names = ("voltage", "square", "temperature", *FRICTION)
    each = np.array([fitted(names, [other for other in RUNS if other != run]) for run in RUNS])
    spread = np.sqrt((len(RUNS) - 1) / len(RUNS) * np.sum((each - each.mean(axis=0)) ** 2, axis=0))
    pairs = zip(names, fitted(names, RUNS), spread, strict=True)
    print("coefficients (± jackknife by recording):", ", ".join(f"{n} {v:.4f} ± {s:.4f}" for n, v, s in pairs))


if __name__ == "__main__":
    main()
