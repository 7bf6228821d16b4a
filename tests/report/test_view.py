"""The 3D view: what it takes from files, what it refuses, and what a real browser draws of it."""

import base64
import itertools
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import steelyard as sy
from steelyard.dynamics import Dahl
from steelyard.errors import is_installed
from steelyard.identification import Identification
from steelyard.identification.parameter_table import ParameterTable
from steelyard.report import save_results
from steelyard.report.playback import play_log, play_trajectory, watch_collisions
from steelyard.report.view import bars_html, is_loopback, quaternion, require_free, triangles_of, view_robot
from steelyard.report.viewed_robot import ViewedRobot, basis_of, load_viewed_robot

BOX = '<{kind}><origin xyz="{x} 0 0"/><geometry><box size="{length} 0.08 0.08"/></geometry></{kind}>'
INERTIAL = (
    '<inertial><origin xyz="0.2 0 0"/><mass value="2"/>'
    '<inertia ixx="0.004" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial>'
)


def arm(folder: Path, *, shapes: bool = True, mesh: str = "") -> Path:
    """Three links of 0.4 m in a row that turn about parallel axes, so that the third can fold onto the first."""
    links = ['<link name="base"/>']
    for k in range(1, 4):
        parts = BOX.format(kind="visual", x=0.2, length=0.36) + BOX.format(kind="collision", x=0.2, length=0.36)
        if mesh and k == 2:
            parts = f'<visual><geometry><mesh filename="{mesh}"/></geometry></visual>'
        links.append(f'<link name="link{k}">{INERTIAL}{parts if shapes else ""}</link>')
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="{"base" if k == 1 else f"link{k - 1}"}"/>'
        f'<child link="link{k}"/><origin xyz="{0 if k == 1 else 0.4} 0 0"/><axis xyz="0 1 0"/>'
        '<limit lower="-3" upper="3" effort="60" velocity="3"/></joint>'
        for k in range(1, 4)
    )
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm">{"".join(links)}{joints}</robot>')
    return path


def fold(folder: Path) -> Path:
    """A motion from the stretched arm to one in which the third link lies in the first."""
    path = folder / "fold.json"
    move = sy.excitation.QuinticTrajectory.point_to_point([[0, 0, 0], [0, 1.6, 1.6], [0, 2.9, 2.9]], [1.0, 1.0])
    sy.excitation.save_trajectory(move, path, joint_names=["j1", "j2", "j3"])
    return path


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("view")
    arm(folder)
    fold(folder)
    return folder


@pytest.fixture(scope="module")
def viewed(place: Path) -> ViewedRobot:
    return load_viewed_robot(place / "arm.urdf")


def test_shapes_and_bodies_of_a_description(viewed: ViewedRobot) -> None:
    assert [(one.link, one.shape.size) for one in viewed.shapes] == [
        (f"link{k}", (0.36, 0.08, 0.08)) for k in (1, 2, 3)
    ]
    assert viewed.identified is None
    assert viewed.remarks == ()
    middle, size = viewed.extent
    np.testing.assert_allclose(middle, [0.59, 0, 0], atol=1e-12)  # from the base's origin to 1.18
    assert size == pytest.approx(np.linalg.norm([1.18, 0.08, 0.08]) / 2)
    for body in viewed.bodies(viewed.described):
        assert body is not None
        np.testing.assert_allclose(body.center, [0.2, 0, 0])
        np.testing.assert_allclose(body.sides, np.sqrt([6 * 0.056 / 2, 6 * 0.004 / 2, 6 * 0.004 / 2]), rtol=1e-9)


def test_rods_go_from_joint_to_joint(viewed: ViewedRobot) -> None:
    found = [(body, start.tolist(), end.round(12).tolist()) for body, start, end in viewed.rods]
    assert found == [
        (-1, [0, 0, 0], [0, 0, 0]),
        (0, [0, 0, 0], [0.4, 0, 0]),
        (1, [0, 0, 0], [0.4, 0, 0]),
        (2, [0, 0, 0], [0.2, 0, 0]),
    ]


def of_two_links() -> ViewedRobot:
    file = sy.RobotFile.of(sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.3, 0, "q")], name="arm"))
    model = sy.Model.from_file(file)
    return ViewedRobot(file, model, None, None, np.asarray(model.robot.parameters))


def test_rods_of_denavit_hartenberg_begin_at_the_joint_of_the_link() -> None:
    found = [(body, start.round(12).tolist(), end.tolist()) for body, start, end in of_two_links().rods]
    assert found == [(-1, [0, 0, 0], [0, 0, 0]), (0, [-0.5, 0, 0], [0, 0, 0]), (1, [-0.3, 0, 0], [0, 0, 0])]


def test_what_cannot_be_shown_is_told(tmp_path: Path) -> None:
    bare = load_viewed_robot(arm(tmp_path, shapes=False))
    assert bare.shapes == ()
    assert "neither visual nor collision shapes; links are drawn as rods" in bare.remarks[0]
    lost = load_viewed_robot(arm(tmp_path, mesh="package://nowhere/hand.stl"))
    assert len(lost.shapes) == 2
    assert lost.remarks[0].startswith("Shapes of link2 are left out:")
    assert "hand.stl" in lost.remarks[0]
    text = (tmp_path / "arm.urdf").read_text()
    (tmp_path / "arm.urdf").write_text(text.replace('ixx="0.004"', 'ixx="4"', 1).replace('izz="0.03"', 'izz="4"', 1))
    odd = load_viewed_robot(tmp_path / "arm.urdf")
    assert any("larger than the robot" in one and "CAD gives link1" in one for one in odd.remarks)
    (tmp_path / "arm.urdf").write_text(text.replace('ixx="0.004"', 'ixx="0.5"', 1))
    odd = load_viewed_robot(tmp_path / "arm.urdf")
    assert any("No body of positive density has the inertia that CAD gives link1" in one for one in odd.remarks)


def test_results_are_shown_with_what_is_known(identification: Identification, tmp_path: Path) -> None:
    save_results(identification, tmp_path)
    seen = load_viewed_robot(tmp_path)
    assert identification.parameters is not None
    assert seen.identified is not None
    np.testing.assert_array_equal(seen.identified, identification.estimate.parameters)
    rows = {row.name: row for row in identification.parameters}
    for number, known in enumerate(seen.known, start=1):
        assert basis_of(known, "mass") == rows[f"m{number}"].basis
        order = ["measured", "bounded", "assumed", "unknown"]
        weakest = max((rows[f"c{axis}{number}"].basis for axis in "xyz"), key=order.index)
        assert basis_of(known, "centre of mass") == weakest
        assert order.index(basis_of(known, "all of these")) >= order.index(weakest)
    document = json.loads((tmp_path / "estimate.json").read_text())
    mass = next(row for row in document["parameter_table"] if row["name"] == "m1")
    for key, value, words in (("basis", "guessed", "row"), ("value", 1e3, "other masses"), ("", None, "identify anew")):
        changed = {**document, "parameter_table": [{**mass, key: value}] if key else []}
        (tmp_path / "estimate.json").write_text(json.dumps(changed))
        if words == "row":
            with pytest.raises(sy.InputError, match="parameter_table: row 1 is none of a table"):
                load_viewed_robot(tmp_path)
        else:
            assert words in load_viewed_robot(tmp_path).remarks[0]
    with pytest.raises(sy.InputError, match="beside a folder of results alone"):
        load_viewed_robot(seen.file.path, seen.file.path)


@pytest.mark.slow
def test_results_find_their_robot_from_any_folder(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("robot.toml", "arm.urdf", "other.csv"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    monkeypatch.chdir(tmp_path)
    save_results(sy.identify("robot.toml", "other.csv"), Path("found/result"))
    for place in (tmp_path, tmp_path / "found/result", tmp_path.parent):
        monkeypatch.chdir(place)
        file = load_viewed_robot(tmp_path / "found/result").file
        assert file.path is not None
        assert file.path.samefile(tmp_path / "robot.toml")
    (tmp_path / "robot.toml").write_text((tmp_path / "robot.toml").read_text().replace("coulomb", "offset"))
    monkeypatch.chdir(tmp_path / "found/result")
    with pytest.raises(sy.InputError, match="not where its record says, or has changed since"):
        load_viewed_robot(".")


def test_a_table_of_parameters_is_made_again_of_plain_rows(identification: Identification) -> None:
    assert identification.parameters is not None
    again = ParameterTable.from_list(json.loads(json.dumps(identification.parameters.to_list())), "here")
    assert again.to_csv() == identification.parameters.to_csv()
    assert again.confidence == identification.parameters.confidence


def test_a_trajectory_is_played_with_the_torques_that_it_takes(viewed: ViewedRobot, place: Path) -> None:
    motion = play_trajectory(viewed, place / "fold.json")
    assert motion.duration == pytest.approx(2.0)
    np.testing.assert_allclose(motion.q[-1], [0, 2.9, 2.9], atol=1e-9)
    assert list(motion.torques) == ["CAD"]
    # At rest, stretched out: links of 2 kg whose centres are 0.2, 0.6 and 1.0 m away.
    np.testing.assert_allclose(np.abs(motion.torques["CAD"][0]), 2 * 9.80665 * np.array([1.8, 0.8, 0.2]), rtol=1e-3)
    np.testing.assert_allclose(motion.configuration(1.0), [0, 1.6, 1.6], atol=1e-3)
    other = of_two_links()
    with pytest.raises(sy.InputError, match="is a motion of 3 joints"):
        play_trajectory(other, place / "fold.json")


def test_a_log_is_played_as_it_was_measured(identification: Identification, folder: Path, tmp_path: Path) -> None:
    save_results(identification, tmp_path)
    motion = play_log(load_viewed_robot(tmp_path), folder / "other.csv")
    table = np.loadtxt(folder / "other.csv", delimiter=",", skiprows=1)
    assert list(motion.torques) == ["measured", "identified"]
    for row in (100, 700, 1400):
        at = motion.index(table[row, 0] - table[0, 0] - (motion.t[0] - 0.0))
        near = np.abs(table[:, 1:3] - motion.q[at]).sum(axis=1).argmin()
        np.testing.assert_allclose(motion.torques["measured"][at], table[near, 3:5], atol=1e-6)
    error = motion.torques["measured"] - motion.torques["identified"]
    inner = error[50:-50]
    assert np.nanstd(inner[:, 0]) < 0.8  # the noise is 0.5
    assert np.nanstd(inner[:, 1]) < 0.2  # and 0.1


@pytest.mark.slow
def test_friction_that_remembers_is_played_with_its_state(tmp_path: Path) -> None:
    """A log whose Dahl friction SciPy integrates, of a balanced disc in otherwise no gravity, by hand."""
    away, friction, inertia = 0.05, 2.0, 0.4
    robot = sy.Robot.from_dh([(0, 0, 0, "q")], name="disc").with_terms(Dahl(displacement=away))
    file = sy.RobotFile.of(robot).with_settings("processing", cutoff="none", velocity_threshold="none", trim=0.0)
    t = np.arange(0.0, 6.0, 0.002)
    q, dq, ddq = 0.3 * np.sin(2 * t), 0.6 * np.cos(2 * t), -1.2 * np.sin(2 * t)

    def rate(time: float, state: np.ndarray) -> np.ndarray:
        speed = 0.6 * np.cos(2 * time)
        return (speed - np.abs(speed) * state) / away

    state = solve_ivp(rate, (0.0, 6.0), [0.0], t_eval=t, max_step=0.002, rtol=1e-8).y[0]
    torque = inertia * ddq + friction * state
    sy.Recording(t=t, q=q[:, None], torque=torque[:, None]).save(tmp_path / "log.csv")
    model = sy.Model.from_file(file)
    truth = np.zeros(model.parameter_count)
    truth[[model.parameter_names.index(name) for name in ("Lzz1", "m1", "Fcj1")]] = inertia, 1.0, friction
    disc = ViewedRobot(file, model, None, truth, truth)
    seen = play_log(disc, tmp_path / "log.csv")
    known = np.isfinite(seen.torques["measured"])
    np.testing.assert_allclose(seen.torques["identified"][known], seen.torques["measured"][known], atol=0.02)
    steady = inertia * ddq + friction * np.sign(dq)
    assert np.abs(steady - torque).max() > 1.0
    move = sy.excitation.QuinticTrajectory.point_to_point([[0.0], [1.0]], [2.0])
    sy.excitation.save_trajectory(move, tmp_path / "move.json", joint_names=model.robot.joint_names)
    played = play_trajectory(disc, tmp_path / "move.json").torques["identified"]
    moving = slice(10, -10)
    motion = move.motion(np.linspace(0.0, 2.0, len(played)))
    np.testing.assert_allclose(played[moving], inertia * motion[2][moving] + friction, atol=1e-3)


def test_pairs_that_come_too_near_are_found(viewed: ViewedRobot, place: Path) -> None:
    pytest.importorskip("coal")
    motion = play_trajectory(viewed, place / "fold.json")
    nearness, unchecked = watch_collisions(viewed, motion)
    assert nearness is not None
    assert unchecked == ()
    assert "Nearest: link3 to link1 at 1." in nearness.words()
    assert "into each other" in nearness.words()
    assert nearness.near(motion.q[0]) == ()
    (pair,) = nearness.near(motion.q[-1])
    assert pair.too_near
    assert pair.bodies == {0, 2}
    # The third link hangs parallel to the first: half a turn each, 0.1 m between their middles, 0.08 m thick.
    q = np.array([0.0, np.pi / 2, np.pi / 2])
    (parallel, *_) = nearness.near(q) or [None]
    assert parallel is None  # 0.4 - 0.08 m apart, farther than what counts as near


def test_shapes_become_triangles_of_their_volume() -> None:
    trimesh = pytest.importorskip("trimesh")
    from steelyard.collision import Box, Capsule, Cylinder, Sphere

    for shape, volume in [
        (Box((0.1, 0.2, 0.3)), 0.006),
        (Sphere(0.2), 4 / 3 * np.pi * 0.2**3),
        (Cylinder(0.1, 0.5), np.pi * 0.01 * 0.5),
        (Capsule(0.1, 0.5), np.pi * 0.01 * 0.5 + 4 / 3 * np.pi * 0.1**3),
    ]:
        made = trimesh.Trimesh(*triangles_of(shape))
        assert made.volume == pytest.approx(volume, rel=0.02)
        np.testing.assert_allclose(made.bounds.mean(axis=0), 0.0, atol=1e-9)


def test_bars_are_as_long_as_torques_and_names_are_escaped() -> None:
    text = bars_html(
        ["<b>a</b>", "b"], {"measured": np.array([5.0, np.nan]), "CAD": np.array([-10.0, 0.0])}, np.array([10.0, 0.0]),
        ["N·m", "N"],
    )  # fmt: skip
    assert "&lt;b&gt;a" in text
    assert "left:50.00%;width:25.00%" in text
    assert "left:0.00%;width:50.00%" in text
    assert "–" in text


def test_rotations_and_addresses() -> None:
    assert quaternion(np.diag([1.0, -1.0, -1.0])) == pytest.approx((0, 1, 0, 0))
    assert [is_loopback(host) for host in ("127.0.0.1", "::1", "localhost", "0.0.0.0", "10.0.0.2", "host")] == [
        True, True, True, False, False, False,
    ]  # fmt: skip
    with pytest.raises(sy.InputError, match=r"nothing can listen at 203\.0\.113\.7, port 8080"):
        require_free("203.0.113.7", 8080)


def test_without_viser_the_extra_is_named(viewed: ViewedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(sy.errors.MissingExtraError, match=r"needs the package viser, .* pip install 'viser"):
        view_robot(viewed)


# In a browser.

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-port=0",
    "--window-size=1280,800",
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",  # no network but this machine
)
PICTURES = Path(__file__).resolve().parents[2] / "build"
DRAWN_CURVE = """(() => {
const canvas = document.querySelector('.uplot canvas'), area = [0, 0, canvas.width, canvas.height];
const data = canvas.getContext('2d').getImageData(...area).data;
let count = 0;
for (let k = 0; k < data.length; k += 4) {
  const off = [181, 68, 110].map((value, i) => Math.abs(data[k + i] - value));
  if (data[k + 3] > 128 && off[0] + off[1] + off[2] < 60) count++;
}
return count;})()"""
LEFT = (0, 200, 860, 640)  # of the page, beside the panel and below what viser says of software rendering


class Page:
    """A page in a headless browser, over the protocol of its developer tools."""

    def __init__(self, address: str, profile: Path) -> None:
        from websockets.sync.client import connect

        assert CHROMIUM is not None
        command = [CHROMIUM, *FLAGS, f"--user-data-dir={profile}", "about:blank"]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        told = profile / "DevToolsActivePort"
        wait(lambda: told.exists() and len(told.read_text().split()) > 1)
        port = told.read_text().split()[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
            target = next(one for one in json.load(answer) if one["type"] == "page")
        self.socket = connect(target["webSocketDebuggerUrl"], max_size=None)
        self.numbers = itertools.count(1)
        self.errors: list[str] = []
        self("Runtime.enable")
        self("Log.enable")
        self("Page.navigate", url=address)

    def __call__(self, method: str, **parameters: Any) -> Any:
        number = next(self.numbers)
        self.socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            said = json.loads(self.socket.recv(timeout=60))
            kind = said.get("params", {})
            if said.get("method") == "Runtime.exceptionThrown" or (
                said.get("method") == "Log.entryAdded" and kind["entry"]["level"] == "error"
            ):
                self.errors.append(str(kind)[:300])
            if said.get("id") == number:
                assert "error" not in said, said
                return said["result"]

    def value(self, expression: str) -> Any:
        return self("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def picture(self, path: Path | None = None) -> np.ndarray:
        from io import BytesIO

        from PIL import Image

        content = base64.b64decode(self("Page.captureScreenshot", format="png")["data"])
        if path is not None:
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content)
        left, top, right, bottom = LEFT
        return np.asarray(Image.open(BytesIO(content)).convert("RGB")).astype(int)[top:bottom, left:right]

    def is_still(self) -> bool:
        """Whether nothing moves for a second: software rendering takes that long for a frame at first."""
        first = self.picture()
        time.sleep(1.0)
        return different(first, self.picture()) == 0

    def click(self, button: str) -> None:
        self.value(f"[...document.querySelectorAll('button')].find(b => b.innerText === {button!r}).click()")

    def type_into(self, label: str, text: str) -> None:
        """Type a number into the field beside the slider of a label, as a visitor does."""
        found = self.value(
            "(() => {const all = [...document.querySelectorAll('input')].filter(one => {let up = one;"
            " for (let k = 0; k < 8 && up; k++) {up = up.parentElement;"
            f" if (up && up.innerText && up.innerText.trim().startsWith({label!r})) return true;"
            " if (up && up.querySelectorAll('input').length > 2) return false;} return false;});"
            " const one = all.filter(x => x.type !== 'hidden').pop(); if (!one) return null;"
            " one.scrollIntoView(); one.focus(); one.select(); return all.length;})()"
        )
        assert found, f"there is no slider {label}"
        self("Input.insertText", text=text)
        for kind in ("keyDown", "keyUp"):
            self("Input.dispatchKeyEvent", type=kind, key="Enter", code="Enter", windowsVirtualKeyCode=13)

    def close(self) -> None:
        self.socket.close()
        self.process.terminate()
        self.process.wait(30)


def wait(ready: Any, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not ready():
        assert time.monotonic() < end, "it did not come about"
        time.sleep(0.2)


@contextmanager
def served(*arguments: object, folder: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The command in a process of its own; its address, and the process."""
    said = folder / "said.txt"
    command = [sys.executable, "-m", "steelyard", "view", *map(str, arguments), "--no-open", "--port", "0"]
    with said.open("w") as out:
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT, text=True, env={**os.environ})
    try:
        wait(lambda: "Look at http" in said.read_text() or process.poll() is not None)
        assert process.poll() is None, said.read_text()
        yield said.read_text().split("Look at ")[1].split()[0], process
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0
        assert "Traceback" not in said.read_text()
    finally:
        process.kill()


def different(first: np.ndarray, second: np.ndarray) -> int:
    """How many pixels differ by more than rounding."""
    return int((np.abs(first - second).max(axis=2) > 24).sum())


def inked(picture: np.ndarray) -> int:
    """How many pixels are not white."""
    return int((np.abs(picture - 255).max(axis=2) > 60).sum())


def red(picture: np.ndarray) -> int:
    """How many pixels are red."""
    r, g, b = np.moveaxis(picture, 2, 0)
    return int(((r > 1.5 * g + 30) & (r > 1.5 * b + 30)).sum())


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None or not is_installed("viser"), reason="needs Chromium and viser (extra view)")
def test_the_view_draws_follows_a_slider_and_plays(place: Path, tmp_path: Path) -> None:
    with served(place / "arm.urdf", "--motion", place / "fold.json", folder=tmp_path) as (address, _):
        assert address.startswith("http://127.0.0.1:")
        # As browsers do: a connection that is not used must leave no trace on the terminal.
        socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2]))).close()
        page = Page(address, tmp_path / "profile")
        try:
            wait(lambda: page.value("document.body.innerText.includes('back to the start')"))
            wait(lambda: page.is_still() and inked(page.picture()) > 4000)  # the arm and the ground on white
            first = page.picture(PICTURES / "view-start.png")
            assert page.value("document.body.innerText.includes('Distances between links')")
            page.type_into("j1", "-1.2")
            wait(lambda: different(first, page.picture()) > 3000)
            page.click("back to the start")
            wait(lambda: different(first, page.picture()) < 1500)
            page.click("play")
            wait(lambda: page.value("document.body.innerText.includes('link3 to link1: -')"))
            wait(lambda: different(first, page.picture(PICTURES / "view-folded.png")) > 3000)
            assert page.value(DRAWN_CURVE) > 100  # the torque stays in its chart
            # Links that are in each other are red, behind their ellipsoids of wire.
            assert red(first) == 0
            assert red(page.picture(PICTURES / "view-folded.png")) > 200
            assert page.errors == []
        finally:
            page.close()
