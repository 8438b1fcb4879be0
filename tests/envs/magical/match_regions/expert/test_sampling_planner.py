"""The expert of the sticks: it solves the task, its failures fail, looking again does no harm."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical.match_regions.expert import sampling_planner as planner
from gril_jax.envs.magical.match_regions.expert import scripted
from gril_jax.envs.magical.match_regions.expert.push_routes import Route, stay

from gril_jax import envs

HOW = planner.Search(candidates=14, horizon=20, stride=10)
STEPS, NUM = 70, 3
NOWHERE = planner.Pull(jnp.zeros(2), jnp.zeros(()))


@pytest.fixture(scope="module")
def env():
    blocks = {"targets": ("green square",), "distractors": ("yellow circle",)}
    return envs.make("match_regions", robot="short", episode_length=STEPS, **blocks)


@pytest.fixture(scope="module")
def played(env):
    """Episodes of successes, then of each way to fail: states and stages; the last is lane 0's."""
    keys = jnp.tile(jax.random.split(jax.random.key(0), NUM), len(scripted.FAILURES))
    keys = jnp.concatenate([keys, keys[:1]])
    failures = jnp.repeat(jnp.arange(len(scripted.FAILURES)), NUM)
    failures = jnp.concatenate([failures, failures[:1]])
    style = scripted.Style(pause=4)
    roll = jax.vmap(lambda key, kind: scripted.rollout(env, key, kind, style, HOW))
    return jax.device_get(jax.jit(roll)(keys, failures))


def _lanes(array, failure):
    start = NUM * scripted.FAILURES.index(failure)
    return np.asarray(array)[start : start + NUM]


@pytest.mark.slow
def test_a_stick_pushes_the_target_into_the_region(played):
    assert _lanes(played[0].metrics["success"], "none")[:, -1].mean() == 1.0


@pytest.mark.slow
def test_what_is_solved_stays_so_and_the_stick_rests(played):
    success = _lanes(played[0].metrics["success"], "none")
    pose = _lanes(played[0].data.pose, "none")
    for row, poses in zip(success, pose, strict=True):
        when = row.argmax()
        assert row[when:].min() == 1.0
        assert np.abs(poses[when + 12 :] - poses[-1]).max() < 1e-3


@pytest.mark.parametrize("failure", ["wrong_block", "wrong_place", "drops"])
@pytest.mark.slow
def test_a_failure_fails(played, failure):
    assert _lanes(played[0].metrics["success"], failure)[:, -1].mean() == 0.0


@pytest.mark.slow
def test_stopping_early_leaves_the_scene_at_rest(played):
    pose = _lanes(played[0].data.pose, "stops_early")
    assert np.ptp(pose[:, 44:], axis=1).max() < 2e-2


@pytest.mark.slow
def test_wrong_block_moves_the_distractor_and_drops_moves_the_target(played):
    for failure, block in (("wrong_block", 2), ("drops", 1)):
        pose = _lanes(played[0].data.pose, failure)[:, :, block, :2]
        assert (np.linalg.norm(pose[:, -1] - pose[:, 0], axis=-1) > 0.2).mean() >= 0.5


@pytest.mark.slow
def test_stages_count_what_is_done(played):
    stages = _lanes(played[1], "none")
    assert stages.shape == (NUM, STEPS + 1)
    assert (stages[:, 0] == 0).all()
    assert (stages[:, -1] == 1).all()


@pytest.mark.slow
def test_an_episode_is_its_key(played):
    pose = np.asarray(played[0].data.pose)
    np.testing.assert_array_equal(pose[0], pose[-1])
    assert len(np.unique(pose[:NUM, -1].reshape(NUM, -1).round(3), axis=0)) == NUM


# ---------------------------------------------------------------- what a scene costs


def _scene(env, square, circle, robot=(0.0, 0.9, 0.0)):
    pose = jnp.array([robot, (*square, 0.0), (*circle, 0.0)], jnp.float32)
    return env.reset_to(pose, jnp.zeros((3, 3)))


@pytest.fixture(scope="module")
def price(env):
    state = jax.jit(env.reset)(jax.random.key(0))
    drawn = jax.jit(lambda state: scripted.plan(env, jax.random.key(1), state))(state)
    cost = jax.jit(lambda pull, *scene: planner.cost(env, drawn, _scene(env, *scene), pull))
    return lambda *scene, pull=NOWHERE: float(cost(pull, *scene))


def test_a_solved_scene_costs_nothing_and_an_unsolved_one_does(price):
    assert price((0.4, 0.35), (-0.6, -0.6)) == 0.0
    assert price((-0.2, 0.35), (-0.6, -0.6)) > 0.2
    assert price((0.4, 0.35), (0.5, 0.1)) > 0.2  # a distractor is inside


def test_nearer_costs_less_and_a_wall_costs_more(price):
    far = (-0.7, -0.7)
    assert price((-0.1, 0.35), far) < price((-0.3, 0.35), far) < price((-0.6, 0.35), far)
    assert price((0.4, 0.35), (0.5, 0.1)) > price((0.4, 0.35), (0.68, 0.1))
    # Both are 0.96 from the region: one at a wall, the other in the open.
    assert price((-0.86, 0.35), far) < price((-0.95, 0.35), far) - 0.09


def test_a_pull_costs_the_way_to_its_point(price):
    pull = planner.Pull(jnp.array([0.3, 0.5]), jnp.float32(2.0))
    solved = (0.4, 0.35), (-0.6, -0.6)
    assert price(*solved, pull=pull) == pytest.approx(2.0 * np.hypot(0.3, 0.4), abs=1e-4)


# ---------------------------------------------------------------- searching


def test_a_search_never_ends_worse_than_the_route_in_hand(env):
    """With no time to find anything, it keeps a good route, and stands still over a bad one."""
    how = planner.Search(candidates=4, rounds=1, elite=2, horizon=12)
    zero = jnp.zeros((), jnp.int32)

    @jax.jit
    def find(points, key):
        state = _scene(env, (-0.2, 0.35), (-0.6, -0.6), (-0.5, 0.35, -np.pi / 2))
        drawn = scripted.plan(env, jax.random.key(1), state)
        route = Route(points, zero, zero)
        return planner.search(env, how, drawn, key, state, route, NOWHERE)

    good = jnp.array([[-0.5, 0.35], [-0.4, 0.35], [0.25, 0.35]])
    bad = jnp.array([[-0.5, 0.35], [-1.0, 0.35], [-1.0, 0.35]])
    for key in jax.random.split(jax.random.key(3), 3):
        np.testing.assert_array_equal(find(good, key).points, good)
        assert not (find(bad, key).points == bad).all()
    assert stay().at == 3
