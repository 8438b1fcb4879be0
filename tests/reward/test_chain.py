"""Chains of goals: against a plain loop, and the shape of their staircase."""

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax import reward
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.reward import chain as subtask_chain
from gril_jax.reward.chain import ChainParams
from gril_jax.subtasks import matching

# Three goals along a line, each one unit from the one before; a fourth slot is padding.
GOALS = jnp.array([[1.0, 0.0], [2.0, 0.0], [3.0, 0.0], [9.0, 9.0]])
CHAIN = ChainParams(GOALS, jnp.ones(4), jnp.full(4, 0.1), jnp.array(3))
run = jax.jit(subtask_chain.trajectory, static_argnames="mode")
make = jax.jit(subtask_chain.from_latents)


def _along(*x):
    return jnp.stack([jnp.array(x, jnp.float32), jnp.zeros(len(x))], axis=-1)


def _oracle(params, latents, mode, bonus=None, fallback=None):
    """One frame after the other, in float64."""
    goals, scale, radius, count = (np.asarray(x, np.float64) for x in params)
    num = int(count)
    index, level, entry = 0, -1.0, 1.0
    values, indices = [], []
    for z in np.asarray(latents, np.float64):
        distance = [scale[i] * np.linalg.norm(z - goals[i]) for i in range(num)]
        stage = towards = min(index, num - 1)
        d = distance[stage]
        covered = 1 - d / entry if d < entry else entry - d
        value = level + ((stage + 1) / num - 1 - level) * covered
        if index == stage and d <= radius[stage]:
            index, towards = index + 1, min(stage + 1, num - 1)
        far = stage > 0 and distance[stage - 1] > radius[stage - 1]
        if fallback is not None and far and d - entry > fallback:
            index = towards = stage - 1
        if towards != stage:
            level, entry = value, max(distance[towards], radius[towards])
        if mode == "stepped":
            step = 1 / num if bonus is None else bonus
            value = -distance[towards] / num - step * (num - 1 - towards)
        values.append(value)
        indices.append(index)
    return np.array(values), np.array(indices)


@pytest.mark.parametrize("mode", ["continuous", "stepped"])
@pytest.mark.parametrize("fallback", [None, 0.3])
def test_random_walks_equal_the_loop(mode, fallback):
    rng = np.random.default_rng(0)
    target = np.repeat([[1, 0], [2, 0], [0, 0], [2, 0], [3, 0], [1, 1]], 10, axis=0)
    noise = 0.05 * rng.normal(size=(20, 60, 2))
    walks = jnp.asarray(target + noise, jnp.float32)
    options = {"mode": mode, "bonus": 0.2, "fallback": fallback}
    values, indices = jax.vmap(lambda z: run(CHAIN, z, **options))(walks)
    for walk, value, index in zip(walks, values, indices, strict=True):
        expected, expected_index = _oracle(CHAIN, walk, **options)
        np.testing.assert_array_equal(index, expected_index)
        np.testing.assert_allclose(value, expected, atol=1e-5)
    assert set(np.asarray(indices).flatten()) == {0, 1, 2, 3}


def test_steps_of_a_rollout_equal_the_whole_trajectory():
    latents = _along(0, 0.5, 0.95, 1.5, 2.0, 2.5, 1.0, 3.0)
    values, indices = run(CHAIN, latents)
    progress = subtask_chain.init()
    step = jax.jit(subtask_chain.step)
    for latent, value, index in zip(latents, values, indices, strict=True):
        progress, found = step(CHAIN, progress, latent)
        np.testing.assert_allclose(found, value, atol=1e-6)
        assert progress.index == index
    assert indices.tolist() == [0, 0, 1, 1, 2, 2, 2, 3]


def test_the_gradient_of_a_step_equals_finite_differences():
    progress = subtask_chain.ChainProgress(jnp.array(1), jnp.array(-0.7), jnp.array(0.8))
    point, shift = jnp.array([1.4, 0.3]), 1e-2 * jnp.eye(2)
    for mode in ("continuous", "stepped"):

        def value(latent, mode=mode):
            return subtask_chain.step(CHAIN, progress, latent, mode=mode)[1]

        values, slope = jax.jit(lambda x, f=value: (jax.vmap(f)(x), jax.grad(f)(point)))(
            jnp.concatenate([point + shift, point - shift])
        )
        np.testing.assert_allclose(slope, (values[:2] - values[2:]) / 2e-2, atol=1e-3)


def test_the_staircase_leads_from_minus_one_to_zero_without_a_jump():
    latents = _along(*np.linspace(0, 3, 301))
    for mode in ("continuous", "stepped"):
        values, _ = run(CHAIN, latents, mode=mode)
        np.testing.assert_allclose(values[jnp.array([0, 300])], [-1, 0], atol=1e-5)
        assert (jnp.diff(values) >= -1e-6).all()
        assert values.max() <= 1e-6
    values, _ = run(CHAIN, latents)
    assert jnp.abs(jnp.diff(values)).max() < 0.006  # a hundredth of a stage is about 1 / 300


def test_a_finished_subtask_steps_up_by_the_bonus_and_costs_without_one():
    latents = _along(0.89, 0.91)  # outside and inside the radius
    for bonus in (0.0, 0.5):
        values, indices = run(CHAIN, latents, mode="stepped", bonus=bonus)
        assert indices.tolist() == [0, 1]
        # From 0.11 stages before one goal to 1.09 before the next, of three.
        np.testing.assert_allclose(values[1] - values[0], bonus - (1.09 - 0.11) / 3, atol=1e-5)


def test_staying_just_short_of_a_goal_does_not_pay_as_it_does_with_what_is_published():
    finish = np.concatenate([np.linspace(0, 3, 31), np.full(10, 3.0)])
    finish, stay = _along(*finish), _along(*np.minimum(finish, 0.89))

    def total(latents, **options):
        return run(CHAIN, latents, **options)[0].sum()

    for options in ({"mode": "continuous"}, {"mode": "stepped"}):
        assert total(finish, **options) > total(stay, **options) + 10
    published = {"mode": "stepped", "bonus": 0.0}
    assert total(finish, **published) < total(stay, **published)


def test_the_index_never_goes_back_unless_asked_to():
    latents = _along(1.0, 1.5, 1.2, 0.0, -1.0, 0.0)
    assert run(CHAIN, latents)[1].tolist() == [1] * 6
    values, indices = run(CHAIN, latents, fallback=0.5)
    assert indices.tolist() == [1, 1, 1, 0, 0, 0]
    jumps = jnp.abs(jnp.diff(values)) / jnp.abs(jnp.diff(latents[:, 0]))
    assert jumps.max() <= 2 / 3 + 1e-5  # it is continuous there, too
    finished = _along(1.0, 2.0, 3.0, 1.2)
    assert run(CHAIN, finished)[1].tolist() == [1, 2, 3, 3]
    assert run(CHAIN, finished, fallback=0.5)[1].tolist() == [1, 2, 3, 1]


def test_undoing_a_finished_task_costs():
    values, indices = run(CHAIN, _along(1.0, 2.0, 3.0, 2.5))
    assert indices.tolist() == [1, 2, 3, 3]
    assert values[2] == pytest.approx(0, abs=1e-5)
    assert values[3] < -0.1


def test_a_stage_entered_at_its_goal_keeps_rewards_finite_and_bounded():
    goals = jnp.array([[1.0, 0.0], [1.0, 0.0]])
    chain = ChainParams(goals, jnp.ones(2), jnp.zeros(2), jnp.array(2))
    for mode in ("continuous", "stepped"):

        def value(x, mode=mode):
            return run(chain, _along(1.0, 1.0, 1.0, 4.0).at[:, 1].add(x), mode=mode)[0]

        values, slope = value(0.0), jax.jacfwd(value)(0.0)
        assert np.isfinite(values).all()
        assert np.isfinite(slope).all()
        assert values[-1] >= -2.0


def test_one_goal_is_the_plain_reward():
    rng = np.random.default_rng(0)
    latents = jnp.asarray(rng.normal(size=(3, 6, 4)), jnp.float32)
    length = jnp.array([6, 4, 5])
    chain = make(latents, (length - 1)[:, None], length)
    ends = latents[jnp.arange(3), length - 1]
    plain = reward.from_latents({}, latents[:, 0], ends)
    np.testing.assert_allclose(chain.goals[0], plain.goal, rtol=1e-5, atol=1e-6)
    for mode in ("continuous", "stepped"):
        values, _ = run(chain, latents[1], mode=mode)
        np.testing.assert_allclose(values, reward.latent_reward(plain, latents[1]), atol=1e-5)


# --- chains from demonstrations


def _demos():
    """Three demonstrations along a line at other speeds, with a goal at 1, at 3 and at 4."""
    knots = [[0, 3, 8, 10], [0, 5, 9, 11], [0, 2, 6, 9]]
    x = np.stack([np.interp(np.arange(12), k, [0.0, 1.0, 3.0, 4.0]) for k in knots])
    noise = 0.02 * np.random.default_rng(0).normal(size=(3, 12, 2))
    latents = np.stack([x, 0 * x], axis=-1) + noise
    return jnp.asarray(latents, jnp.float32), jnp.asarray(knots)[:, 1:], jnp.array([11, 12, 10])


def test_goals_scales_and_radii_are_those_of_a_loop():
    latents, ends, length = _demos()
    ends = ends.at[2, 1].set(-1)  # one lacks the second boundary
    chain = make(latents, ends, length)
    z, ends, starts = np.asarray(latents), np.asarray(ends), np.asarray(ends)
    for stage in range(3):
        has = [b for b in range(3) if ends[b, stage] >= 0]
        goal = np.mean([z[b, ends[b, stage]] for b in has], axis=0)
        started = [b for b in has if stage == 0 or starts[b, stage - 1] >= 0]
        first = [z[b, starts[b, stage - 1] if stage else 0] for b in started]
        scale = 1 / np.mean([np.linalg.norm(s - goal) for s in first])
        near = [scale * np.linalg.norm(z[b, ends[b, stage]] - goal) for b in has]
        np.testing.assert_allclose(chain.goals[stage], goal, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(chain.scale[stage], scale, rtol=1e-4)
        expected = np.clip(np.quantile(near, 0.9), 0.05, 0.5)
        np.testing.assert_allclose(chain.radius[stage], expected, rtol=1e-3)
    assert chain.count == 3


def test_a_chain_from_shared_boundaries_follows_its_demonstrations():
    latents, ends, length = _demos()
    found = jnp.concatenate([ends, jnp.full((3, 1), -1)], axis=1)

    @jax.jit
    def chain_of(latents, found, length):
        shared = matching.shared_boundaries(latents, found, length, tolerance=0.5)
        return subtask_chain.from_latents(latents, shared.frames, length, kept=shared.kept)

    chain = chain_of(latents, found, length)
    assert chain.count == 3
    for demo in range(3):
        for mode in ("continuous", "stepped"):
            values, indices = run(chain, latents[demo, : int(length[demo])], mode=mode)
            assert indices[-1] == 3
            assert values[0] == pytest.approx(-1, abs=0.05)
            assert values[-1] == pytest.approx(0, abs=0.05)
            assert (jnp.diff(values) > -0.05).all()


def test_without_boundaries_the_last_frames_are_the_only_goal():
    latents, _, length = _demos()
    expected = latents[jnp.arange(3), length - 1].mean(axis=0)
    for none in (jnp.zeros((3, 0), jnp.int32), jnp.full((3, 2), -1)):
        chain = make(latents, none, length)
        np.testing.assert_allclose(chain.goals[0], expected, rtol=1e-5, atol=1e-6)
        assert chain.count == 1
        assert np.isfinite(np.concatenate([x.flatten() for x in chain[:3]])).all()


# --- errors


def test_arguments_that_do_not_fit_are_refused():
    step, make = (inspect.unwrap(getattr(subtask_chain, f)) for f in ("step", "from_latents"))
    start, latent = subtask_chain.init(), jnp.zeros(2)
    with pytest.raises(ShapeError, match=r"goals has shape \(4, 2\) but latent has shape \(3,\)"):
        step(CHAIN, start, jnp.zeros(3))
    with pytest.raises(ConfigError, match="mode is 'jump'"):
        step(CHAIN, start, latent, mode="jump")
    for name in ("bonus", "fallback"):
        with pytest.raises(ConfigError, match=rf"{name} is -1\.0"):
            step(CHAIN, start, latent, **{name: -1.0})
    latents, ends, length = _demos()
    with pytest.raises(ShapeError, match=r"boundaries has shape \(2, 3\)"):
        make(latents, ends[:2], length)
    with pytest.raises(ShapeError, match=r"length has shape \(2,\)"):
        make(latents, ends, length[:2])
    with pytest.raises(ConfigError, match=r"radius is 0\.0"):
        make(latents, ends, length, radius=0.0)
