"""What the motion shows, what least squares made impossible, and where the report comes from."""

import hashlib
import shlex
from pathlib import Path

import lxml.html
import numpy as np
import pytest

import steelyard as sy
from steelyard.identification import Identification
from steelyard.report.excitation_section import excitation, weak_combinations
from steelyard.report.impossible_section import defects, impossible
from steelyard.report.sections import provenance

from .conftest import LOGS, rows


def test_bodies_of_points_have_no_defect_and_others_have_the_one_that_was_planted() -> None:
    random = np.random.default_rng(2)
    for _ in range(50):
        masses, points = random.uniform(0.1, 3.0, 5), random.normal(size=(5, 3))
        L = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True))
        body = np.array([L[0, 0], L[0, 1], L[0, 2], L[1, 1], L[1, 2], L[2, 2], *(masses @ points), masses.sum()])
        assert defects(body) == []
        about = L - masses.sum() * (np.dot(c := masses @ points / masses.sum(), c) * np.eye(3) - np.outer(c, c))
        moments, axes = np.linalg.eigvalsh(about), np.linalg.eigh(about)[1]
        for change, words in ((-2 * moments[0], "is negative"), (None, "triangle inequality")):
            which = 0 if change is not None else 2
            added = change if change is not None else 3 * moments.sum()
            M = L + added * np.outer(axes[:, which], axes[:, which])
            wrong = np.array([M[0, 0], M[0, 1], M[0, 2], M[1, 1], M[1, 2], M[2, 2], *body[6:]])
            (told,) = defects(wrong)
            assert words in told
        assert "negative, -" in defects(np.array([*body[:9], -1.5]))[0]


def test_what_is_impossible_is_said_in_words(identification: Identification) -> None:
    page = lxml.html.fromstring(f"<div>{impossible(identification)}</div>")
    found = {row[0]: row[1] for row in rows(page, "violations")}
    assert set(found) == {violation.block for violation in identification.verdict.violations}
    # The friction of the second joint, which was simulated as -0.05.
    told = next(words for name, words in found.items() if name.startswith("Fcj"))
    assert told.startswith("Fcj2 is negative, -0.0")


def test_the_weakest_combination_is_what_the_motion_does_not_tell_apart(folder: Path) -> None:
    """Both joints move alike, so that L of the first and of the second link show in nearly one and the same way."""
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], gravity=(0, 0, -9.81)).with_terms(sy.Viscous())
    model = sy.Model(robot)
    t = np.arange(3000) / 100
    q = np.column_stack([np.sin(2 * t), np.sin(2 * t) + 0.01 * np.sin(5 * t)])
    dq = np.column_stack([2 * np.cos(2 * t), 2 * np.cos(2 * t) + 0.05 * np.cos(5 * t)])
    ddq = np.column_stack([-4 * np.sin(2 * t), -4 * np.sin(2 * t) - 0.25 * np.sin(5 * t)])
    delta = np.zeros(model.parameter_count)
    for columns in model.link_columns:
        delta[columns] = [0.3, 0, 0, 0.3, 0, 0.4, 0.5, 0.0, 0, 2.0]
    delta[[k for k, name in enumerate(model.parameter_names) if name.startswith("Fv")]] = 0.3
    torque = model.inverse_dynamics(q, dq, ddq, delta) + np.random.default_rng(1).normal(0.0, 0.3, q.shape)
    result = sy.identify(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=t))
    (weights, error), *others = weak_combinations(result)
    assert np.abs(weights).max() == 1.0
    assert all(error >= other for _, other in others)
    W = np.asarray(model.regressor(q, dq, ddq)).reshape(-1, model.parameter_count) @ model.base_parameters().Pb
    values = np.linalg.svd(W, compute_uv=False)
    text = str(excitation(result))
    assert f"the strongest is {values[0]:.3g}" in text
    assert f"the weakest {values[-1]:.3g}" in text
    assert error > 0.2
    assert "steelyard excite" in text


def test_provenance_has_the_hashes_and_the_command(identification: Identification, folder: Path) -> None:
    page = lxml.html.fromstring(f"<div>{provenance(identification)}</div>")
    table = {row[0]: row[1] for row in rows(page, "provenance")}
    for name, path in (("Robot file", folder / "robot.toml"), ("Log for identification", folder / LOGS[0])):
        assert table[name].split()[-1] == hashlib.sha256(path.read_bytes()).hexdigest()
    words = shlex.split(page.xpath("//pre")[0].text_content())
    assert words[:3] == ["steelyard", "identify", str(folder / "robot.toml")]
    assert words[3] == str(folder / LOGS[0])
    assert words[words.index("--validate") + 1] == str(folder / LOGS[1])


@pytest.mark.parametrize("mass", [0.0, -1.0])
def test_a_body_without_mass_is_none(mass: float) -> None:
    assert "mass" in defects(np.array([1.0, 0, 0, 1.0, 0, 1.0, 0, 0, 0, mass]))[0]
