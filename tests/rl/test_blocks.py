"""Blocks of environments: how many, and that nothing leaves its own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.rl import blocks


@pytest.mark.parametrize(
    ("num_envs", "minibatches", "count"),
    [
        (1, 1, 1),
        (64, 4, 1),
        (511, 1, 1),  # two would have too few environments each
        (512, 4, 2),
        (8192, 4, 32),
        (32768, 4, 64),
        (2**20, 4, 64),  # as many as are of use
        (3 * 1024, 4, 8),  # at least 256 each, 384 here
        (1000, 4, 2),  # three would not divide it
        (1001, 7, 1),
        (4096, 1024, 4),  # a block of 1024 still has one for each minibatch
    ],
)
def test_blocks_are_large_and_divide_evenly_into_minibatches(num_envs, minibatches, count):
    found = blocks.count(num_envs, minibatches)
    assert found == count
    assert num_envs % (found * minibatches) == 0


def test_the_number_of_blocks_for_all_environments_is_one_of_those_that_devices_can_share():
    """A seed on 2, 4 or 8 devices has whole blocks on each, both of lanes and of minibatches."""
    for devices in (2, 4, 8):
        for each in (1024, 4096, 8192):
            assert blocks.count(devices * each) % devices == 0
            assert blocks.count(devices * each, 4) % devices == 0


def test_to_split_and_to_join_are_each_others_inverse():
    tree = {"a": jnp.arange(12.0).reshape(6, 2), "b": jax.random.split(jax.random.key(0), 6)}
    parts = blocks.split(tree, 3)
    assert parts["a"].shape == (3, 2, 2)
    assert parts["b"].shape == (3, 2)
    whole = blocks.join(parts)
    np.testing.assert_array_equal(whole["a"], tree["a"])
    np.testing.assert_array_equal(*(jax.random.key_data(x["b"]) for x in (whole, tree)))


def _dealt(num_envs, number, key):
    """For each minibatch, which environments are in it; and rows of theirs."""
    tree = {"who": jnp.arange(num_envs), "row": jnp.arange(3.0 * num_envs).reshape(num_envs, 3)}
    found = jax.jit(blocks.minibatches, static_argnums=2)(tree, key, number)
    expected = np.asarray(tree["row"])[np.asarray(found["who"])]
    np.testing.assert_array_equal(found["row"], expected, err_msg="leaves are dealt alike")
    return np.asarray(found["who"])


@pytest.mark.parametrize(("num_envs", "number"), [(8, 1), (8, 4), (1024, 4), (1000, 5), (4096, 2)])
def test_each_environment_is_in_one_minibatch_and_each_block_gives_to_all_alike(num_envs, number):
    who = _dealt(num_envs, number, jax.random.key(1))
    assert who.shape == (number, num_envs // number)
    assert sorted(who.ravel()) == list(range(num_envs))
    size = num_envs // blocks.count(num_envs, number)
    for minibatch in who:
        assert set(np.bincount(minibatch // size)) == {size // number}


def test_minibatches_of_one_block_are_a_plain_shuffle():
    key = jax.random.key(2)
    order = np.argsort(np.asarray(jax.random.bits(key, (60,))), kind="stable")
    np.testing.assert_array_equal(_dealt(60, 4, key), order.reshape(4, 15))


def test_an_environment_meets_every_minibatch_and_every_other_of_its_block():
    """Over many shuffles, each as often as chance has it."""
    keys = jax.random.split(jax.random.key(3), 400)
    shuffle = jax.vmap(lambda key: blocks.minibatches(jnp.arange(512), key, 4))
    who = np.asarray(jax.jit(shuffle)(keys))  # (400, 4, 128)
    where = np.argsort(who.reshape(400, -1), axis=1) // 128  # minibatch of each environment
    shares = np.stack([(where == number).mean(0) for number in range(4)])
    assert abs(shares - 0.25).max() < 5 * np.sqrt(0.25 * 0.75 / 400)
    together = (where == where[:, :1]).mean(0)[1:]  # with environment 0
    assert abs(together - 0.25).max() < 5 * np.sqrt(0.25 * 0.75 / 400)


def test_seeds_beside_each_other_are_shuffled_as_alone():
    keys = jax.random.split(jax.random.key(4), 3)
    together = jax.vmap(lambda key: blocks.minibatches(jnp.arange(512), key, 2))(keys)
    for key, found in zip(keys, together, strict=True):
        np.testing.assert_array_equal(found, blocks.minibatches(jnp.arange(512), key, 2))
