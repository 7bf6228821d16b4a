"""Damaged meshes are refused, whatever they do to the library that reads them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from mutations import DAE, OBJ, PLY

from steelyard.collision import mesh_child, mesh_files
from steelyard.collision.mesh_files import read_mesh, read_meshes
from steelyard.errors import InputError

pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")


@pytest.mark.slow
def test_a_face_that_names_a_vertex_that_is_not_there(tmp_path: Path) -> None:
    good, bad, last = (tmp_path / name for name in ("good.obj", "bad.ply", "last.ply"))
    good.write_text(OBJ)
    bad.write_text(PLY.replace("3 0 2 1", "3 0 2000000000 1"))
    last.write_text(PLY)
    found = read_meshes([good, bad, last])
    assert isinstance(found[bad], InputError)
    assert "bad.ply" in str(found[bad])
    for path in (good, last):  # the others are read all the same
        mesh = found[path]
        assert not isinstance(mesh, InputError)
        corners = {tuple(corner) for corner in mesh[0].round(9).tolist()}
        assert corners == {(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)}
        assert len(mesh[1]) == 4
    with pytest.raises(InputError, match=r"bad.ply"):
        read_mesh(bad)


CRASHES = {
    "crash": ("os.kill(os.getpid(), 11)", "signal SIGSEGV"),
    "exit": ("os._exit(3)", "exit 3"),
    "hang": ("time.sleep(60)", "or 1 s in all"),
    "circle": ("while True: pass", "takes longer than 1 s of the processor"),
    "words": ("print('hello'); raise ValueError('odd')", r"\(odd\)"),
    "memory": ("bytearray(3 * 2**30)", "MemoryError"),
}


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=pytest.mark.slow) if case == "circle" else case for case in CRASHES]
)
def test_what_a_library_may_do(case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if case in ("memory", "circle") and os.name != "posix":
        pytest.skip("memory and the time of the processor are bounded on POSIX systems")
    code, phrase = CRASHES[case]
    (tmp_path / "trimesh.py").write_text(f"import os, time\ndef load_scene(path):\n    {code}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(mesh_files, "_libraries", lambda: ["trimesh"])
    if case == "hang":  # the others end by themselves, on a busy machine after more than a second
        monkeypatch.setattr(mesh_files, "TIME", 1.0)
    if case == "circle":
        monkeypatch.setattr(mesh_files, "PROCESSOR", 1.0)
    path = tmp_path / "mesh.stl"
    path.write_bytes(b"x")
    with pytest.raises(InputError, match=phrase):
        read_mesh(path)


@pytest.mark.slow
def test_the_child_says_what_it_cannot_read(tmp_path: Path) -> None:
    path = tmp_path / "mesh.dae"
    path.write_text(DAE.replace("</COLLADA>", ""))
    said, arrays = mesh_child.answer(str(path), ["coal"])
    assert said["problem"]
    assert arrays == b""
    with pytest.raises(InputError, match=r"mesh.dae: the mesh cannot be read \(.+\); export it again"):
        read_mesh(path)


@pytest.mark.skipif(os.name != "posix", reason="needs pipes")
def test_pipes_and_large_files_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.stl")
    with pytest.raises(InputError, match="is a pipe"):
        read_mesh(tmp_path / "pipe.stl")
    with (tmp_path / "large.stl").open("wb") as file:
        file.truncate(10**10)
    with pytest.raises(InputError, match="more than 500 MB"):
        read_mesh(tmp_path / "large.stl")


def test_the_child_needs_nothing_but_numpy_and_the_library() -> None:
    code = "import sys, runpy; runpy.run_path(sys.argv[1]); print([m for m in sys.modules if 'steelyard' in m])"
    command = [sys.executable, "-c", code, mesh_child.__file__]
    assert subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip() == "[]"
