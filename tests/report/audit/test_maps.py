"""Pictures of an audit."""

import numpy as np
from matplotlib.patches import Rectangle

from gril_jax.report.audit.maps import Situation, View, reward_maps, state_pictures
from gril_jax.report.figures.style import png

CENTER = np.array([[0.5, 0.5], [-0.5, 0.0], [0.0, -0.5]])
SIZE = np.array([[0.6, 0.8], [0.2, 0.2], [0.4, 0.2]])
ACTIVE = np.array([False, True, False])
NAMES = ("goal", "shoe A", "shoe B")


def _view(title):
    return View(title, CENTER, SIZE, ACTIVE)


def test_a_map_shows_every_place_of_the_objects_centre_in_one_scale():
    reward = np.arange(18.0).reshape(2, 3, 3)
    situations = [Situation(_view("at the start"), reward), Situation(_view("later"), reward + 9)]
    figure = reward_maps(situations, NAMES, (1, 2), half_extent=1.0)
    maps = [axes for axes in figure.axes if axes.get_images()]
    assert [axes.get_title("left") for axes in maps] == ["shoe A", "shoe B"] * 2
    assert [axes.get_ylabel() for axes in maps] == ["at the start", "", "later", ""]
    image = maps[1].get_images()[0]
    np.testing.assert_allclose(image.get_extent(), [-0.8, 0.8, -0.9, 0.9])  # less its own box
    assert image.origin == "lower"
    np.testing.assert_array_equal(image.get_array(), reward[1])
    assert {axes.get_images()[0].get_clim() for axes in maps} == {(0.0, 26.0)}
    boxes = [p for p in maps[0].patches if isinstance(p, Rectangle)]
    corners = [p.get_xy() for p in boxes]
    np.testing.assert_allclose(corners, [(0.2, 0.1), (-0.2, -0.6)])  # not its own
    assert png(figure).startswith(b"\x89PNG")


def test_many_objects_take_several_rows():
    reward = np.zeros((8, 2, 2))
    figure = reward_maps([Situation(_view(""), reward)], NAMES, [1] * 8, half_extent=1.0)
    assert sum(axes.get_visible() and bool(axes.get_images()) for axes in figure.axes) == 8


def test_boxes_of_a_state_look_different_however_many_there_are():
    crowd = View("", np.zeros((12, 2)), np.ones((12, 2)), np.zeros(12, bool))
    figure = state_pictures([crowd], [f"block {i}" for i in range(12)], half_extent=1.0)
    looks = {(p.get_edgecolor(), p.get_linestyle()) for p in figure.axes[0].patches}
    assert len(looks) == 12


def test_a_state_has_thick_boxes_where_bits_are_set():
    figure = state_pictures([_view("before"), _view("after")], NAMES, half_extent=1.0)
    assert [axes.get_title("left") for axes in figure.axes] == ["before", "after"]
    widths = [p.get_linewidth() for p in figure.axes[0].patches]
    assert widths[1] > widths[0] == widths[2]
    assert [t.get_text() for t in figure.legends[0].get_texts()] == list(NAMES)
