"""The page about a motion: what it says is compared with the motion itself, and what it predicts with experiments."""

from dataclasses import replace
from pathlib import Path

import lxml.html
import numpy as np
import pytest

import steelyard as sy
from steelyard.dynamics import ChannelFriction
from steelyard.excitation import ExcitationDesign, RestToRestTrajectory, SearchOptions
from steelyard.identification.predicted_intervals import TIME_CONSTANT, PredictedIntervals, predicted_intervals
from steelyard.report.excitation_page import PAGE, excitation_html, save_excitation

from ..chromium import Page
from .conftest import pixels

LENGTHS = (0.5, 0.4)
LIMITS = {"lower": [-1.5, -2.0], "upper": [1.5, 2.0], "velocity": 2.0, "acceleration": 6.0, "torque": [60.0, 15.0]}


def arm(name: str = "arm") -> sy.Robot:
    robot = sy.Robot.from_dh([(0, length, 0, "q") for length in LENGTHS], name=name, gravity=(0, -9.81, 0))
    bodies = [sy.Inertia.from_com(2.0 / k, (-0.2, 0.01 * k, 0.0), np.diag([0.004, 0.03, 0.03])) for k in (1, 2)]
    links = tuple(replace(link, inertia=body) for link, body in zip(robot.links, bodies, strict=True))
    robot = replace(robot, links=links)
    return robot.with_terms(sy.Viscous(), sy.Coulomb())


@pytest.fixture(scope="module")
def model() -> sy.Model:
    return sy.Model(arm("arm <b>&"))


@pytest.fixture(scope="module")
def design(model: sy.Model) -> ExcitationDesign:
    quick = SearchOptions(starts=1, workers=1)
    return sy.design_excitation(model, LIMITS, period=3.0, harmonics=1, search=quick, rate=250.0)


@pytest.fixture(scope="module")
def expected(model: sy.Model, design: ExcitationDesign) -> PredictedIntervals:
    return predicted_intervals(model, design.trajectory, rate=250.0)


@pytest.fixture(scope="module")
def page(model: sy.Model, design: ExcitationDesign, expected: PredictedIntervals) -> lxml.html.HtmlElement:
    return lxml.html.fromstring(excitation_html(design, model, expected))


def cells(page: lxml.html.HtmlElement, identifier: str) -> list[list[str]]:
    lines = page.get_element_by_id(identifier).xpath("./tbody/tr")
    return [[" ".join(cell.text_content().split()) for cell in line] for line in lines]


def test_the_start_is_that_of_the_motion(page: lxml.html.HtmlElement, design: ExcitationDesign) -> None:
    start = design.trajectory.motion([0.0])[0][0]
    for row, place in zip(cells(page, "start-table"), start, strict=True):
        assert float(row[1]) == pytest.approx(place, abs=1e-4)
        assert float(row[3]) == pytest.approx(np.degrees(place), abs=0.01)
    assert cells(page, "start-table")[1][4] == "-2 … 2"


def test_largest_values_are_those_of_the_motion(
    page: lxml.html.HtmlElement, design: ExcitationDesign, model: sy.Model, expected: PredictedIntervals
) -> None:
    _, q, dq, ddq = design.trajectory.sample(1000.0)
    for k, row in enumerate(cells(page, "limits-table")):
        low, high = map(float, row[1].split(" … "))
        assert (low, high) == pytest.approx((q[:, k].min(), q[:, k].max()), abs=2e-3)
        assert float(row[3]) == pytest.approx(np.abs(dq[:, k]).max(), rel=1e-2)
        assert float(row[5]) == pytest.approx(np.abs(ddq[:, k]).max(), rel=1e-2)
        assert [float(row[i]) for i in (4, 6, 8)] == [2.0, 6.0, LIMITS["torque"][k]]  # type: ignore[index]
        # Rigid links alone need at least what holds them up.
        assert float(row[7]) > 1.0


def test_the_end_goes_where_trigonometry_says(page: lxml.html.HtmlElement, design: ExcitationDesign) -> None:
    _, q, _, _ = design.trajectory.sample(100.0)
    first, both = q[:, 0], q.sum(axis=1)
    x = LENGTHS[0] * np.cos(first) + LENGTHS[1] * np.cos(both)
    y = LENGTHS[0] * np.sin(first) + LENGTHS[1] * np.sin(both)
    ((name, *spans),) = cells(page, "extent-table")
    assert name == "link2"
    for text, values in zip(spans[:2], (x, y), strict=True):
        low, high = map(float, text.split(" … "))
        assert (low, high) == pytest.approx((values.min(), values.max()), abs=5e-3)
    assert len(page.xpath("//*[local-name()='line'][@class='path']")) > 200
    assert len(page.xpath("//*[local-name()='g'][@class='later']")) == 4
    # Beside the drawing three ranges have no room: heights, which tell of the table, were to be scrolled to.
    assert not page.xpath("//*[@class='drawing']//*[@id='extent-table']")


def test_the_path_of_a_long_motion_is_as_smooth_as_that_of_its_first_period(
    design: ExcitationDesign, model: sy.Model, expected: PredictedIntervals
) -> None:
    def strokes(page: lxml.html.HtmlElement) -> np.ndarray:
        lines = page.xpath("//*[local-name()='line'][@class='path']")
        ends = np.array([[float(line.get(name)) for name in ("x1", "y1", "x2", "y2")] for line in lines])
        return np.hypot(*(ends[:, :2] - ends[:, 2:]).T)

    pages = []
    for periods in (1, 20):
        motion = RestToRestTrajectory(design.excitation, design.ramp_time, periods, 2.0)
        pages.append(lxml.html.fromstring(excitation_html(replace(design, trajectory=motion), model, expected)))
    short, long = map(strokes, pages)
    assert long.max() < 1.2 * short.max()
    assert cells(pages[1], "extent-table")[0][1:] == cells(pages[0], "extent-table")[0][1:]


def test_nothing_is_taken_for_html(page: lxml.html.HtmlElement) -> None:
    assert page.xpath("//h1")[0].text == "arm <b>&"
    assert not page.xpath("//main//b")


def noise_of(shape: tuple[int, int], deviation: np.ndarray, rate: float, generator: np.random.Generator) -> np.ndarray:
    """Deviations that decay within the time constant, made step by step."""
    decay = np.exp(-1.0 / (rate * TIME_CONSTANT))
    found = np.empty(shape)
    state = generator.normal(size=shape[1])
    for row in found:
        state = decay * state + np.sqrt(1.0 - decay**2) * generator.normal(size=shape[1])
        row[:] = deviation * state
    return found


@pytest.mark.slow
def test_intervals_are_as_wide_as_experiments_scatter(
    model: sy.Model, design: ExcitationDesign, expected: PredictedIntervals
) -> None:
    """Least squares of NumPy on 150 experiments with such noise, against half of 3.92 standard deviations."""
    generator = np.random.default_rng(5)
    _, q, dq, ddq = design.trajectory.sample(250.0)
    base = model.base_parameters()
    columns = [model.inverse_dynamics(q, dq, ddq, base.Pb[:, k]) for k in range(base.count)]
    regressor = np.stack(columns, axis=-1) / expected.noise[:, None]  # rows of joints weigh by their noise
    solve = np.linalg.pinv(regressor.reshape(-1, base.count))
    ones = np.ones(2)
    scatter = np.array([solve @ noise_of(q.shape, ones, 250.0, generator).ravel() for _ in range(150)])
    np.testing.assert_allclose(expected.half_width, 1.96 * scatter.std(axis=0), rtol=0.35)


def test_what_is_predicted_is_about_what_was_assumed(model: sy.Model, expected: PredictedIntervals) -> None:
    assert expected.table is not None
    assert expected.base is not None
    assert "Assumed parameters: those of the description." in expected.sentences
    values = {row.name: row for row in expected.table}
    for name, value in zip(model.parameter_names, model.robot.parameters, strict=True):
        if np.isfinite(value):
            assert values[name].value == pytest.approx(value, abs=1e-12)
        else:
            assert values[name].value > 0.0  # friction that the description leaves open
        assert values[name].lower <= values[name].value <= values[name].upper
    # A planar arm tells the first moment of its last link across the link, and not the mass of the first.
    assert values["ly2"].basis == "measured"
    assert values["m1"].basis == "assumed"


@pytest.mark.slow
def test_half_the_noise_gives_half_the_interval(model: sy.Model, design: ExcitationDesign) -> None:
    wide, narrow = (
        predicted_intervals(sy.Model(model.robot), design.trajectory, rate=100.0, noise=noise) for noise in (1.0, 0.5)
    )
    np.testing.assert_allclose(narrow.half_width, 0.5 * wide.half_width, rtol=1e-6)
    assert wide.sentences[-2] == "Noise: the standard deviations of the torques that were given."


@pytest.mark.slow
def test_without_inertia_base_parameters_remain(tmp_path: Path) -> None:
    robot = sy.Robot.from_dh([(0, length, 0, "q") for length in LENGTHS], name="arm", gravity=(0, -9.81, 0))
    model = sy.Model(robot)
    quick = SearchOptions(starts=1, workers=1)
    kept = {key: value for key, value in LIMITS.items() if key != "torque"}
    design = sy.design_excitation(model, kept, period=4.0, harmonics=2, search=quick, rate=100.0)
    written = save_excitation(design, sy.RobotFile.of(robot.with_terms(sy.Viscous())), tmp_path)
    assert written[-1] == tmp_path / PAGE
    text = written[-1].read_text(encoding="utf-8")
    assert "Only base parameters are predicted" in text
    assert "Torques are not predicted, since the inertia of the links is not known" in text
    found = predicted_intervals(model, design.trajectory, rate=100.0)
    assert found.table is None
    assert found.base is None
    assert np.isfinite(found.half_width).all()


@pytest.mark.parametrize("noise", [[1.0], [0.1, 0.1, 0.1], [0.1, -1.0], [0.1, np.nan]], ids=str)
def test_noise_that_is_none_is_refused(model: sy.Model, design: ExcitationDesign, noise: list[float]) -> None:
    if len(noise) == 1:
        noise = [-1.0]
    with pytest.raises(sy.InputError, match="noise must be a positive number of N·m"):
        predicted_intervals(model, design.trajectory, noise=noise, rate=50.0)


@pytest.mark.slow
def test_the_page_is_drawn(
    model: sy.Model, design: ExcitationDesign, expected: PredictedIntervals, tmp_path: Path, browser: Page
) -> None:
    place = tmp_path / PAGE
    place.write_text(excitation_html(design, model, expected), encoding="utf-8")
    assert place.stat().st_size < 3_000_000
    browser.open(place)
    browser.wait("document.documentElement.dataset.figures === 'drawn'")
    assert browser.console == []
    drawn = lxml.html.fromstring(browser.run("document.documentElement.outerHTML"))
    for joint in range(2):
        layer = ".//*[contains(@class, 'scatterlayer')]//*[contains(@class, 'js-line')]/@d"
        lines = drawn.get_element_by_id(f"joint-{joint}").xpath(layer)
        assert len(lines) == 6  # position, velocity, acceleration, torque, and the limit on both sides
    assert drawn.xpath("//div[contains(@class, 'controls-of-drawing') and not(@hidden)]")
    build = Path(__file__).resolve().parents[2] / "build"
    for width, height in ((1280, 800), (390, 844)):
        browser.size(width, 3 * height)
        picture = pixels(browser.picture(build / f"excite-{width}.png"))
        blue = (np.abs(picture - (0, 95, 158)).max(axis=2) < 40).sum()
        assert blue > 300  # the path, the curves of positions, links


@pytest.mark.slow
def test_an_estimate_with_friction_by_a_signal_is_expected_again(tmp_path: Path) -> None:
    robot = arm().with_terms(ChannelFriction("temperature", range=[15, 60], reference=25), sy.Offset())
    model = sy.Model(robot)
    random = np.random.default_rng(4)
    q, dq, ddq, noise = random.normal(size=(4, 400, 2))
    signal = {"temperature": np.linspace(20.0, 40.0, 400)}
    terms = {"Fcj": 1.0, "Fcsj": 0.02, "Fvj": 0.5}
    known = np.array(robot.parameters, dtype=float)
    stated = [terms.get(name[:-1], 0.0) for name in model.parameter_names]
    torque = model.inverse_dynamics(q, dq, ddq, np.where(np.isnan(known), 0.0, known) + stated, channels=signal)
    info = sy.Information.from_samples(
        model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque + 0.01 * noise, channels=signal)
    )
    sy.fit(info, sy.FeasibleSet(model)).save(tmp_path / "estimate.json")
    quick = SearchOptions(starts=1, workers=1)
    design = sy.design_excitation(model, LIMITS, period=3.0, harmonics=1, search=quick, rate=100.0)
    written = save_excitation(design, sy.RobotFile.of(robot), tmp_path, estimate=tmp_path / "estimate.json")
    assert "those of the estimate before" in written[-1].read_text(encoding="utf-8")
