"""The demonstration: a simulated WAM is recorded, identified and validated, with files to look at."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from steelyard.files import write_text

from .identify import identify
from .result import Identification
from .wam import robot_toml, simulated_log, wam_model

__all__ = ["demonstrate"]


def demonstrate(
    folder: str | Path, *, seed: int = 2014, progress: Callable[[str], None] | None = None
) -> Identification:
    """Simulate recordings of the WAM on trajectories A and B, identify from A and validate on B.

    Parameters
    ----------
    folder : str or Path
        Receives ``robot.toml``, ``trajectory-a.csv`` and ``trajectory-b.csv``.
    seed : int
        Of the noise.
    progress : callable, optional
        Called with a few words before each step.

    Returns
    -------
    Identification
    """
    say = progress or (lambda _: None)
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    robot_file = place / "robot.toml"
    write_text(robot_toml(), robot_file)
    model = wam_model()
    logs = []
    for name in ("A", "B"):
        say(f"simulating the arm on trajectory {name}")
        logs.append(place / f"trajectory-{name.lower()}.csv")
        simulated_log(model, name, seed).save(logs[-1])
    return identify(robot_file, logs[:1], validate=logs[1:], progress=progress)
