"""identify of robots and data in memory: the numbers are those of the same recording in a file, bit for bit."""

import json
import runpy
import sys
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from lxml import etree
from typer.testing import CliRunner

import steelyard as sy
from steelyard.cli.main import app
from steelyard.identification.next_steps import next_steps
from steelyard.recording import process_chunks

ROBOT_FILE = """
name = "arm"
[description]
rows = [["pi/2", 0, 0.3, "q"], [0, 0.4, 0, "q"]]
[[terms]]
kind = "viscous"
[[terms]]
kind = "coulomb"
[processing]
cutoff = 10.0
trim = 0.5
"""
SETTINGS = {"cutoff": 10.0, "trim": 0.5}
BODY = sy.Inertia.from_com(2.0, (0.1, 0.02, -0.03), 0.02 * np.eye(3)).parameters
TRUTH = np.concatenate([[*BODY, 0.8, 0.3]] * 2)


PAIR = """<robot name="pair"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/>
<axis xyz="0 1 0"/></joint></robot>"""


def motion(seed, rate=200.0):
    """Return times, positions, velocities and accelerations of two joints over eight seconds."""
    random = np.random.default_rng(seed)
    return sy.excitation.FourierTrajectory(
        a=random.normal(size=(2, 4)), b=random.normal(size=(2, 4)), center=[0.2, -0.3], frequency=0.125
    ).sample(rate)


@cache
def read(path):
    """Return the columns of a log as NumPy reads them, without this package."""
    names = path.read_text().splitlines()[0].split(",")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    return names, table


def by_columns(path):
    names, table = read(path)
    return {name: table[:, k] for k, name in enumerate(names)}


def by_matrices(path):
    names, table = read(path)

    def part(word):
        return table[:, [name.startswith(word) for name in names]]

    return {"t": table[:, 0], "q": part("q"), "tau": part("tau")}


def structured(path):
    arrays = by_matrices(path)
    rows = np.zeros(len(arrays["t"]), dtype=[("t", "f8"), ("q", "f8", (2,)), ("tau", "f8", (2,))])
    for name, values in arrays.items():
        rows[name] = values
    return rows


def by_pandas(path):
    return pytest.importorskip("pandas", reason="pandas is not installed").DataFrame(by_columns(path))


def by_pandas_index(path):
    return by_pandas(path).set_index("t")


def by_arrow(path):
    return pytest.importorskip("pyarrow", reason="pyarrow is not installed").table(by_columns(path))


KINDS = {
    "polars": lambda path: pl.DataFrame(by_columns(path)),
    "lazy": lambda path: pl.DataFrame(by_columns(path)).lazy(),
    "pandas": by_pandas,
    "pandas index": by_pandas_index,
    "arrow": by_arrow,
    "columns": by_columns,
    "lists": lambda path: {name: values.tolist() for name, values in by_columns(path).items()},
    "matrices": by_matrices,
    "structured": structured,
    "recording": lambda path: sy.Recording(torque=(m := by_matrices(path))["tau"], t=m["t"], q=m["q"]),
}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A robot file, a log for identification, another for validation, and what comes of them."""
    folder = tmp_path_factory.mktemp("memory")
    path = folder / "robot.toml"
    path.write_text(ROBOT_FILE)
    model = sy.Model.load(path)
    logs = []
    for seed, name in ((1, "log"), (2, "other")):
        t, q, dq, ddq = motion(seed)
        torque = model.inverse_dynamics(q, dq, ddq, TRUTH) + np.random.default_rng(seed).normal(
            scale=0.05, size=q.shape
        )
        logs.append(sy.Recording(t=t, q=q, torque=torque).save(folder / f"{name}.csv"))
    return path, *logs, sy.identify(path, logs[0], logs[1])


@pytest.fixture(scope="module")
def chunks_of_the_file(files):
    return list(process_chunks(files[1], rows=1000, joints=2))


@pytest.mark.parametrize("kind", KINDS)
def test_data_in_memory_is_read_as_the_file_is(files, chunks_of_the_file, kind):
    _path, log, _, expected = files
    joints = expected.model.robot.joint_names
    found, wanted = (sy.Recording.read(one, joints=joints) for one in (KINDS[kind](log), log))
    for name in ("t", "q", "torque"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))
    parts = process_chunks(KINDS[kind](log), rows=1000, joints=2)
    for one, two in zip(parts, chunks_of_the_file, strict=True):
        np.testing.assert_array_equal(one.ddq, two.ddq)


@pytest.mark.parametrize(
    "kind", [kind if kind == "pandas" else pytest.param(kind, marks=pytest.mark.slow) for kind in KINDS]
)
def test_data_in_memory_gives_the_numbers_of_the_file(files, kind):
    path, log, other, expected = files
    found = sy.identify(path, KINDS[kind](log), validate=KINDS[kind](other))
    assert found.estimate.to_dict() == expected.estimate.to_dict()
    assert found.prediction.to_dict() == {**expected.prediction.to_dict(), "source": found.prediction.source}
    for one, two in zip(found.predictions, expected.predictions, strict=True):
        np.testing.assert_array_equal(one.trace.measured, two.trace.measured)


@pytest.mark.parametrize("kind", ["model", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("robot", "file"))])
def test_a_robot_in_memory_gives_the_numbers_of_its_file(files, kind):
    path, log, other, expected = files
    model = sy.Model.load(path)
    robot = {"model": model, "robot": model.robot, "file": sy.RobotFile.load(path)}[kind]
    found = sy.identify(robot, log, other, processing=None if kind == "file" else SETTINGS)
    np.testing.assert_array_equal(found.estimate.parameters, expected.estimate.parameters)


@pytest.mark.slow
def test_a_robot_without_terms_gets_those_of_a_plain_description(files):
    _, log, _, _ = files
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")])
    kinds = [term.kind for term in sy.identify(robot, log, processing=SETTINGS).model.robot.terms]
    assert kinds == ["viscous", "coulomb", "offset"]
    model = sy.Model(robot)  # which has no friction, as the robot of this log has none
    t, q, dq, ddq = motion(1)
    torque = model.inverse_dynamics(q, dq, ddq, np.concatenate([BODY] * 2))
    without = sy.Recording(t=t, q=q, torque=torque + np.random.default_rng(1).normal(scale=0.05, size=q.shape))
    assert sy.identify(model, without, processing=SETTINGS).model.robot.terms == ()


def test_samples_are_taken_as_they_are(files):
    model = files[3].model
    _, q, dq, ddq = motion(3, 100.0)
    torque = model.inverse_dynamics(q, dq, ddq, TRUTH)
    found = sy.identify(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    # Exact samples: least squares of NumPy gives the truth, and so does this.
    base = model.base_parameters()
    matrix = (model.regressor(q, dq, ddq) @ base.Pb).reshape(-1, base.count)
    solved = np.linalg.lstsq(matrix, torque.ravel(), rcond=None)[0]
    np.testing.assert_allclose(found.unconstrained.base, solved, rtol=1e-8, atol=1e-9)
    assert found.predictions[0].row_count == torque.size


def test_exact_torques_have_intervals(files):
    """The intervals of what the motion does not show are those of noisy data: rounding is not the error of a sensor."""
    model, noisy = files[3].model, files[3].parameters
    _, q, dq, ddq = motion(1, 100.0)
    exact = sy.Samples(q=q, dq=dq, ddq=ddq, torque=model.inverse_dynamics(q, dq, ddq, TRUTH))
    table = sy.identify(model, exact).parameters
    for name, true in zip(model.parameter_names, TRUTH, strict=True):
        row = table[name]
        assert row.lower - 1e-6 <= true <= row.upper + 1e-6, name
        if noisy[name].basis == "assumed" and np.isfinite(noisy[name].upper - noisy[name].lower):
            assert row.upper - row.lower > 0.5 * (noisy[name].upper - noisy[name].lower), name


def test_columns_by_joint_name_are_found_in_any_order(files):
    _path, log, _, expected = files
    columns = by_columns(log)
    joints = expected.model.robot.joint_names
    named = {"time": columns["t"]}
    for number in (1, 0):
        named[f"{joints[number]}_effort"] = columns[f"tau{number + 1}"]
        named[f"{joints[number]}_pos"] = columns[f"q{number + 1}"]
    found = sy.Recording.read(pl.DataFrame(named), joints=joints)
    np.testing.assert_array_equal(found.torque, by_matrices(log)["tau"])
    labelled = by_matrices(log)
    order = [1, 0]
    labelled = {"t": labelled["t"], "q": labelled["q"][:, order], "tau": labelled["tau"][:, order]}
    found = sy.Recording.read({**labelled, "joint_names": [joints[k] for k in order]}, joints=joints)
    np.testing.assert_array_equal(found.torque, by_matrices(log)["tau"])


def test_dates_count_as_seconds(files, tmp_path):
    log = files[1]
    frame = pl.DataFrame(by_columns(log)).with_columns(
        (pl.col("t") * 1e9).round().cast(pl.Int64).cast(pl.Datetime("ns")).alias("t")
    )
    texts = frame.with_columns(pl.col("t").dt.strftime("%Y-%m-%dT%H:%M:%S%.9f"))
    texts.write_csv(tmp_path / "texts.csv")
    of_file = sy.Recording.read(tmp_path / "texts.csv", joints=2)
    for one in (frame, texts, {name: texts[name].to_list() for name in texts.columns}):
        found = sy.Recording.read(one, joints=2)
        np.testing.assert_allclose(found.t, by_columns(log)["t"], atol=1e-9)
        np.testing.assert_allclose(found.t, of_file.t, atol=0 if one is not frame else 1e-9)


def test_pandas_without_pyarrow(files, monkeypatch):
    _path, log, _, expected = files
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    frame = by_pandas(log)

    def absent(self, requested_schema=None):
        raise ImportError("`Import pyarrow` failed.")

    monkeypatch.setattr(pandas.DataFrame, "__arrow_c_stream__", absent)
    for one in (frame, frame.set_index("t")):
        np.testing.assert_array_equal(sy.Recording.read(one).torque, by_matrices(log)["tau"])
    frame.columns = pandas.MultiIndex.from_tuples(
        [("t", "")] + [(f"joint{k}", word) for word in ("pos", "effort") for k in (1, 2)]
    )
    found = sy.Recording.read(frame, joints=list(expected.model.robot.joint_names))
    np.testing.assert_array_equal(found.q, by_matrices(log)["q"])


@pytest.mark.slow
def test_what_save_writes_is_what_the_command_writes(files, tmp_path):
    path, log, other, result = files
    result.save(tmp_path / "library")
    done = CliRunner().invoke(
        app, ["identify", str(path), str(log), "--validate", str(other), "-o", str(tmp_path / "command")]
    )
    assert done.exit_code == 0, done.output
    written = {place.name: place.read_bytes() for place in (tmp_path / "library").iterdir()}
    assert written == {place.name: place.read_bytes() for place in (tmp_path / "command").iterdir()}
    assert {"estimate.json", "parameters.csv", "report.html", "run.json"} <= written.keys()


@pytest.mark.parametrize(
    "how", [{"tip": "upper"}, {"locked": {"elbow": 0.3}}, pytest.param({"locked": ["elbow"]}, marks=pytest.mark.slow)]
)
def test_a_part_of_a_description_is_written_as_it_was_read(tmp_path, how):
    (tmp_path / "pair.urdf").write_text(PAIR)
    robot = sy.Robot.from_urdf(tmp_path / "pair.urdf", **how)
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb()))
    t, q, dq, ddq = motion(4)
    truth = [*(1.1 * robot.links[0].inertia.parameters), 0.2, 0.1]
    torque = model.inverse_dynamics(q[:, :1], dq[:, :1], ddq[:, :1], truth)
    torque += np.random.default_rng(1).normal(scale=0.02, size=torque.shape)
    result = sy.identify(model, {"t": t, "q": q[:, :1], "tau": torque}, processing=SETTINGS)
    assert tmp_path / "result" / "robot.urdf" in result.save(tmp_path / "result")
    written = sy.Robot.from_urdf(tmp_path / "result" / "robot.urdf", **how)
    names = list(result.parameter_names)
    links = [names.index(name) for name in written.parameter_names]
    np.testing.assert_allclose(written.parameters, np.asarray(result)[links], rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_what_is_in_memory_is_named_and_hashed(files, tmp_path):
    path, log, other, _ = files
    frames = [pl.DataFrame(by_columns(one)) for one in (log, other)]
    result = sy.identify(path, [frames[0], str(other)], validate=[frames[1]])
    assert result.logs == ("data[0]", str(other))
    assert result.validation_logs == ("validate",)
    result.save(tmp_path / "out")
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    again = sy.identify(path, by_columns(log))
    assert record["logs"][0] == [{"path": "data[0]", "sha256": again.in_memory["data"]}]
    changed = by_columns(log)
    changed["q1"] = changed["q1"] + 1e-9
    assert sy.identify(path, changed).in_memory["data"] != again.in_memory["data"]
    # A saved result knows data that it has seen.
    found = sy.identification.validate_estimate(path, tmp_path / "out", [frames[0]])
    assert any("was used to make" in remark for remark in found.remarks)


@pytest.mark.slow
def test_rows_that_are_given_twice_are_named_and_test_no_prediction(files):
    path, log, other, alone = files
    copied = sy.identify(path, [log, by_columns(log)], [by_matrices(log), other, by_columns(other)])
    told = [remark for remark in copied.remarks if " the rows of " in remark]
    assert [remark.split(": ")[0] for remark in told] == ["data[1]", "validate[0]", "validate[2]"]
    assert "count twice, so that intervals are too narrow" in told[0]
    assert "is no test of a prediction" in told[1]
    assert "count once" in told[2]
    # Twice the same rows have the same optimum, and one log is left that the fit has not seen.
    assert copied.prediction.source == "the validation log"
    assert copied.prediction.joint_error == pytest.approx(alone.prediction.joint_error, rel=1e-2)
    assert not any(" the rows of " in remark for remark in alone.remarks)
    itself = sy.identify(path, log, log)
    assert "each left out in turn" in itself.prediction.source
    assert any(step.action == "Try the model on another motion." for step in next_steps(itself))


def test_nothing_is_written_unasked(files, tmp_path, monkeypatch):
    path, log, _, _ = files
    monkeypatch.chdir(tmp_path)
    sy.identify(path, by_columns(log)).report()
    assert list(tmp_path.iterdir()) == []


def test_models_take_estimates(files):
    result = files[3]
    model = result.model
    _, q, dq, ddq = motion(5, 20.0)
    parameters = result.estimate.parameters
    for given in (result, result.estimate):
        np.testing.assert_array_equal(
            model.inverse_dynamics(q, dq, ddq, given), model.inverse_dynamics(q, dq, ddq, parameters)
        )
        np.testing.assert_array_equal(model.inertia_matrix(q, given), model.inertia_matrix(q, parameters))
        np.testing.assert_array_equal(model.drive_torque(dq, ddq, given), model.drive_torque(dq, ddq, parameters))
        np.testing.assert_array_equal(
            model.forward_dynamics(q, dq, ddq, given), model.forward_dynamics(q, dq, ddq, parameters)
        )
        np.testing.assert_array_equal(model.drives(given).damping, model.drives(parameters).damping)
        numbers = model.function("gravity", parameters=given)
        assert str(numbers.outputs) == str(model.function("gravity", parameters=parameters).outputs)
        model.function("inverse_dynamics", base=True, parameters=given)
    other = sy.Model(model.robot.with_terms())
    with pytest.raises(sy.InputError, match="another robot or of other terms"):
        other.gravity(q, result)
    with pytest.raises(sy.InputError, match="base parameters alone"):
        model.gravity(q, result.unconstrained)


def test_the_table_of_parameters(files):
    _, _, _, result = files
    table = result.parameters
    frame = table.to_frame()
    assert isinstance(frame, pl.DataFrame)
    assert frame.filter(pl.col("name") == "m2")["value"].item() == table["m2"].value
    assert frame.columns == ["name", "meaning", "unit", "value", "lower", "upper", "cad", "basis"]
    masses = [link.mass.value for link in table.links]
    assert sum(masses) == pytest.approx(result.total_mass)
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    other = table.to_frame("pandas")
    assert isinstance(other, pandas.DataFrame)
    np.testing.assert_array_equal(other["lower"].to_numpy(), frame["lower"].to_numpy())
    with pytest.raises(sy.InputError, match="polars"):
        table.to_frame("excel")


def test_a_missing_pandas_is_said(files, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(sy.MissingExtraError, match="pandas is not installed"):
        files[3].parameters.to_frame("pandas")


def test_the_plot_shows_what_was_measured(files):
    _, _, other, result = files
    figure = result.plot()
    assert len(figure.data) == 6
    assert "validation" in figure.layout.title.text
    measured = figure.data[0]
    recorded = np.interp(measured.x, by_columns(other)["t"], by_columns(other)["tau1"])
    np.testing.assert_allclose(np.asarray(measured.y), recorded, atol=1e-9)
    alone = result.plot("log.csv", joints=["joint2"])
    assert len(alone.data) == 3
    np.testing.assert_array_equal(alone.data[2].y, result.predictions[0].trace.feasible[:, 1])
    np.testing.assert_array_equal(result.plot(0, ["joint2"]).data[2].y, alone.data[2].y)
    for wrong in ({"log": "lgo.csv"}, {"log": 7}, {"joints": ["elbow"]}, {"joints": []}):
        with pytest.raises(sy.InputError):
            result.plot(**wrong)


def test_the_report_is_text_or_a_file(files, tmp_path):
    result = files[3]
    text = result.report()
    assert result.report(tmp_path / "report.html") == tmp_path / "report.html"
    assert (tmp_path / "report.html").read_text() == text


WRONG = {
    "a list of arrays": (lambda a: [a["q"], a["tau"]], "list that holds an array of shape"),
    "an array": (lambda a: a["q"], "an array of shape"),
    "nothing": (lambda a: None, "NoneType"),
    "no logs": (lambda a: [], "At least one log"),
    "no names": (lambda a: pl.DataFrame(a["q"]), "no columns that look like positions"),
    "no torques": (lambda a: {"t": a["t"], "q": a["q"]}, "no columns that look like torques"),
    "no time": (lambda a: {"q": a["q"], "tau": a["tau"]}, "no column of time"),
    "transposed": (lambda a: {**a, "q": a["q"].T}, "transpose it"),
    "short": (lambda a: {**a, "tau": a["tau"][:9]}, "same samples"),
    "ragged": (lambda a: {**a, "q": [[1.0], [1.0, 2.0]]}, "different lengths"),
    "words": (lambda a: {**a, "q": a["q"].astype(str)}, "expected numbers"),
    "words for times": (lambda a: {**a, "t": ["now"] * len(a["t"])}, "numbers"),
    "numbers for names": (lambda a: {1: a["t"]}, "name columns by strings"),
    "too few joints": (lambda a: {**a, "q": a["q"][:, :1], "tau": a["tau"][:, :1]}, "but the robot has 2"),
    "empty": (lambda a: {name: values[:0] for name, values in a.items()}, "no rows"),
    "samples of another robot": (
        lambda a: sy.Samples(**dict.fromkeys(("q", "dq", "ddq", "torque"), a["q"][:, :1])),
        "samples of 1 joints",
    ),
    "masked": (lambda a: {**a, "tau": np.ma.masked_greater(a["tau"], 1)}, "no finite number"),
    "not a number": (lambda a: {**a, "tau": np.where(a["tau"] > 1, np.nan, a["tau"])}, "row"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_said_in_one_sentence(files, name):
    path, log, _, _ = files
    make, words = WRONG[name]
    with pytest.raises(sy.InputError, match=words) as caught:
        sy.identify(path, make(by_matrices(log)))
    text = str(caught.value)
    assert "\n" not in text
    assert text.count(". ") == 0
    assert text.endswith((".", ")"))


def test_wrong_robots_and_settings_are_refused(files):
    path, log, _, _ = files
    for robot in (7, None, [path]):
        with pytest.raises(sy.InputError, match="The robot is"):
            sy.identify(robot, log)
    with pytest.raises(sy.InputError, match="`columns` is an int"):
        sy.identify(path, log, columns=3)
    with pytest.raises(sy.InputError, match='did you mean "cutoff"'):
        sy.identify(path, log, processing={"cutof": 3})
    with pytest.raises(sy.InputError, match="give a list"):
        sy.identify(path, log, constraints=sy.TotalMass(maximum=3.0))
    with pytest.raises(sy.InputError, match='prior must be "auto" or None'):
        sy.identify(path, log, prior="cad")


def test_wrong_requests_of_a_result_are_refused(files):
    result = files[3]
    q = np.zeros((4, 2))
    for folder in (None, 3):
        with pytest.raises(sy.InputError, match="give its path"):
            result.save(folder)
    for name in (3, None, "mm1"):
        with pytest.raises(sy.InputError, match="there is no parameter"):
            result.parameters[name]
    for parameters in ("x", result.parameters, [[1.0], [1.0, 2.0]]):
        with pytest.raises(sy.InputError, match="or an estimate"):
            result.model.inverse_dynamics(q, q, q, parameters)


def test_constant_torques_are_told_before_a_filter_is_looked_for(files):
    path, log, _, _ = files
    arrays = by_matrices(log)
    with pytest.raises(sy.InputError, match=r"no torque changes within \d+ rows; check `torque` in \[log\]"):
        sy.identify(path, {**arrays, "tau": 0 * arrays["tau"]}, processing={"cutoff": "auto"})


@pytest.mark.slow
def test_degrees_are_told_and_mended(files):
    path, log, _, expected = files
    arrays = by_matrices(log)
    degrees = {**arrays, "q": np.degrees(arrays["q"])}
    told = sy.identify(path, degrees)
    assert any('position_unit = "deg"' in remark for remark in told.remarks)
    mended = sy.identify(path, degrees, columns={"position_unit": "deg"})
    np.testing.assert_allclose(mended.unconstrained.base, expected.unconstrained.base, rtol=1e-6, atol=1e-8)


def test_constraints_are_added(files):
    path, log, _, _ = files
    light = sy.identify(path, log, constraints=[sy.TotalMass(maximum=3.0)])
    assert light.total_mass <= 3.0 + 1e-9


@pytest.mark.slow
def test_the_example_runs(capsys):
    names = runpy.run_path(str(Path(__file__).resolve().parents[2] / "examples" / "from_a_notebook.py"))
    assert "The answer can exist and predicts well" in capsys.readouterr().out
    truth = names["model"].base_parameters().values(names["truth"])
    error = np.abs(names["result"].unconstrained.base - truth)
    assert np.all(error < 5 * names["result"].unconstrained.standard_error)


def test_everything_prints_itself_in_a_notebook(files):
    _path, log, _, result = files
    model = result.model
    things = [
        model.robot,
        model,
        model.base_parameters(),
        sy.Recording.read(log),
        result.information,
        result.verdict,
        result.estimate,
        result.unconstrained,
        result,
        result.parameters,
    ]
    for thing in things:
        text = thing._repr_html_()
        page = etree.fromstring(f"<div>{text}</div>")
        assert len(text) < 40_000, type(thing)
        assert not page.xpath("//script | //*[@style] | //*[@color] | //*[@bgcolor]"), type(thing)


def test_names_are_escaped_in_a_notebook():
    hostile = '<script>alert("1")</script> & co'
    robot = sy.Robot.from_dh([(0, 0.3, 0, "q")], name=hostile)
    t = np.arange(400) / 100
    recording = sy.Recording(t=t, q=np.sin(t)[:, None], torque=np.cos(t)[:, None], source=hostile)
    result = sy.identify(robot, recording, processing={"cutoff": "none"})
    for thing in (robot, result.model, recording, result, result.verdict, result.information):
        page = etree.fromstring(f"<div>{thing._repr_html_()}</div>")
        assert not page.xpath("//script")


def test_long_tables_are_folded():
    robot = sy.Robot.from_dh([("pi/2", 0.1, 0, "q")] * 40, name="snake")
    page = etree.fromstring(f"<div>{robot._repr_html_()}</div>")
    assert len(page.xpath("//details//td[contains(., 'joint')]")) >= 16
    assert page.xpath("string(//summary)") == "and 16 more"
