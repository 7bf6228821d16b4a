"""The object cache: reuse, damage, two writers, and folders that are not safe."""

import os
import subprocess
import sys
import threading

import numpy as np
import pytest

from steelyard.graph import Argument, Function, Graph, Kernel, ObjectCache, Output


@pytest.fixture
def cache(tmp_path):
    folder = tmp_path / "cache"
    folder.mkdir(mode=0o700)
    return ObjectCache(folder)


def doubled(cache):
    twice = 2.0 * Graph().input("x[0]")
    return Kernel(Function("twice", (Argument("x", 1),), (Output("y", (1,), (twice,)),)), cache=cache)


def test_what_was_written_is_read(cache):
    cache.write("key", b"machine code")
    assert cache.read("key") == b"machine code"
    assert cache.read("other") is None


def test_a_kernel_is_compiled_once(cache):
    assert doubled(cache)(np.ones((8, 1))).tolist() == [[2.0]] * 8
    (file,) = cache.folder.glob("*.o")
    stamp = file.stat().st_mtime_ns
    assert doubled(cache)(np.ones((8, 1))).tolist() == [[2.0]] * 8
    assert [p.stat().st_mtime_ns for p in cache.folder.iterdir()] == [stamp]


@pytest.mark.parametrize("damage", [b"", b"steelyard-object-1\n", b"garbage" * 100, None])
def test_a_damaged_file_is_made_again(cache, damage):
    doubled(cache)(np.ones((8, 1)))
    (file,) = cache.folder.glob("*.o")
    whole = file.read_bytes()
    file.write_bytes(whole[:-5] + b"wrong" if damage is None else damage)
    assert cache.read(file.stem) is None
    assert doubled(cache)(np.ones((8, 1))).tolist() == [[2.0]] * 8
    assert file.read_bytes() == whole


def test_many_writers_of_one_key_leave_a_whole_file(cache):
    codes = [bytes([k]) * 100_000 for k in range(8)]

    def write(code):
        for _ in range(20):
            cache.write("key", code)
            assert cache.read("key") in codes

    threads = [threading.Thread(target=write, args=(code,)) for code in codes]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert cache.read("key") in codes
    assert [p.name for p in cache.folder.iterdir()] == ["key.o"]


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path):
    cache = ObjectCache(tmp_path / "missing")
    cache.write("key", b"code")
    assert cache.read("key") is None


def default_cache(environment):
    script = "from steelyard.graph import ObjectCache; print(ObjectCache.default().folder)"
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("STEELYARD", "XDG"))}
    run = subprocess.run(
        [sys.executable, "-c", script], env=clean | environment, capture_output=True, text=True, check=True
    )
    return run.stdout.strip()


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="permissions and homes are those of POSIX")
def test_where_the_default_cache_is(tmp_path):
    home = {"HOME": str(tmp_path)}
    assert default_cache(home | {"STEELYARD_CACHE": "off"}) == "None"
    assert default_cache(home | {"STEELYARD_CACHE_DIR": str(tmp_path / "mine")}) == str(tmp_path / "mine")
    found = default_cache(home)
    assert found.startswith(str(tmp_path))
    assert (tmp_path / "mine").stat().st_mode & 0o077 == 0


@pytest.mark.skipif(os.name != "posix", reason="permissions are those of POSIX")
def test_a_folder_that_others_may_write_is_not_used(tmp_path):
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    assert default_cache({"HOME": str(tmp_path), "STEELYARD_CACHE_DIR": str(shared)}) == "None"
