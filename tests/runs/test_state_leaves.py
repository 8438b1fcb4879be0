"""A state's leaves: copies that outlive donation, and a digest that tells states apart."""

import hashlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.runs.checkpoints.state_leaves import digest, host_copy, like_of, to_device

STATE = {"w": jnp.arange(6.0).reshape(2, 3), "key": jax.random.key(3), "n": jnp.int32(4), "x": 1.5}


def test_leaves_have_names_kinds_and_their_own_memory():
    leaves = host_copy(STATE)
    assert [leaf.path for leaf in leaves] == ["key", "n", "w", "x"]
    assert leaves[0].key == str(jax.random.key_impl(STATE["key"]))
    assert [leaf.key for leaf in leaves[1:]] == [None] * 3
    assert all(leaf.array.flags.owndata for leaf in leaves)
    np.testing.assert_array_equal(leaves[2].array, STATE["w"])


def test_a_copy_outlives_the_donation_of_what_was_copied():
    # A view of a buffer on a CPU would change with it.
    double = jax.jit(lambda x: x * 2, donate_argnums=0)
    state = jnp.arange(1000.0)
    (leaf,) = host_copy(state)
    for _ in range(3):
        state = double(state)
    np.testing.assert_array_equal(leaf.array, np.arange(1000.0))


def test_shapes_are_known_without_values():
    for leaf, copied in zip(jax.tree.leaves(STATE), host_copy(STATE), strict=True):
        assert like_of(leaf) == (copied.key, copied.array.dtype.name, copied.array.shape)


def test_a_leaf_comes_back_on_the_device():
    for leaf, copied in zip(jax.tree.leaves(STATE), host_copy(STATE), strict=True):
        back = to_device(copied.array, leaf)
        assert back.dtype == jnp.asarray(leaf).dtype
        assert bool((back == leaf).all())


def test_the_digest_is_sha_256_over_heads_and_bits():
    total = hashlib.sha256()
    for leaf in host_copy(STATE):
        total.update(repr((leaf.path, leaf.key, leaf.array.dtype.name, leaf.array.shape)).encode())
        total.update(leaf.array.tobytes())
    assert digest(STATE) == total.hexdigest()


@pytest.mark.parametrize(
    "change",
    [
        {"w": STATE["w"].reshape(3, 2)},
        {"w": STATE["w"].at[0, 0].set(-0.0)},
        {"n": jnp.uint32(4)},
        {"key": jax.random.key_data(STATE["key"])},
        {"extra": jnp.zeros(0)},
    ],
)
def test_states_that_differ_in_anything_have_other_digests(change):
    assert digest({**STATE, **change}) != digest(STATE)
