"""A fleet whose robots repeat their programmes: what the model misses returns with each period and tells no more."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import steelyard as sy
from steelyard.fleet import DataSet, FleetManifest, data_sets, identify_fleet, reduce_data_sets
from steelyard.identification.log_reader import LogTask
from steelyard.robot import RobotFile

from .conftest import ROBOT

WITH_FRICTION = ROBOT + '\n[[terms]]\nkind = "viscous"\n'
PERIOD, PERIODS, RATE = 4.0, 10, 200.0
INERTIA, FRICTION, RIPPLE, NOISE = 0.3, 0.4, 0.15, 0.05


def programme(seed: int) -> Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], ...]]:
    """Position, velocity and acceleration of a motion of four seconds."""
    random = np.random.default_rng(seed)
    w = 2.0 * np.pi / PERIOD * np.array([1.0, 2.0, 3.0])
    a, b = random.normal(size=(2, 2, 3)) * [0.8, 0.4, 0.2]

    def at(t: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        s, c = np.sin(t[:, None, None] * w), np.cos(t[:, None, None] * w)
        q = np.sum(a * s + b * c, axis=2)
        return q, np.sum(w * (a * c - b * s), axis=2), -np.sum(w**2 * (a * s + b * c), axis=2)

    return at


def torques(q: NDArray[np.float64], dq: NDArray[np.float64], ddq: NDArray[np.float64]) -> NDArray[np.float64]:
    """A point mass of 2 kg on a rod of 0.5 m, which a first joint turns about the vertical: by Lagrange."""
    own, moment, turned = 0.5, 0.5 * np.cos(q[:, 1]) ** 2, -0.5 * np.sin(2.0 * q[:, 1])  # m l², and how it changes
    first = (INERTIA + moment) * ddq[:, 0] + turned * dq[:, 0] * dq[:, 1]
    second = own * ddq[:, 1] - 0.5 * turned * dq[:, 0] ** 2 + 9.81 * np.cos(q[:, 1])
    return np.column_stack([first, second]) + FRICTION * dq


@pytest.fixture
def written(tmp_path: Path) -> Callable[..., Path]:
    """Writes the logs of some robots, each of a programme, whose torques ripple with their positions."""
    (tmp_path / "robot.toml").write_text(WITH_FRICTION)

    def write(programmes: list[int], phase: Callable[[int], float]) -> Path:
        t = np.arange(round(PERIOD * PERIODS * RATE)) / RATE
        lines = ["id,robot,logs"]
        for number, seed in enumerate(programmes):
            q, dq, ddq = programme(seed)(t)
            tau = torques(q, dq, ddq) + RIPPLE * np.sin(9.0 * q + phase(number))
            tau += NOISE * np.random.default_rng([7, number]).normal(size=q.shape)
            table = np.column_stack([t, q, dq, ddq, tau])
            names = ",".join(["t", *(f"{one}{k}" for one in ("q", "dq", "ddq", "tau") for k in (1, 2))])
            np.savetxt(tmp_path / f"{number}.csv", table, delimiter=",", header=names, comments="", fmt="%.9g")
            lines.append(f"R{number},robot.toml,{number}.csv")
        (tmp_path / "fleet.csv").write_text("\n".join(lines))
        return tmp_path / "fleet.csv"

    return write


@pytest.mark.slow
def test_a_sound_robot_of_another_programme_is_not_named(written: Callable[..., Path]) -> None:
    """All robots have the same ripple, which draws the estimates of each programme elsewhere."""
    fleet = identify_fleet(written([1] * 7 + [2], lambda _: 0.3))
    assert fleet.findings == ()
    group = fleet.groups[0].siblings
    assert group is not None
    assert group.robot_probability.min() > 0.05


@pytest.mark.slow
def test_estimates_are_as_far_off_as_is_said_and_reduced_logs_say_the_same(written: Callable[..., Path]) -> None:
    manifest = FleetManifest.load(written([*range(1, 9)], lambda number: 2.4 * number))
    model = sy.Model.load(manifest.path.parent / "robot.toml")
    names = [str(name) for name in model.parameter_names]
    values = np.zeros(model.parameter_count)
    # Standard DH: the mass is in the origin of the second frame; the first link only turns.
    for name, value in {"Lyy1": INERTIA, "m2": 2.0, "Fvj1": FRICTION, "Fvj2": FRICTION}.items():
        values[names.index(name)] = value
    true = model.base_parameters().values(values)
    rows = identify_fleet(manifest).rows
    off = np.array([(row.values["base"] - true) ** 2 / np.diagonal(row.values["covariance"]) for row in rows])
    assert 0.3 < float(np.sqrt(np.mean(off))) < 1.3  # 4.9 where each period counted
    robot, log = manifest.entries[0].robot, manifest.entries[0].logs[0]
    [reduced] = reduce_data_sets([DataSet(robot, [log])])
    reduced.save(manifest.path.parent / "reduced.json")
    again = sy.regression.ParameterCovariance.of(sy.Information.load(manifest.path.parent / "reduced.json"))
    assert again.matrix == pytest.approx(rows[0].values["covariance"], rel=1e-9)


@pytest.mark.slow
def test_of_many_logs_few_rows_are_kept(written: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of 400 logs kept up to 32 768 rows, 3 GB of seven joints."""
    folder, kept = written([1], lambda _: 0.0).parent, []

    def reduced(reader: object, task: LogTask, model: object) -> None:
        kept.append(task.rows)
        raise sy.InputError("enough")

    for number in range(1, 400):
        (folder / f"{number}.csv").hardlink_to(folder / "0.csv")
    monkeypatch.setattr(data_sets.LogReader, "reduced", reduced)
    logs = [str(folder / f"{number}.csv") for number in range(400)]
    file, model = RobotFile.load(folder / "robot.toml"), sy.Model.load(folder / "robot.toml")
    with pytest.raises(sy.InputError, match="none of 400 logs can be used; of the last: enough"):
        data_sets.reduced_logs(file, model, logs, left_out={})
    assert len(kept) == 400
    assert sum(kept) <= 120_000
