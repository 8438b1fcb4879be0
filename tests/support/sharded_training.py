"""Tiny trainings over seeds, for processes with as many devices as a test wants."""

import math
import re

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax.compilation import sharding
from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.pretraining import pretrain
from gril_jax.rl import ppo, rewards, sac, training
from support.kinematic_demos import kinematic_demos
from support.probes import Probe

SIZES = {"num_envs": 16, "unroll_length": 2, "hidden": (8,), "window": 4}
CAPACITY = 2**16
REPLAY_BYTES = CAPACITY * 4 * (2 * 5 + 1 + 3)  # two observations, an action, three numbers


def algorithm(name):
    """PPO or SAC on the probe; SAC learns from its second unroll on."""
    if name == "ppo":
        return ppo.PPO(Probe(), rewards.environmental, ppo.Static(num_minibatches=2, **SIZES))
    more = {"updates_per_step": 1, "batch_size": 8, "replay_size": CAPACITY, "min_replay": 64}
    return sac.SAC(Probe(), rewards.environmental, sac.Static(**more, **SIZES))


def begin(name, devices, seeds):
    """A fresh chunk for each seed on these devices, the program of two updates, its inputs.

    The seeds differ in their learning rates, too.
    """
    made = algorithm(name)
    layout = sharding.mesh(devices, seeds=seeds, num_envs=made.num_envs)
    hyper = (ppo if name == "ppo" else sac).Hyper()
    hyper = hyper._replace(learning_rate=jnp.linspace(1e-3, 1e-2, seeds))
    hyper = jax.tree.map(lambda x: jnp.broadcast_to(jnp.float32(x), (seeds,)), hyper)
    hyper = sharding.place(layout, hyper)
    keys = jax.vmap(jax.random.key)(jnp.arange(seeds))
    state = sharding.init(made, layout, keys, hyper)
    params = sharding.place(layout, jnp.zeros(seeds))
    run, shapes = sharding.advance(made, layout, state, hyper, params, 2, (Probe(),))
    last = 2 + training.rounds(made)
    return sharding.begun(state, shapes), run, (hyper, params, 0, last, 2)


def train(name, devices, seeds, chunks=2):
    """The training after some chunks, and the last one's scores."""
    state, run, inputs = begin(name, devices, seeds)
    for _ in range(chunks):
        state, found = run(state, *inputs)
    assert run._cache_size() == 1, "a state comes out laid out otherwise than it came in"
    return state, found


def temporary_bytes(name, devices, seeds):
    """Bytes that a chunk's program holds on each device beside its inputs and outputs."""
    state, run, inputs = begin(name, devices, seeds)
    return run.lower(state, *inputs).compile().memory_analysis().temp_size_in_bytes


def exchanged(name, devices, seeds):
    """The most numbers that any operation of a chunk's program moves from device to device.

    Neither sums over devices, as those of gradients, nor keys are counted.
    """
    state, run, inputs = begin(name, devices, seeds)
    text = run.lower(state, *inputs).compile().as_text()
    moved = re.findall(r"= (.*) (?:all-gather|all-to-all|collective-permute)(?:-start)?\(", text)
    assert moved, "scores come back whole to every device: operations are called otherwise"
    arrays = [
        array for shapes in moved for array in re.findall(r"(?:f32|s32|pred)\[(.*?)\]", shapes)
    ]
    return max(math.prod(int(n) for n in array.split(",") if n) for array in arrays)


def pretrained(devices, rows):
    """The metrics of three updates of encoders, each row with its own seed.

    Not the weights: some have no gradient but rounding's, which Adam turns into whole steps.
    """
    layout = sharding.mesh(devices, seeds=rows, num_envs=len(devices))
    demos = jax.tree.map(jnp.asarray, kinematic_demos(0, 4, num_objects=4))
    config = pretrain.Static(
        encoder=EncoderConfig(num_classes=4, width=8, rounds=1, latent=4),
        updates=3, num_videos=2, num_frames=4,
    )  # fmt: skip

    def run(key, hyper):
        return pretrain.step(pretrain.init(key, demos, config), demos, hyper, config)[1]

    keys = sharding.place(layout, jax.vmap(jax.random.key)(jnp.arange(rows)))
    hyper = jax.tree.map(lambda x: jnp.full((rows,), x, jnp.float32), pretrain.Hyper())
    return jax.jit(jax.vmap(run))(keys, sharding.place(layout, hyper))


def numbers(tree):
    """Leaves as NumPy arrays of float64; keys as their data."""

    def plain(leaf):
        key = jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
        return np.asarray(jax.random.key_data(leaf) if key else leaf).astype(np.float64)

    return [plain(leaf) for leaf in jax.tree.leaves(tree)]


def apart(one, other):
    """The largest difference of any two numbers of two trees."""
    pairs = zip(numbers(one), numbers(other), strict=True)
    return max(float(np.abs(a - b).max(initial=0)) for a, b in pairs)
