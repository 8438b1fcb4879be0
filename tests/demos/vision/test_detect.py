"""Colour detection: synthetic scenes with known poses, and the human recordings."""

import math

import numpy as np
import pytest
from support import scenes
from support.scenes import BLOCKS, ROBOT, box_of, scene

from gril_jax.demos.demo import Tracks
from gril_jax.demos.magical_pickles import read_magical
from gril_jax.demos.vision.detect import PALETTE_CLASSES, ColourDetector
from gril_jax.demos.vision.palette import GREY, RGB, block_code, classify, goal_code
from gril_jax.demos.vision.shape_fit import (
    angle_of,
    expected_area,
    roundness_of,
    shape_outline,
    true_roundness,
)
from gril_jax.demos.vision.video import read_video, write_video
from gril_jax.errors import DemoError

MAGICAL = scenes.shared_data() / "magical"
needs_recordings = pytest.mark.skipif(
    not MAGICAL.is_dir(), reason=f"the human demonstrations are not in {MAGICAL}"
)
PIXEL = 2 * scenes.HALF_EXTENT / 384  # world units


def names_of(tracks: Tracks) -> list[str]:
    return [PALETTE_CLASSES[label] for label in tracks.label]


def column(tracks: Tracks, name: str) -> int:
    return names_of(tracks).index(name)


def detect(*frames, half_extent=scenes.HALF_EXTENT, **options) -> Tracks:
    return ColourDetector(half_extent=half_extent, **options).detect(np.stack(frames), name="v")


# ---- palette


@pytest.mark.parametrize("shift", [-6, 0, 6])
def test_every_palette_colour_is_recognised_some_levels_off(shift):
    for colour in ("green", "blue", "yellow", "red"):
        fill, outline, pale = scenes.COLOURS[colour]
        pixels = np.array([[fill, outline, pale]], int) + shift
        codes = classify(np.clip(pixels, 0, 255).astype(np.uint8))[0]
        assert codes.tolist() == [block_code(colour), block_code(colour), goal_code(colour)]
    greys = np.clip(np.array([RGB["grey"]]) + shift, 0, 255).astype(np.uint8)
    assert (classify(greys) == GREY).all()


def test_floor_outside_pupils_and_foreign_colours_are_nothing():
    pixels = [[(255, 255, 255), (231, 231, 234), (26, 26, 26), (255, 0, 255), (0, 90, 0)]]
    assert not classify(np.array(pixels, np.uint8)).any()


# ---- shapes


@pytest.mark.parametrize("shape", ["star", "square", "pentagon", "circle"])
def test_outlines_agree_with_the_specification(shape):
    corners = scenes.corners(shape)
    radius = np.linalg.norm(corners, axis=1).max()
    assert np.linalg.norm(shape_outline(shape), axis=1).max() == pytest.approx(radius, rel=2e-3)
    x, y = corners.T
    area = abs(sum(x[i - 1] * y[i] - x[i] * y[i - 1] for i in range(len(x)))) / 2
    assert expected_area(shape) == pytest.approx(area, rel=3e-3)


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.1])
def test_roundness_separates_the_shapes_at_any_angle(angle):
    for shape in ("star", "square", "pentagon", "circle"):
        mask = _mask_of(shape, angle)
        nearest = min(("star", "square", "pentagon", "circle"), key=lambda s: _off(mask, s))
        assert nearest == shape
        assert _off(mask, shape) < 0.05


def _mask_of(shape, angle):
    frame = scene({f"blue {shape}": (0.1, 0.2, angle)}, robot=None, smooth=True)
    return (classify(frame) == block_code("blue")).astype(np.uint8)


def _off(mask, shape):
    return abs(roundness_of(mask) - true_roundness(shape))


@pytest.mark.parametrize(("shape", "fold"), [("star", 5), ("square", 4), ("pentagon", 5)])
def test_moment_phase_turns_with_the_shape(shape, fold):
    period = 2 * math.pi / fold
    start = angle_of(_mask_of(shape, 0.0), shape)
    for angle in (0.1, 0.5, 0.9):
        turned = start - angle_of(_mask_of(shape, angle), shape)  # image y is down
        assert abs((turned - angle + period / 2) % period - period / 2) < 0.03


# ---- one frame


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("half_extent", [1.02, 1.122])
def test_default_scene_is_found_to_a_fraction_of_a_pixel(smooth, half_extent):
    tracks = detect(scene(smooth=smooth, half_extent=half_extent), half_extent=half_extent)
    assert names_of(tracks) == ["goal", "robot", *BLOCKS]
    for name, pose in BLOCKS.items():
        i = column(tracks, name)
        assert np.abs(tracks.center[0, i] - pose[:2]).max() < 0.3 * PIXEL
        # Drawing without smoothing fills every pixel that an edge touches.
        limit = 0.5 * PIXEL if smooth else 2.5 * PIXEL
        assert np.abs(tracks.size[0, i] - box_of(name, pose)).max() < limit
    assert np.abs(tracks.center[0, 0] - scenes.GOAL[0]).max() < 0.5 * PIXEL
    assert np.abs(tracks.size[0, 0] - scenes.GOAL[1]).max() < PIXEL
    assert np.abs(tracks.center[0, 1] - ROBOT[:2]).max() < 0.3 * PIXEL
    np.testing.assert_allclose(tracks.size[0, 1], 0.4, atol=1e-6)
    assert tracks.seen.all()
    assert tracks.center.dtype == tracks.size.dtype == np.float32
    assert tracks.label.dtype == np.int32


def test_world_y_is_up_and_a_larger_frame_means_the_same_world():
    small = detect(scene({"red star": (0.9, -0.9, 0.3)}, smooth=True))
    large = detect(scene({"red star": (0.9, -0.9, 0.3)}, smooth=True, side=768))
    i = column(small, "red star")
    np.testing.assert_allclose(small.center[0, i], [0.9, -0.9], atol=0.3 * PIXEL)
    np.testing.assert_allclose(small.center, large.center, atol=0.5 * PIXEL)


def test_a_wide_frame_has_its_origin_in_the_middle():
    frame = scene(smooth=True)
    wide = np.pad(frame, ((0, 0), (64, 64), (0, 0)), mode="edge")
    tracks = detect(wide, half_extent=scenes.HALF_EXTENT * 512 / 384)
    square = detect(frame)
    np.testing.assert_allclose(tracks.center, square.center, atol=1e-3)


@pytest.mark.parametrize("colour", ["green", "blue", "yellow", "red"])
def test_every_shape_is_named_in_every_colour_and_a_goal_is_found_in_it(colour):
    places = [(-0.7, -0.7), (-0.7, 0.7), (0.8, -0.7), (-0.1, -0.2)]
    blocks = {
        f"{colour} {shape}": (*place, 0.4)
        for shape, place in zip(("star", "square", "pentagon", "circle"), places, strict=True)
    }
    tracks = detect(scene(blocks, goal_colour=colour))
    assert names_of(tracks) == ["goal", "robot", *blocks]
    for name, pose in blocks.items():
        assert np.abs(tracks.center[0, column(tracks, name)] - pose[:2]).max() < 0.5 * PIXEL
    assert np.abs(tracks.size[0, 0] - scenes.GOAL[1]).max() < PIXEL


@pytest.mark.parametrize(("width", "angle"), [(0.3, 2.5), (0.6, 0.2), (1.6, 0.4), (0.6, 0.0)])
def test_sticks_are_robots_too(width, angle):
    pose = (-0.1, -0.35, angle) if width < 1 else (0.0, 0.1, angle)
    blocks = {} if width > 1 else {"green star": BLOCKS["green star"]}
    tracks = detect(scene(blocks, pose, stick=width))
    i = column(tracks, "robot")
    box = np.abs(
        [
            [width * math.cos(angle), 0.1 * math.sin(angle)],
            [width * math.sin(angle), 0.1 * math.cos(angle)],
        ]
    ).sum(1)
    assert np.abs(tracks.center[0, i] - pose[:2]).max() < 0.5 * PIXEL
    assert np.abs(tracks.size[0, i] - box).max() < 3 * PIXEL
    assert np.abs(tracks.size[0, 0] - scenes.GOAL[1]).max() < 1.5 * PIXEL


def test_robot_at_the_wall_is_not_pulled_by_the_grey_outline():
    pose = (-0.895, 0.3, 0.2)
    tracks = detect(scene({}, pose))
    assert np.abs(tracks.center[0, column(tracks, "robot")] - pose[:2]).max() < 0.5 * PIXEL


# ---- the goal's dashes, and blocks that touch


@pytest.mark.parametrize("place", [(0.1, 0.35), (0.7, 0.1), (0.1, 0.7), (0.25, -0.02), (0.8, 0.4)])
@pytest.mark.parametrize("name", ["green star", "green square"])
def test_dashes_shift_a_block_by_less_than_a_pixel(place, name):
    away = scene({name: (-0.5, -0.5, 0.7)}, smooth=True)
    there = scene({name: (*place, 0.7)}, smooth=True)
    tracks = detect(away, away, there)
    i = column(tracks, name)
    assert tracks.seen.all()
    assert np.abs(tracks.center[2, i] - place).max() < 0.7 * PIXEL
    assert np.abs(tracks.size[2, i] - box_of(name, (*place, 0.7))).max() < 1.2 * PIXEL


def test_blocks_on_the_goal_do_not_change_its_box():
    blocks = {"green star": (0.12, 0.68, 0.3), "green square": (0.66, 0.05, 0.2)}
    empty, covered = detect(scene(blocks={})), detect(scene(blocks))
    np.testing.assert_allclose(empty.center[0, 0], covered.center[0, 0], atol=PIXEL)
    np.testing.assert_allclose(empty.size[0, 0], covered.size[0, 0], atol=1.5 * PIXEL)


@pytest.mark.parametrize("outlines", [True, False])
@pytest.mark.parametrize(
    ("first", "second", "angles", "gap"),
    [
        ("green star", "green square", (0.0, 0.0), 0.225),
        ("green star", "green square", (0.6, 0.3), 0.24),
        ("yellow circle", "yellow pentagon", (0.0, 0.2), 0.24),
        ("green square", "green square#2", (0.0, 0.0), 0.212),
    ],
)
def test_touching_blocks_of_one_colour_keep_identity_and_place(
    first, second, angles, gap, outlines
):
    def frame(distance):
        middle = (0.35, 0.3)
        poses = {
            first: (middle[0] - distance / 2, middle[1], angles[0]),
            second: (middle[0] + distance / 2, middle[1], angles[1]),
        }
        return scene(poses, smooth=True, outlines=outlines), poses

    steps = [*np.linspace(0.5, gap, 6), gap, gap, gap]
    frames, poses = zip(*map(frame, steps), strict=True)
    kinds = [first, second.split("#")[0]]
    tracks = detect(*frames, objects=["goal", "robot", *kinds])
    assert tracks.seen.all()
    # The first stands on the left, so one column order fits all frames of a kept identity.
    blocks = [i for i, name in enumerate(names_of(tracks)) if name in kinds]
    blocks.sort(key=lambda i: tracks.center[0, i, 0])
    assert [names_of(tracks)[i] for i in blocks] == kinds
    expected = np.array([[pose[:2] for pose in p.values()] for p in poses])
    assert np.abs(tracks.center[:, blocks] - expected).max() < 0.01


def test_touching_blocks_are_told_apart_without_any_earlier_frame():
    poses = {"green star": (0.3, 0.3, 0.0), "green square": (0.52, 0.3, 0.1)}
    frame = scene(poses, smooth=True)
    tracks = detect(frame, objects=["robot", "goal", "green square", "green star"])
    assert names_of(tracks) == ["goal", "robot", *poses]
    for name, pose in poses.items():
        assert np.abs(tracks.center[0, column(tracks, name)] - pose[:2]).max() < 0.01


def test_blocks_that_pass_each_other_fast_keep_their_names():
    def frame(t):
        return scene(
            {
                "yellow circle": (-0.6 + 0.2 * t, -0.5, 0),
                "yellow pentagon": (0.6 - 0.2 * t, -0.8, 0.1 * t),
            }
        )

    tracks = detect(*map(frame, range(7)))
    for t in range(7):
        circle, pentagon = (
            tracks.center[t, column(tracks, n)] for n in ("yellow circle", "yellow pentagon")
        )
        assert np.abs(circle - [-0.6 + 0.2 * t, -0.5]).max() < 0.01
        assert np.abs(pentagon - [0.6 - 0.2 * t, -0.8]).max() < 0.01


# ---- videos


def test_hidden_blocks_keep_their_last_box_and_late_ones_their_first():
    both = dict(BLOCKS)
    without = {n: p for n, p in BLOCKS.items() if n != "blue pentagon"}
    frames = [scene(without), scene(both), scene(both), scene(without)]
    tracks = detect(*frames)
    i = column(tracks, "blue pentagon")
    assert tracks.seen[:, i].tolist() == [False, True, True, False]
    assert (tracks.center[:, i] == tracks.center[1, i]).all()
    assert np.delete(tracks.seen, i, axis=1).all()


def test_what_rests_is_constant_and_what_moves_is_followed_within_a_third_of_a_pixel():
    rng = np.random.default_rng(0)
    frames, truth = [], []
    for t in range(12):
        x = -0.05 + 0.03 * min(t, 6)
        frame = scene({**BLOCKS, "blue pentagon": (x, -0.2, 0.0)}, smooth=True).astype(int)
        frames.append(np.clip(frame + rng.integers(-3, 4, frame.shape), 0, 255).astype(np.uint8))
        truth.append(x)
    tracks = detect(*frames)
    assert (tracks.center[:, column(tracks, "green star")] == tracks.center[0, 2]).all()
    error = tracks.center[:, column(tracks, "blue pentagon"), 0] - truth
    assert np.abs(error).max() < 0.6 * PIXEL


@pytest.mark.parametrize(
    ("frames", "objects", "words"),
    [
        (scene()[None], ["goal", "robot", "red star"], r"^v: the object 'red star' is not to be"),
        (scene(robot=None)[None], None, "the object 'robot' is not to be seen"),
        (scene(goal=None)[None], None, r"^v: no goal region was found"),
        (np.zeros((0, 8, 8, 3), np.uint8), None, "holds no frames"),
        (scene()[None], ["green banana"], "'green banana' is not one of the classes"),
    ],
)
def test_what_a_video_lacks_is_named(frames, objects, words):
    with pytest.raises(DemoError, match=words):
        ColourDetector(half_extent=scenes.HALF_EXTENT, objects=objects).detect(frames, name="v")


def test_labels_index_the_callers_vocabulary_and_unlisted_blocks_are_left_out():
    classes = ("robot", "blue pentagon", "goal")
    tracks = ColourDetector(classes, 1.122).detect(scene()[None])
    assert tracks.label.tolist() == [0, 1, 2]
    np.testing.assert_allclose(tracks.center[0, 1], [-0.05, -0.2], atol=PIXEL)


# ---- human recordings


@needs_recordings
@pytest.mark.parametrize("number", [4, 9, 16])
def test_recordings_agree_with_the_replayed_simulation_early_and_succeed_in_the_end(number):
    frames = read_magical(MAGICAL / f"demo-MatchRegions-Demo-v0-{number:03d}.pkl.gz").frames
    tracks = ColourDetector(half_extent=1.02).detect(frames)
    order = ["robot", "green star", "green square", "blue pentagon"]
    order += ["yellow circle", "yellow pentagon"]
    assert sorted(names_of(tracks)) == sorted(["goal", *order])
    assert tracks.seen.all()
    with np.load(MAGICAL / "replayed_states.npz") as states:
        truth = states[f"{number:03d}"][:25, :, :2]
    found = tracks.center[:25, [column(tracks, name) for name in order]]
    assert np.linalg.norm(found - truth, axis=-1).mean(axis=0).max() < 0.003
    np.testing.assert_allclose(tracks.size[:, 0], [[0.6, 0.7]] * len(frames), atol=0.0053)
    for name in ("green star", "green square"):
        x, y = tracks.center[-1, column(tracks, name)]
        assert 0.1 <= x <= 0.7
        assert 0.0 <= y <= 0.7


@needs_recordings
def test_compression_moves_centres_by_less_than_a_pixel_and_nothing_at_rest(tmp_path):
    frames = read_magical(MAGICAL / "demo-MatchRegions-Demo-v0-009.pkl.gz").frames
    write_video(tmp_path / "a.mp4", frames, 8.0)
    detector = ColourDetector(half_extent=1.02)
    exact = detector.detect(frames).center
    coded = detector.detect(read_video(tmp_path / "a.mp4")).center
    assert np.linalg.norm(exact - coded, axis=-1).max() < 0.003
    pixels = 384 / 2.04
    for i in range(exact.shape[1]):
        for t in range(len(exact) - 40):
            if (exact[t : t + 41, i] == exact[t, i]).all():
                drift = np.linalg.norm(coded[t : t + 41, i] - coded[t, i], axis=-1).max()
                assert drift * pixels < 0.35
