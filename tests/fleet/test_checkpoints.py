"""What is finished is kept whole, found again by what it follows from, and belongs to one run at a time."""

import errno
import itertools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.core import TyperCommand

import steelyard as sy
from steelyard.cli.results_folder import require_results_folder
from steelyard.errors import InputError
from steelyard.files.writing import beside, locked, replaced_file, replaced_folder
from steelyard.fleet import robot_estimate
from steelyard.fleet.executors import Here
from steelyard.fleet.log_reduction import run_in_order
from steelyard.fleet.packed import is_whole, packed, unpacked

posix = pytest.mark.skipif(os.name != "posix", reason="locks of folders are those of POSIX")


def test_a_key_tells_content_options_and_versions_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    key = sy.fleet.checkpoint_key("content", {"cutoff": 4.8})
    assert key == sy.fleet.checkpoint_key("content", {"cutoff": 4.8})
    others = {sy.fleet.checkpoint_key("other", {"cutoff": 4.8}), sy.fleet.checkpoint_key("content", {"cutoff": 4.9})}
    monkeypatch.setattr("steelyard.fleet.checkpoints.__version__", "9.9")
    others.add(sy.fleet.checkpoint_key("content", {"cutoff": 4.8}))
    assert len(others - {key}) == 3


SHAPED = """\
<robot name="arm">
  <link name="base"/>
  <link name="rod"><collision><geometry><box size="0.1 0.1 {length}"/></geometry></collision></link>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
</robot>
"""


def test_a_robot_whose_description_changed_is_estimated_again(tmp_path: Path) -> None:
    """Shapes of links say what is known of them beforehand, though no base parameter follows from them."""
    (tmp_path / "robot.toml").write_text('[description]\nurdf = "arm.urdf"\n')
    (tmp_path / "data.json").write_text("{}")
    entry = sy.fleet.FleetEntry("A", "", "", tmp_path / "robot.toml", informations=(str(tmp_path / "data.json"),))
    keys = []
    for length in ("0.3", "0.3", "0.7"):
        (tmp_path / "arm.urdf").write_text(SHAPED.format(length=length))
        description = robot_estimate.description_of(str(entry.robot))
        task = robot_estimate.task_of(entry, description, "base")
        task = robot_estimate.with_contents(task, robot_estimate.hashed_files(None, task))
        inputs = robot_estimate.inputs_of(task)
        keys.append(sy.fleet.checkpoint_key(*inputs))
    assert keys[0] == keys[1]
    assert keys[1] != keys[2]


@posix
def test_a_folder_belongs_to_one_run(tmp_path: Path) -> None:
    with sy.fleet.Checkpoints(tmp_path / "result"):
        with pytest.raises(sy.InputError, match="another run is working in this folder"):
            sy.fleet.Checkpoints(tmp_path / "result").__enter__()
        assert list((tmp_path / "result").iterdir()) == []  # the lock is no file
    with sy.fleet.Checkpoints(tmp_path / "result"):
        pass


@posix
def test_the_lock_of_a_killed_run_is_gone(tmp_path: Path) -> None:
    hold = (
        "import sys, time\nfrom steelyard.fleet import Checkpoints\n"
        "with Checkpoints(sys.argv[1]):\n    print('locked', flush=True)\n    time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", hold, str(tmp_path)], stdout=subprocess.PIPE) as run:
        assert run.stdout is not None
        assert run.stdout.readline() == b"locked\n"
        with pytest.raises(sy.InputError, match="another run"):
            sy.fleet.Checkpoints(tmp_path).__enter__()
        run.kill()
    with sy.fleet.Checkpoints(tmp_path):
        pass


def test_a_folder_that_a_refused_run_made_is_gone(tmp_path: Path) -> None:
    with pytest.raises(sy.InputError, match="no log"), sy.fleet.Checkpoints(tmp_path / "result"):
        raise sy.InputError("no log")
    assert not (tmp_path / "result").exists()


@posix
def test_a_run_that_is_refused_leaves_the_folder_to_the_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two runs that begin at once both make the folder, and one of them is the first to lock it."""
    folder = tmp_path / "result"
    with monkeypatch.context() as patched:
        patched.setattr("steelyard.fleet.checkpoints.locked", lambda handle: False)
        patched.setattr("steelyard.fleet.checkpoints.has_locks", lambda handle: True)
        with pytest.raises(sy.InputError, match="another run"):
            sy.fleet.Checkpoints(folder).__enter__()
    assert folder.is_dir()
    folder.rmdir()
    context = typer.Context(TyperCommand("identify"))
    require_results_folder(context, folder)  # of the other run
    with sy.fleet.Checkpoints(folder) as kept:
        context.close()
        kept.put(sy.fleet.checkpoint_key("log"), b"found")
        assert len(kept.names) == 1


@posix
def test_a_file_system_without_locks_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as a Lustre that was mounted without them, which is no other run."""

    def flock(handle: int, operation: int) -> None:
        raise OSError(errno.ENOSYS, "Function not implemented")

    monkeypatch.setattr("fcntl.flock", flock)
    with pytest.raises(sy.InputError, match="has no locks"):
        sy.fleet.Checkpoints(tmp_path / "result").__enter__()


@posix
def test_a_folder_that_goes_while_it_is_locked_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    removed = []

    def late(handle: int) -> bool:
        if not removed:
            removed.append((tmp_path / "result").rmdir())
        return locked(handle)

    monkeypatch.setattr("steelyard.fleet.checkpoints.locked", late)
    with sy.fleet.Checkpoints(tmp_path / "result") as kept:
        kept.put(sy.fleet.checkpoint_key("log"), b"found")
        assert len(kept.names) == 1
    assert removed


def test_what_killed_writers_left_is_removed(tmp_path: Path) -> None:
    key = sy.fleet.checkpoint_key("log")
    left = beside(tmp_path / f"reduced-{key}.checkpoint")
    left.write_bytes(b"half")
    (tmp_path / "notes.part").write_text("mine")
    with sy.fleet.Checkpoints(tmp_path) as kept:
        assert kept.names == ()
    assert [path.name for path in tmp_path.iterdir()] == ["notes.part"]


def test_keeping_one_of_many_does_not_look_through_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a hundred thousand, it would take a hundred times as long as to write one."""
    with sy.fleet.Checkpoints(tmp_path) as kept:
        for looks in ("scandir", "listdir"):
            monkeypatch.setattr(os, looks, lambda *_: pytest.fail("looked through the folder"))
        kept.put(sy.fleet.checkpoint_key("log"), b"done")
        assert kept.get(sy.fleet.checkpoint_key("log")) == b"done"
        monkeypatch.undo()


def _squared(common: int, task: int) -> bytes:
    DONE.append(task)
    return packed(common * task**2)


def _joined(common: int, results: object) -> bytes:
    return packed([unpacked(one) for one in results])  # type: ignore[attr-defined]


DONE: list[int] = []


def test_only_what_is_missing_or_damaged_is_computed(tmp_path: Path) -> None:
    groups, keys = [[1, 2], [3], [4, 5]], [sy.fleet.checkpoint_key(n) for n in range(3)]
    expected = [[10, 40], [90], [160, 250]]
    DONE.clear()
    with sy.fleet.Checkpoints(tmp_path) as kept:
        for _ in range(2):
            found = run_in_order(_squared, _joined, 10, groups, Here(), keys, kept)
            assert [unpacked(one) for one in found] == expected
        assert DONE == [1, 2, 3, 4, 5]
        damaged = tmp_path / f"reduced-{keys[1]}.checkpoint"
        damaged.write_bytes(damaged.read_bytes()[:-1])
        assert [unpacked(one) for one in run_in_order(_squared, _joined, 10, groups, Here(), keys, kept)] == expected
        assert DONE == [1, 2, 3, 4, 5, 3]


@posix
@pytest.mark.parametrize("planted", ["pipe", "device", "holes"])
def test_a_file_that_never_ends_is_no_checkpoint(tmp_path: Path, planted: str) -> None:
    """Before, a run waited for the pipe, and read the device until the memory was full."""
    key = sy.fleet.checkpoint_key("log.csv")
    with sy.fleet.Checkpoints(tmp_path) as kept:
        kept.put(key, b"what came of it")
        [name] = kept.names
        path = tmp_path / name
        if planted == "holes":
            os.truncate(path, 2**40)
        else:
            path.unlink()
            if planted == "pipe":
                os.mkfifo(path)
            else:
                path.symlink_to("/dev/zero")
        assert kept.get(key) is None


def test_results_that_come_in_any_order_are_yielded_in_order(tmp_path: Path) -> None:
    class Backwards:
        def run(self, leaf, combine, common, groups):  # type: ignore[no-untyped-def]
            for number in reversed(range(len(groups))):
                yield number, combine(common, [leaf(common, task) for task in groups[number]])

    groups = [[n] for n in range(6)]
    keys = [sy.fleet.checkpoint_key(n) for n in range(6)]
    expected = [[n**2] for n in range(6)]
    with sy.fleet.Checkpoints(tmp_path) as kept:
        assert [
            unpacked(one) for one in run_in_order(_squared, _joined, 1, groups, Backwards(), keys, kept)
        ] == expected
    assert [unpacked(one) for one in run_in_order(_squared, _joined, 1, groups, Backwards())] == expected


def test_packed_bytes_hold_results_and_nothing_else() -> None:
    model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    q = np.sin(np.arange(200.0))[:, None]
    samples = sy.Samples(q=q, dq=q, ddq=q, torque=q)
    information = sy.Information.from_samples(model, samples)
    whole = packed({"a": (information, float("nan"), None, [True]), "s": samples})
    again = unpacked(whole)
    assert packed(again) == whole
    for one, other in zip(again["a"][0].factors, information.factors, strict=True):
        np.testing.assert_array_equal(one.triangle, other.triangle)
        assert one.count == other.count == 200
    np.testing.assert_array_equal(again["s"].torque, q)
    assert is_whole(whole)
    flipped = bytearray(whole)
    flipped[-3] ^= 1
    for damaged in (whole[:-1], bytes(flipped), b"", b"PK\x03\x04"):
        with pytest.raises(sy.InputError, match="damaged"):
            unpacked(damaged)
    with pytest.raises(TypeError, match="cannot be packed"):
        packed(model)


def test_zeros_below_a_diagonal_are_not_packed() -> None:
    random = np.random.default_rng(4)
    square = random.normal(size=(3, 40, 40))
    upper, negative = np.triu(square), np.triu(square)
    negative[2, 7, 3] = -0.0
    for array, numbers in ((upper, 3 * 820), (negative, 4800), (square, 4800), (np.triu(square).astype("<f4"), 1230)):
        whole = packed(array)
        assert abs(len(whole) - 8 * numbers) < 200
        again = unpacked(whole)
        assert again.dtype == array.dtype
        assert again.tobytes() == array.tobytes()
        assert not again.flags.writeable


@posix
def test_a_file_system_that_knows_nothing_again_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The folder seemed to be another one each time that it was locked, and the run never began, nor ended."""
    monkeypatch.setattr(os.path, "samestat", lambda one, other: False)
    with pytest.raises(InputError, match=r"out: cannot be written \(it is another one as soon as it is made, .*; give"):
        sy.fleet.Checkpoints(tmp_path / "out").__enter__()
    fstat, count = os.fstat, itertools.count()

    def another(handle: int) -> os.stat_result:
        found = list(fstat(handle))
        found[1], found[3] = found[1] + 1 + next(count), 0  # st_ino and st_nlink
        return os.stat_result(found)

    monkeypatch.setattr(os, "fstat", another)
    with pytest.raises(InputError, match="another one as soon as it is made"), replaced_file(tmp_path / "a.json"):
        pass
    with pytest.raises(InputError, match="another one as soon as it is made"), replaced_folder(tmp_path / "b"):
        pass
    monkeypatch.undo()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
