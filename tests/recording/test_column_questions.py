"""What the names of columns leave open is asked, with the line of TOML that answers it; units and times are found."""

import re
import tomllib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.recording import ColumnMeaning, Layout, LogColumns, Recording, find_columns
from steelyard.recording.column_styles import FURTHER_TIME_WORDS, STYLES, TIME_WORDS

ARM = ("shoulder", "elbow", "wrist")


def numbered(*patterns: str, first: int = 1, count: int = 3) -> list[str]:
    return [pattern.format(first + k) for pattern in patterns for k in range(count)]


def find(names: Iterable[str], joints: object = ARM, log: dict | None = None, **values: list[float]) -> Layout:
    """Find columns; values of columns are given under their names with `_` for everything else."""

    def of(name: str) -> list[np.ndarray]:
        return [np.array(values.get("".join(c if c.isalnum() else "_" for c in name), [0.0, 1.0]))]

    return find_columns(list(names), LogColumns.from_dict(log or {}), joints, values=of)  # type: ignore[arg-type]


def question(names: Iterable[str], joints: object = ARM, log: dict | None = None, **values: list[float]) -> str:
    with pytest.raises(InputError) as caught:
        find(names, joints, log, **values)
    return str(caught.value)


def answered(asked: str, names: list[str], joints: object = ARM, **values: list[float]) -> list[Layout]:
    """Return what the lines of a question lead to: each of them must answer it."""
    lines = [line for line in re.findall(r"`([a-z_]+ = [^`]+)`", asked) if "..." not in line]
    lines = [line for line in lines if not line.startswith("command = ")]  # of [drive], which another command takes
    return [find(names, joints, tomllib.loads(line), **values) for line in lines]


def test_two_groups_of_columns_are_a_question_whose_lines_answer_it() -> None:
    names = ["t", *numbered("q{}", "position_{}", "tau{}", first=0)]
    asked = question(names)
    assert "q0 … q2" in asked
    assert "position_0 … position_2" in asked
    assert [one.position[0] for one in answered(asked, names)] == ["position_0", "q0"]


def test_two_topics_are_a_question() -> None:
    names = [
        "t",
        *(f"/{arm}/joint_states/{joint}/{word}" for arm in "ab" for joint in ARM for word in ("position", "effort")),
    ]
    asked = question(names)
    assert '`position = "/a/joint_states/{name}/position"`' in asked
    assert '`position = "/b/joint_states/{name}/position"`' in asked


@pytest.mark.parametrize("topic", ["/arm/desired/", "/arm/reference.", "/arm/error/", "cmd/"])
def test_what_was_wanted_is_not_what_was_measured(topic: str) -> None:
    measured = [f"/arm/actual/{word}[{k}]" for word in ("positions", "effort") for k in range(3)]
    layout = find(["t", *(f"{topic}{word}[{k}]" for word in ("positions", "effort") for k in range(3)), *measured])
    assert layout.position + layout.torque == tuple(measured)


def test_numbers_against_the_numbers_in_the_names_of_joints_are_a_question() -> None:
    names, joints = ["t", *numbered("q{}", "tau{}")], ("joint_3", "joint_1", "joint_2")
    asked = question(names, joints)
    assert "joint_3, joint_1, joint_2" in asked
    asked_for_torque = question(names, joints, {"position": ["q3", "q1", "q2"]})
    assert '`torque = ["tau3", "tau1", "tau2"]`' in asked_for_torque
    assert '`torque = ["tau1", "tau2", "tau3"]`' in asked_for_torque
    assert find(names, ("joint_1", "joint_2", "joint_3")).position == ("q1", "q2", "q3")
    assert find(names, ("panda_1", "panda_3", "panda_7")).position == ("q1", "q2", "q3")  # no numbers from 1 to 3


def test_a_stated_pattern_of_numbers_tells_in_which_order_it_is_read_and_a_list_answers_it() -> None:
    """As in a URDF whose tree is j1, j2, j4 and beside them j3: in its order q3 is the position of j4."""
    header, joints = ["t", *(f"{kind}{k}" for kind in ("q", "tau") for k in range(1, 5))], ["j1", "j2", "j4", "j3"]
    torque = ("tau1", "tau2", "tau4", "tau3")
    read = find_columns(header, LogColumns(position="q{}", torque=torque), joints)
    assert read.position == ("q1", "q2", "q3", "q4")
    (told,) = read.guesses
    assert 'position = ["q1", "q2", "q4", "q3"]` (by the numbers in the joints' in told
    chosen = LogColumns(position=("q1", "q2", "q4", "q3"), torque=torque)
    assert find_columns(header, chosen, joints).position == ("q1", "q2", "q4", "q3")
    assert not find_columns(header, chosen, joints).guesses
    assert find_columns(header, LogColumns(position="q{}", torque="tau{}"), sorted(joints)).position[2] == "q3"


def test_names_are_taken_before_numbers_and_that_is_told() -> None:
    layout = find(["t", *numbered("q{}", "tau{}"), *(f"{joint}_pos" for joint in reversed(ARM))])
    assert layout.position == ("shoulder_pos", "elbow_pos", "wrist_pos")
    (guess,) = layout.guesses
    assert "q1 … q3" in guess
    assert '`position = "q{}"`' in guess


def test_joints_of_which_one_has_no_column_are_named() -> None:
    asked = question(["t", "shoulder_pos", "elbow_pos", "rist_pos", *numbered("tau{}")])
    assert "positions for wrist, but has shoulder_pos, elbow_pos" in asked


def test_columns_of_another_name_are_offered() -> None:
    names = ["t", *numbered("q{}", "q_ref{}", "tau_m{}", "tau_ff{}", "temperature{}")]
    asked = question(names)
    assert [one.torque[0] for one in answered(asked, names)] == ["tau_m1", "tau_ff1"]
    assert '`command = "q_ref{}"`' in asked
    assert '`torque = "…{}"`' in question(["t", *numbered("q{}", "q_ref{}")])


def test_currents_alone_are_a_question_and_gains_answer_it() -> None:
    names = ["t", *numbered("actual_q_{}", "actual_current_{}", first=0)]
    asked = question(names)
    assert "currents, actual_current_0 … actual_current_2, but no torques" in asked
    assert "`gain = [...]`" in asked
    layout = find(names, log={"gain": [10.0, 10.0, 5.0]})
    assert layout.torque == ("actual_current_0", "actual_current_1", "actual_current_2")
    assert layout.units["torque"] == ("A", "A", "A")


def test_measured_currents_with_gains_are_taken_before_the_moments_of_the_controllers_model() -> None:
    names = ["t", *numbered("actual_q_{}", "actual_current_{}", "target_moment_{}", first=0)]
    commanded = find(names)
    assert commanded.torque[0] == "target_moment_0"
    assert "is not measured" in commanded.guesses[0]
    measured = find(names, log={"gain": [10.0, 10.0, 5.0]})
    assert measured.torque[0] == "actual_current_0"
    assert measured.guesses == ()
    estimated = find([*names, *numbered("actual_current_as_torque_{}", first=0)])
    assert estimated.torque[0] == "actual_current_as_torque_0"
    assert estimated.guesses == ()


def test_torques_in_amperes_ask_for_gains() -> None:
    names = ["t", *(f"Joint {k} {word}" for word in ("position [rad]", "torque [A]") for k in (1, 2, 3))]
    assert "torques in amperes, Joint 1 torque [A] … Joint 3 torque [A]" in question(names)
    assert find(names, log={"gain": [1.0, 2.0, 3.0]}).units["torque"] == ("A", "A", "A")


def test_joints_that_are_called_as_kuka_calls_axes() -> None:
    names, joints = ["t", "A2", "A1", "tau_A1", "tau_A2"], ("A1", "A2")
    asked = question(names, joints)  # radians of a simulation, or degrees of a small motion
    assert [one.units["position"][0] for one in answered(asked, names, joints)] == ["deg", "rad"]
    layout = find(names, joints, A1=[0.0, -87.5])
    assert layout.position == ("A1", "A2")
    assert layout.units["position"] == ("deg", "deg")
    assert "KUKA" in layout.guesses[0]


@pytest.mark.parametrize(
    ("largest", "unit"), [(0.5, "rad"), (6.9, "rad"), (12.5, "rad"), (12.6, "deg"), (170.0, "deg")]
)
def test_size_tells_degrees_where_nothing_else_does(largest: float, unit: str) -> None:
    layout = find(["t", *numbered("J{}", "T{}")], J2=[0.0, -largest])
    assert layout.units["position"] == (unit,) * 3
    assert f"read in {unit}" in layout.guesses[0]


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        *(("q1 [rad]", "rad"), ("q1 [deg]", "deg"), ("q1 (°)", "deg"), ("q1_deg", "deg"), ("q1 [mm]", "mm")),
        *(("position [Degrees] 1", "deg"), ("Joint 1 [deg]", "deg"), ("Joint_1_position_(rad)", "rad")),
        *(("q1 [rev]", "rev"), ("pos1 [turns]", "rev"), ("q1_turns", "rev")),  # as ODrive and moteus count
        *(("q1 [mrad]", "mrad"), ("q1_mrad", "mrad"), ("pos_1 (millidegrees)", "mdeg"), ("q1 {deg}", "deg")),
        *(("q_deg_1", "deg"), ("pos_deg[1]", "deg"), ("angle_degrees1", "deg"), ("q1 in deg", "deg"), ("q1, °", "deg")),
        *(("q1 / rad", "rad"), ("q1/deg", "deg"), ("Winkel 1 [Grad]", "deg"), ("winkel1_Grad", "deg")),
    ],
)
def test_units_of_positions(column: str, unit: str) -> None:
    assert find(["t", column, "tau1"], 1).units["position"] == (unit,)


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        *(("dq1 [rad/s]", "rad/s"), ("dq1 [°/s]", "deg/s"), ("Joint 1 velocity [rpm]", "rpm"), ("qd1 [1/min]", "rpm")),
        *(("speed 1 [mm/s]", "mm/s"), ("vel1_rad_s", "rad/s"), ("dq1", "deg/s")),  # that of the positions, per s
        *(("vel1 [turns/s]", "rev/s"), ("dq1 [rev/s]", "rev/s")),
        *(("dq1 [mrad/s]", "mrad/s"), ("dq1 in Grad/s", "deg/s"), ("dq1 [U/min]", "rpm"), ("speed_rpm_1", "rpm")),
        *(("dq1 / (rad/s)", "rad/s"), ("dq1 / rad/s", "rad/s"), ("vel_deg_s_1", "deg/s"), ("dq1 [rad s⁻¹]", "rad/s")),
    ],
)
def test_units_of_velocities(column: str, unit: str) -> None:
    assert find(["t", "q1 [deg]", column, "tau1"], 1).units["velocity"] == (unit,)


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        *(("tau1 [Nm]", "N·m"), ("tau1 [N·m]", "N·m"), ("torque 1 [N m]", "N·m"), ("tau1 (mNm)", "mN·m")),
        *(("effort[1] [N]", "N"), ("tau_1_nm", "N·m"), ("Axis 1 torque [N*m]", "N·m"), ("tau1", "N·m")),
        *(
            ("tau1 [kNm]", "kN·m"),
            ("tau1_kNm", "kN·m"),
            ("tau_Nm_1", "N·m"),
            ("tau1 [Ncm]", "N·cm"),
            ("tau1 in A", "A"),
        ),
    ],
)
def test_units_of_torques(column: str, unit: str) -> None:
    assert find(["t", "q1", column], 1, {"gain": [1.0]}).units["torque"] == (unit,)


@pytest.mark.parametrize(
    ("unit", "kind", "size"),
    [
        *(("mrad", "position", 1e-3), ("mdeg", "position", np.pi / 180e3), ("kN·m", "torque", 1e3)),
        *(("N·cm", "torque", 1e-2), ("N·mm", "torque", 1e-3), ("kN", "torque", 1e3)),
        *(("mrad/s", "velocity", 1e-3), ("mdeg/s", "velocity", np.pi / 180e3)),
    ],
)
def test_sizes_of_units(unit: str, kind: str, size: float) -> None:
    t = np.arange(100) / 100.0
    log = {"t": t, "q1": np.sin(t), "dq1": np.cos(t), "tau1": np.cos(2.0 * t)}
    column = {"position": "q1", "velocity": "dq1", "torque": "tau1"}[kind]
    said = {f"{name} [{unit}]" if name == column else name: values for name, values in log.items()}
    said[f"{column} [{unit}]"] = log[column] / size
    units = {"velocity_unit": "rad/s"} if kind == "position" else {}
    read = Recording.read(said, units, 1)
    for values, name in ((read.q, "q1"), (read.velocity, "dq1"), (read.torque, "tau1")):
        np.testing.assert_allclose(values[:, 0], log[name], rtol=1e-12)


@pytest.mark.parametrize(
    ("column", "kind"),
    [
        *(("q1 [gon]", "position"), ("q1 [grad]", "position"), ("posDeg1", "position"), ("q1 [µrad]", "position")),
        *(
            ("enc1_counts", "position"),
            ("tau1 [%]", "torque"),
            ("tau1 [kgf·cm]", "torque"),
            ("v1 [ticks/s]", "velocity"),
        ),
    ],
)
def test_a_unit_that_is_not_understood_in_a_stated_column_is_asked_for(column: str, kind: str) -> None:
    """It would be taken for rad or N·m otherwise."""
    names = ["t", *({"position": "q1", "torque": "tau1"} | {kind: column}).values()]
    assert f"state `{kind}_unit` in [log]" in question(names, 1, {kind: [column]})
    matrix = {"torque_matrix" if kind == "torque" else "position_matrix": [["1/4096"]]}
    assert find(names, 1, {kind: [column], **matrix}).settings()[kind] == [column]
    unit = {"position": "deg", "torque": "mN·m", "velocity": "deg/s"}[kind]
    assert find(names, 1, {kind: [column], f"{kind}_unit": unit}).units[kind] == (unit,)


def test_a_unit_that_is_not_known_is_a_question() -> None:
    assert "no columns that look like positions" in question(["t", "q1 [gon]", "tau1"], 1)


def test_minutes_are_minutes_and_a_time_in_days_is_asked_for() -> None:
    t = np.arange(100) / 100.0
    log = {"q1": np.sin(t), "tau1": np.cos(t)}
    read = Recording.read({"time [min]": t / 60.0, **log}, joints=1)
    np.testing.assert_allclose(read.t - read.t[0], t, atol=1e-12)
    names = ["time_days", "q1", "tau1"]
    assert "state `time_unit` in [log]" in question(names, 1, {"time": "time_days"})
    assert find(names, 1, {"time": "time_days", "time_unit": "h"}).time_unit == "h"


def test_what_is_stated_comes_before_what_columns_say() -> None:
    layout = find(["t", "q1 [deg]", "tau1 [mNm]"], 1, {"position_unit": "rad", "torque_unit": "N·m"})
    assert (layout.units["position"], layout.units["torque"]) == (("rad",), ("N·m",))
    assert find(["t", "q1 [deg]", "tau1"], 1, {"position": "q{} [deg]"}).units["position"] == ("deg",)


@pytest.mark.parametrize(
    ("column", "first", "unit"),
    [
        *(("t", 0.0, "s"), ("__time", 1.7e9, "s"), ("stamp", 1.7e12, "ms"), ("Timestamp", 1.7e15, "us")),
        *(("time", 1.7e18, "ns"), ("%time", 1.7e18, "ns"), ("time_ns", 5.0, "ns"), ("Time [ms]", 0.0, "ms")),
        *(("Zeit in ms", 0.0, "ms"), ("time / s", 0.0, "s"), ("time [min]", 0.0, "min"), ("Time (h)", 0.0, "h")),
        *(("elapsed_us", 1.0, "us"), ("timestamp", 12345.0, "s"), ("header.stamp", 1.7e18, "ns"), ("t (s)", 3.0, "s")),
    ],
)
def test_units_of_times(column: str, first: float, unit: str) -> None:
    values = {"".join(c if c.isalnum() else "_" for c in column): [np.nan, first, first + 1.0]}
    layout = find([column, "q1", "tau1"], 1, **values)
    assert (layout.time, layout.time_unit) == (column, unit)
    stated = find([column, "q1", "tau1"], 1, {"time": column, "time_unit": "ms"}, **values)
    assert stated.time_unit == "ms"


@pytest.mark.parametrize(
    ("whole", "rest", "scale"),
    [
        *(("sec", "nanosec", 1e-9), ("header.stamp.sec", "header.stamp.nanosec", 1e-9), ("secs", "nsecs", 1e-9)),
        *(("/joint_states/header/stamp/sec", "/joint_states/header/stamp/nanosec", 1e-9), ("tv_sec", "tv_usec", 1e-6)),
        *(("Seconds", "Nanoseconds", 1e-9), ("stamp_sec", "stamp_nsec", 1e-9)),
    ],
)
def test_seconds_and_nanoseconds_are_one_time(whole: str, rest: str, scale: float) -> None:
    names = [rest, "q1", whole, "tau1"]
    layouts = [find(names, 1), find(names, 1, {"time": [whole, rest]})]
    for layout in layouts:
        assert layout.stamps == (whole, rest)
        seconds = layout.seconds({whole: np.array([3.0, 4.0]), rest: np.array([0.5, 0.25]) / scale})
        np.testing.assert_allclose(seconds, [3.5, 4.25], rtol=1e-15)


def test_the_stamp_of_the_message_is_taken_before_that_of_its_arrival() -> None:
    names = ["__time", "/js/header/stamp", *(f"/js/{joint}/{word}" for joint in ARM for word in ("position", "effort"))]
    assert find(names).time == "/js/header/stamp"
    assert find(names, _js_header_stamp=[0.0, 0.0, 0.0]).time == "__time"  # nobody has set it
    other = ["__time", "/camera/header/stamp", *names[2:]]
    assert find(other).time == "__time"


def test_several_clocks_are_a_question_unless_they_run_alike() -> None:
    names = ["t", "timestamp", "q1", "tau1"]
    asked = question(names, 1, t=[0.0, 1.0, 2.0], timestamp=[0.0, 1.1, 2.0])
    assert [one.time for one in answered(asked, names, 1)] == ["t", "timestamp"]
    assert find(names, 1, t=[0.0, 1.0, 2.0], timestamp=[1.7e12, 1.7e12 + 1e3, 1.7e12 + 2e3]).time == "t"


def test_further_words_for_times_are_taken_where_there_is_no_other() -> None:
    assert find(["date", "elapsed_ms", "time", "q1", "tau1"], 1).time == "time"
    assert find(["elapsed_ms", "q1", "tau1"], 1).time_unit == "ms"


def test_times_that_cannot_be_read_are_no_times() -> None:
    def values(name: str) -> list[np.ndarray]:
        if name == "stamp":
            raise InputError("log.csv, line 2, holds 'noon' in column 'stamp'; expected a number.")
        return [np.array([0.0, 1.0])]

    assert find_columns(["stamp", "t", "q1", "tau1"], joints=1, values=values).time == "t"


def test_letters_with_numbers_are_positions_where_nothing_else_is() -> None:
    names = ["t", *numbered("A{}", "J{}", "T{}", "q{}", "tau{}")]  # accelerations, jerks, temperatures
    layout = find(names)
    assert (layout.position[0], layout.torque[0], layout.guesses) == ("q1", "tau1", ())


def test_one_joint_needs_no_number() -> None:
    layout = find(["t", "q", "dq", "tau"], ("hinge",))
    assert layout.table[1] == ColumnMeaning("q", "hinge", "position", "rad", "number")
    assert find_columns(["t", "q", "tau"]).position == ("q",)
    assert "no columns that look like positions" in question(["t", "q", "tau"], 2)


@pytest.mark.parametrize(
    "form",
    [
        *("{joint}/{word}", "/joint_states/{joint}/{word}", "{word}[{joint}]", "/js/{word}[{joint}] [rad]"),
        *(
            pytest.param(form, marks=pytest.mark.slow)
            for form in ("{joint}.{word}", "{word}_{joint}", "{joint} {word}", "/arm/{word}.{joint}")
        ),
    ],
)
def test_joints_that_nobody_named_are_those_of_the_log(form: str) -> None:
    joints = ("Wrist", "elbow_joint", "shoulder_1")
    forms = {word: form if word == "position" else form.removesuffix(" [rad]") for word in ("position", "effort")}
    names = ["t", *(forms[word].format(joint=joint, word=word) for word in forms for joint in joints), "temperature"]
    for count in (None, 3):
        layout = find_columns(names, joints=count)
        assert [(one.joint, one.quantity) for one in layout.table[1:4]] == [(joint, "position") for joint in joints]
        assert layout.torque == tuple(names[4:7])
        assert layout.guesses == ()
    assert "the robot has 2" in question(names, 2)


def test_lists_of_names_hold_for_what_is_below_their_topic() -> None:
    labels = [f"/jtc/state/joint_names[{k}]" for k in range(3)]
    numbers = [
        f"/jtc/state/{part}/{word}[{k}]"
        for part in ("reference", "feedback")
        for word in ("positions", "effort")
        for k in range(3)
    ]
    layout = find_columns(["t", *labels, *numbers], joints=ARM, labels=("elbow", "shoulder", "wrist"))
    assert layout.position == tuple(f"/jtc/state/feedback/positions[{k}]" for k in (1, 0, 2))


def test_what_was_found_can_be_stated() -> None:
    for names in (
        ["Time [ms]", *numbered("Joint {} position [deg]", "Joint {} velocity [rpm]", "Joint {} torque [mNm]")],
        ["sec", "nanosec", *numbered("J{}", "T{}")],
    ):
        found = find(names, J1=[90.0])
        stated = find(names, log=found.settings())
        told = [(one.column, one.joint, one.quantity, one.unit) for one in found.table]
        assert [(one.column, one.joint, one.quantity, one.unit) for one in stated.table] == told
        assert all(one.by == "[log]" for one in stated.table)
        assert stated.guesses == ()


def test_the_table_is_printed() -> None:
    lines = str(find(["t", *numbered("J{}", "T{}")], J1=[90.0])).splitlines()
    assert lines[0].split() == ["column", "joint", "quantity", "unit", "told", "by"]
    assert lines[2].split() == ["J1", "shoulder", "position", "deg", "number,", "from", "1", "(ABB)"]
    assert "<td>wrist</td>" in find(["t", *numbered("q{}", "tau{}")])._repr_html_()


@pytest.mark.slow
def test_a_header_of_thousands_of_columns() -> None:
    others = [f"/world/body_{k}/contact_{k}/force_{k}" for k in range(3000)]
    assert find(["t", *others, *numbered("q{}", "tau{}", count=30)], 30).torque[-1] == "tau30"


def test_the_page_lists_all_words_and_writers() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "log-files.md").read_text(encoding="utf-8")
    section = page.partition("## Columns")[2].partition("### What was understood")[0]
    words = {word for style in STYLES for word in style.words if f"actual_{word}" in style.words}
    assert len(words) > 30
    assert [
        word for word in sorted(words | set(TIME_WORDS) | set(FURTHER_TIME_WORDS)) if f"`{word}`" not in section
    ] == []
    assert [style.writer for style in STYLES if style.writer.removeprefix("UR ") not in section] == []


def test_only_a_matrix_keeps_the_units_of_sliding_joints_open() -> None:
    """Not a joint whose name has the word in it."""
    names = ["t", "matrix_gantry_position", "arm_position", "matrix_gantry_effort", "arm_effort"]
    plain = find(names, ("matrix_gantry", "arm")).of_joints(["m", "rad"])
    assert [one.unit for one in plain.table] == ["s", "m", "rad", "N", "N·m"]
    assert plain.settings()["position_unit"] == ["m", "rad"]
    assert plain.settings()["torque_unit"] == ["N", "N·m"]
    coupled = find(["t", "q1", "q2", "tau1", "tau2"], 2, {"position_matrix": [[1, 0], [1, 1]]})
    assert coupled.has_matrix
    assert coupled.of_joints(["m", "rad"]) == coupled


def test_forces_of_joints_that_slide_stand_beside_torques_of_those_that_turn() -> None:
    """A gantry with a head: one word for what is in N, another for what is in N·m."""
    found = find(["t", "x_pos [mm]", "y_pos [mm]", "c_pos [deg]", "x_force [N]", "y_force [N]", "c_torque [Nm]"], "xyc")
    assert found.torque == ("x_force [N]", "y_force [N]", "c_torque [Nm]")
    assert found.units["torque"] == ("N", "N", "N·m")
    with pytest.raises(InputError, match=r"torques for x, y, but has c_torque"):  # a sensor at the tool
        find(["t", "x_pos", "y_pos", "c_pos", "force_x", "force_y", "c_torque"], "xyc")


def test_torques_of_some_joints_beside_the_positions_of_all(tmp_path) -> None:
    """The joint without a torque was to be held still, though it moved; an arm on a rail was weighed wrongly so."""
    t = np.arange(400) / 100.0
    columns = {"t": t, "rail_pos": 0.3 * np.sin(t), "arm_pos": np.sin(2.0 * t), "arm_tau": np.cos(t)}
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    for stated in ({}, {"torque": ["", "arm_tau"]}):
        recording = Recording.read(path, stated, joints=("rail", "arm"))
        assert recording.layout is not None
        assert recording.layout.torque == ("", "arm_tau")
        assert recording.layout.names == ("t", "rail_pos", "arm_pos", "arm_tau")
        np.testing.assert_allclose(recording.q, np.column_stack([columns["rail_pos"], columns["arm_pos"]]), atol=1e-9)
        np.testing.assert_allclose(recording.torque[:, 1], columns["arm_tau"], atol=1e-9)
        samples = recording.process(cutoff=10.0)
        assert samples.used_rows.any(axis=0).tolist() == [False, True]
    guess = "No torque of rail was logged: the motion is used, and the torques of the other joints."
    assert Recording.read(path, joints=("rail", "arm")).layout.guesses == (guess,)
    with pytest.raises(InputError, match=r'1 columns of torque .* for 2 joints; .* and "" for a joint of which none'):
        Recording.read(path, {"torque": ["arm_tau"]}, joints=("rail", "arm"))
    without = {name: values for name, values in columns.items() if name != "arm_tau"}
    with pytest.raises(InputError, match="no column"):
        find(list(without), ("rail", "arm"))
