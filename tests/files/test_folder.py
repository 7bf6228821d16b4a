"""The files of a folder change together, whenever the process is killed, and those of others stay."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from steelyard.errors import InputError
from steelyard.files import replaced_folder, write_text, writing

posix = pytest.mark.skipif(os.name != "posix", reason="needs fork and signals")


def write(target: Path, text: str, names: tuple[str, ...] = ("estimate", "report", "run"), **options) -> None:
    with replaced_folder(target, **options) as made:
        for name in names:
            (made / name).write_text(text)


def content(target: Path) -> dict[str, str]:
    return {path.relative_to(target).as_posix(): path.read_text() for path in target.rglob("*") if path.is_file()}


def test_a_new_folder_an_empty_one_and_one_with_other_files(tmp_path: Path) -> None:
    target = tmp_path / "a" / "b"
    for text in ("first", "second"):
        write(target, text)
        assert content(tmp_path) == {f"a/b/{name}": text for name in ("estimate", "report", "run")}
    (target / "notes").write_text("mine")
    write(target, "third", ("estimate", "run"), stale=("report",))
    assert content(target) == {"notes": "mine", "estimate": "third", "run": "third"}


def test_a_failure_leaves_what_was_there(tmp_path: Path) -> None:
    target = tmp_path / "results"
    write(target, "old")

    def fail() -> None:
        with replaced_folder(target) as made:
            (made / "run").write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert content(tmp_path) == {f"results/{name}": "old" for name in ("estimate", "report", "run")}


def test_a_refusal_names_the_folder_that_was_asked_for(tmp_path: Path) -> None:
    def fail() -> None:
        with replaced_folder(tmp_path / "out") as made:
            (made / "log").mkdir()
            write_text("no file can be here", made / "log")

    with pytest.raises(InputError) as caught:
        fail()
    assert str(caught.value).startswith(str(tmp_path / "out" / "log"))
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_the_place_of_a_file_is_found_before_anything_is_moved(tmp_path: Path) -> None:
    """Before, two of five results were moved, and the third was refused."""
    (tmp_path / "b.html").mkdir()
    (tmp_path / "a.json").write_text("old")

    def write() -> None:
        with replaced_folder(tmp_path) as made:
            for name in ("a.json", "b.html"):
                (made / name).write_text("new")

    with pytest.raises(InputError, match=r"b.html: cannot be written \(a folder is where a file has to be\)"):
        write()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.json", "b.html"]
    assert (tmp_path / "a.json").read_text() == "old"


@pytest.mark.skipif(sys.platform != "linux", reason="other systems refuse such names")
def test_a_folder_may_have_a_name_that_is_not_utf_8(tmp_path: Path) -> None:
    target = tmp_path / os.fsdecode(b"\xff\xfe" * 60)
    for text in ("first", "second"):
        write(target, text)
        assert content(target) == dict.fromkeys(("estimate", "report", "run"), text)
    assert os.listdir(os.fsencode(tmp_path)) == [b"\xff\xfe" * 60]


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "results").write_text("mine")
    with pytest.raises(InputError, match="is a file"):
        write(tmp_path / "results", "new")
    with pytest.raises(InputError, match="cannot be written"):
        write(tmp_path / "results" / "inner", "new")


@posix
@pytest.mark.parametrize("case", ["current", "has folders", "linked", "no exchange"])
def test_folders_on_which_more_hangs_stay_themselves(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "results"
    write(target, "old")
    (target / "notes").write_text("mine")
    given, number = target, target.stat().st_ino
    if case == "current":
        monkeypatch.chdir(target)
        given = Path()
    elif case == "has folders":
        (target / "more").mkdir()
        (target / "more" / "notes").write_text("mine too")
    elif case == "linked":
        given = tmp_path / "link"
        given.symlink_to(target)
    else:
        monkeypatch.setattr(writing, "_exchange", lambda one, other: False)
    write(given, "new", record="run")
    assert case == "linked" or target.stat().st_ino == number
    assert case != "linked" or given.is_symlink()
    assert {name: text for name, text in content(target).items() if "notes" not in name} == {
        "estimate": "new",
        "report": "new",
        "run": "new",
    }
    assert (target / "notes").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []
    assert [path.name for path in target.iterdir() if path.name.startswith(".")] == []


KILLED = """
import os, signal, sys
from pathlib import Path
from steelyard.files import replaced_folder, write_text, writing

place, case = Path(sys.argv[1]), sys.argv[2]
target = place / "results"

def write(text):
    with replaced_folder(target, record="run") as made:
        for name in ("estimate", "report", "run"):
            (made / name).write_text(text)

def content():
    return {name: (target / name).read_text() for name in ("estimate", "report", "run") if (target / name).exists()}

if case == "one by one":
    writing._may_be_exchanged = lambda target: False
calls = ("mkdir", "link", "chmod", "rename", "replace", "unlink", "fsync", "rmdir")
write("0")
(target / "notes").write_text("mine")
step, ends = 0, set()
while True:
    old, new = content()["run"], str(step + 1)
    child = os.fork()
    if not child:
        left = step

        def counted(call):
            def one(*arguments, **options):
                global left
                result = call(*arguments, **options)
                left -= 1
                if left < 0:
                    os.kill(os.getpid(), signal.SIGKILL)
                return result
            return one

        for name in calls:
            setattr(os, name, counted(getattr(os, name)))
        writing._exchange = counted(writing._exchange)
        write(new)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    found = content()
    assert (target / "notes").read_text() == "mine", step
    if case == "exchanged" or "run" in found:
        assert set(found) == {"estimate", "report", "run"}, (step, found)
        assert len(set(found.values())) == 1 and found["run"] in (old, new), (step, found)
    ends.add(found.get("run", "none") if found.get("run") != old else "old")
    if not os.WIFSIGNALED(status):
        break
    write(new)
    assert content()["run"] == new
    assert sorted(os.listdir(target)) == ["estimate", "notes", "report", "run"], os.listdir(target)
    assert os.listdir(place) == ["results"], os.listdir(place)
    step += 1
print(step, len(ends))
assert step > 8 and len(ends) >= 3
"""


@posix
@pytest.mark.parametrize("case", ["exchanged", "one by one"])
def test_a_kill_after_any_call_leaves_one_run_and_nothing_that_stays(case: str, tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path), case], check=True, timeout=60)


@posix
def test_what_comes_while_the_folder_is_made_is_kept(tmp_path: Path) -> None:
    target = tmp_path / "results"
    write(target, "old")
    (target / "notes").write_text("before")
    exchange = writing._exchange

    def late(one: Path, other: Path) -> bool:
        (target / "late").write_text("late")
        (target / "notes").unlink()
        (target / "notes").write_text("after")
        return exchange(one, other)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writing, "_exchange", late)
        write(target, "new")
    assert content(target) == {
        **dict.fromkeys(("estimate", "report", "run"), "new"),
        "late": "late",
        "notes": "after",
    }
