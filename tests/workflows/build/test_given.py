"""The ledger of help: levels and words for configurations."""

import dataclasses

import pytest
from gril_jax.envs.tabletop import demonstrations
from gril_jax.envs.tabletop.tasks import shoes_in_box

from gril_jax.config import EnvConfig, PPOConfig, RunConfig, RunSettings
from gril_jax.config.files import load
from gril_jax.types import DemoBatch
from gril_jax.workflows.build import setup
from gril_jax.workflows.build.given import given, of_all


def _config(**env):
    return RunConfig(env=EnvConfig(**{"varied_starts": 0.0, "observation": "plain"} | env))


@pytest.mark.parametrize(
    ("env", "level", "words"),
    [
        ({}, "A", "begin at the task's Demo starts; the policy sees poses and velocities;"),
        ({"variant": "layout"}, "A", "begin at the task's Layout starts;"),
        ({"observation": "xmagical"}, "A", "sees poses and velocities;"),
        ({"observation": "rich"}, "C", "velocities, and which blocks are in the region;"),
        ({"observation": "sorted"}, "C", "in the region and which target is due;"),
        ({"varied_starts": 0.25}, "C", "Demo starts, 25 % of them varied (the robot anywhere;"),
        ({"name": "shoes_in_box"}, "A", "the task's own starts; the policy sees poses and"),
        ({"name": "shoes_in_box", "observation": "rich"}, "C", "task's stages have been reached;"),
        ({"name": "shoes_in_box", "varied_starts": 0.7}, "C", "70 % of them varied (moments of a"),
    ],
)
def test_help_that_only_authors_can_give_makes_it_level_c(env, level, words):
    found = given(_config(**env))
    assert found.level == level
    assert words in str(found)


@pytest.mark.parametrize(
    ("ppo", "env", "level", "words"),
    [
        (
            {"visited_state_resets": 0.5},
            {},
            "B",
            "Demo starts, and first 50 %, in the end none at its",
        ),
        (
            {"video_state_resets": 0.3},
            {},
            "V",
            "and first 30 %, in the end none at videos' frames;",
        ),
        (
            {"visited_state_resets": 0.5, "video_state_resets": 0.3},
            {},
            "V",
            "its own moments, and first 30 %",
        ),
        ({"visited_state_resets": 0.5}, {"observation": "rich"}, "C", "its own moments;"),
    ],
)
def test_starts_that_training_chooses_are_levels_b_and_v(ppo, env, level, words):
    config = dataclasses.replace(_config(**env), ppo=PPOConfig(**ppo))
    assert given(config).level == level
    assert words in str(given(config))


def test_states_of_an_expert_are_played_for_level_c_alone(monkeypatch):
    """Training tasks as a run makes them: only varied starts have the expert recorded. Films bring
    boxes and their classes to a learner, and no states."""
    played = []

    def marked(env, perform):
        played.append(env)
        raise LookupError

    monkeypatch.setattr(demonstrations, "moments", marked)
    fresh = demonstrations.Entry(shoes_in_box.TASK, shoes_in_box.ENTRY.script)
    monkeypatch.setattr(setup, "build", lambda name, options: fresh.make(**options))
    for starts in ({}, {"visited_state_resets": 0.5}, {"video_state_resets": 0.5}):
        own = EnvConfig(name="shoes_in_box", varied_starts=0.0)
        config = RunConfig(env=own, ppo=PPOConfig(**starts))
        setup.make_env(config.env, training=True)
    assert not played
    with pytest.raises(LookupError):
        setup.make_env(EnvConfig(name="shoes_in_box", varied_starts=0.7), training=True)
    assert DemoBatch._fields == ("center", "size", "label", "is_robot", "present", "length")


def test_the_reward_is_named_beside_the_level():
    assert given(_config()).reward == "learned from videos"
    own = RunConfig(env=EnvConfig(reward="sparse"), run=RunSettings(reward="environmental"))
    assert given(own).reward == "the task's own (sparse)"
    staged = RunConfig(run=RunSettings(reward="stages"), ppo=PPOConfig(sub_policies=3))
    assert given(staged).reward == (
        "learned from videos, in its stages, each with a sub-policy of its own (3)"
    )


def test_rows_that_are_given_the_same_are_told_once():
    same = [_config(), _config(), _config(observation="rich")]
    assert of_all(same).count("level") == 2
    assert of_all([]) == ""


def test_the_quickstart_is_at_level_a_and_match_regions_at_c():
    assert given(load("quickstart")).level == "A"
    assert given(load("match_regions")).level == "C"
