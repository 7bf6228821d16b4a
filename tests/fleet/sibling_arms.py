"""Arms of three joints that are built alike, reduced to Informations: what a fleet is made of."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

import steelyard as sy

ROBOT = """\
[description]
rows = [[0.0, 0.4, 0.0, "q"], ["pi/2", 0.3, 0.1, "q"], [0.0, 0.25, 0.0, "q"]]
gravity = [0.0, -9.81, 0.0]

[[terms]]
kind = "viscous"

[[terms]]
kind = "coulomb"
"""
MASSES = (6.0, 4.0, 2.0)
FRICTION = ((1.0, 2.0), (0.8, 1.5), (0.5, 1.0))


Factor = float | NDArray[np.float64]


class Arms:
    """Arms whose links vary by 1 %, friction by 5 %; a fault multiplies friction of a joint, all of a link or a torque,
    or all torques, each by its own factor where there are several, or is a payload; or the arms are warmer, so that
    viscous friction is less by a factor and Coulomb friction by its root.

    Those of another reach have a second link of another length. What they vary by is normal, or has the tails of
    Student's distribution with some degrees of freedom. All may have the same motion.
    """

    trembling = 1e-6
    """Of the encoder of a joint that stands still."""

    def __init__(self, folder: Path, reach: float = 1.0, freedom: float | None = None, alike: bool = False) -> None:
        self.folder, self.freedom, self.alike = folder, freedom, alike
        text = ROBOT.replace('["pi/2", 0.3, 0.1', f'["pi/2", {0.3 * reach}, 0.1')
        (folder / "robot.toml").write_text(text, encoding="utf-8")
        self.model = sy.Model.load(folder / "robot.toml")
        self.names = [str(name) for name in self.model.parameter_names]
        values = []
        for k, (mass, friction) in enumerate(zip(MASSES, FRICTION, strict=True)):
            inertia = sy.Inertia.from_com(mass, [-0.15, 0.02, 0.03 * k], 0.02 * mass * np.diag([0.4, 1.0, 1.1]))
            values += [*inertia.parameters, *friction]
        self.usual = np.array(values)

    def information(
        self,
        number: int,
        fault: str = "",
        factor: Factor = 1.0,
        epoch: int = 0,
        duration: float = 20.0,
        still: int | None = None,
    ) -> sy.Information:
        """Of an arm, of which one joint may stand still, where only the noise of its encoder moves it."""
        random = np.random.default_rng([number, 1])
        vary = random.normal if self.freedom is None else partial(random.standard_t, self.freedom)
        values = self.usual.copy()
        for columns in self.model.link_columns:
            values[columns] *= 1.0 + 0.01 * vary()
        for index, name in enumerate(self.names):
            if name.startswith("F"):
                values[index] *= 1.0 + 0.05 * vary()
            if fault.startswith("joint") and name in (f"Fvj{fault[5:]}", f"Fcj{fault[5:]}"):
                values[index] *= factor
            if fault == "warm" and name.startswith("F"):
                values[index] *= factor if name.startswith("Fv") else factor**0.5
        if fault == "payload":  # a lump of so many kilograms on the flange
            lump = sy.Inertia.from_com(factor, [0.0, 0.05, 0.1], 0.002 * factor * np.eye(3))
            values[self.model.link_columns[-1]] += lump.parameters
        if fault.startswith("link"):
            values[self.model.link_columns[int(fault[4:]) - 1]] *= factor
        t = np.arange(0.0, duration, 0.01)[:, None]
        w, phase = 2 * np.pi * np.array([0.2, 0.31, 0.43]), random.uniform(0.0, 6.0, 3)
        phase = np.ones(3) if self.alike else phase
        q = np.sin(w * t + phase) + 0.3 * np.sin(2.3 * w * t)
        dq = w * np.cos(w * t + phase) + 0.69 * w * np.cos(2.3 * w * t)
        ddq = -(w**2) * np.sin(w * t + phase) - 0.3 * (2.3 * w) ** 2 * np.sin(2.3 * w * t)
        if still is not None:
            trembling = self.trembling * np.random.default_rng([number, 3]).normal(size=(3, len(t)))
            for one, own in zip((q, dq, ddq), trembling, strict=True):
                one[:, still] = own
        torque = self.model.inverse_dynamics(q, dq, ddq, values)
        noise = np.random.default_rng([number, 2, epoch])
        lasting = lfilter([np.sqrt(1 - 0.9**2)], [1.0, -0.9], noise.normal(size=torque.shape), axis=0)
        torque = torque + 0.2 * (lasting + noise.normal(size=torque.shape))
        if fault.startswith("gain"):
            torque[:, slice(None) if fault == "gains" else int(fault[4:]) - 1] *= factor
        return sy.Information.from_samples(self.model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))

    def manifest(self, rows: list[str], *, more: str = "") -> Path:
        (self.folder / "robots.csv").write_text("\n".join(["id,date,informations", *rows]) + "\n", encoding="utf-8")
        path = self.folder / "fleet.toml"
        path.write_text(f'robot = "robot.toml"\ntable = "robots.csv"\n{more}', encoding="utf-8")
        return path
