"""Bags and MCAP files as others write them: topics, joints by name, stamps, and what is damaged."""

import contextlib
import dataclasses
import json
import sqlite3
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bombs import zstd
from log_writers import BAGS, START, State, states, write_mcap_json, write_mcap_ros, write_ros1, write_ros2

from steelyard.errors import InputError, MissingExtraError
from steelyard.recording import Processing, Recording, Samples, process_chunks
from steelyard.recording.formats.joint_messages import JointRows
from steelyard.recording.formats.mcap_file import McapFile
from steelyard.recording.formats.message_log import MessageLog
from steelyard.recording.formats.ros1_bag import Ros1Bag

pytest.importorskip("rosbags", reason="bags are read with rosbags")
pytest.importorskip("mcap", reason="MCAP files are read with mcap")

S = 300
T = np.arange(S) / 250
JOINTS = ("shoulder", "elbow", "wrist")
Q = np.column_stack([np.sin(2 * T), np.cos(3 * T), np.sin(T + 0.3)])
DQ = np.column_stack([2 * np.cos(2 * T), -3 * np.sin(3 * T), np.cos(T + 0.3)])
TORQUE = 3 * Q - DQ
STATES = states(T, JOINTS, Q, DQ, TORQUE)


def part(state: State, *joints: str, **others: Any) -> State:
    """Return the message of some of the joints, in the order in which they are named."""
    places = [JOINTS.index(joint) for joint in joints]
    numbers = {name: np.asarray(getattr(state, name))[places] for name in ("position", "velocity", "effort")}
    return state._replace(names=joints, **numbers, **others)


def expect(found: Recording, joints: tuple[str, ...] = JOINTS, rows: slice = slice(None)) -> None:
    places = [JOINTS.index(joint) for joint in joints]
    np.testing.assert_array_equal(found.t, T[rows])
    np.testing.assert_array_equal(found.q, Q[rows][:, places])
    assert found.velocity is not None
    np.testing.assert_array_equal(found.velocity, DQ[rows][:, places])
    np.testing.assert_array_equal(found.torque, TORQUE[rows][:, places])


@pytest.mark.parametrize("name", BAGS)
def test_every_bag_gives_the_numbers_that_were_written(name: str, tmp_path: Path) -> None:
    path = BAGS[name](tmp_path / name, {"/joint_states": STATES})
    expect(Recording.read(path, joints=JOINTS))
    expect(Recording.read(path), JOINTS)
    expect(Recording.read(path, joints=JOINTS[::-1]), JOINTS[::-1])
    expect(Recording.read(path, joints=("wrist",)), ("wrist",))
    processing = Processing(cutoff=None, trim=0.0, velocity_threshold=None)
    joined = Samples.joined(list(process_chunks(path, None, processing, 90, JOINTS)))
    np.testing.assert_array_equal(joined.torque, TORQUE)


def test_rows_are_found_without_those_before_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = Ros1Bag(BAGS["ros1.bag"](tmp_path / "ros1.bag", {"/joint_states": STATES}))
    taken = []
    found = JointRows.columns
    monkeypatch.setattr(JointRows, "columns", lambda *given: taken.append(given[2:]) or found(*given))
    for start in (0, 7, 199, S - 1):
        blocks = list(file.blocks_from(start, ["position[elbow]"], 100))
        np.testing.assert_array_equal(np.concatenate([block["position[elbow]"] for block in blocks]), Q[start:, 1])
        assert {len(block["position[elbow]"]) for block in blocks[:-1]} <= {100}
    assert taken == [
        (0, 100),
        (100, 200),
        (200, 300),
        (7, 107),
        (107, 207),
        (207, 307),
        (199, 299),
        (299, 399),
        (299, 399),
    ]


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_the_file_in_the_folder_of_a_bag_is_read_too(storage: str, tmp_path: Path) -> None:
    folder = write_ros2(tmp_path / "run", {"/joint_states": STATES}, storage)
    (file,) = (path for path in folder.iterdir() if path.suffix != ".yaml")
    expect(Recording.read(file, joints=JOINTS))


@pytest.mark.parametrize("name", ["ros2_sqlite", "ros2_sqlite_file", "ros2_mcap", "ros2_mcap_file"])
def test_a_bag_may_have_several_files(name: str, tmp_path: Path) -> None:
    """As `ros2 bag record --max-bag-size` makes them; the description lists them in their order."""
    first, second = (
        BAGS[name](tmp_path / part, {"/joint_states": some})
        for part, some in (("b", STATES[:100]), ("a", STATES[100:]))
    )
    (file,), (other,) = ([path for path in folder.iterdir() if path.suffix != ".yaml"] for folder in (first, second))
    other.rename(first / other.name)
    description = first / "metadata.yaml"
    lines = description.read_text().splitlines()
    (place,) = (k for k, line in enumerate(lines) if line.strip() == f"- {file.name}")
    lines.insert(place + 1, lines[place].replace(file.name, other.name))
    description.write_text("\n".join(lines))
    expect(Recording.read(first, joints=JOINTS))


@pytest.mark.parametrize("kind", [Ros1Bag, McapFile])
def test_messages_come_in_the_order_of_their_recording(kind: type[MessageLog], tmp_path: Path) -> None:
    """Chunks may hold messages that were recorded before those of chunks in front of them."""
    recorded = START + 200_000_000 * np.random.default_rng(4).permutation(S)
    messages = [state._replace(stamp=0, recorded=int(time)) for state, time in zip(STATES, recorded, strict=True)]
    path = tmp_path / "run"
    if kind is Ros1Bag:
        write_ros1(path, {"/joint_states": messages}, "LZ4", chunk_size=2000)
    else:
        write_mcap_json(path, {"/joint_states": messages}, chunk_size=2000)
    found = kind(path).read(["recorded", "position[elbow]"])
    np.testing.assert_allclose(found["recorded"], 0.2 * np.arange(S), rtol=1e-12)
    np.testing.assert_array_equal(found["position[elbow]"], Q[np.argsort(recorded), 1])


@pytest.mark.parametrize("left_out", ["schemas", "channels", "counts"])
def test_summaries_of_mcap_may_leave_out_what_stands_elsewhere(
    left_out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if left_out == "counts":  # by channel, as the specification allows
        records = pytest.importorskip("mcap.records")
        write = records.Statistics.write
        uncounted = lambda one, stream: write(dataclasses.replace(one, channel_message_counts={}), stream)  # noqa: E731
        monkeypatch.setattr(records.Statistics, "write", uncounted)
        options = {}
    else:
        options = {f"repeat_{left_out}": False}
    expect(Recording.read(write_mcap_ros(tmp_path / "run.mcap", {"/joint_states": STATES}, **options), joints=JOINTS))


def test_large_chunks_are_read_where_the_file_is_as_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from steelyard.recording.formats import unpacking

    monkeypatch.setattr(unpacking, "AT_ONCE", 1000)
    noise = np.random.default_rng(0).bytes(5000)
    opened = unpacking.Unpacking(tmp_path, 5000)
    assert opened.unpacked("zstd", zstd(noise), 5000) == noise == opened.unpacked("zstd", zstd(noise))
    for size in (5000, None):
        with pytest.raises(InputError, match="unpack to more than"):
            opened.unpacked("zstd", zstd(bytes(5000)), size)


def bag(folder: Path, messages: list[State]) -> Path:
    return write_mcap_json(folder / "run.mcap", {"/joint_states": messages})


def test_a_bag_is_decoded_once_until_it_is_written_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from steelyard.recording.formats import mcap_file

    opened = []
    decoder = mcap_file._decoder
    monkeypatch.setattr(mcap_file, "_decoder", lambda *given: opened.append(1) or decoder(*given))
    path = bag(tmp_path, STATES)
    expect(Recording.read(path, joints=("wrist",)), ("wrist",))
    once = len(opened)
    expect(Recording.read(path, joints=JOINTS))  # other rows of the same messages
    assert len(opened) == once > 0
    bag(tmp_path, STATES[:200])
    assert Recording.read(path, joints=JOINTS).count == 200


def test_orders_of_joints_may_change_from_message_to_message(tmp_path: Path) -> None:
    orders = [("elbow", "wrist", "shoulder"), ("wrist", "elbow", "shoulder"), JOINTS]
    expect(Recording.read(bag(tmp_path, [part(m, *orders[k % 3]) for k, m in enumerate(STATES)]), joints=JOINTS))


def test_messages_of_one_stamp_make_one_row(tmp_path: Path) -> None:
    """Of two publishers one is late, by more than the time between its messages."""
    arm = [part(state, "shoulder", "elbow") for state in STATES]
    hand = [part(state, "wrist", recorded=state.stamp + 30_000_000) for state in STATES]
    expect(Recording.read(bag(tmp_path, arm + hand), joints=JOINTS))


def test_joints_of_others_leave_no_rows(tmp_path: Path) -> None:
    """A gripper has stamps of its own; where it is asked for, it is interpolated to those of the arm."""
    hand = [part(state, "wrist", stamp=state.stamp - 1_000_000) for state in STATES]
    path = bag(tmp_path, [part(state, "shoulder", "elbow") for state in STATES] + hand)
    expect(Recording.read(path, joints=("elbow", "shoulder")), ("elbow", "shoulder"))
    expect(Recording.read(path, joints=("wrist",)), ("wrist",))
    found = Recording.read(path, joints=JOINTS)
    np.testing.assert_array_equal(found.q[:, :2], Q[:-1, :2])  # the gripper ends before the arm
    np.testing.assert_allclose(found.q[:, 2], 0.75 * Q[:-1, 2] + 0.25 * Q[1:, 2], rtol=1e-12)  # 1 ms of 4
    assert found.layout is not None
    assert any("wrist" in guess and "interpolated" in guess for guess in found.layout.guesses)


def test_stamps_are_those_of_the_recording_where_headers_have_none(tmp_path: Path) -> None:
    messages = [state._replace(stamp=0, recorded=state.logged) for state in STATES]
    expect(Recording.read(bag(tmp_path, messages), joints=JOINTS))
    one = [STATES[0]._replace(stamp=0, recorded=STATES[0].logged), *STATES[1:]]
    found = Recording.read(bag(tmp_path, one), joints=JOINTS)
    expect(found)
    assert f"1 of {S} messages has no stamp in the header" in " ".join(found.layout.guesses)
    same = [state._replace(stamp=START, recorded=state.logged) for state in STATES]
    expect(Recording.read(bag(tmp_path, same), joints=JOINTS))


def test_time_of_the_recording_can_be_chosen(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    late = [state._replace(recorded=state.stamp + int(rng.integers(100_000))) for state in STATES]
    found = Recording.read(bag(tmp_path, late), {"time": "recorded"}, JOINTS)
    logged = np.array([state.logged for state in late])
    np.testing.assert_array_equal(found.t, (logged - logged[0]) / 1e9)


def test_messages_that_were_sent_twice_count_once(tmp_path: Path) -> None:
    again = [state._replace(recorded=state.logged + 9000) for state in STATES[::7]]
    expect(Recording.read(bag(tmp_path, STATES + again), joints=JOINTS))


def test_two_messages_of_one_stamp_that_contradict_are_refused(tmp_path: Path) -> None:
    other = STATES[50]._replace(position=[0.77, *STATES[50].position[1:]], recorded=STATES[50].logged + 9)
    with pytest.raises(InputError, match=r"row 52, repeats the time 0\.2 s"):
        Recording.read(bag(tmp_path, [*STATES, other]), joints=JOINTS)


def test_a_simulation_that_began_anew_is_no_row_in_between(tmp_path: Path) -> None:
    again = [state._replace(stamp=state.stamp + 1000, recorded=state.logged + 3 * 10**9) for state in STATES]
    with pytest.raises(InputError, match=r"row 301, goes back in time from 1\.196 s"):
        Recording.read(bag(tmp_path, STATES + again), joints=JOINTS)


def test_velocities_that_are_no_numbers_can_be_left_out(tmp_path: Path) -> None:
    path = bag(tmp_path, [state._replace(velocity=[float("nan")] * 3) for state in STATES])
    with pytest.raises(InputError, match=r'leave out .* with `velocity = "none"` in \[log\]'):
        Recording.read(path, joints=JOINTS)
    found = Recording.read(path, {"velocity": "none"}, JOINTS)
    np.testing.assert_array_equal(found.q, Q)


def test_quantities_that_are_not_there_are_no_columns(tmp_path: Path) -> None:
    still = [state._replace(velocity=[]) for state in STATES]
    assert Recording.read(bag(tmp_path, still), joints=JOINTS).velocity is None
    weak = [state._replace(effort=[]) for state in STATES]
    with pytest.raises(InputError, match=r"no columns .* torque|torque"):
        Recording.read(bag(tmp_path, weak), joints=JOINTS)
    once = [state._replace(effort=[]) if k == 9 else state for k, state in enumerate(STATES)]
    with pytest.raises(InputError, match=r"in 1 of 300 rows, first on row 10"):
        Recording.read(bag(tmp_path, once), joints=JOINTS)


def test_lengths_and_names_must_fit(tmp_path: Path) -> None:
    short = [STATES[0], STATES[1]._replace(effort=[1.0])]
    with pytest.raises(InputError, match=r"topic /joint_states, message 2, has 1 values of effort for 3 joints"):
        Recording.read(bag(tmp_path, short))
    twice = [state._replace(names=("a", "b", "a")) for state in STATES]
    with pytest.raises(InputError, match="message 1, names the joint 'a' twice"):
        Recording.read(bag(tmp_path, twice))
    changing = [state._replace(names=[f"{name}{k}" for name in JOINTS]) for k, state in enumerate(STATES * 2)]
    with pytest.raises(InputError, match="in more than 300 ways"):
        Recording.read(bag(tmp_path, changing))


def test_topics_are_found_named_or_asked_for(tmp_path: Path) -> None:
    weak = [state._replace(effort=[]) for state in STATES]
    one = write_ros1(tmp_path / "one.bag", {"/arm/joint_states": STATES, "/wheels/joint_states": weak})
    expect(Recording.read(one, joints=JOINTS))  # the other one has no torques
    doubled = [state._replace(effort=2 * np.asarray(state.effort)) for state in STATES]
    two = write_ros2(tmp_path / "two", {"/left/joint_states": STATES, "/right/joint_states": doubled})
    with pytest.raises(
        InputError, match=r"several topics, /left/joint_states .sensor_msgs/msg/JointState, 300 messages"
    ) as asked:
        Recording.read(two, joints=JOINTS)
    assert 'topic = "/left/joint_states"' in str(asked.value)
    found = Recording.read(two, {"topic": "right/joint_states"}, JOINTS)
    np.testing.assert_array_equal(found.torque, 2 * TORQUE)
    with pytest.raises(InputError, match=r"no topic '/lft/joint_states'.*did you mean \"/left/joint_states\""):
        Recording.read(two, {"topic": "/lft/joint_states"}, JOINTS)


def test_a_type_of_another_name_is_known_by_its_fields(tmp_path: Path) -> None:
    path = write_mcap_json(tmp_path / "run.mcap", {"/arm": STATES}, "my.Measurements")
    expect(Recording.read(path, joints=JOINTS))


def test_messages_of_other_kinds_are_no_joint_states(tmp_path: Path) -> None:
    from mcap.writer import Writer

    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/camera", "json", 0)
        for k in range(5):
            writer.add_message(channel, k, json.dumps({"name": "left", "gain": [1, k]}).encode(), k)
        writer.finish()
    with pytest.raises(
        InputError, match=r"no topic of sensor_msgs/JointState .* it has /camera .of no type, 5 messages"
    ):
        Recording.read(path)
    with pytest.raises(InputError, match=r"the topic /camera .of no type, 5 messages. holds no numbers of joints"):
        Recording.read(path, {"topic": "/camera"})


def test_foxglove_lists_joints_one_by_one(tmp_path: Path) -> None:
    from mcap.writer import Writer

    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("foxglove.JointStates", "jsonschema", b"{}")
        channel = writer.register_channel("/joints", "json", schema)
        for state in STATES:
            numbers = zip(state.names, state.position, state.velocity, state.effort, strict=True)
            keys = ("name", "position", "velocity", "effort")
            stamp = {"sec": state.stamp // 10**9, "nsec": state.stamp % 10**9}
            content = {"timestamp": stamp, "joints": [dict(zip(keys, values, strict=True)) for values in numbers]}
            writer.add_message(channel, state.logged, json.dumps(content).encode(), state.stamp)
        writer.finish()
    expect(Recording.read(path, joints=JOINTS))


POINT = "trajectory_msgs/JointTrajectoryPoint"
HEAD = "std_msgs/Header header\nstring[] joint_names\n"
OLD = HEAD + "".join(f"{POINT} {name}\n" for name in ("desired", "actual", "error"))
NEW = (
    HEAD
    + "".join(f"{POINT} {name}\n" for name in ("reference", "feedback", "error", "output"))
    + "string[] multi_dof_joint_names\n"
    + "".join(
        f"trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_{name}\n"
        for name in ("reference", "feedback", "error", "output")
    )
)
CONTROLLER = "control_msgs/msg/JointTrajectoryControllerState"


def write_controller_states(path: Path, definition: str, *, ros1: bool) -> Path:
    """Write what a controller of trajectories publishes; `error` and the reference are other numbers."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(definition, CONTROLLER))
    types = store.types
    fields = [field.name for field in dataclasses.fields(types[CONTROLLER])]
    nothing = np.empty(0)

    def point(scale: float, state: State) -> Any:
        elapsed = types["builtin_interfaces/msg/Duration"](0, 0)
        numbers = (scale * np.asarray(x) for x in (state.position, state.velocity))
        return types["trajectory_msgs/msg/JointTrajectoryPoint"](
            *numbers, nothing, scale * np.asarray(state.effort), elapsed
        )

    def message(state: State) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](state.stamp // 10**9, state.stamp % 10**9)
        header = types["std_msgs/msg/Header"](*([0] if ros1 else []), stamp, "base")
        scales = {"desired": 5.0, "reference": 5.0, "actual": 1.0, "feedback": 1.0, "error": 4.0, "output": 7.0}
        values = {name: point(scale, state) for name, scale in scales.items() if name in fields}
        if "multi_dof_output" in fields:
            several = types["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"]
            empty = several([], [], [], types["builtin_interfaces/msg/Duration"](0, 0))
            values |= {f"multi_dof_{name}": empty for name in ("reference", "feedback", "error", "output")}
            values["multi_dof_joint_names"] = []
        return types[CONTROLLER](header=header, joint_names=list(JOINTS), **values)

    writer = rosbag1.Writer(path) if ros1 else rosbag2.Writer(path, version=9)
    with writer:
        connection = writer.add_connection("/arm_controller/state", CONTROLLER, typestore=store)
        for state in STATES:
            data = (store.serialize_ros1 if ros1 else store.serialize_cdr)(message(state), CONTROLLER)
            writer.write(connection, state.logged, data)
    return path


@pytest.mark.parametrize("definition", [OLD, NEW], ids=["actual", "feedback"])
@pytest.mark.parametrize("without_definitions", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_controller_states_of_ros2(definition: str, without_definitions: bool, tmp_path: Path) -> None:
    path = write_controller_states(tmp_path / "run", definition, ros1=False)
    if without_definitions:  # as until Humble
        _take_definitions_out(path)
    expect(Recording.read(path, joints=JOINTS))


def test_controller_states_of_ros1(tmp_path: Path) -> None:
    expect(Recording.read(write_controller_states(tmp_path / "run.bag", OLD, ros1=True), joints=JOINTS))


def _take_definitions_out(folder: Path) -> None:
    (file,) = folder.glob("*.db3")
    with contextlib.closing(sqlite3.connect(file)) as database:
        database.execute("DELETE FROM message_definitions")
        database.commit()


def test_joint_states_without_definitions(tmp_path: Path) -> None:
    path = write_ros2(tmp_path / "run", {"/joint_states": STATES})
    _take_definitions_out(path)
    expect(Recording.read(path, joints=JOINTS))


@pytest.mark.parametrize("change", ["cut off", "first half missing", "zeros", "short"])
@pytest.mark.parametrize(
    "name", ["ros1.bag", "ros1_bz2.bag", "ros2_sqlite", "ros2_mcap", "json.mcap", "cdr.mcap", "protobuf.mcap"]
)
def test_damaged_bag_is_one_sentence(name: str, change: str, tmp_path: Path) -> None:
    path = BAGS[name](tmp_path / name, {"/joint_states": STATES})
    file = next(file for file in path.iterdir() if file.suffix != ".yaml") if path.is_dir() else path
    data = file.read_bytes()
    middle = len(data) // 2
    changed = {
        "cut off": data[:middle],
        "first half missing": data[middle:],
        "zeros": data[:middle] + bytes(len(data) - middle),
        "short": data[:20],
    }
    file.write_bytes(changed[change])
    with pytest.raises(InputError, match=r"cannot be read as (a bag of ROS|MCAP)[^\n]*(reindex|recover)[^\n]*\.$"):
        Recording.read(path)


def test_a_size_that_no_memory_holds_is_one_sentence(tmp_path: Path) -> None:
    path = write_ros2(tmp_path / "run", {"/joint_states": STATES}, "MCAP")
    file = next(file for file in path.iterdir() if file.suffix != ".yaml")
    data = bytearray(file.read_bytes())
    chunk = 17 + int.from_bytes(data[9:17], "little")  # behind the first record
    assert data[chunk] == 6
    name = chunk + 9 + 28  # of its compression, behind its times, its size and its checksum
    size = name + 4 + int.from_bytes(data[name : name + 4], "little")
    data[size : size + 8] = (2**60).to_bytes(8, "little")
    file.write_bytes(data)
    with pytest.raises(InputError, match=r"as a bag of ROS 2: a size that stands in it is larger than the memory;"):
        Recording.read(path)


@pytest.mark.parametrize(
    "content", ["", "rosbag2_bagfile_information: 3", "- [", "rosbag2_bagfile_information: {version: 99}"]
)
def test_damaged_metadata_is_one_sentence(content: str, tmp_path: Path) -> None:
    path = write_ros2(tmp_path / "run", {"/joint_states": STATES[:5]})
    (path / "metadata.yaml").write_text(content)
    with pytest.raises(InputError, match=r"cannot be read as a bag of ROS 2"):
        Recording.read(path)


@pytest.mark.parametrize(
    ("name", "module"),
    [("ros1.bag", "rosbags.rosbag1.reader"), ("ros2_sqlite", "rosbags.typesys"), ("cdr.mcap", "mcap.stream_reader")],
)
def test_missing_library_is_named(name: str, module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = BAGS[name](tmp_path / name, {"/joint_states": STATES[:5]})
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=r"pip install 'rosbags>="):
        Recording.read(path)


def test_a_file_that_is_missing_is_named(tmp_path: Path) -> None:
    path = write_ros2(tmp_path / "run", {"/joint_states": STATES[:5]})
    (path / "run.db3").rename(tmp_path / "run.db3")
    with pytest.raises(InputError, match=r"its file 'run.db3' is not there; mend it with `ros2 bag reindex`"):
        Recording.read(path)


def test_a_long_bag_takes_the_memory_of_a_block(tmp_path: Path) -> None:
    """The numbers stand in a file; blocks of them are all that comes into memory."""
    from steelyard.recording.formats.joint_messages import BLOCK, JointMessage, JointTable

    table = JointTable("run")
    values = tuple(np.arange(3.0) + kind for kind in range(3))
    for k in range(3 * BLOCK + 5):
        table.add(JointMessage(1 + k, JOINTS, tuple(value + k for value in values)), k)
    table.finish()
    assert isinstance(table._numbers, np.memmap)
    block = table.rows(table.names).columns(["time", "effort[wrist]"], 2 * BLOCK - 1, 2 * BLOCK + 1)
    np.testing.assert_array_equal(block["effort[wrist]"], [4.0 + 2 * BLOCK - 1, 4.0 + 2 * BLOCK])
    np.testing.assert_array_equal(block["time"], np.arange(2 * BLOCK - 1, 2 * BLOCK + 1) / 1e9)
