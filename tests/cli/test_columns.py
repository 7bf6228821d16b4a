"""What the columns of a log were understood to be: what is printed, and what results hold."""

import json
import re

import numpy as np
import pytest
from log_exports import JOINTS, STYLES, Motion

import steelyard as sy


def table_of(out: str) -> list[list[str]]:
    """Return the cells of the table of columns that was printed."""
    lines = out.partition("Columns of ")[2].splitlines()
    return [re.split(r" {2,}", line.strip()) for line in lines[4:] if line.startswith("  ")]


@pytest.fixture
def degrees(place):
    """Return a log as an ABB controller names its columns, with positions in degrees."""
    log = sy.Recording.read(place / "log.csv")
    table = np.column_stack([log.t, np.degrees(log.q), log.torque])
    np.savetxt(place / "degrees.csv", table, delimiter=",", header="time,J1,J2,T1,T2", comments="", fmt="%.17g")
    return place / "degrees.csv"


def test_what_was_guessed_is_printed_and_kept(run, place, degrees):
    code, out, _ = run("identify", place / "robot.toml", degrees, "--output", place / "result")
    assert code == 0
    assert re.search(
        r"^The positions J1 … J2 are read in deg, since they reach .* `position_unit = \"rad\"`", out, re.MULTILINE
    )
    assert table_of(out)[:3] == [
        ["time", "s", "name", "time"],
        ["position", "deg", "number, from 1 (ABB)", "shoulder = J1, elbow = J2"],
        ["torque", "N·m", "number, from 1 (ABB)", "shoulder = T1, elbow = T2"],
    ]
    expected = [
        ["time", "", "time", "s", "name"],
        ["J1", "shoulder", "position", "deg", "number, from 1 (ABB)"],
        ["J2", "elbow", "position", "deg", "number, from 1 (ABB)"],
        ["T1", "shoulder", "torque", "N·m", "number, from 1 (ABB)"],
        ["T2", "elbow", "torque", "N·m", "number, from 1 (ABB)"],
    ]
    (kept,) = json.loads((place / "result" / "run.json").read_text())["columns"]
    assert kept["logs"] == [str(degrees)]
    assert [list(row.values()) for row in kept["table"]] == expected
    page = (place / "result" / "report.html").read_text()
    assert "Columns of the logs" in page
    assert "The positions J1 … J2 are read in deg" in page
    assert page.count("number, from 1 (ABB)") == 4


@pytest.mark.slow
def test_what_was_not_guessed_is_printed_with_verbose_alone(run, place):
    options = ("identify", place / "robot.toml", place / "log.csv", "--output", place / "result")
    code, out, _ = run(*options)
    assert code == 0
    assert "Columns of" not in out
    code, out, _ = run(*options, "--verbose", "--validate", place / "log.csv")
    assert code == 0
    assert table_of(out)[1] == ["q1", "shoulder", "position", "rad", "number, from 1"]


@pytest.mark.slow
def test_logs_with_the_same_columns_have_one_table(place, degrees):
    logs = [place / "log.csv", degrees, place / "copy.csv"]
    logs[2].write_bytes(logs[0].read_bytes())
    result = sy.identify(place / "robot.toml", logs)
    assert [one["logs"] for one in result.to_dict()["columns"]] == [[str(logs[0]), str(logs[2])], [str(logs[1])]]
    assert [logs for _, logs in result.columns()] == [(str(logs[0]), str(logs[2])), (str(logs[1]),)]
    assert result.layouts[str(degrees)].units["position"] == ("deg", "deg")


def test_logs_that_would_be_read_in_different_units_are_a_question(run, place, degrees):
    rows = degrees.read_text().splitlines()
    small = [
        rows[0],
        *(
            ",".join([t, str(float(a) / 50), str(float(b) / 50), *rest])
            for t, a, b, *rest in (row.split(",") for row in rows[1:])
        ),
    ]
    (place / "small.csv").write_text("\n".join(small))
    code, _, err = run("identify", place / "robot.toml", degrees, place / "small.csv", "--output", place / "result")
    assert code == 2
    assert 'say which with `position_unit = "deg"` or `position_unit = "rad"` in [log]' in err


@pytest.mark.slow
def test_units_of_joints_that_slide(place):
    urdf = (place / "pair.urdf").read_text().replace('"elbow" type="revolute"', '"elbow" type="prismatic"')
    (place / "pair.urdf").write_text(urdf)
    result = sy.identify(place / "robot.toml", place / "log.csv")
    ((layout, _),) = result.columns()
    assert [one.unit for one in layout.table] == ["s", "rad", "m", "N·m", "N"]


def arm(folder):
    """Write the description of an arm of three joints; return it and a motion with the torques of its model."""
    links = "".join(
        f'<link name="{name}"><inertial><origin xyz="0.1 0 0.05"/><mass value="{mass}"/>'
        '<inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.02"/></inertial></link>'
        for name, mass in (("base", 1), ("upper", 2), ("fore", 1), ("hand", 0.6))
    )
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 0 0.3"/><axis xyz="{axis}"/><limit lower="-3" upper="3" effort="100" velocity="10"/></joint>'
        for name, parent, child, axis in zip(
            JOINTS, ("base", "upper", "fore"), ("upper", "fore", "hand"), ("0 0 1", "0 1 0", "1 0 0"), strict=True
        )
    )
    urdf = folder / "arm.urdf"
    urdf.write_text(f'<robot name="arm">{links}{joints}</robot>')
    model = sy.Model(sy.Robot.from_urdf(urdf).with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))
    t = np.arange(1200) / 100
    rate = 2 * np.pi * np.array([0.3, 0.45, 0.6])
    parts = [(1.0, rate), (0.3, 2.3 * rate)]
    q = sum(size * np.sin(one * t[:, None]) for size, one in parts)
    dq = sum(size * one * np.cos(one * t[:, None]) for size, one in parts)
    ddq = sum(-size * one**2 * np.sin(one * t[:, None]) for size, one in parts)
    parameters = np.nan_to_num(np.asarray(model.robot.parameters), nan=0.2)
    torque = model.inverse_dynamics(q, dq, ddq, parameters)
    return urdf, Motion(t, q, dq, torque + np.random.default_rng(0).normal(scale=0.02, size=torque.shape))


@pytest.mark.slow
def test_every_export_leads_to_the_same_robot_without_an_editor(run, tmp_path):
    urdf, motion = arm(tmp_path)
    answers = {}
    for style, write in STYLES.items():
        export, log, result = write(motion), tmp_path / "log.csv", tmp_path / "result"
        log.write_text(export.text(), encoding="utf-8")
        code, out, _ = run("identify", urdf, log, "--output", result)
        assert code == 0, out
        assert "predicts well" in out, style
        (kept,) = json.loads((result / "run.json").read_text())["columns"]
        told = [(row["column"], row["joint"], row["quantity"], row["unit"]) for row in kept["table"]]
        assert told == list(export.table), style
        assert ("Columns of" in out) == bool(export.guesses), style
        answers[style] = sy.Estimate.load(result / "estimate.json").parameters
        written = sy.Robot.from_urdf(result / "robot.urdf")
        assert sy.check(sy.FeasibleSet(sy.Model(written)), parameters=written.parameters).feasible
    for style, parameters in answers.items():
        # Stamps since 1970 are rounded to 0.2 µs.
        np.testing.assert_allclose(parameters, answers["our own"], rtol=1e-4, atol=1e-5, err_msg=style)
