"""Whatever file is given, reading it ends soon, with its content or with one sentence."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from steelyard.errors import InputError
from steelyard.files import file_hash, read_bytes, read_json, read_text, read_toml, reading, require_file, shown

posix = pytest.mark.skipif(os.name != "posix", reason="needs pipes and devices")
READERS: list[Callable[[Any], Any]] = [read_bytes, read_text, read_json, read_toml, require_file, file_hash]


def refused(read: Callable[[Any], Any], path: object, phrase: str) -> None:
    with pytest.raises(InputError) as caught:
        read(path)
    message = str(caught.value)
    assert phrase in message
    assert "\n" not in message
    assert len(message) < 600


@posix
@pytest.mark.parametrize("read", READERS)
def test_pipes_devices_and_folders_are_refused_without_waiting(read: Callable[[Any], Any], tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    refused(read, pipe, "is a pipe")
    refused(read, "/dev/zero", "is a device")
    refused(read, tmp_path, "is a folder")
    refused(read, tmp_path / "none", "No such file")
    refused(read, str(tmp_path / "a\0b"), "not a valid path")


@posix
@pytest.mark.parametrize("read", [read_bytes, file_hash])
def test_a_file_that_has_nothing_yet_is_not_waited_for(
    read: Callable[[Any], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As ``/proc/kmsg``, which calls itself regular: a pipe that is open for writing stands for it."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    monkeypatch.setattr(reading, "_require_regular", lambda *_: None)
    with open(os.open(pipe, os.O_RDWR), "wb"):
        refused(read, pipe, "cannot be read (Resource temporarily unavailable)")


def test_a_file_that_is_too_large_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "large"
    with path.open("wb") as file:
        file.truncate(10**12)  # takes no room on the disk
    refused(read_bytes, path, "too large")
    path.write_bytes(bytes(1000))
    with pytest.raises(InputError, match="too large"):
        read_bytes(path, largest=999)
    assert read_bytes(path, largest=1000) == bytes(1000)


def test_text(tmp_path: Path) -> None:
    path = tmp_path / "text"
    path.write_bytes("\ufeffGröße".encode())
    assert read_text(path) == "Größe"
    path.write_bytes(b"Gr\xf6\xdfe")
    refused(read_text, path, "byte 2 is not UTF-8")
    path.write_bytes(b"one\0two")
    refused(read_text, path, "byte 3 is 0")


JSON = {
    "not JSON": ("{", "is not JSON"),
    "nothing": ("", "is not JSON"),
    "deep lists": ("[" * 100_000, "nested too deeply"),
    "deep objects": ('{"a":' * 60 + "1" + "}" * 60, "nested more than 50 times"),
    "not a number": ("[NaN]", "NaN, which JSON does not have"),
    "infinite": ("[-Infinity]", "-Infinity"),
    "beyond floats": ("[1e999]", "beyond the range"),
    "a long integer": (f"[{'9' * 400}]", "beyond 64 bits"),
    "a longer integer": (f"[{'9' * 5000}]", "too many digits"),
    "a key twice": ('{"base": 1, "base": 2}', "'base' twice"),
    "half a character": (r'["\ud800"]', "a character that is not valid in a text"),
    "a NUL": (r'["a\u0000b"]', "a character that is not valid in a text"),
    "a NUL in a key": (r'{"a\u0000b": 1}', "a character that is not valid in a text"),
}


@pytest.mark.parametrize("case", JSON)
def test_json_that_nobody_wrote_is_refused(case: str, tmp_path: Path) -> None:
    text, phrase = JSON[case]
    path = tmp_path / "file.json"
    path.write_text(text)
    refused(read_json, path, phrase)


def test_json_that_is_right_is_read(tmp_path: Path) -> None:
    path = tmp_path / "file.json"
    path.write_text('{"a": [1, 2.5, -1e300, null, true, "\\u00fc"], "b": {}}')
    assert read_json(path) == {"a": [1, 2.5, -1e300, None, True, "ü"], "b": {}}


TOML = {
    "not TOML": ("[description", "not valid TOML"),
    "deep lists": ("a = " + "[" * 20_000, "nested too deeply"),
    "deep tables": (f"a = {'{a = ' * 60}1{'}' * 60}", "nested more than 50 times"),
    "deep keys": (f"{'.'.join('a' * 60)} = 1", "nested more than 50 times"),
    "a long integer": (f"a = {'9' * 400}", "beyond 64 bits"),
    "a longer integer": (f"a = {'9' * 5000}", "too many digits"),
    "a NUL": (r'a = "a\u0000b"', "a character that is not valid in a text"),
}


@pytest.mark.parametrize("case", TOML)
def test_toml_that_cannot_be_used_is_refused(case: str, tmp_path: Path) -> None:
    text, phrase = TOML[case]
    path = tmp_path / "file.toml"
    path.write_text(text)
    refused(read_toml, path, phrase)


def test_quoted_values_are_short() -> None:
    nested: list[Any] = []
    for _ in range(10_000):
        nested = [nested]
    for value in (nested, "x" * 10**6, [1.0] * 10**6, 10**5000, {"a": "b" * 1000}):
        assert len(shown(value)) <= 200
    assert shown("a") == "'a'"
