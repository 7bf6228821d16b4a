"""Logs as programs export them are read without a word of configuration, and what each column is, is told."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from log_exports import JOINTS, STYLES, Export, motion

from steelyard.recording import Processing, Recording, Samples, process_chunks

LOG = motion()


def written(export: Export, folder: Path, order: list[int] | None = None) -> Path:
    path = folder / "log.csv"
    path.write_text(export.text(order), encoding="utf-8")
    return path


def assert_is_motion(recording: Recording, export: Export) -> None:
    absolute = recording.t + 1e-9 * recording.clock_origin
    np.testing.assert_allclose(absolute, export.start + LOG.t, rtol=0, atol=1e-12 if export.start == 0.0 else 5e-7)
    np.testing.assert_allclose(recording.q, LOG.q, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(recording.torque, LOG.torque, rtol=1e-14, atol=1e-14)
    if export.velocity:
        assert recording.velocity is not None
        np.testing.assert_allclose(recording.velocity, LOG.dq, rtol=1e-14, atol=1e-14)
    else:
        assert recording.velocity is None
    assert recording.layout is not None
    told = [(one.column, one.joint, one.quantity, one.unit) for one in recording.layout.table]
    assert told == list(export.table)
    assert len(recording.layout.guesses) == len(export.guesses)
    for guess, pattern in zip(recording.layout.guesses, export.guesses, strict=True):
        assert re.match(pattern, guess), guess
    assert recording.remarks == recording.layout.guesses  # and nothing else is odd about these logs


@pytest.mark.parametrize("style", STYLES)
def test_style_is_recognised(style: str, tmp_path: Path) -> None:
    export = STYLES[style](LOG)
    assert_is_motion(Recording.read(written(export, tmp_path), joints=JOINTS), export)


@pytest.mark.parametrize("style", [style for style in STYLES if style != "ros2 topic echo --csv"])
def test_order_of_columns_does_not_matter(style: str, tmp_path: Path) -> None:
    export = STYLES[style](LOG)
    random = np.random.default_rng(len(style))
    for _ in range(3):
        order = random.permutation(len(export.columns)).tolist()
        assert_is_motion(Recording.read(written(export, tmp_path, order), joints=JOINTS), export)


@pytest.mark.parametrize("style", ["name and position", "UR RTDE", "ABB, degrees", "ros2 topic echo --csv", "dates"])
def test_chunks_are_understood_alike(style: str, tmp_path: Path) -> None:
    export = STYLES[style](LOG)
    processing = Processing(cutoff=None, trim=0.0, velocity_threshold=None)
    parts = list(process_chunks(written(export, tmp_path), None, processing, 150, JOINTS))
    joined = Samples.joined(parts)
    np.testing.assert_allclose(joined.q, LOG.q, atol=1e-12)
    np.testing.assert_allclose(joined.torque, LOG.torque, atol=1e-12)
    for pattern in export.guesses:
        assert any(re.match(pattern, remark) for remark in parts[0].remarks)


def test_lists_that_are_empty_in_a_joint_state(tmp_path: Path) -> None:
    """Many drivers publish no velocities; `ros2 topic echo --csv` then writes nothing between two commas."""
    export = STYLES["ros2 topic echo --csv"](LOG)
    columns = [*export.columns[:9], [""] * len(LOG.t), *export.columns[12:]]
    table = [row for row in export.table if row[2] != "velocity"]
    without = replace(export, columns=columns, table=table, velocity=False)
    assert_is_motion(Recording.read(written(without, tmp_path), joints=JOINTS), without)
