"""`identify` with the options of [processing] that the data decides, and what the report shows of them."""

from pathlib import Path

import lxml.html
import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.identification import validate_estimate
from steelyard.report import report_html

ROBOT = """
[description]
convention = "standard"
rows = [["pi/2", 0, 0.3, "q"], [0, 0.4, 0, "q"]]
[[terms]]
kind = "viscous"
[processing]
"""


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Three periods of 2 s of a known arm, with noise, torques 4 ms late."""
    (tmp_path / "robot.toml").write_text(ROBOT)
    model = sy.Model.load(tmp_path / "robot.toml")
    random = np.random.default_rng(4)

    def motion(t):
        w = np.pi * np.array([1.0, 2.0])
        a, b = np.outer(t, w), np.outer(t, 3 * w)
        return np.sin(a) + 0.3 * np.cos(b), w * np.cos(a) - 0.9 * w * np.sin(b), -(w**2) * (np.sin(a) + 2.7 * np.cos(b))

    body, joint = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.1, 0.1, 0.1, 1.0], [0.5]
    t = np.arange(3000) / 500
    torque = model.inverse_dynamics(*motion(t - 0.004), np.array(2 * (body + joint)))
    torque += 0.05 * random.normal(size=torque.shape)
    q = motion(t)[0] + 1e-4 * random.normal(size=torque.shape)
    return sy.Recording(t=t, q=q, torque=torque).save(tmp_path / "log.csv")


def test_choices_of_the_data_are_in_the_report(log):
    robot = log.with_name("robot.toml")
    robot.write_text(ROBOT + 'cutoff = "auto"\ndelay = "automatic"\ntrim = 0.1\n')
    result = sy.identify(robot, [log])
    ((name, choice),) = result.cutoff_choices
    assert name == "all logs"
    assert 5.0 < choice.cutoff < 30.0
    assert any(choice.remark in remark for remark in result.remarks)
    moved = next(remark for remark in result.remarks if "moved back" in remark)
    assert float(moved.split("moved back by ")[1].split(" ms")[0]) == pytest.approx(4.0, abs=0.3)
    assert "the model shows" in moved
    page = lxml.html.fromstring(report_html(result))
    section = page.xpath("//section[@aria-labelledby='processing']")[0]
    assert len(section.xpath(".//svg")) == 1
    assert section.xpath(".//table[@id='cutoff-0']")
    assert [row.text_content() for row in section.xpath(".//table[@id='processing-options']//th[@scope='row']")] == [
        "trim",
        "delay",
    ]
    heads = [cell.text_content() for cell in page.xpath("//table[@id='base-parameters']/thead//th")]
    assert "± %" in heads
    assert np.all(result.estimate.standard_error > 0)


@pytest.mark.slow
def test_filters_that_need_the_whole_log_get_it(log):
    robot = log.with_name("robot.toml")
    robot.write_text(
        ROBOT
        + 'filter = { kind = "fourier", period = 2.0, harmonics = 6 }\naverage = true\ndelay = 0.004\n'
        + 'velocity_threshold = "none"\n'
    )
    result = sy.identify(robot, [log])
    # The first two rows lack nothing: other periods have them.
    assert result.information.count == pytest.approx(2000, abs=8)
    assert result.unconstrained.relative_error < 0.02
    assert any("3 periods of 2 s were averaged" in remark for remark in result.remarks)
    assert result.options["processing"]["filter"] == {"kind": "fourier", "period": 2.0, "harmonics": 6}
    plain = lxml.html.fromstring(report_html(result)).xpath("//section[@aria-labelledby='processing']//svg")
    assert plain == []


def test_a_log_of_a_lower_rate_is_filtered_as_its_rate_allows(log, tmp_path):
    """It was refused for a cutoff that nobody had stated."""
    robot = log.with_name("robot.toml")
    robot.write_text(ROBOT + 'delay = 0.004\nvelocity_threshold = "none"\n')
    read = sy.Recording.read(log)
    slow = sy.Recording(t=read.t[::10], q=read.q[::10], torque=read.torque[::10]).save(tmp_path / "slow.csv")
    result = sy.identify(robot, [log], validate=[slow])
    cutoff = result.options["decided"]["cutoff"]
    assert cutoff > 10.0
    said = f"{slow}: Positions were filtered at 10 Hz, the highest cutoff for 50 samples a second, and not at the"
    assert any(remark.startswith(said) for remark in result.remarks)
    assert result.predictions[1].feasible_error < 0.05  # of which central differences make 2 %
    result.save(tmp_path / "out")
    again = validate_estimate(robot, tmp_path / "out" / "estimate.json", [slow])
    assert again.prediction.relative_error == pytest.approx(result.prediction.relative_error)
    assert any(remark.startswith(said) for remark in again.remarks)
    robot.write_text(ROBOT + 'delay = 0.004\nvelocity_threshold = "none"\ncutoff = 26.0\n')
    with pytest.raises(InputError, match="not below half"):  # what is stated is taken at its word
        sy.identify(robot, [log], validate=[slow])
