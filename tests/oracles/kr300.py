"""The KUKA KR300 of the recordings, as their robot.json describes it."""

import json


def about(folder):
    """What robot.json tells."""
    return json.loads((folder / "robot.json").read_text())


def description(folder):
    """Return [description] of a robot.toml: rows and gravity."""
    return f"[description]\nrows = {json.dumps(about(folder)['rows'])}\ngravity = [0, 0, 9.81]\n"


def log_section(folder):
    """Return [log] of a robot.toml: positions and speeds of the joints, and torques of the motors by their gears."""
    gain = json.dumps(about(folder)["gear_ratio"])
    return f'[log]\nposition = "q{{}}"\nvelocity = "dq{{}}"\ntorque = "tau_m{{}}"\ngain = {gain}\n'


def elastic_robot(folder, further=""):
    """Return a robot.toml with CAD, load, friction, `further` lines, secondary encoders and the motors' inertia."""
    told = about(folder)
    loaded = told["payload"]["link_6_with_payload_used_in_the_feedforward_of_A_B_C"]
    text = description(folder)
    for name in "123456":
        link = told["links_from_CAD"][name]
        mass, com = (loaded["mass"], loaded["com"]) if name == "6" else (link["mass"], link["com"])
        xx, yy, zz, xy, yz, xz = link["inertia"] or [0.05 * mass] * 3 + [0.0] * 3
        text += (
            f'[[description.inertials]]\nlink = "link{name}"\nmass = {mass}\ncenter_of_mass = {com}\n'
            f"inertia = {[xx, xy, xz, yy, yz, zz]}\n"
        )
    text += "".join(f'[[terms]]\nkind = "{one}"\n' for one in ("viscous", "coulomb", "offset", "rotor_inertia"))
    return (
        f"{text}{further}{log_section(folder)}[processing]\ncutoff = 10.0\norder = 4\n"
        '[elastic]\njoints = [1, 2, 3]\nposition = "q_se{}"\nmotor_inertia = [609.0, 843.9, 751.3]\n'
    )
