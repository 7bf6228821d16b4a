"""Logs that share rows, as the parts of one recording may, count these twice; two runs of one motion share none."""

import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import steelyard as sy


def overlaps(path: Path, logs: list[Path], **options: object) -> list[str]:
    remarks = sy.identify(path, list(map(str, logs)), **options).remarks
    return [remark for remark in remarks if "are rows of" in remark]


@pytest.mark.slow
@pytest.mark.parametrize("periods", [1.0, pytest.param(30.0, marks=pytest.mark.slow)])  # all rows are kept, or extremes
@pytest.mark.parametrize("role", ["fit", pytest.param("validation", marks=pytest.mark.slow)])
def test_shared_rows_are_told(elbow, simulation, role, periods):
    path, model, folder = elbow
    table = pl.read_csv(simulation.record(model, folder / "whole.csv", seed=1, periods=periods))
    count, (begin, end) = len(table), (int(0.4 * len(table)), int(0.7 * len(table)))
    parts = [folder / "part0.csv", folder / "part1.csv"]
    table[:end].write_csv(parts[0])
    table[begin:].write_csv(parts[1])
    told = overlaps(path, parts) if role == "fit" else overlaps(path, parts[:1], validate=[str(parts[1])])
    assert len(told) == 1
    found = re.search(r"part1\.csv: rows from t = (\S+) to (\S+) s are rows of .*part0\.csv, too, and (\w+)", told[0])
    assert found is not None
    assert found[3] == ("count" if role == "fit" else "were")
    first, last = table["t"][begin], table["t"][end - 1]
    assert first <= float(found[1]) < first + 1.0 + 0.05 * count / 200.0  # half a second is trimmed
    assert last - 1.0 - 0.05 * count / 200.0 < float(found[2]) <= last
    table[:begin].write_csv(parts[0])
    assert overlaps(path, parts) == []


@pytest.mark.slow
def test_runs_of_one_motion_share_no_rows(elbow, simulation):
    """Encoders and torques with coarse steps, the same stamps, and rests with equal numbers in both."""
    path, model, folder = elbow
    table, logs = pl.read_csv(simulation.record(model, folder / "whole.csv", seed=1)), []
    rest = pl.concat([table[:1]] * 400)
    for run in range(2):
        random = np.random.default_rng(run)
        both = pl.concat([rest, table, rest]).with_columns(t=np.arange(len(table) + 800) / 200.0)
        noisy = {f"q{k}": both[f"q{k}"] + random.normal(scale=2e-4, size=len(both)) for k in (1, 2, 3)}
        noisy = {name: (column / 1e-4).round() * 1e-4 for name, column in noisy.items()}
        coarse = {f"tau{k}": (both[f"tau{k}"] / 5.0).round() * 5.0 for k in (1, 2, 3)}
        logs.append(folder / f"run{run}.csv")
        both.with_columns(**noisy, **coarse).write_csv(logs[-1])
    assert overlaps(path, logs) == []
