"""Scores and dense rewards against the reference's values at known states, and against numpy."""

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical.match_regions import score as rewards
from support import scenes

STAR, SQUARE, BLUE = range(3)
NAMES = ("green star", "green square", "blue pentagon", "yellow circle", "yellow pentagon")
HOME = np.array([scenes.BLOCKS[name][:2] for name in NAMES])
ROBOT, GOAL = np.array([-0.5, 0.1]), np.array([0.40, 0.35])
PAIR = {STAR: (0.25, 0.35), SQUARE: (0.55, 0.35)}


def _progress(moves):
    """The Demo scene but for these blocks, one step after the reset."""
    xy = HOME.copy()
    for block, place in moves.items():
        xy[block] = place
    start, reach = (np.linalg.norm(HOME[:2] - p, axis=1) for p in (GOAL, ROBOT))
    now = np.linalg.norm(xy[:2] - ROBOT, axis=1)
    return rewards.ScoreInputs(
        inside=jnp.asarray((np.abs(xy - GOAL) <= [0.3, 0.35]).all(axis=1)),
        distance=jnp.asarray(np.linalg.norm(xy[:2] - GOAL, axis=1), jnp.float32),
        start=jnp.asarray(start, jnp.float32),
        reach=jnp.asarray(now, jnp.float32),
        nearest=jnp.asarray(np.minimum(now, reach), jnp.float32),
    )


@pytest.mark.parametrize(
    ("moves", "sparse", "s4", "v5"),
    [
        ({}, 0, -0.4996, 1.228),
        ({SQUARE: tuple((HOME[SQUARE] + GOAL) / 2)}, 0, 2.312, 2.265),
        ({SQUARE: tuple(GOAL)}, 0.5, 4.783, 22.47),
        ({STAR: tuple(GOAL)}, 0.5, 4.714, 22.75),
        (PAIR, 1.0, 7.942, 33.47),
        (PAIR | {BLUE: (0.4, 0.1)}, 2 / 3, 5.246, 24.83),
        ({BLUE: tuple(GOAL)}, 0, -5.005, -7.78),
    ],
)
def test_rewards_have_the_references_values(moves, sparse, s4, v5):
    at = _progress(moves)
    assert float(rewards.reward("sparse", at)) == pytest.approx(sparse, rel=1e-6)
    assert float(rewards.reward("S4", at)) == pytest.approx(s4, abs=1e-3)
    assert float(rewards.reward("V5", at)) == pytest.approx(v5, abs=6e-3)


def _numpy(name, at):
    """The reference's formulas as loops in float64."""
    inside, distance, start, reach, nearest = (np.asarray(f, np.float64) for f in at)
    count, diagonal = len(distance), 2 * np.sqrt(2)
    n_t, n_d = inside[:count].sum(), inside[count:].sum()
    share = n_d / (n_t + n_d) if n_t + n_d else 0.0
    outside = [i for i in range(count) if not inside[i]]
    left = [0.0 if inside[i] else distance[i] for i in range(count)]
    if name == "sparse":
        return n_t / count * (1 - share)
    if name == "S4":
        return 10 * np.tanh((-n_d + sum(start[i] - left[i] for i in range(count)) - 0.1) / 2)
    if name == "V5":
        near = sum(max(0.0, 1 - nearest[i] / diagonal) for i in outside)
        whole = n_t / (n_t + n_d) if n_t + n_d else 0.0
        far = -10 * np.mean(distance / diagonal) * (1 + np.sqrt(share))
        return far + 4 + near + 10 * whole + 10 * n_t - 5 * n_d

    def f(d):
        return -0.006 * d**2 - 500 * np.log(d**2 + 0.001)

    way = sum((f(start[i]) - f(left[i])) / f(start[i]) for i in range(count))
    near = sum((f(diagonal) - f(reach[i])) / f(diagonal) for i in outside)
    return -5 * n_d + way + 10 * near - 20.8


def _random(seed, targets=2, blocks=5):
    rng = np.random.default_rng(seed)
    distance, start, reach = rng.uniform(0.05, 2.5, (3, targets)).astype(np.float32)
    return rewards.ScoreInputs(
        inside=jnp.asarray(rng.random(blocks) < 0.5),
        distance=jnp.asarray(distance),
        start=jnp.asarray(start + 0.1 * (abs(start - 1) < 0.1)),  # S3 divides by f, 0 near 1
        reach=jnp.asarray(reach),
        nearest=jnp.asarray(reach * rng.uniform(0.1, 1, targets).astype(np.float32)),
    )


@pytest.mark.parametrize("name", rewards.REWARDS)
@pytest.mark.parametrize(("targets", "blocks"), [(2, 5), (1, 1), (3, 3), (1, 4)])
def test_rewards_are_their_formulas(name, targets, blocks):
    for seed in range(20):
        at = _random(seed, targets, blocks)
        assert float(rewards.reward(name, at)) == pytest.approx(
            _numpy(name, at), rel=2e-4, abs=2e-4
        )


@pytest.mark.parametrize("name", rewards.REWARDS)
def test_jit_is_plain_and_vmap_is_a_loop(name):
    many = [_random(seed) for seed in range(6)]
    loop = [float(rewards.reward(name, at)) for at in many]
    stacked = jax.tree.map(lambda *f: jnp.stack(f), *many)
    lanes = jax.jit(jax.vmap(lambda at: rewards.reward(name, at)))(stacked)
    np.testing.assert_allclose(lanes, loop, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("name", rewards.REWARDS)
def test_a_target_at_the_very_centre_and_one_under_the_robot_are_finite(name):
    at = _progress({SQUARE: tuple(GOAL)})
    at = at._replace(reach=jnp.zeros(2), nearest=jnp.zeros(2), distance=jnp.zeros(2))
    chex.assert_tree_all_finite(rewards.reward(name, at))


def test_best_of_s4_is_the_references():
    """Both targets inside and nothing else: no state of the Demo layout is worth more."""
    best = float(rewards.reward("S4", _progress(PAIR)))
    assert best == pytest.approx(7.94, abs=5e-3)
    rng = np.random.default_rng(0)
    for _ in range(50):
        moves = {block: tuple(rng.uniform(-1, 1, 2)) for block in range(5)}
        assert float(rewards.reward("S4", _progress(moves))) <= best + 1e-5
