"""Frames with objects displaced: what may be moved, what it costs, and what the loss says of it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax import encoder, pretrain_contrast, reward
from gril_jax.encoder import EncoderConfig
from gril_jax.final_places import final_places
from gril_jax.pretrain_options import Hyper, PretrainConfig
from gril_jax.types import DemoBatch

# Region, robot, a block that the video moves, one that it does not, and padding.
FIRST = np.array([[0.5, 0.5], [-0.9, 0.0], [-0.5, 0.0], [0.0, -0.6], [0.0, 0.0]], np.float32)
LAST = np.array([[0.5, 0.5], [0.3, 0.4], [0.5, 0.6], [0.0, -0.6], [0.0, 0.0]], np.float32)
MOVABLE = jnp.array([True, False, True, True, False])
DIAGONAL = jnp.full(5, 0.3)
EXTENT = 1.1


@pytest.fixture(scope="module")
def of():
    return pretrain_contrast.journey(
        jnp.asarray(FIRST), jnp.asarray(LAST), DIAGONAL, MOVABLE, idle_cost=0.25
    )


@pytest.fixture(scope="module")
def draw(of):
    """500 copies of one frame."""

    @jax.jit
    def copies(center, active):
        keys = jax.random.split(jax.random.key(0), 500)
        return jax.vmap(
            lambda key: pretrain_contrast.displaced(key, center, DIAGONAL, active, of, EXTENT)
        )(keys)

    return copies


def test_a_journey_costs_one_in_all_for_what_was_moved(of):
    np.testing.assert_allclose(of.cost, [0.25, 0, 1, 0.25, 0])


def test_a_video_that_moves_nothing_has_finite_costs():
    still = pretrain_contrast.journey(
        jnp.asarray(FIRST), jnp.asarray(FIRST), DIAGONAL, MOVABLE, idle_cost=0.25
    )
    np.testing.assert_allclose(still.cost, [0.25, 0, 0.25, 0.25, 0])


def test_each_copy_of_the_last_frame_displaces_something(draw):
    active = jnp.array([False, True, True, False, False])
    made = jax.tree.map(np.asarray, draw(jnp.asarray(LAST), active))
    offset = np.linalg.norm(made.center - LAST, axis=2)
    np.testing.assert_array_equal(offset[:, [1, 4]], 0)  # robot and padding stay
    # Back to the start is no other place for what never left it.
    assert (offset[:, [0, 2, 3]] > 0).any(1).mean() > 0.8
    assert (offset[:, [0, 2, 3]] > 0).any(0).all()
    assert np.abs(made.center).max() <= EXTENT
    assert made.active[:, [1, 2]].all()
    assert made.active[offset > 1e-6].all()  # what was displaced has moved


def test_what_has_not_come_to_rest_stays(draw):
    """The block is under way: nobody can say whether another place is further on."""
    under_way = LAST.copy()
    under_way[2] = [0.0, 0.3]
    made = draw(jnp.asarray(under_way), jnp.zeros(5, bool))
    np.testing.assert_array_equal(made.center[:, 2], np.tile(under_way[2], (500, 1)))


def _demos(num=3, frames=6):
    share = np.linspace(0, 1, frames)[:, None, None]
    path = (FIRST + share * (LAST - FIRST)).astype(np.float32)
    return DemoBatch(
        center=jnp.tile(path, (num, 1, 1, 1)),
        size=jnp.full((num, frames, 5, 2), 0.2),
        label=jnp.tile(jnp.array([0, 1, 2, 3, 0]), (num, 1)),
        is_robot=jnp.tile(jnp.arange(5) == 1, (num, 1)),
        present=jnp.tile(jnp.arange(5) < 4, (num, 1)),
        length=jnp.full(num, frames),
    )


CONFIG = PretrainConfig(EncoderConfig(4, width=8, rounds=1, latent=4), copies=3, anchors=4)


def _contrast(params, demos, **hyper):
    active = jnp.zeros(demos.center.shape[:3], bool)
    places = final_places(demos, CONFIG.encoder.num_classes)
    return pretrain_contrast.contrast(
        params, jax.random.key(3), demos, active, places, Hyper(**hyper), CONFIG
    )


def test_the_loss_is_smallest_for_a_reward_that_tells_copies_apart():
    """A few steps down its gradient bring copies' rewards nearer to what they are worth."""
    demos = _demos()
    params = encoder.init(jax.random.key(0), CONFIG.encoder)

    @jax.jit
    def descend(params):
        def step(params, _):
            loss, slope = jax.value_and_grad(_contrast)(params, demos, span=1.0)
            return jax.tree.map(lambda p, g: p - 0.02 * g, params, slope), loss

        return jax.lax.scan(step, params, length=150)

    params, losses = descend(params)
    assert np.isfinite(np.asarray(losses)).all()
    assert float(losses[-1]) < 0.5 * float(losses[0])
    still = jnp.zeros(demos.center.shape[:3], bool)
    learned = reward.from_demos(params, demos, CONFIG.encoder, active=still)
    assert float(learned.scale) == pytest.approx(1.0, abs=0.3)  # span 1
