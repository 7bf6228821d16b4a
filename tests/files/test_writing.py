"""Files appear whole or not at all, whoever else writes them and whenever a writer is killed."""

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from steelyard.errors import InputError
from steelyard.files import replaced_file, write_bytes, write_json, write_text

posix = pytest.mark.skipif(os.name != "posix", reason="needs fork and signals")


def hidden(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if path.name.startswith(".")]


def test_a_file_is_replaced_and_keeps_its_permissions(tmp_path: Path) -> None:
    path = tmp_path / "numbers.json"
    path.write_text("old")
    path.chmod(0o600)
    write_json({"ü": [1.5, None]}, path)
    assert path.read_text(encoding="utf-8") == '{\n "ü": [\n  1.5,\n  null\n ]\n}\n'
    assert os.name != "posix" or stat.S_IMODE(path.stat().st_mode) == 0o600
    assert hidden(tmp_path) == []


@posix
def test_a_new_file_has_the_usual_permissions(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_text("x", tmp_path / "file")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o640


def test_what_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("old")

    def fail() -> None:
        with replaced_file(path) as file:
            file.write(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [("file", "old")]


@posix
def test_symbolic_links_are_replaced_and_not_followed(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.write_text("mine")
    target = tmp_path / "file"
    target.symlink_to(mine)
    (tmp_path / "file.part").symlink_to(mine)  # the name that everybody would guess
    write_text("new", target)
    assert mine.read_text() == "mine"
    assert target.read_text() == "new"
    assert not target.is_symlink()


@posix
@pytest.mark.parametrize(
    ("name", "message"), [(os.devnull, "no regular file"), ("folder", "is a folder"), ("no/such", "No such file")]
)
def test_places_where_no_file_can_be_are_refused(name: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match=message):
        write_bytes(b"", tmp_path / name)
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)
    assert hidden(tmp_path) == []


def test_a_path_with_nul_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not a valid path"):
        write_bytes(b"", tmp_path / "a\0b")


WRITERS = """
import os, signal, sys, time
from pathlib import Path
from steelyard.files import write_bytes

path = Path(sys.argv[1])
write_bytes(bytes(100_000), path)
children = []
for letter in (b"a", b"b", b"c"):
    child = os.fork()
    if not child:
        size = 100_000
        while True:
            size = 50_000 + (size * 7 + 1) % 100_000
            write_bytes(letter * size, path)
    children.append(child)
seen = set()
for _ in range(250):
    content = path.read_bytes()
    seen.add(content[:1])
    assert 50_000 <= len(content) <= 150_000 and len(set(content)) == 1, len(content)
for child in children:
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
assert {b"a", b"b", b"c"} <= seen, seen
write_bytes(b"end", path)
assert os.listdir(path.parent) == [path.name], os.listdir(path.parent)
"""


@pytest.mark.slow
@posix
def test_nobody_sees_half_of_what_several_write_and_what_the_killed_leave_is_removed(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", WRITERS, str(tmp_path / "file")], check=True, timeout=60)


WAITING = """
import sys
from steelyard.files import replaced_file, write_text
with replaced_file(sys.argv[1]) as file:
    file.write(b"slow")
    file.flush()
    print(flush=True)
    sys.stdin.read()
"""


@posix
def test_what_is_still_written_is_no_leftover(tmp_path: Path) -> None:
    path = tmp_path / "file"
    command = [sys.executable, "-c", WAITING, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as slow:
        assert slow.stdout is not None
        slow.stdout.readline()
        write_text("quick", path)
        assert path.read_text() == "quick"
        assert len(hidden(tmp_path)) == 1
        slow.communicate()
    assert slow.returncode == 0
    assert path.read_text() == "slow"
    assert hidden(tmp_path) == []
