"""Predicted memory of a training, beside what its compiled program needs, and its splitting."""

import functools

import jax
import jax.numpy as jnp
import pytest
from support.probes import Probe

from gril_jax.compilation import memory
from gril_jax.config import EncoderOptions, RunConfig
from gril_jax.encoders import encoder
from gril_jax.errors import ConfigError
from gril_jax.rl import ppo, rewards, sac, training
from gril_jax.workflows.build import policy_setup, setup

GIB = 2**30
SIZES = {"num_envs": 64, "unroll_length": 4, "hidden": (8,), "window": 4}
HYPER = jax.tree.map(jnp.float32, ppo.Hyper())


def _needed(algorithm, hyper):
    """Bytes that the program for a chunk takes, its state included."""
    state = jax.eval_shape(algorithm.init, jax.random.key(0), hyper)
    chunk = functools.partial(training.chunk, algorithm, updates=2, evaluation=(algorithm.env,))
    program = jax.jit(chunk, donate_argnums=0).lower(state, hyper, jnp.zeros(())).compile()
    found = program.memory_analysis()
    kept = found.argument_size_in_bytes + found.output_size_in_bytes - found.alias_size_in_bytes
    return kept + found.temp_size_in_bytes


def _probe(**more):
    static = ppo.Static(num_minibatches=2, **(SIZES | more))
    return ppo.PPO(Probe(), rewards.environmental, static)


def test_the_prediction_is_near_what_the_program_needs():
    algorithm = _probe()
    predicted = memory.predict_bytes(algorithm, HYPER, jnp.zeros(()))
    assert 0.5 < predicted / _needed(algorithm, HYPER) < 3


@pytest.mark.slow
@pytest.mark.parametrize("sizes", [{"num_envs": 64}, {"num_envs": 1024, "unroll_length": 10}])
def test_the_prediction_is_near_what_the_program_needs_on_a_real_task(sizes):
    config = RunConfig()
    env = setup.make_env(config.env, training=True)
    algorithm = ppo.PPO(env, rewards.environmental, ppo.Static(**sizes))
    hyper = policy_setup.algorithm_hyper(config, "ppo")
    predicted = memory.predict_bytes(algorithm, hyper, jnp.zeros(()))
    assert 0.5 < predicted / _needed(algorithm, hyper) < 3


def test_environments_and_unrolls_cost_memory_and_a_replay_costs_its_size_once():
    def predict(algorithm, hyper=HYPER):
        return memory.predict_bytes(algorithm, hyper, jnp.zeros(()))

    small = predict(_probe())
    assert predict(_probe(num_envs=128)) > 1.9 * small
    assert predict(_probe(unroll_length=64)) > 1.5 * small
    found = []
    for size in (2**12, 2**20):
        static = sac.Static(batch_size=8, replay_size=size, min_replay=64, **SIZES)
        algorithm = sac.SAC(Probe(), rewards.environmental, static)
        found.append(predict(algorithm, jax.tree.map(jnp.float32, sac.Hyper())))
    rows = jax.eval_shape(algorithm.init, jax.random.key(0), sac.Hyper()).replay.rows
    row = sum(x.size * x.dtype.itemsize for x in jax.tree.leaves(rows)) / 2**20
    assert found[1] - found[0] == row * (2**20 - 2**12)


def test_pictures_cost_memory_with_their_area_and_the_number_of_environments():
    params = setup.blank_reward(RunConfig(encoder=EncoderOptions(kind="pixels")), 3)

    def predict(pixels, num_envs, precision="float32"):
        def picture(data):
            return jnp.full((pixels, pixels, 3), data.before > 0, jnp.uint8)

        config = encoder.PixelConfig(pixels=pixels, precision=precision)
        static = ppo.Static(num_minibatches=2, **SIZES | {"num_envs": num_envs})
        algorithm = ppo.PPO(Probe(), rewards.pixels(config, picture), static)
        return memory.predict_bytes(algorithm, HYPER, params)

    # The largest arrays of all are weights in another precision; they do not grow with the lanes.
    more = predict(64, 2048, "bfloat16") - predict(64, 1024, "bfloat16")
    assert 1024 * 3 * 2 * 64 * 32**2 <= more < 1.1 * 1024 * 3 * 4 * 64 * 32**2
    small, large, many = predict(64, 1024), predict(128, 1024), predict(128, 2048)
    assert large - small == 1024 * 3 * 4 * 64 * (64**2 - 32**2)  # outputs of the first layer
    assert 1.9 < many / large < 2
    assert large > 3 * GIB


@pytest.mark.parametrize(
    ("rows", "gib_each", "gib", "devices", "at_once"),
    [
        (10, 1, None, 1, 10),  # not known: all
        (10, 1, 10, 1, 10),
        (10, 1, 9, 1, 5),  # two parts of the same size
        (10, 1, 4, 1, 4),  # 4, 4, 2
        (10, 1, 1, 1, 1),
        (16, 1, 3, 4, 8),  # 12 fit: two parts of 8
        (10, 1, 2, 4, 8),  # 5 each would leave devices idle
        (3, 1, 1, 2, 2),
        (5, 1, 4, 4, 8),  # room for all: one part, whatever the number says
        (2, 2, 1, 4, 2),  # a seed across two devices
    ],
)
def test_seeds_are_split_into_even_parts_that_fit(rows, gib_each, gib, devices, at_once):
    available = None if gib is None else gib * GIB
    assert memory.split(rows, gib_each * GIB, available, devices) == at_once


def test_several_seeds_have_to_fit_with_a_margin_and_one_seed_without():
    assert memory.split(25, GIB, 60 * GIB, margin=3) == 13
    assert memory.split(25, 50 * GIB, 60 * GIB, margin=3) == 1


def test_a_seed_that_cannot_fit_is_refused_and_the_two_knobs_that_help_are_named():
    sentence = "needs about 9.0 GiB but there are 8.0 GiB: lower num_envs or unroll_length, and enc"
    with pytest.raises(ConfigError, match=sentence):
        memory.split(1, 9 * GIB, 4 * GIB, 2)


def test_the_memory_of_this_machine_is_known_or_said_to_be_unknown():
    found = memory.available_bytes(jax.devices()[0])
    assert found is None or found > 2**20


def test_a_device_that_tells_nothing_is_of_unknown_memory():
    class Silent:
        platform = "gpu"

        def memory_stats(self):
            return None

    assert memory.available_bytes(Silent()) is None
