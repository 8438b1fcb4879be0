"""Objects found by their fills: in drawn scenes, and in human videos of MAGICAL's other tasks."""

import cv2
import numpy as np
import pytest
from support.paths import SHARED_DATA

from gril_jax.demos.vision.fills import FillDetector
from gril_jax.demos.vision.palette import RGB, SUITE, SUITE_CLASSES
from gril_jax.demos.vision.shape_fit import shape_outline
from gril_jax.demos.vision.video import read_video
from gril_jax.errors import DemoError

EXTENT, PIXELS = 1.02, 384
SCALE = PIXELS / (2 * EXTENT)


def _pixels(points):
    return (
        np.stack([(points[..., 0] + EXTENT) * SCALE, (EXTENT - points[..., 1]) * SCALE], -1) - 0.5
    )


def _frame(blocks, *, robot=(-0.7, -0.7), region=None):
    """A picture with blocks (colour, shape, x, y, angle), painted fill over outline."""
    frame = np.full((PIXELS, PIXELS, 3), 255, np.uint8)
    if region is not None:
        colour, x, y, width, height = region
        corners = np.array([[x - width / 2, y - height / 2], [x + width / 2, y + height / 2]])
        low, high = np.sort(_pixels(corners), axis=0).round().astype(int)
        pale = tuple((255 + value) // 2 for value in RGB[colour][0])
        cv2.rectangle(frame, low.tolist(), high.tolist(), pale, -1)
    for colour, shape, x, y, angle in blocks:
        cos, sin = np.cos(angle), np.sin(angle)
        outline = shape_outline(shape) @ np.array([[cos, sin], [-sin, cos]])
        for part, share in ((1, 1.0), (0, 0.87)):
            corners = _pixels(np.array([x, y]) + share * outline)
            cv2.fillPoly(frame, [(16 * corners).round().astype(np.int32)], RGB[colour][part],
                         shift=4)  # fmt: skip
    middle = (16 * _pixels(np.array(robot))).round().astype(int).tolist()
    cv2.circle(frame, middle, int(16 * 0.2 * SCALE), RGB["grey"][1], -1, shift=4)
    return frame


def _names(tracks):
    return [SUITE_CLASSES[label] for label in tracks.label]


@pytest.mark.parametrize("shape", ["star", "square", "pentagon", "circle"])
def test_a_shape_is_read_from_a_picture_that_compression_has_frayed(shape):
    frames = []
    for angle in np.linspace(0, 1.4, 5):
        frame = _frame([("yellow", shape, 0.1 + angle / 9, 0.2, angle)])
        frayed = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, 12])[1]
        frames.append(cv2.imdecode(frayed, cv2.IMREAD_COLOR))
    found = FillDetector().detect(np.stack(frames))
    assert _names(found) == ["robot", f"yellow {shape}"]


def test_twins_that_touch_and_pass_each_other_stay_who_they_are():
    times = np.linspace(0, 1, 30)
    left = np.stack([-0.4 + 0.9 * times, 0.13 + 0 * times], 1)
    right = np.stack([0.4 - 0.9 * times, -0.13 + 0 * times], 1)
    frames = np.stack([
        _frame([("red", "circle", *a, 0.0), ("red", "circle", *b, 0.0)])
        for a, b in zip(left, right, strict=True)
    ])  # fmt: skip
    found = FillDetector().detect(frames)
    assert _names(found) == ["robot", "red circle", "red circle"]
    assert found.seen.all()
    np.testing.assert_allclose(found.center[:, 1], left, atol=0.006)
    np.testing.assert_allclose(found.center[:, 2], right, atol=0.006)
    np.testing.assert_allclose(found.size[:, 1:], 0.24, atol=0.002)


def test_shapes_angles_and_regions_are_read():
    blocks = [
        ("green", "star", -0.5, 0.5, 0.3), ("green", "square", 0.5, 0.5, 0.5),
        ("blue", "pentagon", 0.0, 0.0, -0.7), ("yellow", "circle", 0.6, -0.3, 0.0),
    ]  # fmt: skip
    frame = _frame(blocks, region=("blue", 0.3, -0.6, 0.5, 0.4))
    found = FillDetector().detect(np.stack([frame, frame]))
    assert _names(found) == [
        "robot", "blue region", "green star", "green square", "blue pentagon", "yellow circle"
    ]  # fmt: skip
    np.testing.assert_allclose(found.center[0, 1], [0.3, -0.6], atol=0.006)
    np.testing.assert_allclose(found.size[0, 1], [0.5, 0.4], atol=0.012)
    for place, (_, _, x, y, _) in zip(found.center[0, 2:], blocks, strict=True):
        np.testing.assert_allclose(place, [x, y], atol=0.006)
    for size, (_, shape, _, _, angle) in zip(found.size[0, 2:], blocks, strict=True):
        cos, sin = np.cos(angle), np.sin(angle)
        turned = shape_outline(shape) @ np.array([[cos, sin], [-sin, cos]])
        np.testing.assert_allclose(size, np.ptp(turned, axis=0), atol=0.01)


def test_a_block_that_is_lost_for_a_moment_keeps_its_box():
    frames = np.stack([_frame([("red", "square", 0.02 * t, 0.0, 0.0)]) for t in range(9)])
    frames[4] = _frame([])
    found = FillDetector().detect(frames)
    assert found.seen[:, 1].tolist() == [True] * 4 + [False] + [True] * 4
    np.testing.assert_array_equal(found.center[4, 1], found.center[3, 1])


def test_what_is_no_film_of_these_tasks_is_refused_in_a_sentence():
    red = ("red", "square", 0.0, 0.0, 0.0)
    changing = [_frame([red] if t % 3 == 0 else [red, ("red", "circle", 0.5, 0.1 * t, 0.0)] if t % 3
                       == 1 else []) for t in range(9)]  # fmt: skip
    with pytest.raises(DemoError, match="film: the number of red blocks changes"):
        FillDetector().detect(np.stack(changing), name="film")
    with pytest.raises(DemoError, match="film: no robot is to be seen in any of 2 frames"):
        FillDetector().detect(np.full((2, 64, 64, 3), 255, np.uint8), name="film")
    with pytest.raises(DemoError, match="film: the video holds no frames"):
        FillDetector().detect(np.zeros((0, 64, 64, 3), np.uint8), name="film")


# Where the Demo variants begin, from the benchmark's source: robot, regions, blocks.
BEGIN = {
    "move_to_corner": [(0.4, 0.0), (0.1, -0.65)],
    "move_to_region": [(0.058, 0.53), (-0.245, -0.55)],
    "find_dupe": [
        (-0.57, 0.25), (-0.36, -0.555), (-0.0668, 0.7552), (0.4525, 0.3681), (0.4059, -0.7498),
        (-0.33, -0.49), (0.7685, -0.1065), (-0.052, 0.3147), (0.5753, -0.4687),
    ],
    "fix_colour": [
        (0.368, 0.586), (0.202, 0.1345), (0.248, -0.621), (-0.472, -0.053), (0.133, -0.561),
        (0.289, 0.03), (-0.336, 0.0),
    ],
    "cluster_colour": [
        (0.7169, -0.3437), (-0.0774, -0.4296), (0.5198, 0.1853), (-0.1347, -0.7141),
        (-0.7425, -0.0976), (-0.5147, 0.1415), (-0.5404, 0.4829), (-0.1676, 0.643),
        (-0.5278, -0.2164),
    ],
    "cluster_shape": [
        (0.286, -0.202), (0.758, -0.708), (0.867, -0.149), (-0.305, -0.226), (0.068, 0.705),
        (-0.785, -0.14), (-0.414, 0.297), (-0.461, -0.749), (0.821, 0.22),
    ],
    "make_line": [
        (0.702, -0.255), (-0.292, -0.745), (0.79, -0.82), (-0.177, 0.383), (-0.051, -0.128)
    ],
}  # fmt: skip


@pytest.mark.parametrize("task", SUITE)
def test_every_object_of_a_human_film_is_found_in_every_frame(task):
    film = SHARED_DATA / "magical_suite" / task.replace("_", "-") / "000.mp4"
    if not film.exists():
        pytest.skip(f"{film} is not here")
    found = FillDetector().detect(read_video(film)[:30], name=task)
    assert found.seen.all()
    np.testing.assert_allclose(found.center[0], BEGIN[task], atol=0.005)
    if len(found.label) > 2:
        assert np.linalg.norm(np.diff(found.center[:, 1:], axis=0), axis=-1).max() < 0.16
