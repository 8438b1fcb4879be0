"""Curves: what they show, and that they show it without touching anyone's settings."""

import cv2
import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot
from support.run_folders import moving_scene

from gril_jax.errors import ShapeError
from gril_jax.report.curves import (
    learning_curve,
    pretrain_curve,
    reward_profile,
    spread,
    success_failure,
)
from gril_jax.report.style import pixels, png, shortened, styled

FRAMES, _ = moving_scene()
REWARD = np.linspace(-1, 0, len(FRAMES)).astype(np.float32)
ENDS = np.isin(np.arange(len(FRAMES)), [3, 5])


def picture(figure):
    """The PNG of a figure, decoded; it must hold more than its background."""
    image = cv2.imdecode(np.frombuffer(png(figure), np.uint8), cv2.IMREAD_COLOR)
    assert (image != 255).any(-1).mean() > 0.01
    return image


def texts(axes):
    return [text.get_text() for text in axes.texts]


def lines(axes):
    return {line.get_label(): line.get_xydata() for line in axes.lines}


def rows(count=6):
    return [
        {"env_steps": 1000 * i, "success": i / 10, "reward": -1 / i} for i in range(1, count + 1)
    ]


# --- a demonstration's profile


def test_a_profile_is_half_as_wide_as_the_page_and_not_blank():
    assert picture(reward_profile(REWARD, ENDS)).shape[1] == 736
    assert picture(reward_profile(REWARD, ENDS, frames=FRAMES)).shape[1] == 736


def test_a_profile_draws_the_reward_and_numbers_its_stage_ends():
    (axes,) = reward_profile(REWARD, ENDS, name="one", fps=8.0).axes
    np.testing.assert_allclose(axes.lines[0].get_ydata(), REWARD)
    np.testing.assert_array_equal(axes.lines[1].get_xdata(), [3, 5])
    assert texts(axes) == ["1", "2"]
    assert axes.get_xlabel() == "frame (8 a second)"


def test_a_strip_shows_the_first_frame_each_stage_end_and_the_last():
    figure = reward_profile(REWARD, ENDS, frames=FRAMES)
    shown = figure.axes[1:]
    titles = [axes.get_title() for axes in shown]
    assert titles == ["frame 0", "1: frame 3", "2: frame 5", "frame 7"]
    for axes, t in zip(shown, [0, 3, 5, 7], strict=True):
        np.testing.assert_array_equal(axes.images[0].get_array(), FRAMES[t])


def test_a_stage_that_ends_with_the_video_is_shown_once():
    last = np.arange(len(FRAMES)) == len(FRAMES) - 1
    figure = reward_profile(REWARD, last, frames=FRAMES)
    assert [axes.get_title() for axes in figure.axes[1:]] == ["frame 0", "1: frame 7"]


def test_many_stages_are_thinned_out_to_a_strip_of_seven():
    figure = reward_profile(np.zeros(40, np.float32), np.ones(40, bool), frames=FRAMES[[0] * 40])
    numbers = [int(axes.get_title().split()[-1]) for axes in figure.axes[1:]]
    assert len(numbers) == 7
    assert (numbers[0], numbers[-1]) == (0, 39)


def test_pictures_of_a_strip_stay_above_the_curve_and_inside_the_figure():
    figure = reward_profile(REWARD, ENDS, frames=FRAMES)
    curve, *strip = [axes.get_position() for axes in figure.axes]
    for place in strip:
        assert place.y0 > curve.y1
        assert min(place.x0, place.y0) >= 0
        assert max(place.x1, place.y1) <= 1


def test_one_frame_or_a_reward_that_is_not_a_number_can_be_drawn():
    picture(reward_profile(REWARD[:1], ENDS[:1], frames=FRAMES[:1]))
    picture(reward_profile(np.full(8, np.nan, np.float32), ENDS, frames=FRAMES))


def test_a_profile_and_a_video_of_different_lengths_are_refused():
    with pytest.raises(ShapeError, match="8 frames, but the reward is of 7"):
        reward_profile(REWARD[:7], ENDS[:7], frames=FRAMES)


# --- successes and failures


def test_successes_and_failures_share_their_axes():
    left, right = success_failure([REWARD, REWARD], [REWARD * 2 - 1]).axes
    assert left.get_ylim() == right.get_ylim()
    assert left.get_xlim() == right.get_xlim()
    assert (left.get_title("left"), right.get_title("left")) == ("2 successes", "1 failure")


def test_the_mean_holds_the_last_value_of_a_trace_that_has_ended():
    long, short = np.array([0, 1, 2, 3], np.float32), np.array([4, 6], np.float32)
    figure = success_failure([long, short], [long])
    mean = lines(figure.axes[0])["mean"][:, 1]
    np.testing.assert_allclose(mean, [(0 + 4) / 2, (1 + 6) / 2, (2 + 6) / 2, (3 + 6) / 2])
    picture(figure)


# --- policy training


def test_one_run_draws_its_rows_and_the_random_policy():
    left, right = learning_curve(rows(), random_success=0.07).axes
    drawn = lines(left)
    np.testing.assert_allclose(drawn["trained policy"][:, 1], 10 * np.arange(1, 7))
    np.testing.assert_allclose(drawn["random policy"][:, 1], 7)
    np.testing.assert_allclose(lines(right)["trained policy"][:, 1], -1 / np.arange(1, 7))


def test_rows_of_a_resumed_run_replace_earlier_ones_and_empty_ones_are_left_out():
    again = [
        *rows(3),
        {"env_steps": 2000, "success": 0.9, "reward": None},
        {"env_steps": 4000, "success": 0.0, "reward": -0.1, "episodes": 0},
    ]
    left, right = learning_curve(again).axes
    np.testing.assert_allclose(lines(left)["trained policy"][:, 1], [10, 90, 30])
    assert len(lines(right)["trained policy"]) == 4


@pytest.mark.parametrize(
    ("most", "label"),
    [(900, "environment steps"), (9e4, "thousand environ"), (9e6, "million environment steps")],
)
def test_steps_are_counted_in_a_unit_that_fits(most, label):
    figure = learning_curve([{"env_steps": most, "success": 0.5}])
    assert figure.axes[1].get_xlabel().startswith(label)


def test_no_rows_give_empty_axes():
    assert len(learning_curve([]).axes) == 2


# --- encoder training


def test_losses_are_drawn_by_their_names_on_a_logarithmic_axis():
    (axes,) = pretrain_curve(
        [
            {"step": i, "loss": 2 / i, "consistency": 2 / i, "reconstruction": None}
            for i in (1, 2, 4)
        ],
        {},
    ).axes
    assert list(lines(axes)) == ["total", "consistency in time"]
    np.testing.assert_allclose(lines(axes)["total"], [[1, 2], [2, 1], [4, 0.5]])
    assert axes.get_yscale() == "log"
    picture(axes.figure)


def test_the_parts_of_a_loss_add_up_to_it():
    rows = [
        {"step": i, "loss": 5.0 + i, "consistency": 1.0, "reconstruction": 0.5, "contrast": 0.1}
        for i in (1, 2)
    ]
    (axes,) = pretrain_curve(rows, {"reconstruction": 2.0, "contrast": 30.0}).axes
    found = {name: line[:, 1] for name, line in lines(axes).items()}
    total = found.pop("total")
    assert {*found} == {
        "consistency in time", "reconstruction", "perturbed frames", "times aligned directly"
    }  # fmt: skip
    np.testing.assert_allclose(sum(found.values()), total)


def test_a_loss_that_reaches_zero_has_a_linear_axis():
    (axes,) = pretrain_curve([{"step": 1, "loss": 0.0}, {"step": 2, "loss": 1.0}], {}).axes
    assert axes.get_yscale() == "linear"


def test_numbers_on_a_logarithmic_axis_are_plain():
    figure = pretrain_curve([{"step": i, "loss": 3 / i} for i in range(1, 50)], {})
    picture(figure)
    labels = [t.get_text() for t in figure.axes[0].get_yticklabels(which="both")]
    assert "$" not in "".join(labels)
    assert "0.1" in labels
    assert "0.5" in labels


# --- cases over seeds


def test_every_seed_is_a_dot_and_the_mean_a_bar():
    rows = {"one": np.array([0.1, 0.3]), "another $x": np.array([0.5, np.nan, 0.7])}
    (axes,) = spread(rows, "tau").axes
    dots, bar, more, other_bar, line = axes.get_lines()
    np.testing.assert_allclose(dots.get_xdata(), [0.1, 0.3])
    np.testing.assert_allclose(bar.get_xdata(), 0.2)
    np.testing.assert_allclose(more.get_xdata(), [0.5, 0.7])  # what is not finite is left out
    np.testing.assert_allclose(other_bar.get_xdata(), 0.6)
    np.testing.assert_allclose(line.get_xdata(), 0.2)  # the first case, to compare with
    assert [t.get_text() for t in axes.get_yticklabels()] == ["one", "another $x"]
    assert axes.get_ylim()[0] > axes.get_ylim()[1]  # the first case on top


def test_a_figure_grows_with_its_cases_and_is_drawn_even_without_a_finite_value():
    few, many = (spread({str(i): np.array([1.0]) for i in range(n)}, "x") for n in (2, 30))
    assert many.get_figheight() > few.get_figheight() + 5
    assert pixels(spread({"broken": np.array([np.nan])}, "x")).size


def test_nothing_to_draw_is_refused():
    with pytest.raises(ShapeError, match="must hold at least one case"):
        spread({}, "tau")


# --- the style


def test_equal_figures_give_equal_bytes():
    draw = [png(reward_profile(REWARD, ENDS, frames=FRAMES, name="one")) for _ in range(2)]
    assert draw[0] == draw[1]


def test_the_callers_settings_neither_matter_nor_change():
    plain = png(learning_curve(rows()))
    with matplotlib.rc_context({"figure.facecolor": "black", "font.size": 30}):
        assert png(learning_curve(rows())) == plain
        assert matplotlib.rcParams["font.size"] == 30
    assert pyplot.get_fignums() == []


def test_a_name_that_looks_like_mathematics_is_drawn_as_it_stands():
    figure = reward_profile(REWARD, ENDS, name=r"$\frac{$ ☃ 漢字 \ud800")
    picture(figure)


def test_settings_come_back_after_an_error():
    @styled
    def fails():
        raise ValueError("no")

    before = matplotlib.rcParams["font.size"]
    with matplotlib.rc_context({"font.size": 7.5}):
        with pytest.raises(ValueError, match="no"):
            fails()
        assert matplotlib.rcParams["font.size"] == 7.5
    assert matplotlib.rcParams["font.size"] == before


def test_pixels_are_those_of_the_png():
    figure = learning_curve(rows())
    np.testing.assert_array_equal(pixels(figure), picture(figure)[..., ::-1])


@pytest.mark.parametrize(
    ("name", "short"),
    [("a\n b\t c", "a b c"), ("x" * 60, "x" * 47 + "…"), ("\ud800\x00a", "a"), ("", "")],
)
def test_names_are_shortened_to_one_printable_line(name, short):
    assert shortened(name) == short
