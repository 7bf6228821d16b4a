"""What was found and what to do next follow from what was checked, and their commands and lines can be used."""

import shlex
import tomllib
from dataclasses import replace

import lxml.html
import numpy as np
import pytest
import typer.main

import steelyard as sy
from steelyard.cli.main import app
from steelyard.excitation.motion_limits import MotionLimits
from steelyard.excitation.motion_search import SearchOptions
from steelyard.identification import Identification
from steelyard.identification.mistakes import Hypothesis
from steelyard.identification.next_steps import NextStep, excite_command, found, next_steps
from steelyard.identification.parameter_table import TOO_MANY
from steelyard.identification.wrong_scale import WrongScale
from steelyard.recording.correction import Correction
from steelyard.report import report_html

SIGN = Hypothesis(
    kind="torque sign",
    statement="The sign of the torque of elbow looks wrong",
    correction=Correction(torques=np.diag([1.0, -1.0])),
    gain=50.0,
    error_before=0.8,
    error_after=0.06,
    joint="elbow",
    evidence="the error falls from 80 % to 6 %",
    settings={"log": {"torque_sign": [1, -1]}},
)


def judged(identification: Identification, word: str, **changes: object) -> Identification:
    return replace(identification, prediction=replace(identification.prediction, word=word, **changes))


def usable(step: NextStep) -> bool:
    """Whether a command and its options exist, or lines are TOML, words in capitals filled in."""
    if step.language == "toml":
        return bool(tomllib.loads(step.code.replace("MASS", "2.0"))) or "# without" in step.code
    program, name, *words = shlex.split(step.code)
    command = typer.main.get_command(app).get_command(None, name)
    known = {option for parameter in command.params for option in parameter.opts}
    return program == "steelyard" and {word for word in words if word.startswith("-")} <= known


def test_a_mistake_comes_first_and_alone_where_the_model_is_wrong(identification: Identification) -> None:
    changed = replace(judged(identification, "wrong"), mistakes={"a.csv": (SIGN,)}, logs=("a.csv",), validation_logs=())
    (step,) = next_steps(changed)
    assert tomllib.loads(step.code) == {"log": {"torque_sign": [1, -1]}}
    assert step.reason == f"{SIGN.statement}, in a.csv: mended, {SIGN.evidence}."
    (said,) = found(changed)
    assert "does not move like this one" in said


def test_other_mistakes_that_explain_as_much_are_named(identification: Identification) -> None:
    other = replace(SIGN, statement="The positions of elbow look turned", settings={"log": {"position_sign": [1, -1]}})
    alone = replace(identification, mistakes={"a.csv": (SIGN, other)}, logs=("a.csv",), validation_logs=())
    step = next_steps(alone)[0]
    assert step.reason.endswith("The log cannot tell it from: The positions of elbow look turned.")


def test_a_mistake_of_one_log_is_not_said_to_be_that_of_all(identification: Identification) -> None:
    both = replace(identification, logs=("a.csv", "b.csv"), validation_logs=())
    step = next_steps(replace(both, mistakes={"a.csv": (SIGN,)}))[0]
    assert step.action == "Mend that log, or robot.toml if it is so in all logs, and identify again."
    assert step.reason.endswith("It was not found in b.csv, and a line of robot.toml counts for every log.")
    shared = next_steps(replace(both, mistakes={"a.csv": (SIGN,), "b.csv": (SIGN,)}))[0]
    assert shared.action == "Mend robot.toml, and identify again."
    term = replace(SIGN, kind="term", settings={"terms": [{"kind": "viscous"}]})
    assert next_steps(replace(both, mistakes={"a.csv": (term,)}))[0].action == shared.action


def test_a_wrong_model_without_a_mistake_is_for_the_doctor(identification: Identification) -> None:
    (step,) = next_steps(judged(identification, "wrong"))
    assert step.code.startswith("steelyard doctor ")
    # The verdict is on a log that was held out, so that this is the log to look at.
    assert shlex.split(step.code)[2:] == [identification.validation_logs[0], str(identification.robot_file)]
    assert usable(step)
    of_fit = judged(identification, "wrong", source="5 stretches of the logs, each left out in turn")
    assert shlex.split(next_steps(of_fit)[0].code)[2] == identification.logs[0]


def test_a_model_that_is_wrong_of_a_motion_that_it_knows_asks_for_no_other(identification: Identification) -> None:
    """The errors of the verdict are ten times those of a fit in which the same motion takes part, and huge as well."""
    error = 10.0 * identification.prediction.joint_error
    (step,) = next_steps(judged(identification, "wrong", relative_error=3.0, joint_error=error))
    assert step.code.startswith("steelyard doctor ")
    first, _ = next_steps(judged(identification, "wrong", relative_error=0.6, joint_error=error))
    assert first.code.startswith("steelyard excite ")


def test_a_motion_is_designed_with_what_was_found_and_with_limits_where_it_has_none(
    identification: Identification,
) -> None:
    robot = identification.model.robot
    assert not np.isfinite(MotionLimits.from_robot(robot).velocity).any()
    assert excite_command(identification).endswith(" --limits LIMITS.toml --estimate DIR --output motion")
    with pytest.raises(sy.InputError, match="would grow without bound"):
        sy.design_excitation(identification.model, period=1.0)
    limited = replace(robot, joints=tuple(replace(joint, velocity_limit=2.0) for joint in robot.joints))
    fast = replace(identification, model=sy.Model(limited))
    assert "--limits" not in excite_command(fast)  # joints that turn without end have none of position
    sy.design_excitation(fast.model, period=2.0, harmonics=2, search=SearchOptions(starts=1))
    assert "--estimate" not in excite_command(judged(identification, "wrong"))


def test_limits_that_are_zero_in_the_description_do_not_keep_a_result_from_being_told(
    identification: Identification,
) -> None:
    """Exporters write zeros for the positions, where nothing is known; the report of such a robot was never written."""
    robot = identification.model.robot
    joints = tuple(replace(joint, lower=0.0, upper=0.0, velocity_limit=2.0) for joint in robot.joints)
    still = replace(identification, model=sy.Model(replace(robot, joints=joints)))
    assert excite_command(still).endswith(" --limits LIMITS.toml --estimate DIR --output motion")
    with pytest.raises(sy.InputError, match="the joint cannot move"):
        sy.design_excitation(still.model, period=1.0)


def test_a_model_that_knows_its_own_data_alone_needs_another_motion(identification: Identification) -> None:
    """The errors of the verdict are ten times those of a fit in which the same motion takes part."""
    told = identification.prediction
    step = next_steps(judged(identification, "poor", relative_error=0.3, joint_error=10.0 * told.joint_error))[0]
    assert step.code.startswith("steelyard excite ")
    assert "--limits" in step.code  # the description of the arm has none
    assert step.reason.startswith("Where the same motion takes part in the fit, the error of 30.0% is 3.")
    assert usable(step)


def test_a_mass_that_is_assumed_is_to_be_stated_once(identification: Identification) -> None:
    assert identification.parameters is not None
    assert identification.parameters["total mass"].basis == "assumed"
    (step,) = (step for step in next_steps(identification) if "total_mass" in step.code)
    assert usable(step)
    stated = sy.FeasibleSet(identification.model, constraints=[sy.TotalMass(maximum=3.0)])
    steps = next_steps(replace(identification, feasible_set=stated))
    assert not [step for step in steps if "total_mass" in step.code]


def test_bounds_of_physics_are_not_told_where_they_were_not_looked_for(identification: Identification) -> None:
    """As of a humanoid, whose mass neither data nor physics would allow to be zero."""
    table = identification.parameters
    assert table is not None
    rows = [replace(row, lower=0.0, upper=np.inf) if row.name == "total mass" else row for row in table]
    large = replace(identification, parameters=replace(table, rows=tuple(rows), sentences=(TOO_MANY,)))
    (step,) = (step for step in next_steps(large) if "total_mass" in step.code)
    assert "is assumed: the data do not show it." in step.reason
    (sentence, *_) = found(large)
    assert "kg in all (assumed): of" in sentence
    assert "bounded by the data, and" in sentence
    assert all("physics" not in one for one in (step.reason, sentence))
    page = lxml.html.fromstring(report_html(large)).text_content()
    assert "0 to ∞ kg" not in page
    assert "Bounded: the data confine it" in page


def test_weak_parameters_are_counted_and_long_sums_not_written_out(identification: Identification) -> None:
    weak = ("Lxx1 + 0.25*m2 + 0.3*lx2 + 0.4*ly2 + 0.5*lz2", "ly1")
    hidden = replace(identification.unconstrained, standard_error=np.full(10, 100.0))
    steps = next_steps(replace(identification, weak=weak, unconstrained=hidden))
    (step,) = (step for step in steps if "excite" in step.code)
    assert "2 of 10 base parameters are smaller than twice their standard errors, such as ly1." in step.reason


def test_what_the_log_shows_to_be_zero_asks_for_no_other_motion(identification: Identification) -> None:
    """A first moment of zero is smaller than twice its standard error, however well the motion shows it."""
    told = identification.unconstrained
    name = "ly1"
    error = np.where(np.array(told.base_names) == name, 1e-3, told.standard_error)
    steps = next_steps(replace(identification, weak=(name,), unconstrained=replace(told, standard_error=error)))
    assert not [step for step in steps if "excite" in step.code]
    error = np.where(np.array(told.base_names) == name, 1e3, told.standard_error)
    steps = next_steps(replace(identification, weak=(name,), unconstrained=replace(told, standard_error=error)))
    assert [step for step in steps if "excite" in step.code]


def test_at_most_three_steps_that_can_be_done(identification: Identification) -> None:
    steps = next_steps(replace(identification, weak=("ly1",), validation_logs=()))
    assert 1 <= len(steps) <= 3
    assert all(usable(step) for step in steps)


def test_what_was_found_has_the_numbers_of_the_result(identification: Identification) -> None:
    first, second = found(identification)
    assert identification.parameters is not None
    assert f"weigh {identification.total_mass:.4g} kg in all (assumed, " in first
    assert f" {identification.parameters.count('measured')} are measured by the data alone, " in first
    assert second.endswith(f"instead of {identification.unconstrained.relative_error:.2%}.")


def test_the_report_says_so_above_its_sections(identification: Identification) -> None:
    page = lxml.html.fromstring(report_html(identification))
    (listed,) = page.find_class("steps")
    steps = next_steps(identification)
    assert [item.find("pre").text_content() for item in listed] == [step.code for step in steps]
    text = page.text_content()
    assert text.index("Does it predict?") < text.index("What was found") < text.index("What to do next")
    assert text.index("What to do next") < text.index("Condition number")


def test_a_doubtful_scale_stands_beside_every_verdict(identification: Identification) -> None:
    """Torques of motors in front of gears are predicted as well as those behind."""
    sound = lxml.html.fromstring(report_html(identification))
    scale = WrongScale("torques", "Gravity takes 0.05 times the torques of the description.", 0.05)
    doubted = replace(identification, scale=scale)
    assert doubted.headline == f"{identification.headline[:-1]}; but the scale of the torques is in doubt."
    page = lxml.html.fromstring(report_html(doubted))
    (before,), (after,) = (
        [one for one in told.find_class("verdict") if "Good" in one.text_content()] for told in (sound, page)
    )
    assert "good" in before.getparent().classes
    assert after.getparent().classes == {"card", "open"}
    assert after.text_content().endswith("Good, at a doubtful scale")
    assert not page.find_class("card good")
    assert scale.sentence in after.getparent().text_content()


@pytest.mark.parametrize("language", ["console", "toml"])
def test_a_step_prints_itself(language) -> None:
    assert str(NextStep("Do it.", "It is worth it.", "a\nb", language)) == "Do it. It is worth it.\n  a\n  b"
