"""One recording in every format, as official writers write it: the same arrays, and the same answer."""

import io
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from log_writers import BAGS, states
from scipy.io import savemat

import steelyard as sy
from steelyard.recording import Recording

JOINTS = ("shoulder", "elbow")
Arrays = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot file of an arm of two links."""
    place = tmp_path_factory.mktemp("same")
    links = "".join(
        f'<link name="{name}"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>'
        '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>'
        for name in ("base", "upper", "fore")
    )
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
        '<origin xyz="0.3 0 0"/><limit lower="-3" upper="3" effort="100" velocity="10"/></joint>'
        for name, parent, child, axis in (("shoulder", "base", "upper", "0 0 1"), ("elbow", "upper", "fore", "0 1 0"))
    )
    (place / "arm.urdf").write_text(f'<robot name="arm">{links}{joints}</robot>')
    return place


@pytest.fixture(scope="module")
def arrays(folder: Path) -> Arrays:
    """Return a simulated recording at 250 Hz, whose times are whole numbers of ns."""
    model = sy.Model.load(folder / "arm.urdf")
    parameters = np.array(model.robot.parameters)
    parameters[np.isnan(parameters)] = 0.2
    t = np.arange(2000) * 4_000_000 / 1e9
    rate = 2 * np.pi * np.array([0.25, 0.4])
    phase = t[:, None] * rate
    q, dq, ddq = np.sin(phase), rate * np.cos(phase), -(rate**2) * np.sin(phase)
    torque = model.inverse_dynamics(q, dq, ddq, parameters)
    noise = np.random.default_rng(1)
    return {
        "t": t,
        "q": q + noise.normal(scale=1e-5, size=q.shape),
        "dq": dq + noise.normal(scale=1e-3, size=q.shape),
        "tau": torque + noise.normal(scale=0.02, size=q.shape),
    }


def flat(arrays: Arrays) -> dict[str, np.ndarray]:
    columns = {"t": arrays["t"]}
    for name in ("q", "dq", "tau"):
        columns |= {f"{name}{j + 1}": arrays[name][:, j] for j in range(2)}
    return columns


def csv(path: Path, arrays: Arrays) -> None:
    pl.DataFrame(flat(arrays)).write_csv(path)


def semicolons(path: Path, arrays: Arrays) -> None:
    text = io.StringIO()
    pl.DataFrame(flat(arrays)).write_csv(text, separator=";")
    path.write_text(text.getvalue().replace(".", ","))


def gz(path: Path, arrays: Arrays) -> None:
    import gzip

    text = io.BytesIO()
    pl.DataFrame(flat(arrays)).write_csv(text)
    path.write_bytes(gzip.compress(text.getvalue()))


def saved_text(path: Path, arrays: Arrays) -> None:
    columns = flat(arrays)
    np.savetxt(path, np.column_stack(list(columns.values())), header=" ".join(columns), fmt="%.17g")


def parquet(path: Path, arrays: Arrays) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    pa = pytest.importorskip("pyarrow")
    parquet.write_table(pa.table(flat(arrays)), path)


def feather(path: Path, arrays: Arrays) -> None:
    feather = pytest.importorskip("pyarrow.feather")
    pa = pytest.importorskip("pyarrow")
    feather.write_feather(pa.table(flat(arrays)), path)


def mat73(path: Path, arrays: Arrays) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array in arrays.items():
            data = file.create_dataset(name, data=np.atleast_2d(array.T))
            data.attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + bytes([0, 2]) + b"IM")


def hdf5(path: Path, arrays: Arrays) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, array in arrays.items():
            file.create_dataset(f"log/{name}", data=array, compression="gzip")


def messages(write: Callable[..., Any]) -> Callable[[Path, Arrays], None]:
    def write_messages(path: Path, arrays: Arrays) -> None:
        state = states(arrays["t"], JOINTS, arrays["q"], arrays["dq"], arrays["tau"])
        # As joint state broadcasters do, joints are sorted by their names.
        turned = [
            one._replace(names=JOINTS[::-1], **{k: getattr(one, k)[::-1] for k in ("position", "velocity", "effort")})
            for one in state
        ]
        write(path, {"/joint_states": turned})

    return write_messages


WRITERS: dict[str, Callable[[Path, Arrays], None]] = {
    "log.csv": csv,
    "semicolons.csv": semicolons,
    "log.csv.gz": gz,
    "log.txt": saved_text,
    "log.npz": lambda path, arrays: np.savez(path, **arrays),
    "log.parquet": parquet,
    "log.feather": feather,
    "log.mat": lambda path, arrays: savemat(path, arrays),
    "struct.mat": lambda path, arrays: savemat(path, {"log": arrays}, do_compression=True),
    "hdf5.mat": mat73,
    "log.h5": hdf5,
    **{name: messages(write) for name, write in BAGS.items()},
}
FOR_ANSWERS = [name for name in WRITERS if name not in BAGS or name in ("ros1.bag", "ros2_sqlite", "ros2_mcap")]
"""Those of the fast tests: `test_bags.py` has each kind of bag."""


@pytest.mark.usefixtures("mat_in_this_process")
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in FOR_ANSWERS else pytest.mark.slow) for name in WRITERS]
)
def test_every_format_holds_the_same_arrays(name: str, arrays: Arrays, tmp_path: Path) -> None:
    pytest.importorskip("rosbags") if name in BAGS else None
    arrays = {key: array[:500] for key, array in arrays.items()}
    WRITERS[name](tmp_path / name, arrays)
    found = Recording.read(tmp_path / name, joints=JOINTS)
    np.testing.assert_array_equal(found.t, arrays["t"])
    np.testing.assert_array_equal(found.q, arrays["q"])
    np.testing.assert_array_equal(found.velocity, arrays["dq"])
    np.testing.assert_array_equal(found.torque, arrays["tau"])


@pytest.mark.slow
def test_kinds_of_formats_give_the_same_estimate(folder: Path, arrays: Arrays, tmp_path: Path) -> None:
    """A text, a table of columns, arrays, a file of MATLAB and a bag; that all hold the same arrays is tried above."""
    found = {}
    for name in ("log.csv", "log.parquet", "log.npz", "log.mat", "json.mcap"):
        WRITERS[name](tmp_path / name, arrays)
        estimate = sy.identify(folder / "arm.urdf", [tmp_path / name]).estimate
        estimate.save(tmp_path / f"{name}.json")
        found[name] = (tmp_path / f"{name}.json").read_bytes().replace(str(tmp_path / name).encode(), b"log")
    assert len(found["log.csv"]) > 5000
    assert [name for name, content in found.items() if content != found["log.csv"]] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["log.csv", "log.csv.gz", "json.mcap", "log.npz"])
def test_the_standard_input_gives_the_same_estimate(
    name: str, folder: Path, arrays: Arrays, run: Callable[..., tuple[int, str, str]], tmp_path: Path
) -> None:
    log = tmp_path / name
    WRITERS[name](log, arrays)
    code, _, error = run("identify", folder / "arm.urdf", log, "-o", tmp_path / "file")
    assert code == 0, error
    command = [sys.executable, "-m", "steelyard", "identify", folder / "arm.urdf", "-", "-o", tmp_path / "stream"]
    with log.open("rb") as stream:
        done = subprocess.run(command, stdin=stream, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    by_file, by_stream = (
        (tmp_path / output / "estimate.json").read_bytes().replace(json.dumps(source).encode(), b"log")
        for output, source in (("file", str(log)), ("stream", "-"))
    )
    assert by_file == by_stream
    assert '"path": "-"' in (tmp_path / "stream" / "run.json").read_text()


@pytest.mark.slow
def test_nothing_in_the_standard_input_is_one_sentence(folder: Path, tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "steelyard",
        "identify",
        str(folder / "arm.urdf"),
        "-",
        "-o",
        str(tmp_path / "out"),
    ]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "the standard input is empty; expected a log with one row per sample" in done.stderr


@pytest.mark.slow
def test_a_topic_is_chosen_on_the_command_line(folder: Path, arrays: Arrays, tmp_path: Path) -> None:
    path = tmp_path / "two.mcap"
    state = states(arrays["t"], JOINTS, arrays["q"], arrays["dq"], arrays["tau"])
    BAGS["json.mcap"](path, {"/left": state, "/right": [one._replace(effort=-one.effort) for one in state]})
    command = [
        sys.executable,
        "-m",
        "steelyard",
        "identify",
        str(folder / "arm.urdf"),
        str(path),
        "-o",
        str(tmp_path / "out"),
    ]
    asked = subprocess.run(command, capture_output=True, text=True, check=False)
    assert asked.returncode == 2
    assert "--topic /left" in " ".join(asked.stderr.split())
    done = subprocess.run([*command, "--topic", "/left"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
