"""Random MJCF files that use what the format has: defaults, frames, every way to give an inertia and an orientation."""

from pathlib import Path

import numpy as np

ORIENTATIONS = {"quat": 4, "euler": 3, "axisangle": 4, "xyaxes": 6, "zaxis": 3}


def numbers(values) -> str:
    return " ".join(repr(float(value)) for value in np.atleast_1d(values))


def orientation(random: np.random.Generator) -> str:
    kind = str(random.choice(["", *ORIENTATIONS]))
    return f' {kind}="{numbers(random.normal(size=ORIENTATIONS[kind]))}"' if kind else ""


def placement(random: np.random.Generator) -> str:
    return f'pos="{numbers(random.normal(size=3) * 0.3)}"{orientation(random)}'


def inertial(random: np.random.Generator) -> str:
    points = random.normal(size=(5, 3)) * 0.2
    second = sum(point @ point * np.eye(3) - np.outer(point, point) for point in points)
    start = f'<inertial pos="{numbers(random.normal(size=3) * 0.1)}" mass="{numbers(random.uniform(0.1, 5))}"'
    if random.random() < 0.5:
        xx, yy, zz, xy, xz, yz = (second[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        return f'{start} fullinertia="{numbers([xx, yy, zz, xy, xz, yz])}"/>'
    return f'{start} diaginertia="{numbers(np.linalg.eigvalsh(second))}"{orientation(random)}/>'


def geom(random: np.random.Generator) -> str:
    kind = str(random.choice(["sphere", "capsule", "ellipsoid", "cylinder", "box"]))
    weight = str(random.choice(["", ' density="300"', ' mass="0.7"']))
    if kind in ("capsule", "cylinder") and random.random() < 0.5:
        return f'<geom type="{kind}" size="0.05" fromto="{numbers(random.normal(size=6) * 0.2)}"{weight}/>'
    return f'<geom type="{kind}" size="{numbers(random.uniform(0.02, 0.2, 3))}" {placement(random)}{weight}/>'


def joint(random: np.random.Generator) -> str:
    kind = random.choice(["hinge", "hinge", "slide"])
    text = f'<joint type="{kind}" axis="{numbers(random.normal(size=3))}"'
    for key, chance in (("pos", 0.5), ("ref", 0.3), ("armature", 0.4), ("damping", 0.4), ("frictionloss", 0.3)):
        if random.random() < chance:
            text += f' {key}="{numbers(random.uniform(0, 0.5, 3 if key == "pos" else 1))}"'
    return text + str(random.choice(["", ' class="strong"', ' range="-1 2" limited="true"'])) + "/>"


def body(random: np.random.Generator, depth: int) -> str:
    joints = int(random.choice([0, 1, 1, 1, 2, 3], p=[0.2, 0.2, 0.2, 0.2, 0.1, 0.1]))
    parts = [joint(random) for _ in range(joints)]
    if random.random() < 0.6:
        parts.append(inertial(random))
    parts += [geom(random) for _ in range(int(random.integers(1, 4)))]
    for _ in range(int(random.integers(0, 3)) if depth < 5 else 0):
        child = body(random, depth + 1)
        parts.append(f"<frame {placement(random)}>{child}</frame>" if random.random() < 0.2 else child)
    inner = "\n".join(parts)
    childclass = str(random.choice(["", "", ' childclass="strong"']))
    return f"<body {placement(random)}{childclass}>\n{inner}\n</body>"


def random_forest(folder: Path, seed: int) -> Path:
    """Write a file of several random trees on the world."""
    random = np.random.default_rng(seed)
    sequence = random.choice(["xyz", "zyx", "XYZ", "ZXZ", "yXz"])
    compiler = f'<compiler angle="{random.choice(["radian", "degree"])}" eulerseq="{sequence}"'
    if seed % 3 == 0:
        compiler += ' inertiafromgeom="true"'
    if seed % 4 == 0:
        compiler += ' boundmass="1" boundinertia="0.05"'
    if seed % 5 == 0:
        compiler += ' settotalmass="30"'
    trees = "\n".join(body(random, 0) for _ in range(8))
    trees += '<body pos="0 0 1">' + joint(random) * 2 + geom(random) + "</body>"
    path = folder / f"forest{seed}.xml"
    path.write_text(
        f"""<mujoco>{compiler}/>
<default><joint armature="0.01"/><geom density="800"/>
<default class="strong"><joint armature="0.3" damping="0.2" frictionloss="0.1"/><geom density="2000"/></default>
</default>
<worldbody>
{trees}
</worldbody></mujoco>
"""
    )
    return path
