"""Pictures made of frames: boxes stand where objects are, the curve grows with the frames."""

import itertools

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from support.run_folders import OBJECTS, moving_scene
from support.scenes import HALF_EXTENT

from gril_jax.demos.vision.detect import PALETTE_CLASSES
from gril_jax.errors import ShapeError
from gril_jax.report.figures.filmstrip import Film, beside_reward, contact_sheet, with_boxes
from gril_jax.report.figures.style import COLOURS, pixels

FRAMES, TRACKS = moving_scene(side=192)
MOVED = np.zeros((len(FRAMES), len(OBJECTS)), bool)
MOVED[4:, OBJECTS.index("green star")] = True
BLUE, RED = (np.array([round(255 * part) for part in to_rgb(c)]) for c in COLOURS[:2])


def film(frames=FRAMES, active=None, name="one"):
    return Film(name, frames, TRACKS, active)


def boxes(*args, **kwargs):
    return np.stack(list(with_boxes(film(*args, **kwargs), PALETTE_CLASSES, HALF_EXTENT)))


def near(image, colour, tolerance=60):
    return np.abs(image.astype(int) - colour).sum(-1) < tolerance


# --- boxes


def test_a_box_encloses_its_object_and_nothing_else_is_painted():
    blank = np.full_like(FRAMES, 255)
    image = boxes(blank)[0][:192, :192]
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
    still, moved = near(boxes()[5], BLUE).sum(), near(boxes(active=MOVED)[5], BLUE).sum()
    assert moved > 1.4 * still


def test_the_list_changes_where_an_object_has_moved():
    idle, active = boxes(), boxes(active=MOVED)
    panel = np.s_[:, :-20, 192:]  # without the progress bar
    np.testing.assert_array_equal(idle[panel][:4], active[panel][:4])
    assert (idle[panel][4:] != active[panel][4:]).any()


def test_frames_of_the_caller_are_left_alone():
    before = FRAMES.copy()
    boxes(active=MOVED)
    np.testing.assert_array_equal(FRAMES, before)


@pytest.mark.parametrize("side", [64, 97, 230])
def test_frames_of_any_size_come_out_with_even_sides(side):
    frames, tracks = moving_scene(2, side)
    for video in (
        with_boxes(Film("one", frames, tracks), PALETTE_CLASSES, HALF_EXTENT),
        beside_reward(frames, np.array([0.0, 1.0])),
    ):
        shapes = {frame.shape for frame in video}
        ((height, width, _),) = shapes
        assert height == side + side % 2
        assert width % 2 == 0


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


# --- beside the reward


def beside(reward, frames=FRAMES, **kwargs):
    return np.stack(list(beside_reward(frames, reward, **kwargs)))


def test_the_frames_stand_on_the_left_unchanged():
    video = beside(np.linspace(-1, 0, 8))
    np.testing.assert_array_equal(video[:, :192, :192], FRAMES)


def test_the_curve_grows_and_keeps_what_it_has_drawn():
    panels = beside(np.linspace(-1, 0, 8))[:, :, 192:]
    blue = [near(panel, BLUE, 30) for panel in panels]
    counts = [mask.sum() for mask in blue]
    assert counts[0] == 0
    assert all(a < b for a, b in itertools.pairwise(counts))


def test_the_dot_rises_with_the_reward_and_moves_to_the_right():
    panels = beside(np.linspace(-1, 0, 8))[:, :, 192:]
    middles = np.array([np.argwhere(near(panel, RED, 30)).mean(0) for panel in panels])
    assert (np.diff(middles[:, 0]) < 0).all()
    assert (np.diff(middles[:, 1]) > 0).all()


def test_a_reward_of_each_step_begins_with_the_second_frame():
    panels = beside(np.linspace(-1, 0, 7))[:, :, 192:]
    assert not near(panels[0], RED, 30).any()
    assert near(panels[1], RED, 30).any()


def test_a_reward_that_is_not_finite_leaves_a_gap():
    reward = np.linspace(-1, 0, 8)
    reward[3] = np.nan
    panels = beside(reward)[:, :, 192:]
    assert not near(panels[3], RED, 30).any()
    assert near(panels[4], RED, 30).any()
    assert beside(np.full(8, np.nan)).shape == beside(reward).shape


def test_a_constant_reward_and_a_single_frame_can_be_drawn():
    assert len(beside(np.zeros(8))) == 8
    assert len(beside(np.zeros(1), FRAMES[:1])) == 1


def test_rewards_that_do_not_fit_the_frames_are_refused_at_once():
    with pytest.raises(ShapeError, match="5 values for 8 frames"):
        beside_reward(FRAMES, np.zeros(5))


def test_an_episode_is_drawn_a_frame_a_moment():
    frames = np.repeat(moving_scene(1, 384)[0], 121, axis=0)
    assert sum(1 for _ in beside_reward(frames, np.linspace(-1, 0, 120))) == 121
