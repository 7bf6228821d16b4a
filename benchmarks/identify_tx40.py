"""Identify the Stäubli TX40 from its motor-side files: what people do today, and Steelyard, after reading the files.

Today: SciPy filters, Pinocchio's regressor in a Python loop over every sample, friction columns by hand, decimation of
torques and of every regressor column (parallel decimation: Gautier 1997; the tool that published this recording does
the same), NumPy's QR with a tolerance, ordinary least squares. Lean: the same, but the motion is decimated before the
loop. All start from the same raw arrays and end with base parameters and relative error.
"""

import statistics
import sys
import time
from pathlib import Path

import numpy as np
import pinocchio
from scipy.signal import butter, decimate, filtfilt

import steelyard as sy
from steelyard.recording import LogColumns, Processing
from steelyard.robot import RobotFile

ROUNDS = 5
RATE = 5000.0
RATIOS = np.array([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
THRESHOLDS = np.array([0.05009095, 0.05009095, 0.07504916, 0.0715585, 0.05585054, 0.12217305])


def today(urdf: Path, q_motor: np.ndarray, tau_motor: np.ndarray, lean: bool) -> tuple[float, int]:
    """Return relative error and number of base parameters, as commonly programmed."""
    to_motor, to_joint = np.diag(RATIOS), np.diag(RATIOS)
    to_motor[5, 4] = to_joint[4, 5] = RATIOS[5]
    q = q_motor @ np.linalg.inv(to_motor).T + [0, -np.pi / 2, np.pi / 2, 0, 0, 0]
    tau = tau_motor @ to_joint.T
    b, a = butter(4, 100.0 / (RATE / 2))
    q = filtfilt(b, a, q, axis=0)
    dq = np.gradient(q, 1 / RATE, axis=0)
    ddq = np.gradient(dq, 1 / RATE, axis=0)
    if lean:
        q, dq, ddq, tau = map(decimated, (q, dq, ddq, tau))
    W = regressor(urdf, q, dq, ddq)
    if not lean:
        W, dq, tau = map(decimated, (W, dq, tau))
    W, omega = W.reshape(-1, W.shape[2]), tau.ravel()
    keep = (np.abs(dq) > THRESHOLDS).ravel()
    W, omega = W[keep], omega[keep]
    W = W[:, np.linalg.norm(W, axis=0) > 1e-8]
    diagonal = np.abs(np.diag(np.linalg.qr(W, mode="r")))
    W = W[:, diagonal > 1e-6]
    Q, R = np.linalg.qr(W)
    beta = np.linalg.solve(R, Q.T @ omega)
    return float(np.linalg.norm(omega - W @ beta) / np.linalg.norm(omega)), W.shape[1]


def decimated(signal: np.ndarray) -> np.ndarray:
    """Keep every hundredth sample, in two steps, without phase shift."""
    for _ in range(2):
        signal = decimate(signal, 10, axis=0, zero_phase=True)
    return signal


def regressor(urdf: Path, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Return the regressor of links and drives, (S, 6, n)."""
    model = pinocchio.buildModelFromUrdf(str(urdf))
    data = model.createData()
    motor, motor_acceleration = dq[:, 4] + dq[:, 5], ddq[:, 4] + ddq[:, 5]
    each = np.eye(6)
    wrist = np.zeros((len(q), 6, 3))
    wrist[:, 4:] = np.stack([motor, np.sign(motor), motor_acceleration], axis=1)[:, None]
    extra = [dq[:, None] * each, np.sign(dq)[:, None] * each, np.ones_like(dq)[:, None] * each]
    extra.append((ddq[:, None] * each)[:, :, :5])
    rigid = np.array([pinocchio.computeJointTorqueRegressor(model, data, q[s], dq[s], ddq[s]) for s in range(len(q))])
    return np.concatenate([rigid, *extra, wrist], axis=2)


def main() -> None:
    if len(sys.argv) != 2:
        sys.exit("usage: python benchmarks/identify_tx40.py FOLDER_OF_THE_TX40_RECORDING")
    folder = Path(sys.argv[1])
    files = [folder / "raw_q_motor_5khz.csv", folder / "raw_tau_motor_5khz.csv"]
    urdf = folder / "tx40_mdh_modified.urdf"
    q_motor, tau_motor = (np.loadtxt(f, delimiter=",", skiprows=1) for f in files)
    settings = RobotFile.load(Path(__file__).parent.parent / "examples" / "staubli_tx40.toml")
    columns, processing = (
        LogColumns.from_dict(settings.section("log")),
        Processing.from_dict(settings.section("processing")),
    )
    recording = sy.Recording.read(files, columns, joints=6)

    def ours() -> tuple[float, int]:
        model = sy.Model.from_file(RobotFile.load(settings.path))
        information = sy.Information.from_samples(model, recording.process(processing))
        return sy.least_squares(information, weights=None).relative_error, information.base_count

    def usual() -> tuple[float, int]:
        return today(urdf, q_motor, tau_motor, lean=False)

    def lean() -> tuple[float, int]:
        return today(urdf, q_motor, tau_motor, lean=True)

    runs = {"Steelyard": ours, "today": usual, "today, lean": lean}
    results = {name: run() for name, run in runs.items()}  # the first of ours fills the cache of compiled code
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(ROUNDS):
        for name, run in runs.items():
            begin = time.perf_counter()
            run()
            times[name].append(time.perf_counter() - begin)
    print("Stäubli TX40, after reading the files, to base parameters and relative error")
    reference = statistics.median(times["Steelyard"])
    for name, (error, count) in results.items():
        seconds = statistics.median(times[name])
        ratio = seconds / reference
        print(f"{name:12s} {seconds:8.3f} s   ratio {ratio:6.1f}   error {error:.2%}   {count} base parameters")


if __name__ == "__main__":
    main()
