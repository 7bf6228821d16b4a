"""Files of arrays and tables as their libraries write them: MATLAB, HDF5, Arrow, and LeRobot's Parquet."""

import json
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import scipy.io.matlab
from scipy.io import savemat

from steelyard.errors import InputError, MissingExtraError
from steelyard.files import check_parquet
from steelyard.recording import LogColumns, Processing, Recording, Samples, clock_statistics, process_chunks
from steelyard.recording.formats import parquet_file, table_file
from steelyard.recording.formats.log_sets import logs_in
from steelyard.recording.formats.registry import open_log

S = 500
T = np.arange(S) / 100
JOINTS = ("shoulder", "elbow", "wrist")
Q = np.column_stack([np.sin(2 * T), np.cos(3 * T), np.sin(T + 0.3)])
TORQUE = 3 * Q - 0.1
needs_h5py = pytest.mark.skipif(find_spec("h5py") is None, reason="HDF5 files are read with h5py")
needs_pyarrow = pytest.mark.skipif(find_spec("pyarrow") is None, reason="the files are written with pyarrow")


def expect(path: Path, joints: Any = 3, order: tuple[int, ...] = (0, 1, 2)) -> None:
    """Compare what is read whole and in chunks with what was written."""
    found = Recording.read(path, joints=joints)
    np.testing.assert_array_equal(found.t, T)
    np.testing.assert_array_equal(found.q, Q[:, order])
    np.testing.assert_array_equal(found.torque, TORQUE[:, order])
    processing = Processing(cutoff=None, trim=0.0, velocity_threshold=None)
    joined = Samples.joined(list(process_chunks(path, None, processing, 110, joints)))
    np.testing.assert_array_equal(joined.torque, TORQUE[:, order])


@pytest.mark.usefixtures("mat_in_this_process")
@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("across", [False, True])
@pytest.mark.parametrize("struct", [False, True])
def test_mat(compressed: bool, across: bool, struct: bool, tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    content = {"t": T, "q": Q.T if across else Q, "tau": TORQUE.T if across else TORQUE, "fs": 100.0, "robot": "arm"}
    savemat(path, {"log": content} if struct else content, do_compression=compressed)
    expect(path)


@pytest.mark.usefixtures("mat_in_this_process")
@pytest.mark.parametrize("suffix", [".mat", pytest.param(".h5", marks=needs_h5py)])
def test_the_name_of_a_run_names_no_joint(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    content = {"t": T, "q": Q, "tau": TORQUE, "name": "third run"}
    if suffix == ".mat":
        savemat(path, content)
    else:
        import h5py

        with h5py.File(path, "w") as file:
            for key, value in content.items():
                file[key] = value
    expect(path, JOINTS)


@pytest.mark.usefixtures("mat_in_this_process")
def test_mat_version_4(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    savemat(path, {"t": T, "q": Q, "tau": TORQUE}, format="4")
    expect(path)


@pytest.mark.slow
def test_a_mat_is_decoded_once_until_it_is_written_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A log is opened several times, and each time it would take another process."""
    from steelyard.recording.formats import mat_file

    started = []
    run = mat_file.run_child
    monkeypatch.setattr(mat_file, "run_child", lambda *given: started.append(1) or run(*given))
    path = tmp_path / "run.mat"
    savemat(path, {"t": T, "q": Q, "tau": TORQUE})
    expect(path)
    assert len(started) == 1
    savemat(path, {"t": T[:200], "q": Q[:200], "tau": TORQUE[:200]})
    assert Recording.read(path, joints=3).count == 200
    assert len(started) == 2


@pytest.mark.usefixtures("mat_in_this_process")
def test_joints_that_a_mat_names(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    content = {"t": T, "position": Q, "effort": TORQUE, "joint_names": np.array(JOINTS, dtype=object)}
    savemat(path, {"arm": {"log": content}})
    expect(path, JOINTS[::-1], (2, 1, 0))
    savemat(path, {**content, "joint_names": list(JOINTS)})  # a matrix of characters, filled with blanks
    expect(path, JOINTS[::-1], (2, 1, 0))
    assert open_log(path).joint_labels() == JOINTS


@pytest.mark.usefixtures("mat_in_this_process")
def test_structs_keep_their_names_apart(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    savemat(
        path, {"time": T, "measured": {"q": Q}, "model": {"q": 2 * Q}, "drive": [{"tau": TORQUE}, {"tau": -TORQUE}]}
    )
    names = open_log(path).names
    assert {"time", "measured.q_0", "model.q_2", "drive(1).tau_0", "drive(2).tau_2"} <= set(names)
    stated = {"position": [f"measured.q_{k}" for k in range(3)], "torque": [f"drive(2).tau_{k}" for k in range(3)]}
    found = Recording.read(path, stated, 3)
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_array_equal(found.torque, -TORQUE)


@pytest.mark.usefixtures("mat_in_this_process")
def test_arrays_of_other_lengths_are_named(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    savemat(path, {"t": T, "q": Q, "tau": TORQUE[:-1], "picture": np.zeros((40, 60)), "volume": np.zeros((3, 4, 5))})
    with pytest.raises(InputError, match=r"different lengths .t: 500, q: 500, tau: 499."):
        Recording.read(path, joints=3)


MATLAB = Path(scipy.io.matlab.__file__).parent / "tests" / "data"


@pytest.mark.usefixtures("mat_in_this_process")
@pytest.mark.parametrize(
    "name", ["testdouble_4.2c_SOL2", "testdouble_6.1_SOL2", "testdouble_7.4_GLNX86", "testhdf5_7.4_GLNX86"]
)
def test_a_file_that_matlab_wrote(name: str) -> None:
    """SciPy ships files from MATLAB of several versions; this one holds the angles 0 to 2 pi in a row."""
    if "hdf5" in name:
        pytest.importorskip("h5py")
    if not (MATLAB / f"{name}.mat").exists():
        pytest.skip("this SciPy comes without the files of its tests")
    log = open_log(MATLAB / f"{name}.mat")
    np.testing.assert_allclose(log.read(["testdouble"])["testdouble"], np.linspace(0, 2 * np.pi, 9), atol=1e-15)


@pytest.mark.usefixtures("mat_in_this_process")
@pytest.mark.parametrize("name", ["testfunc_7.4_GLNX86", "testobject_7.4_GLNX86", "parabola"])
def test_objects_of_matlab_are_named(name: str) -> None:
    if not (MATLAB / f"{name}.mat").exists():
        pytest.skip("this SciPy comes without the files of its tests")
    with pytest.raises(InputError, match=r"objects of MATLAB, which only MATLAB reads; save plain arrays"):
        open_log(MATLAB / f"{name}.mat")


def matlab_73(path: Path, content: dict[str, Any]) -> Path:
    """Write HDF5 as MATLAB 7.3 does: columns first, a class for each array, structs as groups, cells as references."""
    import h5py

    def put(group: Any, name: str, value: Any) -> None:
        if isinstance(value, dict):
            made = group.create_group(name)
            made.attrs["MATLAB_class"] = np.bytes_("struct")
            for key, inner in value.items():
                put(made, key, inner)
        elif isinstance(value, str):
            made = group.create_dataset(name, data=np.array([[ord(one)] for one in value], dtype=np.uint16))
            made.attrs["MATLAB_class"] = np.bytes_("char")
        elif isinstance(value, list):
            refs = file.require_group("#refs#")
            for text in value:
                put(refs, f"r{len(refs)}", text)
            names = sorted(refs, key=lambda one: int(one[1:]))[-len(value) :]
            references = np.array([[refs[one].ref] for one in names], dtype=h5py.ref_dtype)
            group.create_dataset(name, data=references, dtype=h5py.ref_dtype).attrs["MATLAB_class"] = np.bytes_("cell")
        else:
            data = np.atleast_2d(np.asarray(value, dtype=float).T)
            chunked = {"chunks": True, "compression": "gzip"} if data.size > 1 else {}
            group.create_dataset(name, data=data, **chunked).attrs["MATLAB_class"] = np.bytes_("double")

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in content.items():
            put(file, name, value)
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Thu May  2 10:00:00 2024 HDF5 schema 1.00 ."
    with path.open("r+b") as raw:
        raw.write(header.ljust(124) + bytes([0, 2]) + b"IM")
    return path


@needs_h5py
@pytest.mark.parametrize("across", [False, True])
@pytest.mark.parametrize("struct", [False, True])
def test_mat_version_73(across: bool, struct: bool, tmp_path: Path) -> None:
    content = {
        "t": T[:, None],
        "q": Q.T if across else Q,
        "tau": TORQUE.T if across else TORQUE,
        "fs": 100.0,
        "robot": "arm",
    }
    expect(matlab_73(tmp_path / "run.mat", {"log": content} if struct else content))


@needs_h5py
def test_joints_that_a_mat_of_version_73_names(tmp_path: Path) -> None:
    content = {"t": T, "position": Q, "effort": TORQUE, "joint_names": list(JOINTS)}
    expect(matlab_73(tmp_path / "run.mat", {"log": content}), JOINTS[::-1], (2, 1, 0))


@needs_h5py
@pytest.mark.parametrize("group", ["", "robot/log/"])
@pytest.mark.parametrize("options", [{}, {"chunks": True, "compression": "gzip", "shuffle": True}])
def test_hdf5(group: str, options: dict[str, Any], tmp_path: Path) -> None:
    import h5py

    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        for name, array in {"t": T, "q": Q, "tau": TORQUE}.items():
            file.create_dataset(group + name, data=array, **options)
        file.create_dataset(f"{group}gain", data=3.0)
        file.attrs["robot"] = "arm"
    expect(path)


@needs_h5py
@pytest.mark.parametrize("place", ["dataset", "attribute of the file", "attribute of the array"])
def test_joints_that_hdf5_names(place: str, tmp_path: Path) -> None:
    import h5py

    path = tmp_path / "run.hdf5"
    with h5py.File(path, "w") as file:
        for name, array in {"timestamp": T, "position": Q, "effort": TORQUE}.items():
            file[name] = array
        if place == "dataset":
            file.create_dataset("joint_names", data=list(JOINTS), dtype=h5py.string_dtype())
        elif place == "attribute of the file":
            file.attrs["joint_names"] = list(JOINTS)
        else:
            file["position"].attrs["joint_names"] = np.array(JOINTS, dtype="S10")
    expect(path, JOINTS[::-1], (2, 1, 0))


@needs_h5py
def test_compound_datasets_of_hdf5(tmp_path: Path) -> None:
    import h5py

    path = tmp_path / "run.h5"
    rows = np.zeros(S, dtype=[("t", "f8"), ("q", "f8", (3,)), ("tau", "f8", (3,)), ("mode", "S4")])
    rows["t"], rows["q"], rows["tau"] = T, Q, TORQUE
    with h5py.File(path, "w") as file:
        file["log"] = rows
    expect(path)


@needs_h5py
def test_hdf5_reads_nothing_that_stands_in_other_files(tmp_path: Path) -> None:
    import h5py

    secret = tmp_path / "secret.bin"
    T.tofile(secret)
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["t"] = T
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file["q"], file["tau"] = Q, TORQUE
        file.create_dataset("t", shape=T.shape, dtype="f8", external=[(str(secret), 0, T.nbytes)])
        file["time"] = h5py.ExternalLink("other.h5", "/t")
        layout = h5py.VirtualLayout(shape=T.shape, dtype="f8")
        layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "t", shape=T.shape)
        file.create_virtual_dataset("timestamp", layout)
        file["circle"] = h5py.SoftLink("/")
        file["again"] = file["/"]
    with pytest.raises(InputError, match="nested more than 20 times"):
        open_log(path)
    with h5py.File(path, "a") as file:
        del file["again"]
    assert open_log(path).names == tuple(f"{name}_{k}" for name in ("q", "tau") for k in range(3))


@needs_h5py
def test_hdf5_that_claims_more_than_it_holds_is_refused(tmp_path: Path) -> None:
    import h5py

    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("t", shape=(10**12,), dtype="f8", chunks=(10**5,))
    with pytest.raises(InputError, match=r"its array t claims 8000000000000 bytes, from 0 stored ones"):
        Recording.read(path)


@pytest.mark.parametrize("suffix", [".h5", ".mat"])
@pytest.mark.parametrize("change", ["cut off", "short", "text"])
def test_damaged_arrays_are_one_sentence(
    suffix: str, change: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    if change != "short":  # which goes the whole way
        request.getfixturevalue("mat_in_this_process")
    path = tmp_path / f"run{suffix}"
    if suffix == ".h5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            file["t"], file["q"], file["tau"] = T, Q, TORQUE
    else:
        savemat(path, {"t": T, "q": Q, "tau": TORQUE})
    data = path.read_bytes()
    path.write_bytes({"cut off": data[: len(data) // 2], "short": data[:9], "text": b"t,q1,tau1\n1,2,3\n"}[change])
    with pytest.raises(InputError, match=r"cannot be read as (HDF5|a file of MATLAB): [^\n]*; save it again\.$"):
        Recording.read(path)


@pytest.mark.slow
def test_what_crashes_the_library_is_one_sentence(tmp_path: Path) -> None:
    """This type of an array, which there is none of, ends the process in which SciPy reads it."""
    path = tmp_path / "run.mat"
    savemat(path, {"t": T, "q": Q, "tau": TORQUE})
    data = bytearray(path.read_bytes())
    data[177] = 210
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"cannot be read as a file of MATLAB: [^\n]*; save it again\.$"):
        Recording.read(path)


def test_missing_h5py_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.h5"
    path.write_bytes(b"anything")
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MissingExtraError, match=r"h5py, which is not installed; pip install 'h5py>="):
        Recording.read(path)


@needs_pyarrow
@pytest.mark.parametrize("suffix", [".parquet", ".arrow", ".feather"])
@pytest.mark.parametrize("kind", ["columns", "lists", "lists of a fixed size"])
def test_tables_of_arrow(suffix: str, kind: str, tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.feather
    import pyarrow.parquet

    def column(values: np.ndarray) -> Any:
        if kind == "lists":
            return pa.array(values.tolist(), pa.list_(pa.float64()))
        return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])

    columns: dict[str, Any] = {"t": T}
    for name, values in (("q", Q), ("tau", TORQUE)):
        if kind == "columns":
            columns |= {f"{name}_{k}": values[:, k] for k in range(3)}
        else:
            columns[name] = column(values)
    table = pa.table(columns)
    path = tmp_path / f"run[1]*{suffix}"  # which is no pattern
    if suffix == ".parquet":
        pyarrow.parquet.write_table(table, path, row_group_size=130)
    elif suffix == ".feather":
        pyarrow.feather.write_feather(table, path, compression="zstd", chunksize=130)
    else:
        with pa.OSFile(str(path), "wb") as sink, pa.ipc.new_stream(sink, table.schema) as writer:
            writer.write_table(table, 130)
    expect(path)


def table_in_pages(path: Path, writer: str, group: int, rows: int) -> None:
    """Write a log with times for an index, numbers of several widths and lists, in pages of 800 bytes."""
    index = pl.Series("__index_level_0__", 10 * np.arange(rows)).cast(pl.Datetime("ms"))
    random = np.random.default_rng(4)
    columns = {
        "q": random.normal(size=rows),
        "tau": random.normal(size=rows).astype(np.float32),
        "mode": np.arange(rows),
    }
    frame = pl.DataFrame([index]).with_columns(
        *(pl.Series(name, values) for name, values in columns.items()),
        pl.Series("force.left", random.normal(size=(rows, 2)).tolist()),
    )
    if writer == "polars":
        frame.write_parquet(path, row_group_size=group, data_page_size=800)
    else:
        import pyarrow.parquet

        pyarrow.parquet.write_table(
            frame.to_arrow(), path, row_group_size=group, data_page_size=800, write_batch_size=50
        )


@pytest.mark.slow
@needs_pyarrow
@pytest.mark.parametrize("group", [130, 700, 5000])
@pytest.mark.parametrize("writer", ["polars", "pyarrow"])
def test_what_parts_a_table_is_read_in_changes_no_number(
    writer: str, group: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By groups, by pages, and page by page with pyarrow, from anywhere; beside what Polars reads whole."""
    import pyarrow.parquet

    path = tmp_path / "log.parquet"
    table_in_pages(path, writer, group, 3000)
    own = pyarrow.parquet.ParquetFile(path).metadata
    ends = np.cumsum([0, *(own.row_group(k).num_rows for k in range(own.num_row_groups))])
    groups, pages = check_parquet(path)
    np.testing.assert_array_equal(groups, ends)
    assert np.isin(groups, pages).all()
    assert len(pages) > 15
    np.testing.assert_array_less(0, np.diff(pages))
    frame = pl.read_parquet(path)
    names = ["time", "q", "tau", "mode", "force.left_1"]
    truth = np.column_stack(
        [np.arange(3000) / 100, *(frame[name] for name in names[1:-1]), frame["force.left"].list[1]]
    )
    with monkeypatch.context() as patch:
        patch.setattr(table_file, "READ_NUMBERS", 100)
        for large, installed in ((10**6, True), (600, True), (600, False)):
            patch.setattr(parquet_file, "PAGED_GROUP", large // 5)
            patch.setattr(parquet_file, "LARGE_GROUP", large)
            patch.setattr(parquet_file, "is_installed", lambda _, installed=installed: installed)
            file = open_log(path, LogColumns())
            assert isinstance(file, parquet_file.ParquetFile)
            is_large = group > large
            assert (file.places() is None) is is_large
            assert bool(file.notes()) is (is_large and not installed)
            for start in (0, 1, 129, 130, 1999, 2999):
                blocks = list(file.blocks_from(start, names, 100))
                assert {len(block["q"]) for block in blocks[:-1]} <= {100}
                read = np.column_stack([np.concatenate([block[name] for block in blocks]) for name in names])
                np.testing.assert_array_equal(read, truth[start:])


@needs_pyarrow
@pytest.mark.skipif(not Path("/proc/self/io").exists(), reason="the bytes that are read are counted by the system")
def test_a_large_group_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Page by page, as far as pyarrow can: Polars reads all of it for each part."""

    def bytes_read() -> int:
        return int(Path("/proc/self/io").read_text().split()[1])

    path = tmp_path / "log.parquet"
    random = np.random.default_rng(5)
    frame = pl.DataFrame({name: random.normal(size=200_000) for name in ("q", "tau")})
    frame.write_parquet(path, row_group_size=200_000, data_page_size=8 * 5000)
    monkeypatch.setattr(parquet_file, "PAGED_GROUP", 100_000)
    monkeypatch.setattr(table_file, "READ_NUMBERS", 20_000)
    file = parquet_file.ParquetFile(path)
    next(iter(file.blocks_from(0, ["q"], 1000)))  # pyarrow is loaded
    times = {}
    for installed in (True, False):
        monkeypatch.setattr(parquet_file, "is_installed", lambda _, installed=installed: installed)
        before = bytes_read()
        assert sum(len(block["q"]) for block in file.blocks_from(0, ["q", "tau"], 1000)) == 200_000
        times[installed] = (bytes_read() - before) / path.stat().st_size
    assert times[True] < 1.5
    assert times[False] > 3.0


def test_parts_are_of_whole_pages(tmp_path: Path) -> None:
    """So that none is decoded twice; of a short group all of it, and of one page that is far too long a piece."""
    path = tmp_path / "log.parquet"
    frame = pl.DataFrame({"q": np.arange(10_000.0)})
    frame.write_parquet(path, row_group_size=4000, data_page_size=8 * 1000)
    _, pages = check_parquet(path)
    file = parquet_file.ParquetFile(path)
    for rows, most in ((4000, 4000), (1500, 1500), (600, 1000)):
        found = []
        for scan in file._scans(0, ["q"], rows):
            found.append(scan.collect().height)
        assert sum(found) == 10_000
        assert max(found) <= most
        assert set(np.cumsum(found).tolist()) <= set(pages.tolist())
    frame.write_parquet(path, row_group_size=10_000, data_page_size=10 * 10_000)
    assert {scan.collect().height for scan in parquet_file.ParquetFile(path)._scans(0, ["q"], 1000)} == {4000, 2000}


def test_lists_of_several_lengths_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    lists = [[0.1, 0.2]] * S
    lists[300] = [0.1]
    pl.DataFrame({"t": T, "q": lists, "tau": [[0.0, 1.0]] * S}).write_parquet(path)
    with pytest.raises(InputError, match=r"lists of 2 and of 1 numbers in column 'q'"):
        Recording.read(path, joints=2)


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_dates_count_from_the_first_row_without_a_loss(unit: str, tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    step = {"ms": 10, "us": 10_000, "ns": 10_000_000}[unit]
    begin = 1_700_000_000_123_456_789 // {"ms": 10**6, "us": 10**3, "ns": 1}[unit]
    stamps = pl.Series("time", begin + step * np.arange(S)).cast(pl.Datetime(unit))
    frame = pl.DataFrame({"time": stamps, **{f"q{k + 1}": Q[:, k] for k in range(3)}})
    frame.with_columns(*(pl.Series(f"tau{k + 1}", TORQUE[:, k]) for k in range(3))).write_parquet(path)
    expect(path)


FEATURES = {
    "observation.state": {"dtype": "float32", "shape": [3], "names": {"motors": list(JOINTS)}},
    "observation.effort": {"dtype": "float32", "shape": [3], "names": list(JOINTS)},
    "action": {"dtype": "float32", "shape": [3], "names": list(JOINTS)},
}


def lerobot(folder: Path, episodes: int, names: bool = True) -> Path:
    """Write a data set in the layout of LeRobot."""
    frames = []
    for episode in range(episodes):
        frame = pl.DataFrame({"timestamp": T, "frame_index": np.arange(S), "episode_index": np.full(S, episode)})
        kind = pl.Array(pl.Float64, 3)
        lists = {"observation.state": Q, "observation.effort": TORQUE, "action": 2 * Q}
        frames.append(frame.with_columns(*(pl.Series(name, values, dtype=kind) for name, values in lists.items())))
    (folder / "data" / "chunk-000").mkdir(parents=True)
    (folder / "meta").mkdir()
    if names:
        (folder / "meta" / "info.json").write_text(json.dumps({"fps": 100, "features": FEATURES}))
    path = folder / "data" / "chunk-000" / "file-000.parquet"
    pl.concat(frames).write_parquet(path)
    return path


def test_lerobot(tmp_path: Path) -> None:
    path = lerobot(tmp_path / "named", 1)
    assert open_log(path).names[3:6] == tuple(f"observation.state[{joint}]" for joint in JOINTS)
    expect(path, JOINTS[::-1], (2, 1, 0))
    expect(lerobot(tmp_path / "unnamed", 1, names=False))


def test_episodes_of_lerobot_follow_each_other(tmp_path: Path) -> None:
    path = lerobot(tmp_path, 3)
    found = Recording.read(path, joints=JOINTS)
    assert found.count == 3 * S
    for episode in range(3):
        rows = found.t[episode * S : (episode + 1) * S]
        np.testing.assert_allclose(rows - rows[0], T, atol=1e-9)
    processing = Processing(cutoff=None, trim=0.1, velocity_threshold=None)
    assert found.process(processing).count == 3 * (S - 20)
    assert sum(piece.count for piece in process_chunks(path, None, processing, 110, JOINTS)) == 3 * (S - 20)


@pytest.mark.parametrize("form", ["parquet", "csv", "frame", "mapping"])
def test_episodes_are_told_as_such_in_whatever_form_they_come(form: str, tmp_path: Path) -> None:
    """What stands between them is a pause, and no row is missing in it; tables about the data set are no logs."""
    path = lerobot(tmp_path, 3)
    pl.DataFrame({"episode_index": [0, 1, 2], "length": [S] * 3}).write_parquet(tmp_path / "meta" / "episodes.parquet")
    frame = pl.read_parquet(path)
    flat = frame.select(
        *("timestamp", "frame_index", "episode_index"),
        *(pl.col("observation.state").arr.get(j).alias(f"q{j}") for j in range(3)),
        *(pl.col("observation.effort").arr.get(j).alias(f"tau{j}") for j in range(3)),
    )
    assert logs_in(str(tmp_path)) == [str(path)]
    flat.write_csv(tmp_path / "flat.csv")
    arrays = {name: frame[name].to_numpy() for name in frame.columns if name != "action"}
    forms = {"csv": tmp_path / "flat.csv", "frame": frame.drop("action"), "mapping": arrays, "parquet": path}
    recording = Recording.read(forms[form], joints=JOINTS if form == "parquet" else 3)
    for episode in range(3):
        rows = slice(episode * S, (episode + 1) * S)
        np.testing.assert_allclose(recording.t[rows] - recording.t[rows.start], T, atol=1e-9)
        np.testing.assert_allclose(recording.torque[rows], TORQUE)
    assert recording.remarks[0].startswith("It holds 3 episodes by its column 'episode_index'")
    clock = clock_statistics(recording)
    assert clock.missing == 0
    assert clock.paused == pytest.approx(2000.0)
    assert clock.sentences() == (
        f"Nothing was recorded for up to 1000 s in 2 pauses, the first {T[-1]:.6g} s after the first row.",
    )
    samples = recording.process(cutoff=None, trim=0.1, velocity_threshold=None)
    assert samples.count == 3 * (S - 20)
    assert not any("missing" in remark for remark in samples.remarks)


@pytest.mark.parametrize("suffix", [".parquet", ".arrow"])
def test_damaged_table_is_one_sentence(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    frame = pl.DataFrame({"t": T, "q1": Q[:, 0], "tau1": TORQUE[:, 0]})
    frame.write_parquet(path) if suffix == ".parquet" else frame.write_ipc(path)
    data = path.read_bytes()
    for damaged in (data[: len(data) // 2], data[:6], b"ARROW1" + bytes(100), b"t,q1,tau1\n"):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"cannot be read as (Parquet|Arrow): [^\n]*; save it again\.$"):
            Recording.read(path)
