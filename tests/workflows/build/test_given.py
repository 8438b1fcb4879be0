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
    ("env", "assistance", "words"),
    [
        (
            {},
            "task starts only",
            "begin at the task's Demo starts; the policy sees poses and velocities;",
        ),
        ({"variant": "layout"}, "task starts only", "begin at the task's Layout starts;"),
        ({"observation": "xmagical"}, "task starts only", "sees poses and velocities;"),
        (
            {"observation": "rich"},
            "expert-state resets",
            "velocities, and which blocks are in the region;",
        ),
        (
            {"observation": "sorted"},
            "expert-state resets",
            "in the region and which target is next;",
        ),
        (
            {"varied_starts": 0.25},
            "expert-state resets",
            "Demo starts, 25 % of them varied (the robot anywhere;",
        ),
        (
            {"name": "shoes_in_box"},
            "task starts only",
            "the task's own starts; the policy sees poses and",
        ),
        (
            {"name": "shoes_in_box", "observation": "rich"},
            "expert-state resets",
            "task's stages have been reached;",
        ),
        (
            {"name": "shoes_in_box", "varied_starts": 0.7},
            "expert-state resets",
            "70 % of them varied (states of a",
        ),
    ],
)
def test_help_that_only_authors_can_give_counts_as_an_experts(env, assistance, words):
    found = given(_config(**env))
    assert found.assistance == assistance
    assert words in str(found)


@pytest.mark.parametrize(
    ("ppo", "env", "assistance", "words"),
    [
        (
            {"visited_state_resets": 0.5},
            {},
            "visited-state resets",
            "Demo starts, 50 % of them at first at visited states;",
        ),
        (
            {"video_state_resets": 0.3},
            {},
            "video-state resets",
            "30 % of them at first at states of the videos;",
        ),
        (
            {"visited_state_resets": 0.5, "video_state_resets": 0.3},
            {},
            "video-state resets",
            "visited states, 30 % of them at first at states of the videos",
        ),
        (
            {"visited_state_resets": 0.5},
            {"observation": "rich"},
            "expert-state resets",
            "visited states;",
        ),
    ],
)
def test_states_that_training_resets_to_are_named(ppo, env, assistance, words):
    config = dataclasses.replace(_config(**env), ppo=PPOConfig(**ppo))
    assert given(config).assistance == assistance
    assert words in str(given(config))


def test_states_of_an_expert_are_played_for_an_experts_states_alone(monkeypatch):
    """Training tasks as a run makes them: only varied starts have the expert recorded. Videos bring
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


def test_the_reward_is_named():
    assert given(_config()).reward == "learned from videos"
    own = RunConfig(env=EnvConfig(reward="sparse"), run=RunSettings(reward="environmental"))
    assert given(own).reward == "the task's own (sparse)"
    assert given(RunConfig(run=RunSettings(reward="./a.npz"))).reward == "that of ./a.npz"
    staged = RunConfig(run=RunSettings(reward="stages"), ppo=PPOConfig(sub_policies=3))
    assert given(staged).reward == (
        "learned from videos, in its stages, each with a sub-policy of its own (3)"
    )


def test_rows_that_are_given_the_same_are_told_once():
    same = [_config(), _config(), _config(observation="rich")]
    assert of_all(same).count("training episodes") == 2
    assert of_all([]) == ""


def test_the_quickstart_has_task_starts_only():
    assert given(load("quickstart")).assistance == "task starts only"
    assert given(load("match_regions")).assistance == "expert-state resets"
