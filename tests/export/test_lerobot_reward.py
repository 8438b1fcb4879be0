"""`compute_reward` of a batch is the library's own reward, sample by sample."""

import jax.numpy as jnp
import numpy as np
import pytest
from support.saved_rewards import CLASSES, CONFIGS, OBJECTS, boxes, made

from gril_jax.errors import ConfigError, ShapeError
from gril_jax.export.lerobot_reward import RewardModel
from gril_jax.reward.learned_reward import LearnedReward

LEARNED = LearnedReward(
    made(CONFIGS["paper"]), CONFIGS["paper"], CLASSES, ("robot",), OBJECTS,
    description='{"half_extent": 1.0}',
)  # fmt: skip
MODEL = RewardModel(LEARNED)
CENTER, SIZE = boxes(6)


class Tensor:
    """As one of torch on a GPU: no array before it is detached and copied."""

    def __init__(self, values):
        self.values, self.steps = values, []

    def detach(self):
        self.steps.append("detach")
        return self

    def cpu(self):
        assert self.steps == ["detach"]
        return self.values


def frames():
    """Each frame as a sample, with the bits of its episode."""
    memory = LEARNED.init(CENTER[0], SIZE[0])
    active = [memory.activity.active]
    for center, size in zip(CENTER[1:], SIZE[1:], strict=True):
        memory, _ = LEARNED.step(memory, center, size)
        active.append(memory.activity.active)
    return {"center": CENTER, "size": SIZE, "active": jnp.stack(active)}


def test_frames_have_the_rewards_of_the_episode_they_are_of():
    found = MODEL.compute_reward(frames() | {"task": ["x"] * 6})
    assert (type(found), found.dtype, found.shape) == (np.ndarray, np.float32, (6,))
    np.testing.assert_allclose(found, LEARNED.trajectory(CENTER, SIZE), atol=1e-6)
    assert np.ptp(found) > 1e-4


def test_recordings_have_the_reward_of_their_last_frame():
    for last in (1, 4, 6):
        batch = {"center": jnp.stack([CENTER[:last], CENTER[-last:]]), "size": [SIZE[:last]] * 2}
        expected = [LEARNED.trajectory(one, SIZE[:last])[-1] for one in batch["center"]]
        np.testing.assert_allclose(MODEL.compute_reward(batch), expected, atol=1e-6)


def test_a_batch_of_one_and_tensors():
    one = {name: value[2:3] for name, value in frames().items()}
    found = MODEL.compute_reward({name: Tensor(value) for name, value in one.items()})
    assert found.shape == (1,)
    np.testing.assert_array_equal(found, MODEL.compute_reward(one))


def test_labels_of_another_scene_are_given_by_sample():
    label = jnp.array([[0, 1, 2, 3, 3], [0, 1, 2, 3, 2]])
    present = jnp.array([[True] * 5, [True] * 4 + [False]])
    one = {name: value[:2] for name, value in frames().items()}
    found = MODEL.compute_reward(one | {"label": label, "present": present})
    for i, value in enumerate(found):
        given = [one[name][i] for name in ("center", "size", "active")]
        expected = LEARNED(*given, label=label[i], present=present[i])
        np.testing.assert_allclose(value, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"center": None}, ConfigError, "batch lacks 'center'; it must hold center and size of"),
        ({"active": None}, ConfigError, "batch lacks 'active'; it must hold center and size of"),
        ({"size": SIZE[:3]}, ShapeError, r"size has shape \(3, 5, 2\) but center has shape \(6, 5"),
        ({"present": np.ones(6, bool)}, ShapeError, r"present has shape \(6,\) but center"),
        ({"label": np.full((6, 5), 4)}, ConfigError, "label holds a number outside 0 to 3"),
        (
            {"center": CENTER[:, :4], "size": SIZE[:, :4], "active": np.ones((6, 4), bool)},
            ShapeError,
            "center has 4 objects, but the reward is for 5: ",
        ),
        ({"center": CENTER[..., :1], "size": SIZE[..., :1]}, ShapeError, r"\(6, 5, 1\); it must"),
        ({"label": [["star"] * 5] * 6}, ConfigError, "label must be an array of numbers"),
        ({"size": [[1.0], [1.0, 2.0]]}, ConfigError, "size must be an array of numbers"),
        ({"center": CENTER * 300}, ConfigError, "convert pixels with gril_jax.boxes_from_pixels"),
    ],
)
def test_a_wrong_batch_is_a_sentence(change, error, words):
    batch = {k: v for k, v in (frames() | change).items() if v is not None}
    with pytest.raises(error, match=words):
        MODEL.compute_reward(batch)


def test_a_batch_that_is_no_mapping_is_a_sentence():
    with pytest.raises(ConfigError, match="batch is a list, but must be a mapping of arrays"):
        MODEL.compute_reward([CENTER, SIZE])
