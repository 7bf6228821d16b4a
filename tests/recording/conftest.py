"""A small log of a two-joint motion, as columns and as files."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from child_programs import run_here

Columns = dict[str, np.ndarray]


@pytest.fixture
def log() -> Columns:
    """Three seconds at 100 Hz of two sinusoids, their exact velocities, and torques."""
    t = np.arange(300) / 100
    return {
        "t": t,
        "q1": 0.8 * np.sin(3.0 * t),
        "q2": 0.5 * np.cos(5.0 * t),
        "dq1": 2.4 * np.cos(3.0 * t),
        "dq2": -2.5 * np.sin(5.0 * t),
        "tau1": 4.0 * np.cos(2.0 * t),
        "tau2": 1.0 + np.sin(4.0 * t),
    }


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write columns as CSV, by hand, so that the reader is tested against plain text."""

    def write_csv(columns: Mapping[str, np.ndarray], name: str = "log.csv", separator: str = ",") -> Path:
        rows = [separator.join(columns)]
        rows += [separator.join(str(value) for value in row) for row in zip(*columns.values(), strict=True)]
        path = tmp_path / name
        path.write_text("\n".join(rows) + "\n")
        return path

    return write_csv


@pytest.fixture
def mat_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the program that reads MATLAB's files here."""
    monkeypatch.setattr("steelyard.recording.formats.mat_file.run_child", run_here)
