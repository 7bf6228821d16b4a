"""A seven-joint arm picks something up: what it weighs, and where its centre of mass is, while the arm moves on.

python examples/pick_up_a_payload.py
"""

from steelyard.online import OnlinePayloadEstimate, simulated_pick_up, watch_pick_up

simulated = simulated_pick_up(seed=2014, mass=2.0, when=25.0, duration=31.0)


def show(found: OnlinePayloadEstimate) -> None:
    """Print one line a second."""
    if round(10 * found.since) % 10 == 0:
        x, y, z = (found[name].value for name in ("cx", "cy", "cz"))
        print(f"{found.t:6.2f} s: {found['mass']}; centre of mass at ({x:.3f}, {y:.3f}, {z:.3f}) m")


run = watch_pick_up(simulated, progress=show)
print(run)
if 2.0 not in run.told[-1]["mass"]:
    raise SystemExit("the interval of the mass does not hold the truth")
