"""A two-joint arm with hostile names, its logs, and what plain NumPy makes of them."""

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

import lxml.html
import numpy as np
import pytest

from steelyard.identification import Identification, identify
from steelyard.recording import Processing, Recording
from steelyard.report import write_report

from ..chromium import Page, chromium

Array = np.ndarray
LENGTH, GRAVITY = 0.5, 9.81
JOINTS = ("<script>alert(1)</script>", "elbow</script><img src=x onerror=alert(2)>")
LINKS = ("upper & 'lower' \"arm\"", "<b>fore</b>arm")
LOGS = ("motion <i>&1.csv", "other.csv")
# Lzz1 lx1 ly1 | m2 Lzz2 lx2 ly2 | Fv1 Fc1 Fv2 Fc2; the last is impossible.
TRUTH = np.array([0.6, 0.8, 0.05, 1.5, 0.15, 0.4, -0.03, 0.7, 0.5, 0.3, -0.05])


def planar_regressor(q: Array, dq: Array, ddq: Array) -> Array:
    """Torques (S, 2) of a planar arm in a vertical plane, by Lagrange, linear in what TRUTH lists: (S, 2, 11)."""
    (q1, q2), (d1, d2), (a1, a2) = q.T, dq.T, ddq.T
    c2, s2, c12, s12 = np.cos(q2), np.sin(q2), np.cos(q1 + q2), np.sin(q1 + q2)
    g, a = GRAVITY, LENGTH
    zero = np.zeros_like(q1)
    first = [
        *(a1, g * np.cos(q1), -g * np.sin(q1)),
        *(a * a * a1 + g * a * np.cos(q1), a1 + a2),
        a * ((2 * a1 + a2) * c2 - (2 * d1 + d2) * d2 * s2) + g * c12,
        -a * ((2 * a1 + a2) * s2 + (2 * d1 + d2) * d2 * c2) - g * s12,
        *(d1, np.sign(d1), zero, zero),
    ]
    second = [
        *(zero, zero, zero, zero, a1 + a2),
        a * (a1 * c2 + d1**2 * s2) + g * c12,
        a * (-a1 * s2 + d1**2 * c2) - g * s12,
        *(zero, zero, d2, np.sign(d2)),
    ]
    return np.stack([np.stack(first, -1), np.stack(second, -1)], 1)


def write_log(path: Path, seed: int) -> None:
    generator = np.random.default_rng(seed)
    t = np.arange(1500) / 100
    amplitude, frequency = generator.uniform(0.2, 0.6, (2, 4)), generator.uniform(0.8, 4.0, (2, 4))
    angle = t[:, None, None] * frequency
    q = (amplitude * np.sin(angle)).sum(-1)
    dq = (amplitude * frequency * np.cos(angle)).sum(-1)
    ddq = -(amplitude * frequency**2 * np.sin(angle)).sum(-1)
    torque = planar_regressor(q, dq, ddq) @ TRUTH + generator.normal(0.0, (0.5, 0.1), q.shape)
    table = np.column_stack([t, q, torque])
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header="t,q1,q2,tau1,tau2", comments="")


def write_robot(folder: Path) -> Path:
    joints = "".join(
        f'<joint name={quoteattr(JOINTS[i])} type="continuous"><parent link={quoteattr(("base", *LINKS)[i])}/>'
        f'<child link={quoteattr(LINKS[i])}/><origin xyz="{LENGTH * i} 0 0"/><axis xyz="0 0 1"/></joint>'
        for i in range(2)
    )
    links = "".join(f"<link name={quoteattr(name)}/>" for name in ("base", *LINKS))
    (folder / "arm.urdf").write_text(f'<robot name="arm">{links}{joints}</robot>')
    robot = folder / "robot.toml"
    robot.write_text(
        'name = "arm\\u001b[2J\\u202e <script>alert(3)</script>"\n[description]\nurdf = "arm.urdf"\n'
        f'gravity = [0, -{GRAVITY}, 0]\n[[terms]]\nkind = "viscous"\n[[terms]]\nkind = "coulomb"\n'
        '[log]\nposition = "q{}"\ntorque = "tau{}"\n[processing]\ncutoff = "none"\n'
    )
    return robot


@dataclass(frozen=True)
class Reference:
    """What plain NumPy finds: least squares on the first log, in the order of TRUTH, and the samples of both."""

    parameters: Array
    regressors: tuple[Array, ...]
    torques: tuple[Array, ...]

    def errors(self, log: int, parameters: Array) -> tuple[float, float, float]:
        """Relative errors of joint 1, of joint 2 and of both, in per cent."""
        difference = self.torques[log] - self.regressors[log] @ parameters
        joints = np.linalg.norm(difference, axis=0) / np.linalg.norm(self.torques[log], axis=0)
        whole = np.linalg.norm(difference) / np.linalg.norm(self.torques[log])
        return tuple(100 * float(x) for x in (*joints, whole))


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("arm")
    write_robot(folder)
    for seed, name in enumerate(LOGS):
        write_log(folder / name, seed)
    return folder


@pytest.fixture(scope="session")
def identification(folder: Path) -> Identification:
    return identify(folder / "robot.toml", [folder / LOGS[0]], validate=[folder / LOGS[1]], weights=None)


@pytest.fixture(scope="session")
def reference(folder: Path) -> Reference:
    regressors, torques = [], []
    for name in LOGS:
        samples = Recording.read(folder / name).process(Processing(cutoff=None))
        regressors.append(planar_regressor(samples.q, samples.dq, samples.ddq))
        torques.append(samples.torque)
    parameters = np.linalg.lstsq(regressors[0].reshape(-1, len(TRUTH)), torques[0].reshape(-1))[0]
    return Reference(parameters, tuple(regressors), tuple(torques))


@pytest.fixture(scope="session")
def report(identification: Identification, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(identification, path)
    return path


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with chromium(tmp_path_factory.mktemp("profile")) as page:
        yield page


def pixels(png: bytes) -> Array:
    """The picture as (height, width, 3), 0 to 255."""
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed, which reads pictures")
    return np.asarray(image.open(io.BytesIO(png)).convert("RGB")).astype(int)


Rows = list[list[str]]


def rows(page: lxml.html.HtmlElement, identifier: str) -> Rows:
    lines = page.get_element_by_id(identifier).xpath("./tbody/tr | ./tfoot/tr")
    return [[" ".join(cell.text_content().split()) for cell in line] for line in lines]
