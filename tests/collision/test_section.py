"""The tables of a limits file that describe constraints in space."""

import tomllib

import numpy as np
import pytest

from steelyard import Robot
from steelyard.collision import geometry_from_dict
from steelyard.errors import InputError

URDF = """<robot name="arm">
  <link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
  <link name="upper"><collision><origin xyz="0 0 0.2" /><geometry><cylinder radius="0.04" length="0.3"/></geometry>
    </collision></link>
  <link name="fore"><collision><origin xyz="0 0 0.2" /><geometry><capsule radius="0.03" length="0.3"/></geometry>
    </collision></link>
  <link name="tool0"/>
  <joint name="j1" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5"/></joint>
  <joint name="j2" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
    <limit lower="-2.9" upper="2.9"/></joint>
  <joint name="tip" type="fixed"><parent link="fore"/><child link="tool0"/><origin xyz="0 0 0.4"/></joint>
</robot>"""

COMPLETE = """
[collision]
margin = 0.02
horizon = 0.4
exclude = [["upper", "base"]]
srdf = "arm.srdf"
neutral_configuration = [0, 0]

[[collision.shapes]]
link = "tool0"
type = "sphere"
radius = 0.05
xyz = [0, 0, 0.02]

[[obstacles]]
name = "wall"
type = "box"
size = [0.1, 2, 2]
xyz = [0.7, 0, 0]
rpy = [0, 0, 0.1]
margin = 0.03

[[obstacles]]
name = "rock"
type = "mesh"
file = "rock.obj"
scale = 0.001
xyz = [-0.7, 0, 0.2]
ignore = ["upper"]

[table]
normal = [0, 0, 1]
offset = 0.0
margin = 0.01
ignore = ["upper"]

[[workspace]]
link = "tool0"
lower = [-1, -inf, 0.1]

[[workspace]]
link = "fore"
upper = [0.3, inf, inf]
point = [0, 0, 0.1]
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF)
    (tmp_path / "arm.srdf").write_text('<robot name="arm"><disable_collisions link1="fore" link2="x"/></robot>')
    corners = "".join(f"v {x} {y} {z}\n" for x in (0, 100) for y in (0, 100) for z in (0, 100))
    (tmp_path / "rock.obj").write_text(f"{corners}f 1 2 3\nf 5 6 7\nf 2 4 8\n")
    return tmp_path


def read(text, folder, robot=None):
    robot = robot or Robot.from_urdf(folder / "arm.urdf")
    return geometry_from_dict(tomllib.loads(text), robot, folder, where="limits.toml")


def test_a_complete_file(folder):
    pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")
    own, obstacles, table, first, second = read(COMPLETE, folder)
    assert own.name == "self-collision"
    assert own.labels == ("fore to base", "tool0 to upper")
    assert own.watched == ((("base", "fore"), ("base", "tool0")), (("upper", "tool0"),))
    assert own.horizon == 0.4
    np.testing.assert_array_equal(own.margins, [0.02, 0.02])
    assert obstacles.labels == ("upper to wall", "fore to wall", "fore to rock")
    np.testing.assert_array_equal(obstacles.margins, [0.03, 0.03, 0.02])
    assert table.labels == ("fore",)
    assert (first.name, second.name) == ("workspace 1", "workspace 2")
    assert first.labels == ("tool0 above x = -1", "tool0 above z = 0.1")
    assert second.labels == ("fore below x = 0.3",)
    # Straight up: the ball on the tool is 0.97 above the plane, and the forearm is the nearest part of it.
    q = np.zeros((1, 2))
    assert table.clearance(q)[0, 0] == pytest.approx(0.5 + 0.05 - 0.03 - 0.01)
    assert own.distances(q)[0, 0] == pytest.approx(0.5 + 0.05 - 0.03 - 0.05, abs=1e-6)
    assert second.clearance(q)[0, 0] == pytest.approx(0.3)
    corner = np.array([-0.6, 0.0, 0.3])  # of the rock, the nearest to the axis of the forearm
    assert obstacles.distances(q)[0, 2] == pytest.approx(np.hypot(0.6, 0.55 - corner[2]) - 0.03, abs=2e-6)


def test_a_workspace_needs_no_geometry():
    arm = Robot.from_dh([(0, 0.5, 0, "q")], name="arm")
    (box,) = read('[workspace]\nlink = "link1"\nupper = [1, 1, inf]', ".", arm)
    assert box.name == "workspace"


def test_a_table_alone_watches_no_collisions(folder):
    (table,) = read('[table]\nignore = ["upper"]', folder)
    assert table.name == "table plane"


def test_self_collision_can_be_switched_off(folder):
    (table,) = read('[collision]\nself = false\n[table]\nignore = ["upper"]', folder)
    assert table.name == "table plane"


def test_nothing_described_is_nothing(folder):
    assert read("", folder) == ()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[colision]", r"limits.toml: 'colision' is no table of geometry; did you mean \"collision\"\?"),
        ("collision = 3", r"limits.toml, \[collision\] must be a table with .*, got 3"),
        ("[collision]\nmargn = 1", r"limits.toml, \[collision\]: 'margn' is not known here; did you mean \"margin\"\?"),
        ("[collision]\nself = 1", r"\[collision\]: self must be true or false, got 1"),
        ('[collision]\nmargin = "1 cm"', r"\[collision\]: margin must be a number, finite, got '1 cm'"),
        ("[collision]\nmargin = -1", r"limits.toml, \[collision\]: self-collision: the margin must be 0 or more"),
        ('[collision]\nurdf = "no.urdf"', r"\[collision\]: .*no.urdf: cannot be read"),
        ('[collision]\nmeshes = "fine"', r'\[collision\]: meshes must be "hull" or "exact", got \'fine\''),
        ("[collision]\npackages = [1]", r"\[collision\]: packages must be a list of strings, got \[1\]"),
        ('[collision]\nsrdf = "no.srdf"', r"\[collision\]: .*no.srdf: cannot be read"),
        ("[collision]\nsrdf = 3", "srdf must be a string, got 3"),
        ("[collision]\nexclude = [1]", r"exclude must be a list of links and of pairs"),
        ('[collision]\nexclude = ["hand"]', r'\[collision\]: robot "arm" has no link "hand"'),
        ("[collision]\nneutral_configuration = [0]", r"neutral_configuration must be 2 numbers, finite, got \[0\]"),
        ("[[collision.shapes]]\nradius = 1", r"\[\[collision.shapes\]\] number 1: type must name a shape, got None"),
        ('[[collision.shapes]]\ntype = "spere"', "got 'spere'; did you mean \"sphere\""),
        ('[[collision.shapes]]\ntype = "sphere"\nradius = 1', "number 1: it has no link; name the link"),
        ('[[collision.shapes]]\ntype = "sphere"\nradius = 1\nlink = "x"', 'number 1: robot "arm" has no link "x"'),
        ("obstacles = 3", r"limits.toml: obstacles must be written as \[\[obstacles\]\]"),
        ('[[obstacles]]\ntype = "sphere"\nradius = 1', r"\[\[obstacles\]\] number 1: it has no name"),
        ('[[obstacles]]\nname = "a"\ntype = "sphere"', "number 1: a sphere needs radius; add it, in m"),
        ('[[obstacles]]\nname = "a"\ntype = "sphere"\nradius = 0', "number 1: a sphere: radius must be positive"),
        ('[[obstacles]]\nname = "a"\ntype = "box"\nsize = 1', "number 1: size must be 3 numbers, finite, got 1"),
        (
            '[[obstacles]]\nname = "a"\ntype = "box"\nradius = 1',
            '\'radius\' is not known here; known are "type", "size"',
        ),
        ('[[obstacles]]\nname = "a"\ntype = "mesh"', "number 1: a mesh needs file; add the path"),
        ('[[obstacles]]\nname = "a"\ntype = "mesh"\nfile = "no.stl"', "number 1: the mesh .*no.stl is not found; the"),
        ('[[obstacles]]\nname = "a"\ntype = "mesh"\nfile = "rock.obj"\nscale = 0', "the scale must not be 0, got 0"),
        (
            '[[obstacles]]\nname = "a"\ntype = "mesh"\nfile = "rock.obj"\nexact = 1',
            "exact must be true or false, got 1",
        ),
        ('[[obstacles]]\nname = "a"\ntype = "sphere"\nradius = 1\nxyz = [0, 0]', "xyz must be 3 numbers, finite"),
        ('[[obstacles]]\nname = "a"\ntype = "sphere"\nradius = 1\nrpy = 1', "rpy must be 3 numbers, finite, got 1"),
        ('[[obstacles]]\nname = "a"\ntype = "sphere"\nradius = 1', r"\[\[obstacles\]\]: obstacles: .* is violated by"),
        ('[table]\nnormal = "up"', r"limits.toml, \[table\]: normal must be 3 numbers, finite, got 'up'"),
        ("[table]\nheight = 1", r"\[table\]: 'height' is not known here"),
        ("[table]\noffset = true", r"\[table\]: offset must be a number, finite, got True"),
        ('[table]\nlinks = "upper"', r"\[table\]: links must be a list of strings, got 'upper'"),
        ("[[table]]\noffset = 5", r"\[\[table\]\] number 1: table plane: upper is violated by"),
        ("[workspace]\nlower = [0, 0, 0]", r"\[workspace\]: it has no link; name the link of the tool"),
        ('[workspace]\nlink = "tool0"\nlower = [nan, 0, 0]', r"lower must be 3 numbers, got \[nan, 0, 0\]"),
        ('[workspace]\nlink = "tool1"\nlower = [0, 0, 0]', 'no link "tool1"; did you mean "tool0"'),
    ],
)
def test_mistakes_are_named_with_their_place(text, message, folder):
    pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")
    with pytest.raises(InputError, match=message) as caught:
        read(text, folder)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("limits.toml")
