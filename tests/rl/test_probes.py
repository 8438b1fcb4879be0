"""PPO and SAC on probes with a known answer: what critics and actors learn of each."""

import functools

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.probes import Probe

from gril_jax.rl import ppo, sac, sac_loss
from gril_jax.rl.policy import LEAST_DEVIATION, MAX_OBSERVATION, normalize

GAMMA = 0.8
SIZES = {"num_envs": 16, "hidden": (16,), "observe_activity": False, "window": 4}
STATIC = {
    "ppo": ppo.Static(unroll_length=8, num_minibatches=2, num_epochs=4, **SIZES),
    "sac": sac.Static(
        unroll_length=4, updates_per_step=8, batch_size=64, replay_size=2048, min_replay=256,
        **SIZES,
    ),
}  # fmt: skip
HYPER = {
    "ppo": ppo.Hyper(learning_rate=5e-3, discounting=GAMMA),
    # Next to no temperature, so that the value of a state is that of the rewards alone.
    "sac": sac.Hyper(
        learning_rate=5e-3, initial_alpha=1e-3, alpha_learning_rate=0.0, discounting=GAMMA,
        soft_update=0.05,
    ),
}  # fmt: skip
UPDATES = {"ppo": 120, "sac": 200}
CONSTANT, SEEN, DONE, LATE = np.eye(4, dtype=np.float32)  # what is rewarded

# Weights of the reward, and options of the probe.
PROBES = {
    "constant": (CONSTANT, {}),
    "seen": (SEEN, {}),
    "done": (DONE, {}),
    "late": (LATE, {"ends": 2, "clock": True}),
    "ends": (CONSTANT, {"ends": 1}),
    "burns": (-CONSTANT, {"burns": True}),
    "breaks": (DONE, {"breaks": 2, "fragile": 0.5}),
    "warm": (DONE, {}),  # with a temperature, which SAC alone has
}


def weighted(weights, state, active):
    """A constant, the sign that was seen, action times sign, and the task's end."""
    del active
    return weights @ jnp.stack([jnp.ones(()), state.data.before, state.reward, state.done])


@functools.cache
def _made(kind):
    return {"ppo": ppo.PPO, "sac": sac.SAC}[kind](Probe(), weighted, STATIC[kind])


class Solved:
    """One program for all probes of an algorithm: what is learned from each, and its metrics."""

    def __init__(self, kind):
        self.kind, self.networks = kind, _made(kind).networks
        never = {"ends": 10**6, "breaks": 10**6, "fragile": 0.0, "burns": False, "clock": False}
        hyper = HYPER[kind]._replace

        def learn(weights, options, hyper):
            of = type(_made(kind))(Probe(**options), weighted, STATIC[kind])
            start = of.init(jax.random.key(0), hyper)
            return jax.lax.scan(
                lambda s, _: of.step(s, hyper, weights), start, length=UPDATES[kind]
            )

        warm = {"initial_alpha": 1.0, "alpha_learning_rate": 1e-2}
        cases = [
            (
                weights, never | options,
                jax.tree.map(jnp.float32, hyper(**warm) if name == "warm" else hyper()),
            )
            for name, (weights, options) in PROBES.items()
            if name != "warm" or kind == "sac"
        ]  # fmt: skip
        found = jax.jit(jax.vmap(learn))(*jax.tree.map(lambda *x: jnp.stack(x), *cases))
        chex.assert_tree_all_finite(jax.tree.map(_data, found[0]._replace(envs=(), key=())))
        self.found = {
            name: jax.tree.map(lambda x, i=i: x[i], found)
            for i, name in enumerate([*PROBES][: len(cases)])
        }

    def value(self, probe, sign, time=0, action=0.3):
        """What the critic, or the more pessimistic one, says of what is seen."""
        state, seen = self.found[probe][0], jnp.array([sign, time], jnp.float32)
        if self.kind == "ppo":
            params = state.params.value
            return float(self.networks.value_network.apply(state.normalizer, params, seen))
        done = jnp.array([action], jnp.float32)
        params = state.learned.params.critic
        return float(self.networks.q_network.apply(state.normalizer, params, seen, done).min())

    def mean_action(self, sign):
        """The action that the policy of "done" prefers."""
        state, seen = self.found["done"][0], jnp.array([sign, 0], jnp.float32)
        params = state.params if self.kind == "ppo" else state.learned.params
        logits = self.networks.policy_network.apply(state.normalizer, params.policy, seen)
        return float(self.networks.parametric_action_distribution.mode(logits)[0])


def _data(leaf):
    return jax.random.key_data(leaf) if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key) else leaf


@pytest.fixture(scope="module", params=["ppo", "sac"])
def solved(request):
    return Solved(request.param)


@pytest.mark.parametrize("sign", [-1, 1])
def test_critics_learn_what_is_due(solved, sign):
    """Episodes of 8 steps are cut, not ended: 1 / (1 - 0.8) = 5; as ends it would be 2.9."""
    assert solved.value("constant", sign) == pytest.approx(5.0, abs=0.4)
    assert solved.value("ends", sign) == pytest.approx(1.0, abs=0.1)
    each = 16 * STATIC[solved.kind].unroll_length
    assert solved.found["ends"][1]["episodes"][-1] == each
    assert solved.value("seen", sign) == pytest.approx(sign, abs=0.3)
    # It comes with the second and last step of an episode.
    assert solved.value("late", sign, time=0) == pytest.approx(GAMMA, abs=0.1)
    assert solved.value("late", sign, time=1) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("sign", [-1, 1])
def test_actors_learn_the_action_that_the_observation_asks_for(solved, sign):
    assert sign * solved.mean_action(sign) > 0.8
    if solved.kind == "sac":  # critics know that the other one costs 2 now, and nothing later
        both = (solved.value("done", sign, action=side * sign) for side in (1, -1))
        assert next(both) - next(both) == pytest.approx(2.0, abs=0.5)


def test_breaking_the_simulation_is_not_learned_as_a_way_out_of_a_negative_reward(solved):
    """Actions above 0.5 break it. Were that an end with nothing to come, all steps would.

    PPO's become more at first, while the critic lags behind: a cut step has advantage 0, and
    normalising lifts it above the negative ones. That passes; then nothing pulls either way. SAC's
    critics learn nothing from such steps, so that all values stay alike.
    """
    steps = 16 * STATIC[solved.kind].unroll_length
    share = np.asarray(solved.found["burns"][1]["nonfinite"]) / steps
    assert share[0] > 0  # it happens, by chance
    later = share[40:60].max() if solved.kind == "ppo" else share[-20:].mean()
    assert later < 0.9
    if solved.kind == "sac":
        assert solved.value("burns", 1, action=0.0) == pytest.approx(-5.0, abs=0.4)


def test_broken_lanes_leave_all_weights_finite(solved):
    state, metrics = solved.found["breaks"]
    assert metrics["nonfinite"].min() > 0
    if solved.kind == "sac":
        assert 0 < np.mean(state.replay.rows.dropped) < 1


def test_an_observation_that_was_constant_so_far_does_not_blow_up_the_networks(solved):
    """It counts as if it had varied a little until it first changes."""
    if solved.kind == "sac":
        pytest.skip("both have the same statistics")
    state, _ = solved.found["done"]
    constant = np.asarray(state.normalizer.std) == np.float32(LEAST_DEVIATION)
    assert constant.any()
    ones = jnp.ones(2)
    seen = normalize(ones, state.normalizer)
    beyond = (ones - state.normalizer.mean)[constant] / LEAST_DEVIATION
    np.testing.assert_allclose(seen[constant], beyond, rtol=1e-5)
    assert np.abs(seen).max() <= MAX_OBSERVATION
    for network, params in (
        (solved.networks.value_network, state.params.value),
        (solved.networks.policy_network, state.params.policy),
    ):
        out = network.apply(state.normalizer, params, ones)
        nearby = network.apply(state.normalizer, params, 0.9 * ones)
        assert np.abs(out - nearby).max() < 10  # one deviation apart


def test_temperature_brings_the_entropy_to_its_target(solved):
    """Left alone it would fall as low as it can: the reward asks for one action."""
    if solved.kind == "ppo":
        pytest.skip("it has none")
    state, metrics = solved.found["warm"]
    seen, zero = jnp.zeros((512, 2)).at[:, 0].set(1.0), jnp.zeros(512)
    batch = _made("sac")._transitions(sac.Row(seen, zero[:, None], seen, zero, zero, zero))
    entropy = sac_loss._entropy(
        solved.networks, state.learned.params.policy, state.normalizer, batch, jax.random.key(0)
    )
    assert float(entropy.mean()) == pytest.approx(-0.5, abs=0.3)
    assert 1e-3 < float(metrics["alpha"][-1]) < 0.9
    assert float(metrics["alpha"][0]) == 1.0  # the replay is not yet full enough
