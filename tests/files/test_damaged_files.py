"""Damaged files of every kind are read or refused; nothing else comes out, and no number that is none.

`benchmarks/damaged_files.py` tries tens of thousands. What it found stands here as cases of their own.
"""

import hashlib
import io
import json
import os
import random
import signal
import zipfile
from pathlib import Path

import numpy as np
import pytest
from mutations import LIMITS, MESHES, MJCF, READERS, ROBOT, SDF, TAKES_LONG, URDF, damaged, is_readable, write_samples

import steelyard as sy
from steelyard.errors import InputError, SteelyardError
from steelyard.excitation import MotionLimits, load_trajectory
from steelyard.feasibility.constraints.center_of_mass import read_points
from steelyard.files.reading import reading_table
from steelyard.fleet.packed import unpacked

COUNT = 8


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("samples")
    write_samples(folder)
    return folder


@pytest.mark.parametrize("kind", READERS)
def test_valid_files_are_read(kind: str, samples: Path) -> None:
    if kind in {*MESHES, "limits.toml"}:
        pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")
    skip_unless_readable(kind)
    READERS[kind][0](samples / kind)


def skip_unless_readable(kind: str) -> None:
    if not is_readable(kind):
        pytest.skip("the libraries that read such files (extras `logs`, `xacro`) are not installed")


@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=[pytest.mark.slow] * (kind in TAKES_LONG)) for kind in READERS if kind not in MESHES],
)
def test_damaged_files_are_read_or_refused(kind: str, samples: Path, capfd: pytest.CaptureFixture[str]) -> None:
    skip_unless_readable(kind)
    content = (samples / kind).read_bytes()
    place = samples / f"damaged-{kind}"
    messages: list[str] = []
    for number in range(COUNT):
        place.write_bytes(damaged(content, kind, random.Random(f"{kind} 0 {number}")))
        for read in READERS[kind]:
            try:
                read(place)
            except SteelyardError as error:
                messages.append(str(error))
    assert len(messages) > COUNT / 8
    assert [message for message in messages if "\n" in message or len(message) > 1000] == []
    assert capfd.readouterr() == ("", "")


def refuse(kind: str, samples: Path, content: bytes | str, phrase: str) -> None:
    place = samples / f"made-{kind}"
    place.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as caught:
        [read(place) for read in READERS[kind]]
    assert phrase in str(caught.value)
    assert len(str(caught.value)) < 1000


TEXTS = {
    "mass of 1e308": (
        "robot.urdf",
        URDF,
        '<mass value="2"/>',
        '<mass value="1e308"/>',
        "value of <mass> is beyond 1e+15",
    ),
    "axis that underflows": (
        "robot.urdf",
        URDF,
        '<axis xyz="0 1 0"/>\n    <limit lower="-3" upper="3" effort="50" velocity="5"/><dynamics',
        '<axis xyz="1e-320 0 0"/><dynamics',
        'joint "shoulder": its axis is',
    ),
    "long integer": ("robot.toml", ROBOT, "trim = 0.5", f"trim = {'9' * 400}", "beyond 64 bits"),
    "kind in a list": ("robot.toml", ROBOT, 'kind = "viscous"', 'kind = ["viscous"]', "kind is ['viscous']"),
    "far point of a hull": ("robot.toml", ROBOT, "[1, 0, 0], [0, 1", "[1e308, 0, 0], [0, 1", "beyond 1e+09 m"),
    "NUL in a path": (
        "robot.toml",
        ROBOT,
        'convention = "standard"\nrows = [["pi/2", 0, 0.3, "q"], [0, 0.5, 0, "q+pi/2"]]',
        'urdf = "a\\u0000b"',
        "a character that is not valid in a text",
    ),
    "endless URDF": (
        "robot.toml",
        ROBOT,
        'convention = "standard"\nrows = [["pi/2", 0, 0.3, "q"], [0, 0.5, 0, "q+pi/2"]]',
        'urdf = "/dev/zero"',
        "is a device",
    ),
    "ragged list": ("limits.toml", LIMITS, "lower = [-1, -1]", "lower = [[1], [2, 3]]", "must be a number, got [1]"),
    "type in a list": ("limits.toml", LIMITS, 'type = "box"', 'type = ["box"]', "must name a shape, got ['box']"),
    "tiny radius": ("limits.toml", LIMITS, "radius = 0.05", "radius = 1e-320", "radius must be positive"),
}


@pytest.mark.parametrize("case", TEXTS)
def test_numbers_and_values_that_no_file_should_hold(case: str, samples: Path) -> None:
    kind, text, old, new, phrase = TEXTS[case]
    if kind == "limits.toml":
        pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")
    if "/dev/" in new and not Path("/dev/zero").exists():
        pytest.skip("there are no devices")
    assert old in text
    refuse(kind, samples, text.replace(old, new, 1), phrase)


FIELDS = {
    "infinite parameter": ("estimate.json", '"base": [', '"base": [1e999, ', "beyond the range"),
    "base without a value": ("estimate.json", '"base": [', '"base": [null, ', "'base' must be a list of numbers"),
    "huge parameter": ("estimate.json", '"parameters": [', '"parameters": [1e308, ', "numbers beyond 1e+30"),
    "negative deviation": (
        "estimate.json",
        '"standard_error": [',
        '"standard_error": [-1, ',
        "negative number",
    ),
    "not a number": ("information.json", '"triangle": [[', '"triangle": [[NaN, ', "NaN, which JSON does not have"),
    "text for a factor": ("information.json", '"triangle": [[', '"triangle": ["box", [', "must hold numbers"),
    "column that is not there": ("information.json", '"columns": [0, ', '"columns": [77, ', "different indices below"),
    "more joints than factors": (
        "information.json",
        '"joint_names": [',
        '"joint_names": ["x", ',
        "one factor for each joint",
    ),
    "uneven trajectory": ("trajectory.json", '"q": [[', '"q": [[1e306, ', "must be real numbers"),
    "trajectory without end": (
        "trajectory.json",
        '"times": [0.0, 1.0, 2.0]',
        '"times": [0.0, 1.0, 1e300]',
        "beyond 1e+12",
    ),
}


@pytest.mark.parametrize("case", FIELDS)
def test_documents_that_nobody_saved(case: str, samples: Path) -> None:
    kind, old, new, phrase = FIELDS[case]
    text = (samples / kind).read_text()
    compact = " ".join(text.split()).replace("[ ", "[")
    assert old in compact
    refuse(kind, samples, compact.replace(old, new, 1), phrase)


def npz(header: bytes, data: bytes = b"", flags: int = 0, method: int = 0) -> bytes:
    """An archive with an array q of this header."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("q.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + data)
    content = bytearray(file.getvalue())
    for mark, place in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        start = content.index(mark)
        content[start + place] |= flags
        if method:
            content[start + place + 2] = method
    return bytes(content)


def header(shape: str, kind: str = "<f8") -> bytes:
    return f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs a timer")
@pytest.mark.parametrize(
    ("content", "phrase"),
    [
        (npz(header("(10, 1000000000000)")), "claims to have the shape (10, 1000000000000)"),
        (npz(header("(1000000000000,)")), "too few"),
        (npz(header("(7, 20000)"), bytes(8 * 140000)), "transpose it"),
        (npz(header("(-1, 2)")), "shape (-1, 2)"),
        (npz(b"{" * 200), "the header of an array cannot be read"),
        (npz(b"(" * 9000), "the header of an array cannot be read"),
        (npz(header("(2,)"), bytes(16), flags=1), "encrypted"),
        (npz(header("(2,)"), bytes(16), method=9), "compression"),
        (npz(header("(2,)"), bytes(16), method=8), "cannot be read as NPZ"),
        (npz(header("(2,)"), bytes(16), method=12), "cannot be read as NPZ"),
        (npz(header("(2,)"), bytes(16), method=14), "cannot be read as NPZ"),
    ],
    ids=lambda value: "archive" if isinstance(value, bytes) else None,  # archives hold the second they were made in
)
def test_archives_that_claim_what_they_do_not_hold(content: bytes, phrase: str, tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    path.write_bytes(content)

    def late(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, 5.0)  # it took 44 s, or had no end
    try:
        with pytest.raises(InputError) as caught:
            sy.Recording.read(path, {}, 2)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert phrase in str(caught.value)


def test_a_bomb_is_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive, archive.open("q.npy", "w", force_zip64=True) as file:
        file.write(b"\x93NUMPY\x01\x00" + len(header("(1000000,)")).to_bytes(2, "little") + header("(1000000,)"))
        file.write(bytes(8_000_000))
    assert path.stat().st_size < 5000
    with pytest.raises(InputError, match="no compression reaches"):
        sy.Recording.read(path, {}, 1)


def test_a_panic_of_the_library_is_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    polars = pytest.importorskip("polars")
    path = tmp_path / "log.parquet"
    path.write_bytes(b"x")

    def panic(*_: object, **__: object) -> None:
        os.write(2, b"thread 'main' panicked at src/lib.rs\n")
        raise polars.exceptions.PanicException("index out of bounds\nnote: run with RUST_BACKTRACE=1")

    monkeypatch.setattr(polars, "scan_parquet", panic)
    with pytest.raises(
        InputError, match=r"log.parquet cannot be read as Parquet: index out of bounds; save it again.$"
    ):
        sy.Recording.read(path)
    assert capfd.readouterr().err == ""


def test_what_is_said_of_an_interrupt_while_a_table_is_read_is_not_lost(capfd: pytest.CaptureFixture[str]) -> None:
    """Polars raises it in the thread that reads, and the main thread says so meanwhile."""

    def interrupted() -> None:
        os.write(2, b"steelyard: interrupted\n")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), reading_table("log.parquet", "Parquet"):
        interrupted()
    assert capfd.readouterr().err == "steelyard: interrupted\n"


def test_what_others_write_while_a_table_is_read_is_not_lost(capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("polars")
    with reading_table("log.parquet", "Parquet"), reading_table("other.parquet", "Parquet"):
        os.write(2, b"Traceback of another thread\n")
        assert capfd.readouterr().err == ""
    assert capfd.readouterr().err == "Traceback of another thread\n"


def test_logs_with_numbers_that_no_robot_reaches(samples: Path) -> None:
    lines = (samples / "log.csv").read_text().splitlines()
    lines[20] = ",".join([lines[20].split(",")[0], "1e200", *lines[20].split(",")[2:]])
    refuse("log.csv", samples, "\n".join(lines), "beyond 1e+15 in row 20")


def test_a_name_that_is_longer_than_names_can_be(samples: Path) -> None:
    text = f"id,robot,informations\n1,robot.urdf,{'9' * 5000}.json\n"
    refuse("robots.csv", samples, text, "is longer than a path can be")


def test_a_time_that_no_clock_shows(samples: Path) -> None:
    """Damage to one bit of a stored time, in a file without checksums."""
    lines = (samples / "log.csv").read_text().splitlines()
    lines[-1] = ",".join(["1.1e304", *lines[-1].split(",")[1:]])
    refuse("log.csv", samples, "\n".join(lines), "holds a time beyond 1e+15 s in row 400")


def test_points_of_an_array_that_claims_too_much(tmp_path: Path) -> None:
    path = tmp_path / "points.npy"
    np.save(path, np.eye(3))
    path.write_bytes(path.read_bytes().replace(b"(3, 3)", b"(99,3)"))
    with pytest.raises(InputError, match="is no array of numbers"):
        read_points(path)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('type="revolute"', f'type="rev{"9" * 5000}"'),
        ("<child>fore</child>", "<child>fo\nre</child>"),
        ('<link name="fore">', f'<link name="{"fore" * 999}">'),
    ],
)
def test_names_that_no_robot_has_do_not_fill_a_message(old: str, new: str, tmp_path: Path) -> None:
    path = tmp_path / "robot.sdf"
    assert old in SDF
    path.write_text(SDF.replace(old, new))
    with pytest.raises(InputError, match="give a name of one line") as caught:
        sy.Robot.from_sdf(path)
    assert len(str(caught.value)) < 600
    assert "\n" not in str(caught.value)


BODY = '<mujoco model="{}"><worldbody><body name="{}"><joint name="{}"/><geom size="1"/></body></worldbody></mujoco>'
NAMED = {
    "robot.urdf": '<robot name="{}"><link name="b"/><link name="l"/>'
    '<joint name="j" type="continuous"><parent link="b"/><child link="l"/></joint></robot>',
    "robot.xml": BODY.format("{}", "b", "j"),
    "link.xml": BODY.format("arm", "{}", "j"),
    "joint.xml": BODY.format("arm", "b", "{}"),
    "robot.toml": 'name = "{}"\n[description]\nrows = [[0, 0, 0, "q"]]\n',
}


@pytest.mark.parametrize("file", NAMED)
def test_names_of_a_million_letters_are_refused(file: str, tmp_path: Path) -> None:
    path = tmp_path / file
    path.write_text(NAMED[file].format("elbow"))
    assert sy.Model.load(path).dof == 1
    path.write_text(NAMED[file].format("x" * 1_000_000))
    with pytest.raises(
        InputError, match=rf"name (of a {path.stem} is 'xx|must be a string of one line, got 'xx)"
    ) as told:
        sy.Model.load(path)
    assert len(str(told.value)) < 600
    with pytest.raises(InputError, match="the name of a robot is 'xx"):
        sy.Robot.from_dh([(0, 0, 0, "q")], name="x" * 1_000_000)


def test_a_trajectory_with_infinite_numbers_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.csv"
    path.write_text("t,q1,dq1,ddq1\n-inf,0,0,0\n1,1,0,0\n")
    with pytest.raises(InputError, match="missing or not finite"):
        load_trajectory(path)


def test_a_shape_whose_inertia_no_robot_has(tmp_path: Path) -> None:
    """Its length is one that a robot may have by the bound on numbers, and its volume times the squared length not."""
    path, capsule = tmp_path / "robot.mjcf", 'fromto="0 0 0 0.4 0 0"'
    assert capsule in MJCF
    path.write_text(MJCF.replace(capsule, 'fromto="0 0 1e15 0.4 0 0"'))
    with pytest.raises(InputError, match=r"has a mass or an inertia beyond 1e\+15"):
        sy.Robot.from_mjcf(path)


def test_a_link_with_an_endless_name_does_not_fill_a_message(tmp_path: Path) -> None:
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q")], name="pair")
    with pytest.raises(InputError, match="has no link") as caught:
        sy.Model(robot).pose(np.zeros(1), "f" + "9" * 5000)
    assert len(str(caught.value)) < 600


ENDLESS = "9" * 5000


@pytest.mark.parametrize(
    ("kind", "text", "old", "new", "phrase", "end"),
    [
        ("robot.toml", ROBOT, "rows = ", f"{ENDLESS} = ", "rows = ... is needed, found convention", ""),
        ("limits.toml", LIMITS, "shoulder = 2", f"sho{ENDLESS} = 2", "velocity names a joint", "shoulder, elbow."),
    ],
)
def test_keys_without_end_do_not_fill_a_message(
    kind: str, text: str, old: str, new: str, phrase: str, end: str, samples: Path
) -> None:
    if kind == "limits.toml":
        pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")
    assert old in text
    refuse(kind, samples, text.replace(old, new, 1), phrase)
    with pytest.raises(InputError) as caught:
        READERS[kind][0](samples / f"made-{kind}")
    assert str(caught.value).endswith(end)


def test_a_message_of_the_joints_of_a_large_robot_counts_most_of_them() -> None:
    """A hundred names of two hundred letters each."""
    rows = [("pi/2", 0, 0.3, "q")] * 100
    robot = sy.Robot.from_dh(rows, name="snake")
    with pytest.raises(InputError, match="joint20 and 80 more") as caught:
        MotionLimits.from_robot(robot).updated({"velocity": [1.0, 2.0]})
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("kind", ["<f8[", "(2,)<f8", "f8,f8", "O", "<f99", "{", "datetime64[s]", ""])
def test_arrays_of_reduced_logs_have_one_of_a_few_kinds(kind: str) -> None:
    """NumPy would parse these, and raises what it likes, a SyntaxError among others."""
    head = json.dumps({"a": [kind, [1]]}).encode()
    content = b"".join([len(head).to_bytes(8, "little"), head, bytes(8)])
    with pytest.raises(InputError, match="made by another version"):
        unpacked(b"steelyard-packed-1\n" + hashlib.sha256(content).digest() + content)


def test_a_triangle_of_no_numbers_takes_no_memory() -> None:
    """Before, its order was believed, and the places of a million rows were listed."""
    head = json.dumps({"a": ["<f8", [0], 1_000_000]}).encode()
    content = len(head).to_bytes(8, "little") + head
    array = unpacked(b"steelyard-packed-1\n" + hashlib.sha256(content).digest() + content)
    assert array.shape == (0, 1_000_000, 1_000_000)


def test_endlessly_nested_reduced_logs_are_refused() -> None:
    head = b"[" * 200_000
    content = len(head).to_bytes(8, "little") + head
    with pytest.raises(InputError, match="made by another version"):
        unpacked(b"steelyard-packed-1\n" + hashlib.sha256(content).digest() + content)


@pytest.mark.parametrize("key", ["a", '"a b"', "'.'"])
@pytest.mark.parametrize("between", [".", " . "])
def test_keys_of_endlessly_many_parts_are_refused(key: str, between: str, samples: Path) -> None:
    """Python's parser would take minutes for one of 2 MB, by the square of the number of parts."""
    endless = between.join([key] * 100_000)
    refuse("robot.toml", samples, f"{ROBOT}[x]\n{endless} = 1\n", rf"line {ROBOT.count(chr(10)) + 2} has a key of more")
    refuse("robot.toml", samples, f"{ROBOT}\n[{endless}]\n", "has a key of more than 100 parts")


@pytest.mark.parametrize(("name", "phrase"), [("log.bag", "does not begin with #ROSBAG"), ("log.mat", "MATLAB")])
def test_a_file_of_holes_is_not_read_to_its_end(name: str, phrase: str, tmp_path: Path) -> None:
    """The library looked for the end of the first line of a bag, 3.8 GB behind its begin, and then broke off."""
    if name == "log.bag":
        pytest.importorskip("rosbags")
    with (tmp_path / name).open("wb") as file:
        file.truncate(2**41)
    with pytest.raises(InputError, match=phrase):
        sy.Recording.read(tmp_path / name)


@pytest.mark.parametrize(
    ("moving", "links", "phrase"),
    [(1000, 1001, "more than 500 joints move; lock some"), (1, 6000, "has 6000 links, more than 5000")],
)
def test_a_robot_with_more_joints_than_memory_holds(moving: int, links: int, phrase: str, tmp_path: Path) -> None:
    """Before, 19 000 joints in 3 MB took all the memory, and `inspect` of 20 000 fixed links hours."""
    parts = [f'<link name="l{k}"/>' for k in range(links)]
    for k in range(1, links):
        kind = "revolute" if k <= moving else "fixed"
        parts.append(f'<joint name="j{k}" type="{kind}"><parent link="l{k - 1}"/><child link="l{k}"/></joint>')
    path = tmp_path / "chain.urdf"
    path.write_text(f'<robot name="chain">{"".join(parts)}</robot>')
    with pytest.raises(InputError, match=phrase):
        sy.Robot.from_urdf(path)
    if moving > 1:
        assert sy.Robot.from_urdf(path, tip="l3").dof == 3
