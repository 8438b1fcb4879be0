"""SAC on probes with a known answer, its replay and temperature, and what it must not depend on."""

import functools

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.probes import Probe

from gril_jax.config import RunConfig, SACConfig
from gril_jax.errors import ConfigError
from gril_jax.rl import sac_loss
from gril_jax.rl.policy import fresh_normalizer
from gril_jax.rl.sac import SAC, Hyper, Row, Static

STATIC = Static(
    num_envs=16, unroll_length=4, updates_per_step=8, batch_size=64, replay_size=2048,
    min_replay=256, hidden=(16,), observe_activity=False, window=4,
)  # fmt: skip
GAMMA = 0.8
# Next to no temperature, so that the value of a state is that of the rewards alone.
HYPER = Hyper(
    learning_rate=5e-3, initial_alpha=1e-3, alpha_learning_rate=0.0, discounting=GAMMA,
    soft_update=0.05,
)  # fmt: skip
HYPER = Hyper(*map(jnp.float32, HYPER))
CONSTANT, SEEN, DONE, LATE = np.eye(4, dtype=np.float32)  # what is rewarded
UPDATES = 200


def weighted(weights, state, active):
    """A constant, the sign that was seen, action times sign, and the task's end."""
    del active
    return weights @ jnp.stack([jnp.ones(()), state.data.before, state.reward, state.done])


def _sac(static=STATIC, reward=weighted, **options):
    return SAC(Probe(**options), reward, static)


# ---------------------------------------------------------------- probes

# Weights of the reward, options of the probe, and what is different about the hyper-parameters.
PROBES = {
    "constant": (CONSTANT, {}, {}),
    "seen": (SEEN, {}, {}),
    "done": (DONE, {}, {}),
    "late": (LATE, {"ends": 2, "clock": True}, {}),
    "ends": (CONSTANT, {"ends": 1}, {}),
    "burns": (-CONSTANT, {"burns": True}, {}),
    "breaks": (DONE, {"breaks": 2, "fragile": 0.5}, {}),
    "warm": (DONE, {}, {"initial_alpha": 1.0, "alpha_learning_rate": 1e-2}),
}


@pytest.fixture(scope="module")
def solved():
    """One program for all probes: what is learned from each, its metrics, and the algorithm."""
    never = {"ends": 10**6, "breaks": 10**6, "fragile": 0.0, "burns": False, "clock": False}

    def learn(weights, options, hyper):
        sac = _sac(**options)
        start = sac.init(jax.random.key(0), hyper)
        return jax.lax.scan(lambda s, _: sac.step(s, hyper, weights), start, length=UPDATES)

    cases = [
        (weights, never | options, HYPER._replace(**{k: jnp.float32(v) for k, v in hyper.items()}))
        for weights, options, hyper in PROBES.values()
    ]
    states, metrics = jax.jit(jax.vmap(learn))(*jax.tree.map(lambda *x: jnp.stack(x), *cases))
    chex.assert_tree_all_finite((states.learned, states.normalizer))
    return {
        name: jax.tree.map(lambda x, i=i: x[i], (states, metrics)) for i, name in enumerate(PROBES)
    }


def _q(state, sign, action, time=0):
    nets = _sac().networks
    seen, done = jnp.array([sign, time], jnp.float32), jnp.array([action], jnp.float32)
    return float(
        nets.q_network.apply(state.normalizer, state.learned.params.critic, seen, done).min()
    )


def _mean_action(state, sign):
    nets = _sac().networks
    seen = jnp.array([sign, 0], jnp.float32)
    logits = nets.policy_network.apply(state.normalizer, state.learned.params.policy, seen)
    return float(nets.parametric_action_distribution.mode(logits)[0])


def test_critics_learn_a_constant_and_bootstrap_at_the_time_limit(solved):
    """Episodes of 8 steps are cut, not ended: 1 / (1 - 0.8) = 5. As ends: 2.9."""
    state, _ = solved["constant"]
    for sign in (-1, 1):
        assert _q(state, sign, 0.3) == pytest.approx(5.0, abs=0.4)


def test_critics_do_not_bootstrap_where_the_task_ends(solved):
    state, _ = solved["ends"]
    for sign in (-1, 1):
        assert _q(state, sign, 0.3) == pytest.approx(1.0, abs=0.1)


def test_critics_read_the_observation(solved):
    state, _ = solved["seen"]
    for sign in (-1, 1):
        assert _q(state, sign, 0.3) == pytest.approx(sign, abs=0.2)


def test_critics_discount_a_reward_that_comes_late(solved):
    """It comes with the second and last step of an episode."""
    state, _ = solved["late"]
    for sign in (-1, 1):
        assert _q(state, sign, 0.3, time=0) == pytest.approx(GAMMA, abs=0.1)
        assert _q(state, sign, 0.3, time=1) == pytest.approx(1.0, abs=0.1)


def test_actor_learns_the_action_that_the_observation_asks_for(solved):
    state, _ = solved["done"]
    for sign in (-1, 1):
        assert sign * _mean_action(state, sign) > 0.8
        # Critics know that the other action costs 2 now, and nothing later.
        assert _q(state, sign, sign) - _q(state, sign, -sign) == pytest.approx(2.0, abs=0.5)


def test_breaking_the_simulation_is_not_learned_as_a_way_out_of_a_negative_reward(solved):
    """Actions above 0.5 break it; such steps tell the critics nothing, so all values stay alike."""
    state, metrics = solved["burns"]
    assert metrics["nonfinite"][0] > 0
    assert metrics["nonfinite"][-20:].mean() < 0.9 * 16 * 4
    assert _q(state, 1, 0.0) == pytest.approx(-5.0, abs=0.4)


def test_broken_lanes_leave_all_weights_finite(solved):
    state, metrics = solved["breaks"]
    assert metrics["nonfinite"].min() > 0
    assert 0 < np.mean(state.replay.rows.dropped) < 1
    chex.assert_tree_all_finite((state.learned, state.normalizer, state.replay))


def test_temperature_brings_the_entropy_to_its_target(solved):
    """Left alone it would fall as low as it can: the reward asks for one action."""
    state, metrics = solved["warm"]
    batch = _transitions(observation=jnp.zeros((512, 2)).at[:, 0].set(1.0))
    entropy = sac_loss._entropy(
        _sac().networks, state.learned.params.policy, state.normalizer, batch, jax.random.key(0)
    )
    assert float(entropy.mean()) == pytest.approx(-0.5, abs=0.3)
    assert 1e-3 < float(metrics["alpha"][-1]) < 0.9
    assert float(metrics["alpha"][0]) == 1.0  # the replay is not yet full enough


def _transitions(observation):
    n = len(observation)
    zero, action = jnp.zeros(n), jnp.zeros((n, 1))
    return _sac()._transitions(Row(observation, action, observation, zero, zero, zero))


# ---------------------------------------------------------------- replay


@pytest.fixture(scope="module")
def fragile():
    return _sac(STATIC, weighted, breaks=3, fragile=0.3)


@pytest.fixture(scope="module")
def gathered(fragile):
    """Two unrolls without learning, before the replay is full enough: (state, steps of both)."""

    @jax.jit
    def gather(key):
        def move(state, key):
            quiet = jnp.arange(16) < 4
            state, steps = fragile.collect(state, key, HYPER, CONSTANT, deterministic=quiet)
            return fragile.store(state, steps), steps

        start = fragile.init(key, HYPER)
        return jax.lax.scan(move, start, jax.random.split(jax.random.key(1), 2))

    return gather(jax.random.key(0))


def test_replay_holds_every_transition_in_order_with_what_came_before_a_reset(gathered):
    state, steps = gathered
    assert int(state.replay.size) == int(state.replay.position) == 2 * 4 * 16
    rows = jax.tree.map(
        lambda x: x[: 2 * 4 * 16].reshape(2, 4, 16, *x.shape[1:]), state.replay.rows
    )
    np.testing.assert_array_equal(rows.observation, steps.observation)
    np.testing.assert_array_equal(rows.action, steps.action)
    np.testing.assert_array_equal(rows.next_observation, steps.last)
    # A time limit does not end the task; a step that was taken back is to be left out.
    assert steps.result.truncated.any()
    assert np.all(np.asarray(rows.discount) == 1)
    np.testing.assert_array_equal(rows.reward, steps.result.reward)
    np.testing.assert_array_equal(rows.dropped, steps.result.nonfinite)
    assert np.asarray(rows.dropped).any()


def test_actions_are_uniform_until_the_replay_is_full_enough(gathered):
    _, steps = gathered
    wild, quiet = steps.action[:, :, 4:, 0], steps.action[:, :, :4, 0]
    assert np.abs(np.mean(wild)) < 0.2
    assert np.mean(np.abs(wild)) == pytest.approx(0.5, abs=0.1)
    assert np.abs(wild).max() <= 1
    # Mean actions follow from what is seen; drawn ones are never twice the same.
    seen = np.asarray(steps.observation[:, :, :4]).reshape(quiet.size, -1)
    _, which = np.unique(seen, axis=0, return_inverse=True)
    for sight in range(which.max() + 1):
        assert np.ptp(np.asarray(quiet).reshape(-1)[which.reshape(-1) == sight]) < 1e-5
    assert which.max() + 1 < quiet.size / 2
    assert len(np.unique(wild)) == wild.size


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"replay_size": 1000}, "replay_size is 1000, but must be a multiple of"),
        ({"min_replay": 4096}, "min_replay is 4096, but must be at most replay_size"),
    ],
)
def test_what_does_not_fit_together_is_refused_in_one_sentence(change, text):
    with pytest.raises(ConfigError, match=text):
        _sac(Static(**{**STATIC.__dict__, **change}))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"replay_size": 1000}, r"sac\.replay_size is 1000.* = 256, such as 768"),
        ({"replay_size": 100}, r"sac\.replay_size is 100.* such as 256"),
        ({"min_replay": 2**19}, r"sac\.min_replay is 524288.* which is 131072"),
        ({"num_timesteps": 255}, r"sac\.num_timesteps is 255.* = 256 steps"),
    ],
)
def test_a_configuration_that_does_not_fit_together_is_refused(change, text):
    with pytest.raises(ConfigError, match=text):
        RunConfig(sac=SACConfig(**change))


# ---------------------------------------------------------------- the gradient step


@pytest.fixture(scope="module")
def learner():
    """Weights, a batch with one dropped row, and the compiled gradient step."""
    sac = _sac()
    begin = jax.jit(functools.partial(sac_loss.begin, sac.networks))
    learned = begin(jax.random.key(0), HYPER)
    rng = np.random.default_rng(0)
    rows = Row(
        *(jnp.asarray(rng.normal(size=(8, n)), jnp.float32) for n in (2, 1, 2)),
        *(jnp.ones(8), jnp.zeros(8).at[3].set(1.0), jnp.asarray(rng.normal(size=8), jnp.float32)),
    )
    step = jax.jit(functools.partial(sac_loss.gradient_step, sac.networks))
    return sac, learned, rows, step


def _step(learner, rows, hyper=HYPER):
    sac, learned, _, step = learner
    normalizer = fresh_normalizer(2)
    batch = sac._transitions(rows)
    return step(learned, normalizer, batch, jax.random.key(1), hyper)


def test_dropped_rows_teach_the_critics_nothing(learner):
    _, _, rows, _ = learner
    one, losses = _step(learner, rows)
    other, same = _step(learner, rows._replace(reward=rows.reward.at[3].set(1e6)))
    chex.assert_trees_all_equal(one.params.critic, other.params.critic)
    assert float(losses["loss/critic"]) == float(same["loss/critic"])


def test_learning_rates_are_arguments_of_their_own_parts(learner):
    _, learned, rows, _ = learner
    still = HYPER._replace(learning_rate=jnp.float32(0), alpha_learning_rate=jnp.float32(0.1))
    after, _ = _step(learner, rows, still)
    chex.assert_trees_all_equal(after.params[:2], learned.params[:2])
    # A new policy's entropy is above the target; Adam's first step is as long as its rate.
    change = float(after.params.log_alpha - learned.params.log_alpha)
    assert change == pytest.approx(-0.1, rel=1e-3)


def test_target_follows_the_critics_by_its_share(learner):
    _, learned, rows, _ = learner
    after, _ = _step(learner, rows)
    expected = jax.tree.map(lambda t, c: 0.95 * t + 0.05 * c, learned.target, after.params.critic)
    chex.assert_trees_all_close(after.target, expected, atol=1e-6)


def test_a_gradient_that_is_cut_to_nothing_moves_nothing(learner):
    """Adam divides by the gradient's size, but for its epsilon of 1e-8."""
    _, learned, rows, _ = learner
    after, _ = _step(learner, rows, HYPER._replace(max_grad_norm=jnp.float32(1e-12)))
    chex.assert_trees_all_close(after.params, learned.params, atol=1e-5)
