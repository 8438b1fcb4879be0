"""Frames with boxes: boxes stand where objects are, and thick ones where something has moved."""

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from support.run_folders import OBJECTS, moving_scene
from support.scenes import HALF_EXTENT

from gril_jax.demos.vision.detect import PALETTE_CLASSES
from gril_jax.report import filmstrip
from gril_jax.report.filmstrip import Film, contact_sheet
from gril_jax.report.style import COLOURS, pixels

FRAMES, TRACKS = moving_scene(side=192)
MOVED = np.zeros((len(FRAMES), len(OBJECTS)), bool)
MOVED[4:, OBJECTS.index("green star")] = True
BLUE = np.array([round(255 * part) for part in to_rgb(COLOURS[0])])


def film(frames=FRAMES, active=None, name="one"):
    return Film(name, frames, TRACKS, active)


def boxed(t, *args, **kwargs):
    one = film(*args, **kwargs)
    shown = filmstrip._classes_shown([one])
    return filmstrip._boxed(one, t, PALETTE_CLASSES, HALF_EXTENT, shown)


def near(image, colour, tolerance=60):
    return np.abs(image.astype(int) - colour).sum(-1) < tolerance


# --- boxes


def test_a_box_encloses_its_object_and_nothing_else_is_painted():
    blank = np.full_like(FRAMES, 255)
    image = boxed(0, blank)
    star = OBJECTS.index("green star")
    scale = 192 / (2 * HALF_EXTENT)
    middle = 95.5 + TRACKS.center[0, star] * scale * [1, -1]
    half = TRACKS.size[0, star] * scale / 2
    ys, xs = np.nonzero(near(image, BLUE))  # the first class beside goal and robot is blue
    assert xs.min() == pytest.approx(middle[0] - half[0], abs=1.6)
    assert xs.max() == pytest.approx(middle[0] + half[0], abs=1.6)
    assert ys.max() == pytest.approx(middle[1] + half[1], abs=1.6)
    inner = image[round(middle[1]) - 4 : round(middle[1]) + 4, round(middle[0]) :][:, :4]
    assert (inner == 255).all()


def test_the_box_of_an_object_that_has_moved_is_thicker():
    still, moved = near(boxed(5), BLUE).sum(), near(boxed(5, active=MOVED), BLUE).sum()
    assert moved > 1.4 * still


def test_frames_of_the_caller_are_left_alone():
    before = FRAMES.copy()
    boxed(5, active=MOVED)
    np.testing.assert_array_equal(FRAMES, before)


# --- the contact sheet


def test_a_contact_sheet_has_four_frames_a_demonstration_and_names_its_classes():
    figure = contact_sheet([film(), film(name="two")], PALETTE_CLASSES, HALF_EXTENT)
    titles = [axes.get_title("left") for axes in figure.axes]
    assert titles == ["frame 0", "frame 2", "frame 5", "frame 7"] * 2
    assert [text.get_text() for text in figure.texts] == ["one", "two"]
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    ordered = sorted(OBJECTS, key=PALETTE_CLASSES.index)
    assert labels == [f"{n}  {name}" for n, name in enumerate(ordered)]


def test_a_contact_sheet_is_half_as_wide_as_the_page_and_grows_with_its_demonstrations():
    one, two = (pixels(contact_sheet([film()] * n, PALETTE_CLASSES, HALF_EXTENT)) for n in (1, 2))
    assert one.shape[1] == two.shape[1] == 736
    assert two.shape[0] > one.shape[0] + 250
    assert (one != 255).mean() > 0.05


def test_two_objects_of_one_class_share_a_number_and_a_colour():
    twins = TRACKS._replace(label=np.full_like(TRACKS.label, 2))
    figure = contact_sheet([Film("one", FRAMES, twins)], PALETTE_CLASSES, HALF_EXTENT)
    assert [t.get_text() for t in figure.legends[0].get_texts()] == [f"0  {PALETTE_CLASSES[2]}"]
