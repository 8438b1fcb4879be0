"""The share of a policy's episodes that end as the videos do."""

import types

import jax.numpy as jnp
import pytest
from gril_jax.envs.base import Objects
from support.probes import carried

from gril_jax.config import EncoderOptions, RunConfig
from gril_jax.workflows.build import video_ends
from gril_jax.workflows.study.recipe import changed

CONFIG = RunConfig(encoder=EncoderOptions(width=4, rounds=0, latent=2))
CLASSES = ("red region", "robot", "red square")


@pytest.mark.parametrize("goal_model", ["places", "inside", "arrangement"])
def test_ends_of_videos_lack_nothing_and_beginnings_do(goal_model):
    config = changed(CONFIG, {"loss.goal_model": goal_model})
    scenes, due = video_ends.owed(carried(), config, carried(), CLASSES, touch=0.0)
    assert scenes.center.shape == (4, 10, 3, 2)
    assert (due[:, -1] >= -0.25).all()  # at the edge of a place without extent
    assert (due[:, 0] < -0.7).all()


def test_an_episode_ends_as_videos_do_if_its_last_frame_lacks_little():
    shown = carried()
    assert video_ends.share(shown, CONFIG, shown, CLASSES) == 1.0
    idle = shown._replace(center=shown.center.at[:3, -1].set(shown.center[:3, 0]))
    assert video_ends.share(idle, CONFIG, shown, CLASSES) == 0.25
    assert video_ends.share(idle, CONFIG, idle, CLASSES) == 1.0  # as most of these videos do


def test_episodes_are_read_as_videos_of_one_length():
    shown = carried()
    seen = Objects(
        shown.center, shown.size, *(jnp.tile(x[:, None], (1, 10, 1)) for x in shown[2:4])
    )
    again = video_ends.as_videos(seen)
    for one, two in zip(again, shown, strict=True):
        assert jnp.array_equal(one, two)


@pytest.mark.parametrize(
    "changes",
    [
        {"run.reward": "environmental"},
        {"run.reward": "other.npz"},  # learned from other videos, perhaps
        {"encoder.kind": "pixels"},
        {},  # the demonstrations are gone
    ],
)
def test_a_run_that_cannot_tell_says_nothing(tmp_path, changes):
    nothing = Objects(*(jnp.zeros(()) for _ in range(4)))
    assert video_ends.of_run(tmp_path, changed(CONFIG, changes), nothing) is None


def test_nor_do_episodes_with_other_objects_than_the_videos(tmp_path, monkeypatch):
    config, shown = changed(CONFIG, {"demos.path": str(tmp_path)}), carried()
    (tmp_path / "demos.json").touch()
    made = types.SimpleNamespace(batch=lambda split: shown)
    monkeypatch.setattr(video_ends.demonstrations, "chosen", lambda *a: made)
    monkeypatch.setattr(video_ends, "share", lambda *a: 0.5)
    label, is_robot = (jnp.tile(x[:, None], (1, 10, 1)) for x in shown[2:4])
    seen = Objects(shown.center, shown.size, label, is_robot)
    assert video_ends.of_run(tmp_path, config, seen) == 0.5
    assert video_ends.of_run(tmp_path, config, seen._replace(label=label[..., ::-1])) == 0.5
    assert video_ends.of_run(tmp_path, config, seen._replace(label=label.at[0].add(1))) is None
    more = Objects(*(jnp.concatenate([x, x[:, :, :1]], axis=2) for x in seen))
    assert video_ends.of_run(tmp_path, config, more) is None
