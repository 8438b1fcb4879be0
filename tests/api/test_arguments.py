"""Wrong arguments of public functions are errors of ours, in one sentence that names them."""

import jax.numpy as jnp
import numpy as np
import pytest
from support.saved_rewards import CLASSES, CONFIGS, OBJECTS, boxes, made

import gril_jax as gril
from gril_jax import graphs, losses, metrics, reward
from gril_jax.errors import GrilError
from gril_jax.reward.learned_reward import LearnedReward

PAPER = CONFIGS["paper"]
LEARNED = LearnedReward(made(PAPER), PAPER, CLASSES, ("robot",), OBJECTS)
CENTER, SIZE = (x[0] for x in boxes(1))
STILL, LABEL = jnp.zeros(5, bool), jnp.arange(5) % 4

WRONG = {
    "labels with a point": (lambda: LEARNED(CENTER, SIZE, STILL, label=LABEL + 0.5), "label holds"),
    "labels that are words": (lambda: LEARNED(CENTER, SIZE, STILL, label=["a"] * 5), "label is"),
    "rows of several lengths": (lambda: LEARNED([[1, 2], [3]], SIZE, STILL), "center is"),
    "no boxes": (lambda: LEARNED(None, SIZE, STILL), "center is None"),
    "no memory": (lambda: LEARNED.step(None, CENTER, SIZE), "memory is None, but must be a Memory"),
    "a graph without labels": (
        lambda: graphs.scene_graph(CENTER, SIZE, LABEL + 0.5, STILL, STILL), "label holds float32",
    ),
    "no demonstrations": (lambda: reward.from_demos({}, None, PAPER), "demos is None, but must be"),
    "text for a loss": (lambda: losses.soft_dtw("cost"), "cost is 'cost', but must be an array"),
    "no times": (lambda: losses.cycle_consistency(CENTER, SIZE, None), "times is None"),
    "a number for a path": (lambda: gril.load_reward(5), "path is 5, but must be a str or"),
    "a path for demonstrations": (lambda: gril.learn_reward("mine"), "demos is 'mine', but must"),
    "no task": (lambda: gril.train_policy(None), "task is None, but must be a name, or have reset"),
    "a number for a task": (lambda: gril.make(5), "name is 5, but must be a str"),
}  # fmt: skip


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_argument_is_named(kind):
    call, words = WRONG[kind]
    with pytest.raises(GrilError) as refused:
        call()
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_lists_are_arrays():
    assert losses.soft_dtw([[0.0, 1.0], [1.0, 0.0]], gamma=0.1) == pytest.approx(0, abs=1e-3)
    assert metrics.kendall_tau([1.0, 2.0, 3.0]) == 1
    given = (np.asarray(x).tolist() for x in (CENTER, SIZE, STILL))
    assert LEARNED(*given) == LEARNED(CENTER, SIZE, STILL)
