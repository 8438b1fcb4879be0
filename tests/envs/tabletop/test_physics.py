"""Servos at their limit in MJX: a step is that of C MuJoCo, which MJX's own is not."""

import contextlib
import functools
import importlib
import importlib.util
import io

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from gril_jax.envs.tabletop.moves import Hand
from gril_jax.envs.tabletop.physics import constant_where_saturated, driven
from support import tabletop_scenes as scenes

from gril_jax import envs
from gril_jax.config import EnvConfig, PPOConfig, RunConfig, RunSettings
from gril_jax.config.grid import with_seed
from gril_jax.errors import ConfigError
from gril_jax.workflows.build import setup
from gril_jax.workflows.study import programs as sweep_programs
from gril_jax.workflows.study.saved import Row

with contextlib.redirect_stdout(io.StringIO()):
    from mujoco import mjx

# Two joints in a row, whose servos are as stiff, damped and weak as the Panda's.
ARM = """
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.005" integrator="implicitfast"><flag eulerdamp="disable"/></option>
  <worldbody><body><joint name="a" axis="0 1 0" armature="0.1"/>
    <geom type="capsule" size="0.03" fromto="0 0 0 0.4 0 0"/>
    <body pos="0.4 0 0"><joint name="b" axis="0 1 0" armature="0.1"/>
      <geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0"/></body></body></worldbody>
  <actuator>
    <position joint="a" kp="4500" kv="450" forcerange="-87 87" ctrlrange="-2 2"/>
    <position joint="b" kp="2000" kv="200" forcerange="-12 12"/>
  </actuator>
</mujoco>"""
AIMS = np.array([[0.0, 0.0], [0.001, -0.0005], [0.05, 0.3], [-1.5, 3.0], [9.0, -0.2]], np.float32)


def _in_c(model, aim, steps):
    data = mujoco.MjData(model)
    data.ctrl[:] = aim
    for _ in range(steps):
        mujoco.mj_step(model, data)
    return data.qpos.copy()


def _in_mjx(model, aims, steps, *, own):
    at, compiled = driven(model), mjx.put_model(model)
    blank = mjx.make_data(compiled)

    def play(aim):
        def step(data, _):
            held = compiled
            if not own:
                held = constant_where_saturated(compiled, at, data.qpos, data.qvel, aim)
            return mjx.step(held, data), None

        return jax.lax.scan(step, blank.replace(ctrl=aim), length=steps)[0].qpos

    return np.asarray(jax.jit(jax.vmap(play))(jnp.asarray(aims)))


def test_a_step_is_that_of_c_mujoco_at_the_limit_and_below_it():
    model = mujoco.MjModel.from_xml_string(ARM)
    true = np.stack([_in_c(model, aim, 40) for aim in AIMS])
    np.testing.assert_allclose(_in_mjx(model, AIMS, 40, own=False), true, atol=2e-5)


def test_mjx_alone_is_behind():
    """If this fails, MJX has learned it, and `constant_where_saturated` has done its work."""
    model = mujoco.MjModel.from_xml_string(ARM)
    true = np.stack([_in_c(model, aim, 20) for aim in AIMS])
    gap = np.abs(_in_mjx(model, AIMS, 20, own=True) - true).max(axis=1)
    assert gap[:2].max() < 1e-5  # none is at its limit
    assert gap[3:].min() > 0.05


def test_only_saturated_servos_change():
    model = mujoco.MjModel.from_xml_string(ARM)
    compiled, at = mjx.put_model(model), driven(model)
    state = jnp.array([0.1, 0.0]), jnp.array([0.0, 0.02])  # forces 4500 (aim - 0.1), 2000 aim - 4
    held = constant_where_saturated(compiled, at, *state, jnp.array([0.5, 0.003]))
    assert held.actuator_gainprm[:, 0].tolist() == [0.0, 2000.0]
    np.testing.assert_allclose(held.actuator_biasprm[:, :3], [[87, 0, 0], [0, -2000, -200]])
    beyond = constant_where_saturated(compiled, at, *state, jnp.array([-9.0, -0.005]))
    np.testing.assert_allclose(beyond.actuator_biasprm[:, :3], [[-87, 0, 0], [-12, 0, 0]])


@pytest.mark.parametrize(
    "servo",
    ['<position joint="a" kp="9" gear="2" forcerange="-1 1"/>', '<position joint="a" kp="9"/>'],
    ids=["gear", "no limit"],
)
def test_a_servo_with_a_gear_or_without_a_limit_is_refused(servo):
    text = ARM[: ARM.index("<actuator>")] + f"<actuator>{servo}</actuator></mujoco>"
    with pytest.raises(ValueError, match="a joint without a gear, its force limited"):
        driven(mujoco.MjModel.from_xml_string(text))


# --- MuJoCo Warp in place of MJX: equal behaviour, and a sentence where it is not installed

LANES = 4
INSTALLED = importlib.util.find_spec("warp") is not None
with_warp = pytest.mark.skipif(not INSTALLED, reason="warp-lang is not installed")


@functools.cache
def _env(engine):
    config = EnvConfig(name="shoes_in_box", reward="staged", engine=engine, max_envs=64)
    return setup.make_env(config, training=False)


@functools.cache
def _step(engine):
    return jax.jit(jax.vmap(_env(engine).step))


@pytest.fixture(scope="module")
def starts():
    return jax.jit(jax.vmap(_env("auto").reset))(jax.random.split(jax.random.key(0), LANES))


def _qpos(states):
    return np.asarray(states.data.motion.qpos)


def _lanes(starts):
    return [jax.tree.map(lambda x, i=i: x[i], starts) for i in range(LANES)]


@with_warp
def test_a_step_is_that_of_c_mujoco(starts):
    actions = np.random.default_rng(0).uniform(-1, 1, (LANES, 5)).astype(np.float32)
    after = {name: _step(name)(starts, jnp.asarray(actions)) for name in ("auto", "warp")}
    plays = [Hand(_env("auto"), lane) for lane in _lanes(starts)]
    for play, action in zip(plays, actions, strict=True):
        play.act(action)
    true = np.stack([play.qpos for play in plays])
    np.testing.assert_allclose(_qpos(after["warp"]), true, atol=1e-4)
    np.testing.assert_allclose(_qpos(after["auto"]), true, atol=1e-4)
    shapes = [[(x.shape, x.dtype) for x in jax.tree.leaves(state)] for state in after.values()]
    assert shapes[0] == shapes[1]


@with_warp
def test_kernels_do_not_report_among_what_a_command_prints(monkeypatch):
    warp = importlib.import_module("warp")
    monkeypatch.setattr(warp.config, "log_level", warp.LOG_INFO)
    assert _env.__wrapped__("warp").observation_size  # made anew
    assert warp.config.log_level == warp.LOG_WARNING


@with_warp
def test_only_what_is_lost_is_told_of():
    """Not each solution that ends at the iterations' limit, but contacts without room."""
    kinds = importlib.import_module("mujoco.mjx.third_party.mujoco_warp").OverflowType
    told = _env("warp").physics._model.opt._impl.warn_overflow
    assert not told & (kinds.ITERATIONS | kinds.LS_ITERATIONS)
    assert told & kinds.NEFC
    assert told & kinds.NARROWPHASE


@with_warp
def test_lanes_of_lanes_are_lanes(starts):
    action = jnp.zeros((LANES, 5))
    nested = jax.tree.map(lambda x: x.reshape(2, LANES // 2, *x.shape[1:]), (starts, action))
    found = jax.jit(jax.vmap(jax.vmap(_env("warp").step)))(*nested)
    flat = _step("warp")(starts, action)
    np.testing.assert_array_equal(_qpos(found).reshape(LANES, -1), _qpos(flat))


@with_warp
@pytest.mark.slow
def test_a_whole_episode_of_the_expert_ends_alike(starts):
    """Open loop: an expert's actions in C MuJoCo, replayed."""
    plays = [scenes.box_filled(_env("auto"), lane, i) for i, lane in enumerate(_lanes(starts))]
    actions = [np.array(play.actions) for play in plays]
    length = max(map(len, actions))
    rest = np.array([0, 0, 0, 0, 1])
    held = [np.concatenate([a, np.tile(a[-1] * rest, (length - len(a), 1))]) for a in actions]
    ends = {}
    for engine in ("auto", "warp"):
        states, ends[engine] = starts, [None] * LANES
        for moment, action in enumerate(np.stack(held, axis=1).astype(np.float32), start=1):
            states = _step(engine)(states, jnp.asarray(action))
            for i, played in enumerate(actions):
                if moment == len(played):
                    ends[engine][i] = _qpos(states)[i, 10:].reshape(2, 7)[:, :3]
        assert (np.asarray(states.metrics["score"]) == 1).mean() >= 0.75
    true = [play.qpos[10:].reshape(2, 7)[:, :3] for play in plays]
    gaps = {
        name: [np.abs(a - b).max() for a, b in zip(found, true, strict=True)]
        for name, found in ends.items()
    }
    assert np.median(gaps["warp"]) < 0.01, gaps


@with_warp
def test_a_sweep_runs_as_many_seeds_at_once_as_there_is_room_for():
    env = EnvConfig(
        name="shoes_in_box", reward="staged", engine="warp", max_envs=160, varied_starts=0.0
    )
    run = RunSettings(reward="environmental", eval_episodes=64)
    config = RunConfig(env=env, ppo=PPOConfig(num_envs=64), run=run)
    rows = [Row(0, seed, with_seed(config, seed)) for seed in range(3)]
    found = sweep_programs.programs(rows, 7, jax.devices())
    assert [len(program.rows) for program in found] == [2, 1]


@pytest.mark.skipif(INSTALLED, reason="warp-lang is installed")
def test_without_the_package_a_sentence_says_what_to_install():
    with pytest.raises(ConfigError, match=r"impl is 'warp', .* pip install 'gril-jax\[warp\]'"):
        _env("warp")


def test_an_unknown_implementation_and_another_task_are_refused():
    with pytest.raises(ValueError, match="impl is 'cpp', but must be one of jax, warp"):
        envs.make("shoes_in_box", impl="cpp")
    with pytest.raises(ConfigError, match="'warp', but match_regions has other engines"):
        setup.make_env(EnvConfig(engine="warp"), training=False)
    with pytest.raises(ValueError, match="worlds is 0"):
        envs.make("shoes_in_box", worlds=0)
