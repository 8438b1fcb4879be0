"""The frames of a demo set as one array: what a reader of the videos would make of them."""

import dataclasses

import jax
import numpy as np
import pytest
from gril_jax.envs import make
from support.run_folders import moving_scene, save_demos
from support.scenes import HALF_EXTENT

from gril_jax.config import EncoderOptions, EnvConfig, RunConfig
from gril_jax.demos import files
from gril_jax.demos.demo import Demo, Tracks
from gril_jax.demos.demo_set import demo_batch, frame_batch, load_demo_set, shrink
from gril_jax.demos.files import write_demo_set
from gril_jax.demos.vision.detect import PALETTE_CLASSES
from gril_jax.demos.vision.video import read_video, write_video
from gril_jax.errors import ConfigError, DemoError
from gril_jax.rl import rewards
from gril_jax.types import VideoBatch
from gril_jax.workflows.build import filming, learners, policy_rewards
from gril_jax.workflows.build.demonstrations import Demonstrations


@pytest.fixture(scope="module")
def demo_set(tmp_path_factory):
    """Two demonstrations of 8 and 5 frames of 96 x 96."""
    folder = tmp_path_factory.mktemp("frames") / "set"
    frames, tracks = moving_scene()
    short = Tracks(tracks.center[:5], tracks.size[:5], tracks.label, tracks.seen[:5])
    write_demo_set(
        folder,
        [Demo("long", frames, tracks), Demo("short", frames[:5], short)],
        task="match_regions",
        classes=PALETTE_CLASSES,
        half_extent=HALF_EXTENT,
        fps=8.0,
        source="drawn for a test",
    )
    return load_demo_set(folder)


def test_frames_are_the_means_of_the_decoded_pixels_padded_as_the_boxes(demo_set):
    names = ["short", "long"]
    found = frame_batch(demo_set, names, pixels=24)
    boxes = demo_batch(demo_set, names)
    assert found.frames.dtype == np.uint8
    assert found.frames.shape == (2, 8, 24, 24, 3)
    np.testing.assert_array_equal(found.length, boxes.length)
    decoded = read_video(demo_set.folder / "001.mp4")
    means = decoded.reshape(5, 24, 4, 24, 4, 3).mean((2, 4))  # area: means of 4 x 4 pixels
    np.testing.assert_allclose(found.frames[0, :5], means, atol=0.51)
    for t in range(5, 8):
        np.testing.assert_array_equal(found.frames[0, t], found.frames[0, 4])


def test_a_wider_world_continues_the_border_and_a_narrower_one_cuts_it_off():
    frames = np.random.default_rng(0).integers(0, 256, (2, 8, 8, 3), np.uint8)
    np.testing.assert_array_equal(shrink(frames, 8), frames)
    np.testing.assert_array_equal(shrink(frames, 4, zoom=0.5), frames[:, 2:6, 2:6])
    wider = np.pad(frames, ((0, 0), (4, 4), (4, 4), (0, 0)), mode="edge")
    np.testing.assert_array_equal(shrink(frames, 16, zoom=2.0), wider)


def test_another_world_is_asked_for_by_its_half_extent(demo_set):
    found = frame_batch(demo_set, ["long"], pixels=24, half_extent=HALF_EXTENT / 2)
    decoded = read_video(demo_set.folder / "000.mp4")[:, 24:72, 24:72]
    means = decoded.reshape(8, 24, 2, 24, 2, 3).mean((2, 4))
    np.testing.assert_allclose(found.frames[0], means, atol=0.51)


def test_the_tasks_own_picture_looks_like_a_videos_frame(tmp_path):
    env = make("match_regions")
    data = jax.jit(env.reset)(jax.random.key(0)).data
    host = jax.device_get(data)
    painted = filming.paint(
        env.outlines(host), half_extent=env.half_extent, background=env.background
    )
    write_video(tmp_path / "a.mp4", [painted], 8.0)
    frame = shrink(read_video(tmp_path / "a.mp4"), 64, zoom=64 / 66)[0].astype(int)
    config = RunConfig(encoder=EncoderOptions(kind="pixels"))
    ours = np.asarray(jax.jit(policy_rewards._picture(config, 64))(data))
    assert (ours.shape, ours.dtype) == ((64, 64, 3), np.uint8)
    difference = np.abs(ours - frame)
    assert difference.mean() < 0.8  # with the wall, which OpenCV draws broader, 1.7
    assert np.quantile(difference, 0.99) < 12


@pytest.mark.parametrize(("task", "reward"), [("match_regions", "S4"), ("shoes_in_box", "staged")])
def test_videos_are_cut_as_the_tasks_own_pictures_where_it_has_them(monkeypatch, task, reward):
    asked = []

    def frames(demo_set, names, *, pixels, half_extent):
        asked.append((names, half_extent))
        return VideoBatch(np.zeros((1, 1, pixels, pixels, 3), np.uint8), np.ones(1, np.int32))

    monkeypatch.setattr(learners, "frame_batch", frames)
    config = RunConfig(
        env=EnvConfig(name=task, reward=reward), encoder=EncoderOptions(kind="pixels")
    )
    learned = learners.learner(config, Demonstrations(None, {"train": "a", "validation": "b"}, 0))
    wanted = make(task).half_extent * 64 / 66 if task == "match_regions" else None
    assert asked == [(("a",), wanted), (("b",), wanted)]
    assert learned.data[0].frames.shape == (1, 1, 64, 64, 3)


def test_no_policy_is_paid_for_pictures_of_a_task_that_has_none():
    on_table = EnvConfig(name="shoes_in_box", reward="staged")
    shoes = RunConfig(env=on_table, encoder=EncoderOptions(kind="pixels"))
    with pytest.raises(ConfigError, match=r"a policy for shoes_in_box, which has no pictures"):
        policy_rewards.function(shoes, make("shoes_in_box"))
    own = dataclasses.replace(shoes, run=dataclasses.replace(shoes.run, reward="environmental"))
    assert policy_rewards.function(own, make("shoes_in_box")) is rewards.environmental


def test_what_does_not_fit_is_named(demo_set, tmp_path):
    with pytest.raises(DemoError, match="there is no demonstration 'third'"):
        frame_batch(demo_set, ["third"], pixels=8)
    path = demo_set.folder / "000.mp4"
    wrong = dataclasses.replace(demo_set[0], video=lambda: files._video(path, 7))
    with pytest.raises(DemoError, match=r"holds 8 frames, but its boxes are those of 7"):
        frame_batch(dataclasses.replace(demo_set, demos=(wrong,)), ["long"], pixels=8)
    save_demos(tmp_path / "set")
    wide = load_demo_set(tmp_path / "set")
    write_video(wide.folder / "000.mp4", [np.zeros((8, 16, 3), np.uint8)] * 8, fps=8.0)
    with pytest.raises(DemoError, match="frames are 16 x 8, but must be square"):
        frame_batch(wide, ["one"], pixels=8)
