"""Fresh weights are distributed as brax's; of sub-policies that of the present stage answers."""

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.training.agents.ppo import networks as of_ppo
from brax.training.agents.sac import networks as of_sac

from gril_jax.rl.policy import fresh_normalizer, fresh_weights, normalize, of_stages, stage

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


# --- sub-policies

COUNT, SIZE = 3, 5
MADE = of_ppo.make_ppo_networks(
    SIZE, 2, preprocess_observations_fn=normalize, policy_hidden_layer_sizes=(8,),
    value_hidden_layer_sizes=(8,),
)  # fmt: skip
NORMALIZER = fresh_normalizer(SIZE)


def _observations(*finished):
    drawn = jax.random.normal(jax.random.key(1), (len(finished), SIZE))
    return drawn.at[:, -1].set(jnp.array(finished) / COUNT)


@pytest.mark.parametrize("network", [MADE.policy_network, MADE.value_network])
def test_the_network_of_the_present_stage_answers(network):
    """For a batch in all stages, against the single networks one by one."""
    several = of_stages(network, COUNT)
    (params,) = fresh_weights(jax.random.key(0), several)
    observations = _observations(0, 1, 2, 3, 1)
    got = jax.jit(several.apply)(NORMALIZER, params, observations)
    for number, (one, of) in enumerate(zip(observations, (0, 1, 2, 2, 1), strict=True)):
        alone = network.apply(NORMALIZER, jax.tree.map(lambda x, of=of: x[of], params), one)
        np.testing.assert_allclose(got[number], alone, rtol=1e-5, atol=1e-6)


def test_only_the_present_stage_has_a_gradient():
    several = of_stages(MADE.policy_network, COUNT)
    (params,) = fresh_weights(jax.random.key(0), several)

    def squares(params):
        return jnp.sum(several.apply(NORMALIZER, params, _observations(1, 1)) ** 2)

    for leaf in jax.tree.leaves(jax.grad(squares)(params)):
        assert np.any(leaf[1])
        assert not np.any(leaf[jnp.array([0, 2])])


def test_weights_of_stages_differ_and_biases_are_none():
    (params,) = fresh_weights(jax.random.key(0), of_stages(MADE.policy_network, COUNT))
    for layer in params["params"].values():
        assert np.abs(np.diff(layer["kernel"], axis=0)).min() > 0
        assert layer["kernel"].std() == pytest.approx(layer["kernel"].shape[1] ** -0.5, rel=0.2)
        assert not layer["bias"].any()


def test_one_sub_policy_is_the_network_itself():
    assert of_stages(MADE.policy_network, 1) is MADE.policy_network


def test_the_last_stage_goes_on_when_all_are_finished():
    assert stage(_observations(0, 1, 2, 3), COUNT).tolist() == [0, 1, 2, 2]


def test_sub_policies_share_out_more_stages_than_they_are():
    """Of three stages two sub-policies have two and one; a single stage is the first one's."""
    assert stage(_observations(0, 1, 2, 3), 2).tolist() == [0, 0, 1, 1]
    assert stage(jnp.array([[0.0], [1.0]]), 2).tolist() == [0, 1]
