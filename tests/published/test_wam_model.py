"""The WAM's model against the published tables 4.1, 4.2, 4.4 and 4.5."""

import csv
import re

import numpy as np
import pytest

import steelyard as sy
from steelyard.identification.wam import TRAJECTORIES

pytestmark = pytest.mark.data


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def model(thesis_tables):
    """The model from table 4.1 and equations 4.5, 4.12 to 4.15."""
    links = rows(thesis_tables / "table_4_1_wam_dh_standard.csv")
    n3, n6 = 1.68, 1.0
    coupling = np.zeros((7, 7))
    coupling[0, 0] = -1
    coupling[1:3, 1:3] = [[1, -1], [-1 / n3, -1 / n3]]
    coupling[3, 3] = 1
    coupling[4:6, 4:6] = [[1, 1], [-1 / n6, 1 / n6]]
    coupling[6, 6] = -1
    robot = sy.Robot.from_dh([(r["alpha"], float(r["a_m"]), float(r["d_m"]), r["theta"]) for r in links], name="wam")
    return sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset(), sy.MotorSide(coupling=coupling)))


def combination(text):
    """Parse ``"+1*Lyy1 -1.1*ly3"`` or ``"Lyy1 - 1.1*ly3"`` into coefficients by name."""
    result = {}
    for sign, size, name in re.findall(r"([+-]?)\s*(?:([\d.e]+)\*)?([A-Za-z]+\d+)", text):
        result[name] = float(size or 1.0) * (-1.0 if sign == "-" else 1.0)
    return result


def test_base_parameters_are_those_of_table_4_2(model, thesis_tables):
    published = [combination(r["combination"]) for r in rows(thesis_tables / "table_4_2_wam_base_parameters.csv")]
    base = model.base_parameters()
    assert model.parameter_count == 119
    assert base.count == len(published) == 76
    names = model.parameter_names
    for row, expected in zip(base.K, published, strict=True):
        ours = {names[k]: row[k] for k in np.flatnonzero(row)}
        assert set(ours) == set(expected)
        assert ours == pytest.approx(expected, abs=1e-8)
    assert [combination(text) for text in base.expressions] == [pytest.approx(e, abs=1e-8) for e in published]
    assert base.gap > 1e10


def test_coefficients_are_rounded_to_what_they_are(model):
    base = model.base_parameters()
    values = {float(v) for v in np.abs(base.Kd[base.Kd != 0.0])}
    assert {1.1, 0.300475, 0.55, 0.002025, 0.045, 0.00405, 0.092025, 0.087975, 1.68} <= values
    assert min(abs(v - 2 / 1.68**2) for v in values) < 1e-12


@pytest.mark.parametrize(("name", "file", "published"), [("A", "table_4_4", 107.94), ("B", "table_4_5", 107.20)])
def test_reference_trajectories_have_the_known_condition_numbers(model, thesis_tables, name, file, published):
    """Equations 4.19 and 4.20 evaluated here from the tables, against the thesis's conditions as recomputed."""
    (path,) = thesis_tables.glob(f"{file}*.csv")
    t, w = np.arange(12500) / 1000.0, 2.0 * np.pi * 0.08
    q, dq, ddq = np.zeros((3, len(t), 7))
    for k, row in enumerate(rows(path)):
        q[:, k] += float(row["q0_rad"])
        for i in range(1, 7):
            a, b = float(row[f"a{i}"]), float(row[f"b{i}"])
            s, c = np.sin(w * i * t), np.cos(w * i * t)
            q[:, k] += (a * s - b * c) / (w * i)
            dq[:, k] += a * c + b * s
            ddq[:, k] += (b * c - a * s) * w * i
    regressor = model.regressor(q, dq, ddq)[:, :, model.base_parameters().independent]
    assert np.linalg.cond(regressor.reshape(-1, 76)) == pytest.approx(published, abs=0.1)
    samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=np.ones_like(q))
    assert sy.Information.from_samples(model, samples).condition_number == pytest.approx(published, abs=0.1)
    shipped = TRAJECTORIES[name].sample(1000.0)
    for ours, theirs in zip(shipped, (t, q, dq, ddq), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_the_shipped_model_is_the_same(model, wam):
    np.testing.assert_allclose(wam.base_parameters().K, model.base_parameters().K, atol=1e-12)
    assert wam.parameter_names == model.parameter_names
