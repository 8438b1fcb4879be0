"""MatchRegions' stages agree with the task's own score."""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs import make
from gril_jax.envs.magical.match_regions.score import REGION, ROBOT, stages

TASK = stages(("green star", "green square", "blue pentagon"), 2, arena=1.1)
SIZE = jnp.array([[0.6, 0.7], [0.4, 0.4], [0.3, 0.3], [0.27, 0.29], [0.26, 0.26]])
START = jnp.array([[0.4, 0.35], [-0.5, 0.1], [0.8, -0.7], [-0.68, 0.72], [-0.05, -0.2]])


def _score(center, size, targets):
    inside = [all(abs(c - center[0]) <= size[0] / 2) for c in center[2:]]
    right, wrong = sum(inside[:targets]), sum(inside[targets:])
    return right / targets * (1 - wrong / max(right + wrong, 1))


def test_progress_is_the_tasks_score():
    rng = np.random.default_rng(0)
    center = rng.uniform(-0.9, 0.9, (200, 5, 2)).astype(np.float32)
    center[:, 0] = START[0]
    center[::2, 2:] = np.float32(START[0]) + 0.5 * center[::2, 2:]
    found = jax.vmap(lambda c: TASK.progress(c, SIZE))(jnp.asarray(center))
    wanted = [_score(c, np.asarray(SIZE), 2) for c in center]
    assert len(set(np.round(wanted, 3))) > 4
    np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_blocks_are_put_wholly_inside_and_clear_of_each_other():
    def both(key):
        keys = jax.random.split(key)
        center = TASK.stages[0].place(keys[0], START, SIZE)
        return TASK.stages[1].place(keys[1], center, SIZE)

    center = jax.vmap(both)(jax.random.split(jax.random.key(0), 40))
    for block in (2, 3):
        reach = jnp.abs(center[:, block] - START[REGION]) + SIZE[block] / 2
        assert (reach <= SIZE[REGION] / 2 + 1e-6).all()
    apart = jnp.linalg.norm(center[:, 2] - center[:, 3], axis=1)
    assert jnp.mean(apart > 0.28) > 0.8
    rest = jnp.array([0, 1, 4])
    np.testing.assert_array_equal(center[:, rest], jnp.tile(START[rest], (40, 1, 1)))


def test_a_region_smaller_than_the_block_gets_it_at_its_centre():
    small = SIZE.at[REGION].set(0.1)
    center = TASK.stages[0].place(jax.random.key(0), START, small)
    np.testing.assert_allclose(center[2], START[REGION], atol=1e-6)
    assert TASK.done(center, small).tolist() == [True, False]


def test_the_environment_offers_them_in_the_order_of_its_objects():
    env = make("match_regions", targets=("green square",), distractors=("yellow circle",))
    assert [s.name for s in env.stages.stages] == ["green square in the region"]
    assert [s.name for s in env.stages.faults] == ["yellow circle in the region"]
    assert (env.stages.movable, env.stages.robots) == ((2, 3), (ROBOT,))
    assert env.stages.half_extent == env.arena
