"""Which pairs are watched, and what the constraints refuse."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.collision import (
    Box,
    Capsule,
    Obstacle,
    ObstacleClearance,
    PlacedShape,
    RobotGeometry,
    SelfCollision,
    Sphere,
    TablePlane,
    WorkspaceBox,
)
from steelyard.collision.configurations import default_neutral_configuration, random_configurations
from steelyard.errors import InputError
from steelyard.excitation.limit_margins import margins_of
from steelyard.robot.placement import rotation_y, translation

CHAIN = """<robot name="chain">
  <link name="base"/><link name="a"/><link name="b"/><link name="wrist"/><link name="c"/>
  <link name="tool"/><link name="cam"/>
  <joint name="j1" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3"/></joint>
  <joint name="j2" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.5 0 0"/><axis xyz="0 0 1"/>
    <limit lower="0.5" upper="2.5"/></joint>
  <joint name="j3" type="revolute"><parent link="b"/><child link="wrist"/><origin xyz="0.5 0 0"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="j4" type="revolute"><parent link="wrist"/><child link="c"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1"/></joint>
  <joint name="f1" type="fixed"><parent link="c"/><child link="tool"/><origin xyz="0.3 0 0"/></joint>
  <joint name="f2" type="fixed"><parent link="c"/><child link="cam"/><origin xyz="0.02 0 0.08"/></joint>
</robot>"""


ROD = """<collision><origin xyz="0.25 0 0" rpy="0 1.5707963267948966 0"/><geometry><cylinder radius="0.05"
  length="0.3"/></geometry></collision>"""
BALL = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'
SCISSORS = f"""<robot name="scissors"><link name="base">{BALL}</link>
  <link name="left">{ROD}</link><link name="right">{ROD}</link>
  <joint name="j1" type="revolute"><parent link="base"/><child link="left"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3"/></joint>
  <joint name="j2" type="revolute"><parent link="base"/><child link="right"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def chain(tmp_path_factory):
    path = tmp_path_factory.mktemp("chain") / "chain.urdf"
    path.write_text(CHAIN)
    robot = sy.Robot.from_urdf(path)
    rod = rotation_y(np.pi / 2)
    rod[0, 3] = 0.25
    shapes = [PlacedShape.on(robot, name, Capsule(0.03, 0.3), rod) for name in ("a", "b")]
    shapes += [PlacedShape.on(robot, "c", Capsule(0.03, 0.1), rod), PlacedShape.on(robot, "base", Sphere(0.05))]
    shapes += [PlacedShape.on(robot, "tool", Sphere(0.04)), PlacedShape.on(robot, "cam", Sphere(0.02))]
    return RobotGeometry(robot, shapes, RobotGeometry.from_urdf(robot).parents)


def watched(limit):
    return {frozenset(pair) for links in limit.watched for pair in links}


def pairs(*names):
    return {frozenset(name.split()) for name in names}


def test_neutral_and_random_configurations_keep_to_the_limits(chain):
    np.testing.assert_allclose(default_neutral_configuration(chain.robot), [0.0, 1.5, 0.0, 0.0])
    configurations = random_configurations(chain.robot, 4000)
    np.testing.assert_allclose(configurations.min(axis=0), [-3.0, 0.5, -np.pi, -1.0], atol=0.01)
    np.testing.assert_allclose(configurations.max(axis=0), [3.0, 2.5, np.pi, 1.0], atol=0.01)
    np.testing.assert_array_equal(configurations, random_configurations(chain.robot, 4000))


class TestPairs:
    @pytest.fixture(autouse=True)
    def _coal(self):
        pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")

    def test_neighbours_are_left_out(self, chain):
        """`wrist` has no shape, so b and c are neighbours; cam is not, since c lies between."""
        limit = SelfCollision(chain)
        left_out = {frozenset((one.first, one.second)): one.reason for one in limit.left_out}
        assert left_out == dict.fromkeys(pairs("base a", "a b", "b c"), "adjacent")
        assert watched(limit) == pairs("base b", "base c", "base tool", "base cam", "a c", "a tool", "a cam") | pairs(
            "b tool", "b cam"
        )
        assert limit.labels == ("b to base", "c to base", "c to a", "c to b")
        assert limit.clearance(np.zeros((3, 4)) + default_neutral_configuration(chain.robot)).shape == (3, 4)

    @pytest.mark.parametrize(("mass", "moments", "apart"), [(0.37, (4e-4, 5e-4, 3e-4), True), (1.0, (1.0,) * 3, False)])
    def test_a_heavy_link_without_a_shape_is_a_body(self, tmp_path, mass, moments, apart):
        """The links on either side of the wrist are 0 to 0.1 m apart; what a template leaves as an inertial is none."""
        ixx, iyy, izz = moments
        inertial = (
            f'<inertial><mass value="{mass}"/><inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/>'
            "</inertial>"
        )
        path = tmp_path / "chain.urdf"
        path.write_text(CHAIN.replace('<link name="wrist"/>', f'<link name="wrist">{inertial}</link>'))
        robot = sy.Robot.from_urdf(path)
        rod = rotation_y(np.pi / 2)
        rod[0, 3] = 0.25
        shapes = [PlacedShape.on(robot, name, Capsule(0.03, 0.3), rod) for name in ("b", "c")]
        assert watched(SelfCollision(RobotGeometry(robot, shapes))) == (pairs("b c") if apart else set())

    def test_the_neutral_configuration(self, chain):
        """At 0 the second rod is stretched out; folded back, the tool lies on the first rod."""
        folded = np.array([0.0, 2.5, 2.3, 0.0])
        touching = {
            frozenset((one.first, one.second))
            for one in SelfCollision(chain, neutral_configuration=folded).left_out
            if one.reason.startswith("touch in the neutral configuration, and in ")
        }
        assert touching
        assert touching <= pairs("a c", "a tool", "a cam", "base tool", "base cam")
        free = SelfCollision(chain, exclude=touching and [tuple(pair) for pair in touching])
        assert watched(free) == watched(SelfCollision(chain, neutral_configuration=folded))

    def test_pairs_that_touch_at_zeros_but_seldom_elsewhere_are_watched(self, tmp_path):
        """Two rods that turn about one axis lie on each other at zeros, as the links of a folded arm do."""
        path = tmp_path / "scissors.urdf"
        path.write_text(SCISSORS)
        geometry = RobotGeometry.from_urdf(sy.Robot.from_urdf(path))
        limit = SelfCollision(geometry, margin=0.01)
        assert watched(limit) == pairs("left right")
        *_, pair = SelfCollision(geometry, neutral_configuration=[0.0, 0.0]).left_out
        assert str(pair).startswith("left and right: touch in the neutral configuration, and in ")
        assert limit.remedies == (
            'in [collision] of the limits file, give a margin below 0.01 (m) or exclude = [["left", "right"]], '
            "which is right where only the shapes touch and not the links",
        )

    def test_what_always_touches_is_left_out(self, chain):
        big = chain.with_shapes([PlacedShape.on(chain.robot, "base", Sphere(0.9))])
        limit = SelfCollision(big, neutral_configuration=[0.0, 0.5, 0.0, 0.0])
        reasons = {frozenset((one.first, one.second)): one.reason for one in limit.left_out}
        assert reasons[frozenset(("base", "b"))] == "touch in 100% of random configurations"

    @pytest.mark.parametrize(("bend", "watching"), [(0.93, False), (1.8, True)])
    def test_shapes_that_hardly_come_apart_are_left_out(self, scissors, bend, watching):
        """A ball turns in a ring of balls with a gap: of 11 % of the turn and 10 mm, or of half and more than that."""
        ring = [one for angle, one in self.ring(scissors, "right") if abs(angle) > bend]
        limit = SelfCollision(RobotGeometry(scissors, [*self.balls(scissors), *ring]), margin=0.01)
        assert watched(limit) == (pairs("left right") if watching else set())
        if not watching:
            assert str(limit.left_out[-1]).startswith("left and right: nowhere farther apart than ")

    def test_links_that_are_never_all_apart_are_left_out(self, scissors):
        """Two halves of a ring on one moving link: of each the ball comes clear, of both it never does."""
        halves = [
            [one for angle, one in self.ring(scissors, link) if side * angle > 0.93]
            for link, side in (("right", 1.0), ("plate", -1.0))
        ]
        balls = self.balls(scissors)
        for half, link in zip(halves, ("right", "plate"), strict=True):
            assert watched(
                SelfCollision(RobotGeometry(scissors, [*balls, *half]), margin=0.01, exclude=["base"])
            ) == pairs(f"left {link}")
        limit = SelfCollision(RobotGeometry(scissors, [*balls, *halves[0], *halves[1]]), margin=0.01, exclude=["base"])
        assert watched(limit) == set()
        reasons = {frozenset((one.first, one.second)): one.reason for one in limit.left_out}
        assert {pair for pair, reason in reasons.items() if "nowhere farther" in reason} == pairs(
            "left right", "left plate"
        )

    @pytest.fixture
    def scissors(self, tmp_path):
        path = tmp_path / "scissors.urdf"
        plate = '<joint name="f" type="fixed"><parent link="right"/><child link="plate"/></joint></robot>'
        bare = SCISSORS.replace(BALL, "").replace(ROD, "")
        path.write_text(bare.replace("</robot>", f'<link name="plate"/>{plate}'))
        return sy.Robot.from_urdf(path)

    @staticmethod
    def balls(robot):
        """The ball, and a shape of the base, without which the two links would be adjacent."""
        ball = PlacedShape.on(robot, "left", Sphere(0.012), translation(0.03, 0.0, 0.0))
        return [ball, PlacedShape.on(robot, "base", Sphere(0.001))]

    @staticmethod
    def ring(robot, link):
        angles = np.linspace(-np.pi, np.pi, 40)
        places = [translation(0.03 * np.cos(a), 0.03 * np.sin(a), 0.0) for a in angles]
        return [(a, PlacedShape.on(robot, link, Sphere(0.008), one)) for a, one in zip(angles, places, strict=True)]

    def test_exclusions(self, chain, tmp_path):
        srdf = tmp_path / "chain.srdf"
        srdf.write_text('<robot name="chain"><disable_collisions link1="tool" link2="b"/></robot>')
        limit = SelfCollision(chain, exclude=["base", ("cam", "a")], srdf=srdf)
        assert watched(limit) == pairs("a c", "a tool", "b cam")
        reasons = {frozenset((one.first, one.second)): one.reason for one in limit.left_out}
        assert reasons[frozenset(("tool", "b"))] == "disabled by the SRDF"
        assert reasons[frozenset(("cam", "a"))] == "excluded"
        assert str(limit.left_out[0]) == "a and b: adjacent"

    def test_margins_that_cannot_be_kept_are_halved(self, chain):
        """The camera is 0.08 m above the last axis: from the second rod it is never farther than some centimetres."""
        limit = SelfCollision(chain, margin=0.15)
        q = random_configurations(chain.robot, 2000, seed=4)
        column = limit.labels.index("cam to b")
        assert limit.watched[column] == (("b", "cam"),)
        widest = limit.distances(q)[:, column].max()
        assert 0.0 < limit.margins[column] < 0.15
        assert limit.margins[column] == pytest.approx(widest / 2, rel=0.05)
        others = np.delete(limit.margins, column)
        np.testing.assert_array_equal(others, 0.15)

    def test_links_that_cannot_collide_have_no_clearance(self):
        arm = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.5, 0, "q")])
        geometry = RobotGeometry(arm, [PlacedShape.on(arm, name, Sphere(0.01)) for name in arm.link_names])
        limit = SelfCollision(geometry)
        assert limit.labels == ()
        assert limit.clearance(np.zeros((4, 2))).shape == (4, 0)
        assert not limit.vjp(np.zeros((4, 2)), None, None, np.zeros((4, 0)))[0].any()

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"margin": -0.1}, "self-collision: the margin must be 0 or more, in m, got -0.1"),
            ({"margin": "wide"}, "the margin must be 0 or more"),
            ({"margin": 0.1, "horizon": 0.1}, "the horizon must be larger than the margin of 0.1 m, got 0.1 m"),
            ({"exclude": ["hand"]}, 'no link "hand"'),
            ({"exclude": [("a", "b", "c")]}, r"an entry is a link or a pair of links, got \('a', 'b', 'c'\)"),
            ({"neutral_configuration": [0.0]}, "the neutral configuration must be 4 finite numbers"),
        ],
    )
    def test_bad_options(self, chain, options, message):
        with pytest.raises(InputError, match=message):
            SelfCollision(chain, **options)

    def test_a_foreign_srdf_is_refused(self, chain, tmp_path):
        srdf = tmp_path / "other.srdf"
        srdf.write_text('<robot name="x"><disable_collisions link1="left" link2="right"/></robot>')
        with pytest.raises(InputError, match=r'names no link of the robot "chain" \(it names left, right\)'):
            SelfCollision(chain, srdf=srdf)

    def test_no_shapes(self, chain):
        with pytest.raises(InputError, match='robot "chain" has no collision geometry'):
            SelfCollision(RobotGeometry(chain.robot, []))

    def test_obstacles(self, chain):
        near = Obstacle("post", Box((0.1, 0.1, 1.0)), translation(0.6, 0.6, 0.0), ignore=["cam", "a"], margin=0.05)
        far = Obstacle("ball", Sphere(0.1), translation(0.0, -1.0, 0.3))
        limit = ObstacleClearance(chain, [near, far], margin=0.01)
        assert limit.labels == ("b to post", "c to post", "a to ball", "b to ball", "c to ball")
        np.testing.assert_array_equal(limit.margins, [0.05, 0.05, 0.01, 0.01, 0.01])
        # The first rod, from (0.1, 0, 0) to (0.4, 0, 0) with a radius of 0.03, from the ball.
        distance = np.hypot(np.hypot(0.1, 1.0), 0.3) - 0.13
        assert limit.distances([[0.0, 1.0, 0.0, 0.0]])[0, 2] == pytest.approx(distance, abs=1e-6)

    def test_what_is_never_near_is_told_as_such(self, chain):
        """Beyond the horizon distances are not computed: no time is that of the smallest one."""
        limit = ObstacleClearance(chain, [Obstacle("ball", Sphere(0.1), translation(0.25, 0.0, 0.2))], margin=0.01)
        t = np.array([0.0, 1.0])
        q = np.array([[-np.pi / 2, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
        margins = {margin.label: margin for margin in margins_of([limit], t, (q, 0 * q, 0 * q))}
        assert limit.distances(q)[:, 1].min() > limit.horizon
        assert margins["b to ball"].beyond
        assert margins["b to ball"].cells == ("over 0.1", "-")
        assert str(margins["b to ball"]) == "obstacles, b to ball: keeps over 0.1"
        assert margins["a to ball"].cells == ("0.06", "1.000")

    def test_bad_obstacles(self, chain):
        ball = Obstacle("ball", Sphere(0.1), translation(2.0, 0.0, 0.0))
        with pytest.raises(InputError, match='two obstacles have the name "ball"'):
            ObstacleClearance(chain, [ball, ball])
        with pytest.raises(InputError, match='no link "hand"'):
            ObstacleClearance(chain, [Obstacle("ball", Sphere(0.1), ignore=["hand"])])
        with pytest.raises(
            InputError, match=r"obstacles: a to ball is violated by .* or more at each of 500 .*`ignore`"
        ):
            ObstacleClearance(chain, [Obstacle("ball", Sphere(0.3))])
        with pytest.raises(InputError, match='obstacle "ball": the margin must be 0 or more'):
            Obstacle("ball", Sphere(0.1), margin=-1.0)
        with pytest.raises(InputError, match="no moving link with collision geometry"):
            ObstacleClearance(chain.without(["a", "b", "c", "tool", "cam"]), [ball])


def test_table_watches_chosen_links(chain):
    q = np.zeros((1, 4))
    everything = TablePlane(chain, offset=-1.0)
    assert everything.labels == ("a", "b", "c")
    tool = TablePlane(chain, (0.0, 0.0, 2.0), -2.0, links=["tool"])
    assert tool.labels == ("c",)
    assert tool.clearance(q)[0, 0] == pytest.approx(1.0 - 0.04)
    assert TablePlane(chain, offset=-1.0, ignore=["a", "b"], margin=0.1).labels == ("c",)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"normal": (0.0, 0.0, 0.0)}, "the normal must be three finite numbers, not all 0"),
        ({"normal": (0.0, 1.0)}, "the normal must be three finite numbers"),
        ({"offset": np.nan}, "the offset must be a finite number, in m, got nan"),
        ({"margin": -1}, "the margin must be 0 or more"),
        ({"links": ["hand"]}, 'no link "hand"'),
        ({"links": ["wrist"]}, 'table plane: link "wrist" has no collision geometry; known are'),
        ({"links": ["base"]}, "no moving link of robot .* has collision geometry"),
        ({"ignore": ["hand"]}, 'no link "hand"'),
        (
            {"offset": 0.1},
            r"table plane: a is violated by 0.13 m or more at each of 500 random configurations .*`ignore`",
        ),
    ],
)
def test_bad_tables(chain, options, message):
    with pytest.raises(InputError, match=message):
        TablePlane(chain, **options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "open on all sides"),
        ({"lower": (1, 0, 0), "upper": (0, 1, 1)}, "the lower x of 1 m is above the upper one of 0 m"),
        ({"lower": (0, 0)}, r"lower must be three numbers in m, got \(0, 0\)"),
        ({"lower": "low"}, "lower must be three numbers in m, got 'low'"),
        ({"upper": (np.nan, 0, 0)}, "upper must be three numbers"),
        ({"upper": (1, 1, 1), "point": (0, np.inf, 0)}, "the point must be finite"),
        ({"lower": (5, 5, 5)}, "workspace: tool above x = 5 is violated by .*correct the box"),
        ({"link": "base", "upper": (1, 1, 1)}, 'link "base" is fixed to the base and does not move'),
        ({"link": "hand", "upper": (1, 1, 1)}, 'no link "hand"'),
    ],
)
def test_bad_boxes(chain, options, message):
    with pytest.raises(InputError, match=message):
        WorkspaceBox(chain.robot, **{"link": "tool", **options})


def test_wrong_shapes_of_arrays(chain):
    box = WorkspaceBox(chain.robot, "tool", (0, 0, 0), (2, 2, 2))
    with pytest.raises(InputError, match=r"workspace: configurations must have shape \(S, 4\), got shape \(5, 3\)"):
        box.clearance(np.zeros((5, 3)))
    with pytest.raises(InputError, match=r"workspace: weights must have shape \(5, 6\), got \(5, 2\)"):
        box.vjp(np.zeros((5, 4)), None, None, np.zeros((5, 2)))
    assert repr(box) == "WorkspaceBox(workspace: 6 clearances)"


def test_configurations_that_are_no_numbers_are_not_clear(chain):
    pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")
    q = np.zeros((3, 4))
    q[1, 2] = np.nan
    limits = [
        SelfCollision(chain),
        ObstacleClearance(chain, [Obstacle("ball", Sphere(0.1), translation(2.0, 0.0, 0.0))]),
        TablePlane(chain, offset=-1.0),
        WorkspaceBox(chain.robot, "tool", (0, 0, 0), (2, 2, 2)),
    ]
    for limit in limits:
        assert np.isnan(limit.clearance(q)[1]).all()
        assert np.isfinite(limit.clearance(q)[[0, 2]]).all()
    assert np.isnan(limits[0].distances(q)[1]).all()
