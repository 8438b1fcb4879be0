"""The kernel against the XLA engine, step by step, and inside JAX's transformations."""

import functools
import importlib
import importlib.util
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical import simulator
from gril_jax.envs.planar import shapes
from gril_jax.envs.planar.joints import Strengths

from gril_jax import envs

LANES, STEPS = 32, 40
INSTALLED = importlib.util.find_spec("warp") is not None
with_warp = pytest.mark.skipif(not INSTALLED, reason="warp-lang is not installed")
# From any layout, the robot often before a block, so that most of the states have contacts.
STARTS = dict(variant="all", varied_starts=1.0, facing=1.0)
CASES = [("gripper", "xmagical")]
CASES += [
    pytest.param(*case, marks=pytest.mark.slow)
    for case in (
        ("gripper", "magical"),
        ("short", "xmagical"),
        ("long", "magical"),
        ("medium", "xmagical"),
    )
]


@functools.cache
def _env(robot="gripper", physics="xmagical", engine="kernel"):
    return envs.make("match_regions", robot=robot, physics=physics, engine=engine, **STARTS)


def _starts(env, lanes=LANES):
    return jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), lanes))


def _arguments(env, state, action):
    """Arguments of the engines' `step`."""
    data, command = state.data, env._command(action)
    scene = data.pose, data.velocity, data.memory, shapes.blocks(data.shape)
    return *scene, Strengths(*data.strengths), command


def _actions(size, steps=STEPS, lanes=LANES):
    """Random actions (steps, lanes, size), held for a while, mostly forward and little turned."""
    rng = np.random.default_rng(1)
    held = rng.uniform(-1, 1, (-(-steps // 5), lanes, size))
    held[..., 0] = np.abs(held[..., 0]) * rng.choice([1, 1, 1, -1], held.shape[:2])
    held[..., 1] *= rng.choice([0.05, 1.0], held.shape[:2])
    return jnp.asarray(np.repeat(held, 5, axis=0)[:steps], jnp.float32)


def _apart(robot, physics):
    """Largest differences of poses, velocities and memories (steps, lanes), and of contacts.

    Each control step begins in a state of the XLA engine's.
    """
    one, other = (_env(robot, physics, engine) for engine in ("impulse", "kernel"))
    contacts = 3 * (len(one.blocks) + 1) + (0 if robot != "gripper" else 12)

    def compared(state, action):
        given = _arguments(one, state, action)
        a, b = one._engine.step(*given), other._engine.step(*given)
        errors = [jnp.abs(x - y).max() for x, y in zip(a, b, strict=True)]
        moved = state.data._replace(**dict(zip(("pose", "velocity", "memory"), a, strict=True)))
        return state._replace(data=moved), (*errors, (a[2][:-contacts] > 0).sum())

    play = jax.jit(lambda s, a: jax.lax.scan(lambda s, a: jax.vmap(compared)(s, a), s, a))
    return [np.asarray(x) for x in play(_starts(one), _actions(one.action_size))[1]]


@with_warp
@pytest.mark.parametrize(("robot", "physics"), CASES)
def test_a_control_step_is_that_of_the_xla_engine(robot, physics):
    """But for rounding, to which a few pinched blocks are sensitive."""
    pose, velocity, memory, contacts = _apart(robot, physics)
    assert (contacts > 0).mean() > 0.3
    assert (contacts > 2).any()
    for error in (pose, memory):
        assert np.median(error) < 2e-6
        assert np.quantile(error, 0.9) < 1e-4
        assert (error > 1e-3).mean() < 0.02
    assert np.median(velocity) < 5e-5


@with_warp
@pytest.mark.parametrize("robot", ["gripper", pytest.param("short", marks=pytest.mark.slow)])
def test_extreme_actions_keep_all_finite_and_inside(robot):
    env = _env(robot)
    rng = np.random.default_rng(2)
    actions = np.repeat(rng.choice([-1.0, 1.0], (20, LANES, env.action_size)), 10, axis=0)

    def move(state, action):
        state = jax.vmap(env.step)(state, action)
        return state, (state.data.pose, state.data.velocity, state.data.memory)

    _, moved = jax.jit(lambda s, a: jax.lax.scan(move, s, a))(_starts(env), np.float32(actions))
    assert all(np.isfinite(x).all() for x in moved)
    robots = np.asarray(moved[0])[..., :1, :2]
    assert np.abs(robots).max() < env.arena


def _leaves(found):
    return [np.asarray(x) for x in found]


@with_warp
def test_a_step_is_the_same_in_a_program_and_outside_and_each_time():
    env = _env()
    state = jax.tree.map(lambda x: x[3], _starts(env))
    given = _arguments(env, state, jnp.array([1.0, 0.3, 0.2]))
    plain = type(env._engine).step.__wrapped__
    found = [_leaves(env._engine.step(*given)) for _ in range(2)]
    found.append(_leaves(plain(env._engine, *given)))
    for again in found[1:]:
        for a, b in zip(found[0], again, strict=True):
            np.testing.assert_array_equal(a, b)
    assert not np.array_equal(found[0][0], given[0])


@with_warp
def test_lanes_of_lanes_are_single_ones():
    env = _env()
    state, action = _starts(env, 6), _actions(3, 1, 6)[0]
    nested = jax.tree.map(lambda x: x.reshape(2, 3, *x.shape[1:]), (state, action))
    step = lambda s, a: env._engine.step(*_arguments(env, s, a))  # noqa: E731
    found = jax.jit(jax.vmap(jax.vmap(step)))(*nested)
    for lane in range(6):
        single = step(*jax.tree.map(lambda x, lane=lane: x[lane], (state, action)))
        for many, one in zip(found, single, strict=True):
            np.testing.assert_allclose(many[divmod(lane, 3)], one, atol=1e-6)


@with_warp
def test_shapes_that_all_lanes_share_are_those_of_each():
    env = envs.make("match_regions", engine="kernel")
    state, action = _starts(env, 4), _actions(3, 1, 4)[0]
    each = jax.vmap(lambda s, a: env._engine.step(*_arguments(env, s, a)))(state, action)
    shared = jax.vmap(env.step)(state, action).data
    np.testing.assert_allclose(shared.pose, each[0], atol=1e-6)


@with_warp
def test_it_begins_and_measures_by_the_xla_engine():
    one, other = (_env(engine=engine)._engine for engine in ("impulse", "kernel"))
    assert other.physics is one
    np.testing.assert_array_equal(one.rest(), other.rest())


def test_without_the_package_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "gril_jax.envs.planar.kernel.engine", None)
    simulator._in_a_kernel.cache_clear()
    with pytest.raises(ValueError, match=r"engine is 'kernel', .* pip install warp-lang"):
        envs.make("match_regions", engine="kernel")


@with_warp
def test_threads_share_out_lanes_without_a_trace(monkeypatch):
    lanes = importlib.import_module("gril_jax.envs.planar.kernel.engine")
    env, found = _env(), []
    state, action = _starts(env, 200), _actions(3, 1, 200)[0]
    step = jax.jit(jax.vmap(lambda s, a: env._engine.step(*_arguments(env, s, a))))
    for cores in (1, 3):
        monkeypatch.setattr(lanes, "_cores", lambda cores=cores: cores)
        assert len(lanes._shares(200)) == cores
        found.append(_leaves(step(state, action)))
    for one, three in zip(*found, strict=True):
        np.testing.assert_array_equal(one, three)


@with_warp
def test_gradients_are_refused_in_one_sentence():
    env = _env()
    state, action = jax.jit(env.reset)(jax.random.key(0)), jnp.zeros(env.action_size)
    with pytest.raises(ValueError, match="engine 'kernel' has no gradients: make"):
        jax.grad(lambda a: env.step(state, a).data.pose.sum())(action)


@with_warp
def test_auto_is_the_kernel_where_it_runs_and_says_so(monkeypatch):
    assert envs.make("match_regions").engine == "kernel"
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.warns(UserWarning, match="slower than they could: pip install warp-lang"):
        assert envs.make("match_regions").engine == "impulse"


@with_warp
def test_where_the_cache_cannot_be_written_a_temporary_one_is_taken(monkeypatch):
    from gril_jax.envs.planar.kernel import engine

    tried = []

    def init():
        tried.append(engine.wp.config.kernel_cache_dir)
        if len(tried) == 1:
            raise OSError(30, "Read-only file system")

    monkeypatch.setattr(engine.wp, "init", init)
    monkeypatch.setattr(engine.wp.config, "kernel_cache_dir", None)
    engine._begin()
    assert tried == [None, engine._scratch().name]
