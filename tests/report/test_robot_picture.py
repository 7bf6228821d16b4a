"""The drawing of the robot: where its parts are by closed forms, and the projection by points on the surface itself."""

import re
from dataclasses import replace

import lxml.html
import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.identification import Identification
from steelyard.report.drawing import Drawing, View
from steelyard.report.robot_picture import drawn_links, remarks_on_drawing, robot_picture, robot_svg
from steelyard.report.robot_scene import robot_scene
from steelyard.report.robot_section import robot

from .conftest import LENGTH, LINKS

Array = np.ndarray
VIEW = View(0.7, 0.4, np.array([0.1, -0.2, 0.3]), 250.0, 720.0, 560.0)


def seen(place: Array, view: View = VIEW) -> Array:
    """Pixels of a place by two turns: first about z, then about the axis that points to the right."""
    c, s = np.cos(view.azimuth), np.sin(view.azimuth)
    x, y, z = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ (place - view.center)
    c, s = np.cos(view.elevation), np.sin(view.elevation)
    return np.array([view.width / 2 + view.scale * y, view.height / 2 - view.scale * (c * z - s * x)])


def matrix(element: str) -> Array:
    found = re.search(r"matrix\(([^)]*)\)", element)
    assert found is not None
    a, b, c, d, e, f = (float(word) for word in found[1].split())
    return np.array([[a, c, e], [b, d, f]])


def test_a_place_is_seen_where_two_turns_put_it() -> None:
    places = np.random.default_rng(0).normal(size=(20, 3))
    np.testing.assert_allclose(VIEW.project(places), [seen(place) for place in places], atol=1e-9)


def test_the_outline_of_an_ellipsoid_holds_its_surface_and_touches_it() -> None:
    random = np.random.default_rng(1)
    radii, center = random.normal(scale=0.3, size=(3, 3)), random.normal(size=3)
    directions = random.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    surface = np.array([seen(center + direction @ radii) for direction in directions])
    shape = matrix(Drawing(VIEW).ball(center, radii, "ball"))
    # In the coordinates in which the outline is the unit circle.
    sizes = np.linalg.norm(np.linalg.solve(shape[:, :2], surface.T - shape[:, 2:]), axis=0)
    assert 0.99 < sizes.max() < 1.001


def test_numbers_at_one_place_lie_above_each_other() -> None:
    drawing = Drawing(VIEW)
    heights = [float(re.findall(r"translate\(\S+ (\S+)\)", drawing.label(np.zeros(3), str(k)))[0]) for k in range(3)]
    assert np.diff(heights).tolist() == pytest.approx([-13.0, -13.0])


def test_joints_and_ends_of_an_arm_with_a_slide() -> None:
    """One turn about z by a right angle, then a slide along x of the first link, then 0.4 m of the last."""
    rows = [(0, 0.5, 0, "q"), ("pi/2", 0, "q", 0), (0, 0.4, 0, "q")]
    first, second, third = robot_scene(sy.Robot.from_dh(rows), [np.pi / 2, 0.3, 0.0]).links
    assert [link.rotates for link in (first, second, third)] == [True, False, True]
    np.testing.assert_allclose(first.joint_origin, 0.0, atol=1e-12)
    np.testing.assert_allclose(second.joint_origin, [0, 0.5, 0], atol=1e-12)
    np.testing.assert_allclose(first.ends[0], second.joint_origin, atol=1e-12)
    np.testing.assert_allclose(third.joint_origin, [0, 0.5, 0.3], atol=1e-12)
    np.testing.assert_allclose(third.joint_frame[:, 2], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(third.ends[0], [0, 0.9, 0.3], atol=1e-12)


def test_centers_of_mass_are_where_the_parameters_say(identification: Identification) -> None:
    """The arm lies along x, gravity along -y, so that y is upwards in the picture."""
    page = lxml.html.fromstring(robot_svg(identification))
    parameters = identification.estimate.parameters
    assert parameters is not None
    found = dict(zip(identification.estimate.parameter_names, parameters.tolist(), strict=True))
    dots = page.xpath("//*[@class='drawn-answer']/g[@data-point]/@data-point")
    expected = []
    for number in (1, 2):
        x, y, z = (found[f"l{axis}{number}"] / found[f"m{number}"] for axis in "xyz")
        expected.append([LENGTH * (number - 1) + x, -z, y])  # y goes to z by the least turn
    drawn = np.array([[float(word) for word in dot.split()] for dot in dots])
    order = np.argsort(drawn[:, 0]) if expected[0][0] < expected[1][0] else np.argsort(-drawn[:, 0])
    np.testing.assert_allclose(drawn[order], expected, rtol=1e-4, atol=1e-5)


def test_elements_are_coloured_by_what_their_numbers_rest_on(identification: Identification) -> None:
    page = lxml.html.fromstring(robot_svg(identification))
    told = identification.parameters
    assert told is not None
    order = ("measured", "bounded", "assumed")
    for number, link in enumerate(told.links, start=1):
        (group,) = page.xpath(f"//*[@data-link='{number}'][title]")
        assert group.find("title").text.startswith(f"{number} {LINKS[number - 1]}: {link.mass.value:.3g} kg")
        (ball,) = group.xpath(".//*[starts-with(@class, 'ball ')]/@class")
        (outline,) = group.xpath(".//*[starts-with(@class, 'outline ')]/@class")
        assert ball == f"ball {link.mass.basis}"
        assert outline == f"outline {max((row.basis for row in link.moments), key=order.index)}"
        sure = [row for row in link.center if row.basis != "assumed"]
        assert len(group.xpath(".//line[starts-with(@class, 'interval-of-center')]")) == len(sure)


def with_cad(identification: Identification, *bodies: sy.Inertia) -> Identification:
    """The same result of a description with other inertias."""
    robot = identification.model.robot
    links = tuple(replace(link, inertia=body) for link, body in zip(robot.links, bodies, strict=True))
    return replace(identification, model=sy.Model(replace(robot, links=links)))


def test_cad_that_no_body_has_is_marked_and_named(identification: Identification) -> None:
    flat = sy.Inertia.from_com(1.0, (0.2, 0, 0), np.diag([0.01, 0.01, 0.05]))
    changed = with_cad(identification, flat, sy.Inertia.zero())
    page = lxml.html.fromstring(robot_svg(changed))
    impossible = page.xpath("//*[@class='drawn-cad impossible']")
    assert len(impossible) == 2
    assert len(page.xpath("//*[@class='cad']")) == 1  # of the one with a mass, flat
    said = remarks_on_drawing(drawn_links(changed), robot_scene(changed.model.robot))
    assert said == [
        f"CAD gives {LINKS[0]} moments of inertia that no body has, drawn flat.",
        f"CAD gives {LINKS[1]} no positive mass.",
    ]


def test_what_lies_far_away_is_named_and_leaves_the_scale(identification: Identification) -> None:
    near, far = (sy.Inertia.from_com(1.0, (x, 0, 0), np.diag([0.01, 0.01, 0.01])) for x in (0.2, 118.0))
    pictures = [lxml.html.fromstring(robot_svg(with_cad(identification, near, body))) for body in (near, far)]
    scales = [float(page.xpath("//@data-view")[0].split()[3]) for page in pictures]
    assert scales[0] == pytest.approx(scales[1], rel=0.5)
    changed = with_cad(identification, near, far)
    (said,) = remarks_on_drawing(drawn_links(changed), robot_scene(changed.model.robot))
    assert said.startswith(f"CAD's centre of mass of {LINKS[1]} lies 118 m from the middle of the robot")


def test_nothing_but_the_file_is_needed(identification: Identification, tmp_path) -> None:
    target = tmp_path / "robot.svg"
    robot_picture(identification, target, [0.3, -0.4])
    text = target.read_text()
    assert "<script" not in text
    assert "url(" not in text
    root = lxml.etree.fromstring(text.encode())
    assert root.get("width") == "720"
    assert text != robot_svg(identification)


def test_a_configuration_has_a_number_for_each_joint(identification: Identification) -> None:
    with pytest.raises(InputError, match=r"has 2 joints, so q must have the shape \(2,\), got \(3,\)"):
        robot_svg(identification, [0.0, 0.0, 0.0])


def test_an_answer_of_base_parameters_alone_shows_cad(identification: Identification) -> None:
    body = sy.Inertia.from_com(1.0, (0.2, 0, 0), np.diag([0.01, 0.01, 0.01]))
    alone = replace(identification.estimate, parameters=None)
    changed = replace(with_cad(identification, body, body), estimate=alone, parameters=None)
    page = lxml.html.fromstring(robot_svg(changed))
    assert not page.xpath("//*[@class='drawn-answer']")
    assert len(page.xpath("//*[@class='cad']")) == 2
    assert lxml.html.fromstring(str(robot(changed))).xpath("//*[@class='what']/text()") == ["CAD 1 kg"] * 2


@pytest.mark.parametrize("gravity", [(0, 0, 9.81), (0, 0, 0), (9.81, 0, 0)], ids=["ceiling", "space", "wall"])
def test_down_is_where_gravity_pulls(identification: Identification, gravity: tuple[float, float, float]) -> None:
    """However a robot is mounted, the picture has finite places, and gravity points downwards in it."""
    turned = replace(identification.model.robot, gravity=np.array(gravity, dtype=float))
    page = lxml.html.fromstring(robot_svg(replace(identification, model=sy.Model(turned))))
    places = [float(word) for text in page.xpath("//@data-line") for word in text.split()]
    assert np.isfinite(places).all()
    axes = {line.get("class")[-1]: line for line in page.xpath("//line[starts-with(@class, 'axis')]")}
    ends = {name: np.array(line.get("data-line").split(), dtype=float) for name, line in axes.items()}
    pull = sum(g * (ends[name][3:] - ends[name][:3]) for name, g in zip("xyz", gravity, strict=True))
    if any(gravity):
        np.testing.assert_allclose(pull[:2], 0.0, atol=1e-9)
        assert pull[2] < 0.0


def test_frames_in_one_place_have_a_scale(identification: Identification) -> None:
    scene = robot_scene(sy.Robot.from_dh([(0, 0, 0, "q"), ("pi/2", 0, 0, "q")]))
    assert scene.size == 0.5


def test_notebooks_show_the_drawing(identification: Identification) -> None:
    page = lxml.html.fromstring(f"<div>{identification._repr_html_()}</div>")
    (drawn,) = page.find_class("robot-drawing")
    assert drawn.xpath(".//*[@data-ball]")
    assert not page.xpath("//@id")  # so that two results may stand in one notebook
