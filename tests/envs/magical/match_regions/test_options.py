"""Options of MatchRegions: wrong ones are refused in one sentence."""

import jax
import pytest
from gril_jax.envs.magical.match_regions import task

from gril_jax import envs


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"variant": "demos"}, ["variant", "'demos'", "demo, jitter, layout"]),
        ({"targets": ("pink star",)}, ["'pink star'", "green star"]),
        ({"targets": ("goal",)}, ["'goal'"]),
        ({"targets": ()}, ["targets", "at least one"]),
        ({"robot": "sticks"}, ["robot", "'sticks'", "gripper, short, medium, long"]),
        ({"physics": "mujoco"}, ["physics", "'mujoco'", "xmagical, magical"]),
        ({"observation": "state"}, ["observation", "'state'", "rich, sorted, xmagical"]),
        ({"reward": "sparce"}, ["reward", "'sparce'", "did you mean 'sparse'"]),
        ({"varied_starts": 1.5}, ["varied_starts", "1.5", "between 0 and 1"]),
        ({"on_the_way": -0.5}, ["on_the_way", "-0.5", "between 0 and 1"]),
        ({"substeps": 0}, ["substeps", "0", "at least 1"]),
        ({"iterations": 0}, ["iterations", "0", "at least 1"]),
        ({"episode_length": 0}, ["episode_length", "0", "at least 1"]),
        ({"distractors": ("red star",)}, ["'red star'", "demo layout"]),
        ({"distractors": ("red star",), "variant": "jitter"}, ["'red star'", "jitter layout"]),
    ],
)
def test_a_wrong_option_is_one_sentence_that_names_it(options, words):
    with pytest.raises(ValueError) as error:  # noqa: PT011
        envs.make("match_regions", **options)
    for word in words:
        assert word in str(error.value)
    assert "\n" not in str(error.value)


def test_an_unknown_task_is_one_sentence_with_the_known_ones():
    expected = (
        r"did you mean 'match_regions'\?\): the tasks are match_regions, .*shoes_in_box, "
        r".*empty_container, and any"
    )
    with pytest.raises(ValueError, match=expected):
        envs.make("match_region")


def test_other_blocks_make_another_scene():
    env = envs.make(
        "match_regions",
        targets=("red circle",),
        distractors=("blue star", "green square"),
        variant="layout",
    )
    state = jax.eval_shape(env.reset, jax.random.key(0))
    assert env.blocks == ("red circle", "blue star", "green square")
    assert state.obs.shape == (14 + 36,)
    assert state.data.progress.start_distance.shape == (1,)


def test_classes_are_the_detectors():
    from gril_jax.demos.vision.palette import PALETTE_CLASSES

    assert task.CLASSES == PALETTE_CLASSES
