"""Fresh weights: of brax's shapes and of brax's distribution, though drawn all at once."""

import chex
import jax
import numpy as np
import pytest
from brax.training.agents.ppo import networks as of_ppo
from brax.training.agents.sac import networks as of_sac

from gril_jax.rl.policy import fresh_weights

KEY = jax.random.key(0)


def _networks(kind):
    if kind == "ppo":
        made = of_ppo.make_ppo_networks(7, 2, policy_hidden_layer_sizes=(64, 32))
        return made.policy_network, made.value_network
    made = of_sac.make_sac_networks(7, 2, hidden_layer_sizes=(64, 32))
    return made.policy_network, made.q_network


@pytest.mark.parametrize("kind", ["ppo", "sac"])
def test_weights_have_the_shapes_and_the_spread_of_braxs_own(kind):
    """Of 200 draws: the same extremes, deviations and means, layer by layer; no bias."""
    networks = _networks(kind)
    keys = jax.random.split(KEY, 200)
    ours = jax.jit(jax.vmap(lambda key: fresh_weights(key, *networks)))(keys)
    brax = [jax.jit(jax.vmap(network.init))(keys) for network in networks]
    chex.assert_trees_all_equal_shapes_and_dtypes(ours, brax)
    for mine, theirs in zip(jax.tree.leaves(ours), jax.tree.leaves(brax), strict=True):
        mine, theirs = np.asarray(mine), np.asarray(theirs)
        if mine.ndim == 2:  # biases, of all draws
            assert not mine.any()
            assert not theirs.any()
            continue
        assert np.abs(mine).max() == pytest.approx(np.abs(theirs).max(), rel=0.02)
        assert mine.std() == pytest.approx(theirs.std(), rel=0.02)
        assert abs(mine.mean()) < 0.05 * mine.std()


def test_no_two_weights_are_the_same_draw():
    kernels = [x for x in jax.tree.leaves(fresh_weights(KEY, *_networks("ppo"))) if x.ndim == 2]
    drawn = np.concatenate([np.ravel(x) * np.sqrt(x.shape[0]) for x in kernels])
    assert len(np.unique(np.round(drawn, 6))) > 0.9 * drawn.size  # a few round to the same
