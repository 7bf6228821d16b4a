"""Random trees of bodies, told to Pinocchio and written as SDF, in which frames are placed in many ways."""

import numpy as np

pinocchio = __import__("pytest").importorskip("pinocchio", reason="Pinocchio (the oracle) is not installed")


def random_placement(random):
    return (
        pinocchio.SE3.Random()
        if random is None
        else pinocchio.SE3(pinocchio.exp3(random.normal(size=3)), random.uniform(-1, 1, 3))
    )


class RandomTree:
    """A tree whose links stand in one frame at q = 0, as `links` (SE3), with joints and inertias."""

    def __init__(self, seed, count):
        random = self.random = np.random.default_rng(seed)
        self.names = ["base", *(f"link{k}" for k in range(count))]
        self.parents = [-1, *(int(random.integers(0, k + 1)) for k in range(count))]
        self.links = [random_placement(random) for _ in self.names]
        self.in_child = [random_placement(random) for _ in self.names]  # frame of the joint in the child
        self.kinds = ["", *(str(random.choice(["revolute", "continuous", "prismatic", "fixed"])) for _ in range(count))]
        self.kinds[1] = "revolute"
        self.axes = [axis / np.linalg.norm(axis) for axis in random.normal(size=(count + 1, 3))]
        self.inertias = []
        for _ in self.names:
            spread = random.uniform(0.01, 0.1, 3)
            turn = pinocchio.exp3(random.normal(size=3))
            tensor = turn @ np.diag(spread.sum() - spread) @ turn.T
            self.inertias.append((random.uniform(0.2, 4.0), random.normal(size=3) * 0.2, turn, spread.sum() - spread))
            assert np.isfinite(tensor).all()

    def joint_frame(self, k):
        return self.links[k] * self.in_child[k]

    def pinocchio_model(self):
        """The model, with a body for each link, and the joints' numbers by name."""
        model = pinocchio.Model()
        model.gravity.linear = np.array([0, 0, -9.81])
        carrier = {0: (0, pinocchio.SE3.Identity())}  # of each link: joint of the model, and its frame at q = 0
        for k in range(1, len(self.names)):
            index, frame = carrier[self.parents[k]]
            mass, com, turn, moments = self.inertias[k]
            body = pinocchio.Inertia(mass, com, turn @ np.diag(moments) @ turn.T)
            here = self.joint_frame(k)
            if self.kinds[k] != "fixed":
                joint = (
                    pinocchio.JointModelPrismaticUnaligned(self.axes[k])
                    if self.kinds[k] == "prismatic"
                    else pinocchio.JointModelRevoluteUnaligned(self.axes[k])
                )
                index = model.addJoint(index, joint, frame.inverse() * here, f"joint{k - 1}")
                frame = here
            carrier[k] = index, frame
            model.appendBodyToJoint(index, body, frame.inverse() * self.links[k])
        return model

    def sdf(self, version="1.9", plain=False):
        """The text of an SDF: each pose in a frame that is chosen at random, each axis too."""
        random = self.random
        old = plain or tuple(map(int, version.split("."))) < (1, 7)
        frames = {"__model__": pinocchio.SE3.Identity()}
        extra = []
        if not old:
            for k in range(3):
                place = random_placement(random)
                within = random.choice(list(frames))
                extra.append(f'<frame name="frame{k}">{pose(frames[within].inverse() * place, within)}</frame>')
                frames[f"frame{k}"] = place
        parts = []
        for k, name in enumerate(self.names):
            within = "__model__" if old else str(random.choice(list(frames)))
            mass, com, turn, moments = self.inertias[k]
            place = frames[within].inverse() * self.links[k]
            held = pinocchio.SE3(turn, com)
            tensor = "".join(f"<i{a}{a}>{float(value)!r}</i{a}{a}>" for a, value in zip("xyz", moments, strict=True))
            parts.append(
                f'<link name="{name}">{pose(place, None if old else within)}<inertial>{pose(held)}'
                f"<mass>{mass!r}</mass><inertia>{tensor}</inertia></inertial></link>"
            )
            frames[name] = self.links[k]
        for k in range(1, len(self.names)):
            here = self.joint_frame(k)
            within = None if old or random.random() < 0.3 else str(random.choice(list(frames)))
            place = self.in_child[k] if within is None else frames[within].inverse() * here
            axis, words = self.axes[k], ""
            if version == "1.4":
                axis = here.rotation @ axis
            elif old and random.random() < 0.5:
                axis, words = here.rotation @ axis, "<use_parent_model_frame>true</use_parent_model_frame>"
            turned = None if old or random.random() < 0.3 else str(random.choice(list(frames)))
            if turned:
                axis = frames[turned].rotation.T @ here.rotation @ axis
            named = f' expressed_in="{turned}"' if turned else ""
            ends = f"<parent>{self.names[self.parents[k]]}</parent><child>{self.names[k]}</child>"
            line = " ".join(repr(float(value)) for value in axis)
            axes = "" if self.kinds[k] == "fixed" else f"<axis><xyz{named}>{line}</xyz>{words}</axis>"
            parts.append(f'<joint name="joint{k - 1}" type="{self.kinds[k]}">{pose(place, within)}{ends}{axes}</joint>')
            frames[f"joint{k - 1}"] = here
        body = "".join([*(parts[i] for i in random.permutation(len(parts))), *extra])
        return f'<sdf version="{version}"><model name="tree">{body}</model></sdf>'


def pose(place, within=None):
    """A `<pose>` element; Pinocchio turns matrices into roll, pitch and yaw."""
    angles = pinocchio.rpy.matrixToRpy(place.rotation)
    numbers = " ".join(repr(float(value)) for value in (*place.translation, *angles))
    return f'<pose relative_to="{within}">{numbers}</pose>' if within else f"<pose>{numbers}</pose>"
