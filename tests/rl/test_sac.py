"""SAC: its replay, and its gradient step, which is the same for whoever takes it."""

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
CONSTANT = np.eye(4, dtype=np.float32)[0]  # what is rewarded


def weighted(weights, state, active):
    """A constant, the sign that was seen, action times sign, and the task's end."""
    del active
    return weights @ jnp.stack([jnp.ones(()), state.data.before, state.reward, state.done])


def _sac(static=STATIC, reward=weighted, **options):
    return SAC(Probe(**options), reward, static)


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
