"""The pure rooms and a policy's training under JAX's checks, and with 64 bits."""

import functools
import gc

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.audit_tasks import one_shoe, sound, start
from support.kinematic_demos import kinematic_demos
from support.probes import Probe
from support.saved_rewards import CLASSES, CONFIGS, boxes, made, moment

from gril_jax import graphs, losses, metrics, reward, subtasks
from gril_jax.audit.ascent import search
from gril_jax.audit.made import make_states, rewards_of
from gril_jax.encoders import encoder
from gril_jax.graphs.activity_rule import ActivityRule
from gril_jax.pretraining import pretrain
from gril_jax.pretraining.pretrain import Hyper, Static
from gril_jax.rl import ppo, rewards, sac

PARAMS = made(CONFIGS["paper"])  # here, since it is kept: a trace must not make it


def _random(*shape, seed=0):
    return jnp.asarray(np.random.default_rng(seed).normal(size=shape), jnp.float32)


def _graphs():
    """Bits, whole and frame by frame, of objects one of which stands still."""
    center, size = boxes(6)
    rule = {"window": 2, "smoothing": 3, "noise": 0.01, "tau": 0.01}
    bits = jax.jit(functools.partial(graphs.activity.trajectory, **rule))(center, size)
    label = jnp.array([0, 1, 2, 3, 3])
    graph = graphs.scene_graph(center[0], size[0], label, label == 1, bits[-1])
    return bits, graph.edges


def _encoders(kind):
    config = CONFIGS[kind]
    params = encoder.init(jax.random.key(0), config)
    value = lambda params: encoder.apply(params, moment(config), config).sum()  # noqa: E731
    return jax.jit(jax.value_and_grad(value))(params)


def _losses():
    latents, times = _random(3, 6, 4), jnp.tile(jnp.linspace(0.0, 1.0, 6), (3, 1))
    valid = jnp.arange(6) < jnp.array([6, 4, 3])[:, None]
    lengths = jnp.array([6, 4, 3])

    def total(x, gamma):
        cycles = losses.mean_consistency(x, times, valid)
        drawn = losses.stochastic_consistency(jax.random.key(0), x, times, valid, num_cycles=5)
        warped = losses.soft_dtw_divergence(x, x[::-1], lengths, lengths[::-1], gamma=gamma)
        return jax.tree.reduce(jnp.add, jax.tree.map(jnp.sum, (cycles, drawn, warped)))

    return jax.jit(jax.value_and_grad(total, argnums=(0, 1)))(latents, jnp.float32(0.1))


def _reward():
    rule = ActivityRule(window=2)
    learned = reward.LearnedReward(
        PARAMS, CONFIGS["paper"], CLASSES, ("robot",), CLASSES + ("star",), rule
    )
    center, size = boxes(6)
    paid = jax.jit(lambda center: learned.trajectory(center, size))
    slope = jax.jit(jax.grad(lambda center: paid(center).sum()))(center)
    values = paid(center)
    return values, slope, reward.shaping.step(values[:-1], values[1:], discount=0.9)


def _metrics():
    x, y, success = _random(6, 4), _random(5, 4, seed=1), jnp.arange(6) > 3
    return (
        metrics.alignment_tau(x, y), metrics.mean_alignment_tau(_random(3, 6, 4)),
        metrics.two_way_cycle_consistency(_random(3, 6, 4)), metrics.kendall_tau(x[:, 0]),
        metrics.separation.ratio(x[:, 0], success), metrics.success_auc(x[:, 0], success),
        metrics.interquartile_mean(x),
        metrics.interquartile_interval(jax.random.key(0), x[:, 0], num_resamples=20),
    )  # fmt: skip


def _subtasks():
    steps = jnp.repeat(jnp.array([-1.0, -0.6, -0.3, 0.0]), 25)
    traces = jnp.stack([steps + 0.01 * _random(100, seed=i) for i in range(3)])
    length = jnp.array([100, 100, 90])
    patience, found = subtasks.agreed_stages(traces, length, smoothing=5)
    alone = subtasks.each_alone(traces, length, smoothing=5, patience=patience)
    features, cut = _random(3, 100, 2), jnp.tile(jnp.array([30, 60, -1]), (3, 1))
    shared = subtasks.shared_boundaries(features, cut, length, tolerance=1.0)
    return patience, found, alone, shared, subtasks.transitions(steps)


def _audit():
    task = one_shoe()
    starts = jax.tree.map(lambda x: x[None], start())
    states = jax.vmap(functools.partial(make_states, task=task, side=3))(
        jax.random.split(jax.random.key(0), 1), starts
    )
    params = jnp.float32(1)
    found = search(sound(task), params, jax.random.key(1), task, start(), ascents=4, steps=3)
    # Not `measure`, whose accuracy of a factor is NaN where a task has no pair of it.
    # A search has -inf for a kind of which it met no state.
    found = found._replace(reward=jnp.maximum(found.reward, -9))
    return found, rewards_of(sound(task), params, states)


def _pretraining():
    demos = jax.tree.map(jnp.asarray, kinematic_demos(0, 4, num_objects=4, max_length=40))
    config = Static(
        encoder=encoder.EncoderConfig(num_classes=4, width=4, rounds=1, latent=3),
        updates=2, num_videos=2, num_frames=4, num_perturbations=1,
    )  # fmt: skip
    state = pretrain.init(jax.random.key(0), demos, config)
    state, values = pretrain.step(state, demos, Hyper(), config)
    figures = pretrain.evaluate(state.params.encoder, demos, demos, Hyper(), config)
    return state.params, values, figures


def _policy(module, name, static):
    algorithm = getattr(module, name)(Probe(), rewards.environmental, static)
    hyper = module.Hyper(*map(jnp.float32, module.Hyper()))
    state = jax.jit(algorithm.init)(jax.random.key(0), hyper)
    # A scan, whose state must keep its types.
    steps = jax.jit(lambda s: jax.lax.scan(lambda s, _: algorithm.step(s, hyper, ()), s, length=2))
    state, values = steps(state)
    return algorithm.policy(state), values


PPO = ppo.Static(num_envs=4, unroll_length=4, num_minibatches=2, num_epochs=1, hidden=(4,))
SAC = sac.Static(
    num_envs=4, unroll_length=2, updates_per_step=1, batch_size=4, replay_size=64, min_replay=8,
    hidden=(4,),
)  # fmt: skip
ROOMS = {
    "graphs": _graphs,
    **{f"encoders, {kind}": functools.partial(_encoders, kind) for kind in CONFIGS},
    "losses": _losses,
    "reward": _reward,
    "metrics": _metrics,
    "subtasks": _subtasks,
    "audit": _audit,
    "pretraining": _pretraining,
    "rl, ppo": functools.partial(_policy, ppo, "PPO", PPO),
    "rl, sac": functools.partial(_policy, sac, "SAC", SAC),
}


# optax's Adam and brax's statistics of observations mix types themselves.
OTHERS_PROMOTE = {"pretraining", "rl, ppo", "rl, sac"}

LONG = {
    "pretraining", "encoders, pixel", "encoders, ensemble", "encoders, history", "rl, sac",
}  # fmt: skip


MOST = [pytest.param(room, marks=[pytest.mark.slow] * (room in LONG)) for room in ROOMS]


@pytest.fixture(scope="module", autouse=True)
def _leaks_are_sought_in_what_is_new():
    """JAX seeks them among all objects after each trace: what there is before is left out."""
    gc.collect()
    gc.freeze()


@pytest.mark.parametrize("room", MOST)
def test_a_room_makes_no_nan_leaks_no_tracer_and_promotes_no_type_silently(room):
    promotion = "standard" if room in OTHERS_PROMOTE else "strict"
    with jax.debug_nans(True), jax.checking_leaks(), jax.numpy_dtype_promotion(promotion):
        found = jax.device_get(jax.jit(ROOMS[room])())
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))


def test_a_leak_would_be_found():
    kept = []
    with jax.checking_leaks(), pytest.raises(Exception, match="Leaked trace"):
        jax.jit(lambda x: kept.append(x) or x)(1.0)


@pytest.mark.parametrize("room", MOST)
def test_a_room_is_traced_with_64_bits(room):
    with jax.enable_x64(True):
        jax.eval_shape(ROOMS[room])
